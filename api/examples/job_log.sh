# GET /v1/jobs/{id}/log: what its workers said.
curl -fsS "$base/v1/jobs/$job/log"
