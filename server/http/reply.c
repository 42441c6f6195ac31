#include "server/http/reply.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/failure.h"
#include "server/http/content.h"

#define RETRY_SECONDS "5"

void bw_reply_made(bw_request *r, unsigned status, struct MHD_Response *response, const char *media_type) {
    if (r->reply || !response) {
        if (response) MHD_destroy_response(response);
        return;
    }
    if (media_type) MHD_add_response_header(response, "Content-Type", media_type);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    r->reply = response;
    r->reply_status = status;
}

static void reply_document(bw_request *r, unsigned status, json_t *body, const char *media_type) {
    static char lost[] = "{\"type\":\"/problems/internal\",\"title\":\"internal error\",\"status\":500}\n";
    char *text = body ? json_dumps(body, JSON_INDENT(1)) : NULL;
    json_decref(body);
    if (text) bw_reply_content(r, status, &(bw_content){.fd = -1, .data = text, .owned = true, .bytes = strlen(text), .media_type = media_type});
    else bw_reply_made(r, 500, MHD_create_response_from_buffer(sizeof lost - 1, lost, MHD_RESPMEM_PERSISTENT), "application/problem+json");
}

void bw_reply_json(bw_request *r, unsigned status, json_t *body) { reply_document(r, status, body, "application/json"); }

void bw_reply_problem_json(bw_request *r, bw_problem problem, json_t *document) {
    reply_document(r, (unsigned)bw_problem_types[problem].http, document, "application/problem+json");
}

void bw_reply_problem(bw_request *r, bw_problem problem, const char *format, ...) {
    char detail[400];
    va_list args;
    va_start(args, format);
    vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    bw_reply_problem_json(r, problem, bw_problem_document(problem, detail));
}

void bw_reply_storage(bw_request *r) {
    bool full = errno == ENOSPC || bw_store_room(r->services->store) < BW_ROOM_KEPT / 64;
    bw_reply_problem(r, full ? BW_PROBLEM_STORAGE_FULL : BW_PROBLEM_IO, "the daemon's storage failed");
}

void bw_reply_text(bw_request *r, const char *media_type, const char *text, size_t size) {
    char hash[BW_SHA256_TEXT];
    bw_digest *digest = bw_digest_new();
    bool hashed = digest && bw_digest_add(digest, text, size) && bw_digest_end(digest, hash);
    bw_digest_free(digest);
    bw_reply_content(r, 200, &(bw_content){.fd = -1, .data = text, .bytes = size, .media_type = media_type, .sha256 = hashed ? hash : NULL});
}

void bw_reply_nothing(bw_request *r) {
    bw_reply_made(r, 204, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT), NULL);
}

void bw_reply_header(bw_request *r, const char *name, const char *value) {
    if (r->reply) MHD_add_response_header(r->reply, name, value);
}

/* Answers are for who asked, with that token, at that time. */
static void add_caching(bw_request *r) {
    if (MHD_get_response_header(r->reply, "Cache-Control")) return;
    bw_reply_header(r, "Cache-Control", MHD_get_response_header(r->reply, "ETag") ? "private, no-cache" : "no-store");
}

/* A daemon that stops or is not ready is asked again: its successor, or its operator, needs some seconds. */
static void add_retry(bw_request *r) {
    if (r->reply_status == 503) bw_reply_header(r, "Retry-After", RETRY_SECONDS);
}

/* Every answer of theirs says it, by whichever part of the daemon it was made. */
static void add_tus(bw_request *r) {
    bool upload = r->op < BW_OP_COUNT && strncmp(bw_endpoints[r->op].path, "/v1/uploads", 11) == 0;
    if (upload) bw_reply_header(r, "Tus-Resumable", BW_TUS_VERSION);
}

enum MHD_Result bw_reply_send(bw_request *r) {
    if (!r->reply) bw_reply_problem(r, BW_PROBLEM_INTERNAL, "the request was not answered");
    if (!r->reply) return MHD_NO;
    add_caching(r);
    add_retry(r);
    add_tus(r);
    if (r->sized) bw_guard_answer(r->guarded, r->reply_bytes);
    return MHD_queue_response(r->connection, r->reply_status, r->reply);
}
