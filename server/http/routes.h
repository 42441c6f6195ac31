/* Which functions do which operation of api/openapi.yaml, and which operation a request is for. */
#ifndef BW_SERVER_HTTP_ROUTES_H
#define BW_SERVER_HTTP_ROUTES_H

#include "server/http/request.h"

typedef struct {
    void (*begin)(bw_request *request);  /* before the body; may be NULL */
    void (*handle)(bw_request *request); /* with the body; must reply or suspend */
} bw_route;

extern const bw_route bw_routes[BW_OP_COUNT];

/* Finds the operation and checks the names in the query; false after a reply (404, 405, 400). */
bool bw_route_find(bw_request *request, const char *method, const char *path);

#endif
