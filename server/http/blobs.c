#include "server/http/operations.h"

#include <errno.h>
#include <unistd.h>

#include "server/http/access.h"
#include "server/http/content.h"
#include "server/http/receive.h"
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

void bw_http_blob_begin(bw_request *r) {
    uint64_t bytes;
    bool fresh = true;
    int fd = -1;
    if (!is_hash(r) || !bw_http_blob_sized(r)) return;
    if ((fd = bw_http_open_blob(r, r->parameters[0], &bytes, &fresh)) >= 0 && fresh) bw_reply_json(r, 200, blob_json(r->parameters[0], bytes));
    else bw_http_receive_blob(r, fd >= 0); /* also what is there, but may soon be collected: it comes anew, with a long time to live */
    if (fd >= 0) close(fd);
}

static void stored(bw_request *r) {
    uint64_t bytes;
    const char *sha256 = bw_http_kept_blob(r, &bytes);
    bw_event(BW_INFO, "blob.stored", "sha256=%s bytes=%llu", sha256, (unsigned long long)bytes);
    bw_reply_json(r, 201, blob_json(sha256, bytes));
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
    if (unpacked_fits(r)) bw_http_store_blob(r, r->parameters[0], stored);
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
