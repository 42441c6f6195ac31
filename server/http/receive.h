/* A body that becomes a blob: of blob_put, and of job_create if the input itself is sent. */
#ifndef BW_SERVER_HTTP_RECEIVE_H
#define BW_SERVER_HTTP_RECEIVE_H

#include "server/http/request.h"

/* For an operation's begin. These reply, and are false, if it cannot be taken; then no byte has been. */
bool bw_http_blob_sized(bw_request *request); /* it has a Content-Length, of at most max-upload */
/* Opens request->upload and has the body go there. `owned`: the caller has it already, so that it does not count towards his bytes again. */
bool bw_http_receive_blob(bw_request *request, bool owned);

/* For its handle: what has come is a durable blob and the caller's, or there is a reply. `sha256`: the hash that it must have, NULL: any.
 * Then `then` is called, which may ask bw_http_kept_blob(). Takes the request's state and resume. */
void bw_http_store_blob(bw_request *request, const char *sha256, void (*then)(bw_request *));

#endif
