#!/bin/sh
# Installs the Debian packages that building and testing Blockwright needs; does nothing when they are all there.
# The one list of them: deploy/demo.sh, tests/run.sh and .ci/run call this file. Needs root, or sudo for the install.
#
#   sh deploy/install-packages.sh          install what is missing
#   sh deploy/install-packages.sh --list   print the list
set -eu

packages="
    build-essential cmake ninja-build pkg-config python3 python3-yaml ca-certificates
    libjansson-dev libgmp-dev libexpat1-dev zlib1g-dev libdraco-dev libsqlite3-dev libmicrohttpd-dev libgnutls28-dev libcurl4-openssl-dev libssl-dev libseccomp-dev
    coinor-libclp-dev coinor-libcbc-dev libsuitesparse-dev libzstd-dev libcgns-dev
    libcmocka-dev openssl curl python3-meshio python3-jsonschema cgns-convert
"

say() { printf '%s\n' "install-packages: $*" >&2; }

if [ "${1:-}" = --list ]; then
    # shellcheck disable=SC2086
    printf '%s\n' $packages
    exit 0
fi

missing=
for package in $packages; do
    state=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null || true)
    [ "$state" = installed ] || missing="$missing $package"
done
[ -n "$missing" ] || exit 0

if ! command -v apt-get >/dev/null 2>&1; then
    say "this is not a Debian system; please install by hand:$missing"
    exit 5
fi
sudo=
if [ "$(id -u)" != 0 ]; then
    if ! command -v sudo >/dev/null 2>&1; then
        say "root or sudo is needed to install:$missing"
        exit 5
    fi
    sudo=sudo
fi
say "installing:$missing"
# Slow mirrors are the usual reason for a failure, so each download is tried three times.
$sudo env DEBIAN_FRONTEND=noninteractive apt-get -q -o Acquire::Retries=3 update >&2
# shellcheck disable=SC2086
$sudo env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o Acquire::Retries=3 install --no-install-recommends $missing >&2
