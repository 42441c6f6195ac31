#include "server/http/operations.h"

#include <string.h>
#include <unistd.h>

#include "bw_page.h"
#include "server/failure.h"
#include "server/http/reply.h"
#include "server/worker/spawner.h"

void bw_http_live(bw_request *r) { bw_reply_json(r, 200, json_pack("{s:s}", "version", BW_VERSION)); }

void bw_http_ready(bw_request *r) {
    const bw_services *s = r->services;
    bool queue = bw_queue_healthy(s->queue), dispatch = bw_dispatch_alive(s->dispatch);
    bool storage = bw_store_room(s->store) >= BW_ROOM_KEPT, worker = access(s->config->worker, X_OK) == 0;
    bool drains = bw_dispatch_draining(s->dispatch), all = queue && dispatch && storage && worker && !drains;
    json_t *checks = json_pack("{s:s, s:s, s:s, s:s}", "queue", queue ? "ok" : "the database does not read or write",
                               "dispatcher", !dispatch ? "it has stopped" : drains ? "it is draining, the daemon is about to stop" : "ok", "storage",
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
