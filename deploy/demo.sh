#!/bin/sh
# Shows Blockwright at work on this machine: installs what is missing, builds, makes a part, starts the daemon, sends the
# part through its HTTP interface, fetches blocks and hex mesh and tells what they are. Needs root or sudo only if
# packages are missing. Everything it makes is under build/.
#
#   sh deploy/demo.sh                  the daemon is left running; the last lines say where and how to stop it
#   sh deploy/demo.sh --stop-after     stop the daemon at the end
#   sh deploy/demo.sh --stop           only stop the daemon of an earlier demo
#   sh deploy/demo.sh --no-install     do not look at the installed packages
#   sh deploy/demo.sh FILE.hexex       send this part instead
set -eu

usage() { sed -n '2,11s/^# \{0,1\}//p' "$0"; }

stop_after=no
only_stop=no
install=yes
part=
while [ $# -gt 0 ]; do
    case $1 in
    --stop-after) stop_after=yes ;;
    --stop) only_stop=yes ;;
    --no-install) install=no ;;
    -h | --help) usage; exit 0 ;;
    -*) echo "demo.sh: unknown option '$1'; see --help" >&2; exit 2 ;;
    *) part=$(realpath "$1") ;;
    esac
    shift
done

cd "$(dirname "$0")/.."
bin=$PWD/build/release/bin
here=$PWD/build/demo
step() { printf '\n== %s\n' "$*"; }

# The daemon of an earlier demo, if it still runs and is really ours.
stop_daemon() {
    [ -s "$here/pid" ] || return 0
    pid=$(cat "$here/pid")
    rm -f "$here/pid"
    case $(readlink "/proc/$pid/exe" 2>/dev/null || true) in
    "$bin/blockwrightd"*) ;;
    *) return 0 ;;
    esac
    kill "$pid" 2>/dev/null || return 0
    while kill -0 "$pid" 2>/dev/null; do sleep 0.1; done
    echo "stopped the daemon (process $pid)"
}

start_daemon() {
    rm -f "$here/data/address"
    # Its own session, so that it outlives this terminal.
    setsid "$bin/blockwrightd" --data "$here/data" --listen 127.0.0.1:0 >>"$here/blockwrightd.log" 2>&1 </dev/null &
    echo $! >"$here/pid"
    tries=0
    while [ ! -s "$here/data/address" ]; do
        tries=$((tries + 1))
        if [ $tries -gt 200 ] || ! kill -0 "$(cat "$here/pid")" 2>/dev/null; then
            echo "demo.sh: the daemon did not start:" >&2
            tail -n 20 "$here/blockwrightd.log" >&2
            exit 5
        fi
        sleep 0.1
    done
    server=$(cat "$here/data/address")
    case $server in
    http://*) ;;
    *) server=http://$server ;;
    esac
}

if [ $only_stop = yes ]; then
    stop_daemon
    exit 0
fi
if [ $install = yes ]; then
    step "Packages"
    sh deploy/install-packages.sh
    echo "all there"
fi

step "Build (release)"
mkdir -p "$here"
# Debian's Python, for which the packages above are: another one may come first in the PATH.
build() {
    cmake --preset release -D Python3_EXECUTABLE=/usr/bin/python3 && cmake --build --preset release --target blockwright blockwrightd blockwright-worker
}
if ! build >"$here/build.log" 2>&1; then
    tail -n 40 "$here/build.log" >&2
    echo "demo.sh: the build failed; all of it is in build/demo/build.log" >&2
    exit 5
fi
"$bin/blockwright" --version

if [ -z "$part" ]; then
    step "A part"
    part=$here/part.hexex
    # Vertices off their regular places and a chart of its own for every block, as in parts that come from elsewhere.
    "$bin/blockwright" sample part --size 2 --noise 0.5 --scramble blocks -o "$part"
fi

step "The daemon"
stop_daemon
start_daemon
trap 'stop_daemon' EXIT
BLOCKWRIGHT_SERVER=$server
export BLOCKWRIGHT_SERVER
echo "listening at $server"

step "The job: upload, wait, fetch (clients/sh/blockwright.sh, that is curl)"
rm -rf "$here/result"
id=$(sh clients/sh/blockwright.sh submit "$part" --quantize any --target-hexes 5000)
sh clients/sh/blockwright.sh watch "$id"
sh clients/sh/blockwright.sh fetch "$id" --out "$here/result" --quiet

step "What came out"
"$bin/blockwright" show "$here/result"
if /usr/bin/python3 deploy/draw.py "$here/result/traced.hexex" "$here/result/blocks.svg" >/dev/null; then
    echo "  blocks.svg           a picture of the blocks, pulled apart"
fi

step "Where it is"
echo "files   $here/result"
echo "job     $server/v1/jobs/$id"
if [ $stop_after = yes ]; then
    exit 0 # the trap stops the daemon
fi
trap - EXIT
echo "see it  $server/#$id (in a browser on this machine: the hex mesh)"
echo "daemon  $server (process $(cat "$here/pid"), log build/demo/blockwrightd.log)"
echo "stop    sh deploy/demo.sh --stop"
