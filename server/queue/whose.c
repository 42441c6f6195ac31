/* Whose a job or a blob is. */
#include <string.h>

#include "server/queue/writer.h"

bw_status bw_queue_job_owner(bw_queue *q, const char *id, char owner[BW_OWNER_TEXT], bool *found) {
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT owner FROM jobs WHERE id = ?1 UNION ALL"
                                               " SELECT owner FROM gone WHERE id = ?1 LIMIT 1", "s", id) : NULL;
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    *owner = '\0';
    *found = step == SQLITE_ROW;
    if (*found) bw_sql_put(owner, BW_OWNER_TEXT, stmt, 0);
    else if (stmt && step != SQLITE_DONE) bw_sql_error(reader, "owner");
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

bw_status bw_queue_owns_blob(bw_queue *q, const char *owner, const char *sha256, bool *owns, int64_t *used) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, used, -1, "SELECT used FROM blobs WHERE sha256 = ? AND owner = ?", "ss", sha256, owner)
                              : BW_E_IO;
    bw_reader_return(q, reader);
    *owns = status == BW_OK && *used >= 0;
    return status;
}

/* Its file belongs to nobody, unless another owner has it too. */
static bw_status refuse(bw_writer *w, const bw_new_blob *b) {
    int64_t owned;
    bw_status status = bw_sql_number(&w->sql, &owned, 0, "SELECT 1 FROM blobs WHERE sha256 = ? LIMIT 1", "s", b->sha256);
    if (status == BW_OK && !owned && b->refused) b->refused(b->user, b->sha256);
    return status;
}

bw_status bw_write_blob(bw_writer *w, void *user) {
    bw_new_blob *b = user;
    bw_owner has;
    int64_t added;
    b->fits = true;
    b->in_force = b->limits;
    b->lacking = b->present && !b->present(b->user, b->sha256);
    if (b->lacking) return BW_OK;
    bw_status status = bw_owner_blob_bytes(w, b->owner, b->sha256, b->bytes, &added);
    if (status == BW_OK) status = bw_owner_limits(&w->sql, b->owner, &b->in_force);
    if (status == BW_OK && b->in_force.bytes) {
        status = bw_owner_read(&w->sql, b->owner, &has);
        b->fits = added == 0 || has.bytes + added <= b->in_force.bytes;
    }
    if (status == BW_OK && !b->fits) return refuse(w, b);
    return status != BW_OK ? status : bw_owner_use_blob(w, b->owner, b->sha256, b->bytes, b->now);
}
