/* The functions of bw_routes, by the file they are in. */
#ifndef BW_SERVER_HTTP_OPERATIONS_H
#define BW_SERVER_HTTP_OPERATIONS_H

#include "server/http/request.h"

/* blobs.c */
void bw_http_blob_begin(bw_request *request);
void bw_http_blob_put(bw_request *request);
void bw_http_blob_head(bw_request *request);

/* uploads.c */
void bw_http_upload_create_begin(bw_request *request);
void bw_http_upload_create(bw_request *request);
void bw_http_upload_options(bw_request *request);
void bw_http_upload_head(bw_request *request);
void bw_http_upload_patch_begin(bw_request *request);
void bw_http_upload_patch(bw_request *request);
void bw_http_upload_delete(bw_request *request);

/* job_create.c */
void bw_http_job_create_begin(bw_request *request);
void bw_http_job_create(bw_request *request);
void bw_http_batch_create_begin(bw_request *request);
void bw_http_batch_create(bw_request *request);
void bw_http_reply_too_many(bw_request *request, int64_t most); /* 429: jobs that wait or run */
void bw_http_reply_too_large(bw_request *request, int64_t most); /* 429: bytes of inputs */

/* jobs.c */
void bw_http_job_list(bw_request *request);
void bw_http_job_get(bw_request *request);
/* Reads the job that the path names, or replies. The caller clears it. */
bool bw_http_load_job(bw_request *request, bw_job *job);
/* Answers with the job `id` and `status` (with 201, Location too): at once, or when it has ended or the time is over if the client
 * prefers to wait. Takes the request's state and resume. */
void bw_http_answer_job(bw_request *request, unsigned status, const char *id);

void bw_http_reply_job(bw_request *request, const bw_job *job);      /* 200 */
void bw_http_reply_no_job(bw_request *request, const char *id);      /* 404, or 410 if it was deleted */

/* job_change.c */
void bw_http_job_cancel(bw_request *request);
void bw_http_job_finish(bw_request *request);
void bw_http_job_retry(bw_request *request);
void bw_http_job_pin(bw_request *request);
void bw_http_job_unpin(bw_request *request);
void bw_http_job_delete(bw_request *request);

/* events.c */
void bw_http_job_events(bw_request *request);
void bw_http_event_list(bw_request *request);

/* job_log.c */
void bw_http_job_log(bw_request *request);

/* results.c */
void bw_http_job_report(bw_request *request);
void bw_http_result_list(bw_request *request);
void bw_http_result_get(bw_request *request);

/* health.c */
void bw_http_capabilities(bw_request *request);
void bw_http_live(bw_request *request);
void bw_http_ready(bw_request *request);
void bw_http_metrics(bw_request *request);
void bw_http_openapi(bw_request *request);
void bw_http_page(bw_request *request);
void bw_http_page_file(bw_request *request);

#endif
