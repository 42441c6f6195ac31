/* The HTTP side of the daemon, on libmicrohttpd: connections, bodies, routing over the generated endpoint table, replies.
 * What the operations do is in routes.c.
 *
 * A request is decided in three steps:
 *     begin   headers are there, no byte of the body: routing, framing rules, size; uploads are opened
 *     body    collected (JSON, at most BW_BODY_MOST) or streamed into the upload
 *     handle  body complete: the operation's function makes the reply
 * A reply made in an earlier step ends the request: at once if the client waits for "100 Continue" or the body is large, else
 * after the body has been read and thrown away, for clients that only listen when they have spoken.
 */
#ifndef BW_SERVER_HTTP_H
#define BW_SERVER_HTTP_H

#include <jansson.h>
#include <microhttpd.h>
#include <stdbool.h>

#include "bw_api.h"
#include "server/config.h"
#include "server/dispatch.h"
#include "server/queue.h"
#include "server/store.h"

enum { BW_BODY_MOST = 65536, BW_PARAMETER_MOST = 128 };

typedef struct {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_dispatch *dispatch;
} bw_services; /* all borrowed */

typedef struct bw_request {
    const bw_services *services;
    struct MHD_Connection *connection;
    bw_op op;
    char parameters[2][BW_PARAMETER_MOST]; /* the variable segments of the path, in order */
    bool has_length, discard;              /* discard: the reply is made, the rest of the body is thrown away */
    uint64_t length;                       /* Content-Length */
    uint64_t received;
    int64_t started;
    char *body; /* NUL-terminated; NULL until the first byte */
    size_t body_size, body_room;
    bw_upload *upload;
    struct MHD_Response *reply; /* NULL until made */
    unsigned reply_status;
} bw_request;

typedef struct bw_http bw_http;

/* Starts to listen. `address` gets "ADDRESS:PORT" as bound. */
bw_status bw_http_start(const bw_services *services, bw_http **http, char *address, size_t size);
void bw_http_stop(bw_http *http); /* lets running requests end */

/* Replies; the first one counts. */
void bw_reply_json(bw_request *request, unsigned status, json_t *body); /* takes body; NULL: out of memory, 500 */
void bw_reply_problem(bw_request *request, bw_problem problem, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
void bw_reply_problem_json(bw_request *request, bw_problem problem, json_t *document); /* takes document */
void bw_reply_text(bw_request *request, const char *media_type, const char *text, size_t size); /* text is static */
/* Takes fd. With an etag (a plain word) If-None-Match is honoured. */
void bw_reply_file(bw_request *request, int fd, uint64_t bytes, const char *media_type, const char *etag);
void bw_reply_header(bw_request *request, const char *name, const char *value); /* after a reply */

const char *bw_request_header(const bw_request *request, const char *name); /* NULL if absent */
const char *bw_request_query(const bw_request *request, const char *name);

#endif
