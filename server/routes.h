/* What the operations of api/openapi.yaml do: one function per operationId, found over bw_routes. */
#ifndef BW_SERVER_ROUTES_H
#define BW_SERVER_ROUTES_H

#include "server/http.h"

typedef struct {
    void (*begin)(bw_request *request);  /* before the body; may be NULL */
    void (*handle)(bw_request *request); /* with the body; must reply */
} bw_route;

extern const bw_route bw_routes[BW_OP_COUNT];

#endif
