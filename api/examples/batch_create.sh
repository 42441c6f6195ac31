# POST /v1/batches: two jobs at once, both or none; sent twice with one Idempotency-Key, so that the second time creates nothing.
for again in 1 2; do
    curl -fsS -H "Content-Type: application/json" -H "Idempotency-Key: walkthrough-$hash" \
        -d "{\"jobs\": [{\"input\": \"$hash\", \"tags\": [\"walkthrough\"]},
                      {\"input\": \"$hash\", \"tags\": [\"walkthrough\"], \"priority\": 10, \"options\": {\"complex\": \"bc\"}}]}" \
        "$base/v1/batches"
done
