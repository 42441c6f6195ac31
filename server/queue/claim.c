/* Who is next: round-robin over owners, the one least recently served first; of an owner's jobs those that have started, then
 * by priority, then by age. Each look is one step along an index. */
#include <stdlib.h>
#include <string.h>

#include "server/queue/writer.h"

bw_status bw_queue_turn(bw_queue *q, int64_t running_most, bw_turn *turn, bool *found) {
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT owner, served FROM owners INDEXED BY owners_turn WHERE waiting > 0"
                                               " AND (served, owner) > (?, ?) AND running < coalesce((SELECT nullif(quotas.running, -1) FROM quotas"
                                               " WHERE quotas.owner = owners.owner), ?) ORDER BY served, owner LIMIT 1", "isi",
                                               turn->served, turn->owner, running_most ? running_most : INT64_MAX) : NULL;
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    *found = step == SQLITE_ROW;
    if (*found) {
        bw_sql_put(turn->owner, sizeof turn->owner, stmt, 0);
        turn->served = sqlite3_column_int64(stmt, 1);
    }
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

bw_status bw_queue_candidates(bw_queue *q, const char *owner, int64_t now, int skip, int limit, bw_job **jobs, size_t *count) {
    bw_job *list = calloc((size_t)limit, sizeof *list);
    size_t n = 0;
    int step = SQLITE_ERROR;
    *jobs = NULL;
    *count = 0;
    if (!list) return BW_E_MEMORY;
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT" BW_JOB_COLUMNS "FROM jobs INDEXED BY jobs_waiting WHERE owner = ?"
                                               " AND open = 0 AND state < 2 AND (due <= ? OR due > ?) ORDER BY state DESC, priority DESC, seq"
                                               " LIMIT ? OFFSET ?", "siiii", owner, now, now + BW_PAUSE_MOST_MS, (int64_t)limit,
                                               (int64_t)skip) : NULL;
    while (stmt && n < (size_t)limit && (step = sqlite3_step(stmt)) == SQLITE_ROW) bw_job_read(stmt, &list[n++]);
    bw_status status = step == SQLITE_DONE || step == SQLITE_ROW ? BW_OK : BW_E_IO;
    if (stmt && status != BW_OK) bw_sql_error(reader, "candidates");
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    if (status == BW_OK) *jobs = list, *count = n;
    else bw_jobs_free(list, n);
    return status;
}

bw_status bw_queue_next_due(bw_queue *q, int64_t now, int64_t *due) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, due, 0, "SELECT due FROM jobs INDEXED BY jobs_due WHERE open = 0 AND state < 2"
                                              " AND due > 0 AND due > ? ORDER BY due LIMIT 1", "i", now) : BW_E_IO;
    bw_reader_return(q, reader);
    return status;
}

/* ---- the two ways to take a turn ---- */

enum { USED_COARSE_MS = 60000 }; /* how exact the last use of an output is known */

typedef struct {
    bw_job *job;
    const char *key; /* of a reused output */
    bool results;
    int64_t now;
    int changes;
} taking;

static bool is_last(const bw_job *job) { return job->stage + 1 >= job->stage_count; }

static bw_status add_attempt(bw_writer *w, const taking *t, bool reused) {
    const bw_job *job = t->job;
    int64_t served;
    bool last = reused && is_last(job);
    bw_status status =
        bw_sql_run(&w->sql, NULL, "INSERT INTO attempts (job, attempt, stage, reused, started, finished, outcome)"
                   " VALUES (?, ?, ?, ?, ?, ?, ?)", "sisiiis", job->id, (int64_t)job->attempt + 1, bw_api_stages[job->stage].name,
                   (int64_t)reused, t->now, reused ? t->now : (int64_t)0, reused ? "ok" : "");
    if (status == BW_OK)
        status = bw_event_add(w, job->id, last ? "successful" : reused ? "reused" : "started", last ? "reused" : NULL, t->now, &served);
    /* The number of the event says when its owner was served last: such numbers only grow. */
    return status == BW_OK ? bw_sql_run(&w->sql, NULL, "UPDATE owners SET served = ? WHERE owner ="
                                        " (SELECT owner FROM jobs WHERE id = ?)", "is", served, job->id) : status;
}

static bw_status claim(bw_writer *w, void *user) {
    taking *t = user;
    bw_status status = bw_sql_run(&w->sql, &t->changes, "UPDATE jobs SET state = 1, open = 1, attempt = attempt + 1,"
                                  " tries = tries + 1, started = CASE started WHEN 0 THEN ? ELSE started END"
                                  " WHERE id = ? AND attempt = ? AND open = 0 AND state IN (0, 1)", "isi", t->now, t->job->id,
                                  (int64_t)t->job->attempt);
    return status == BW_OK && t->changes ? add_attempt(w, t, false) : status;
}

bw_status bw_queue_claim(bw_queue *q, bw_job *job, int64_t now, bool *done) {
    taking t = {.job = job, .now = now};
    bw_status status = bw_queue_write(q, claim, &t);
    *done = status == BW_OK && t.changes == 1;
    if (*done) {
        job->state = BW_JOB_RUNNING;
        job->open = true;
        job->attempt++;
        job->tries++;
    }
    return status;
}

static bw_status reuse(bw_writer *w, void *user) {
    taking *t = user;
    bool last = is_last(t->job);
    bw_status status =
        bw_sql_run(&w->sql, &t->changes, "UPDATE jobs SET state = ?, attempt = attempt + 1, tries = 0, interruptions = 0, due = 0,"
                   " stage = stage + 1, finished = ?, result_key = ?, state_key = ?, started = CASE started WHEN 0 THEN ? ELSE started END,"
                   " kind = ifnull((SELECT nullif(outputs.kind, '') FROM outputs WHERE key = ?4), kind)"
                   " WHERE id = ? AND attempt = ? AND open = 0 AND state IN (0, 1) AND (?4 = '' OR EXISTS (SELECT 1 FROM outputs WHERE key = ?4))",
                   "iissisi", (int64_t)(last ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING), last ? t->now : (int64_t)0,
                   t->results ? t->key : "", t->key, t->now, t->job->id, (int64_t)t->job->attempt);
    if (status == BW_OK && t->changes) status = add_attempt(w, t, true);
    if (status != BW_OK || !t->changes) return status;
    return bw_sql_run(&w->sql, NULL, "UPDATE outputs SET used = ? WHERE key = ? AND used < ?", "isi", t->now, t->key,
                      t->now - USED_COARSE_MS);
}

bw_status bw_queue_reuse(bw_queue *q, bw_job *job, const char *key, bool results, int64_t now, bool *done) {
    taking t = {.job = job, .key = key, .results = results, .now = now};
    bool last = is_last(job);
    bw_status status = bw_queue_write(q, reuse, &t);
    *done = status == BW_OK && t.changes == 1;
    if (*done) {
        job->state = last ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING;
        job->attempt++;
        job->stage++;
        job->tries = 0;
    }
    return status;
}

static bw_status go_back(bw_writer *w, void *user) {
    taking *t = user;
    bw_status status = bw_sql_run(&w->sql, &t->changes, "UPDATE jobs SET stage = 0, state_key = '', tries = 0, spent_wall_ms = 0, spent_cpu_ms = 0 WHERE id = ? AND attempt = ?"
                                  " AND open = 0 AND state IN (0, 1)", "si", t->job->id, (int64_t)t->job->attempt);
    return status == BW_OK && t->changes ? bw_event_add(w, t->job->id, "rewound", NULL, t->now, NULL) : status;
}

bw_status bw_queue_rewind(bw_queue *q, bw_job *job, int64_t now, bool *done) {
    taking t = {.job = job, .now = now};
    bw_status status = bw_queue_write(q, go_back, &t);
    *done = status == BW_OK && t.changes == 1;
    if (*done) {
        job->stage = job->tries = 0;
        job->spent = (bw_spent){0};
    }
    return status;
}
