/* Limits that an owner has of its own, and who the owners are. */
#include <stdlib.h>
#include <string.h>

#include "server/queue/writer.h"

bw_status bw_write_quota(bw_writer *w, void *user) {
    const bw_quota *q = user;
    bool any = q->limits.queued >= 0 || q->limits.running >= 0 || q->limits.bytes >= 0;
    if (!any) return bw_sql_run(&w->sql, NULL, "DELETE FROM quotas WHERE owner = ?", "s", q->owner);
    return bw_sql_run(&w->sql, NULL, "INSERT OR REPLACE INTO quotas (owner, queued, running, bytes) VALUES (?, ?, ?, ?)", "siii", q->owner,
                      q->limits.queued, q->limits.running, q->limits.bytes);
}

bw_status bw_owner_limits(bw_sql *sql, const char *owner, bw_limits *limits) {
    int64_t *const to[] = {&limits->queued, &limits->running, &limits->bytes};
    sqlite3_stmt *stmt = bw_sql_query(sql, "SELECT queued, running, bytes FROM quotas WHERE owner = ?", "s", owner);
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    for (int i = 0; step == SQLITE_ROW && i < 3; i++)
        if (sqlite3_column_int64(stmt, i) >= 0) *to[i] = sqlite3_column_int64(stmt, i);
    bw_sql_done(stmt);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : bw_sql_error(sql, "limits");
}

bw_status bw_queue_limits(bw_queue *q, const char *owner, bw_limits *limits) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_owner_limits(reader, owner, limits) : BW_E_IO;
    bw_reader_return(q, reader);
    return status;
}

/* Rows of `size` bytes each, made of the statement's by `read`. */
static bw_status collect(bw_queue *q, const char *text, size_t size, void (*read)(sqlite3_stmt *stmt, void *row), void *out, size_t *count) {
    char *list = NULL;
    size_t n = 0, room = 0;
    int step = SQLITE_ERROR;
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, text, "") : NULL;
    bw_status status = stmt ? BW_OK : BW_E_IO;
    while (status == BW_OK && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        char *more = n < room ? list : realloc(list, (room = room ? 2 * room : 16) * size);
        if (!more) status = BW_E_MEMORY;
        else read(stmt, (list = more) + n++ * size);
    }
    if (status == BW_OK && step != SQLITE_DONE) status = bw_sql_error(reader, "owners");
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    if (status != BW_OK) free(list), list = NULL, n = 0;
    memcpy(out, &list, sizeof list);
    *count = n;
    return status;
}

static void read_quota(sqlite3_stmt *stmt, void *row) {
    bw_quota *q = row;
    bw_sql_put(q->owner, sizeof q->owner, stmt, 0);
    q->limits = (bw_limits){sqlite3_column_int64(stmt, 1), sqlite3_column_int64(stmt, 2), sqlite3_column_int64(stmt, 3)};
}

bw_status bw_queue_quotas(bw_queue *q, bw_quota **quotas, size_t *count) {
    return collect(q, "SELECT owner, queued, running, bytes FROM quotas ORDER BY owner", sizeof **quotas, read_quota, quotas, count);
}

static void read_owner(sqlite3_stmt *stmt, void *row) { bw_sql_put(row, BW_OWNER_TEXT, stmt, 0); }

bw_status bw_queue_owners(bw_queue *q, char (**owners)[BW_OWNER_TEXT], size_t *count) {
    return collect(q, "SELECT owner FROM owners UNION SELECT owner FROM quotas UNION SELECT owner FROM tokens ORDER BY 1", sizeof **owners, read_owner,
                   owners, count);
}
