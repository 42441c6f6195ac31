/* The journal: one row for every change of a job's state or stage, written with that change. */
#include "server/queue/writer.h"

#include <string.h>

bw_status bw_event_add(bw_writer *w, const char *id, const char *kind, const char *outcome, int64_t now, int64_t *seq) {
    bw_status status = bw_sql_run(&w->sql, NULL,
                                  "INSERT INTO events (job, kind, data, at) SELECT id, ?1, CASE WHEN ?2 IS NULL THEN json_object("
                                  BW_EVENT_DATA("state") ") ELSE json_object(" BW_EVENT_DATA("state") ", 'outcome', ?2) END, ?3"
                                  " FROM jobs WHERE id = ?4", "ssis", kind, outcome, now, id);
    if (seq) *seq = sqlite3_last_insert_rowid(w->sql.db);
    w->tally.accepted += strcmp(kind, "queued") == 0;
    for (int i = BW_JOB_SUCCESSFUL; i < BW_JOB_COUNT; i++) w->tally.ended[i] += strcmp(kind, bw_job_state_names[i]) == 0;
    return status;
}

static void sql_stage_name(sqlite3_context *context, int argc, sqlite3_value **argv) {
    int stage = sqlite3_value_int(argv[0]);
    (void)argc;
    if (stage >= 0 && stage < BW_API_STAGE_COUNT) sqlite3_result_text(context, bw_api_stages[stage].name, -1, SQLITE_STATIC);
}

static void sql_state_name(sqlite3_context *context, int argc, sqlite3_value **argv) {
    int state = sqlite3_value_int(argv[0]);
    (void)argc;
    if (state >= 0 && state < BW_JOB_COUNT) sqlite3_result_text(context, bw_job_state_names[state], -1, SQLITE_STATIC);
}

bw_status bw_event_functions(bw_sql *sql) {
    int flags = SQLITE_UTF8 | SQLITE_DETERMINISTIC;
    if (sqlite3_create_function(sql->db, "stage_name", 1, flags, NULL, sql_stage_name, NULL, NULL) != SQLITE_OK ||
        sqlite3_create_function(sql->db, "state_name", 1, flags, NULL, sql_state_name, NULL, NULL) != SQLITE_OK)
        return bw_sql_error(sql, "function");
    return BW_OK;
}

/* ---- reading ---- */

static sqlite3_stmt *select_events(bw_sql *sql, const bw_journal *w) {
    if (w->job)
        return bw_sql_query(sql, "SELECT seq, job, kind, data, at FROM events WHERE job = ? AND seq > ? ORDER BY seq LIMIT ?", "sii", w->job,
                            w->after, (int64_t)w->limit);
    if (w->owner)
        return bw_sql_query(sql, "SELECT seq, job, kind, data, at, (SELECT owner FROM jobs WHERE id = job) FROM events WHERE seq > ?"
                            " ORDER BY seq LIMIT ?", "ii", w->after, (int64_t)w->limit);
    return bw_sql_query(sql, "SELECT seq, job, kind, data, at FROM events WHERE seq > ? ORDER BY seq LIMIT ?", "ii", w->after, (int64_t)w->limit);
}

static const char *column(sqlite3_stmt *stmt, int i) {
    const char *text = (const char *)sqlite3_column_text(stmt, i);
    return text ? text : "";
}

bw_status bw_queue_journal(bw_queue *q, bw_journal *w, bw_journal_fn fn, void *user) {
    int step = SQLITE_ERROR;
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? select_events(reader, w) : NULL;
    w->last = w->after;
    w->looked = 0;
    while (stmt && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        w->last = sqlite3_column_int64(stmt, 0);
        w->looked++;
        if (w->job || !w->owner || strcmp(column(stmt, 5), w->owner) == 0)
            fn(user, w->last, column(stmt, 1), column(stmt, 2), column(stmt, 3), sqlite3_column_int64(stmt, 4));
    }
    bw_status status = step == SQLITE_DONE ? BW_OK : stmt ? bw_sql_error(reader, "journal") : BW_E_IO;
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return status;
}

static bw_status read_number(bw_queue *q, int64_t *value, int64_t otherwise, const char *text, const char *id) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = !reader ? BW_E_IO : id ? bw_sql_number(reader, value, otherwise, text, "s", id) : bw_sql_number(reader, value, otherwise, text, "");
    bw_reader_return(q, reader);
    return status;
}

bw_status bw_queue_journal_end(bw_queue *q, int64_t *seq) {
    return read_number(q, seq, 0, "SELECT max(seq) FROM events", NULL);
}

bw_status bw_queue_state(bw_queue *q, const char *id, bw_job_state *state, bool *known) {
    int64_t value = -1;
    bw_status status = read_number(q, &value, -1, "SELECT state FROM jobs WHERE id = ?", id);
    *known = status == BW_OK && value >= 0;
    *state = *known ? (bw_job_state)value : BW_JOB_QUEUED;
    return status;
}
