/* Creating jobs: one (job_create), of an uploaded input or with it as the body, or many at once (batch_create). */
#include "server/http/operations.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "server/clock.h"
#include "server/http/access.h"
#include "server/http/job_read.h"
#include "server/http/receive.h"
#include "server/http/reply.h"
#include "server/log.h"

enum { BATCH_BODY_MOST = 1 << 20, BATCH_JOBS_MOST = 1000, KEY_BYTES_MOST = 200, FULL_SECONDS = 10, LARGE_SECONDS = 600 };

/* What a request keeps while its jobs are written. */
typedef struct {
    bw_submit submit;
    char key[KEY_BYTES_MOST + 1], digest[BW_SHA256_TEXT];
    char *answer;
} submission;

static void submission_free(void *state) {
    submission *s = state;
    bw_jobs_free(s->submit.jobs, s->submit.count);
    free(s->submit.stored);
    free(s->answer);
    free(s);
}

/* ---- before the body ---- */

static bool has_type(const char *type, const char *wanted) {
    size_t n = type ? strcspn(type, "; ") : 0;
    return n == strlen(wanted) && strncasecmp(type, wanted, n) == 0;
}

static void begin_json(bw_request *r, size_t most) {
    r->body_most = most;
    if (r->has_length && r->length > most) bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %zu bytes", most);
}

static enum MHD_Result refuse_parameter(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    (void)kind, (void)value;
    bw_reply_problem(user, BW_PROBLEM_INVALID_PARAMETER, "%s belongs into the body, if that is JSON", key);
    return MHD_NO;
}

/* Whatever is wrong with the description is told before the input is sent, and that it is one job too many, unless it may be one that there is. */
static void begin_input(bw_request *r) {
    bw_job job = {0};
    if (!bw_http_blob_sized(r)) return;
    if (r->length == 0) {
        bw_reply_problem(r, BW_PROBLEM_EMPTY_INPUT, "the body is to be a job's input, or with Content-Type: application/json its description");
        return;
    }
    json_t *asked = bw_http_query_job(r);
    if (asked && bw_http_read_description(r, asked, "", &job) && (bw_request_header(r, "Idempotency-Key") || bw_http_job_fits(r)))
        bw_http_receive_blob(r, false);
    bw_job_clear(&job);
    json_decref(asked);
}

void bw_http_job_create_begin(bw_request *r) {
    const char *type = bw_request_header(r, "Content-Type");
    if (has_type(type, "application/json")) {
        MHD_get_connection_values(r->connection, MHD_GET_ARGUMENT_KIND, refuse_parameter, r);
        if (!r->reply) begin_json(r, BW_BODY_MOST);
    } else if (!type || has_type(type, "application/octet-stream")) {
        begin_input(r);
    } else {
        bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_MEDIA_TYPE,
                         "a job is described as application/json, or its input is sent as application/octet-stream with the description in the query");
    }
}

void bw_http_batch_create_begin(bw_request *r) {
    if (has_type(bw_request_header(r, "Content-Type"), "application/json")) begin_json(r, BATCH_BODY_MOST);
    else bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_MEDIA_TYPE, "jobs are described as application/json");
}

/* ---- reading ---- */

/* The body as an object, or NULL after a reply. */
static json_t *read_body(bw_request *r) {
    json_error_t error;
    json_t *body = json_loadb(r->body ? r->body : "", r->body_size, JSON_REJECT_DUPLICATES, &error);
    if (!body) {
        bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "line %d column %d: %s", error.line, error.column, error.text);
    } else if (!json_is_object(body)) {
        bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "the body must be an object");
        json_decref(body);
        body = NULL;
    }
    return body;
}

/* The request's key, if it has one, and the digest of what it asks for, of which `asked` tells all but the operation. False after a reply. */
static bool read_key(bw_request *r, submission *s, const char *asked, size_t size) {
    const char *key = bw_request_header(r, "Idempotency-Key");
    if (!key) return true;
    size_t n = strlen(key);
    bool good = n > 0 && n <= KEY_BYTES_MOST;
    for (size_t i = 0; i < n; i++) good = good && key[i] > 0x20 && key[i] < 0x7f;
    if (!good) {
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Idempotency-Key has 1 to %d visible ASCII characters", KEY_BYTES_MOST);
        return false;
    }
    memcpy(s->key, key, n + 1);
    const char *operation = bw_endpoints[r->op].id;
    bw_digest *digest = bw_digest_new();
    good = digest && bw_digest_add(digest, operation, strlen(operation) + 1) && bw_digest_add(digest, asked, size) &&
           bw_digest_end(digest, s->digest);
    bw_digest_free(digest);
    if (!good) bw_reply_json(r, 500, NULL);
    return good;
}

/* A submission with room for `count` jobs, as the request's state. NULL after a reply. */
static submission *submission_new(bw_request *r, size_t count) {
    submission *s = calloc(1, sizeof *s);
    if (s) s->submit.jobs = calloc(count, sizeof *s->submit.jobs);
    if (s && !s->submit.jobs) free(s), s = NULL;
    if (!s) {
        bw_reply_json(r, 500, NULL);
        return NULL;
    }
    r->state = s;
    r->state_free = submission_free;
    return s;
}

/* Adds a job; false after a reply. */
static bool add_job(bw_request *r, submission *s, json_t *body, const char *place) {
    bw_job *job = &s->submit.jobs[s->submit.count++];
    bw_job_id_make(job->id);
    job->created = bw_now_ms();
    memcpy(job->owner, r->caller.owner, sizeof job->owner);
    return bw_http_read_job(r, body, place, job);
}

/* ---- writing ---- */

static bw_status write_submission(bw_writer *w, void *user) { return bw_write_submit(w, &((submission *)user)->submit); }

/* The ids, as they are kept with the key: ["...", ...] */
static char *ids_text(const bw_submit *submit) {
    json_t *ids = json_array();
    for (size_t i = 0; i < submit->count; i++) json_array_append_new(ids, json_string(submit->jobs[i].id));
    char *text = json_dumps(ids, JSON_COMPACT);
    json_decref(ids);
    return text;
}

static void submit_jobs(bw_request *r, const char *asked, size_t size, void (*then)(bw_request *)) {
    submission *s = r->state;
    const bw_config *config = r->services->config;
    if (!read_key(r, s, asked, size)) return;
    s->submit.limits = (bw_limits){.queued = config->owner_jobs, .bytes = (int64_t)config->owner_bytes};
    if (*s->key && !(s->answer = ids_text(&s->submit))) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    s->submit.present = bw_http_has_blob;
    s->submit.user = r->services->store;
    if (*s->key) s->submit.key = s->key, s->submit.digest = s->digest, s->submit.answer = s->answer;
    bw_request_write(r, write_submission, then);
}

void bw_http_reply_too_many(bw_request *r, int64_t most) {
    char seconds[12];
    bw_reply_problem(r, BW_PROBLEM_TOO_MANY_JOBS, "you may have %lld jobs that wait or run", (long long)most);
    snprintf(seconds, sizeof seconds, "%d", FULL_SECONDS);
    bw_reply_header(r, "Retry-After", seconds);
}

void bw_http_reply_too_large(bw_request *r, int64_t most) {
    char seconds[12];
    bw_reply_problem(r, BW_PROBLEM_TOO_MANY_BYTES, "your inputs may have %lld bytes in all", (long long)most);
    snprintf(seconds, sizeof seconds, "%d", LARGE_SECONDS);
    bw_reply_header(r, "Retry-After", seconds);
}

/* What has become of a submission: the ids of its jobs (a new array), or NULL after a reply. */
static json_t *accepted(bw_request *r) {
    const bw_submit *s = &((submission *)r->state)->submit;
    if (r->written != BW_OK) {
        bw_reply_storage(r);
        return NULL;
    }
    switch (s->result) {
    case BW_SUBMIT_ACCEPTED: break;
    case BW_SUBMIT_KNOWN: return json_loads(s->stored, 0, NULL);
    case BW_SUBMIT_CONFLICT:
        bw_reply_problem(r, BW_PROBLEM_KEY_REUSED, "this Idempotency-Key came with another request before");
        return NULL;
    case BW_SUBMIT_TOO_MANY: bw_http_reply_too_many(r, s->in_force.queued); return NULL;
    case BW_SUBMIT_TOO_LARGE: bw_http_reply_too_large(r, s->in_force.bytes); return NULL;
    case BW_SUBMIT_NO_BLOB:
        bw_reply_problem(r, BW_PROBLEM_UNKNOWN_INPUT, "upload the input first: PUT /v1/blobs/%s", s->jobs[s->lacking].input);
        return NULL;
    }
    json_t *ids = json_array();
    for (size_t i = 0; i < s->count; i++) {
        bw_event(BW_INFO, "job.accepted", "job=%s input=%s", s->jobs[i].id, s->jobs[i].input);
        json_array_append_new(ids, json_string(s->jobs[i].id));
    }
    bw_dispatch_wake(r->services->dispatch);
    return ids;
}

/* ---- one ---- */

static void job_created(bw_request *r) {
    char id[BW_JOB_ID_TEXT];
    json_t *ids = accepted(r);
    if (!ids) return;
    snprintf(id, sizeof id, "%s", json_string_value(json_array_get(ids, 0)));
    json_decref(ids);
    submission_free(r->state);
    r->state = NULL; /* bw_http_answer_job has its own */
    bw_http_answer_job(r, 201, id);
}

static void create(bw_request *r, json_t *described, const char *asked, size_t size) {
    submission *s = submission_new(r, 1);
    if (s && add_job(r, s, described, "")) submit_jobs(r, asked, size, job_created);
}

/* The input has come, is durable and the caller's. */
static void create_from_query(bw_request *r) {
    uint64_t bytes;
    json_t *sha256 = json_string(bw_http_kept_blob(r, &bytes)), *described = bw_http_query_job(r);
    char *asked = NULL;
    r->state_free(r->state);
    r->state = NULL;
    r->state_free = NULL;
    if (json_object_set_new(described, "input", sha256) == 0) asked = json_dumps(described, JSON_COMPACT | JSON_SORT_KEYS);
    if (asked) create(r, described, asked, strlen(asked));
    else if (!r->reply) bw_reply_json(r, 500, NULL);
    free(asked);
    json_decref(described);
}

void bw_http_job_create(bw_request *r) {
    if (r->upload) {
        bw_http_store_blob(r, NULL, create_from_query);
        return;
    }
    json_t *body = read_body(r);
    if (body) create(r, body, r->body, r->body_size);
    json_decref(body);
}

/* ---- many ---- */

static void batch_created(bw_request *r) {
    json_t *ids = accepted(r), *jobs = json_array(), *id;
    size_t i;
    json_array_foreach(ids, i, id)
        json_array_append_new(jobs, json_pack("{s:O, s:o}", "id", id, "href", json_sprintf("/v1/jobs/%s", json_string_value(id))));
    if (ids) bw_reply_json(r, 201, json_pack("{s:O}", "jobs", jobs));
    json_decref(jobs);
    json_decref(ids);
}

static bool read_batch(bw_request *r, json_t *body) {
    json_t *jobs = json_object_get(body, "jobs"), *job;
    size_t i, count = json_array_size(jobs);
    if (count < 1 || count > BATCH_JOBS_MOST || json_object_size(body) != 1) {
        bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "a batch has one member, 'jobs', a list of 1 to %d jobs", BATCH_JOBS_MOST);
        return false;
    }
    submission *s = submission_new(r, count);
    bool good = s != NULL;
    json_array_foreach(jobs, i, job) {
        char place[40];
        snprintf(place, sizeof place, "jobs[%zu]: ", i);
        good = good && add_job(r, s, job, place);
    }
    return good;
}

void bw_http_batch_create(bw_request *r) {
    json_t *body = read_body(r);
    if (body && read_batch(r, body)) submit_jobs(r, r->body, r->body_size, batch_created);
    json_decref(body);
}
