# GET /v1/jobs/{id}: until its state is final. Each answer comes when the job has ended, or after 30 seconds.
while state=$(curl -fsS -H "Prefer: wait=30" "$base/v1/jobs/$job" | sed -n 's/^ "state": "\([a-z]*\)".*/\1/p'); do
    case $state in queued | running) ;; *) break ;; esac
done
echo "the job is $state"
