# GET /v1/jobs: newest first; next page: ?cursor=<next of this one>; also by tag
curl -fsS "$base/v1/jobs?limit=2&state=successful"
curl -fsS "$base/v1/jobs?tag=walkthrough"
