/* Requests that were answered before, by owner and Idempotency-Key. */
#include "server/queue/writer.h"

#include <string.h>

bw_status bw_idempotency_find(bw_writer *w, const char *owner, const char *key, const char *digest, bool *known,
                              bool *same, char **stored) {
    *known = *same = false;
    *stored = NULL;
    sqlite3_stmt *stmt = bw_sql_query(&w->sql, "SELECT digest, response FROM idempotency WHERE owner = ? AND key = ?", "ss", owner, key);
    if (!stmt) return BW_E_IO;
    int step = sqlite3_step(stmt);
    bw_status status = step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : bw_sql_error(&w->sql, "idempotency");
    if (step == SQLITE_ROW) {
        *known = true;
        *same = strcmp((const char *)sqlite3_column_text(stmt, 0), digest) == 0;
        if (*same && !(*stored = bw_sql_text(stmt, 1))) status = BW_E_MEMORY;
    }
    bw_sql_done(stmt);
    return status;
}

bw_status bw_idempotency_keep(bw_writer *w, const char *owner, const char *key, const char *digest,
                              const char *response, int64_t now) {
    return bw_sql_run(&w->sql, NULL, "INSERT INTO idempotency (owner, key, digest, response, created) VALUES (?, ?, ?, ?, ?)",
                      "ssssi", owner, key, digest, response, now);
}
