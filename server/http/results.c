#include "server/http/operations.h"

#include <stdlib.h>
#include <string.h>

#include "server/http/content.h"
#include "server/http/reply.h"

/* What the job had may be gone because the job is, by now. */
static void reply_lost(bw_request *r) {
    bw_job now;
    if (bw_http_load_job(r, &now)) bw_reply_storage(r);
    bw_job_clear(&now);
}

/* The manifest of a successful job: a new array, empty when the job stopped before encode. NULL after a reply. */
static json_t *load_manifest(bw_request *r, bw_job *job) {
    bool found = false;
    char *text = NULL;
    if (!bw_http_load_job(r, job)) return NULL;
    if (job->state != BW_JOB_SUCCESSFUL) {
        bw_reply_problem(r, BW_PROBLEM_NOT_SUCCESSFUL, "the job is %s", bw_job_state_names[job->state]);
        return NULL;
    }
    if (!*job->result_key) return json_array();
    json_t *manifest = NULL;
    if (bw_queue_output(r->services->queue, job->result_key, &found, &text) == BW_OK && text)
        manifest = json_loads(text, 0, NULL);
    free(text);
    if (!manifest) reply_lost(r);
    return manifest;
}

void bw_http_result_list(bw_request *r) {
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
        if (fd < 0) reply_lost(r);
        else bw_reply_content(r, 200, &(bw_content){.fd = fd, .bytes = bytes, .modified = job.finished,
                                                    .media_type = json_string_value(json_object_get(hit, "media_type")),
                                                    .sha256 = json_string_value(json_object_get(hit, "sha256"))});
        bw_reply_header(r, "Content-Security-Policy", "sandbox; default-src 'none'; style-src 'unsafe-inline'"); /* an SVG may have scripts */
    }
    json_decref(manifest);
    bw_job_clear(&job);
}

void bw_http_result_get(bw_request *r) { send_result(r, r->parameters[1]); }
void bw_http_job_report(bw_request *r) { send_result(r, "report.json"); }
