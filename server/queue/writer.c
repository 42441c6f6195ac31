#include "server/queue/writer.h"

#include <errno.h>
#include <malloc.h>
#include <semaphore.h>
#include <stdlib.h>
#include <time.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"

/* The WAL in pages of 4 KiB: checkpointed as it grows by the first, cut to nothing beyond the second and when nothing was
 * written for a while. */
enum { CHECKPOINT_PAGES = 4000, WAL_PAGES_MOST = 8192, PAGE_BYTES = 4096, IDLE_MS = 1000 };

/* ---- the list of writes ---- */

static void append(bw_queue *q, bw_write *write) {
    write->next = NULL;
    pthread_mutex_lock(&q->lock);
    *q->last = write;
    q->last = &write->next;
    atomic_fetch_add(&q->waiting, 1);
    pthread_cond_signal(&q->arrived);
    pthread_mutex_unlock(&q->lock);
}

bw_status bw_queue_post(bw_queue *q, bw_write_fn fn, void *user, bw_write_done done) {
    bw_write *write = calloc(1, sizeof *write);
    if (!write) return BW_E_MEMORY;
    *write = (bw_write){.fn = fn, .user = user, .done = done, .owned = true};
    append(q, write);
    return BW_OK;
}

typedef struct {
    bw_write_fn fn;
    void *user;
    bw_status status;
    sem_t done;
} waiter;

static bw_status run_waiter(bw_writer *w, void *user) {
    waiter *wait = user;
    return wait->fn(w, wait->user);
}

static void wake_waiter(void *user, bw_status status) {
    waiter *wait = user;
    wait->status = status;
    sem_post(&wait->done);
}

bw_status bw_queue_write(bw_queue *q, bw_write_fn fn, void *user) {
    waiter wait = {.fn = fn, .user = user};
    bw_write write = {.fn = run_waiter, .user = &wait, .done = wake_waiter};
    if (pthread_equal(pthread_self(), q->thread)) abort(); /* it would wait for itself */
    sem_init(&wait.done, 0, 0);
    append(q, &write);
    while (sem_wait(&wait.done) != 0 && errno == EINTR) continue;
    sem_destroy(&wait.done);
    return wait.status;
}

/* ---- the WAL ---- */

static int wal_grew(void *user, sqlite3 *db, const char *name, int pages) {
    bw_queue *q = user;
    (void)db, (void)name;
    q->wal_pages = pages;
    atomic_store(&q->wal_bytes, (uint64_t)pages * PAGE_BYTES);
    return SQLITE_OK;
}

/* A reader in its transaction can hold a checkpoint up; then it is tried again later. */
static void bound_wal(bw_queue *q, bool idle) {
    sqlite3 *db = q->writer.sql.db;
    bool cut = idle || q->wal_pages >= WAL_PAGES_MOST;
    if (q->wal_pages < q->wal_seen) q->wal_seen = 0; /* it began anew */
    if (!q->wal_pages || (!idle && q->wal_pages - q->wal_seen < CHECKPOINT_PAGES)) return;
    sqlite3_busy_timeout(db, 100);
    int code = sqlite3_wal_checkpoint_v2(db, NULL, cut ? SQLITE_CHECKPOINT_TRUNCATE : SQLITE_CHECKPOINT_PASSIVE, NULL, NULL);
    if (code != SQLITE_OK && (code & 0xff) != SQLITE_BUSY) bw_sql_error(&q->writer.sql, "checkpoint");
    sqlite3_busy_timeout(db, 10000);
    q->wal_seen = q->wal_pages;
    if (cut && code == SQLITE_OK) wal_grew(q, db, NULL, 0);
}

/* A quiet daemon keeps no pages of the database; the system's cache has them. */
static void give_memory_back(bw_queue *q) {
    sqlite3_db_release_memory(q->writer.sql.db);
    bw_readers_shrink(q);
    malloc_trim(0);
}

/* ---- the thread ---- */

/* Waits for writes and takes at most BW_BATCH_MOST of them. 0: nothing came for a while, or it is time to stop. */
static size_t take(bw_queue *q, bw_write **batch, bool *stop) {
    struct timespec until;
    size_t n = 0;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += IDLE_MS / 1000;
    pthread_mutex_lock(&q->lock);
    while (!q->first && !q->stopping) {
        if (!q->wal_pages) pthread_cond_wait(&q->arrived, &q->lock);
        else if (pthread_cond_timedwait(&q->arrived, &q->lock, &until) == ETIMEDOUT) break;
    }
    for (; q->first && n < BW_BATCH_MOST; n++) {
        batch[n] = q->first;
        q->first = q->first->next;
    }
    if (!q->first) q->last = &q->first;
    *stop = q->stopping && !n;
    pthread_mutex_unlock(&q->lock);
    return n;
}

static bw_status run_in_savepoint(bw_queue *q, bw_write *write) {
    bw_sql *sql = &q->writer.sql;
    bw_tally before = q->writer.tally;
    bw_status status = bw_sql_run(sql, NULL, "SAVEPOINT one", "");
    if (status != BW_OK) return status;
    status = write->fn(&q->writer, write->user);
    if (status != BW_OK) q->writer.tally = before;
    if (sqlite3_get_autocommit(sql->db)) return status; /* SQLite rolled everything back */
    if (status != BW_OK && bw_sql_run(sql, NULL, "ROLLBACK TO one", "") != BW_OK) { /* half a write must not be in the commit of the others */
        bw_sql_run(sql, NULL, "ROLLBACK", "");
        return status;
    }
    bw_status released = bw_sql_run(sql, NULL, "RELEASE one", "");
    return status != BW_OK ? status : released;
}

static bw_status commit(bw_queue *q) {
    int64_t from = bw_mono_us(), us;
    const bw_tally *tally = &q->writer.tally;
    bw_status status = bw_sql_run(&q->writer.sql, NULL, "COMMIT", "");
    atomic_store(&q->commit_us, (uint64_t)(us = bw_mono_us() - from));
    if (status != BW_OK) return status;
    atomic_fetch_add(&q->commits, 1);
    bw_observe(BW_METRIC_COMMIT_SECONDS, 0, us);
    bw_count(BW_METRIC_JOBS_ACCEPTED, 0, 0, tally->accepted);
    for (int i = BW_JOB_SUCCESSFUL; i < BW_JOB_COUNT; i++) bw_count(BW_METRIC_JOBS_ENDED, i - BW_JOB_SUCCESSFUL, 0, tally->ended[i]);
    return BW_OK;
}

/* One transaction for all. False: nothing of it is in the file, and no write's status counts. */
static bool run_together(bw_queue *q, bw_write **batch, size_t n) {
    bw_sql *sql = &q->writer.sql;
    bool whole = bw_sql_run(sql, NULL, "BEGIN IMMEDIATE", "") == BW_OK;
    q->writer.tally = (bw_tally){0};
    for (size_t i = 0; whole && i < n; i++) {
        batch[i]->status = run_in_savepoint(q, batch[i]);
        whole = !sqlite3_get_autocommit(sql->db);
    }
    if (whole) whole = commit(q) == BW_OK;
    if (!sqlite3_get_autocommit(sql->db)) bw_sql_run(sql, NULL, "ROLLBACK", "");
    return whole;
}

static void run_alone(bw_queue *q, bw_write *write) {
    bw_sql *sql = &q->writer.sql;
    write->status = bw_sql_run(sql, NULL, "BEGIN IMMEDIATE", "");
    q->writer.tally = (bw_tally){0};
    if (write->status == BW_OK) write->status = write->fn(&q->writer, write->user);
    if (write->status == BW_OK) write->status = commit(q);
    atomic_store(&q->broken, write->status != BW_OK);
    if (!sqlite3_get_autocommit(sql->db)) bw_sql_run(sql, NULL, "ROLLBACK", "");
}

static void run_batch(bw_queue *q, bw_write **batch, size_t n) {
    if (n > 1 && run_together(q, batch, n)) {
        atomic_store(&q->broken, false);
    } else { /* what one of them met need not meet the others */
        for (size_t i = 0; i < n; i++) run_alone(q, batch[i]);
    }
    atomic_fetch_add(&q->writes, n);
    atomic_fetch_sub(&q->waiting, n);
    if (n > atomic_load(&q->batch_most)) atomic_store(&q->batch_most, n);
    for (size_t i = 0; i < n; i++) {
        bw_write *write = batch[i];
        bool owned = write->owned; /* after done() a write that is not owned may be gone */
        if (write->done) write->done(write->user, write->status);
        if (owned) free(write);
    }
}

static void *write_main(void *user) {
    bw_queue *q = user;
    bw_write *batch[BW_BATCH_MOST];
    for (bool stop = false; !stop;) {
        size_t n = take(q, batch, &stop);
        if (n) run_batch(q, batch, n);
        bound_wal(q, !n);
        if (!n && !stop) give_memory_back(q);
    }
    return NULL;
}

bw_status bw_writer_start(bw_queue *q) {
    sqlite3_wal_hook(q->writer.sql.db, wal_grew, q);
    q->has_thread = pthread_create(&q->thread, NULL, write_main, q) == 0;
    return q->has_thread ? BW_OK : BW_E_IO;
}

void bw_writer_stop(bw_queue *q) {
    if (!q->has_thread) return;
    pthread_mutex_lock(&q->lock);
    q->stopping = true;
    pthread_cond_signal(&q->arrived);
    pthread_mutex_unlock(&q->lock);
    pthread_join(q->thread, NULL);
    q->has_thread = false;
}
