#!/bin/sh
# Builds Blockwright and runs its tests: first the debug build (warnings are errors), then the address and the undefined
# behaviour sanitizer builds. Installs what is missing. The last line counts all tests of all builds:
#
#     N passed, N failed[, N skipped]
#
# A build that fails counts as one failed test. Exit code 0 only if nothing failed and something passed.
#
#   sh tests/run.sh                      everything (5 to 10 minutes on two cores)
#   sh tests/run.sh --preset dev         one build only; may be repeated
#   sh tests/run.sh --filter clients     only tests whose name matches the regular expression
#   sh tests/run.sh --no-install         do not look at the installed packages
set -u

usage() { sed -n '2,12s/^# \{0,1\}//p' "$0"; }

presets=
filter=.
install=yes
while [ $# -gt 0 ]; do
    case $1 in
    --preset) presets="$presets ${2:?--preset needs a name}"; shift 2 ;;
    --filter) filter=${2:?--filter needs a regular expression}; shift 2 ;;
    --no-install) install=no; shift ;;
    -h | --help) usage; exit 0 ;;
    *) echo "tests/run.sh: unknown option '$1'; see --help" >&2; exit 2 ;;
    esac
done
presets=${presets:-dev asan ubsan}

cd "$(dirname "$0")/.." || exit 5
[ $install = no ] || sh deploy/install-packages.sh || exit 5
jobs=$(nproc 2>/dev/null || echo 2)

# Reports are read back at the end of every sanitized test; these make any finding a failure of that test.
export ASAN_OPTIONS="detect_leaks=1:halt_on_error=1:${ASAN_OPTIONS:-}"
export UBSAN_OPTIONS="print_stacktrace=1:halt_on_error=1:${UBSAN_OPTIONS:-}"

passed=0
failed=0
skipped=0

# attribute FILE NAME: a count of the test suite element, which CTest spreads over several lines.
attribute() { tr '\n\t' '  ' <"$1" | sed -n "s/.*<testsuite [^>]*[ ]$2=\"\([0-9]*\)\".*/\1/p"; }

run_preset() {
    log=build/$1
    junit=$PWD/build/$1/junit.xml
    rm -f "$junit"
    echo "== $1: build"
    # Debian's Python, for which the packages are: another one may come first in the PATH.
    if ! cmake --preset "$1" -D Python3_EXECUTABLE=/usr/bin/python3 >"$log.configure.log" 2>&1; then
        cat "$log.configure.log"
        echo "== $1: could not be configured"
        failed=$((failed + 1))
        return
    fi
    if ! cmake --build --preset "$1" -j "$jobs" >"$log.build.log" 2>&1; then
        grep -v '^\[[0-9]*/[0-9]*\] ' "$log.build.log" | head -n 200
        echo "== $1: does not build"
        failed=$((failed + 1))
        return
    fi
    echo "== $1: test"
    ctest --preset "$1" -j "$jobs" -R "$filter" --output-junit "$junit"
    if [ ! -s "$junit" ]; then
        echo "== $1: no test result"
        failed=$((failed + 1))
        return
    fi
    all=$(attribute "$junit" tests)
    bad=$(attribute "$junit" failures)
    left=$(($(attribute "$junit" skipped) + $(attribute "$junit" disabled)))
    passed=$((passed + all - bad - left))
    failed=$((failed + bad))
    skipped=$((skipped + left))
}

mkdir -p build || exit 5
for preset in $presets; do
    run_preset "$preset"
done

line="$passed passed, $failed failed"
[ $skipped -eq 0 ] || line="$line, $skipped skipped"
echo "$line"
[ $failed -eq 0 ] && [ $passed -gt 0 ]
