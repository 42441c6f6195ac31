# POST /v1/jobs/{id}/cancel: this job has ended, so the answer is the problem document "job-finished" (409).
curl -sS -X POST "$base/v1/jobs/$job/cancel"
