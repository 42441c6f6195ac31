# GET /v1/jobs/{id}/events: what happens to the job, until it has ended. Who was cut off comes again with -H "Last-Event-ID: N".
curl -fsSN "$base/v1/jobs/$job/events" | grep -e '^id:' -e '^event:' | tail -n 3
# The same of its log.
curl -fsSN "$base/v1/jobs/$job/log?follow=true&tail=2" | sed -n 's/^data: //p'
