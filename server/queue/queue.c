#include "server/queue/queue.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "server/queue/writer.h"

bw_status bw_queue_open(const char *path, bw_queue **out) {
    pthread_condattr_t monotonic;
    bw_queue *q = calloc(1, sizeof *q);
    if (!q) return BW_E_MEMORY;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_mutex_init(&q->lock, NULL);
    pthread_cond_init(&q->arrived, &monotonic);
    pthread_mutex_init(&q->read_lock, NULL);
    pthread_cond_init(&q->returned, NULL);
    pthread_condattr_destroy(&monotonic);
    q->last = &q->first;
    q->path = strdup(path);
    bw_status status = q->path ? BW_OK : BW_E_MEMORY;
    if (status == BW_OK)
        status = bw_sql_open(&q->writer.sql, path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX,
                             "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON;"
                             "PRAGMA wal_autocheckpoint=0; PRAGMA journal_size_limit=67108864; PRAGMA cache_size=-65536");
    if (status == BW_OK) status = bw_schema_migrate(&q->writer.sql, path);
    if (status == BW_OK) status = bw_event_functions(&q->writer.sql);
    if (status == BW_OK) status = bw_writer_start(q);
    if (status != BW_OK) {
        bw_queue_close(q);
        return status;
    }
    *out = q;
    return BW_OK;
}

void bw_queue_close(bw_queue *q) {
    if (!q) return;
    bw_writer_stop(q);
    for (size_t i = 0; i < BW_READERS_MOST; i++) bw_sql_close(&q->readers[i]);
    bw_sql_close(&q->writer.sql); /* the last connection: it cuts the WAL */
    pthread_mutex_destroy(&q->lock);
    pthread_cond_destroy(&q->arrived);
    pthread_mutex_destroy(&q->read_lock);
    pthread_cond_destroy(&q->returned);
    free(q->path);
    free(q);
}

/* ---- readers ---- */

/* One that is open and free, else a place for a new one. NULL: all are lent. */
static bw_sql *pick(bw_queue *q) {
    bw_sql *empty = NULL;
    for (size_t i = 0; i < BW_READERS_MOST; i++) {
        if (q->lent[i]) continue;
        if (q->readers[i].db) return &q->readers[i];
        if (!empty) empty = &q->readers[i];
    }
    return empty;
}

bw_sql *bw_reader_borrow(bw_queue *q) {
    bw_sql *reader;
    pthread_mutex_lock(&q->read_lock);
    while (!(reader = pick(q))) pthread_cond_wait(&q->returned, &q->read_lock);
    q->lent[reader - q->readers] = true;
    pthread_mutex_unlock(&q->read_lock);
    if (reader->db || bw_sql_open(reader, q->path, SQLITE_OPEN_READWRITE | SQLITE_OPEN_NOMUTEX,
                                  "PRAGMA query_only=ON; PRAGMA wal_autocheckpoint=0; PRAGMA cache_size=-8192") == BW_OK)
        return reader;
    bw_reader_return(q, reader);
    return NULL;
}

void bw_reader_return(bw_queue *q, bw_sql *reader) {
    if (!reader) return;
    pthread_mutex_lock(&q->read_lock);
    q->lent[reader - q->readers] = false;
    pthread_cond_signal(&q->returned);
    pthread_mutex_unlock(&q->read_lock);
}

void bw_readers_shrink(bw_queue *q) {
    pthread_mutex_lock(&q->read_lock);
    for (size_t i = 0; i < BW_READERS_MOST; i++)
        if (!q->lent[i] && q->readers[i].db) sqlite3_db_release_memory(q->readers[i].db);
    pthread_mutex_unlock(&q->read_lock);
}

/* ---- how it is ---- */

bool bw_queue_healthy(bw_queue *q) {
    int64_t n;
    bw_sql *reader = bw_reader_borrow(q);
    bool reads = reader && bw_sql_number(reader, &n, 0, "SELECT 1 FROM jobs LIMIT 1", "") == BW_OK;
    bw_reader_return(q, reader);
    return reads && !atomic_load(&q->broken);
}

void bw_queue_statistics(bw_queue *q, bw_queue_stats *stats) {
    stats->writes = atomic_load(&q->writes);
    stats->commits = atomic_load(&q->commits);
    stats->waiting = atomic_load(&q->waiting);
    stats->batch_most = atomic_load(&q->batch_most);
    stats->commit_us = atomic_load(&q->commit_us);
    stats->wal_bytes = atomic_load(&q->wal_bytes);
}
