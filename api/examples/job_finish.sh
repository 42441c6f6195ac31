# POST /v1/jobs/{id}/finish: settle for the best found so far. This job has ended: the problem document "job-finished" (409).
curl -sS -X POST "$base/v1/jobs/$job/finish"
