# GET /v1/capabilities: stages, options with ranges and defaults, formats, limits.
curl -fsS "$base/v1/capabilities"
