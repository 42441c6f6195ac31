#include "server/http/operations.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bw_page.h"
#include "server/failure.h"
#include "server/http/content.h"
#include "server/http/reply.h"
#include "server/metrics.h"

void bw_http_live(bw_request *r) { bw_reply_json(r, 200, json_pack("{s:s}", "version", BW_VERSION)); }

/* A limit of which 0 says that there is none. */
static json_t *limit_json(uint64_t most) { return most ? json_integer((json_int_t)most) : json_null(); }

/* What confines a worker here: mechanisms in force, and sizes. */
static json_t *limits_json(const bw_config *c, const bw_sandbox *sandbox) {
    return json_pack("{s:b, s:b, s:b, s:i, s:b, s:s, s:I, s:I, s:I, s:I, s:i, s:i, s:o, s:o, s:f}", "address_space", sandbox->address_space,
                     "no_new_privileges", sandbox->no_new_privileges, "seccomp", sandbox->seccomp, "landlock", sandbox->landlock,
                     "sandbox_required", c->require_sandbox, "missing", sandbox->missing, "memory", (json_int_t)c->memory, "stage_memory",
                     (json_int_t)c->stage_memory, "stage_output", (json_int_t)c->stage_output, "stage_scratch",
                     (json_int_t)c->stage_scratch, "stage_cpu_seconds", c->stage_cpu_seconds, "stage_wall_seconds",
                     c->stage_wall_seconds, "job_cpu_seconds", limit_json((uint64_t)c->job_cpu_seconds), "job_wall_seconds",
                     limit_json((uint64_t)c->job_wall_seconds), "cancel_grace_seconds", c->cancel_grace_ms / 1000.0);
}

static json_t *request_limits_json(const bw_config *c) {
    return json_pack("{s:I, s:i, s:o, s:o, s:o, s:o, s:o, s:o, s:i}", "upload_bytes", (json_int_t)c->max_upload, "uploads", c->max_uploads, "owner_bytes",
                     limit_json(c->owner_bytes), "owner_jobs", limit_json((uint64_t)c->owner_jobs), "owner_running",
                     limit_json((uint64_t)c->owner_running), "owner_uploads", limit_json((uint64_t)c->owner_uploads), "owner_streams",
                     limit_json((uint64_t)c->owner_streams), "owner_rate", limit_json((uint64_t)c->owner_rate), "workers", c->workers);
}

void bw_http_capabilities(bw_request *r) {
    const bw_services *s = r->services;
    bw_sandbox sandbox = bw_dispatch_sandbox(s->dispatch);
    json_t *body = json_pack("{s:s}", "version", BW_VERSION), *fixed = json_loads(bw_api_capabilities, 0, NULL);
    json_object_update(body, fixed);
    json_decref(fixed);
    json_object_set_new(body, "limits", request_limits_json(s->config));
    json_object_set_new(body, "worker", limits_json(s->config, &sandbox));
    bw_reply_json(r, 200, body);
}

void bw_http_ready(bw_request *r) {
    const bw_services *s = r->services;
    bw_verdict worst;
    json_t *checks = bw_health_checks(s->health, &worst);
    bool ready = worst != BW_VERDICT_FAIL;
    bw_sandbox sandbox = bw_dispatch_sandbox(s->dispatch);
    json_t *limits = limits_json(s->config, &sandbox);
    json_t *body = ready ? json_object() : bw_problem_document(BW_PROBLEM_NOT_READY, "see checks");
    json_object_set_new(body, "ready", json_boolean(ready));
    json_object_set_new(body, "checks", checks);
    json_object_set_new(body, "limits", limits);
    if (ready) bw_reply_json(r, 200, body);
    else bw_reply_problem_json(r, BW_PROBLEM_NOT_READY, body);
}

void bw_http_metrics(bw_request *r) {
    char *text = NULL;
    size_t size = 0;
    bw_health_measure(r->services->health);
    FILE *f = open_memstream(&text, &size);
    if (f) bw_metrics_write(f);
    if (!f || fclose(f) != 0) {
        free(text);
        bw_reply_json(r, 500, NULL);
        return;
    }
    bw_reply_content(r, 200, &(bw_content){.fd = -1, .data = text, .owned = true, .bytes = size, .media_type = "text/plain; version=0.0.4; charset=utf-8"});
}

void bw_http_openapi(bw_request *r) { bw_reply_text(r, "application/json", bw_api_document, bw_api_document_size); }

/* ---- the page ---- */

/* Scripts, styles and data come from this daemon only, and nothing may frame it. */
static const char page_policy[] = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; worker-src 'self'; "
                                  "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

static void send_page(bw_request *r, const bw_page_file *file) {
    bw_reply_text(r, file->media_type, file->bytes, file->size);
    bw_reply_header(r, "Content-Security-Policy", page_policy);
    bw_reply_header(r, "Cache-Control", "no-cache");
}

void bw_http_page(bw_request *r) { send_page(r, bw_page_files); }

void bw_http_page_file(bw_request *r) {
    const bw_page_file *file = bw_page_files;
    while (file->name && strcmp(file->name, r->parameters[0]) != 0) file++;
    if (file->name) send_page(r, file);
    else bw_reply_problem(r, BW_PROBLEM_NOT_FOUND, "the page has no file %.80s", r->parameters[0]);
}
