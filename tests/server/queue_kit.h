/* For the tests of the queue: one in a folder of its own, and jobs to put into it. */
#ifndef BW_TESTS_QUEUE_KIT_H
#define BW_TESTS_QUEUE_KIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "server/files.h"
#include "server/queue/queue.h"

static char folder[64], path[96];
static bw_queue *q;
static const char hash[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

static inline int open_queue(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/bw-queue-XXXXXX");
    if (!mkdtemp(folder)) return -1;
    snprintf(path, sizeof path, "%s/jobs.db", folder);
    return bw_queue_open(path, &q) == BW_OK ? 0 : -1;
}

static inline int close_queue(void **state) {
    (void)state;
    bw_queue_close(q);
    bw_remove_tree(folder);
    return 0;
}

/* A job with a new id; options and tags as given (tags may be NULL). */
static inline void make_job(bw_job *job, const char *owner, int stages, const char *options, const char *tags) {
    memset(job, 0, sizeof *job);
    bw_job_id_make(job->id);
    snprintf(job->input, sizeof job->input, "%s", hash);
    snprintf(job->owner, sizeof job->owner, "%s", owner);
    job->options = strdup(options);
    job->tags = tags ? strdup(tags) : NULL;
    job->stage_count = stages;
    job->created = 1000;
    job->input_bytes = 10;
}

static inline void put_job(bw_job *job, const char *owner, int stages) {
    make_job(job, owner, stages, "{}", NULL);
    assert_int_equal(bw_queue_insert(q, job), BW_OK);
}

static inline bw_job get_job(const char *id) {
    bw_job job;
    bool found;
    assert_int_equal(bw_queue_get(q, id, &job, &found), BW_OK);
    assert_true(found);
    return job;
}

static inline bool is_there(const char *id) {
    bw_job job;
    bool found;
    assert_int_equal(bw_queue_get(q, id, &job, &found), BW_OK);
    if (found) bw_job_clear(&job);
    return found;
}

#endif
