#!/bin/sh
# Runs api/examples/walkthrough.sh against a daemon of its own: examples.sh API_DIR BIN_DIR
set -eu
api=$1 bin=$2
work=$(mktemp -d)
daemon=
finish() {
    [ -z "$daemon" ] || kill "$daemon" 2>/dev/null || true
    [ -z "$daemon" ] || wait "$daemon" 2>/dev/null || true
    rm -rf "$work"
}
trap finish EXIT
"$bin/blockwright" sample cuboid --size 2 -o "$work/part.hexex" >/dev/null 2>&1
"$bin/blockwrightd" --data "$work/data" --listen 127.0.0.1:0 2>"$work/log" &
daemon=$!
i=0
while [ ! -s "$work/data/address" ]; do
    i=$((i + 1))
    [ $i -lt 200 ] || { cat "$work/log"; exit 1; }
    sleep 0.1
done
cd "$work"
sh "$api/examples/walkthrough.sh" part.hexex "$(cat data/address)" >out 2>&1 || { cat out log; exit 1; }
for expected in '"version"' '"ready": true' 'HTTP/1.1 200 OK' '"parameters": "' 'the job is successful' '"traced.hexex"' 'second time: 304' 'in part: 206' 'Blockwright-Blob: ' \
    '"blocks": 1' 'event: end' 'event: state' '/problems/job-finished' 'the deleted job: 410' '"walkthrough"' '"openapi": "3.1.0"'; do
    grep -q "$expected" out || { cat out log; echo "missing: $expected"; exit 1; }
done
test -s blocks.json
