# POST /v1/jobs/{id}/retry: a job that failed or was dismissed waits again. This one was successful, so the answer is
# the problem document "job-finished" (409).
curl -sS -X POST "$base/v1/jobs/$job/retry"
