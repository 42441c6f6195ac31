/* What may go, found in order along indexes, a bounded number of rows at a time. */
#include "server/queue/retention.h"

#include <stdio.h>
#include <string.h>

#include "server/queue/writer.h"

/* Of a row of jobs: it stays. ?1, ?2: finished_before and failed_before of the policy. */
#define STAYS "(j.state < 2 OR j.pinned = 1 OR NOT j.finished < CASE j.state WHEN 2 THEN ?1 ELSE ?2 END)"
/* A job of the owner that stays names the blob. */
#define NAMED(b)                                                                                                       \
    "(EXISTS (SELECT 1 FROM jobs j INDEXED BY jobs_by_input WHERE j.input = " b ".sha256 AND j.owner = " b ".owner AND " STAYS ")"                \
    " OR EXISTS (SELECT 1 FROM jobs j INDEXED BY jobs_by_parameters WHERE j.parameters <> '' AND j.parameters = " b ".sha256"      \
    " AND j.owner = " b ".owner AND " STAYS "))"
#define EXPIRED(state, before)                                                                                         \
    "SELECT id, owner, seq FROM jobs INDEXED BY jobs_expiring WHERE state > 1 AND pinned = 0 AND state = " state " AND finished < " before
#define ALL_EXPIRED EXPIRED("2", "?1") " UNION ALL " EXPIRED("3", "?2") " UNION ALL " EXPIRED("4", "?2")

enum { JOB_ROWS = 32 }; /* each has its attempts, events and tags with it */

/* ---- what goes by age alone ---- */

static bw_status count_aged(bw_sql *sql, bw_collect *c) {
    const bw_policy *p = c->policy;
    if (c->kind == BW_KEEP_JOBS)
        return bw_sql_number(sql, &c->count, 0, "SELECT count(*) FROM (" ALL_EXPIRED ")", "ii", p->finished_before, p->failed_before);
    if (c->kind == BW_KEEP_KEYS) return bw_sql_number(sql, &c->count, 0, "SELECT count(*) FROM idempotency WHERE created < ?", "i", p->keys_before);
    return bw_sql_number(sql, &c->count, 0, "SELECT count(*) FROM gone WHERE at < ?", "i", p->gone_before);
}

typedef struct {
    char id[BW_JOB_ID_TEXT], owner[BW_OWNER_TEXT];
    int64_t seq;
} expired;

static bw_status find_expired(bw_sql *sql, const bw_policy *p, expired jobs[JOB_ROWS], int *count) {
    int step = SQLITE_ERROR, n = 0;
    sqlite3_stmt *stmt = bw_sql_query(sql, ALL_EXPIRED " LIMIT ?3", "iii", p->finished_before, p->failed_before, (int64_t)JOB_ROWS);
    while (stmt && n < JOB_ROWS && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        bw_sql_put(jobs[n].id, sizeof jobs[n].id, stmt, 0);
        bw_sql_put(jobs[n].owner, sizeof jobs[n].owner, stmt, 1);
        jobs[n++].seq = sqlite3_column_int64(stmt, 2);
    }
    bw_sql_done(stmt);
    *count = n;
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

static bw_status drop_jobs(bw_writer *w, bw_collect *c, int64_t now) {
    expired jobs[JOB_ROWS];
    int n;
    bw_status status = find_expired(&w->sql, c->policy, jobs, &n);
    for (int i = 0; status == BW_OK && i < n; i++) {
        status = bw_job_drop(w, jobs[i].id, jobs[i].owner, jobs[i].seq, now);
        if (status == BW_OK && c->take) c->take(c->user, c->kind, jobs[i].id);
    }
    c->count += n;
    c->more = n == JOB_ROWS;
    return status;
}

static bw_status drop_aged(bw_writer *w, bw_collect *c) {
    const bw_policy *p = c->policy;
    int n = 0;
    bw_status status =
        c->kind == BW_KEEP_KEYS
            ? bw_sql_run(&w->sql, &n, "DELETE FROM idempotency WHERE (owner, key) IN (SELECT owner, key FROM idempotency WHERE created < ?"
                         " ORDER BY created LIMIT ?)", "ii", p->keys_before, (int64_t)BW_COLLECT_ROWS)
            : bw_sql_run(&w->sql, &n, "DELETE FROM gone WHERE id IN (SELECT id FROM gone WHERE at < ? ORDER BY at LIMIT ?)", "ii",
                         p->gone_before, (int64_t)BW_COLLECT_ROWS);
    c->count += n;
    c->more = n == BW_COLLECT_ROWS;
    return status;
}

/* ---- outputs and blobs, by their last use ---- */

typedef struct {
    char name[BW_SHA256_TEXT], owner[BW_OWNER_TEXT];
    int64_t at, bytes;
    bool held, shared; /* shared: another owner has the blob too, and would keep it or come later in a dry run */
} candidate;

static sqlite3_stmt *select_candidates(bw_sql *sql, const bw_collect *c) {
    const bw_policy *p = c->policy;
    if (c->kind == BW_KEEP_OUTPUTS)
        return bw_sql_query(sql, "SELECT key, '', used, bytes,"
                            " EXISTS (SELECT 1 FROM jobs j INDEXED BY jobs_by_result WHERE j.result_key <> '' AND j.result_key = o.key AND " STAYS ")"
                            " OR EXISTS (SELECT 1 FROM jobs j INDEXED BY jobs_by_state_key WHERE j.state < 2 AND j.state_key <> '' AND j.state_key = o.key), 0"
                            " FROM outputs o INDEXED BY outputs_by_use WHERE (used, key) > (?3, ?4) ORDER BY used, key LIMIT ?5", "iiisi",
                            p->finished_before, p->failed_before, c->at, c->at_name, (int64_t)BW_COLLECT_ROWS);
    return bw_sql_query(sql, "SELECT sha256, owner, used, bytes, " NAMED("b") ", EXISTS (SELECT 1 FROM blobs o WHERE o.sha256 = b.sha256"
                        " AND o.owner <> b.owner AND ((o.used, o.owner) > (b.used, b.owner) OR " NAMED("o") "))"
                        " FROM blobs b INDEXED BY blobs_by_use WHERE used < ?3 AND (used, sha256, owner) > (?4, ?5, ?6)"
                        " ORDER BY used, sha256, owner LIMIT ?7", "iiiissi", p->finished_before, p->failed_before, p->blobs_before,
                        c->at, c->at_name, c->at_owner, (int64_t)BW_COLLECT_ROWS);
}

static bw_status find_candidates(bw_sql *sql, const bw_collect *c, candidate found[BW_COLLECT_ROWS], int *count) {
    int step = SQLITE_ERROR, n = 0;
    sqlite3_stmt *stmt = select_candidates(sql, c);
    while (stmt && n < BW_COLLECT_ROWS && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        candidate *x = &found[n++];
        bw_sql_put(x->name, sizeof x->name, stmt, 0);
        bw_sql_put(x->owner, sizeof x->owner, stmt, 1);
        x->at = sqlite3_column_int64(stmt, 2);
        x->bytes = sqlite3_column_int64(stmt, 3);
        x->held = sqlite3_column_int(stmt, 4) != 0;
        x->shared = sqlite3_column_int(stmt, 5) != 0;
    }
    bw_sql_done(stmt);
    *count = n;
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

/* `w` is NULL in a dry run. */
static bw_status drop_candidate(bw_writer *w, bw_collect *c, const candidate *x) {
    bool output = c->kind == BW_KEEP_OUTPUTS;
    int64_t shared = x->shared;
    bw_status status = BW_OK;
    if (w)
        status = output ? bw_sql_run(&w->sql, NULL, "DELETE FROM outputs WHERE key = ?", "s", x->name)
                        : bw_sql_run(&w->sql, NULL, "DELETE FROM blobs WHERE sha256 = ? AND owner = ?", "ss", x->name, x->owner);
    if (w && !output && status == BW_OK) /* the rows decide: a job that held one of them when it was passed may have gone since */
        status = bw_sql_number(&w->sql, &shared, 0, "SELECT 1 FROM blobs WHERE sha256 = ? LIMIT 1", "s", x->name);
    if (status != BW_OK) return status;
    if (w && c->take && !shared) c->take(c->user, c->kind, x->name);
    c->count += output || !shared;
    c->bytes += shared ? 0 : x->bytes;
    c->total -= x->bytes;
    return BW_OK;
}

static bool enough(const bw_collect *c) { return c->kind == BW_KEEP_OUTPUTS && c->total <= c->policy->cache_most; }

static bw_status drop_unused(bw_sql *sql, bw_writer *w, bw_collect *c) {
    candidate found[BW_COLLECT_ROWS];
    int n = 0;
    bw_status status = BW_OK;
    if (c->kind == BW_KEEP_OUTPUTS && (w || !c->begun))
        status = bw_sql_number(sql, &c->total, 0, "SELECT value FROM totals WHERE name = 'cache'", "");
    if (!c->begun) c->at = -1;
    c->begun = true;
    if (status == BW_OK && !enough(c)) status = find_candidates(sql, c, found, &n);
    for (int i = 0; status == BW_OK && i < n && !enough(c); i++) {
        if (!found[i].held) status = drop_candidate(w, c, &found[i]);
        else c->held++, c->held_bytes += found[i].bytes;
        c->at = found[i].at;
        memcpy(c->at_name, found[i].name, sizeof c->at_name);
        memcpy(c->at_owner, found[i].owner, sizeof c->at_owner);
    }
    c->more = n == BW_COLLECT_ROWS && !enough(c);
    return status;
}

/* ---- steps ---- */

static bool asked_for(const bw_collect *c) {
    const bw_policy *p = c->policy;
    switch (c->kind) {
    case BW_KEEP_JOBS: return p->finished_before || p->failed_before;
    case BW_KEEP_OUTPUTS: return p->cache_most != 0;
    case BW_KEEP_BLOBS: return p->blobs_before != 0;
    case BW_KEEP_KEYS: return p->keys_before != 0;
    default: return p->gone_before != 0;
    }
}

typedef struct {
    const bw_collect *before;
    bw_collect after; /* a write may be run again, and then begins where the first did */
} collecting;

static bw_status collect(bw_writer *w, void *user) {
    collecting *x = user;
    bw_collect *c = &x->after;
    *c = *x->before;
    if (c->kind == BW_KEEP_JOBS) return drop_jobs(w, c, c->policy->now);
    return c->kind == BW_KEEP_OUTPUTS || c->kind == BW_KEEP_BLOBS ? drop_unused(&w->sql, w, c) : drop_aged(w, c);
}

static bw_status rehearse(bw_queue *q, bw_collect *c) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = !reader ? BW_E_IO
                       : c->kind == BW_KEEP_OUTPUTS || c->kind == BW_KEEP_BLOBS ? drop_unused(reader, NULL, c) : count_aged(reader, c);
    bw_reader_return(q, reader);
    return status;
}

bw_status bw_queue_collect(bw_queue *q, bw_collect *c) {
    collecting x = {.before = c};
    c->more = false;
    if (!asked_for(c)) return BW_OK;
    if (c->dry) return rehearse(q, c);
    bw_status status = bw_queue_write(q, collect, &x);
    if (status == BW_OK) *c = x.after;
    return status;
}

bw_status bw_queue_cache_bytes(bw_queue *q, int64_t *bytes) {
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, bytes, 0, "SELECT value FROM totals WHERE name = 'cache'", "") : BW_E_IO;
    bw_reader_return(q, reader);
    return status;
}

bw_status bw_queue_has_job(bw_queue *q, const char *id, bool *found) {
    int64_t there = 0;
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, &there, 0, "SELECT 1 FROM jobs WHERE id = ?", "s", id) : BW_E_IO;
    bw_reader_return(q, reader);
    *found = there != 0;
    return status;
}

/* ---- at start ---- */

typedef struct {
    const char *sha256;
    int64_t bytes, now;
    int added;
} adoption;

static bw_status adopt(bw_writer *w, void *user) {
    adoption *a = user;
    return bw_sql_run(&w->sql, &a->added, "INSERT INTO blobs (sha256, owner, bytes, created, used) SELECT ?1, '', ?2, ?3, ?3"
                      " WHERE NOT EXISTS (SELECT 1 FROM blobs WHERE sha256 = ?1)", "sii", a->sha256, a->bytes, a->now);
}

bw_status bw_queue_adopt_blob(bw_queue *q, const char *sha256, int64_t bytes, int64_t now, bool *added) {
    adoption a = {sha256, bytes, now, 0};
    int64_t known = 0;
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, &known, 0, "SELECT 1 FROM blobs WHERE sha256 = ? LIMIT 1", "s", sha256) : BW_E_IO;
    bw_reader_return(q, reader);
    if (status == BW_OK && !known) status = bw_queue_write(q, adopt, &a);
    *added = status == BW_OK && a.added > 0;
    return status;
}

typedef struct {
    bool (*present)(void *user, const char *sha256);
    void *user;
    int64_t now;
    bw_mended mended;
} mending;

static void sql_present(sqlite3_context *context, int argc, sqlite3_value **argv) {
    const mending *m = sqlite3_user_data(context);
    const unsigned char *name = sqlite3_value_text(argv[0]);
    (void)argc;
    sqlite3_result_int(context, name && m->present(m->user, (const char *)name));
}

#define LOST                                                                                                           \
    "(state = 2 AND result_key <> '' AND NOT EXISTS (SELECT 1 FROM outputs WHERE key = jobs.result_key)"               \
    " OR state < 2 AND stage = 0 AND (NOT EXISTS (SELECT 1 FROM blobs WHERE sha256 = jobs.input)"                      \
    " OR parameters <> '' AND NOT EXISTS (SELECT 1 FROM blobs WHERE sha256 = jobs.parameters)))"

/* What a failed job of these had is forgotten, so that a retry begins anew. */
static bw_status fail_lost(bw_writer *w, mending *m) {
    static const char failure[] =
        "{\"type\":\"/problems/files-lost\",\"title\":\"files of the job are gone\",\"status\":500,\"class\":\"system\","
        "\"detail\":\"its input or its results were not in the data folder when the daemon started\"}";
    int n = 0;
    bw_status status = bw_sql_run(&w->sql, NULL, "INSERT INTO events (job, kind, data, at) SELECT id, 'failed', json_object("
                                  BW_EVENT_DATA("3") ", 'outcome', 'files-lost'), ?1 FROM jobs WHERE " LOST, "i", m->now);
    if (status == BW_OK)
        status = bw_sql_run(&w->sql, &n, "UPDATE jobs SET state = 3, stage = 0, state_key = '', result_key = '', finished = ?, failure = ?"
                            " WHERE " LOST, "is", m->now, failure);
    m->mended.jobs_failed = n;
    w->tally.ended[BW_JOB_FAILED] += (unsigned)n;
    return status;
}

static bw_status mend(bw_writer *w, void *user) {
    mending *m = user;
    int n = 0;
    if (sqlite3_create_function(w->sql.db, "blob_present", 1, SQLITE_UTF8, m, sql_present, NULL, NULL) != SQLITE_OK)
        return bw_sql_error(&w->sql, "function");
    bw_status status = bw_sql_run(&w->sql, &n, "DELETE FROM blobs WHERE NOT blob_present(sha256)", "");
    sqlite3_create_function(w->sql.db, "blob_present", 1, SQLITE_UTF8, NULL, NULL, NULL, NULL);
    m->mended.blobs_forgotten = n;
    return status == BW_OK ? fail_lost(w, m) : status;
}

bw_status bw_queue_mend(bw_queue *q, bool (*present)(void *, const char *), void *user, int64_t now, bw_mended *mended) {
    mending m = {.present = present, .user = user, .now = now};
    bw_status status = bw_queue_write(q, mend, &m);
    mended->blobs_forgotten = m.mended.blobs_forgotten;
    mended->jobs_failed = m.mended.jobs_failed;
    return status;
}
