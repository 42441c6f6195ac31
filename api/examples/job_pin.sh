# PUT /v1/jobs/{id}/pin: the job and its results stay, however old they get.
curl -fsS -X PUT "$base/v1/jobs/$job/pin"
