#include "server/http/routes.h"

#include <stdio.h>
#include <string.h>

#include "server/http/operations.h"
#include "server/http/reply.h"

const bw_route bw_routes[BW_OP_COUNT] = {
    [BW_OP_BLOB_PUT] = {bw_http_blob_begin, bw_http_blob_put},
    [BW_OP_BLOB_HEAD] = {NULL, bw_http_blob_head},
    [BW_OP_UPLOAD_CREATE] = {bw_http_upload_create_begin, bw_http_upload_create},
    [BW_OP_UPLOAD_OPTIONS] = {NULL, bw_http_upload_options},
    [BW_OP_UPLOAD_HEAD] = {NULL, bw_http_upload_head},
    [BW_OP_UPLOAD_PATCH] = {bw_http_upload_patch_begin, bw_http_upload_patch},
    [BW_OP_UPLOAD_DELETE] = {NULL, bw_http_upload_delete},
    [BW_OP_JOB_CREATE] = {bw_http_job_create_begin, bw_http_job_create},
    [BW_OP_BATCH_CREATE] = {bw_http_batch_create_begin, bw_http_batch_create},
    [BW_OP_JOB_LIST] = {NULL, bw_http_job_list},
    [BW_OP_JOB_GET] = {NULL, bw_http_job_get},
    [BW_OP_JOB_CANCEL] = {NULL, bw_http_job_cancel},
    [BW_OP_JOB_FINISH] = {NULL, bw_http_job_finish},
    [BW_OP_JOB_RETRY] = {NULL, bw_http_job_retry},
    [BW_OP_JOB_PIN] = {NULL, bw_http_job_pin},
    [BW_OP_JOB_UNPIN] = {NULL, bw_http_job_unpin},
    [BW_OP_JOB_DELETE] = {NULL, bw_http_job_delete},
    [BW_OP_JOB_EVENTS] = {NULL, bw_http_job_events},
    [BW_OP_EVENT_LIST] = {NULL, bw_http_event_list},
    [BW_OP_JOB_LOG] = {NULL, bw_http_job_log},
    [BW_OP_JOB_REPORT] = {NULL, bw_http_job_report},
    [BW_OP_RESULT_LIST] = {NULL, bw_http_result_list},
    [BW_OP_RESULT_GET] = {NULL, bw_http_result_get},
    [BW_OP_CAPABILITIES] = {NULL, bw_http_capabilities},
    [BW_OP_LIVE] = {NULL, bw_http_live},
    [BW_OP_READY] = {NULL, bw_http_ready},
    [BW_OP_METRICS] = {NULL, bw_http_metrics},
    [BW_OP_OPENAPI] = {NULL, bw_http_openapi},
    [BW_OP_PAGE] = {NULL, bw_http_page},
    [BW_OP_PAGE_FILE] = {NULL, bw_http_page_file},
};

/* Does `path` fit `pattern`, whose {segments} stand for any non-empty segment? Fills the parameters. */
static bool match(const char *pattern, const char *path, char parameters[2][BW_PARAMETER_MOST]) {
    int n = 0;
    while (*pattern) {
        if (*pattern == '{') {
            size_t size = strcspn(path, "/");
            if (size == 0 || size >= BW_PARAMETER_MOST || n == 2) return false;
            memcpy(parameters[n], path, size);
            parameters[n++][size] = '\0';
            path += size;
            pattern += strcspn(pattern, "}") + 1;
        } else if (*pattern++ != *path++) {
            return false;
        }
    }
    return *path == '\0';
}

static bool method_fits(const char *wanted, const char *method) {
    return strcmp(wanted, method) == 0 || (strcmp(method, "HEAD") == 0 && strcmp(wanted, "GET") == 0);
}

static bool find_operation(bw_request *r, const char *method, const char *path) {
    char allow[80] = "";
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        if (!match(e->path, path, r->parameters)) continue;
        if (method_fits(e->method, method)) {
            r->op = (bw_op)i;
            return true;
        }
        size_t n = strlen(allow);
        snprintf(allow + n, sizeof allow - n, "%s%s%s", n ? ", " : "", e->method,
                 strcmp(e->method, "GET") == 0 ? ", HEAD" : "");
    }
    if (*allow) {
        bw_reply_problem(r, BW_PROBLEM_METHOD_NOT_ALLOWED, "%.20s is not allowed here; allowed: %s", method, allow);
        bw_reply_header(r, "Allow", allow);
    } else {
        bw_reply_problem(r, BW_PROBLEM_NOT_FOUND, "there is nothing at %.200s; /openapi.json tells what there is", path);
    }
    return false;
}

static enum MHD_Result check_query(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    bw_request *r = user;
    (void)kind, (void)value;
    for (const char *const *name = bw_endpoints[r->op].query; *name; name++)
        if (strcmp(*name, key) == 0) return MHD_YES;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "there is no parameter '%.60s' here", key);
    return MHD_NO;
}

/* Clients that cannot send PATCH or DELETE may say so with POST; tus 1.0.0 asks for that, and only its operations have it. */
static const char *method_meant(const bw_request *r, const char *method, const char *path) {
    const char *instead = bw_request_header(r, "X-HTTP-Method-Override");
    bool upload = strncmp(path, "/v1/uploads/", 12) == 0;
    return upload && instead && strcmp(method, "POST") == 0 ? instead : method;
}

bool bw_route_find(bw_request *r, const char *method, const char *path) {
    method = method_meant(r, method, path);
    if (!find_operation(r, method, path)) return false;
    MHD_get_connection_values(r->connection, MHD_GET_ARGUMENT_KIND, check_query, r);
    return !r->reply;
}
