#include "server/http/reply.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/failure.h"

static void reply(bw_request *r, unsigned status, struct MHD_Response *response, const char *media_type) {
    if (r->reply || !response) {
        if (response) MHD_destroy_response(response);
        return;
    }
    MHD_add_response_header(response, "Content-Type", media_type);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    r->reply = response;
    r->reply_status = status;
}

static void reply_document(bw_request *r, unsigned status, json_t *body, const char *media_type) {
    static char lost[] = "{\"type\":\"/problems/internal\",\"title\":\"internal error\",\"status\":500}\n";
    char *text = body ? json_dumps(body, JSON_INDENT(1)) : NULL;
    json_decref(body);
    if (!text) {
        reply(r, 500, MHD_create_response_from_buffer(sizeof lost - 1, lost, MHD_RESPMEM_PERSISTENT),
              "application/problem+json");
        return;
    }
    reply(r, status, MHD_create_response_from_buffer(strlen(text), text, MHD_RESPMEM_MUST_FREE), media_type);
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
    reply(r, 200, MHD_create_response_from_buffer(size, (void *)text, MHD_RESPMEM_PERSISTENT), media_type);
}

void bw_reply_file(bw_request *r, int fd, uint64_t bytes, const char *media_type, const char *etag) {
    char quoted[BW_PARAMETER_MOST];
    const char *known = etag ? bw_request_header(r, "If-None-Match") : NULL;
    snprintf(quoted, sizeof quoted, "\"%s\"", etag ? etag : "");
    if (known && (strcmp(known, "*") == 0 || strstr(known, quoted))) {
        close(fd);
        reply(r, 304, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT), media_type);
    } else {
        struct MHD_Response *response = MHD_create_response_from_fd64(bytes, fd);
        if (!response) close(fd);
        reply(r, 200, response, media_type);
    }
    if (etag) bw_reply_header(r, "ETag", quoted);
}

void bw_reply_header(bw_request *r, const char *name, const char *value) {
    if (r->reply) MHD_add_response_header(r->reply, name, value);
}

enum MHD_Result bw_reply_send(bw_request *r) {
    if (!r->reply) bw_reply_problem(r, BW_PROBLEM_INTERNAL, "the request was not answered");
    return r->reply ? MHD_queue_response(r->connection, r->reply_status, r->reply) : MHD_NO;
}
