# DELETE /v1/jobs/{id}/pin: the job goes by age again.
curl -fsS -X DELETE "$base/v1/jobs/$job/pin"
