# PUT /v1/blobs/{sha256}: the input, under its own hash; it may be coded on the way.
hash=$(sha256sum "$input" | cut -d" " -f1)
gzip -c "$input" >upload.gz
curl -fsS -H "Content-Encoding: gzip" -T upload.gz "$base/v1/blobs/$hash"
curl -fsS -T "$input" "$base/v1/blobs/$hash"
rm -f upload.gz
