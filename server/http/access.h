/* Who makes a request, and whether he may.
 *
 * bw_http_check_access runs for every request, before its operation and before its body:
 *     on a daemon without tokens, is it meant for this host, and not made by a page of another site?   421, 403
 *     does it show a token that holds, if the operation wants one (`security` in api/openapi.yaml)?     401
 *     has the token the scope?                                                                          403
 *     if the path names a job, may the caller see it (404), and change it (403)?
 * So an operation on /v1/jobs/{id} needs no check of its own. What is not under a job's id asks here: lists, blobs, uploads.
 */
#ifndef BW_SERVER_HTTP_ACCESS_H
#define BW_SERVER_HTTP_ACCESS_H

#include "server/http/request.h"

/* Sets the request's caller; false after a reply. */
bool bw_http_check_access(bw_request *request);
/* After a wait: does the caller's token still hold? False after a reply. */
bool bw_http_check_again(bw_request *request);
enum { BW_CLIENT_TEXT = 46 };
/* The address of who asks: of the connection's other end, or if that is a proxy of `behind-proxy` what it says in X-Forwarded-For, as far back
 * as proxies are known. "-" if it cannot be said. */
const char *bw_http_client(bw_request *request, char text[BW_CLIENT_TEXT]);
/* Whose jobs are to be listed, by the query's `owner` and what the caller may see; NULL: everybody's. False after a reply. */
bool bw_http_owner_wanted(bw_request *request, const char **owner);
bool bw_http_has_blob(void *store, const char *sha256); /* for bw_submit */
/* Has the caller this blob? What others have uploaded is as if it were not there. A descriptor for reading, or -1: errno is
 * ENOENT if not, else it may have it. *fresh: it was uploaded or named so lately that it stays for half of keep-uploads, whatever comes. */
int bw_http_open_blob(const bw_request *request, const char *sha256, uint64_t *bytes, bool *fresh);
/* Has the caller room for so many bytes more (owner-bytes)? False after a reply. */
bool bw_http_blob_fits(bw_request *request, uint64_t bytes);
/* May the caller have one job more that waits or runs (owner-jobs)? False after a reply. */
bool bw_http_job_fits(bw_request *request);
/* Notes durably that the caller has the blob, which the store has already: suspends the request; `then` is called when that is done and
 * replies, unless it could not be done or is too much, which is replied here. Takes the request's state and resume. */
void bw_http_keep_blob(bw_request *request, const char *sha256, uint64_t bytes, void (*then)(bw_request *request));
/* In `then`: the blob. */
const char *bw_http_kept_blob(const bw_request *request, uint64_t *bytes);

#endif
