# GET /v1/jobs: newest first; next page: ?cursor=<next of this one>
curl -fsS "$base/v1/jobs?limit=2&state=successful"
