#include "server/http/content.h"

#include <errno.h>
#include <openssl/evp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <time.h>
#include <unistd.h>

#include "server/http/coding.h"
#include "server/http/reply.h"

enum { CODE_LEAST = 512, CHUNK = 65536, ETAG_TEXT = BW_SHA256_TEXT + 10 };

/* What a request wants of a content. */
typedef struct {
    bw_coding coding;
    char etag[ETAG_TEXT]; /* with its quotes; "" if there is none */
    bool partial;
    uint64_t first, size; /* of the part */
} selection;

static void drop(const bw_content *c) {
    if (c->fd >= 0) close(c->fd);
    if (c->owned) free((void *)c->data);
}

/* ---- conditions ---- */

/* Is the tag in the list, or is the list "*"? Weak tags count only in weak comparison (RFC 9110, 8.8.3.2). */
static bool tag_listed(const char *list, const char *tag, bool weakly) {
    while (*list) {
        list += strspn(list, ", \t");
        if (*list == '*') return true;
        bool weak = strncmp(list, "W/", 2) == 0;
        const char *open = weak ? list + 2 : list, *close = *open == '"' ? strchr(open + 1, '"') : NULL;
        if (!close) return false;
        size_t size = (size_t)(close + 1 - open);
        if ((weakly || !weak) && *tag && strlen(tag) == size && memcmp(open, tag, size) == 0) return true;
        list = close + 1;
    }
    return false;
}

/* Seconds since 1970 in one of the three forms of RFC 9110, 5.6.7; -1 for what is none. */
static int64_t read_date(const char *text) {
    static const char *const forms[] = {"%a, %d %b %Y %H:%M:%S GMT", "%A, %d-%b-%y %H:%M:%S GMT", "%a %b %e %H:%M:%S %Y"};
    for (size_t i = 0; i < sizeof forms / sizeof *forms; i++) {
        struct tm tm = {0};
        const char *end = strptime(text, forms[i], &tm);
        if (end && !*end) return (int64_t)timegm(&tm);
    }
    return -1;
}

const char *bw_http_date(int64_t ms, char text[BW_HTTP_DATE]) {
    struct tm tm;
    time_t seconds = (time_t)(ms / 1000);
    gmtime_r(&seconds, &tm);
    strftime(text, BW_HTTP_DATE, "%a, %d %b %Y %H:%M:%S GMT", &tm);
    return text;
}

/* Has it changed since the date? A date that cannot be read says nothing: `otherwise`. */
static bool changed_since(const bw_content *c, const char *date, bool otherwise) {
    int64_t since = read_date(date);
    return since < 0 || !c->modified ? otherwise : c->modified / 1000 > since;
}

/* The order of RFC 9110, 13.2.2. 200 to go on, 304 or 412. */
static unsigned check_conditions(bw_request *r, const bw_content *c, const char *etag) {
    const char *match = bw_request_list(r, "If-Match"), *none = bw_request_list(r, "If-None-Match");
    const char *unmodified = bw_request_header(r, "If-Unmodified-Since"), *since = bw_request_header(r, "If-Modified-Since");
    if (match ? !tag_listed(match, etag, false) : unmodified && changed_since(c, unmodified, false)) return 412;
    if (none ? tag_listed(none, etag, true) : since && !changed_since(c, since, true)) return 304;
    return 200;
}

/* ---- ranges ---- */

static bool read_number(const char **text, uint64_t *value) {
    char *end;
    if (**text < '0' || **text > '9') return false;
    errno = 0;
    *value = strtoull(*text, &end, 10);
    *text = end;
    return errno == 0;
}

typedef enum { RANGE_NONE, RANGE_GOOD, RANGE_OUTSIDE } range_kind;

/* bytes=FIRST-LAST, bytes=FIRST-, bytes=-SUFFIX. What is written otherwise, and more than one range, is none (RFC 9110, 14.2). */
static range_kind read_range(const char *text, uint64_t bytes, uint64_t *first, uint64_t *size) {
    uint64_t last = UINT64_MAX;
    if (strncasecmp(text, "bytes=", 6) != 0) return RANGE_NONE; /* any case: RFC 9110, 14.1 */
    text += 6;
    bool suffix = *text == '-';
    if (suffix ? (text++, !read_number(&text, size)) : !read_number(&text, first) || *text++ != '-') return RANGE_NONE;
    if (!suffix && *text && (!read_number(&text, &last) || last < *first)) return RANGE_NONE;
    if (*text) return RANGE_NONE;
    if (suffix) {
        if (*size > bytes) *size = bytes;
        *first = bytes - *size;
        return *size ? RANGE_GOOD : RANGE_OUTSIDE;
    }
    if (*first >= bytes) return RANGE_OUTSIDE;
    *size = (last < bytes ? last + 1 : bytes) - *first;
    return RANGE_GOOD;
}

/* If-Range: the part only of the very same content; a date is good only if it is exactly that of the content. */
static bool range_applies(const bw_request *r, const bw_content *c, const char *etag) {
    const char *condition = bw_request_header(r, "If-Range");
    if (!condition) return true;
    if (*condition == '"' || strncmp(condition, "W/", 2) == 0) return tag_listed(condition, etag, false);
    return c->modified && read_date(condition) == c->modified / 1000;
}

/* ---- coded replies ---- */

typedef struct {
    bw_content content;
    bw_packer *packer;
    uint64_t taken; /* of the content, into `in` */
    const char *at; /* what is left in `in`, or of content.data */
    size_t left;
    bool done;
    uint64_t *sent; /* of the request, which outlives the reply's reader */
    char in[CHUNK];
} coded;

static bool refill(coded *s) {
    uint64_t rest = s->content.bytes - s->taken;
    if (s->left || !rest) return true;
    if (s->content.fd < 0) {
        s->at = s->content.data;
        s->left = (size_t)rest;
    } else {
        ssize_t n = pread(s->content.fd, s->in, rest < CHUNK ? (size_t)rest : CHUNK, (off_t)(s->content.offset + s->taken));
        if (n <= 0) return false;
        s->at = s->in;
        s->left = (size_t)n;
    }
    s->taken += s->left;
    return true;
}

static ssize_t read_coded(void *user, uint64_t at, char *out, size_t room) {
    coded *s = user;
    size_t written = 0;
    (void)at;
    while (!written && !s->done) {
        if (!refill(s)) return MHD_CONTENT_READER_END_WITH_ERROR;
        if (bw_pack(s->packer, &s->at, &s->left, s->taken == s->content.bytes, out, room, &written, &s->done) != BW_OK)
            return MHD_CONTENT_READER_END_WITH_ERROR;
    }
    *s->sent += written;
    return written ? (ssize_t)written : MHD_CONTENT_READER_END_OF_STREAM;
}

static void free_coded(void *user) {
    coded *s = user;
    drop(&s->content);
    bw_packer_free(s->packer);
    free(s);
}

static struct MHD_Response *make_coded(bw_request *r, const bw_content *c, bw_coding coding) {
    coded *s = calloc(1, sizeof *s);
    bw_packer *packer = s ? bw_packer_new(coding, c->bytes) : NULL;
    if (!packer) {
        free(s);
        drop(c);
        return NULL;
    }
    s->content = *c;
    s->packer = packer;
    s->sent = &r->sent;
    struct MHD_Response *response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, CHUNK, read_coded, s, free_coded);
    if (!response) free_coded(s);
    return response;
}

/* ---- all together ---- */

static struct MHD_Response *make_plain(const bw_content *c, uint64_t first, uint64_t size) {
    struct MHD_Response *response;
    if (c->fd >= 0) {
        response = MHD_create_response_from_fd_at_offset64(size, c->fd, c->offset + first);
        if (!response) close(c->fd);
        return response;
    }
    bool whole = size == c->bytes;
    enum MHD_ResponseMemoryMode mode = !c->owned ? MHD_RESPMEM_PERSISTENT : whole ? MHD_RESPMEM_MUST_FREE : MHD_RESPMEM_MUST_COPY;
    response = MHD_create_response_from_buffer((size_t)size, (char *)c->data + first, mode);
    if (c->owned && (!whole || !response)) free((void *)c->data);
    return response;
}

/* Documents made for this one answer have no parts. */
static bool has_parts(const bw_content *c) { return c->fd >= 0 || c->sha256; }

static void select_part(bw_request *r, unsigned status, const bw_content *c, selection *s, range_kind *kind) {
    const char *range = status == 200 && !r->head && has_parts(c) ? bw_request_header(r, "Range") : NULL;
    bool codable = c->bytes >= CODE_LEAST && bw_coding_helps(c->media_type);
    s->coding = codable && !range ? bw_coding_accepted(bw_request_list(r, "Accept-Encoding")) : BW_CODING_IDENTITY;
    if (c->sha256)
        snprintf(s->etag, sizeof s->etag, "\"%.64s%s%s\"", c->sha256, s->coding ? "-" : "", s->coding ? bw_coding_names[s->coding] : "");
    s->size = c->bytes;
    *kind = range && range_applies(r, c, s->etag) ? read_range(range, c->bytes, &s->first, &s->size) : RANGE_NONE;
    if (*kind == RANGE_NONE) s->first = 0, s->size = c->bytes;
    s->partial = *kind == RANGE_GOOD;
}

/* Repr-Digest (RFC 9530) of content that is not coded. */
static void add_digest(bw_request *r, const char *sha256) {
    unsigned char raw[32], text[48];
    char value[64];
    for (int i = 0; i < 32; i++) {
        unsigned byte;
        sscanf(sha256 + 2 * i, "%2x", &byte);
        raw[i] = (unsigned char)byte;
    }
    EVP_EncodeBlock(text, raw, sizeof raw);
    snprintf(value, sizeof value, "sha-256=:%s:", (const char *)text);
    bw_reply_header(r, "Repr-Digest", value);
}

static void add_validators(bw_request *r, const bw_content *c, const selection *s) {
    char text[BW_HTTP_DATE];
    if (*s->etag) bw_reply_header(r, "ETag", s->etag);
    if (c->modified) bw_reply_header(r, "Last-Modified", bw_http_date(c->modified, text));
    if (bw_coding_helps(c->media_type)) bw_reply_header(r, "Vary", "Accept-Encoding");
}

static void add_headers(bw_request *r, const bw_content *c, const selection *s) {
    char text[80];
    add_validators(r, c, s);
    if (s->coding) bw_reply_header(r, "Content-Encoding", bw_coding_names[s->coding]);
    else if (has_parts(c)) bw_reply_header(r, "Accept-Ranges", "bytes");
    if (s->partial) {
        snprintf(text, sizeof text, "bytes %llu-%llu/%llu", (unsigned long long)s->first, (unsigned long long)(s->first + s->size - 1),
                 (unsigned long long)c->bytes);
        bw_reply_header(r, "Content-Range", text);
    }
}

static void refuse_range(bw_request *r, uint64_t bytes) {
    char text[40];
    bw_reply_problem(r, BW_PROBLEM_RANGE_NOT_SATISFIABLE, "there are only %llu bytes", (unsigned long long)bytes);
    snprintf(text, sizeof text, "bytes */%llu", (unsigned long long)bytes);
    bw_reply_header(r, "Content-Range", text);
}

void bw_reply_content(bw_request *r, unsigned status, const bw_content *c) {
    selection s = {0};
    range_kind range;
    if (r->reply) {
        drop(c);
        return;
    }
    select_part(r, status, c, &s, &range);
    unsigned verdict = status == 200 && r->reads ? check_conditions(r, c, s.etag) : 200;
    if (verdict != 200 || range == RANGE_OUTSIDE || r->reply) drop(c);
    if (r->reply) return; /* out of memory */
    if (verdict == 412) {
        bw_reply_problem(r, BW_PROBLEM_PRECONDITION_FAILED, "it is not the one that you know");
    } else if (verdict == 304) {
        bw_reply_made(r, 304, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT), NULL);
        add_validators(r, c, &s);
    } else if (range == RANGE_OUTSIDE) {
        refuse_range(r, c->bytes);
    } else {
        bw_reply_made(r, s.partial ? 206 : status, s.coding ? make_coded(r, c, s.coding) : make_plain(c, s.first, s.size), c->media_type);
        add_headers(r, c, &s);
        r->sized = true;
        r->reply_bytes = s.size;
        if (!s.coding && !r->head) r->sent = s.size;
        if (c->sha256 && !s.coding) add_digest(r, c->sha256);
    }
}
