#include "format/hex_bwh.h"

#include <float.h>
#include <math.h>
#include <string.h>
#include <zlib.h>

#include "hex/grid.h"
#include "format/output.h"

_Static_assert(FLT_EVAL_METHOD == 0, "predictions are sums of doubles, rounded after each step");
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "structures are written as they are");

/* A growable list of numbers. */
typedef struct {
    uint32_t *item;
    size_t count, room;
} numbers;

typedef struct {
    bw_context *ctx;
    const bw_hex_mesh *mesh;
    bw_hex_groups blocks;
    bw_bwh_part *part;   /* [group] */
    uint8_t *uses;       /* [vertex] hexes it is in; 255: that many or more */
    int32_t *number;     /* [vertex] its new number, or -1 */
    bw_hvertex *vertex;  /* [number] */
    size_t numbered;
    bw_hvertex *grid;    /* [point] of the block at hand: x fastest */
    size_t grid_room;
    numbers glue, corners;
    uint8_t *plane[24];  /* [8 * axis + byte] */
} encoder;

/* ---- a block as a grid of vertices --------------------------------------------------------------------------------- */

/* Fills the grid; false if a part is to be listed hex by hex: no grid, or a point inside is met by others too. */
static bool fill_grid(encoder *e, size_t g, const uint32_t n[3]) {
    if (!bw_hex_grid_fill(e->mesh, &e->blocks, g, n, e->grid)) return false;
    for (uint32_t z = 1; z < n[2]; z++)
        for (uint32_t y = 1; y < n[1]; y++)
            for (uint32_t x = 1; x < n[0]; x++)
                if (e->uses[e->grid[bw_hex_grid_point(n, x, y, z)]] != 8) return false;
    return true;
}

static bw_status make_room(encoder *e, const uint32_t n[3]) {
    size_t points = bw_hex_grid_points(n);
    if (points <= e->grid_room) return BW_OK;
    bw_free(e->ctx, e->grid);
    e->grid_room = 0;
    e->grid = bw_alloc(e->ctx, points, sizeof *e->grid);
    if (e->grid) e->grid_room = points;
    return e->grid ? BW_OK : e->ctx->error.status;
}

/* ---- coordinates --------------------------------------------------------------------------------------------------- */

/* Doubles in their order as unsigned integers. */
static uint64_t ordered(double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits >> 63 ? ~bits : bits | (uint64_t)1 << 63;
}

/* near[m]: the neighbour at the low end of the axes in m, for all subsets m of `axes`; what a product of functions of one axis each would be. Only sums,
 * in this order: every machine gets the same bits. */
static double predict(const double *const near[8], unsigned axes, int k) {
    double p = 0;
    switch (axes) {
    case 0: return 0;
    case 1:
    case 2:
    case 4: p = near[axes][k]; break;
    case 3: p = near[1][k] + near[2][k] - near[3][k]; break;
    case 5: p = near[1][k] + near[4][k] - near[5][k]; break;
    case 6: p = near[2][k] + near[4][k] - near[6][k]; break;
    default: p = near[1][k] + near[2][k] + near[4][k] - near[3][k] - near[5][k] - near[6][k] + near[7][k]; break;
    }
    return isfinite(p) ? p : 0;
}

/* Gives v the next number, and its coordinates to the planes. axes 0: predicted by the vertex before it. */
static void take_vertex(encoder *e, bw_hvertex v, const double *const near[8], unsigned axes) {
    size_t at = e->numbered++;
    e->number[v] = (int32_t)at, e->vertex[at] = v;
    for (int k = 0; k < 3; k++) {
        double p = axes ? predict(near, axes, k) : at ? e->mesh->position[e->vertex[at - 1]][k] : 0;
        uint64_t d = ordered(e->mesh->position[v][k]) - ordered(p);
        uint64_t code = d << 1 ^ (d >> 63 ? ~(uint64_t)0 : 0);
        for (int b = 0; b < 8; b++) e->plane[8 * k + b][at] = (uint8_t)(code >> (56 - 8 * b));
    }
}

/* ---- connectivity -------------------------------------------------------------------------------------------------- */

static bw_status push(encoder *e, numbers *list, uint32_t value) {
    bw_status status = bw_reserve(e->ctx, &list->item, &list->room, list->count + 1);
    if (status == BW_OK) list->item[list->count++] = value;
    return status;
}

/* What number a point on the outside of a block would have if numbers went on as they do beside it: along a face as an affine function, else one more than the last
 * that was guessed at. */
static int64_t guess(const encoder *e, const uint32_t n[3], const uint32_t x[3], int64_t last) {
    const size_t step[3] = {1, n[0] + 1, (size_t)(n[0] + 1) * (n[1] + 1)};
    const bw_hvertex *p = e->grid + bw_hex_grid_point(n, x[0], x[1], x[2]);
    int inside[3], count = 0;
    for (int k = 0; k < 3; k++)
        if (x[k] > 0 && x[k] < n[k]) inside[count++] = k;
    int64_t to = last + 1;
    if (count == 2 && x[inside[0]] >= 2 && x[inside[1]] >= 2) {
        size_t a = step[inside[0]], b = step[inside[1]];
        to = (int64_t)e->number[*(p - a)] + e->number[*(p - b)] - e->number[*(p - a - b)];
    } else {
        for (int i = count; i-- > 0;)
            if (x[inside[i]] >= 3) to = 2 * (int64_t)e->number[*(p - step[inside[i]])] - e->number[*(p - 2 * step[inside[i]])];
    }
    return to < 0 ? 0 : to >= (int64_t)e->numbered ? (int64_t)e->numbered - 1 : to;
}

static bw_status take_point(encoder *e, const uint32_t n[3], const uint32_t x[3], int64_t *last) {
    const size_t step[3] = {1, n[0] + 1, (size_t)(n[0] + 1) * (n[1] + 1)};
    const bw_hvertex *p = e->grid + bw_hex_grid_point(n, x[0], x[1], x[2]);
    bool fresh = e->number[*p] < 0, outside = false;
    for (int k = 0; k < 3; k++) outside |= x[k] == 0 || x[k] == n[k];
    if (outside) {
        int64_t d = fresh ? 0 : e->number[*p] - guess(e, n, x, *last);
        bw_status status = push(e, &e->glue, fresh ? 0 : 1 + (uint32_t)(d < 0 ? -2 * d - 1 : 2 * d));
        if (status != BW_OK) return status;
        if (!fresh) *last = e->number[*p];
    }
    if (!fresh) return BW_OK;
    const double *near[8] = {0};
    unsigned axes = 0;
    for (int k = 0; k < 3; k++) axes |= x[k] ? 1u << k : 0;
    for (unsigned m = 1; m < 8; m++)
        if ((m & axes) == m) near[m] = e->mesh->position[*(p - (m & 1 ? step[0] : 0) - (m & 2 ? step[1] : 0) - (m & 4 ? step[2] : 0))];
    take_vertex(e, *p, near, axes);
    return BW_OK;
}

static bw_status take_block(encoder *e, const uint32_t n[3]) {
    bw_status status = BW_OK;
    int64_t last = -1;
    uint32_t x[3];
    for (x[2] = 0; x[2] <= n[2] && status == BW_OK; x[2]++)
        for (x[1] = 0; x[1] <= n[1]; x[1]++)
            for (x[0] = 0; x[0] <= n[0] && status == BW_OK; x[0]++) status = take_point(e, n, x, &last);
    return status;
}

/* A hex by itself: a corner is 0 if it is new, else how far back its number is. Of its neighbours within the hex the lower ones are known. */
static bw_status take_hex(encoder *e, const bw_hvertex hex[8]) {
    bw_status status = BW_OK;
    for (unsigned c = 0; c < 8 && status == BW_OK; c++) {
        bool fresh = e->number[hex[c]] < 0;
        status = push(e, &e->corners, fresh ? 0 : (uint32_t)(e->numbered - (size_t)e->number[hex[c]]));
        if (!fresh || status != BW_OK) continue;
        const double *near[8] = {0};
        for (unsigned m = 1; m < 8; m++)
            if ((m & c) == m) near[m] = e->mesh->position[hex[c ^ m]];
        take_vertex(e, hex[c], near, c);
    }
    return status;
}

static bw_status take_part(encoder *e, size_t g) {
    bw_bwh_part *part = &e->part[g];
    size_t from = e->blocks.begin[g], to = e->blocks.begin[g + 1];
    uint32_t n[3];
    part->block = e->blocks.key[g];
    if (bw_hex_grid_measure(e->mesh, &e->blocks, g, n)) {
        bw_status status = make_room(e, n);
        if (status != BW_OK) return status;
        if (fill_grid(e, g, n)) {
            memcpy(part->n, n, sizeof n);
            return take_block(e, n);
        }
    }
    part->n[0] = (uint32_t)(to - from);
    bw_status status = BW_OK;
    for (size_t i = from; i < to && status == BW_OK; i++) status = take_hex(e, e->mesh->hex[e->blocks.item[i]]);
    return status;
}

/* ---- streams ------------------------------------------------------------------------------------------------------- */

static voidpf take_memory(voidpf ctx, uInt count, uInt size) {
    return bw_alloc(ctx, count, size);
}
static void give_memory(voidpf ctx, voidpf block) {
    bw_free(ctx, block);
}

/* *stored: bytes of the zlib stream, in `to`; 0 if it would not be smaller than raw. */
static bw_status squeeze(encoder *e, const uint8_t *from, size_t size, uint8_t *to, uint64_t *stored) {
    z_stream z = {.zalloc = take_memory, .zfree = give_memory, .opaque = e->ctx, .next_in = (Bytef *)from, .next_out = to};
    *stored = 0;
    if (deflateInit(&z, 6) != Z_OK) return bw_fail(e->ctx, BW_E_MEMORY, "no memory for a compressor");
    size_t left_in = size, left_out = size;
    int result = Z_OK;
    while (result == Z_OK && (left_out || z.avail_out)) {
        enum { STEP = 1 << 30 };
        if (!z.avail_in) z.avail_in = (uInt)(left_in < STEP ? left_in : STEP), left_in -= z.avail_in;
        if (!z.avail_out) z.avail_out = (uInt)(left_out < STEP ? left_out : STEP), left_out -= z.avail_out;
        result = deflate(&z, left_in ? Z_NO_FLUSH : Z_FINISH);
    }
    if (result == Z_STREAM_END) *stored = (uint64_t)(z.next_out - to);
    deflateEnd(&z);
    return bw_poll(e->ctx);
}

/* Bytes of numbers, the highest of all of them first. */
static bw_status planes_of(encoder *e, const numbers *list, uint8_t **bytes) {
    *bytes = bw_alloc(e->ctx, list->count, 4);
    if (!*bytes) return e->ctx->error.status;
    for (size_t i = 0; i < list->count; i++)
        for (size_t b = 0; b < 4; b++) (*bytes)[b * list->count + i] = (uint8_t)(list->item[i] >> (24 - 8 * b));
    return BW_OK;
}

static uint32_t crc_of(uint32_t crc, const void *data, size_t size) {
    return (uint32_t)crc32_z(crc, data, size);
}

/* Takes the stream over: *data is what is to be written. */
static bw_status finish_stream(encoder *e, uint8_t **data, size_t size, bw_bwh_stream *stream) {
    *stream = (bw_bwh_stream){.size = size, .stored = size};
    uint8_t *packed = bw_alloc(e->ctx, size, 1);
    uint64_t stored = 0;
    bw_status status = packed ? squeeze(e, *data, size, packed, &stored) : e->ctx->error.status;
    if (status == BW_OK && stored && stored < size) {
        bw_free(e->ctx, *data);
        *data = bw_resize(e->ctx, packed, (size_t)stored, 1);
        if (!*data) *data = packed, status = e->ctx->error.status;
        packed = NULL;
        stream->method = 1, stream->stored = stored;
    }
    bw_free(e->ctx, packed);
    stream->crc = crc_of(0, *data, (size_t)stream->stored);
    return status;
}

static bw_status make_streams(encoder *e, uint8_t *data[BW_BWH_STREAMS], bw_bwh_stream stream[BW_BWH_STREAMS]) {
    bw_status status = planes_of(e, &e->glue, &data[BW_BWH_GLUE]);
    if (status == BW_OK) status = planes_of(e, &e->corners, &data[BW_BWH_CORNERS]);
    if (status == BW_OK && !(data[BW_BWH_HELD] = bw_alloc(e->ctx, e->numbered, 1))) status = e->ctx->error.status;
    for (size_t i = 0; i < e->numbered && status == BW_OK; i++) data[BW_BWH_HELD][i] = e->mesh->held[e->vertex[i]];
    for (int p = 0; p < 24; p++) data[BW_BWH_COORDINATES + p] = e->plane[p], e->plane[p] = NULL;
    for (int s = 0; s < BW_BWH_STREAMS && status == BW_OK; s++) {
        size_t size = s == BW_BWH_GLUE ? 4 * e->glue.count : s == BW_BWH_CORNERS ? 4 * e->corners.count : e->numbered;
        status = finish_stream(e, &data[s], size, &stream[s]);
    }
    return status;
}

static bw_status write_file(encoder *e, const bw_bwh_stream stream[BW_BWH_STREAMS], uint8_t *const data[BW_BWH_STREAMS], const char *path, uint64_t *bytes) {
    bw_bwh_header header = {.magic = "\x89"
                                     "BWH\r\n\x1a\n",
                            .version = BW_BWH_VERSION,
                            .part_count = (uint32_t)e->blocks.count,
                            .vertex_count = e->numbered,
                            .hex_count = e->mesh->hex_count,
                            .subdivide = (uint32_t)e->mesh->subdivide,
                            .stream_count = BW_BWH_STREAMS};
    size_t parts = e->blocks.count * sizeof *e->part, directory = BW_BWH_STREAMS * sizeof *stream;
    header.file_size = sizeof header + parts + directory;
    for (int s = 0; s < BW_BWH_STREAMS; s++) header.file_size += stream[s].stored;
    header.crc = crc_of(crc_of(crc_of(0, &header, sizeof header), e->part, parts), stream, directory);
    bw_output out;
    bw_output_open(e->ctx, &out, path);
    bw_put_bytes(&out, &header, sizeof header);
    bw_put_bytes(&out, e->part, parts);
    bw_put_bytes(&out, stream, directory);
    for (int s = 0; s < BW_BWH_STREAMS; s++) bw_put_bytes(&out, data[s], (size_t)stream[s].stored);
    return bw_output_close(&out, bytes);
}

/* ---- all of it ----------------------------------------------------------------------------------------------------- */

static bw_status prepare(encoder *e) {
    bw_context *ctx = e->ctx;
    size_t n = e->mesh->vertex_count;
    if (e->mesh->hex_count >= INT32_MAX || n >= INT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "too many hexes for the compact form");
    bw_status status = bw_hex_groups_of_blocks(ctx, e->mesh, &e->blocks);
    if (status != BW_OK) return status;
    e->part = bw_alloc(ctx, e->blocks.count, sizeof *e->part);
    e->uses = bw_alloc(ctx, n, 1);
    e->number = bw_alloc(ctx, n, sizeof *e->number);
    e->vertex = bw_alloc(ctx, n, sizeof *e->vertex);
    if (!e->part || !e->uses || !e->number || !e->vertex) return ctx->error.status;
    for (int p = 0; p < 24; p++)
        if (!(e->plane[p] = bw_alloc(ctx, n, 1))) return ctx->error.status;
    memset(e->number, 0xff, n * sizeof *e->number);
    for (size_t h = 0; h < e->mesh->hex_count; h++)
        for (int c = 0; c < 8; c++) {
            uint8_t *uses = &e->uses[e->mesh->hex[h][c]];
            if (*uses < UINT8_MAX) ++*uses;
        }
    return BW_OK;
}

static void clear(encoder *e) {
    bw_hex_groups_clear(e->ctx, &e->blocks);
    bw_free(e->ctx, e->part), bw_free(e->ctx, e->uses), bw_free(e->ctx, e->number), bw_free(e->ctx, e->vertex), bw_free(e->ctx, e->grid);
    bw_free(e->ctx, e->glue.item), bw_free(e->ctx, e->corners.item);
    for (int p = 0; p < 24; p++) bw_free(e->ctx, e->plane[p]);
}

bw_status bw_hex_write_bwh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    (void)skin;
    encoder e = {.ctx = ctx, .mesh = mesh};
    uint8_t *data[BW_BWH_STREAMS] = {0};
    bw_bwh_stream stream[BW_BWH_STREAMS];
    bw_status status = prepare(&e);
    for (size_t g = 0; g < e.blocks.count && status == BW_OK; g++) status = take_part(&e, g);
    if (status == BW_OK && e.numbered != mesh->vertex_count) status = bw_fail(ctx, BW_E_CHECK, "a vertex is in no hex");
    if (status == BW_OK) status = make_streams(&e, data, stream);
    if (status == BW_OK) status = write_file(&e, stream, data, path, bytes);
    for (int s = 0; s < BW_BWH_STREAMS; s++) bw_free(ctx, data[s]);
    clear(&e);
    return status;
}
