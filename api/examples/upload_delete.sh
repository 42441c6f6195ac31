# DELETE /v1/uploads/{upload}: give it up; the blob that it has become stays.
curl -fsS -X DELETE -H "Tus-Resumable: 1.0.0" "$base$upload"
