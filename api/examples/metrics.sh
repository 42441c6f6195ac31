# GET /metrics: what Prometheus reads.
curl -fsS "$base/metrics"
