/* Answers to requests. The first one counts. Files, and all that has ranges and conditions: content.h. */
#ifndef BW_SERVER_HTTP_REPLY_H
#define BW_SERVER_HTTP_REPLY_H

#include "server/http/request.h"

#define BW_TUS_VERSION "1.0.0"

void bw_reply_json(bw_request *request, unsigned status, json_t *body); /* takes body; NULL: out of memory, 500 */
void bw_reply_problem(bw_request *request, bw_problem problem, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
void bw_reply_problem_json(bw_request *request, bw_problem problem, json_t *document); /* takes document */
void bw_reply_storage(bw_request *request); /* store or queue have failed; errno tells whether for lack of room */
void bw_reply_text(bw_request *request, const char *media_type, const char *text, size_t size); /* text is static; it gets an ETag */
/* Takes the response (NULL: out of memory). media_type may be NULL. */
void bw_reply_made(bw_request *request, unsigned status, struct MHD_Response *response, const char *media_type);
void bw_reply_nothing(bw_request *request); /* 204 */
void bw_reply_header(bw_request *request, const char *name, const char *value); /* after a reply */
/* For request.c: queues the reply, an internal error if there is none. */
enum MHD_Result bw_reply_send(bw_request *request);

#endif
