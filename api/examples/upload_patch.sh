# PATCH /v1/uploads/{upload}: bytes from Upload-Offset on; here in two parts. The last answer names the blob.
head -c 100 "$input" | curl -fsS -X PATCH -H "Tus-Resumable: 1.0.0" -H "Upload-Offset: 0" \
    -H "Content-Type: application/offset+octet-stream" --data-binary @- "$base$upload"
tail -c +101 "$input" | curl -fsS -i -X PATCH -H "Tus-Resumable: 1.0.0" -H "Upload-Offset: 100" \
    -H "Content-Type: application/offset+octet-stream" --data-binary @- "$base$upload"
