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
