# GET /v1/events: what happens to all jobs; from the first event on, for a second. Without `after` it begins now.
curl -sSN --max-time 1 "$base/v1/events?after=0" | grep -m 1 '^event:' || true
