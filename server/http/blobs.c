#include "server/http/operations.h"

#include <errno.h>
#include <stdlib.h>
#include <unistd.h>

#include "server/http/access.h"
#include "server/http/content.h"
#include "server/http/reply.h"
#include "server/log.h"

static json_t *blob_json(const char *sha256, uint64_t bytes) {
    return json_pack("{s:s, s:I}", "sha256", sha256, "bytes", (json_int_t)bytes);
}

static bool is_hash(bw_request *r) {
    if (bw_is_sha256(r->parameters[0])) return true;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "'%.80s' is not a SHA-256: 64 digits 0-9 a-f", r->parameters[0]);
    return false;
}

static bool take_bytes(bw_request *r, const char *data, size_t size) {
    uint64_t bytes = bw_upload_bytes(r->upload) + size, most = r->services->config->max_upload;
    if (bytes > most) bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "an upload has at most %llu bytes", (unsigned long long)most);
    else if (!bw_request_room_left(r, bytes, size)) bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "the upload does not fit any more");
    else if (bw_upload_write(r->upload, data, size) != BW_OK) bw_reply_storage(r);
    return !r->reply;
}

void bw_http_blob_begin(bw_request *r) {
    const bw_services *s = r->services;
    uint64_t bytes;
    bool fresh = true;
    int fd = -1;
    if (!is_hash(r)) return;
    if (!r->has_length) {
        bw_reply_problem(r, BW_PROBLEM_LENGTH_REQUIRED, "an upload must say its Content-Length");
    } else if (r->length > s->config->max_upload) {
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "an upload has at most %llu bytes",
                         (unsigned long long)s->config->max_upload);
    } else if ((fd = bw_http_open_blob(r, r->parameters[0], &bytes, &fresh)) >= 0 && fresh) {
        close(fd);
        bw_reply_json(r, 200, blob_json(r->parameters[0], bytes));
    } else if (bw_store_room(s->store) < r->length + BW_ROOM_KEPT) {
        bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "an upload of %llu bytes does not fit any more",
                         (unsigned long long)r->length);
    } else if ((fd >= 0 || bw_http_blob_fits(r, r->length)) && bw_upload_begin(s->store, &r->upload) != BW_OK) {
        bw_reply_storage(r);
    } else {
        r->take = take_bytes; /* also of what is there, but may soon be collected: it comes anew, with a long time to live */
    }
    if (fd >= 0 && !fresh) close(fd);
}

static void stored(bw_request *r) {
    uint64_t bytes;
    const char *sha256 = bw_http_kept_blob(r, &bytes);
    bw_event(BW_INFO, "blob.stored", "sha256=%s bytes=%llu", sha256, (unsigned long long)bytes);
    bw_reply_json(r, 201, blob_json(sha256, bytes));
}

typedef struct {
    uint64_t bytes;
    bw_status status;
    bool matches;
    char actual[BW_SHA256_TEXT];
} finishing;

static void finish(bw_request *r) {
    finishing *f = r->state;
    bw_upload *upload = r->upload;
    r->upload = NULL; /* finish frees it */
    f->status = bw_upload_finish(upload, r->parameters[0], &f->matches, f->actual);
}

static void finished(bw_request *r) {
    finishing f = *(finishing *)r->state;
    free(r->state);
    r->state = NULL;
    r->state_free = NULL;
    if (f.status != BW_OK) bw_reply_storage(r);
    else if (f.matches) bw_http_keep_blob(r, f.actual, f.bytes, stored);
    else bw_reply_problem(r, BW_PROBLEM_HASH_MISMATCH, "the %llu bytes that came have the SHA-256 %s", (unsigned long long)f.bytes, f.actual);
}

/* Of a coded body the size is known only now. What its owner has already counts once. */
static bool unpacked_fits(bw_request *r) {
    uint64_t bytes;
    bool fresh;
    int fd = r->unpacker ? bw_http_open_blob(r, r->parameters[0], &bytes, &fresh) : -1;
    if (fd >= 0) close(fd);
    return !r->unpacker || fd >= 0 || bw_http_blob_fits(r, bw_upload_bytes(r->upload));
}

void bw_http_blob_put(bw_request *r) {
    if (!unpacked_fits(r)) return;
    finishing *f = calloc(1, sizeof *f);
    if (!f) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    f->bytes = bw_upload_bytes(r->upload);
    r->state = f;
    r->state_free = free;
    bw_request_offload(r, finish, finished);
}

static void reply_head(bw_request *r) {
    uint64_t bytes;
    bool fresh;
    int fd = bw_http_open_blob(r, r->parameters[0], &bytes, &fresh);
    if (fd < 0 && errno != ENOENT) bw_reply_storage(r);
    else if (fd < 0) bw_reply_problem(r, BW_PROBLEM_NO_SUCH_BLOB, "no blob %s has been uploaded", r->parameters[0]);
    else bw_reply_content(r, 200, &(bw_content){.fd = fd, .bytes = bytes, .media_type = "application/octet-stream", .sha256 = r->parameters[0]});
}

/* Who asks is about to name it: one that may soon be collected is noted as used. */
void bw_http_blob_head(bw_request *r) {
    uint64_t bytes;
    bool fresh;
    if (!is_hash(r)) return;
    int fd = bw_http_open_blob(r, r->parameters[0], &bytes, &fresh);
    if (fd >= 0) close(fd);
    if (fd >= 0 && !fresh) bw_http_keep_blob(r, r->parameters[0], bytes, reply_head);
    else reply_head(r);
}
