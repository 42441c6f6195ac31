#!/bin/sh
# Validates every response to the examples, to mistakes and to the wrong tokens: responses.sh API_DIR BIN_DIR
set -eu
api=$1 bin=$2
here=$(cd "$(dirname "$0")" && pwd)
set -- --owner-jobs 20 --owner-bytes 1M --owner-streams 3 --workers 1 --max-uploads 2 --config settings
. "$here/daemon.sh"
export DAEMON="$daemon"
python3 "$here/check_responses.py" "$(cat data/address)" "$api" sh "$here/calls.sh" "$api" "$bin" "$work" {} && code=0 || code=$?
[ $code = 0 ] || [ $code = 77 ] || cat out log
exit $code
