# GET /page/{name}: a file of the page
curl -fsS "$base/page/style.css" | head -n 2
