# POST /v1/uploads: an upload that can be resumed (tus 1.0.0); its address is in Location.
upload=$(curl -fsS -D - -o /dev/null -X POST -H "Tus-Resumable: 1.0.0" -H "Upload-Length: $(wc -c <"$input")" "$base/v1/uploads" |
    tr -d '\r' | sed -n 's/^[Ll]ocation: //p')
echo "upload $upload"
