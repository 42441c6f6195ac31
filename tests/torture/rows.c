/* Fills the queue of a stopped daemon with jobs, through the queue's own functions (its invariants hold, whatever the schema):
 *
 *     torture_rows DATABASE INPUT_SHA256 WAITING OPEN FINISHED [IDS]
 *
 * WAITING jobs that nobody has claimed, OPEN ones with an attempt under way, as a daemon that was killed leaves them, FINISHED ones
 * that were dismissed. No two share the output of a stage (each has its own `tolerance`). IDS gets the id of every job, one a line.
 * A commit a job: preload the shim with `call=fsync|fdatasync,do=skip` where the disk is not the point. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/clock.h"
#include "server/joboptions.h"
#include "server/queue/queue.h"

static bw_queue *queue;

static void stop(const char *what) {
    fprintf(stderr, "torture_rows: %s\n", what);
    exit(1);
}

static void insert(long number, const char *input, bw_job *job) {
    char detail[200];
    json_t *all, *given = json_pack("{s:f}", "tolerance", 1e-4 + 1e-12 * (double)number);
    memset(job, 0, sizeof *job);
    if (!bw_joboptions_check(given, &all, detail, sizeof detail)) stop(detail);
    bw_job_id_make(job->id);
    snprintf(job->input, sizeof job->input, "%s", input);
    job->options = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    job->stage_count = bw_joboptions_stages(all);
    job->created = bw_now_ms();
    json_decref(all);
    json_decref(given);
    if (!job->options || bw_queue_insert(queue, job) != BW_OK) stop("cannot insert");
}

int main(int argc, char **argv) {
    FILE *ids = argc > 6 ? fopen(argv[6], "w") : NULL;
    bw_job job;
    if (argc < 6 || (argc > 6 && !ids)) stop("DATABASE INPUT_SHA256 WAITING OPEN FINISHED [IDS]");
    if (bw_queue_open(argv[1], &queue) != BW_OK) stop("cannot open the database");
    long waiting = atol(argv[3]), open = atol(argv[4]), finished = atol(argv[5]);
    for (long i = 0; i < waiting + open + finished; i++) {
        bool done = true;
        bw_cancel dismissed = BW_CANCEL_DISMISSED;
        insert(i, argv[2], &job);
        if (i >= waiting && i < waiting + open && (bw_queue_claim(queue, &job, bw_now_ms(), &done) != BW_OK || !done)) stop("cannot claim");
        if (i >= waiting + open && bw_queue_cancel(queue, job.id, bw_now_ms(), &dismissed) != BW_OK) stop("cannot cancel");
        if (dismissed != BW_CANCEL_DISMISSED) stop("a job that waits was not dismissed");
        if (ids) fprintf(ids, "%s\n", job.id);
        bw_job_clear(&job);
    }
    bw_queue_close(queue);
    return ids && fclose(ids) != 0;
}
