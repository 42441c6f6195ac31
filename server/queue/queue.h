/* The queue: jobs, their attempts, owners, events and what is in the cache, in one SQLite file.
 *
 * Invariants
 *  1. One writing connection, owned by one thread, in WAL mode at synchronous=FULL; it also makes all checkpoints. Readers
 *     use connections that are query_only. The thread takes all writes that wait (at most 256) into one transaction, each in
 *     a savepoint of its own, so that one that fails is undone alone; a write is told of only after the commit is durable.
 *  2. A job's `attempt` only grows. It is the fencing number: every function that ends an attempt changes something only if
 *     the job is running, that very attempt is open and the number is still the job's; else *done is false.
 *  3. tries counts the claims of the present stage. It is raised at the claim, before the worker exists, so a job that
 *     brings down its worker cannot be claimed for ever. What the daemon's own death ended is given back (recover), at most
 *     BW_INTERRUPTIONS_MOST times.
 *  4. Every change of a job's state or stage appends a row to `events` in its transaction.
 *  5. An owner's counters equal what a count over its rows would give (triggers in schema.c).
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
 *     failed, dismissed queued             bw_queue_restart   tries, cancel, finish and spent start anew; attempts go on counting
 *     ended             -                  bw_queue_delete    its id stays in `gone`
 *     queued, running   the same           bw_queue_rewind    begins again at stage 0
 *     successful, queued failed            bw_queue_mend      at start: files are gone (retention.h)
 */
#ifndef BW_SERVER_QUEUE_H
#define BW_SERVER_QUEUE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bw_api.h"
#include "server/digest.h"

enum { BW_JOB_ID_TEXT = 25, BW_OWNER_TEXT = 65, BW_TAG_BYTES_MOST = 64, BW_TAGS_MOST = 16, BW_PRIORITY_MOST = 100 };
enum { BW_TRIES_MOST = 3, BW_INTERRUPTIONS_MOST = 50, BW_SCAN_MOST = 1000, BW_PAUSE_MOST_MS = 10000 };

typedef struct bw_queue bw_queue;

typedef struct {
    int64_t wall_ms, cpu_ms;
} bw_spent; /* by workers */

typedef struct {
    int64_t seq; /* order of acceptance */
    char id[BW_JOB_ID_TEXT];
    char input[BW_SHA256_TEXT];
    char parameters[BW_SHA256_TEXT]; /* "": none */
    char kind[8];                    /* what the input was found to be, "tet" or "hex"; "": not known yet */
    char result_key[BW_SHA256_TEXT]; /* cache key of the result folder; "" until there is one */
    bw_job_state state;
    bool open, cancel, finish;
    int stage, stage_count; /* stages done; stages to do */
    int attempt, tries;
    int cut; /* 1 + the first stage whose search was cut by `finish`: from it on, outputs are for this job only. 0: none */
    int64_t created, started, finished; /* ms; 0: not yet */
    bw_spent spent; /* by its attempts since it was accepted, restarted or rewound last; by those that the daemon's end interrupted nothing */
    char *name;                         /* may be NULL */
    char *limits;                       /* JSON: those that the job has asked for (server/limits.h); NULL: none */
    char *options;                      /* canonical JSON */
    char *failure;                      /* JSON; NULL if it has not failed */
    char owner[BW_OWNER_TEXT];          /* "": the local one */
    int priority;                       /* -BW_PRIORITY_MOST..BW_PRIORITY_MOST, larger first, among the owner's jobs */
    bool pinned;                        /* not to be removed by age */
    char *tags;                         /* JSON array of words in order; given to submit it may be NULL */
    int64_t input_bytes, parameters_bytes; /* of the blobs; only for submit */
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

/* Opens or makes the file and starts its thread; migrates an older one, refuses (BW_E_VERSION) one of a newer daemon. */
bw_status bw_queue_open(const char *path, bw_queue **queue);
void bw_queue_close(bw_queue *queue);   /* after all that was posted is done */
bool bw_queue_healthy(bw_queue *queue); /* a read works and the last commit did not fail */

typedef struct {
    uint64_t writes, commits, waiting; /* so far; so far; now */
    uint64_t batch_most;               /* most writes in one commit */
    uint64_t commit_us, wal_bytes;     /* of the last commit */
} bw_queue_stats;
void bw_queue_statistics(bw_queue *queue, bw_queue_stats *stats);

/* ---- writing ---- */

/* A write: run inside a transaction of the writer thread; if it does not return BW_OK, all it did is undone. When a whole
 * batch was undone it is run again, so it takes nothing from `user` but what the caller put there, and sets all results. */
typedef struct bw_writer bw_writer;
typedef bw_status (*bw_write_fn)(bw_writer *writer, void *user);
/* Called in the writer thread when the write is durable, or has failed. Must not wait, nor call bw_queue_write. */
typedef void (*bw_write_done)(void *user, bw_status status);

/* Returns at once; `done` will be called exactly once if the status is BW_OK, never else. `user` is borrowed until then. */
bw_status bw_queue_post(bw_queue *queue, bw_write_fn fn, void *user, bw_write_done done);
/* The same, and waits. */
bw_status bw_queue_write(bw_queue *queue, bw_write_fn fn, void *user);

/* ---- accepting ---- */

typedef struct {
    int64_t queued; /* jobs that have not ended */
    int64_t running;
    int64_t bytes; /* of the blobs that its jobs name */
} bw_limits; /* of one owner; 0: none */

/* An owner may have limits of its own, which take the place of those that are given with a write, each for itself. */
typedef struct {
    char owner[BW_OWNER_TEXT];
    bw_limits limits; /* -1: that which is given; no limit is INT64_MAX */
} bw_quota;
bw_status bw_write_quota(bw_writer *writer, void *quota); /* a row without any limit of its own is taken away */
/* All there are, by name; malloc'ed. */
bw_status bw_queue_quotas(bw_queue *queue, bw_quota **quotas, size_t *count);
/* *limits: those given; then those in force. */
bw_status bw_queue_limits(bw_queue *queue, const char *owner, bw_limits *limits);
/* Names of all owners that have, or had, anything here; malloc'ed. */
bw_status bw_queue_owners(bw_queue *queue, char (**owners)[BW_OWNER_TEXT], size_t *count);

typedef enum {
    BW_SUBMIT_ACCEPTED,
    BW_SUBMIT_KNOWN,    /* the key was used with this digest: `stored` is the answer given then */
    BW_SUBMIT_CONFLICT, /* the key was used with another digest */
    BW_SUBMIT_TOO_MANY, /* queued */
    BW_SUBMIT_TOO_LARGE, /* bytes */
    BW_SUBMIT_NO_BLOB    /* a blob that a job names has gone meanwhile */
} bw_submit_result;

/* Jobs of one owner, accepted all or none. Uses of each job: id, name, input, parameters, options, stage_count, created,
 * owner, priority, pinned, tags, input_bytes, parameters_bytes; sets seq. Everything is borrowed. */
typedef struct {
    bw_job *jobs;
    size_t count;                      /* at least 1 */
    const char *key, *digest, *answer; /* Idempotency-Key (NULL: none), digest of the request, what to keep for next time */
    bw_limits limits, in_force; /* given; with those of the owner's own */
    bool (*present)(void *user, const char *sha256); /* is the blob's file there? Asked in the writer thread (retention.h); NULL: not asked */
    void *user;
    bw_submit_result result;
    size_t lacking; /* BW_SUBMIT_NO_BLOB: of which job */
    char *stored; /* owned by the caller */
} bw_submit;
bw_status bw_write_submit(bw_writer *writer, void *submit);

/* One job without limits, durable when it returns. */
bw_status bw_queue_insert(bw_queue *queue, bw_job *job);
bw_status bw_queue_get(bw_queue *queue, const char *id, bw_job *job, bool *found);

typedef struct {
    int state;         /* -1: any */
    const char *owner; /* NULL: all */
    const char *tag;   /* NULL: any */
} bw_filter;
/* Newest first, seq below `before` (0: from the newest), at most `limit`. *next: `before` of the next page, 0 if there is
 * none. At most BW_SCAN_MOST rows are looked at: a page may have fewer jobs than `limit`, even none, and still a next one. */
bw_status bw_queue_list(bw_queue *queue, const bw_filter *filter, int64_t before, int limit, bw_job **jobs, size_t *count,
                        int64_t *next);
bw_status bw_queue_attempts(bw_queue *queue, const char *id, bw_attempt **attempts, size_t *count);
bw_status bw_queue_is_gone(bw_queue *queue, const char *id, bool *gone); /* it was deleted */

typedef struct {
    int64_t waiting, running, finished; /* jobs: no attempt under way; one under way; ended */
    int64_t bytes;                      /* of the blobs that its jobs name, each once */
    int64_t served;                     /* its last turn: number of the event of its last claim or reuse; 0: none */
} bw_owner;
typedef struct {
    int64_t waiting, running, ended; /* jobs of all owners */
    int64_t oldest;                  /* when the oldest of those was accepted that no stage has begun of, or that pause; 0: none */
} bw_load;
bw_status bw_queue_load(bw_queue *queue, bw_load *load); /* O(owners) */
bw_status bw_queue_owner(bw_queue *queue, const char *owner, bw_owner *counts); /* zeros if it has nothing */

/* ---- the journal ---- */

/* Which events: those numbered above `after`, of one job, of one owner's jobs, or (both NULL) all. At most `limit` are looked at, so of an
 * owner's there may be fewer. What was deleted with its job is not there any more. */
typedef struct {
    const char *job, *owner; /* borrowed */
    int64_t after;
    int limit;
    int64_t last; /* result: number of the last one looked at; `after` if there was none */
    int looked;   /* how many */
} bw_journal;
/* `kind` is queued, started, reused, done, retrying, interrupted, cancelling, finishing, restarted,
 * rewound or a final state; `data` a JSON object
 * with state, stage (the next, or the last), stages_done, stage_count, attempt and perhaps outcome. Must not use the queue. */
typedef void (*bw_journal_fn)(void *user, int64_t seq, const char *job, const char *kind, const char *data, int64_t at);
bw_status bw_queue_journal(bw_queue *queue, bw_journal *which, bw_journal_fn fn, void *user);
bw_status bw_queue_journal_end(bw_queue *queue, int64_t *seq); /* number of the newest event; 0: none */
/* The state of a job; *known is false when there is none (any more). Ask before the journal: what has ended then is in it. */
bw_status bw_queue_state(bw_queue *queue, const char *id, bw_job_state *state, bool *known);

/* ---- whose turn it is ---- */

/* Order: owners by their last turn, oldest first; of one owner's jobs those that have started, then by priority, then by age.
 * A claim or a reuse is a turn. So: while a worker is free, go on to the next owner, and try its candidates until one
 * is taken; the owner is met again after all others. */
typedef struct {
    int64_t served;
    char owner[BW_OWNER_TEXT];
} bw_turn;
enum { BW_LOOK_MOST = 256 }; /* candidates of one owner to be tried in one turn */
/* The owner after *turn (at first {.served = -1}) that has waiting jobs and fewer than running_most (0: any number) running. */
bw_status bw_queue_turn(bw_queue *queue, int64_t running_most, bw_turn *turn, bool *found);
/* Its jobs that wait and are due at `now`, in order, without the first `skip`. A due further ahead than any pause is of a clock that
 * has been set back since: that job is due too. */
bw_status bw_queue_candidates(bw_queue *queue, const char *owner, int64_t now, int skip, int limit, bw_job **jobs,
                              size_t *count);
bw_status bw_queue_next_due(bw_queue *queue, int64_t now, int64_t *due); /* when the next job that pauses is due; 0: none */

/* On success (*done) the fields of `job` are brought up to date. */
bw_status bw_queue_claim(bw_queue *queue, bw_job *job, int64_t now, bool *done);
/* `key`: of the stage's output, which has to have a row still, or nothing is *done ("": one that is not kept). `results`: the job's are in it. */
bw_status bw_queue_reuse(bw_queue *queue, bw_job *job, const char *key, bool results, int64_t now, bool *done);
/* What the job's next stage was to read is gone from the cache: the job, which waits, begins again and takes what is there still. */
bw_status bw_queue_rewind(bw_queue *queue, bw_job *job, int64_t now, bool *done);

/* The cache entry that a stage has made. */
typedef struct {
    const char *key;
    uint64_t bytes;
    uint64_t need;        /* bytes of memory that the next stage will take about; 0: not known */
    const char *manifest; /* JSON; NULL: it is a state file */
    bool cut; /* the search was ended by finish, so that this and all later outputs are for this job only */
    const char *kind; /* of the job's input, as in bw_job; NULL: not told */
} bw_made;

/* Ends of an attempt. A cancel that was noted wins: advance and fail change nothing then (*done is false), the attempt is to be
 * dismissed. A retry's `due` is at most BW_PAUSE_MOST_MS ahead. `spent`: by the attempt, added to what the job has spent; NULL: nothing. */
bw_status bw_queue_advance(bw_queue *queue, const char *id, int attempt, const bw_made *made, int64_t now, const bw_spent *spent,
                           bool *done);
bw_status bw_queue_retry(bw_queue *queue, const char *id, int attempt, const char *outcome, int64_t due, int64_t now,
                         const bw_spent *spent, bool *done);
bw_status bw_queue_fail(bw_queue *queue, const char *id, int attempt, const char *outcome, const char *failure,
                        int64_t now, const bw_spent *spent, bool *done);
bw_status bw_queue_dismiss(bw_queue *queue, const char *id, int attempt, int64_t now, const bw_spent *spent, bool *done);
bw_status bw_queue_interrupt(bw_queue *queue, const char *id, int attempt, int64_t now, bool *done);

/* ---- what owners ask for ---- */

typedef enum {
    BW_CHANGE_DONE,
    BW_CHANGE_NOTED,    /* cancel, finish: the dispatcher has to act */
    BW_CHANGE_UNKNOWN,  /* no such job */
    BW_CHANGE_TOO_LATE, /* it has ended; restart: it was successful */
    BW_CHANGE_TOO_EARLY, /* restart, delete: it has not ended */
    BW_CHANGE_TOO_MANY  /* restart: limits.queued */
} bw_change_result;
typedef struct {
    const char *id; /* borrowed */
    int64_t now;
    bw_limits limits, in_force;
    bw_change_result result;
} bw_change;
/* For bw_queue_post and bw_queue_write with a bw_change. */
bw_status bw_write_cancel(bw_writer *writer, void *change);
bw_status bw_write_finish(bw_writer *writer, void *change);
bw_status bw_write_restart(bw_writer *writer, void *change); /* back into the queue, at the stage it had come to */
bw_status bw_write_delete(bw_writer *writer, void *change);  /* rows only; files are the store's */

bw_status bw_write_pin(bw_writer *writer, void *change);     /* whatever its state: it is not removed by age; DONE or UNKNOWN */
bw_status bw_write_unpin(bw_writer *writer, void *change);

typedef enum { BW_CANCEL_DISMISSED, BW_CANCEL_NOTED, BW_CANCEL_TOO_LATE, BW_CANCEL_UNKNOWN } bw_cancel;
bw_status bw_queue_cancel(bw_queue *queue, const char *id, int64_t now, bw_cancel *result);
typedef enum { BW_FINISH_NOTED, BW_FINISH_TOO_LATE, BW_FINISH_UNKNOWN } bw_finish;
/* Notes, durably and for good, that the job's searches are to settle for the best they have found. */
bw_status bw_queue_finish(bw_queue *queue, const char *id, bw_finish *result);
/* To be called once before any claim: ends all attempts that a dead daemon left open. */
bw_status bw_queue_recover(bw_queue *queue, int64_t now, int *recovered);

/* *manifest (may be NULL as argument): malloc'ed JSON or NULL. */
bw_status bw_queue_output(bw_queue *queue, const char *key, bool *found, char **manifest);
/* What was told with it; 0 also if there is no such output. */
bw_status bw_queue_output_need(bw_queue *queue, const char *key, uint64_t *need);
bw_status bw_queue_forget_output(bw_queue *queue, const char *key);
/* Forgets all cache rows for which `present` says no. */
bw_status bw_queue_sweep_outputs(bw_queue *queue, bool (*present)(void *user, const char *key), void *user,
                                 int *forgotten);

/* ---- who may do what (access.h) ---- */

enum { BW_TOKEN_ID_TEXT = 13, BW_TOKEN_NOTE_MOST = 200 };

typedef struct {
    char id[BW_TOKEN_ID_TEXT];
    char hash[BW_SHA256_TEXT]; /* of the whole token as text */
    char owner[BW_OWNER_TEXT];
    int scopes; /* of bw_scope */
    int64_t created, expires, revoked; /* ms; 0: never */
    char *note;
} bw_token;
/* All there ever were, oldest first; revoked ones stay. Free with bw_tokens_free. */
bw_status bw_queue_tokens(bw_queue *queue, bw_token **tokens, size_t *count);
void bw_tokens_free(bw_token *tokens, size_t count);
bw_status bw_write_token(bw_writer *writer, void *token); /* adds a bw_token, all borrowed */
typedef struct {
    const char *id; /* borrowed */
    int64_t now;
    bool found;
} bw_revocation;
bw_status bw_write_revocation(bw_writer *writer, void *revocation); /* of one that is revoked already: nothing */

/* Whose job this is, or was: the owner of a deleted one is still known while it is in `gone`. */
bw_status bw_queue_job_owner(bw_queue *queue, const char *id, char owner[BW_OWNER_TEXT], bool *found);
/* Notes that the owner has uploaded a blob (bw_new_blob). */
typedef struct {
    const char *owner, *sha256; /* borrowed */
    int64_t bytes, now;
    bw_limits limits, in_force;
    bool (*present)(void *user, const char *sha256); /* as with bw_submit */
    /* It does not fit, and nobody has it; within the write, as with bw_collect.take. May be NULL. */
    void (*refused)(void *user, const char *sha256);
    void *user;
    bool fits, lacking; /* it does not fit, it is not there (any more): nothing is noted */
} bw_new_blob;
bw_status bw_write_blob(bw_writer *writer, void *blob);
/* Has the owner uploaded it, and when was that or its last use? */
bw_status bw_queue_owns_blob(bw_queue *queue, const char *owner, const char *sha256, bool *owns, int64_t *used);

#endif
