#!/bin/sh
# Every call of the interface once, with curl, against a running daemon:
#     sh walkthrough.sh part.hexex [ADDRESS:PORT]
set -eu
input=${1:?usage: walkthrough.sh part.hexex [ADDRESS:PORT]}
base=http://${2:-127.0.0.1:8080}
here=$(dirname "$0")
export base input

step() {
    echo "== $1"
    . "$here/$1"
}

step live.sh
step ready.sh
step metrics.sh
step capabilities.sh
step blob_put.sh
step blob_head.sh
step upload_options.sh
step upload_create.sh
step upload_patch.sh
step upload_head.sh
step upload_delete.sh
step job_create_parameters.sh
step job_create_streamed.sh
step job_create.sh
step batch_create.sh
step job_list.sh
step job_wait.sh
step job_events.sh
step event_list.sh
step job_log.sh
step result_list.sh
step result_get.sh
step job_report.sh
step job_finish.sh
step job_cancel.sh
step job_retry.sh
step job_pin.sh
step job_unpin.sh
step job_delete.sh
step openapi.sh
step page.sh
step page_file.sh
