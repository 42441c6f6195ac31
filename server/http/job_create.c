#include "server/http/operations.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/http/access.h"
#include "server/http/reply.h"
#include "server/joboptions.h"
#include "server/log.h"

enum { NAME_BYTES_MOST = 200 };

void bw_http_job_create_begin(bw_request *r) {
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
    int fd = bw_http_open_blob(r, sha256, &bytes);
    if (fd >= 0) close(fd);
    else bw_reply_problem(r, BW_PROBLEM_UNKNOWN_INPUT, "upload the %s first: PUT /v1/blobs/%s", member, sha256);
    return fd >= 0;
}

static void accept_job(bw_request *r, bw_job *job, const json_t *all) {
    bw_job_id_make(job->id);
    job->options = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    job->stage_count = bw_joboptions_stages(all);
    job->created = bw_now_ms();
    memcpy(job->owner, r->caller.owner, sizeof job->owner);
    if (!job->options || bw_queue_insert(r->services->queue, job) != BW_OK) {
        bw_reply_storage(r);
        return;
    }
    bw_event(BW_INFO, "job.accepted", "job=%s input=%s", job->id, job->input);
    bw_dispatch_wake(r->services->dispatch);
    bw_http_answer_job(r, 201, job->id);
}

void bw_http_job_create(bw_request *r) {
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
