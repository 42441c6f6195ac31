#include "server/queue.h"

#include <inttypes.h>
#include <pthread.h>
#include <sqlite3.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "server/log.h"

struct bw_queue {
    sqlite3 *writer, *reader;
    pthread_mutex_t write_lock, read_lock;
    atomic_bool broken; /* the last commit failed */
};

/* Migrations: entry i leads from version i to version i + 1 (PRAGMA user_version). To change the schema append an entry;
 * never edit one that has been released. */
static const char *const migrations[] = {
    "CREATE TABLE jobs ("
    " seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, name TEXT, input TEXT NOT NULL,"
    " options TEXT NOT NULL, state INTEGER NOT NULL, open INTEGER NOT NULL DEFAULT 0, cancel INTEGER NOT NULL DEFAULT 0,"
    " stage INTEGER NOT NULL DEFAULT 0, stage_count INTEGER NOT NULL, attempt INTEGER NOT NULL DEFAULT 0,"
    " tries INTEGER NOT NULL DEFAULT 0, interruptions INTEGER NOT NULL DEFAULT 0, due INTEGER NOT NULL DEFAULT 0,"
    " created INTEGER NOT NULL, started INTEGER NOT NULL DEFAULT 0, finished INTEGER NOT NULL DEFAULT 0,"
    " failure TEXT, result_key TEXT NOT NULL DEFAULT '');"
    "CREATE INDEX jobs_waiting ON jobs(seq) WHERE open = 0 AND state IN (0, 1);"
    "CREATE INDEX jobs_by_state ON jobs(state, seq);"
    "CREATE TABLE attempts ("
    " job TEXT NOT NULL REFERENCES jobs(id), attempt INTEGER NOT NULL, stage TEXT NOT NULL, reused INTEGER NOT NULL,"
    " started INTEGER NOT NULL, finished INTEGER NOT NULL DEFAULT 0, outcome TEXT NOT NULL DEFAULT '',"
    " PRIMARY KEY (job, attempt)) WITHOUT ROWID;"
    "CREATE INDEX attempts_open ON attempts(job) WHERE finished = 0;"
    "CREATE TABLE outputs (key TEXT PRIMARY KEY, bytes INTEGER NOT NULL, manifest TEXT, created INTEGER NOT NULL)"
    " WITHOUT ROWID;",
    "ALTER TABLE jobs ADD COLUMN parameters TEXT NOT NULL DEFAULT '';",
    "ALTER TABLE jobs ADD COLUMN finish INTEGER NOT NULL DEFAULT 0;"
    "ALTER TABLE jobs ADD COLUMN cut INTEGER NOT NULL DEFAULT 0;"};
enum { SCHEMA_VERSION = sizeof migrations / sizeof *migrations };
/* The numbers stored in jobs.state, which the partial index above spells out, are the enumeration of the API. */
_Static_assert(BW_JOB_QUEUED == 0 && BW_JOB_RUNNING == 1 && BW_JOB_SUCCESSFUL == 2 && BW_JOB_FAILED == 3 &&
                   BW_JOB_DISMISSED == 4, "stored states changed: write a migration");

static bw_status complain(sqlite3 *db, const char *what) {
    char text[512];
    int code = sqlite3_extended_errcode(db);
    bw_event(BW_ERROR, "queue.error", "code=%d what=%s message=%s", code, what,
             bw_quoted(sqlite3_errmsg(db), text, sizeof text));
    if (code == SQLITE_IOERR_FSYNC || code == SQLITE_IOERR_DIR_FSYNC) abort(); /* see files.h */
    return BW_E_IO;
}

/* Prepares sql and binds the arguments: i int64_t, s const char * (NULL allowed; must outlive the statement). */
static sqlite3_stmt *prepare(sqlite3 *db, const char *sql, const char *types, va_list args) {
    sqlite3_stmt *stmt = NULL;
    if (sqlite3_prepare_v2(db, sql, -1, &stmt, NULL) != SQLITE_OK) {
        complain(db, "prepare");
        return NULL;
    }
    for (int i = 1; *types; types++, i++) {
        if (*types == 'i') sqlite3_bind_int64(stmt, i, va_arg(args, int64_t));
        else sqlite3_bind_text(stmt, i, va_arg(args, const char *), -1, SQLITE_STATIC);
    }
    return stmt;
}

static sqlite3_stmt *query(sqlite3 *db, const char *sql, const char *types, ...) {
    va_list args;
    va_start(args, types);
    sqlite3_stmt *stmt = prepare(db, sql, types, args);
    va_end(args);
    return stmt;
}

/* Runs a statement without rows; *changes (may be NULL) gets how many rows it changed. */
static bw_status run(bw_queue *q, int *changes, const char *sql, const char *types, ...) {
    va_list args;
    va_start(args, types);
    sqlite3_stmt *stmt = prepare(q->writer, sql, types, args);
    va_end(args);
    if (!stmt) return BW_E_IO;
    bw_status status = sqlite3_step(stmt) == SQLITE_DONE ? BW_OK : complain(q->writer, "step");
    sqlite3_finalize(stmt);
    if (changes) *changes = status == BW_OK ? sqlite3_changes(q->writer) : 0;
    return status;
}

static bw_status begin(bw_queue *q) {
    pthread_mutex_lock(&q->write_lock);
    return run(q, NULL, "BEGIN IMMEDIATE", "");
}

/* Ends what begin() began: commits if all went well. Returns the status now in force. */
static bw_status end(bw_queue *q, bw_status status) {
    if (status == BW_OK) {
        status = run(q, NULL, "COMMIT", "");
        atomic_store(&q->broken, status != BW_OK);
    }
    if (status != BW_OK && !sqlite3_get_autocommit(q->writer)) run(q, NULL, "ROLLBACK", "");
    pthread_mutex_unlock(&q->write_lock);
    return status;
}

/* ---- opening ---- */

static bw_status scalar(sqlite3 *db, const char *sql, int64_t *value) {
    sqlite3_stmt *stmt = query(db, sql, "");
    if (!stmt) return BW_E_IO;
    bw_status status = sqlite3_step(stmt) == SQLITE_ROW ? BW_OK : complain(db, "scalar");
    if (status == BW_OK) *value = sqlite3_column_int64(stmt, 0);
    sqlite3_finalize(stmt);
    return status;
}

static bw_status migrate(bw_queue *q) {
    int64_t version = 0;
    bw_status status = scalar(q->writer, "PRAGMA user_version", &version);
    if (status == BW_OK && version > SCHEMA_VERSION) {
        bw_event(BW_ERROR, "queue.newer", "version=%" PRId64 " known=%d", version, SCHEMA_VERSION);
        return BW_E_VERSION;
    }
    for (; status == BW_OK && version < SCHEMA_VERSION; version++) {
        char pragma[64];
        snprintf(pragma, sizeof pragma, "PRAGMA user_version = %" PRId64, version + 1);
        status = begin(q);
        if (status == BW_OK && sqlite3_exec(q->writer, migrations[version], NULL, NULL, NULL) != SQLITE_OK)
            status = complain(q->writer, "migrate");
        if (status == BW_OK) status = run(q, NULL, pragma, "");
        status = end(q, status);
    }
    return status;
}

static bw_status configure(sqlite3 *db, const char *pragmas) {
    sqlite3_busy_timeout(db, 10000);
    sqlite3_extended_result_codes(db, 1);
    return sqlite3_exec(db, pragmas, NULL, NULL, NULL) == SQLITE_OK ? BW_OK : complain(db, "configure");
}

bw_status bw_queue_open(const char *path, bw_queue **out) {
    bw_queue *q = calloc(1, sizeof *q);
    if (!q) return BW_E_MEMORY;
    pthread_mutex_init(&q->write_lock, NULL);
    pthread_mutex_init(&q->read_lock, NULL);
    bw_status status = BW_E_IO;
    if (sqlite3_open_v2(path, &q->writer, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, NULL) == SQLITE_OK)
        status = configure(q->writer, "PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA foreign_keys=ON");
    if (status == BW_OK) status = migrate(q);
    if (status == BW_OK) {
        status = sqlite3_open_v2(path, &q->reader, SQLITE_OPEN_READWRITE, NULL) == SQLITE_OK ? BW_OK : BW_E_IO;
        if (status == BW_OK) status = configure(q->reader, "PRAGMA query_only=ON; PRAGMA wal_autocheckpoint=0");
    }
    if (status != BW_OK) {
        bw_queue_close(q);
        return status;
    }
    *out = q;
    return BW_OK;
}

void bw_queue_close(bw_queue *q) {
    if (!q) return;
    sqlite3_close(q->reader);
    sqlite3_close(q->writer);
    pthread_mutex_destroy(&q->write_lock);
    pthread_mutex_destroy(&q->read_lock);
    free(q);
}

bool bw_queue_healthy(bw_queue *q) {
    int64_t n;
    pthread_mutex_lock(&q->read_lock);
    bw_status status = scalar(q->reader, "SELECT count(*) FROM (SELECT 1 FROM jobs LIMIT 1)", &n);
    pthread_mutex_unlock(&q->read_lock);
    return status == BW_OK && !atomic_load(&q->broken);
}

/* ---- rows ---- */

#define JOB_COLUMNS                                                                                                    \
    "seq, id, input, result_key, state, open, cancel, stage, stage_count, attempt, tries, created, started, finished," \
    " name, options, failure, parameters, finish, cut"

static char *copy_text(sqlite3_stmt *stmt, int column) {
    const unsigned char *text = sqlite3_column_text(stmt, column);
    return text ? strdup((const char *)text) : NULL;
}

static void put_text(char *out, size_t size, sqlite3_stmt *stmt, int column) {
    const unsigned char *text = sqlite3_column_text(stmt, column);
    snprintf(out, size, "%s", text ? (const char *)text : "");
}

static void read_job(sqlite3_stmt *stmt, bw_job *job) {
    memset(job, 0, sizeof *job);
    job->seq = sqlite3_column_int64(stmt, 0);
    put_text(job->id, sizeof job->id, stmt, 1);
    put_text(job->input, sizeof job->input, stmt, 2);
    put_text(job->result_key, sizeof job->result_key, stmt, 3);
    job->state = (bw_job_state)sqlite3_column_int(stmt, 4);
    job->open = sqlite3_column_int(stmt, 5) != 0;
    job->cancel = sqlite3_column_int(stmt, 6) != 0;
    job->stage = sqlite3_column_int(stmt, 7);
    job->stage_count = sqlite3_column_int(stmt, 8);
    job->attempt = sqlite3_column_int(stmt, 9);
    job->tries = sqlite3_column_int(stmt, 10);
    job->created = sqlite3_column_int64(stmt, 11);
    job->started = sqlite3_column_int64(stmt, 12);
    job->finished = sqlite3_column_int64(stmt, 13);
    job->name = copy_text(stmt, 14);
    job->options = copy_text(stmt, 15);
    job->failure = copy_text(stmt, 16);
    put_text(job->parameters, sizeof job->parameters, stmt, 17);
    job->finish = sqlite3_column_int(stmt, 18) != 0;
    job->cut = sqlite3_column_int(stmt, 19);
}

void bw_job_clear(bw_job *job) {
    free(job->name);
    free(job->options);
    free(job->failure);
    job->name = job->options = job->failure = NULL;
}

void bw_jobs_free(bw_job *jobs, size_t count) {
    for (size_t i = 0; i < count; i++) bw_job_clear(&jobs[i]);
    free(jobs);
}

void bw_job_id_make(char id[BW_JOB_ID_TEXT]) {
    unsigned char raw[12];
    if (getrandom(raw, sizeof raw, 0) != (ssize_t)sizeof raw) abort();
    for (size_t i = 0; i < sizeof raw; i++) snprintf(id + 2 * i, 3, "%02x", raw[i]);
}

/* Reads all rows of a job query into an array of at most `limit`. */
static bw_status read_jobs(sqlite3 *db, sqlite3_stmt *stmt, int limit, bw_job **jobs, size_t *count) {
    bw_job *list = calloc((size_t)limit, sizeof *list);
    size_t n = 0;
    int step = SQLITE_DONE;
    *jobs = NULL;
    *count = 0;
    if (!list) return BW_E_MEMORY;
    while (n < (size_t)limit && (step = sqlite3_step(stmt)) == SQLITE_ROW) read_job(stmt, &list[n++]);
    if (step != SQLITE_DONE && step != SQLITE_ROW) {
        bw_jobs_free(list, n);
        return complain(db, "read");
    }
    *jobs = list;
    *count = n;
    return BW_OK;
}

bw_status bw_queue_get(bw_queue *q, const char *id, bw_job *job, bool *found) {
    pthread_mutex_lock(&q->read_lock);
    sqlite3_stmt *stmt = query(q->reader, "SELECT " JOB_COLUMNS " FROM jobs WHERE id = ?", "s", id);
    bw_status status = stmt ? BW_OK : BW_E_IO;
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    memset(job, 0, sizeof *job);
    *found = step == SQLITE_ROW;
    if (*found) read_job(stmt, job);
    else if (stmt && step != SQLITE_DONE) status = complain(q->reader, "get");
    sqlite3_finalize(stmt);
    pthread_mutex_unlock(&q->read_lock);
    return status;
}

bw_status bw_queue_list(bw_queue *q, int state, int64_t before, int limit, bw_job **jobs, size_t *count) {
    if (before <= 0) before = INT64_MAX;
    pthread_mutex_lock(&q->read_lock);
    sqlite3_stmt *stmt =
        state < 0 ? query(q->reader, "SELECT " JOB_COLUMNS " FROM jobs WHERE seq < ? ORDER BY seq DESC LIMIT ?", "ii",
                          before, (int64_t)limit)
                  : query(q->reader, "SELECT " JOB_COLUMNS " FROM jobs WHERE seq < ? AND state = ? ORDER BY seq DESC"
                          " LIMIT ?", "iii", before, (int64_t)state, (int64_t)limit);
    bw_status status = stmt ? read_jobs(q->reader, stmt, limit, jobs, count) : BW_E_IO;
    sqlite3_finalize(stmt);
    pthread_mutex_unlock(&q->read_lock);
    return status;
}

bw_status bw_queue_attempts(bw_queue *q, const char *id, bw_attempt **attempts, size_t *count) {
    bw_attempt *list = NULL;
    size_t n = 0, room = 0;
    bw_status status = BW_OK;
    int step = SQLITE_ERROR;
    pthread_mutex_lock(&q->read_lock);
    sqlite3_stmt *stmt = query(q->reader, "SELECT attempt, stage, outcome, reused, started, finished FROM attempts"
                               " WHERE job = ? ORDER BY attempt", "s", id);
    while (stmt && status == BW_OK && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        if (n == room) {
            room = room ? 2 * room : 8;
            bw_attempt *more = realloc(list, room * sizeof *list);
            if (!more) {
                status = BW_E_MEMORY;
                break;
            }
            list = more;
        }
        bw_attempt *a = &list[n++];
        memset(a, 0, sizeof *a);
        a->attempt = sqlite3_column_int(stmt, 0);
        put_text(a->stage, sizeof a->stage, stmt, 1);
        put_text(a->outcome, sizeof a->outcome, stmt, 2);
        a->reused = sqlite3_column_int(stmt, 3) != 0;
        a->started = sqlite3_column_int64(stmt, 4);
        a->finished = sqlite3_column_int64(stmt, 5);
    }
    if (status == BW_OK && step != SQLITE_DONE) status = BW_E_IO;
    sqlite3_finalize(stmt);
    pthread_mutex_unlock(&q->read_lock);
    if (status != BW_OK) {
        free(list);
        list = NULL;
        n = 0;
    }
    *attempts = list;
    *count = n;
    return status;
}

bw_status bw_queue_waiting(bw_queue *q, int64_t now, int64_t after_seq, int limit, bw_job **jobs, size_t *count,
                           int64_t *next_due) {
    pthread_mutex_lock(&q->read_lock);
    sqlite3_stmt *stmt = query(q->reader, "SELECT " JOB_COLUMNS " FROM jobs WHERE open = 0 AND state IN (0, 1)"
                               " AND seq > ? AND due <= ? ORDER BY seq LIMIT ?", "iii", after_seq, now, (int64_t)limit);
    bw_status status = stmt ? read_jobs(q->reader, stmt, limit, jobs, count) : BW_E_IO;
    sqlite3_finalize(stmt);
    if (status == BW_OK) {
        stmt = query(q->reader, "SELECT min(due) FROM jobs WHERE open = 0 AND state IN (0, 1) AND due > ?", "i", now);
        if (stmt && sqlite3_step(stmt) == SQLITE_ROW) *next_due = sqlite3_column_int64(stmt, 0);
        else status = BW_E_IO;
        sqlite3_finalize(stmt);
        if (status != BW_OK) bw_jobs_free(*jobs, *count);
    }
    pthread_mutex_unlock(&q->read_lock);
    return status;
}

/* ---- transitions ---- */

bw_status bw_queue_insert(bw_queue *q, bw_job *job) {
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, NULL, "INSERT INTO jobs (id, name, input, parameters, options, state, stage_count, created)"
                     " VALUES (?, ?, ?, ?, ?, 0, ?, ?)", "sssssii", job->id, job->name, job->input, job->parameters,
                     job->options, (int64_t)job->stage_count, job->created);
    if (status == BW_OK) job->seq = sqlite3_last_insert_rowid(q->writer);
    return end(q, status);
}

static const char *stage_name(int stage) { return bw_api_stages[stage].name; }

static bw_status add_attempt(bw_queue *q, const char *id, int attempt, int stage, bool reused, int64_t now) {
    return run(q, NULL, "INSERT INTO attempts (job, attempt, stage, reused, started, finished, outcome)"
               " VALUES (?, ?, ?, ?, ?, ?, ?)", "sisiiis", id, (int64_t)attempt, stage_name(stage), (int64_t)reused, now,
               reused ? now : (int64_t)0, reused ? "ok" : "");
}

bw_status bw_queue_claim(bw_queue *q, bw_job *job, int64_t now, bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET state = 1, open = 1, attempt = attempt + 1, tries = tries + 1,"
                     " started = CASE started WHEN 0 THEN ? ELSE started END"
                     " WHERE id = ? AND attempt = ? AND open = 0 AND state IN (0, 1)", "isi", now, job->id,
                     (int64_t)job->attempt);
    if (status == BW_OK && changes) status = add_attempt(q, job->id, job->attempt + 1, job->stage, false, now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    if (*done) {
        job->state = BW_JOB_RUNNING;
        job->open = true;
        job->attempt++;
        job->tries++;
    }
    return status;
}

bw_status bw_queue_reuse(bw_queue *q, bw_job *job, const char *result_key, int64_t now, bool *done) {
    int changes = 0;
    bool last = job->stage + 1 >= job->stage_count;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET state = ?, attempt = attempt + 1, tries = 0, interruptions = 0, due = 0,"
                     " stage = stage + 1, finished = ?, result_key = ?,"
                     " started = CASE started WHEN 0 THEN ? ELSE started END"
                     " WHERE id = ? AND attempt = ? AND open = 0 AND state IN (0, 1)", "iisisi",
                     (int64_t)(last ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING), last ? now : (int64_t)0, result_key, now,
                     job->id, (int64_t)job->attempt);
    if (status == BW_OK && changes) status = add_attempt(q, job->id, job->attempt + 1, job->stage, true, now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    if (*done) {
        job->state = last ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING;
        job->attempt++;
        job->stage++;
        job->tries = 0;
    }
    return status;
}

static bw_status close_attempt(bw_queue *q, const char *id, int attempt, const char *outcome, int64_t now) {
    return run(q, NULL, "UPDATE attempts SET finished = ?, outcome = ? WHERE job = ? AND attempt = ? AND finished = 0",
               "issi", now, outcome, id, (int64_t)attempt);
}

#define FENCE " WHERE id = ? AND attempt = ? AND open = 1 AND state = 1"

bw_status bw_queue_advance(bw_queue *q, const char *id, int attempt, const char *key, uint64_t bytes,
                           const char *manifest, bool cut, int64_t now, bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET open = 0, tries = 0, interruptions = 0, due = 0, stage = stage + 1,"
                     " state = CASE WHEN stage + 1 >= stage_count THEN 2 ELSE 1 END,"
                     " finished = CASE WHEN stage + 1 >= stage_count THEN ? ELSE 0 END, result_key = ?,"
                     " cut = CASE WHEN cut = 0 AND ? THEN stage + 1 ELSE cut END" FENCE, "isisi",
                     now, manifest ? key : "", (int64_t)cut, id, (int64_t)attempt);
    if (status == BW_OK && changes) status = close_attempt(q, id, attempt, "ok", now);
    if (status == BW_OK && changes)
        status = run(q, NULL, "INSERT OR REPLACE INTO outputs (key, bytes, manifest, created) VALUES (?, ?, ?, ?)",
                     "sisi", key, (int64_t)bytes, manifest, now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    return status;
}

bw_status bw_queue_retry(bw_queue *q, const char *id, int attempt, const char *outcome, int64_t due, int64_t now,
                         bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET open = 0, state = 0, due = ?" FENCE, "isi", due, id,
                     (int64_t)attempt);
    if (status == BW_OK && changes) status = close_attempt(q, id, attempt, outcome, now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    return status;
}

bw_status bw_queue_fail(bw_queue *q, const char *id, int attempt, const char *outcome, const char *failure, int64_t now,
                        bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET open = 0, state = 3, finished = ?, failure = ?" FENCE, "issi", now,
                     failure, id, (int64_t)attempt);
    if (status == BW_OK && changes) status = close_attempt(q, id, attempt, outcome, now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    return status;
}

bw_status bw_queue_dismiss(bw_queue *q, const char *id, int attempt, int64_t now, bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET open = 0, state = 4, finished = ?" FENCE, "isi", now, id,
                     (int64_t)attempt);
    if (status == BW_OK && changes) status = close_attempt(q, id, attempt, "cancelled", now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    return status;
}

bw_status bw_queue_interrupt(bw_queue *q, const char *id, int attempt, int64_t now, bool *done) {
    int changes = 0;
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, &changes, "UPDATE jobs SET open = 0, state = 0, tries = tries - 1" FENCE, "si", id,
                     (int64_t)attempt);
    if (status == BW_OK && changes) status = close_attempt(q, id, attempt, "interrupted", now);
    status = end(q, status);
    *done = status == BW_OK && changes == 1;
    return status;
}

bw_status bw_queue_cancel(bw_queue *q, const char *id, int64_t now, bw_cancel *result) {
    int state = -1, open = 0;
    bw_status status = begin(q);
    sqlite3_stmt *stmt = status == BW_OK ? query(q->writer, "SELECT state, open FROM jobs WHERE id = ?", "s", id) : NULL;
    if (stmt && sqlite3_step(stmt) == SQLITE_ROW) {
        state = sqlite3_column_int(stmt, 0);
        open = sqlite3_column_int(stmt, 1);
    }
    if (!stmt) status = BW_E_IO;
    sqlite3_finalize(stmt);
    *result = state < 0 ? BW_CANCEL_UNKNOWN
              : state == BW_JOB_SUCCESSFUL || state == BW_JOB_FAILED ? BW_CANCEL_TOO_LATE
              : open ? BW_CANCEL_NOTED : BW_CANCEL_DISMISSED;
    if (status == BW_OK && *result == BW_CANCEL_NOTED)
        status = run(q, NULL, "UPDATE jobs SET cancel = 1 WHERE id = ?", "s", id);
    if (status == BW_OK && *result == BW_CANCEL_DISMISSED && state != BW_JOB_DISMISSED)
        status = run(q, NULL, "UPDATE jobs SET cancel = 1, state = 4, finished = ? WHERE id = ?", "is", now, id);
    return end(q, status);
}

bw_status bw_queue_finish(bw_queue *q, const char *id, bw_finish *result) {
    int state = -1;
    bw_status status = begin(q);
    sqlite3_stmt *stmt = status == BW_OK ? query(q->writer, "SELECT state FROM jobs WHERE id = ?", "s", id) : NULL;
    if (stmt && sqlite3_step(stmt) == SQLITE_ROW) state = sqlite3_column_int(stmt, 0);
    if (!stmt) status = BW_E_IO;
    sqlite3_finalize(stmt);
    *result = state < 0 ? BW_FINISH_UNKNOWN : state == BW_JOB_QUEUED || state == BW_JOB_RUNNING ? BW_FINISH_NOTED : BW_FINISH_TOO_LATE;
    if (status == BW_OK && *result == BW_FINISH_NOTED)
        status = run(q, NULL, "UPDATE jobs SET finish = 1 WHERE id = ?", "s", id);
    return end(q, status);
}

bw_status bw_queue_recover(bw_queue *q, int64_t now, int *recovered) {
    static const char failure[] =
        "{\"type\":\"/problems/internal\",\"title\":\"internal error\",\"status\":500,\"class\":\"system\","
        "\"detail\":\"the daemon went away too often while this stage ran\"}";
    bw_status status = begin(q);
    if (status == BW_OK)
        status = run(q, recovered, "UPDATE attempts SET finished = ?, outcome = 'interrupted' WHERE finished = 0", "i",
                     now);
    if (status == BW_OK)
        status = run(q, NULL, "UPDATE jobs SET open = 0, state = 4, finished = ? WHERE open = 1 AND cancel = 1", "i", now);
    if (status == BW_OK)
        status = run(q, NULL, "UPDATE jobs SET open = 0, state = 3, finished = ?, failure = ?"
                     " WHERE open = 1 AND interruptions >= ?", "isi", now, failure, (int64_t)BW_INTERRUPTIONS_MOST);
    if (status == BW_OK)
        status = run(q, NULL, "UPDATE jobs SET open = 0, state = 0, due = 0, interruptions = interruptions + 1,"
                     " tries = tries - 1 WHERE open = 1", "");
    return end(q, status);
}

/* ---- cache rows ---- */

bw_status bw_queue_output(bw_queue *q, const char *key, bool *found, char **manifest) {
    pthread_mutex_lock(&q->read_lock);
    sqlite3_stmt *stmt = query(q->reader, "SELECT manifest FROM outputs WHERE key = ?", "s", key);
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    *found = step == SQLITE_ROW;
    if (manifest) *manifest = *found ? copy_text(stmt, 0) : NULL;
    sqlite3_finalize(stmt);
    pthread_mutex_unlock(&q->read_lock);
    return step == SQLITE_ROW || step == SQLITE_DONE ? BW_OK : BW_E_IO;
}

bw_status bw_queue_forget_output(bw_queue *q, const char *key) {
    bw_status status = begin(q);
    if (status == BW_OK) status = run(q, NULL, "DELETE FROM outputs WHERE key = ?", "s", key);
    return end(q, status);
}

static void sql_present(sqlite3_context *context, int argc, sqlite3_value **argv) {
    struct {
        bool (*present)(void *, const char *);
        void *user;
    } *call = sqlite3_user_data(context);
    (void)argc;
    const unsigned char *key = sqlite3_value_text(argv[0]);
    sqlite3_result_int(context, key && call->present(call->user, (const char *)key));
}

bw_status bw_queue_sweep_outputs(bw_queue *q, bool (*present)(void *, const char *), void *user, int *forgotten) {
    struct {
        bool (*present)(void *, const char *);
        void *user;
    } call = {present, user};
    bw_status status = begin(q);
    if (status == BW_OK && sqlite3_create_function(q->writer, "present", 1, SQLITE_UTF8, &call, sql_present, NULL,
                                                   NULL) != SQLITE_OK)
        status = complain(q->writer, "function");
    if (status == BW_OK) status = run(q, forgotten, "DELETE FROM outputs WHERE NOT present(key)", "");
    sqlite3_create_function(q->writer, "present", 1, SQLITE_UTF8, NULL, NULL, NULL, NULL);
    return end(q, status);
}
