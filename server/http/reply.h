/* Answers to requests. The first one counts. */
#ifndef BW_SERVER_HTTP_REPLY_H
#define BW_SERVER_HTTP_REPLY_H

#include "server/http/request.h"

void bw_reply_json(bw_request *request, unsigned status, json_t *body); /* takes body; NULL: out of memory, 500 */
void bw_reply_problem(bw_request *request, bw_problem problem, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
void bw_reply_problem_json(bw_request *request, bw_problem problem, json_t *document); /* takes document */
void bw_reply_storage(bw_request *request); /* store or queue have failed; errno tells whether for lack of room */
void bw_reply_text(bw_request *request, const char *media_type, const char *text, size_t size); /* text is static */
/* Takes fd. With an etag (a plain word) If-None-Match is honoured. */
void bw_reply_file(bw_request *request, int fd, uint64_t bytes, const char *media_type, const char *etag);
void bw_reply_header(bw_request *request, const char *name, const char *value); /* after a reply */
/* For request.c: queues the reply, an internal error if there is none. */
enum MHD_Result bw_reply_send(bw_request *request);

#endif
