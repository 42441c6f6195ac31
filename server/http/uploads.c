/* Resumable uploads: tus 1.0.0 (https://tus.io/protocols/resumable-upload) with the extensions creation, creation-with-upload, checksum,
 * expiration and termination. An upload that is complete is a blob; Blockwright-Blob in the answer names it.
 *
 * Who works on an upload has taken it (partial.h) from the request's begin until its end, however that comes. What a connection that
 * breaks has sent stays, unless it was to be checked as a whole; the next HEAD makes it durable before it tells of it. */
#include "server/http/operations.h"

#include <errno.h>
#include <openssl/evp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "server/clock.h"
#include "server/http/access.h"
#include "server/http/content.h"
#include "server/http/reply.h"
#include "server/log.h"
#include "server/partial.h"

#define BW_TUS_VERSION "1.0.0"
enum { METADATA_MOST = 4096, VALUE_MOST = METADATA_MOST };
static const char media_type[] = "application/offset+octet-stream";

typedef struct {
    bw_partial *partial;                   /* taken */
    EVP_MD_CTX *checksum;                  /* of what this request brings; NULL: not asked for */
    unsigned char expected[EVP_MAX_MD_SIZE];
    size_t expected_size;
    bool whole;                            /* nothing is to be undone: the body has come to its end, or not begun */
    bw_status status;                      /* of the commit */
    char actual[BW_SHA256_TEXT];
} upload_state;

/* ---- answers ---- */

static void add_number(bw_request *r, const char *name, uint64_t value) {
    char text[24];
    snprintf(text, sizeof text, "%llu", (unsigned long long)value);
    bw_reply_header(r, name, text);
}

static void reply_empty(bw_request *r, unsigned status) {
    bw_reply_made(r, status, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT), NULL);
}

static void add_location(bw_request *r) {
    char text[64];
    snprintf(text, sizeof text, "/v1/uploads/%.24s", r->parameters[0]);
    bw_reply_header(r, "Location", text);
}

static bool speaks_our_version(bw_request *r) {
    const char *version = bw_request_header(r, "Tus-Resumable");
    if (version && strcmp(version, BW_TUS_VERSION) == 0) return true;
    bw_reply_problem(r, BW_PROBLEM_TUS_VERSION, "the header Tus-Resumable has to be " BW_TUS_VERSION);
    bw_reply_header(r, "Tus-Version", BW_TUS_VERSION);
    return false;
}

/* ---- headers ---- */

/* A header that is a whole number; false after a reply. */
static bool read_number(bw_request *r, const char *name, uint64_t *value) {
    const char *text = bw_request_header(r, name);
    char *end;
    errno = 0;
    *value = text ? strtoull(text, &end, 10) : 0;
    if (text && !errno && *text >= '0' && *text <= '9' && !*end && *value <= INT64_MAX) return true;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "the header %s has to be a whole number", name);
    return false;
}

/* The bytes of `text`, `size` letters of base64; -1 if it is none, or has more than `room`. */
static int read_base64(const char *text, size_t size, unsigned char *out, size_t room) {
    unsigned char raw[VALUE_MOST / 4 * 3 + 3];
    if (size % 4 || size > VALUE_MOST) return -1;
    int n = EVP_DecodeBlock(raw, (const unsigned char *)text, (int)size);
    for (size_t i = size; n > 0 && i > 0 && size - i < 2 && text[i - 1] == '='; i--) n--;
    if (n < 0 || (size_t)n > room) return -1;
    memcpy(out, raw, (size_t)n);
    return n;
}

/* A key of metadata: visible ASCII. */
static bool is_key(const char *text, size_t size) {
    for (size_t i = 0; i < size; i++)
        if (text[i] <= 0x20 || text[i] >= 0x7f) return false;
    return size > 0;
}

/* Upload-Metadata: "KEY BASE64,KEY BASE64,KEY". The value of the key sha256 is the hash that is expected. False: it is not of that form. */
static bool read_metadata(const char *text, char expected[BW_SHA256_TEXT]) {
    unsigned char value[VALUE_MOST];
    *expected = '\0';
    if (strlen(text) > METADATA_MOST) return false;
    for (;;) {
        size_t key = strcspn(text, " ,"), size = 0;
        const char *start = text + key;
        if (*start == ' ') start++, size = strcspn(start, ",");
        int n = read_base64(start, size, value, sizeof value);
        if (!is_key(text, key) || n < 0) return false;
        if (key == 6 && memcmp(text, "sha256", 6) == 0) {
            if (n != 64) return false;
            memcpy(expected, value, 64);
            expected[64] = '\0';
            if (!bw_is_sha256(expected)) return false;
        }
        text = start + size;
        if (!*text++) return true;
    }
}

/* Upload-Checksum: "ALGORITHM BASE64". False after a reply. */
static bool read_checksum(bw_request *r, upload_state *s) {
    const char *text = bw_request_header(r, "Upload-Checksum");
    if (!text) return true;
    size_t name = strcspn(text, " ");
    const EVP_MD *md = name == 6 && memcmp(text, "sha256", 6) == 0 ? EVP_sha256() : name == 4 && memcmp(text, "sha1", 4) == 0 ? EVP_sha1() : NULL;
    const char *value = text + name + (text[name] == ' ');
    int n = md ? read_base64(value, strlen(value), s->expected, sizeof s->expected) : -1;
    if (!md || n != EVP_MD_get_size(md)) {
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Upload-Checksum has to be sha256 or sha1, a blank, and the hash in base64");
        return false;
    }
    s->expected_size = (size_t)n;
    s->checksum = EVP_MD_CTX_new();
    if (s->checksum && EVP_DigestInit_ex(s->checksum, md, NULL) == 1) return true;
    bw_reply_json(r, 500, NULL);
    return false;
}

static bool has_body(const bw_request *r) { return r->length || bw_request_header(r, "Transfer-Encoding"); }

/* Is the body one of ours, and of at most `most` bytes? False after a reply. */
static bool check_body(bw_request *r, uint64_t most) {
    const char *type = bw_request_header(r, "Content-Type");
    if (!type || strcasecmp(type, media_type) != 0) bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_MEDIA_TYPE, "the body has to be %s", media_type);
    else if (r->unpacker) bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_CODING, "the body of an upload in parts is not coded");
    else if (r->length > most) bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "only %llu bytes are still to come", (unsigned long long)most);
    return !r->reply;
}

/* ---- the course of a request ---- */

static void let_go(void *state) {
    upload_state *s = state;
    bool undo = s->partial && s->checksum && !s->whole;
    if (undo && bw_partial_undo(s->partial) != BW_OK) bw_event(BW_WARN, "upload.undo", "upload=%s", bw_partial_id(s->partial));
    if (s->partial) bw_partial_release(s->partial);
    EVP_MD_CTX_free(s->checksum);
    free(s);
}

/* Before the answer goes out, for the client may come back as soon as it has it. */
static void drop_state(bw_request *r) {
    if (r->state) let_go(r->state);
    r->state = NULL;
    r->state_free = NULL;
}

static upload_state *new_state(bw_request *r) {
    upload_state *s = calloc(1, sizeof *s);
    if (!s) {
        bw_reply_json(r, 500, NULL);
        return NULL;
    }
    r->state = s;
    r->state_free = let_go;
    return s;
}

static bool take_bytes(bw_request *r, const char *data, size_t size) {
    upload_state *s = r->state;
    if (s->checksum && EVP_DigestUpdate(s->checksum, data, size) != 1) {
        bw_reply_json(r, 500, NULL);
        return false;
    }
    bw_status status = bw_partial_write(s->partial, data, size);
    if (status == BW_E_LIMIT) bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "that is more than the Upload-Length that was announced");
    else if (status == BW_OK && !bw_request_room_left(r, bw_partial_offset(s->partial), size))
        bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "the upload does not fit any more");
    else if (status != BW_OK) bw_reply_storage(r);
    if (r->reply) drop_state(r);
    return !r->reply;
}

/* Takes the upload that the path names, or replies. */
static bool take_upload(bw_request *r, upload_state *s) {
    bw_partial_found found = bw_partial_take(r->traffic->partials, r->parameters[0], r->caller.owner, bw_now_ms(), &s->partial);
    if (found == BW_PARTIAL_TAKEN) return true;
    if (found == BW_PARTIAL_FAILED) {
        bw_reply_storage(r);
    } else if (found == BW_PARTIAL_BUSY) {
        bw_reply_problem(r, BW_PROBLEM_UPLOAD_BUSY, "another request works on this upload");
        bw_reply_header(r, "Retry-After", "1");
    } else {
        bw_reply_problem(r, BW_PROBLEM_NO_SUCH_UPLOAD, "there is no upload '%.40s', or it has expired", r->parameters[0]);
    }
    return false;
}

static int64_t expiry(const bw_request *r) { return bw_now_ms() + (int64_t)r->services->config->upload_keep_seconds * 1000; }

static void commit(bw_request *r) {
    upload_state *s = r->state;
    s->status = bw_partial_commit(s->partial, expiry(r), s->actual);
    if (s->status != BW_E_CHECK) return;
    bw_partial_remove(s->partial);
    s->partial = NULL;
}

/* Headers of an answer about an upload that is complete, and a blob. */
static void add_complete(bw_request *r) {
    uint64_t bytes;
    const char *sha256 = bw_http_kept_blob(r, &bytes);
    add_number(r, "Upload-Offset", bytes);
    if (r->op == BW_OP_UPLOAD_HEAD) add_number(r, "Upload-Length", bytes);
    bw_reply_header(r, "Blockwright-Blob", sha256);
}

static void reply_complete(bw_request *r) {
    reply_empty(r, r->op == BW_OP_UPLOAD_CREATE ? 201 : r->op == BW_OP_UPLOAD_HEAD ? 200 : 204);
    if (r->op == BW_OP_UPLOAD_CREATE) add_location(r);
    if (r->op == BW_OP_UPLOAD_HEAD) bw_reply_header(r, "Cache-Control", "no-store");
    add_complete(r);
}

static void reply_partial(bw_request *r, const bw_partial *p) {
    char date[BW_HTTP_DATE];
    reply_empty(r, r->op == BW_OP_UPLOAD_CREATE ? 201 : r->op == BW_OP_UPLOAD_HEAD ? 200 : 204);
    if (r->op == BW_OP_UPLOAD_CREATE) add_location(r);
    if (r->op == BW_OP_UPLOAD_HEAD) {
        add_number(r, "Upload-Length", bw_partial_length(p));
        if (bw_partial_metadata(p)) bw_reply_header(r, "Upload-Metadata", bw_partial_metadata(p));
        bw_reply_header(r, "Cache-Control", "no-store");
    }
    add_number(r, "Upload-Offset", bw_partial_offset(p));
    bw_reply_header(r, "Upload-Expires", bw_http_date(bw_partial_expires(p), date));
}

/* All that is there is durable. A blob is booked as its owner's, then told; each time, for the daemon may have died in between. */
static void answer(bw_request *r) {
    upload_state *s = r->state;
    if (s->status == BW_E_CHECK) {
        bw_reply_problem(r, BW_PROBLEM_HASH_MISMATCH, "the upload has the SHA-256 %s; it is gone", s->actual);
    } else if (s->status != BW_OK) {
        bw_reply_storage(r);
    } else if (*bw_partial_blob(s->partial)) {
        char sha256[BW_SHA256_TEXT];
        uint64_t bytes = bw_partial_length(s->partial);
        snprintf(sha256, sizeof sha256, "%s", bw_partial_blob(s->partial));
        if (*s->actual) bw_event(BW_INFO, "upload.complete", "upload=%s sha256=%s bytes=%llu", r->parameters[0], sha256, (unsigned long long)bytes);
        drop_state(r);
        bw_http_keep_blob(r, sha256, bytes, reply_complete);
        return;
    } else {
        reply_partial(r, s->partial);
    }
    drop_state(r);
}

static bool checksum_fits(upload_state *s) {
    unsigned char raw[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    if (!s->checksum) return true;
    return EVP_DigestFinal_ex(s->checksum, raw, &size) == 1 && size == s->expected_size && memcmp(raw, s->expected, size) == 0;
}

static void finish_body(bw_request *r) {
    upload_state *s = r->state;
    if (!checksum_fits(s)) {
        bw_reply_problem(r, BW_PROBLEM_CHECKSUM_MISMATCH, "the bytes that came do not have the checksum that was announced; they are gone");
        drop_state(r); /* undoes them */
        return;
    }
    s->whole = true;
    bw_request_offload(r, commit, answer);
}

/* ---- the operations ---- */

/* Several requests at once may each find the last place free. */
static bool is_place_for(bw_request *r, uint64_t length) {
    const bw_config *config = r->services->config;
    bw_partial_tally tally;
    bw_partials_tally(r->traffic->partials, r->caller.owner, &tally);
    if (config->owner_uploads && tally.of_owner >= config->owner_uploads)
        bw_reply_problem(r, BW_PROBLEM_TOO_MANY_UPLOADS, "%d of this owner's uploads are under way already", tally.of_owner);
    else if (tally.uploads >= config->max_uploads) bw_reply_problem(r, BW_PROBLEM_TOO_MANY_UPLOADS, "%d uploads are under way already", tally.uploads);
    else return bw_http_blob_fits(r, tally.bytes_of_owner + length);
    bw_reply_header(r, "Retry-After", "60");
    return false;
}

static void create(bw_request *r, uint64_t length) {
    const char *metadata = bw_request_header(r, "Upload-Metadata");
    char expected[BW_SHA256_TEXT] = "";
    if (metadata && !read_metadata(metadata, expected)) {
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Upload-Metadata has to be keys with values in base64, with commas between, %d bytes at most; "
                "sha256 is the hash of the content in 64 digits 0-9 a-f", METADATA_MOST);
        return;
    }
    upload_state *s = new_state(r);
    if (!s || !read_checksum(r, s)) return;
    bw_partial_new wanted = {.owner = r->caller.owner, .length = length, .expected = expected, .metadata = metadata, .expires = expiry(r)};
    if (bw_partial_create(r->traffic->partials, &wanted, &s->partial) != BW_OK || bw_partial_mark(s->partial) != BW_OK) {
        bw_reply_storage(r);
    } else {
        snprintf(r->parameters[0], sizeof r->parameters[0], "%s", bw_partial_id(s->partial));
        r->take = take_bytes;
    }
}

void bw_http_upload_create_begin(bw_request *r) {
    const bw_services *services = r->services;
    uint64_t length, most = services->config->max_upload;
    if (!speaks_our_version(r)) return;
    if (bw_request_header(r, "Upload-Defer-Length")) bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "an upload has to say its Upload-Length at once");
    else if (!read_number(r, "Upload-Length", &length)) return;
    else if (length > most) bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "an upload has at most %llu bytes", (unsigned long long)most);
    else if (bw_store_room(services->store) < length + BW_ROOM_KEPT) bw_reply_problem(r, BW_PROBLEM_STORAGE_FULL, "an upload of %llu bytes does not fit any more", (unsigned long long)length);
    else if ((!has_body(r) || check_body(r, length)) && is_place_for(r, length)) create(r, length);
}

void bw_http_upload_create(bw_request *r) { finish_body(r); }

void bw_http_upload_patch_begin(bw_request *r) {
    uint64_t offset;
    if (!speaks_our_version(r) || !read_number(r, "Upload-Offset", &offset)) return;
    upload_state *s = new_state(r);
    if (!s || !take_upload(r, s)) return;
    uint64_t has = bw_partial_offset(s->partial);
    s->whole = true; /* so far: nothing to undo */
    if (offset != has) {
        bw_reply_problem(r, BW_PROBLEM_OFFSET_MISMATCH, "the upload has %llu bytes so far", (unsigned long long)has);
        add_number(r, "Upload-Offset", has);
    } else if (check_body(r, bw_partial_length(s->partial) - has) && read_checksum(r, s)) {
        if (bw_partial_mark(s->partial) != BW_OK) bw_reply_storage(r);
        s->whole = false;
        r->take = take_bytes;
    }
    if (r->reply) drop_state(r);
}

void bw_http_upload_patch(bw_request *r) { finish_body(r); }

void bw_http_upload_head(bw_request *r) {
    if (!speaks_our_version(r)) return;
    upload_state *s = new_state(r);
    if (!s || !take_upload(r, s)) return;
    s->whole = true;
    if (bw_partial_durable(s->partial)) answer(r);
    else bw_request_offload(r, commit, answer);
}

static void remove_upload(bw_request *r) {
    upload_state *s = r->state;
    bw_partial_remove(s->partial);
    s->partial = NULL;
}

static void removed(bw_request *r) {
    drop_state(r);
    reply_empty(r, 204);
}

void bw_http_upload_delete(bw_request *r) {
    if (!speaks_our_version(r)) return;
    upload_state *s = new_state(r);
    if (s && take_upload(r, s)) bw_request_offload(r, remove_upload, removed);
}

void bw_http_upload_options(bw_request *r) {
    reply_empty(r, 204);
    bw_reply_header(r, "Tus-Version", BW_TUS_VERSION);
    bw_reply_header(r, "Tus-Extension", "creation,creation-with-upload,checksum,expiration,termination");
    bw_reply_header(r, "Tus-Checksum-Algorithm", "sha256,sha1");
    add_number(r, "Tus-Max-Size", r->services->config->max_upload);
}
