/* Inside of the queue: the writer thread, the readers and what the files of this folder share. Nobody else includes this. */
#ifndef BW_SERVER_QUEUE_WRITER_H
#define BW_SERVER_QUEUE_WRITER_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>

#include "server/queue/queue.h"
#include "server/queue/sql.h"

/* What the transaction at hand does to jobs, for the metrics: counted when it is durable. */
typedef struct {
    unsigned accepted, ended[BW_JOB_COUNT]; /* by state */
} bw_tally;

struct bw_writer {
    bw_sql sql;
    bw_tally tally;
};

/* A write that waits for the writer thread. */
typedef struct bw_write {
    bw_write_fn fn;
    bw_write_done done;
    void *user;
    bw_status status;
    bool owned; /* freed by the thread after done() */
    struct bw_write *next;
} bw_write;

enum { BW_BATCH_MOST = 256, BW_READERS_MOST = 8 };

struct bw_queue {
    char *path;
    bw_writer writer; /* used by the thread only, and by open and close while there is none */
    pthread_t thread;
    bool has_thread;
    pthread_mutex_t lock; /* the list of writes, `stopping` */
    pthread_cond_t arrived;
    bw_write *first, **last;
    bool stopping;
    int wal_pages, wal_seen; /* pages in the WAL after the last commit; at the last checkpoint */
    atomic_bool broken;      /* the last commit failed */
    atomic_uint_fast64_t writes, commits, waiting, batch_most, commit_us, wal_bytes;
    pthread_mutex_t read_lock;
    pthread_cond_t returned;
    bw_sql readers[BW_READERS_MOST];
    bool lent[BW_READERS_MOST];
};

bw_status bw_writer_start(bw_queue *queue);
void bw_writer_stop(bw_queue *queue); /* after all that was posted is done */

/* A connection that only reads, for one statement or a few; waits until one is free. NULL if it cannot be opened. */
bw_sql *bw_reader_borrow(bw_queue *queue);
void bw_reader_return(bw_queue *queue, bw_sql *reader); /* NULL allowed */
void bw_readers_shrink(bw_queue *queue);                 /* those that are free give their pages back */

/* schema.c: brings the file to this daemon's version. BW_E_VERSION: it is a newer daemon's. */
bw_status bw_schema_migrate(bw_sql *sql, const char *path); /* before it changes an older one, PATH.vN.bak becomes a copy of it, durably */
int64_t bw_schema_version(void);
/* backup.c: copies the whole file to `to`, which must not be there. stop: see queue/backup.h. */
bw_status bw_sql_copy(bw_sql *from, const char *to, const atomic_bool *stop);

/* events.c: appends an event about the job as it is now; outcome may be NULL. *seq (may be NULL): its number. */
bw_status bw_event_add(bw_writer *w, const char *id, const char *kind, const char *outcome, int64_t now, int64_t *seq);
bw_status bw_event_functions(bw_sql *sql); /* stage_name(n) and state_name(n) for SQL */
/* The pairs of json_object(...) about the row of `jobs` at hand; state: an expression of its number. */
#define BW_EVENT_DATA(state)                                                                                           \
    "'state', state_name(" state "), 'stage', stage_name(min(stage, stage_count - 1)), 'stages_done', stage,"              \
    " 'stage_count', stage_count, 'attempt', attempt"

/* jobs.c: rows as bw_job. Columns in the order of bw_job_read. */
#define BW_JOB_COLUMNS                                                                                                 \
    " jobs.seq, id, input, result_key, state, open, cancel, stage, stage_count, attempt, tries, created, started,"     \
    " finished, name, options, failure, parameters, finish, cut, owner, priority, pinned,"                             \
    " (SELECT json_group_array(tag) FROM (SELECT tag FROM tags WHERE tags.seq = jobs.seq ORDER BY tag)), limits, spent_wall_ms,"       \
    " spent_cpu_ms, jobs.kind "
void bw_job_read(sqlite3_stmt *statement, bw_job *job);

/* attempts.c: deletes an ended job with all its rows; its id goes to `gone`. */
bw_status bw_job_drop(bw_writer *w, const char *id, const char *owner, int64_t seq, int64_t now);

/* idempotency.c: is the key known? *stored is the answer given then, if the digest is the same. */
bw_status bw_idempotency_find(bw_writer *w, const char *owner, const char *key, const char *digest, bool *known,
                              bool *same, char **stored);
bw_status bw_idempotency_keep(bw_writer *w, const char *owner, const char *key, const char *digest,
                              const char *response, int64_t now);

/* owners.c: what an owner has. An owner without a row has nothing. */
bw_status bw_owner_read(bw_sql *sql, const char *owner, bw_owner *counts);
/* Notes that the owner uses a blob; its bytes count once per owner. *added: how many bytes that adds (0: it had it). */
bw_status bw_owner_blob_bytes(bw_writer *w, const char *owner, const char *sha256, int64_t bytes, int64_t *added);
bw_status bw_owner_use_blob(bw_writer *w, const char *owner, const char *sha256, int64_t bytes, int64_t now);

/* quotas.c: *limits, those given, become those in force. */
bw_status bw_owner_limits(bw_sql *sql, const char *owner, bw_limits *limits);

#endif
