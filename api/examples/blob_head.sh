# HEAD /v1/blobs/{sha256}: 200 if it is there already, so need not be sent.
curl -fsSI "$base/v1/blobs/$hash"
