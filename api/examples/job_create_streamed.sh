# POST /v1/jobs, with the input itself as the body: upload and job in one request, options in the query.
curl -fsS -X POST -T "$input" "$base/v1/jobs?complex=bc&tag=walkthrough&hex_formats=mesh,vtu" | sed -n 's/^ "id": "\([0-9a-f]*\)".*/job \1/p'
