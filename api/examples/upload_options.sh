# OPTIONS /v1/uploads: what of tus is spoken here.
curl -fsS -i -X OPTIONS "$base/v1/uploads"
