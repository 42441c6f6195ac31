# POST /v1/jobs, of two files: a Medit mesh has its parameters in a second one, uploaded and named in the same way.
for file in cube.mesh cube.parameters; do
    curl -fsS -T "$here/formats/$file" "$base/v1/blobs/$(sha256sum "$here/formats/$file" | cut -d" " -f1)"
done
curl -fsS -H "Content-Type: application/json" \
    -d "{\"input\": \"$(sha256sum "$here/formats/cube.mesh" | cut -d" " -f1)\",
         \"parameters\": \"$(sha256sum "$here/formats/cube.parameters" | cut -d" " -f1)\"}" "$base/v1/jobs"
