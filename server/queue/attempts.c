/* How jobs change: ends of attempts, and what their owners ask for. */
#include <string.h>

#include "server/clock.h"
#include "server/queue/writer.h"

/* ---- ends of an attempt ---- */

typedef struct {
    const char *id;
    int attempt;
    const char *outcome, *failure;
    const bw_made *made; /* of advance */
    const bw_spent *spent; /* NULL: nothing */
    int64_t due, now;
    int changes;
} ending;

#define FENCE " WHERE id = ? AND attempt = ? AND open = 1 AND state = 1"
#define NOT_CANCELLED " AND cancel = 0" /* whoever cancelled in time was told that the job would be dismissed */

static bw_status close_attempt(bw_writer *w, const ending *e, const char *kind) {
    bw_status status = bw_sql_run(&w->sql, NULL, "UPDATE attempts SET finished = ?, outcome = ? WHERE job = ? AND attempt = ?"
                                  " AND finished = 0", "issi", e->now, e->outcome, e->id, (int64_t)e->attempt);
    if (status == BW_OK && e->spent)
        status = bw_sql_run(&w->sql, NULL, "UPDATE jobs SET spent_wall_ms = spent_wall_ms + ?, spent_cpu_ms = spent_cpu_ms + ? WHERE id = ?", "iis",
                            e->spent->wall_ms, e->spent->cpu_ms, e->id);
    return status == BW_OK ? bw_event_add(w, e->id, kind, e->outcome, e->now, NULL) : status;
}

static bw_status finish_attempt(bw_queue *q, bw_write_fn fn, ending *e, bool *done) {
    bw_status status = bw_queue_write(q, fn, e);
    *done = status == BW_OK && e->changes == 1;
    return status;
}

static bw_status advance(bw_writer *w, void *user) {
    ending *e = user;
    int64_t state = 0;
    bw_status status =
        bw_sql_run(&w->sql, &e->changes, "UPDATE jobs SET open = 0, tries = 0, interruptions = 0, due = 0, stage = stage + 1,"
                   " state = CASE WHEN stage + 1 >= stage_count THEN 2 ELSE 1 END,"
                   " finished = CASE WHEN stage + 1 >= stage_count THEN ? ELSE 0 END, result_key = ?, state_key = ?,"
                   " cut = CASE WHEN cut = 0 AND ? THEN stage + 1 ELSE cut END, kind = ifnull(?, kind)" FENCE NOT_CANCELLED, "ississi", e->now,
                   e->made->manifest ? e->made->key : "", e->made->key, (int64_t)e->made->cut, e->made->kind, e->id, (int64_t)e->attempt);
    if (status != BW_OK || !e->changes) return status;
    status = bw_sql_number(&w->sql, &state, 0, "SELECT state FROM jobs WHERE id = ?", "s", e->id);
    if (status == BW_OK) status = close_attempt(w, e, state == BW_JOB_SUCCESSFUL ? "successful" : "done");
    return status == BW_OK ? bw_sql_run(&w->sql, NULL, "INSERT INTO outputs (key, bytes, manifest, need, created, used, kind)"
                                        " VALUES (?1, ?2, ?3, ?4, ?5, ?5, ifnull(?6, '')) ON CONFLICT (key) DO UPDATE SET bytes = excluded.bytes,"
                                        " manifest = excluded.manifest, need = excluded.need, created = excluded.created, used = excluded.used, kind = excluded.kind", "sisiis",
                                        e->made->key, (int64_t)e->made->bytes, e->made->manifest, (int64_t)e->made->need, e->now, e->made->kind) : status;
}

bw_status bw_queue_advance(bw_queue *q, const char *id, int attempt, const bw_made *made, int64_t now, const bw_spent *spent,
                           bool *done) {
    ending e = {.id = id, .attempt = attempt, .outcome = "ok", .made = made, .now = now, .spent = spent};
    return finish_attempt(q, advance, &e, done);
}

static bw_status retry(bw_writer *w, void *user) {
    ending *e = user;
    bw_status status = bw_sql_run(&w->sql, &e->changes, "UPDATE jobs SET open = 0, state = 0, due = ?" FENCE, "isi", e->due, e->id,
                                  (int64_t)e->attempt);
    return status == BW_OK && e->changes ? close_attempt(w, e, "retrying") : status;
}

bw_status bw_queue_retry(bw_queue *q, const char *id, int attempt, const char *outcome, int64_t due, int64_t now,
                         const bw_spent *spent, bool *done) {
    ending e = {.id = id, .attempt = attempt, .outcome = outcome, .due = due, .now = now, .spent = spent};
    return finish_attempt(q, retry, &e, done);
}

static bw_status fail(bw_writer *w, void *user) {
    ending *e = user;
    bw_status status = bw_sql_run(&w->sql, &e->changes, "UPDATE jobs SET open = 0, state = 3, finished = ?, failure = ?" FENCE NOT_CANCELLED, "issi",
                                  e->now, e->failure, e->id, (int64_t)e->attempt);
    return status == BW_OK && e->changes ? close_attempt(w, e, "failed") : status;
}

bw_status bw_queue_fail(bw_queue *q, const char *id, int attempt, const char *outcome, const char *failure, int64_t now,
                        const bw_spent *spent, bool *done) {
    ending e = {.id = id, .attempt = attempt, .outcome = outcome, .failure = failure, .now = now, .spent = spent};
    return finish_attempt(q, fail, &e, done);
}

static bw_status dismiss(bw_writer *w, void *user) {
    ending *e = user;
    bw_status status = bw_sql_run(&w->sql, &e->changes, "UPDATE jobs SET open = 0, state = 4, finished = ?" FENCE, "isi", e->now, e->id,
                                  (int64_t)e->attempt);
    return status == BW_OK && e->changes ? close_attempt(w, e, "dismissed") : status;
}

bw_status bw_queue_dismiss(bw_queue *q, const char *id, int attempt, int64_t now, const bw_spent *spent, bool *done) {
    ending e = {.id = id, .attempt = attempt, .outcome = "cancelled", .now = now, .spent = spent};
    return finish_attempt(q, dismiss, &e, done);
}

static bw_status interrupt(bw_writer *w, void *user) {
    ending *e = user;
    bw_status status = bw_sql_run(&w->sql, &e->changes, "UPDATE jobs SET open = 0, state = 0, tries = tries - 1" FENCE, "si", e->id,
                                  (int64_t)e->attempt);
    return status == BW_OK && e->changes ? close_attempt(w, e, "interrupted") : status;
}

bw_status bw_queue_interrupt(bw_queue *q, const char *id, int attempt, int64_t now, bool *done) {
    ending e = {.id = id, .attempt = attempt, .outcome = "interrupted", .now = now};
    return finish_attempt(q, interrupt, &e, done);
}

/* ---- what the owner asks for ---- */

typedef struct {
    int64_t seq;
    int state; /* -1: there is no such job */
    bool open, cancel, finish;
    char owner[BW_OWNER_TEXT];
} standing;

static bw_status look(bw_writer *w, const char *id, standing *s) {
    memset(s, 0, sizeof *s);
    s->state = -1;
    sqlite3_stmt *stmt = bw_sql_query(&w->sql, "SELECT seq, state, open, cancel, finish, owner FROM jobs WHERE id = ?", "s", id);
    if (!stmt) return BW_E_IO;
    int step = sqlite3_step(stmt);
    if (step == SQLITE_ROW) {
        s->seq = sqlite3_column_int64(stmt, 0);
        s->state = sqlite3_column_int(stmt, 1);
        s->open = sqlite3_column_int(stmt, 2) != 0;
        s->cancel = sqlite3_column_int(stmt, 3) != 0;
        s->finish = sqlite3_column_int(stmt, 4) != 0;
        bw_sql_put(s->owner, sizeof s->owner, stmt, 5);
    }
    bw_sql_done(stmt);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : bw_sql_error(&w->sql, "look");
}

static bool has_ended(const standing *s) { return s->state > BW_JOB_RUNNING; }

bw_status bw_write_cancel(bw_writer *w, void *user) {
    bw_change *c = user;
    standing s;
    bw_status status = look(w, c->id, &s);
    c->result = s.state < 0 ? BW_CHANGE_UNKNOWN
                : s.state == BW_JOB_SUCCESSFUL || s.state == BW_JOB_FAILED ? BW_CHANGE_TOO_LATE
                : s.open ? BW_CHANGE_NOTED : BW_CHANGE_DONE;
    bool already = c->result == BW_CHANGE_NOTED ? s.cancel : s.state == BW_JOB_DISMISSED;
    if (status != BW_OK || already || c->result == BW_CHANGE_UNKNOWN || c->result == BW_CHANGE_TOO_LATE) return status;
    if (c->result == BW_CHANGE_NOTED) {
        status = bw_sql_run(&w->sql, NULL, "UPDATE jobs SET cancel = 1 WHERE id = ?", "s", c->id);
        return status == BW_OK ? bw_event_add(w, c->id, "cancelling", NULL, c->now, NULL) : status;
    }
    status = bw_sql_run(&w->sql, NULL, "UPDATE jobs SET cancel = 1, state = 4, finished = ? WHERE id = ?", "is", c->now, c->id);
    return status == BW_OK ? bw_event_add(w, c->id, "dismissed", NULL, c->now, NULL) : status;
}

bw_status bw_write_finish(bw_writer *w, void *user) {
    bw_change *c = user;
    standing s;
    bw_status status = look(w, c->id, &s);
    c->result = s.state < 0 ? BW_CHANGE_UNKNOWN : has_ended(&s) ? BW_CHANGE_TOO_LATE : BW_CHANGE_NOTED;
    if (status != BW_OK || c->result != BW_CHANGE_NOTED || s.finish) return status;
    status = bw_sql_run(&w->sql, NULL, "UPDATE jobs SET finish = 1 WHERE id = ?", "s", c->id);
    return status == BW_OK ? bw_event_add(w, c->id, "finishing", NULL, c->now, NULL) : status;
}

bw_status bw_write_restart(bw_writer *w, void *user) {
    bw_change *c = user;
    standing s;
    bw_owner has;
    bw_status status = look(w, c->id, &s);
    c->result = s.state < 0 ? BW_CHANGE_UNKNOWN
                : !has_ended(&s) ? BW_CHANGE_TOO_EARLY
                : s.state == BW_JOB_SUCCESSFUL ? BW_CHANGE_TOO_LATE : BW_CHANGE_DONE;
    if (status == BW_OK) status = bw_owner_read(&w->sql, s.owner, &has);
    c->in_force = c->limits;
    if (status == BW_OK) status = bw_owner_limits(&w->sql, s.owner, &c->in_force);
    if (status != BW_OK || c->result != BW_CHANGE_DONE) return status;
    if (c->in_force.queued && has.waiting + has.running >= c->in_force.queued) {
        c->result = BW_CHANGE_TOO_MANY;
        return BW_OK;
    }
    status = bw_sql_run(&w->sql, NULL, "UPDATE jobs SET state = 0, cancel = 0, finish = 0, tries = 0, interruptions = 0, due = 0,"
                        " finished = 0, failure = NULL, spent_wall_ms = 0, spent_cpu_ms = 0 WHERE id = ?", "s", c->id);
    return status == BW_OK ? bw_event_add(w, c->id, "restarted", NULL, c->now, NULL) : status;
}

/* Tags and events go by trigger. */
bw_status bw_job_drop(bw_writer *w, const char *id, const char *owner, int64_t seq, int64_t now) {
    bw_status status = bw_sql_run(&w->sql, NULL, "DELETE FROM attempts WHERE job = ?", "s", id);
    if (status == BW_OK) status = bw_sql_run(&w->sql, NULL, "DELETE FROM jobs WHERE seq = ?", "i", seq);
    return status == BW_OK ? bw_sql_run(&w->sql, NULL, "INSERT INTO gone (id, owner, at) VALUES (?, ?, ?)", "ssi", id, owner, now) : status;
}

bw_status bw_write_delete(bw_writer *w, void *user) {
    bw_change *c = user;
    standing s;
    bw_status status = look(w, c->id, &s);
    c->result = s.state < 0 ? BW_CHANGE_UNKNOWN : has_ended(&s) ? BW_CHANGE_DONE : BW_CHANGE_TOO_EARLY;
    if (status != BW_OK || c->result != BW_CHANGE_DONE) return status;
    return bw_job_drop(w, c->id, s.owner, s.seq, c->now);
}

static bw_status set_pinned(bw_writer *w, bw_change *c, int64_t pinned) {
    int n;
    bw_status status = bw_sql_run(&w->sql, &n, "UPDATE jobs SET pinned = ? WHERE id = ?", "is", pinned, c->id);
    c->result = n ? BW_CHANGE_DONE : BW_CHANGE_UNKNOWN;
    return status;
}

bw_status bw_write_pin(bw_writer *w, void *change) { return set_pinned(w, change, 1); }
bw_status bw_write_unpin(bw_writer *w, void *change) { return set_pinned(w, change, 0); }

bw_status bw_queue_cancel(bw_queue *q, const char *id, int64_t now, bw_cancel *result) {
    bw_change c = {.id = id, .now = now};
    bw_status status = bw_queue_write(q, bw_write_cancel, &c);
    *result = c.result == BW_CHANGE_UNKNOWN ? BW_CANCEL_UNKNOWN : c.result == BW_CHANGE_TOO_LATE ? BW_CANCEL_TOO_LATE
              : c.result == BW_CHANGE_NOTED ? BW_CANCEL_NOTED : BW_CANCEL_DISMISSED;
    return status;
}

bw_status bw_queue_finish(bw_queue *q, const char *id, bw_finish *result) {
    bw_change c = {.id = id, .now = bw_now_ms()};
    bw_status status = bw_queue_write(q, bw_write_finish, &c);
    *result = c.result == BW_CHANGE_UNKNOWN ? BW_FINISH_UNKNOWN : c.result == BW_CHANGE_NOTED ? BW_FINISH_NOTED : BW_FINISH_TOO_LATE;
    return status;
}

/* ---- after a crash ---- */

typedef struct {
    int64_t now;
    int recovered;
} recovery;

/* Set by set: one pass over the jobs that were open, whatever the size of the queue. */
static bw_status recover(bw_writer *w, void *user) {
    static const char failure[] =
        "{\"type\":\"/problems/internal\",\"title\":\"internal error\",\"status\":500,\"class\":\"system\","
        "\"detail\":\"the daemon went away too often while this stage ran\"}";
    recovery *r = user;
    int64_t most = BW_INTERRUPTIONS_MOST;
    int dismissed = 0, failed = 0;
    bw_sql *sql = &w->sql;
    bw_status status = bw_sql_run(sql, &r->recovered, "UPDATE attempts SET finished = ?, outcome = 'interrupted' WHERE finished = 0",
                                  "i", r->now);
    if (status == BW_OK) /* before the jobs change, because only now they can be told */
        status = bw_sql_run(sql, NULL, "INSERT INTO events (job, kind, data, at) SELECT id,"
                            " CASE WHEN cancel = 1 THEN 'dismissed' WHEN interruptions >= ?1 THEN 'failed' ELSE 'interrupted' END,"
                            " json_object(" BW_EVENT_DATA("CASE WHEN cancel = 1 THEN 4 WHEN interruptions >= ?1 THEN 3 ELSE 0 END")
                            ", 'outcome', 'interrupted'), ?2 FROM jobs WHERE open = 1", "ii", most, r->now);
    if (status == BW_OK)
        status = bw_sql_run(sql, &dismissed, "UPDATE jobs SET open = 0, state = 4, finished = ? WHERE open = 1 AND cancel = 1", "i", r->now);
    if (status == BW_OK)
        status = bw_sql_run(sql, &failed, "UPDATE jobs SET open = 0, state = 3, finished = ?, failure = ?"
                            " WHERE open = 1 AND interruptions >= ?", "isi", r->now, failure, most);
    if (status == BW_OK)
        status = bw_sql_run(sql, NULL, "UPDATE jobs SET open = 0, state = 0, due = 0, interruptions = interruptions + 1,"
                            " tries = tries - 1 WHERE open = 1", "");
    w->tally.ended[BW_JOB_DISMISSED] += (unsigned)dismissed;
    w->tally.ended[BW_JOB_FAILED] += (unsigned)failed;
    return status;
}

bw_status bw_queue_recover(bw_queue *q, int64_t now, int *recovered) {
    recovery r = {.now = now};
    bw_status status = bw_queue_write(q, recover, &r);
    *recovered = r.recovered;
    return status;
}
