# GET /v1/jobs/{id}/results: name, size and SHA-256 of every file.
curl -fsS "$base/v1/jobs/$job/results"
