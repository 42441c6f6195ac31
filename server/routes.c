#include "server/routes.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "bw_page.h"
#include "server/clock.h"
#include "server/failure.h"
#include "server/joboptions.h"
#include "server/log.h"
#include "server/worker/spawner.h"

enum { NAME_BYTES_MOST = 200, PAGE_DEFAULT = 50, PAGE_MOST = 200 };
static const uint64_t room_kept = (uint64_t)64 << 20; /* uploads leave this much of the disk to the queue */

/* Replies for a failure of store or queue. */
static void storage_problem(bw_request *r) {
    bool full = errno == ENOSPC || bw_store_room(r->services->store) < room_kept / 64;
    bw_reply_problem(r, full ? BW_PROBLEM_STORAGE_FULL : BW_PROBLEM_IO, "the daemon's storage failed");
}

/* ---- blobs ---- */

static json_t *blob_json(const char *sha256, uint64_t bytes) {
    return json_pack("{s:s, s:I}", "sha256", sha256, "bytes", (json_int_t)bytes);
}

static bool is_hash(bw_request *r) {
    if (bw_is_sha256(r->parameters[0])) return true;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "'%.80s' is not a SHA-256: 64 digits 0-9 a-f", r->parameters[0]);
    return false;
}

static void blob_begin(bw_request *r) {
    const bw_services *s = r->services;
    uint64_t bytes;
    int fd;
    if (!is_hash(r)) return;
    if (!r->has_length) {
        bw_reply_problem(r, BW_PROBLEM_LENGTH_REQUIRED, "an upload must say its Content-Length");
    } else if (r->length > s->config->max_upload) {
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "an upload has at most %llu bytes",
                         (unsigned long long)s->config->max_upload);
    } else if ((fd = bw_store_open_blob(s->store, r->parameters[0], &bytes)) >= 0) {
        close(fd);
        bw_reply_json(r, 200, blob_json(r->parameters[0], bytes));
    } else if (bw_store_room(s->store) < r->length + room_kept) {
        bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "an upload of %llu bytes does not fit any more",
                         (unsigned long long)r->length);
    } else if (bw_upload_begin(s->store, &r->upload) != BW_OK) {
        storage_problem(r);
    }
}

static void blob_put(bw_request *r) {
    char actual[BW_SHA256_TEXT];
    bool matches;
    bw_upload *upload = r->upload;
    uint64_t bytes = bw_upload_bytes(upload);
    r->upload = NULL; /* finish frees it */
    if (bw_upload_finish(upload, r->parameters[0], &matches, actual) != BW_OK) {
        storage_problem(r);
    } else if (!matches) {
        bw_reply_problem(r, BW_PROBLEM_HASH_MISMATCH, "the %llu bytes that came have the SHA-256 %s",
                         (unsigned long long)bytes, actual);
    } else {
        bw_event(BW_INFO, "blob.stored", "sha256=%s bytes=%llu", actual, (unsigned long long)bytes);
        bw_reply_json(r, 201, blob_json(actual, bytes));
    }
}

static void blob_head(bw_request *r) {
    uint64_t bytes;
    if (!is_hash(r)) return;
    int fd = bw_store_open_blob(r->services->store, r->parameters[0], &bytes);
    if (fd < 0) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_BLOB, "no blob %s has been uploaded", r->parameters[0]);
    else bw_reply_file(r, fd, bytes, "application/octet-stream", NULL);
}

/* ---- jobs as JSON ---- */

static void set_time(json_t *object, const char *name, int64_t ms) {
    char text[BW_TIME_TEXT];
    if (ms) json_object_set_new(object, name, json_string(bw_time_text(ms, text)));
}

static json_t *attempts_json(bw_request *r, const char *id) {
    bw_attempt *attempts;
    size_t count;
    json_t *list = json_array();
    if (bw_queue_attempts(r->services->queue, id, &attempts, &count) != BW_OK) return list;
    for (size_t i = 0; i < count; i++) {
        const bw_attempt *a = &attempts[i];
        json_t *item = json_pack("{s:i, s:s, s:b}", "attempt", a->attempt, "stage", a->stage, "reused", a->reused);
        set_time(item, "started", a->started);
        set_time(item, "finished", a->finished);
        if (*a->outcome) json_object_set_new(item, "outcome", json_string(a->outcome));
        json_array_append_new(list, item);
    }
    free(attempts);
    return list;
}

static double job_progress(bw_request *r, const bw_job *job, char note[BW_NOTE_TEXT]) {
    *note = '\0';
    double stage = job->open ? bw_dispatch_progress(r->services->dispatch, job->id, note) : 0;
    return job->state == BW_JOB_SUCCESSFUL ? 1 : (job->stage + stage) / job->stage_count;
}

static json_t *links_json(const bw_job *job) {
    char self[64];
    snprintf(self, sizeof self, "/v1/jobs/%s", job->id);
    json_t *links = json_pack("{s:s, s:s+}", "self", self, "log", self, "/log");
    if (job->state == BW_JOB_SUCCESSFUL) {
        json_object_set_new(links, "results", json_sprintf("%s/results", self));
        json_object_set_new(links, "report", json_sprintf("%s/report", self));
    }
    return links;
}

static json_t *job_json(bw_request *r, const bw_job *job) {
    int stage = job->stage < job->stage_count ? job->stage : job->stage_count - 1;
    char note[BW_NOTE_TEXT];
    double progress = job_progress(r, job, note);
    json_t *o = json_pack("{s:s, s:s, s:s, s:s, s:i, s:i, s:f}", "id", job->id, "state", bw_job_state_names[job->state],
                          "input", job->input, "stage", bw_api_stages[stage].name, "stage_index", job->stage,
                          "stage_count", job->stage_count, "progress", progress);
    if (!o) return NULL;
    if (job->name) json_object_set_new(o, "name", json_string(job->name));
    if (*job->parameters) json_object_set_new(o, "parameters", json_string(job->parameters));
    if (job->cancel && job->state == BW_JOB_RUNNING) json_object_set_new(o, "cancelling", json_true());
    if (job->finish && (job->state == BW_JOB_QUEUED || job->state == BW_JOB_RUNNING)) json_object_set_new(o, "finishing", json_true());
    if (*note) json_object_set_new(o, "note", json_string(note));
    json_object_set_new(o, "options", json_loads(job->options, 0, NULL));
    set_time(o, "created", job->created);
    set_time(o, "started", job->started);
    set_time(o, "finished", job->finished);
    json_object_set_new(o, "attempts", attempts_json(r, job->id));
    if (job->failure) json_object_set_new(o, "failure", json_loads(job->failure, 0, NULL));
    json_object_set_new(o, "links", links_json(job));
    return o;
}

/* Reads the job that the path names, or replies. The caller clears it. */
static bool load_job(bw_request *r, bw_job *job) {
    bool found;
    if (bw_queue_get(r->services->queue, r->parameters[0], job, &found) != BW_OK) {
        storage_problem(r);
        return false;
    }
    if (!found) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_JOB, "there is no job '%.60s'", r->parameters[0]);
    return found;
}

/* ---- creating ---- */

static void create_begin(bw_request *r) {
    static const char json[] = "application/json";
    const char *type = bw_request_header(r, "Content-Type");
    size_t n = type ? strcspn(type, "; ") : 0;
    if (r->has_length && r->length > BW_BODY_MOST)
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %d bytes", BW_BODY_MOST);
    else if (n != sizeof json - 1 || strncasecmp(type, json, n) != 0)
        bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_MEDIA_TYPE, "a job is described as %s", json);
}

static bool is_member(const char *key) {
    static const char *const members[] = {"input", "parameters", "name", "options"};
    for (size_t i = 0; i < sizeof members / sizeof *members; i++)
        if (strcmp(key, members[i]) == 0) return true;
    return false;
}

/* A member that names a blob; false after a reply. */
static bool read_hash(bw_request *r, const json_t *body, const char *member, char hash[BW_SHA256_TEXT]) {
    const char *text = json_string_value(json_object_get(body, member));
    if (text && bw_is_sha256(text)) memcpy(hash, text, BW_SHA256_TEXT);
    else bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "'%s' must be the SHA-256 of an uploaded blob, 64 digits 0-9 a-f", member);
    return *hash;
}

/* The members of the body; false after a reply. `given` borrows from body. */
static bool read_job(bw_request *r, json_t *body, bw_job *job, const json_t **given) {
    const char *key;
    json_t *value, *name = json_object_get(body, "name");
    json_object_foreach(body, key, value) {
        if (is_member(key)) continue;
        bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "there is no member '%.60s'", key);
        return false;
    }
    if (!read_hash(r, body, "input", job->input)) return false;
    if (json_object_get(body, "parameters") && !read_hash(r, body, "parameters", job->parameters)) return false;
    if (name && (!json_is_string(name) || json_string_length(name) > NAME_BYTES_MOST)) {
        bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "'name' must be a string of at most %d bytes", NAME_BYTES_MOST);
        return false;
    }
    if (name) job->name = strdup(json_string_value(name));
    *given = json_object_get(body, "options");
    return true;
}

static bool is_uploaded(bw_request *r, const char *member, const char *sha256) {
    uint64_t bytes;
    int fd = bw_store_open_blob(r->services->store, sha256, &bytes);
    if (fd >= 0) close(fd);
    else bw_reply_problem(r, BW_PROBLEM_UNKNOWN_INPUT, "upload the %s first: PUT /v1/blobs/%s", member, sha256);
    return fd >= 0;
}

static void accept_job(bw_request *r, bw_job *job, const json_t *all) {
    char location[64];
    bw_job_id_make(job->id);
    job->options = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    job->stage_count = bw_joboptions_stages(all);
    job->created = bw_now_ms();
    if (!job->options || bw_queue_insert(r->services->queue, job) != BW_OK) {
        storage_problem(r);
        return;
    }
    bw_event(BW_INFO, "job.accepted", "job=%s input=%s", job->id, job->input);
    bw_reply_json(r, 201, job_json(r, job));
    snprintf(location, sizeof location, "/v1/jobs/%s", job->id);
    bw_reply_header(r, "Location", location);
    bw_dispatch_wake(r->services->dispatch);
}

static void job_create(bw_request *r) {
    char detail[200];
    json_error_t error;
    const json_t *given = NULL;
    json_t *all = NULL, *body = json_loadb(r->body ? r->body : "", r->body_size, JSON_REJECT_DUPLICATES, &error);
    bw_job job;
    memset(&job, 0, sizeof job);
    if (!json_is_object(body)) {
        if (body) bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "the body must be an object");
        else bw_reply_problem(r, BW_PROBLEM_BAD_JSON, "line %d column %d: %s", error.line, error.column, error.text);
    } else if (read_job(r, body, &job, &given)) {
        if (!bw_joboptions_check(given, &all, detail, sizeof detail))
            bw_reply_problem(r, BW_PROBLEM_INVALID_OPTION, "%s", detail);
        else if (is_uploaded(r, "input", job.input) && (!*job.parameters || is_uploaded(r, "parameters", job.parameters)))
            accept_job(r, &job, all);
    }
    json_decref(all);
    json_decref(body);
    bw_job_clear(&job);
}

/* ---- reading jobs ---- */

/* A whole number in [low, high] from the query; `otherwise` if it is not given. False after a reply. */
static bool query_number(bw_request *r, const char *name, int64_t low, int64_t high, int64_t otherwise, int64_t *value) {
    const char *text = bw_request_query(r, name);
    char *end;
    *value = otherwise;
    if (!text) return true;
    errno = 0;
    *value = strtoll(text, &end, 10);
    if (!errno && *text >= '0' && *text <= '9' && !*end && *value >= low && *value <= high) return true;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "%s has a bad value '%.40s'", name, text);
    return false;
}

static bool query_state(bw_request *r, int *state) {
    const char *text = bw_request_query(r, "state");
    *state = -1;
    for (int i = 0; text && i < BW_JOB_COUNT; i++)
        if (strcmp(text, bw_job_state_names[i]) == 0) *state = i;
    if (text && *state < 0) bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "there is no state '%.40s'", text);
    return !text || *state >= 0;
}

static void job_list(bw_request *r) {
    int64_t limit, before;
    int state;
    bw_job *jobs;
    size_t count;
    if (!query_number(r, "limit", 1, PAGE_MOST, PAGE_DEFAULT, &limit) ||
        !query_number(r, "cursor", 1, INT64_MAX, 0, &before) || !query_state(r, &state))
        return;
    if (bw_queue_list(r->services->queue, state, before, (int)limit + 1, &jobs, &count) != BW_OK) {
        storage_problem(r);
        return;
    }
    json_t *list = json_array(), *page = json_pack("{s:o}", "jobs", list);
    size_t shown = count > (size_t)limit ? (size_t)limit : count;
    for (size_t i = 0; i < shown; i++) json_array_append_new(list, job_json(r, &jobs[i]));
    if (shown < count)
        json_object_set_new(page, "next", json_sprintf("%lld", (long long)jobs[shown - 1].seq));
    bw_jobs_free(jobs, count);
    bw_reply_json(r, 200, page);
}

static void job_get(bw_request *r) {
    bw_job job;
    if (!load_job(r, &job)) return;
    bw_reply_json(r, 200, job_json(r, &job));
    bw_job_clear(&job);
}

static void job_cancel(bw_request *r) {
    bw_cancel result;
    if (bw_queue_cancel(r->services->queue, r->parameters[0], bw_now_ms(), &result) != BW_OK) {
        storage_problem(r);
        return;
    }
    if (result == BW_CANCEL_TOO_LATE) {
        bw_reply_problem(r, BW_PROBLEM_JOB_FINISHED, "the job has already ended; there is nothing to cancel");
        return;
    }
    if (result == BW_CANCEL_NOTED) bw_dispatch_wake(r->services->dispatch);
    job_get(r); /* 404 if it is unknown */
}

static void job_finish(bw_request *r) {
    bw_finish result;
    if (bw_queue_finish(r->services->queue, r->parameters[0], &result) != BW_OK) {
        storage_problem(r);
        return;
    }
    if (result == BW_FINISH_TOO_LATE) {
        bw_reply_problem(r, BW_PROBLEM_JOB_FINISHED, "the job has already ended; there is nothing to finish");
        return;
    }
    if (result == BW_FINISH_NOTED) bw_dispatch_wake(r->services->dispatch);
    job_get(r); /* 404 if it is unknown */
}

static void job_log(bw_request *r) {
    static const char text_plain[] = "text/plain; charset=utf-8";
    uint64_t bytes;
    bw_job job;
    if (!load_job(r, &job)) return;
    int fd = bw_store_open_log(r->services->store, job.id, &bytes);
    if (fd >= 0) bw_reply_file(r, fd, bytes, text_plain, NULL);
    else bw_reply_text(r, text_plain, "", 0);
    bw_job_clear(&job);
}

/* ---- results ---- */

/* The manifest of a successful job: a new array, empty when the job stopped before encode. NULL after a reply. */
static json_t *load_manifest(bw_request *r, bw_job *job) {
    bool found = false;
    char *text = NULL;
    if (!load_job(r, job)) return NULL;
    if (job->state != BW_JOB_SUCCESSFUL) {
        bw_reply_problem(r, BW_PROBLEM_NOT_SUCCESSFUL, "the job is %s", bw_job_state_names[job->state]);
        return NULL;
    }
    if (!*job->result_key) return json_array();
    json_t *manifest = NULL;
    if (bw_queue_output(r->services->queue, job->result_key, &found, &text) == BW_OK && text)
        manifest = json_loads(text, 0, NULL);
    free(text);
    if (!manifest) storage_problem(r);
    return manifest;
}

static void result_list(bw_request *r) {
    bw_job job;
    json_t *item, *manifest = load_manifest(r, &job);
    size_t i;
    if (manifest) {
        json_array_foreach(manifest, i, item)
            json_object_set_new(item, "href", json_sprintf("/v1/jobs/%s/results/%s", job.id,
                                                           json_string_value(json_object_get(item, "name"))));
        bw_reply_json(r, 200, json_pack("{s:s, s:o}", "job", job.id, "results", manifest));
    }
    bw_job_clear(&job);
}

static void send_result(bw_request *r, const char *name) {
    bw_job job;
    uint64_t bytes;
    json_t *item, *manifest = load_manifest(r, &job), *hit = NULL;
    size_t i;
    json_array_foreach(manifest, i, item)
        if (strcmp(json_string_value(json_object_get(item, "name")), name) == 0) hit = item;
    if (manifest && !hit) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_RESULT, "the job has no result '%.100s'", name);
    if (hit) {
        int fd = bw_store_open_cached(r->services->store, job.result_key, name, &bytes);
        if (fd < 0) storage_problem(r);
        else bw_reply_file(r, fd, bytes, json_string_value(json_object_get(hit, "media_type")),
                           json_string_value(json_object_get(hit, "sha256")));
    }
    json_decref(manifest);
    bw_job_clear(&job);
}

static void result_get(bw_request *r) { send_result(r, r->parameters[1]); }
static void job_report(bw_request *r) { send_result(r, "report.json"); }

/* ---- the daemon itself ---- */

static void live(bw_request *r) { bw_reply_json(r, 200, json_pack("{s:s}", "version", BW_VERSION)); }

static void ready(bw_request *r) {
    const bw_services *s = r->services;
    bool queue = bw_queue_healthy(s->queue), dispatch = bw_dispatch_alive(s->dispatch);
    bool storage = bw_store_room(s->store) >= room_kept, worker = access(s->config->worker, X_OK) == 0;
    bool all = queue && dispatch && storage && worker;
    json_t *checks = json_pack("{s:s, s:s, s:s, s:s}", "queue", queue ? "ok" : "the database does not read or write",
                               "dispatcher", dispatch ? "ok" : "it has stopped", "storage",
                               storage ? "ok" : "the disk is full", "worker", worker ? "ok" : "the program cannot be run");
    json_t *limits = json_pack("{s:b, s:b, s:b, s:b, s:I, s:i, s:i}", "address_space", bw_spawner_limits_memory(),
                               "no_new_privileges", 1, "seccomp", 0, "landlock", 0, "stage_memory",
                               (json_int_t)s->config->stage_memory, "stage_cpu_seconds", s->config->stage_cpu_seconds,
                               "stage_wall_seconds", s->config->stage_wall_seconds);
    json_t *body = all ? json_object() : bw_problem_document(BW_PROBLEM_NOT_READY, "see checks");
    json_object_set_new(body, "ready", json_boolean(all));
    json_object_set_new(body, "checks", checks);
    json_object_set_new(body, "limits", limits);
    if (all) bw_reply_json(r, 200, body);
    else bw_reply_problem_json(r, BW_PROBLEM_NOT_READY, body);
}

static void openapi(bw_request *r) { bw_reply_text(r, "application/json", bw_api_document, bw_api_document_size); }

/* ---- the page ---- */

/* Scripts, styles and data come from this daemon only, and nothing may frame it. */
static const char page_policy[] = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; worker-src 'self'; "
                                  "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

static void send_page(bw_request *r, const bw_page_file *file) {
    bw_reply_text(r, file->media_type, file->bytes, file->size);
    bw_reply_header(r, "Content-Security-Policy", page_policy);
    bw_reply_header(r, "Cache-Control", "no-cache");
}

static void page(bw_request *r) { send_page(r, bw_page_files); }

static void page_file(bw_request *r) {
    const bw_page_file *file = bw_page_files;
    while (file->name && strcmp(file->name, r->parameters[0]) != 0) file++;
    if (file->name) send_page(r, file);
    else bw_reply_problem(r, BW_PROBLEM_NOT_FOUND, "the page has no file %.80s", r->parameters[0]);
}

const bw_route bw_routes[BW_OP_COUNT] = {
    [BW_OP_BLOB_PUT] = {blob_begin, blob_put},
    [BW_OP_BLOB_HEAD] = {NULL, blob_head},
    [BW_OP_JOB_CREATE] = {create_begin, job_create},
    [BW_OP_JOB_LIST] = {NULL, job_list},
    [BW_OP_JOB_GET] = {NULL, job_get},
    [BW_OP_JOB_CANCEL] = {NULL, job_cancel},
    [BW_OP_JOB_FINISH] = {NULL, job_finish},
    [BW_OP_JOB_LOG] = {NULL, job_log},
    [BW_OP_JOB_REPORT] = {NULL, job_report},
    [BW_OP_RESULT_LIST] = {NULL, result_list},
    [BW_OP_RESULT_GET] = {NULL, result_get},
    [BW_OP_LIVE] = {NULL, live},
    [BW_OP_READY] = {NULL, ready},
    [BW_OP_OPENAPI] = {NULL, openapi},
    [BW_OP_PAGE] = {NULL, page},
    [BW_OP_PAGE_FILE] = {NULL, page_file},
};
