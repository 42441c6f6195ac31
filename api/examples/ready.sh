# GET /readyz: can it work? 503 with the reason if not.
curl -fsS "$base/readyz"
