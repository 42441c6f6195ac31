/* What is in the cache. */
#include <stdlib.h>

#include "server/queue/writer.h"

bw_status bw_queue_output(bw_queue *q, const char *key, bool *found, char **manifest) {
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT manifest FROM outputs WHERE key = ?", "s", key) : NULL;
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    *found = step == SQLITE_ROW;
    if (manifest) *manifest = *found ? bw_sql_text(stmt, 0) : NULL;
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

bw_status bw_queue_output_need(bw_queue *q, const char *key, uint64_t *need) {
    int64_t told = 0;
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, &told, 0, "SELECT need FROM outputs WHERE key = ?", "s", key) : BW_E_IO;
    bw_reader_return(q, reader);
    *need = told > 0 ? (uint64_t)told : 0;
    return status;
}

static bw_status forget(bw_writer *w, void *key) {
    return bw_sql_run(&w->sql, NULL, "DELETE FROM outputs WHERE key = ?", "s", (const char *)key);
}

bw_status bw_queue_forget_output(bw_queue *q, const char *key) {
    char copy[BW_SHA256_TEXT];
    for (size_t i = 0; i < sizeof copy && (copy[i] = key[i]); i++) continue;
    return bw_queue_write(q, forget, copy);
}

typedef struct {
    bool (*present)(void *user, const char *key);
    void *user;
    int forgotten;
} sweep;

static void sql_present(sqlite3_context *context, int argc, sqlite3_value **argv) {
    const sweep *call = sqlite3_user_data(context);
    const unsigned char *key = sqlite3_value_text(argv[0]);
    (void)argc;
    sqlite3_result_int(context, key && call->present(call->user, (const char *)key));
}

static bw_status sweep_outputs(bw_writer *w, void *user) {
    sweep *s = user;
    bw_sql *sql = &w->sql;
    if (sqlite3_create_function(sql->db, "present", 1, SQLITE_UTF8, s, sql_present, NULL, NULL) != SQLITE_OK)
        return bw_sql_error(sql, "function");
    bw_status status = bw_sql_run(sql, &s->forgotten, "DELETE FROM outputs WHERE NOT present(key)", "");
    sqlite3_create_function(sql->db, "present", 1, SQLITE_UTF8, NULL, NULL, NULL, NULL);
    return status;
}

bw_status bw_queue_sweep_outputs(bw_queue *q, bool (*present)(void *, const char *), void *user, int *forgotten) {
    sweep s = {present, user, 0};
    bw_status status = bw_queue_write(q, sweep_outputs, &s);
    *forgotten = s.forgotten;
    return status;
}
