#!/bin/sh
# Runs api/examples/walkthrough.sh against a daemon of its own: examples.sh API_DIR BIN_DIR
set -eu
api=$1 bin=$2
set --
. "$(dirname "$0")/daemon.sh"
sh "$api/examples/walkthrough.sh" part.hexex "$(cat data/address)" >out 2>&1 || { cat out log; exit 1; }
for expected in '"version"' '"ready": true' 'HTTP/1.1 200 OK' '"parameters": "' 'the job is successful' '"traced.hexex"' 'second time: 304' 'in part: 206' 'Blockwright-Blob: ' \
    '"blocks": 1' 'event: end' 'event: state' '/problems/job-finished' 'the deleted job: 410' '"walkthrough"' '"openapi": "3.1.0"'; do
    grep -q "$expected" out || { cat out log; echo "missing: $expected"; exit 1; }
done
test -s blocks.json
