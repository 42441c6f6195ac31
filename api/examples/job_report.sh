# GET /v1/jobs/{id}/report: the numbers.
curl -fsS "$base/v1/jobs/$job/report"
