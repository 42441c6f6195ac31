#!/bin/sh
# Workers made to exceed memory, processor time, disk, time and talk, to fork, exec, open sockets and files, signal, ignore SIGTERM: what becomes
# of each job, how long it took, and what became of the job beside it. A test of ctest (server/daemon_limits) that can be run by hand:
#
#   sh tests/server/limits.sh [BUILD]      BUILD defaults to build/dev
set -eu
build=${1:-build/dev}
exec "$(find "$build" -name server_daemon_limits -type f | head -n 1)"
