# PUT /v1/blobs/{sha256}: the input, under its own hash.
hash=$(sha256sum "$input" | cut -d" " -f1)
curl -fsS -T "$input" "$base/v1/blobs/$hash"
