/* Fills the queue of a stopped daemon with jobs, through the queue's own functions (its invariants hold, whatever the schema):
 *
 *     torture_rows DATABASE INPUT_SHA256 WAITING OPEN FINISHED [IDS]
 *
 * WAITING jobs that nobody has claimed, OPEN ones with an attempt under way, as a daemon that was killed leaves them, FINISHED ones
 * that were dismissed. No two share the output of a stage (each has its own `tolerance`). IDS gets the id of every job, one a line.
 * Where the disk is not the point, preload the shim with `call=fsync|fdatasync,times=0,do=skip`. */
#include <jansson.h>
#include <semaphore.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/clock.h"
#include "server/joboptions.h"
#include "server/queue/queue.h"

enum { BATCH = 200 }; /* rows of a commit */

static bw_queue *queue;
static sem_t posted;

static void stop(const char *what) {
    fprintf(stderr, "torture_rows: %s\n", what);
    exit(1);
}

static void make(long number, const char *input, bw_job *job) {
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
    if (!job->options) stop("out of memory");
}

static void on_posted(void *user, bw_status status) {
    if (status != BW_OK || ((bw_change *)user)->result != BW_CHANGE_DONE) stop("a job that waits was not dismissed");
    sem_post(&posted);
}

static void dismiss(const bw_job *jobs, long count) {
    static bw_change changes[BATCH];
    for (long i = 0; i < count; i++) {
        changes[i] = (bw_change){.id = jobs[i].id, .now = bw_now_ms()};
        if (bw_queue_post(queue, bw_write_cancel, &changes[i], on_posted) != BW_OK) stop("cannot cancel");
    }
    for (long i = 0; i < count; i++) sem_wait(&posted);
}

static void claim(bw_job *jobs, long count) {
    for (long i = 0; i < count; i++) {
        bool done;
        if (bw_queue_claim(queue, &jobs[i], bw_now_ms(), &done) != BW_OK || !done) stop("cannot claim");
    }
}

int main(int argc, char **argv) {
    static bw_job jobs[BATCH];
    FILE *ids = argc > 6 ? fopen(argv[6], "w") : NULL;
    if (argc < 6 || (argc > 6 && !ids)) stop("DATABASE INPUT_SHA256 WAITING OPEN FINISHED [IDS]");
    if (bw_queue_open(argv[1], &queue) != BW_OK) stop("cannot open the database");
    sem_init(&posted, 0, 0);
    for (int kind = 0, number = 0; kind < 3; kind++) {
        for (long left = atol(argv[3 + kind]), count; left > 0; left -= count) {
            bw_submit submit = {.jobs = jobs, .count = (size_t)(count = left < BATCH ? left : BATCH)};
            for (long i = 0; i < count; i++) make(number++, argv[2], &jobs[i]);
            if (bw_queue_write(queue, bw_write_submit, &submit) != BW_OK || submit.result != BW_SUBMIT_ACCEPTED) stop("cannot insert");
            if (kind == 1) claim(jobs, count);
            if (kind == 2) dismiss(jobs, count);
            for (long i = 0; i < count; i++) {
                if (ids) fprintf(ids, "%s\n", jobs[i].id);
                bw_job_clear(&jobs[i]);
            }
        }
    }
    bw_queue_close(queue);
    return ids && fclose(ids) != 0;
}
