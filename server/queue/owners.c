/* What each owner has: counters of jobs and bytes, kept by the triggers of schema.c in the transaction of the change. */
#include "server/queue/writer.h"

#include <string.h>

bw_status bw_owner_read(bw_sql *sql, const char *owner, bw_owner *counts) {
    memset(counts, 0, sizeof *counts);
    sqlite3_stmt *stmt = bw_sql_query(sql, "SELECT waiting, running, finished, bytes, served FROM owners WHERE owner = ?", "s", owner);
    if (!stmt) return BW_E_IO;
    int step = sqlite3_step(stmt);
    if (step == SQLITE_ROW) {
        counts->waiting = sqlite3_column_int64(stmt, 0);
        counts->running = sqlite3_column_int64(stmt, 1);
        counts->finished = sqlite3_column_int64(stmt, 2);
        counts->bytes = sqlite3_column_int64(stmt, 3);
        counts->served = sqlite3_column_int64(stmt, 4);
    }
    bw_sql_done(stmt);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : bw_sql_error(sql, "owner");
}

bw_status bw_queue_owner(bw_queue *q, const char *owner, bw_owner *counts) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_owner_read(reader, owner, counts) : BW_E_IO;
    bw_reader_return(q, reader);
    return status;
}

bw_status bw_owner_blob_bytes(bw_writer *w, const char *owner, const char *sha256, int64_t bytes, int64_t *added) {
    int64_t known;
    bw_status status = bw_sql_number(&w->sql, &known, 0, "SELECT 1 FROM blobs WHERE sha256 = ? AND owner = ?", "ss", sha256, owner);
    *added = known ? 0 : bytes;
    return status;
}

bw_status bw_owner_use_blob(bw_writer *w, const char *owner, const char *sha256, int64_t bytes, int64_t now) {
    return bw_sql_run(&w->sql, NULL, "INSERT INTO blobs (sha256, owner, bytes, created, used) VALUES (?1, ?2, ?3, ?4, ?4)"
                      " ON CONFLICT (sha256, owner) DO UPDATE SET used = excluded.used", "ssii", sha256, owner, bytes, now);
}

bw_status bw_queue_load(bw_queue *q, bw_load *load) {
    memset(load, 0, sizeof *load);
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT total(waiting), total(running), total(finished),"
                                               " ifnull((SELECT created FROM jobs WHERE state = 0 ORDER BY seq LIMIT 1), 0) FROM owners", "")
                                : NULL;
    bool row = stmt && sqlite3_step(stmt) == SQLITE_ROW;
    if (row) {
        load->waiting = sqlite3_column_int64(stmt, 0);
        load->running = sqlite3_column_int64(stmt, 1);
        load->ended = sqlite3_column_int64(stmt, 2);
        load->oldest = sqlite3_column_int64(stmt, 3);
    }
    bw_status status = row ? BW_OK : reader ? bw_sql_error(reader, "load") : BW_E_IO;
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return status;
}
