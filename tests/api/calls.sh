#!/bin/sh
# What responses.sh records: the examples, mistakes of every kind, a daemon that is not ready, then every operation without a token and with one that does not do.
#     DAEMON=PID calls.sh API_DIR BIN_DIR WORK ADDRESS:PORT      the daemon's file of settings is WORK/settings
set -eu
api=$1 bin=$2 work=$3 address=$4 base=http://$4
here=$(cd "$(dirname "$0")" && pwd)
cd "$work"
failed=0
ask() { # STATUS and what curl is to do
    want=$1
    shift
    got=$(curl -sS -o answer -w '%{http_code}' --max-time 30 "$@") || true
    [ "$got" = "$want" ] || { echo "$got instead of $want: curl $*"; failed=1; }
}
value() { sed -n "s/^ \"$1\": \"\([^\"]*\)\".*/\1/p" answer; }

sh "$api/examples/walkthrough.sh" part.hexex "$address" >out 2>&1 || { cat out; exit 1; }

none=000000000000000000000000
zeros=$(printf '%064d' 0)
hash=$(sha256sum part.hexex | cut -d" " -f1)
json='Content-Type: application/json'
tus='Tus-Resumable: 1.0.0'
offset='Content-Type: application/offset+octet-stream'
jobs=$base/v1/jobs
# no operation
ask 404 "$base/v1/none"
ask 405 -X DELETE "$base/livez"
ask 404 "$base/page/none.js"
ask 421 -H 'Host: elsewhere.example' "$base/livez"
ask 403 -H 'Origin: http://elsewhere.example' -H "$json" -d '{}' "$jobs"
ask 400 "$base/livez?what=1"
# blobs
ask 400 -T part.hexex "$base/v1/blobs/none"
ask 404 -I "$base/v1/blobs/$zeros"
ask 411 -X PUT -H 'Transfer-Encoding: chunked' --data-binary @part.hexex "$base/v1/blobs/$hash"
ask 415 -H 'Content-Encoding: br' -T part.hexex "$base/v1/blobs/$hash"
ask 422 -T part.hexex "$base/v1/blobs/$zeros"
ask 400 -H 'Content-Encoding: gzip' -T part.hexex "$base/v1/blobs/$zeros"
ask 413 -X PUT -H 'Content-Length: 9000000000000000000' -H 'Expect: 100-continue' "$base/v1/blobs/$zeros"
# uploads
ask 412 -X POST -H 'Upload-Length: 4' "$base/v1/uploads"
ask 400 -X POST -H "$tus" -H 'Upload-Length: many' "$base/v1/uploads"
ask 413 -X POST -H "$tus" -H 'Upload-Length: 9000000000000000000' "$base/v1/uploads"
ask 415 -H "$tus" -H 'Upload-Length: 4' -H "$json" -d 'four' "$base/v1/uploads"
ask 460 -H "$tus" -H 'Upload-Length: 4' -H "$offset" -H 'Upload-Checksum: sha1 AAAAAAAAAAAAAAAAAAAAAAAAAAA=' -d 'four' "$base/v1/uploads"
ask 422 -H "$tus" -H 'Upload-Length: 4' -H "$offset" -H "Upload-Metadata: sha256 $(printf %s "$zeros" | base64 -w0)" -d 'four' "$base/v1/uploads"
upload=$base$(curl -sS -D - -o answer -X POST -H "$tus" -H 'Upload-Length: 4' "$base/v1/uploads" | tr -d '\r' | sed -n 's/^[Ll]ocation: //p')
ask 409 -X PATCH -H "$tus" -H 'Upload-Offset: 2' -H "$offset" -d 'ur' "$upload"
ask 400 -X PATCH -H "$tus" -H 'Upload-Offset: two' -H "$offset" -d 'ur' "$upload"
ask 412 -X PATCH -H 'Upload-Offset: 0' -H "$offset" -d 'four' "$upload"
ask 415 -X PATCH -H "$tus" -H 'Upload-Offset: 0' -H "$json" -d 'four' "$upload"
ask 413 -X PATCH -H "$tus" -H 'Upload-Offset: 0' -H "$offset" -d 'fourteen' "$upload"
ask 460 -X PATCH -H "$tus" -H 'Upload-Offset: 0' -H "$offset" -H 'Upload-Checksum: sha1 AAAAAAAAAAAAAAAAAAAAAAAAAAA=' -d 'four' "$upload"
ask 412 -I "$upload"
ask 412 -X DELETE "$upload"
ask 204 -X DELETE -H "$tus" "$upload"
ask 404 -I -H "$tus" "$upload"
ask 404 -X DELETE -H "$tus" "$upload"
ask 404 -X PATCH -H "$tus" -H 'Upload-Offset: 0' -H "$offset" -d 'four' "$upload"
ask 201 -X POST -H "$tus" -H 'Upload-Length: 4' "$base/v1/uploads"
ask 201 -X POST -H "$tus" -H 'Upload-Length: 4' "$base/v1/uploads"
ask 429 -X POST -H "$tus" -H 'Upload-Length: 4' "$base/v1/uploads"
head -c 2000000 /dev/zero >large
ask 429 -T large "$base/v1/blobs/$(sha256sum large | cut -d" " -f1)"
# jobs that are not taken
for path in jobs batches; do
    ask 400 -H "$json" -d '{' "$base/v1/$path"
    ask 400 -H "$json" -H 'Idempotency-Key: a b' -d '{}' "$base/v1/$path"
    ask 415 -H 'Content-Type: text/plain' -d '{}' "$base/v1/$path"
    ask 415 -H "$json" -H 'Content-Encoding: br' -d '{}' "$base/v1/$path"
    ask 413 -H "$json" -X POST -H 'Content-Length: 900000000000' -H 'Expect: 100-continue' "$base/v1/$path"
done
ask 400 -H "$json" -d "{\"input\": \"$hash\", \"options\": {\"beam\": 0}}" "$jobs"
ask 400 -X POST -T part.hexex "$jobs?beam=0"
ask 400 -X POST -T part.hexex "$jobs?what=1"
ask 411 -X POST "$jobs"
ask 413 -X POST -H 'Content-Type:' -H 'Content-Length: 9000000000000000000' -H 'Expect: 100-continue' "$jobs"
ask 422 -X POST -H 'Content-Type:' -d '' "$jobs"
ask 429 -X POST -T large "$jobs"
ask 422 -H "$json" -d "{\"input\": \"$zeros\"}" "$jobs"
ask 422 -H "$json" -d "{\"jobs\": [{\"input\": \"$zeros\"}]}" "$base/v1/batches"
ask 429 -H "$json" -d "{\"jobs\": [$(yes "{\"input\": \"$hash\"}," | head -n 20) {\"input\": \"$hash\"}]}" "$base/v1/batches"
ask 400 "$jobs?limit=0"
ask 400 "$jobs?state=lost"
# a job that fails, one with everything set
printf '1 1\nnothing\n' >bad.hexex
bad=$(sha256sum bad.hexex | cut -d" " -f1)
ask 201 -T bad.hexex "$base/v1/blobs/$bad"
ask 201 -H "$json" -H 'Idempotency-Key: bad' -H 'Prefer: wait=20' -d "{\"input\": \"$bad\"}" "$jobs"
job=$(value id)
ask 200 -H 'Prefer: wait=20' "$jobs/$job"
ask 409 "$jobs/$job/results"
ask 409 "$jobs/$job/results/blocks.json"
ask 409 "$jobs/$job/report"
ask 200 "$jobs/$job/events"
last=$(sed -n 's/^id: //p' answer | tail -n 1)
ask 204 -H "Last-Event-ID: $last" "$jobs/$job/events"
ask 400 -H 'Last-Event-ID: last' "$jobs/$job/events"
ask 400 -H 'Last-Event-ID: last' "$base/v1/events"
ask 400 "$jobs/$job/log?tail=none"
ask 204 -H 'Last-Event-ID: 1000000' "$jobs/$job/log?follow=true"
ask 200 -X POST "$jobs/$job/retry"
ask 200 -H 'Prefer: wait=20' "$jobs/$job"
ask 204 -X DELETE "$jobs/$job"
for tail in "" /results /results/blocks.json /report /events /log; do ask 410 "$jobs/$job$tail"; done
for tail in /cancel /finish /retry; do ask 410 -X POST "$jobs/$job$tail"; done
for tail in /pin ""; do ask 410 -X DELETE "$jobs/$job$tail"; done
ask 410 -X PUT "$jobs/$job/pin"
ask 410 -H "$json" -H 'Idempotency-Key: bad' -d "{\"input\": \"$bad\"}" "$jobs"
printf '{"jobs": [{"input": "%s"}]}' "$bad" | gzip >batch.gz
ask 201 -H "$json" -H 'Content-Encoding: gzip' --data-binary @batch.gz "$base/v1/batches"
ask 201 -H "$json" -H 'Prefer: wait=30' -d "{\"input\": \"$hash\", \"name\": \"all\", \"tags\": [\"a\", \"b\"], \"priority\": 5, \"pinned\": true,
    \"limits\": {\"memory\": 2000000000, \"wall_seconds\": 100, \"job_wall_seconds\": 300, \"job_cpu_seconds\": 200}, \"options\": {\"quantize\": \"any\", \"scales\": [1, 2]}}" "$jobs"
job=$(value id)
ask 200 -H 'Prefer: wait=30' "$jobs/$job"
ask 200 "$jobs/$job/results"
ask 200 "$jobs/$job/report"
ask 200 -H 'Accept-Encoding: gzip' "$jobs/$job/results/report.json"
ask 304 -H 'If-None-Match: *' "$jobs/$job/report"
ask 412 -H 'If-Match: "other"' "$jobs/$job/results/blocks.json"
ask 416 -H 'Range: bytes=900000000-' "$jobs/$job/results/blocks.json"
ask 404 "$jobs/$job/results/none"
ask 206 -H 'Range: bytes=0-9' "$jobs/$job/log"
ask 416 -H 'Range: bytes=900000000-' "$jobs/$job/log"
ask 422 -H "$json" -H "Idempotency-Key: walkthrough-$hash" -d "{\"jobs\": [{\"input\": \"$hash\"}]}" "$base/v1/batches"
# a failure with elements: the first tet turned inside out
awk '{ if (!done && NF == 16) { t = $1; $1 = $2; $2 = t; done = 1 } print }' "$api/examples/formats/cube.hexex" >inverted.hexex
inverted=$(sha256sum inverted.hexex | cut -d" " -f1)
ask 201 -T inverted.hexex "$base/v1/blobs/$inverted"
ask 201 -H "$json" -H 'Prefer: wait=20' -d "{\"input\": \"$inverted\"}" "$jobs"
ask 200 -H 'Prefer: wait=20' "$jobs/$(value id)"
grep -q '"elements"' answer || { cat answer; failed=1; }
# one that has not begun: it waits behind nine others for the only worker
job() { printf '{"input": "%s", "priority": %d, "options": {"max_cells": %d}}' "$hash" "$2" "$((5000 + $1))"; }
ask 201 -H "$json" -d "{\"jobs\": [$(for i in 1 2 3 4 5 6 7 8 9; do job $i 1; printf ,; done) $(job 10 -1)]}" "$base/v1/batches"
job=$(sed -n 's/.*"id": "\([0-9a-f]*\)".*/\1/p' answer | tail -n 1)
ask 409 -X DELETE "$jobs/$job"
ask 200 -X POST "$jobs/$job/finish"
ask 200 -X POST "$jobs/$job/cancel"
ask 200 -H 'Prefer: wait=20' "$jobs/$job"
# as many streams as there may be
streams=
for i in 1 2 3; do
    curl -sSN --max-time 60 -D "stream$i" "$base/v1/events?after=0" >/dev/null 2>&1 &
    streams="$streams $!"
    j=0
    while [ ! -s "stream$i" ] && [ $j -lt 200 ]; do
        j=$((j + 1))
        sleep 0.1
    done
done
for path in events "jobs/$job/events" "jobs/$job/log?follow=true"; do ask 429 "$base/v1/$path"; done
# shellcheck disable=SC2086
kill $streams
wait
# a job that never was
for tail in "" /results /results/blocks.json /report /events /log; do ask 404 "$jobs/$none$tail"; done
for tail in /cancel /finish /retry; do ask 404 -X POST "$jobs/$none$tail"; done
for tail in /pin ""; do ask 404 -X DELETE "$jobs/$none$tail"; done
ask 404 -X PUT "$jobs/$none/pin"
python3 "$here/knock.py" "$address" || failed=1
# a disk that is too full to be ready
echo 'ready-disk-fail = 1000T' >settings
kill -HUP "$DAEMON"
i=0
while [ "$(curl -sS -o answer -w '%{http_code}' "$base/readyz")" = 200 ]; do
    i=$((i + 1))
    [ $i -lt 100 ] || { echo "ready with a full disk"; failed=1; break; }
    sleep 0.1
done
# tokens, at last: from the first one on everybody needs one
token() { "$bin/blockwrightd" token create --data data --owner contract --scopes "$1"; }
submit=$(token submit) read=$(token read)
[ -n "$submit" ] && [ -n "$read" ] || { echo "no tokens"; exit 1; }
python3 "$here/knock.py" "$address" "$submit" "$read" || failed=1
# an owner that asks too often
echo 'owner-rate = 1' >settings
kill -HUP "$DAEMON"
own="Authorization: Bearer $submit"
i=0
while [ "$(curl -sS -o answer -w '%{http_code}' -H "$own" -T part.hexex "$base/v1/blobs/$hash")" != 429 ]; do
    i=$((i + 1))
    [ $i -lt 300 ] || { echo "no 429 at any rate"; failed=1; break; }
done
grep -q too-many-requests answer || { cat answer; failed=1; }
ask 429 -H "$own" -X POST -T part.hexex "$jobs"
ask 429 -H "$own" -H "$tus" -X POST -H 'Upload-Length: 4' "$base/v1/uploads"
ask 429 -H "$own" -X POST "$jobs/$none/cancel"
ask 200 "$base/livez"
exit $failed
