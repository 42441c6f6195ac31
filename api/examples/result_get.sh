# GET /v1/jobs/{id}/results/{name}: one file; with --etag-compare a second download is answered 304. Coded on the way, or in part.
curl -fsS --etag-save blocks.etag -o blocks.json "$base/v1/jobs/$job/results/blocks.json"
curl -fsS --etag-compare blocks.etag -o /dev/null -w "second time: %{http_code}\n" "$base/v1/jobs/$job/results/blocks.json"
curl -fsS --compressed "$base/v1/jobs/$job/results/blocks.json" | cmp - blocks.json
curl -fsS -r 0-99 -w "\nin part: %{http_code}\n" "$base/v1/jobs/$job/results/blocks.json"
rm -f blocks.etag
