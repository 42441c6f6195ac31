/* A job as a client describes it (NewJob of api/openapi.yaml). */
#ifndef BW_SERVER_HTTP_JOB_READ_H
#define BW_SERVER_HTTP_JOB_READ_H

#include "server/http/request.h"

/* Fills what bw_submit needs but id, owner and created. `place` comes before every message ("" for a job alone). False after a
 * reply. The caller clears the job in both cases. */
bool bw_http_read_job(bw_request *request, json_t *body, const char *place, bw_job *job);
/* The same but for `input`, which is still to come. */
bool bw_http_read_description(bw_request *request, json_t *body, const char *place, bw_job *job);
/* The query as such a body without `input`, a new object; NULL after a reply. */
json_t *bw_http_query_job(bw_request *request);
bool bw_http_is_tag(const char *text);

#endif
