# GET /v1/jobs/{id}: until its state is final.
while state=$(curl -fsS "$base/v1/jobs/$job" | sed -n 's/^ "state": "\([a-z]*\)".*/\1/p'); do
    case $state in queued | running) sleep 1 ;; *) break ;; esac
done
echo "the job is $state"
