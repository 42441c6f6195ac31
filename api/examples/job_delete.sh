# DELETE /v1/jobs/{id}: answered with 204; after that the job's address answers with 410.
curl -fsS -X DELETE "$base/v1/jobs/$job"
curl -sS -o /dev/null -w "the deleted job: %{http_code}\n" "$base/v1/jobs/$job"
