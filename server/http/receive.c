#include "server/http/receive.h"

#include <stdlib.h>
#include <string.h>

#include "server/http/access.h"
#include "server/http/reply.h"

/* ---- before the body ---- */

static void reply_too_large(bw_request *r) {
    bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "an upload has at most %llu bytes", (unsigned long long)r->services->config->max_upload);
}

bool bw_http_blob_sized(bw_request *r) {
    if (!r->has_length) bw_reply_problem(r, BW_PROBLEM_LENGTH_REQUIRED, "an upload must say its Content-Length");
    else if (r->length > r->services->config->max_upload) reply_too_large(r);
    return !r->reply;
}

static bool take_bytes(bw_request *r, const char *data, size_t size) {
    uint64_t bytes = bw_upload_bytes(r->upload) + size;
    if (bytes > r->services->config->max_upload) reply_too_large(r); /* of a coded body */
    else if (!bw_request_room_left(r, bytes, size)) bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "the upload does not fit any more");
    else if (bw_upload_write(r->upload, data, size) != BW_OK) bw_reply_storage(r);
    return !r->reply;
}

bool bw_http_receive_blob(bw_request *r, bool owned) {
    bw_store *store = r->services->store;
    if (bw_store_room(store) < r->length + BW_ROOM_KEPT)
        bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "an upload of %llu bytes does not fit any more", (unsigned long long)r->length);
    else if ((owned || bw_http_blob_fits(r, r->length)) && bw_upload_begin(store, &r->upload) != BW_OK)
        bw_reply_storage(r);
    r->take = take_bytes;
    return !r->reply;
}

/* ---- after it ---- */

typedef struct {
    const char *sha256;
    uint64_t bytes;
    bw_status status;
    bool matches;
    char actual[BW_SHA256_TEXT];
    void (*then)(bw_request *);
} finishing;

static void finish(bw_request *r) {
    finishing *f = r->state;
    bw_upload *upload = r->upload;
    r->upload = NULL; /* finish frees it */
    f->status = bw_upload_finish(upload, f->sha256, &f->matches, f->actual);
}

static void finished(bw_request *r) {
    finishing f = *(finishing *)r->state;
    free(r->state);
    r->state = NULL;
    r->state_free = NULL;
    if (f.status != BW_OK) bw_reply_storage(r);
    else if (f.matches) bw_http_keep_blob(r, f.actual, f.bytes, f.then);
    else bw_reply_problem(r, BW_PROBLEM_HASH_MISMATCH, "the %llu bytes that came have the SHA-256 %s", (unsigned long long)f.bytes, f.actual);
}

void bw_http_store_blob(bw_request *r, const char *sha256, void (*then)(bw_request *)) {
    finishing *f = calloc(1, sizeof *f);
    if (!f) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    *f = (finishing){.sha256 = sha256, .bytes = bw_upload_bytes(r->upload), .then = then};
    r->state = f;
    r->state_free = free;
    bw_request_offload(r, finish, finished);
}
