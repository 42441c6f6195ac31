# GET /: the page for browsers
curl -fsS "$base/" | head -n 4
