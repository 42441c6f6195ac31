/* The HTTP side of the daemon, on libmicrohttpd: listening and its limits. A request's course is in request.h, the answers in reply.h,
 * which function does which operation of api/openapi.yaml in routes.c, what they do in one file per resource.
 */
#ifndef BW_SERVER_HTTP_H
#define BW_SERVER_HTTP_H

#include "server/access.h"
#include "server/config.h"
#include "server/dispatch/dispatch.h"
#include "server/health.h"
#include "server/queue/queue.h"
#include "server/store.h"
#include "server/watch.h"

typedef struct {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_access *access;
    bw_watch *watch;
    bw_dispatch *dispatch;
    bw_health *health;
} bw_services; /* all borrowed */

typedef struct bw_http bw_http;

/* Starts to listen. `address` gets "ADDRESS:PORT" as bound. */
bw_status bw_http_start(const bw_services *services, bw_http **http, char *address, size_t size);
/* Reads certificate and key again, if the daemon speaks TLS. The log tells what has become of it. */
void bw_http_reload(bw_http *http);
/* Takes no more connections, stops the watch so that nobody waits any longer, and lets what is under way be answered. Whoever owes a
 * bw_request_resume() must still be alive. */
void bw_http_stop(bw_http *http);

#endif
