# GET /livez: does the process answer?
curl -fsS "$base/livez"
