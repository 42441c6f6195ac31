# HEAD /v1/uploads/{upload}: how far it is.
curl -fsSI -H "Tus-Resumable: 1.0.0" "$base$upload"
