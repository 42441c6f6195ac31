#include "server/http/coding.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <zlib.h>
#include <zstd.h>

enum { GZIP_LEVEL = 5, GZIP_WINDOW = 15 + 16, GZIP_MEMORY = 8, ZSTD_LEVEL = 3, ZSTD_WINDOW_OUT = 18, ZSTD_WINDOW_IN = 23 };

const char *const bw_coding_names[BW_CODING_COUNT] = {"identity", "gzip", "zstd"};

/* ---- which ---- */

static bool is_word(const char *word, const char *text, size_t size) {
    return strlen(word) == size && strncasecmp(word, text, size) == 0;
}

/* The weight in "CODING;q=0.5", in thousandths; 1000 without one, 0 for one that is no number (RFC 9110, 12.4.2). */
static int weight_of(const char *parameters, const char *end) {
    while (parameters < end && strchr("; \t", *parameters)) parameters++;
    if (parameters >= end) return 1000;
    if (end - parameters < 2 || (*parameters != 'q' && *parameters != 'Q') || parameters[1] != '=') return 1000;
    parameters += 2;
    int weight = *parameters == '1' ? 1000 : 0, digit = 100;
    if (*parameters != '0' && *parameters != '1') return 0;
    if (weight == 1000 || ++parameters >= end || *parameters != '.') return weight;
    while (++parameters < end && *parameters >= '0' && *parameters <= '9' && digit) {
        weight += digit * (*parameters - '0');
        digit /= 10;
    }
    return weight;
}

/* The weight that `accept` gives the coding; -1 if it does not mention it. */
static int weight_in(const char *accept, const char *coding) {
    int any = -1;
    while (*accept) {
        accept += strspn(accept, ", \t");
        const char *end = accept + strcspn(accept, ",");
        size_t name = strcspn(accept, ",; \t");
        if (is_word(coding, accept, name)) return weight_of(accept + name, end);
        if (is_word("*", accept, name)) any = weight_of(accept + name, end);
        accept = end;
    }
    return any;
}

bw_coding bw_coding_accepted(const char *accept) {
    if (!accept) return BW_CODING_IDENTITY;
    int identity = weight_in(accept, "identity"), best = 0;
    bw_coding coding = BW_CODING_IDENTITY;
    for (int c = BW_CODING_COUNT - 1; c > BW_CODING_IDENTITY; c--) {
        int weight = weight_in(accept, bw_coding_names[c]);
        if (weight > best) best = weight, coding = (bw_coding)c;
    }
    return identity > best ? BW_CODING_IDENTITY : coding;
}

bool bw_coding_find(const char *name, bw_coding *coding) {
    size_t size = strcspn(name, " \t");
    if (name[size + strspn(name + size, " \t")]) return false;
    for (int c = 0; c < BW_CODING_COUNT; c++)
        if (is_word(bw_coding_names[c], name, size)) {
            *coding = (bw_coding)c;
            return true;
        }
    *coding = BW_CODING_GZIP;
    return is_word("x-gzip", name, size);
}

bool bw_coding_helps(const char *media_type) {
    static const char *const types[] = {"application/json", "application/problem+json", "application/xml", "image/svg+xml"};
    size_t size = strcspn(media_type, "; ");
    if (strncmp(media_type, "text/", 5) == 0) return true;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (is_word(types[i], media_type, size)) return true;
    return false;
}

/* ---- out ---- */

struct bw_packer {
    z_stream gzip;
    bool has_gzip;
    ZSTD_CCtx *zstd;
};

bw_packer *bw_packer_new(bw_coding coding, uint64_t bytes) {
    bw_packer *p = calloc(1, sizeof *p);
    if (!p) return NULL;
    if (coding == BW_CODING_GZIP) {
        p->has_gzip = deflateInit2(&p->gzip, GZIP_LEVEL, Z_DEFLATED, GZIP_WINDOW, GZIP_MEMORY, Z_DEFAULT_STRATEGY) == Z_OK;
    } else if ((p->zstd = ZSTD_createCCtx())) {
        ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_compressionLevel, ZSTD_LEVEL);
        ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_windowLog, ZSTD_WINDOW_OUT);
        ZSTD_CCtx_setParameter(p->zstd, ZSTD_c_checksumFlag, 1);
        ZSTD_CCtx_setPledgedSrcSize(p->zstd, bytes);
    }
    if (p->has_gzip || p->zstd) return p;
    free(p);
    return NULL;
}

void bw_packer_free(bw_packer *p) {
    if (!p) return;
    if (p->has_gzip) deflateEnd(&p->gzip);
    ZSTD_freeCCtx(p->zstd);
    free(p);
}

static bw_status pack_gzip(z_stream *z, const char **data, size_t *size, bool last, char *out, size_t room, size_t *written, bool *done) {
    z->next_in = (Bytef *)*data;
    z->avail_in = (uInt)*size;
    z->next_out = (Bytef *)out;
    z->avail_out = (uInt)(room < BW_UNPACK_PIECE ? room : BW_UNPACK_PIECE);
    uInt given = z->avail_out;
    int code = deflate(z, last ? Z_FINISH : Z_NO_FLUSH);
    *data = (const char *)z->next_in;
    *size = z->avail_in;
    *written = given - z->avail_out;
    *done = code == Z_STREAM_END;
    return code == Z_OK || code == Z_STREAM_END || code == Z_BUF_ERROR ? BW_OK : BW_E_INTERNAL;
}

bw_status bw_pack(bw_packer *p, const char **data, size_t *size, bool last, char *out, size_t room, size_t *written, bool *done) {
    if (p->has_gzip) return pack_gzip(&p->gzip, data, size, last, out, room, written, done);
    ZSTD_inBuffer from = {*data, *size, 0};
    ZSTD_outBuffer to = {out, room, 0};
    size_t left = ZSTD_compressStream2(p->zstd, &to, &from, last ? ZSTD_e_end : ZSTD_e_continue);
    *data += from.pos;
    *size -= from.pos;
    *written = to.pos;
    *done = last && left == 0;
    return ZSTD_isError(left) ? BW_E_INTERNAL : BW_OK;
}

/* ---- in ---- */

struct bw_unpacker {
    z_stream gzip;
    bool has_gzip, complete;
    ZSTD_DCtx *zstd;
    char piece[BW_UNPACK_PIECE];
};

bw_unpacker *bw_unpacker_new(bw_coding coding) {
    bw_unpacker *u = calloc(1, sizeof *u);
    if (!u) return NULL;
    if (coding == BW_CODING_GZIP) u->has_gzip = inflateInit2(&u->gzip, GZIP_WINDOW) == Z_OK;
    else if ((u->zstd = ZSTD_createDCtx())) ZSTD_DCtx_setParameter(u->zstd, ZSTD_d_windowLogMax, ZSTD_WINDOW_IN);
    if (u->has_gzip || u->zstd) return u;
    free(u);
    return NULL;
}

void bw_unpacker_free(bw_unpacker *u) {
    if (!u) return;
    if (u->has_gzip) inflateEnd(&u->gzip);
    ZSTD_freeDCtx(u->zstd);
    free(u);
}

/* Several members one after another are as good as one (RFC 1952, 2.2). */
static bw_status unpack_gzip(bw_unpacker *u, const char *data, size_t size, bw_unpack_sink sink, void *user) {
    z_stream *z = &u->gzip;
    z->next_in = (Bytef *)data;
    z->avail_in = (uInt)size;
    do {
        if (u->complete && inflateReset(z) != Z_OK) return BW_E_INTERNAL;
        z->next_out = (Bytef *)u->piece;
        z->avail_out = sizeof u->piece;
        int code = inflate(z, Z_NO_FLUSH);
        if (code != Z_OK && code != Z_STREAM_END && code != Z_BUF_ERROR) return code == Z_MEM_ERROR ? BW_E_MEMORY : BW_E_SYNTAX;
        u->complete = code == Z_STREAM_END;
        size_t got = sizeof u->piece - z->avail_out;
        if (got && !sink(user, u->piece, got)) return BW_E_LIMIT;
    } while (z->avail_in || (!u->complete && z->avail_out == 0));
    return BW_OK;
}

static bw_status unpack_zstd(bw_unpacker *u, const char *data, size_t size, bw_unpack_sink sink, void *user) {
    ZSTD_inBuffer from = {data, size, 0};
    bool full = false;
    while (from.pos < from.size || full) {
        ZSTD_outBuffer to = {u->piece, sizeof u->piece, 0};
        size_t left = ZSTD_decompressStream(u->zstd, &to, &from);
        if (ZSTD_isError(left)) return BW_E_SYNTAX;
        if (to.pos && !sink(user, u->piece, to.pos)) return BW_E_LIMIT;
        u->complete = left == 0;
        full = to.pos == to.size && left != 0;
    }
    return BW_OK;
}

bw_status bw_unpack(bw_unpacker *u, const char *data, size_t size, bw_unpack_sink sink, void *user) {
    if (!size) return BW_OK;
    return u->has_gzip ? unpack_gzip(u, data, size, sink, user) : unpack_zstd(u, data, size, sink, user);
}

bool bw_unpacker_complete(const bw_unpacker *u) { return u->complete; }
