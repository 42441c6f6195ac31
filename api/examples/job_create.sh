# POST /v1/jobs: answered with 201 once the job is on stable storage. Options may be left out.
job=$(curl -fsS -H "Content-Type: application/json" \
    -d "{\"input\": \"$hash\", \"name\": \"walkthrough\", \"options\": {\"complex\": \"mc\"}}" "$base/v1/jobs" |
    sed -n 's/^ "id": "\([0-9a-f]*\)".*/\1/p')
echo "job $job"
