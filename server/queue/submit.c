/* Accepting jobs, one or many at once. */
#include <stdlib.h>
#include <string.h>

#include "server/queue/writer.h"

/* The bytes that one blob adds to the owner's, unless an earlier job of the same request names it too. */
static bw_status blob_bytes(bw_writer *w, const bw_submit *s, size_t at, const char *sha256, int64_t bytes, int64_t *sum) {
    int64_t added;
    for (size_t i = 0; i < at; i++)
        if (!strcmp(s->jobs[i].input, sha256) || !strcmp(s->jobs[i].parameters, sha256)) return BW_OK;
    bw_status status = bw_owner_blob_bytes(w, s->jobs->owner, sha256, bytes, &added);
    *sum += added;
    return status;
}

static bw_status check_limits(bw_writer *w, bw_submit *s) {
    bw_owner has;
    int64_t sum = 0;
    s->in_force = s->limits;
    bw_status status = bw_owner_read(&w->sql, s->jobs->owner, &has);
    if (status == BW_OK) status = bw_owner_limits(&w->sql, s->jobs->owner, &s->in_force);
    for (size_t i = 0; status == BW_OK && s->in_force.bytes && i < s->count; i++) {
        const bw_job *job = &s->jobs[i];
        status = blob_bytes(w, s, i, job->input, job->input_bytes, &sum);
        if (status == BW_OK && *job->parameters && strcmp(job->parameters, job->input) != 0)
            status = blob_bytes(w, s, i, job->parameters, job->parameters_bytes, &sum);
    }
    if (status != BW_OK) return status;
    if (s->in_force.queued && has.waiting + has.running + (int64_t)s->count > s->in_force.queued) s->result = BW_SUBMIT_TOO_MANY;
    else if (s->in_force.bytes && sum && has.bytes + sum > s->in_force.bytes) s->result = BW_SUBMIT_TOO_LARGE;
    return BW_OK;
}

static bw_status insert(bw_writer *w, bw_job *job) {
    bw_sql *sql = &w->sql;
    bw_status status = bw_sql_run(sql, NULL, "INSERT INTO jobs (id, name, input, parameters, options, state, stage_count, created,"
                                  " owner, priority, limits, pinned) VALUES (?, ?, ?, ?, ?, 0, ?, ?, ?, ?, ?, ?)", "sssssiisisi", job->id, job->name,
                                  job->input, job->parameters, job->options, (int64_t)job->stage_count, job->created, job->owner,
                                  (int64_t)job->priority, job->limits, (int64_t)job->pinned);
    if (status == BW_OK) job->seq = sqlite3_last_insert_rowid(sql->db);
    if (status == BW_OK && job->tags)
        status = bw_sql_run(sql, NULL, "INSERT OR IGNORE INTO tags (tag, seq) SELECT value, ?2 FROM json_each(?1)", "si", job->tags,
                            job->seq);
    if (status == BW_OK) status = bw_owner_use_blob(w, job->owner, job->input, job->input_bytes, job->created);
    if (status == BW_OK && *job->parameters)
        status = bw_owner_use_blob(w, job->owner, job->parameters, job->parameters_bytes, job->created);
    return status == BW_OK ? bw_event_add(w, job->id, "queued", NULL, job->created, NULL) : status;
}

/* Nothing collects a blob between this and the end of the write, and from then on the job holds it. */
static void check_blobs(bw_submit *s) {
    for (size_t i = 0; s->present && s->result == BW_SUBMIT_ACCEPTED && i < s->count; i++) {
        const bw_job *job = &s->jobs[i];
        if (s->present(s->user, job->input) && (!*job->parameters || s->present(s->user, job->parameters))) continue;
        s->result = BW_SUBMIT_NO_BLOB;
        s->lacking = i;
    }
}

bw_status bw_write_submit(bw_writer *w, void *user) {
    bw_submit *s = user;
    bool known = false, same = false;
    bw_status status = BW_OK;
    s->result = BW_SUBMIT_ACCEPTED;
    free(s->stored);
    s->stored = NULL;
    if (s->key) status = bw_idempotency_find(w, s->jobs->owner, s->key, s->digest, &known, &same, &s->stored);
    if (known) s->result = same ? BW_SUBMIT_KNOWN : BW_SUBMIT_CONFLICT;
    if (status == BW_OK && s->result == BW_SUBMIT_ACCEPTED) status = check_limits(w, s);
    check_blobs(s);
    if (s->result != BW_SUBMIT_ACCEPTED) return status;
    for (size_t i = 0; status == BW_OK && i < s->count; i++) status = insert(w, &s->jobs[i]);
    if (status == BW_OK && s->key)
        status = bw_idempotency_keep(w, s->jobs->owner, s->key, s->digest, s->answer, s->jobs->created);
    return status;
}

bw_status bw_queue_insert(bw_queue *q, bw_job *job) {
    bw_submit submit = {.jobs = job, .count = 1};
    return bw_queue_write(q, bw_write_submit, &submit);
}
