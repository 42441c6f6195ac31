/* The queue: jobs, their attempts and what is in the cache, in one SQLite file.
 *
 * Invariants
 *  1. One writing connection, under one mutex, in WAL mode at synchronous=FULL; it also makes all checkpoints. Readers use a
 *     second connection that is query_only.
 *  2. A job's `attempt` only grows. It is the fencing number: every function that ends an attempt changes something only if
 *     the job is running, that very attempt is open and the number is still the job's; else *done is false.
 *  3. tries counts the claims of the present stage. It is raised at the claim, before the worker exists, so a job that
 *     brings down its worker cannot be claimed for ever. What the daemon's own death ended is given back (recover), at most
 *     BW_INTERRUPTIONS_MOST times.
 *
 * States (the `open` column says whether an attempt is under way)
 *
 *     from              to                 function
 *     -                 queued             bw_queue_insert
 *     queued, running   running, open      bw_queue_claim
 *     queued, running   running|successful bw_queue_reuse     stage found in the cache
 *     running, open     running            bw_queue_advance   stage done, more to come
 *     running, open     successful         bw_queue_advance   last stage done
 *     running, open     queued             bw_queue_retry     system failure, tries left
 *     running, open     failed             bw_queue_fail
 *     running, open     dismissed          bw_queue_dismiss   its worker has stopped after a cancel
 *     queued, running   dismissed          bw_queue_cancel    no attempt under way
 *     running, open     running, open      bw_queue_cancel    cancel noted
 *     queued, running   the same           bw_queue_finish    finish noted, for this stage and all that follow
 *     running, open     queued             bw_queue_recover, bw_queue_interrupt   the daemon went away or stops
 *     running, open     dismissed          bw_queue_recover   ... with a cancel noted; a finish noted stays so through all of these
 */
#ifndef BW_SERVER_QUEUE_H
#define BW_SERVER_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bw_api.h"
#include "server/digest.h"

enum { BW_JOB_ID_TEXT = 25, BW_TRIES_MOST = 3, BW_INTERRUPTIONS_MOST = 50 };

typedef struct bw_queue bw_queue;

typedef struct {
    int64_t seq; /* order of acceptance */
    char id[BW_JOB_ID_TEXT];
    char input[BW_SHA256_TEXT];
    char parameters[BW_SHA256_TEXT]; /* "": none */
    char result_key[BW_SHA256_TEXT]; /* cache key of the result folder; "" until there is one */
    bw_job_state state;
    bool open, cancel, finish;
    int stage, stage_count; /* stages done; stages to do */
    int attempt, tries;
    int cut; /* 1 + the first stage whose search was cut by `finish`: from it on, outputs are for this job only. 0: none */
    int64_t created, started, finished; /* ms; 0: not yet */
    char *name;                         /* may be NULL */
    char *options;                      /* canonical JSON */
    char *failure;                      /* JSON; NULL if it has not failed */
} bw_job;

typedef struct {
    int attempt;
    char stage[16], outcome[32]; /* outcome "" while under way */
    bool reused;
    int64_t started, finished;
} bw_attempt;

void bw_job_clear(bw_job *job);
void bw_jobs_free(bw_job *jobs, size_t count);
void bw_job_id_make(char id[BW_JOB_ID_TEXT]); /* random */

/* Opens or makes the file; migrates an older one, refuses (BW_E_VERSION) one of a newer daemon. */
bw_status bw_queue_open(const char *path, bw_queue **queue);
void bw_queue_close(bw_queue *queue);
bool bw_queue_healthy(bw_queue *queue); /* a read works and the last write did not fail */

/* Durable when it returns. Uses id, name, input, parameters, options, stage_count, created; sets seq. */
bw_status bw_queue_insert(bw_queue *queue, bw_job *job);
bw_status bw_queue_get(bw_queue *queue, const char *id, bw_job *job, bool *found);
/* Newest first, seq below `before` (0: from the newest), only `state` unless it is -1. */
bw_status bw_queue_list(bw_queue *queue, int state, int64_t before, int limit, bw_job **jobs, size_t *count);
bw_status bw_queue_attempts(bw_queue *queue, const char *id, bw_attempt **attempts, size_t *count);
/* Oldest first: jobs that wait for a claim and are due at `now`. *next_due: when the earliest other one is (0: never). */
bw_status bw_queue_waiting(bw_queue *queue, int64_t now, int64_t after_seq, int limit, bw_job **jobs, size_t *count,
                           int64_t *next_due);

/* On success (*done) the fields of `job` are brought up to date. */
bw_status bw_queue_claim(bw_queue *queue, bw_job *job, int64_t now, bool *done);
/* `result_key` is the stage's cache key if the job's results are in it, else "". */
bw_status bw_queue_reuse(bw_queue *queue, bw_job *job, const char *result_key, int64_t now, bool *done);

/* Ends of an attempt. `key`, `bytes`, `manifest` (JSON or NULL) describe the cache entry the stage has made; `cut`: its
 * search was ended by finish, so that this and all later outputs are for this job only. */
bw_status bw_queue_advance(bw_queue *queue, const char *id, int attempt, const char *key, uint64_t bytes,
                           const char *manifest, bool cut, int64_t now, bool *done);
bw_status bw_queue_retry(bw_queue *queue, const char *id, int attempt, const char *outcome, int64_t due, int64_t now,
                         bool *done);
bw_status bw_queue_fail(bw_queue *queue, const char *id, int attempt, const char *outcome, const char *failure,
                        int64_t now, bool *done);
bw_status bw_queue_dismiss(bw_queue *queue, const char *id, int attempt, int64_t now, bool *done);
bw_status bw_queue_interrupt(bw_queue *queue, const char *id, int attempt, int64_t now, bool *done);

typedef enum { BW_CANCEL_DISMISSED, BW_CANCEL_NOTED, BW_CANCEL_TOO_LATE, BW_CANCEL_UNKNOWN } bw_cancel;
bw_status bw_queue_cancel(bw_queue *queue, const char *id, int64_t now, bw_cancel *result);
typedef enum { BW_FINISH_NOTED, BW_FINISH_TOO_LATE, BW_FINISH_UNKNOWN } bw_finish;
/* Notes, durably and for good, that the job's searches are to settle for the best they have found. */
bw_status bw_queue_finish(bw_queue *queue, const char *id, bw_finish *result);
/* To be called once before any claim: ends all attempts that a dead daemon left open. */
bw_status bw_queue_recover(bw_queue *queue, int64_t now, int *recovered);

/* *manifest (may be NULL as argument): malloc'ed JSON or NULL. */
bw_status bw_queue_output(bw_queue *queue, const char *key, bool *found, char **manifest);
bw_status bw_queue_forget_output(bw_queue *queue, const char *key);
/* Forgets all cache rows for which `present` says no. */
bw_status bw_queue_sweep_outputs(bw_queue *queue, bool (*present)(void *user, const char *key), void *user,
                                 int *forgotten);

#endif
