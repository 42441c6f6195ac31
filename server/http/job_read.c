/* A job as a client describes it, read and checked. */
#include "server/http/job_read.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "server/http/access.h"
#include "server/http/reply.h"
#include "server/joboptions.h"
#include "server/limits.h"

enum { NAME_BYTES_MOST = 200 };

typedef struct {
    bw_request *request;
    const char *place; /* before every message: which job of a batch, "" for a job alone */
    bw_problem malformed;
} reading;

static reading begin(bw_request *r, const char *place) {
    return (reading){r, place, r->body ? BW_PROBLEM_BAD_JSON : BW_PROBLEM_INVALID_PARAMETER};
}

static bool refuse(const reading *x, bw_problem problem, const char *format, ...) __attribute__((format(printf, 3, 4)));

static bool refuse(const reading *x, bw_problem problem, const char *format, ...) {
    char detail[300];
    va_list args;
    va_start(args, format);
    vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    bw_reply_problem(x->request, problem, "%s%s", x->place, detail);
    return false;
}

static bool check_members(const reading *x, json_t *body) {
    static const char *const members[] = {"input", "parameters", "name", "options", "limits", "priority", "pinned", "tags"};
    const char *key;
    json_t *value;
    json_object_foreach(body, key, value) {
        bool known = false;
        for (size_t i = 0; i < sizeof members / sizeof *members; i++) known = known || strcmp(key, members[i]) == 0;
        if (!known) return refuse(x, x->malformed, "there is no member '%.60s'", key);
    }
    return true;
}

/* A member that names a blob, which must be there. */
static bool read_blob(const reading *x, const json_t *body, const char *member, char hash[BW_SHA256_TEXT], int64_t *bytes) {
    const char *text = json_string_value(json_object_get(body, member));
    uint64_t size;
    bool fresh;
    if (!text || !bw_is_sha256(text))
        return refuse(x, x->malformed, "'%s' must be the SHA-256 of an uploaded blob, 64 digits 0-9 a-f", member);
    memcpy(hash, text, BW_SHA256_TEXT);
    int fd = bw_http_open_blob(x->request, hash, &size, &fresh);
    if (fd < 0 && errno != ENOENT) return refuse(x, BW_PROBLEM_IO, "the daemon's storage failed"); /* it may be there */
    if (fd < 0) return refuse(x, BW_PROBLEM_UNKNOWN_INPUT, "upload the %s first: PUT /v1/blobs/%s", member, hash);
    close(fd);
    *bytes = (int64_t)size;
    return true;
}

static bool read_name(const reading *x, const json_t *body, bw_job *job) {
    const json_t *name = json_object_get(body, "name");
    if (!name) return true;
    if (!json_is_string(name) || json_string_length(name) > NAME_BYTES_MOST)
        return refuse(x, x->malformed, "'name' must be a string of at most %d bytes", NAME_BYTES_MOST);
    job->name = strdup(json_string_value(name));
    return true;
}

static bool read_priority(const reading *x, const json_t *body, bw_job *job) {
    const json_t *priority = json_object_get(body, "priority");
    json_int_t value = json_integer_value(priority);
    if (priority && (!json_is_integer(priority) || value < -BW_PRIORITY_MOST || value > BW_PRIORITY_MOST))
        return refuse(x, x->malformed, "'priority' must be a whole number from %d to %d", -BW_PRIORITY_MOST, BW_PRIORITY_MOST);
    job->priority = (int)value;
    return true;
}

static bool read_pinned(const reading *x, const json_t *body, bw_job *job) {
    const json_t *pinned = json_object_get(body, "pinned");
    if (pinned && !json_is_boolean(pinned)) return refuse(x, x->malformed, "'pinned' must be true or false");
    job->pinned = json_is_true(pinned);
    return true;
}

bool bw_http_is_tag(const char *text) {
    size_t n = strlen(text);
    if (n == 0 || n > BW_TAG_BYTES_MOST) return false;
    for (; *text; text++)
        if ((unsigned char)*text < 0x20 || *text == 0x7f) return false;
    return true;
}

static bool read_tags(const reading *x, const json_t *body, bw_job *job) {
    const json_t *tags = json_object_get(body, "tags"), *tag;
    size_t i;
    bool good = !tags || (json_is_array(tags) && json_array_size(tags) <= BW_TAGS_MOST);
    json_array_foreach(tags, i, tag) good = good && json_is_string(tag) && bw_http_is_tag(json_string_value(tag));
    if (!good)
        return refuse(x, x->malformed, "'tags' must be a list of at most %d strings of 1 to %d bytes", BW_TAGS_MOST,
                      BW_TAG_BYTES_MOST);
    if (json_array_size(tags)) job->tags = json_dumps(tags, JSON_COMPACT);
    return true;
}

static bool read_limits(const reading *x, const json_t *body, bw_job *job) {
    char detail[200];
    const json_t *limits = json_object_get(body, "limits");
    if (!limits) return true;
    if (!bw_stage_limits_check(limits, detail, sizeof detail)) return refuse(x, BW_PROBLEM_INVALID_OPTION, "%s", detail);
    job->limits = json_dumps(limits, JSON_COMPACT | JSON_SORT_KEYS);
    if (!job->limits) bw_reply_json(x->request, 500, NULL);
    return job->limits != NULL;
}

static bool read_options(const reading *x, const json_t *body, bw_job *job) {
    char detail[200];
    json_t *all = NULL;
    if (!bw_joboptions_check(json_object_get(body, "options"), &all, detail, sizeof detail))
        return refuse(x, BW_PROBLEM_INVALID_OPTION, "%s", detail);
    job->options = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS | JSON_REAL_PRECISION(17));
    job->stage_count = bw_joboptions_stages(all);
    json_decref(all);
    if (!job->options) bw_reply_json(x->request, 500, NULL);
    return job->options != NULL;
}

bool bw_http_read_description(bw_request *r, json_t *body, const char *place, bw_job *job) {
    const reading x = begin(r, place);
    return check_members(&x, body) && read_name(&x, body, job) && read_priority(&x, body, job) && read_pinned(&x, body, job) && read_tags(&x, body, job) &&
           read_options(&x, body, job) && read_limits(&x, body, job) &&
           (!json_object_get(body, "parameters") || read_blob(&x, body, "parameters", job->parameters, &job->parameters_bytes));
}

bool bw_http_read_job(bw_request *r, json_t *body, const char *place, bw_job *job) {
    const reading x = begin(r, place);
    if (!json_is_object(body)) return refuse(&x, x.malformed, "a job is an object");
    return bw_http_read_description(r, body, place, job) && read_blob(&x, body, "input", job->input, &job->input_bytes);
}
