/* Reading jobs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "server/queue/writer.h"

void bw_job_read(sqlite3_stmt *stmt, bw_job *job) {
    memset(job, 0, sizeof *job);
    job->seq = sqlite3_column_int64(stmt, 0);
    bw_sql_put(job->id, sizeof job->id, stmt, 1);
    bw_sql_put(job->input, sizeof job->input, stmt, 2);
    bw_sql_put(job->result_key, sizeof job->result_key, stmt, 3);
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
    job->name = bw_sql_text(stmt, 14);
    job->options = bw_sql_text(stmt, 15);
    job->failure = bw_sql_text(stmt, 16);
    bw_sql_put(job->parameters, sizeof job->parameters, stmt, 17);
    job->finish = sqlite3_column_int(stmt, 18) != 0;
    job->cut = sqlite3_column_int(stmt, 19);
    bw_sql_put(job->owner, sizeof job->owner, stmt, 20);
    job->priority = sqlite3_column_int(stmt, 21);
    job->pinned = sqlite3_column_int(stmt, 22) != 0;
    job->tags = bw_sql_text(stmt, 23);
    job->limits = bw_sql_text(stmt, 24);
    job->spent = (bw_spent){sqlite3_column_int64(stmt, 25), sqlite3_column_int64(stmt, 26)};
    bw_sql_put(job->kind, sizeof job->kind, stmt, 27);
}

void bw_job_clear(bw_job *job) {
    free(job->name);
    free(job->options);
    free(job->failure);
    free(job->tags);
    free(job->limits);
    job->name = job->options = job->failure = job->tags = job->limits = NULL;
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

bw_status bw_queue_get(bw_queue *q, const char *id, bw_job *job, bool *found) {
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT" BW_JOB_COLUMNS "FROM jobs WHERE id = ?", "s", id) : NULL;
    bw_status status = stmt ? BW_OK : BW_E_IO;
    int step = stmt ? sqlite3_step(stmt) : SQLITE_ERROR;
    memset(job, 0, sizeof *job);
    *found = step == SQLITE_ROW;
    if (*found) bw_job_read(stmt, job);
    else if (stmt && step != SQLITE_DONE) status = bw_sql_error(reader, "get");
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    return status;
}

/* ---- lists ---- */

/* Only what an index gives in order is asked of SQL; the rest is looked at row by row, BW_SCAN_MOST of them per page. */
static sqlite3_stmt *select_jobs(bw_sql *sql, const bw_filter *filter, int64_t before) {
    int64_t state = filter->state;
    if (filter->tag)
        return bw_sql_query(sql, "SELECT" BW_JOB_COLUMNS "FROM tags CROSS JOIN jobs ON jobs.seq = tags.seq"
                            " WHERE tag = ? AND tags.seq < ? ORDER BY tags.seq DESC", "si", filter->tag, before);
    if (filter->owner && state >= 0)
        return bw_sql_query(sql, "SELECT" BW_JOB_COLUMNS "FROM jobs INDEXED BY jobs_by_owner_state"
                            " WHERE owner = ? AND state = ? AND seq < ? ORDER BY seq DESC", "sii", filter->owner, state, before);
    if (filter->owner)
        return bw_sql_query(sql, "SELECT" BW_JOB_COLUMNS "FROM jobs INDEXED BY jobs_by_owner"
                            " WHERE owner = ? AND seq < ? ORDER BY seq DESC", "si", filter->owner, before);
    if (state >= 0)
        return bw_sql_query(sql, "SELECT" BW_JOB_COLUMNS "FROM jobs INDEXED BY jobs_by_state"
                            " WHERE state = ? AND seq < ? ORDER BY seq DESC", "ii", state, before);
    return bw_sql_query(sql, "SELECT" BW_JOB_COLUMNS "FROM jobs WHERE seq < ? ORDER BY seq DESC", "i", before);
}

static bool matches(const bw_filter *filter, const bw_job *job) {
    return (filter->state < 0 || (int)job->state == filter->state) && (!filter->owner || strcmp(filter->owner, job->owner) == 0);
}

bw_status bw_queue_list(bw_queue *q, const bw_filter *filter, int64_t before, int limit, bw_job **jobs, size_t *count,
                        int64_t *next) {
    bw_job *list = calloc((size_t)limit, sizeof *list);
    size_t n = 0;
    int step = SQLITE_DONE;
    *jobs = NULL;
    *count = 0;
    *next = 0;
    if (!list) return BW_E_MEMORY;
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? select_jobs(reader, filter, before > 0 ? before : INT64_MAX) : NULL;
    int64_t last = 0;
    for (int seen = 0; stmt && (step = sqlite3_step(stmt)) == SQLITE_ROW; seen++) {
        if (n == (size_t)limit || seen == BW_SCAN_MOST) {
            *next = last;
            break;
        }
        bw_job_read(stmt, &list[n]);
        last = list[n].seq;
        if (matches(filter, &list[n])) n++;
        else bw_job_clear(&list[n]);
    }
    bw_status status = stmt && (step == SQLITE_DONE || step == SQLITE_ROW) ? BW_OK : BW_E_IO;
    if (stmt && status != BW_OK) bw_sql_error(reader, "list");
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    if (status == BW_OK) *jobs = list, *count = n;
    else bw_jobs_free(list, n);
    return status;
}

static bool grow(bw_attempt **list, size_t n, size_t *room) {
    if (n < *room) return true;
    size_t wanted = *room ? 2 * *room : 8;
    bw_attempt *more = realloc(*list, wanted * sizeof **list);
    if (!more) return false;
    *list = more;
    *room = wanted;
    return true;
}

bw_status bw_queue_attempts(bw_queue *q, const char *id, bw_attempt **attempts, size_t *count) {
    bw_attempt *list = NULL;
    size_t n = 0, room = 0;
    bw_status status = BW_OK;
    int step = SQLITE_ERROR;
    bw_sql *reader = bw_reader_borrow(q);
    sqlite3_stmt *stmt = reader ? bw_sql_query(reader, "SELECT attempt, stage, outcome, reused, started, finished FROM attempts"
                                               " WHERE job = ? ORDER BY attempt", "s", id) : NULL;
    while (stmt && status == BW_OK && (step = sqlite3_step(stmt)) == SQLITE_ROW) {
        if (!grow(&list, n, &room)) {
            status = BW_E_MEMORY;
            break;
        }
        bw_attempt *a = &list[n++];
        memset(a, 0, sizeof *a);
        a->attempt = sqlite3_column_int(stmt, 0);
        bw_sql_put(a->stage, sizeof a->stage, stmt, 1);
        bw_sql_put(a->outcome, sizeof a->outcome, stmt, 2);
        a->reused = sqlite3_column_int(stmt, 3) != 0;
        a->started = sqlite3_column_int64(stmt, 4);
        a->finished = sqlite3_column_int64(stmt, 5);
    }
    if (status == BW_OK && step != SQLITE_DONE) status = BW_E_IO;
    bw_sql_done(stmt);
    bw_reader_return(q, reader);
    if (status != BW_OK) {
        free(list);
        list = NULL;
        n = 0;
    }
    *attempts = list;
    *count = n;
    return status;
}

bw_status bw_queue_is_gone(bw_queue *q, const char *id, bool *gone) {
    int64_t at = 0;
    bw_sql *reader = bw_reader_borrow(q);
    bw_status status = reader ? bw_sql_number(reader, &at, 0, "SELECT 1 FROM gone WHERE id = ?", "s", id) : BW_E_IO;
    bw_reader_return(q, reader);
    *gone = at != 0;
    return status;
}
