#include "format/vtu_data.h"

#include <limits.h>
#include <string.h>
#include <zlib.h>

#include "format/number.h"

enum { DEFLATE_MOST = 1032 }; /* bytes that a deflated byte can stand for */

/* Bytes out of raw or base64 text. Padding ends a group of four, not the text: header and data may be encoded
 * apart. */
typedef struct {
    bw_scan *scan;
    bw_vtu_coding coding;
    uint8_t group[3];
    int have, given; /* bytes of the group, and how many of them were handed out */
} source;

/* ---- base64 -------------------------------------------------------------------------------------------- */

static int digit_of(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' ? 62 : c == '/' ? 63 : -1;
}

static bw_status next_group(source *from) {
    bw_scan *s = from->scan;
    uint32_t bits = 0;
    int digits = 0, padding = 0;
    while (digits + padding < 4) {
        while (s->at < s->end && bw_is_blank(*s->at)) s->at++;
        if (s->at == s->end) return bw_scan_fail(s, BW_E_TRUNCATED, "the base64 data ends here");
        int value = *s->at == '=' ? -2 : digit_of(*s->at);
        if (value == -1 || (value >= 0 && padding) || (value == -2 && digits < 2))
            return bw_scan_fail(s, BW_E_SYNTAX, "this is not base64");
        s->at++;
        bits = bits << 6 | (uint32_t)(value < 0 ? 0 : value);
        if (value < 0)
            padding++;
        else
            digits++;
    }
    for (int i = 0; i < 3; i++) from->group[i] = (uint8_t)(bits >> (16 - 8 * i));
    from->have = digits - 1;
    from->given = 0;
    return BW_OK;
}

/* Upper bound of the bytes that are left. */
static uint64_t bytes_left(const source *from) {
    uint64_t left = bw_scan_left(from->scan);
    return from->coding.base64 ? left / 4 * 3 + 3 : left;
}

static bw_status take(source *from, void *to, size_t size) {
    bw_status status = BW_OK;
    if (!from->coding.base64) {
        const char *bytes = NULL;
        status = bw_scan_bytes(from->scan, size, &bytes);
        if (status == BW_OK && size) memcpy(to, bytes, size);
        return status;
    }
    uint8_t *out = to;
    for (size_t i = 0; i < size && status == BW_OK; i++) {
        while (from->given == from->have && status == BW_OK) status = next_group(from);
        if (status == BW_OK) out[i] = from->group[from->given++];
        if (i % (1 << 20) == 0 && status == BW_OK) status = bw_poll(from->scan->ctx);
    }
    return status;
}

static bw_status take_count(source *from, uint64_t *count) {
    uint8_t bytes[8] = {0};
    size_t size = from->coding.wide ? 8 : 4;
    bw_status status = take(from, bytes, size);
    *count = 0;
    for (size_t i = 0; i < size; i++) *count |= (uint64_t)bytes[from->coding.big ? size - 1 - i : i] << 8 * i;
    return status;
}

/* ---- blocks deflated by zlib --------------------------------------------------------------------------- */

static void *z_alloc(void *ctx, unsigned count, unsigned size) {
    return bw_alloc(ctx, count, size);
}
static void z_free(void *ctx, void *block) {
    bw_free(ctx, block);
}

static bw_status inflate_block(bw_scan *s, void *packed, uint64_t packed_size, void *out, uint64_t size) {
    bw_context *ctx = s->ctx;
    if (packed_size > UINT_MAX || size > UINT_MAX)
        return bw_scan_fail(s, BW_E_COUNT, "a deflated block of %llu bytes", (unsigned long long)size);
    z_stream z = {.zalloc = z_alloc,
                  .zfree = z_free,
                  .opaque = ctx,
                  .next_in = packed,
                  .avail_in = (unsigned)packed_size,
                  .next_out = out,
                  .avail_out = (unsigned)size};
    int result = inflateInit(&z);
    if (result != Z_OK)
        return ctx->error.status != BW_OK ? ctx->error.status
                                          : bw_fail(ctx, BW_E_INTERNAL, "zlib does not start");
    result = inflate(&z, Z_FINISH);
    bool whole = result == Z_STREAM_END && !z.avail_out;
    inflateEnd(&z);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    return whole ? BW_OK
                 : bw_scan_fail(s, BW_E_SYNTAX, "a deflated block is damaged, or not of the size announced");
}

/* number of blocks, size of a block, size of the last one (0: like the others), deflated size of each; then
 * the blocks */
typedef struct {
    uint64_t count, size, last, largest;
    uint64_t *packed;
} blocks;

static bw_status check_sizes(source *from, const blocks *b, uint64_t size) {
    uint64_t whole = b->last && b->count ? b->count - 1 : b->count, total;
    if (__builtin_mul_overflow(whole, b->size, &total) ||
        __builtin_add_overflow(total, b->count ? b->last : 0, &total) || total != size)
        return bw_scan_fail(
            from->scan, BW_E_COUNT,
            "the header of the deflated data does not announce the %llu bytes that are needed",
            (unsigned long long)size);
    if (size / DEFLATE_MOST > bytes_left(from))
        return bw_scan_fail(from->scan, BW_E_COUNT, "%llu bytes cannot be deflated in the %llu that are left",
                            (unsigned long long)size, (unsigned long long)bytes_left(from));
    return BW_OK;
}

static bw_status read_header(source *from, blocks *b, uint64_t size) {
    bw_status status = take_count(from, &b->count);
    if (status == BW_OK) status = take_count(from, &b->size);
    if (status == BW_OK) status = take_count(from, &b->last);
    if (status == BW_OK) status = check_sizes(from, b, size);
    if (status != BW_OK) return status;
    if (b->count > bytes_left(from) / (from->coding.wide ? 8 : 4))
        return bw_scan_fail(from->scan, BW_E_COUNT, "%llu blocks cannot be in the bytes that are left",
                            (unsigned long long)b->count);
    if (!(b->packed = bw_alloc(from->scan->ctx, b->count, sizeof *b->packed)))
        return from->scan->ctx->error.status;
    uint64_t total = 0;
    for (uint64_t i = 0; i < b->count && status == BW_OK; i++) {
        status = take_count(from, &b->packed[i]);
        if (b->packed[i] > b->largest) b->largest = b->packed[i];
        if (status == BW_OK &&
            (__builtin_add_overflow(total, b->packed[i], &total) || total > bytes_left(from)))
            status = bw_scan_fail(from->scan, BW_E_COUNT,
                                  "the deflated blocks cannot be in the bytes that are left");
    }
    return status;
}

static bw_status inflate_all(source *from, uint64_t size, uint8_t **out) {
    bw_context *ctx = from->scan->ctx;
    blocks b = {0};
    uint8_t *packed = NULL;
    bw_status status = read_header(from, &b, size);
    if (status == BW_OK && !(packed = bw_alloc(ctx, b.largest, 1))) status = ctx->error.status;
    if (status == BW_OK && !(*out = bw_alloc(ctx, size, 1))) status = ctx->error.status;
    for (uint64_t i = 0, at = 0; i < b.count && status == BW_OK; i++) {
        uint64_t part = i + 1 == b.count && b.last ? b.last : b.size;
        status = take(from, packed, b.packed[i]);
        if (i % 256 == 0 && status == BW_OK) status = bw_poll(ctx);
        if (status == BW_OK) status = inflate_block(from->scan, packed, b.packed[i], *out + at, part);
        at += part;
    }
    bw_free(ctx, packed), bw_free(ctx, b.packed);
    return status;
}

/* ---- both ---------------------------------------------------------------------------------------------- */

static bw_status copy_all(source *from, uint64_t size, uint8_t **out, const char **in_place) {
    uint64_t announced = 0;
    bw_scan *s = from->scan;
    bw_status status = take_count(from, &announced);
    if (status != BW_OK) return status;
    if (announced != size)
        return bw_scan_fail(s, BW_E_COUNT, "%llu bytes are announced where %llu are needed",
                            (unsigned long long)announced, (unsigned long long)size);
    if (size > bytes_left(from))
        return bw_scan_fail(s, BW_E_COUNT, "%llu bytes cannot be in the %llu that are left",
                            (unsigned long long)size, (unsigned long long)bytes_left(from));
    if (!from->coding.base64) return bw_scan_bytes(s, (size_t)size, in_place);
    if (!(*out = bw_alloc(s->ctx, (size_t)size, 1))) return s->ctx->error.status;
    return take(from, *out, (size_t)size);
}

bw_status bw_vtu_decode(bw_scan *s, bw_vtu_coding coding, uint64_t size, bw_scan *out, void **owned) {
    s->binary = true;
    source from = {.scan = s, .coding = coding};
    uint8_t *block = NULL;
    const char *bytes = NULL;
    bw_status status =
        coding.deflated ? inflate_all(&from, size, &block) : copy_all(&from, size, &block, &bytes);
    *owned = block;
    if (status != BW_OK) return status;
    *out = bw_scan_open(s->ctx, block ? (const char *)block : bytes, (size_t)size);
    out->binary = out->part = true;
    if (!block) out->base = s->base + (uint64_t)(bytes - s->data);
    return BW_OK;
}
