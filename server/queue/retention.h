/* What may go from the queue, and from the store with it: ended jobs by age, cached outputs by size, blobs that nobody names.
 *
 * Invariants
 *  1. Rows go in small transactions of the writer thread, each of at most BW_COLLECT_ROWS looked at, so that accepts get their turn between them.
 *  2. The file of a blob or of an output leaves its name within the transaction that deletes its last row (`take`), or that refuses it its
 *     first one (bw_new_blob.refused), and nowhere else while the daemon runs. So a write that finds the file in its place
 *     (bw_submit.present, bw_new_blob.present) keeps it: writes come one after another, and
 *     the row that the write makes or touches is seen by every later collection. If the commit fails after `take`, a row without its
 *     file stays; such rows are forgotten when they are met (dispatch/choose.c) or at the next start (reconcile.c).
 *  3. Never taken: an output that a job's results are (jobs.result_key), or that a job which has not ended reads next (jobs.state_key); a blob
 *     that a job of this owner names, or that its owner uploaded or named after `blobs_before`; a pinned job, one that has not ended.
 *  4. A dry run reads only, and finds what a real one would take if nothing else happened meanwhile: "job" in 3 is one that does not itself go.
 */
#ifndef BW_SERVER_QUEUE_RETENTION_H
#define BW_SERVER_QUEUE_RETENTION_H

#include "server/queue/queue.h"

enum { BW_COLLECT_ROWS = 128 };

/* Times in ms since 1970; of the others: what is older goes, 0: nothing goes by age. */
typedef struct {
    int64_t now;
    int64_t finished_before, failed_before; /* jobs that ended successfully; that failed or were dismissed */
    int64_t gone_before, keys_before;       /* ids of deleted jobs; Idempotency-Keys */
    int64_t blobs_before;                   /* last use of blobs that no job names */
    int64_t cache_most;                     /* bytes of all outputs; 0: any number */
} bw_policy;

typedef enum { BW_KEEP_JOBS, BW_KEEP_OUTPUTS, BW_KEEP_BLOBS, BW_KEEP_KEYS, BW_KEEP_GONE, BW_KEEP_COUNT } bw_keep_kind;

/* One kind's collection, step by step. Begin with {.kind, .dry, .policy, .take, .user} and nothing else. */
typedef struct {
    bw_keep_kind kind;
    bool dry;
    const bw_policy *policy; /* borrowed */
    /* An output or a blob (BW_KEEP_JOBS: a job's log, after which nobody asks) is to leave its place; runs in the writer thread, at most some
     * microseconds. Not called in a dry run. May be NULL. */
    void (*take)(void *user, bw_keep_kind kind, const char *name);
    void *user;
    int64_t count, bytes;     /* taken so far; bytes of outputs and of blobs whose last row went */
    int64_t held, held_bytes; /* outputs that would be due, but are in use */
    bool more;                /* after a step: there is another one to do */
    int64_t at;               /* from here on private: where it has come to */
    char at_name[BW_SHA256_TEXT], at_owner[BW_OWNER_TEXT];
    int64_t total;            /* bytes of all outputs */
    bool begun;
} bw_collect;

bw_status bw_queue_collect(bw_queue *queue, bw_collect *collect); /* one step */
bw_status bw_queue_cache_bytes(bw_queue *queue, int64_t *bytes);  /* of all outputs */

/* ---- at start, before any claim ---- */

typedef struct {
    int64_t blobs_adopted;   /* files without a row: the local owner has them now */
    int64_t blobs_forgotten; /* rows without their file */
    int64_t jobs_failed;     /* waited for a blob that is gone, or their results are */
} bw_mended;
/* Gives a blob's file that has no row one of the local owner. *added: it had none. */
bw_status bw_queue_adopt_blob(bw_queue *queue, const char *sha256, int64_t bytes, int64_t now, bool *added);
/* Forgets rows of blobs for which `present` says no. Then jobs that have not ended and whose blobs have no row, and successful ones
 * whose results have none, become failed: `files-lost`. */
bw_status bw_queue_mend(bw_queue *queue, bool (*present)(void *user, const char *sha256), void *user, int64_t now, bw_mended *mended);
bw_status bw_queue_has_job(bw_queue *queue, const char *id, bool *found);

#endif
