# GET /openapi.json: the interface, for tools.
curl -fsS "$base/openapi.json" | head -c 200
