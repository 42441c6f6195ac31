#include "bwh.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#if FLT_EVAL_METHOD != 0
#error "predictions are sums of doubles, rounded after each step"
#endif

enum { VERSION = 1, HEADER = 64, PART = 16, STREAM = 24, STREAMS = 27, GLUE = 0, CORNERS = 1, HELD = 2, COORDINATES = 3 };
enum { DEFLATE_MOST = 1032 }; /* bytes that a byte of a zlib stream can stand for */

const uint8_t bwh_ring[8] = {0, 1, 3, 2, 4, 5, 7, 6};

typedef struct {
    const uint8_t *data; /* stored */
    uint64_t stored, size;
    uint32_t method, crc;
    uint8_t *bytes;      /* own, or the same as data if raw */
} stream;

typedef struct {
    bwh_mesh *mesh;
    stream stream[STREAMS];
    size_t glue_count, corner_count, glue_at, corner_at; /* numbers of the two streams, and those read */
    size_t vertices;     /* numbered so far */
    int32_t *grid;       /* of the block at hand */
} decoder;

static uint32_t get32(const uint8_t *p) {
    return p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static uint64_t get64(const uint8_t *p) {
    return get32(p) | (uint64_t)get32(p + 4) << 32;
}

const char *bwh_text(bwh_status status) {
    static const char *const text[BWH_STATUS_COUNT] = {
        "all right",
        "this is no hexmesh.bwh",
        "another version of the format",
        "the file is shorter or longer than it says",
        "the file is damaged: a checksum is wrong",
        "the file is damaged: it contradicts itself",
        "the mesh would take more memory than allowed",
        "out of memory",
    };
    return (unsigned)status < BWH_STATUS_COUNT ? text[status] : "no status";
}

/* ---- header, parts, directory -------------------------------------------------------------------------------------- */

static bool checksum_is_right(const uint8_t *p, size_t front) {
    static const uint8_t zero[4];
    uLong crc = crc32_z(0, p, 48);
    crc = crc32_z(crc, zero, 4);
    return (uint32_t)crc32_z(crc, p + 52, front - 52) == get32(p + 48);
}

/* Hexes of a part, and its grid points inside and outside, or corners listed; false if it is none, or too large. */
static bool count_part(const bwh_part *part, uint64_t *hexes, uint64_t *inside, uint64_t *outside, uint64_t *corners) {
    uint64_t n[3] = {part->n[0], part->n[1], part->n[2]};
    *inside = *outside = *corners = 0;
    if (!n[0] || n[0] > INT32_MAX || n[1] > INT32_MAX || n[2] > INT32_MAX || !n[1] != !n[2]) return false;
    *hexes = n[0];
    if (!n[1]) {
        *corners = 8 * n[0];
        return true;
    }
    if (n[0] * n[1] > INT32_MAX || n[0] * n[1] * n[2] > INT32_MAX) return false;
    *hexes = n[0] * n[1] * n[2];
    *inside = (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
    *outside = (n[0] + 1) * (n[1] + 1) * (n[2] + 1) - *inside;
    return part->block >= 0;
}

static bwh_status read_parts(decoder *d, const uint8_t *p, uint64_t hex_count, uint64_t vertex_count) {
    uint64_t sum = 0, fresh = 0, glue = 0, corners = 0;
    for (size_t i = 0; i < d->mesh->part_count; i++, p += PART) {
        bwh_part *part = &d->mesh->part[i];
        uint64_t hexes, inside, outside, listed;
        part->block = (int32_t)get32(p);
        for (int k = 0; k < 3; k++) part->n[k] = get32(p + 4 + 4 * k);
        if (part->block < -1 || !count_part(part, &hexes, &inside, &outside, &listed)) return BWH_DAMAGED;
        part->first = (size_t)sum, part->count = (size_t)hexes;
        sum += hexes, fresh += inside, glue += outside, corners += listed;
        if (sum > INT32_MAX || fresh > vertex_count) return BWH_DAMAGED; /* a point inside is always a new vertex */
    }
    if (sum != hex_count || glue > SIZE_MAX / 4 || corners > SIZE_MAX / 4) return BWH_DAMAGED;
    d->glue_count = (size_t)glue, d->corner_count = (size_t)corners;
    return BWH_OK;
}

static bwh_status read_directory(decoder *d, const uint8_t *directory, const uint8_t *data, uint64_t room, uint64_t vertices) {
    for (int s = 0; s < STREAMS; s++, directory += STREAM) {
        stream *t = &d->stream[s];
        t->method = get32(directory), t->crc = get32(directory + 4);
        t->size = get64(directory + 8), t->stored = get64(directory + 16);
        uint64_t size = s == GLUE ? 4 * (uint64_t)d->glue_count : s == CORNERS ? 4 * (uint64_t)d->corner_count : vertices;
        if (t->stored > room) return BWH_TRUNCATED;
        if (t->size != size || t->method > 1 || (t->method == 0 && t->stored != size)) return BWH_DAMAGED;
        if (t->method == 1 && size / DEFLATE_MOST > t->stored) return BWH_DAMAGED;
        t->data = data, data += t->stored, room -= t->stored;
    }
    return room ? BWH_TRUNCATED : BWH_OK;
}

static bwh_status read_front(decoder *d, const uint8_t *p, size_t size, uint64_t max_bytes) {
    static const uint8_t magic[8] = {0x89, 'B', 'W', 'H', '\r', '\n', 0x1a, '\n'};
    if (size < 8 || memcmp(p, magic, 8)) return BWH_NOT_BWH;
    if (size < 12) return BWH_TRUNCATED;
    if (get32(p + 8) != VERSION) return BWH_VERSION;
    if (size < HEADER || get64(p + 40) != size) return BWH_TRUNCATED;
    uint64_t parts = get32(p + 12), vertices = get64(p + 16), hexes = get64(p + 24);
    uint64_t front = HEADER + PART * parts + STREAM * STREAMS;
    if (get32(p + 36) != STREAMS) return BWH_DAMAGED;
    if (front > size) return BWH_TRUNCATED;
    if (!checksum_is_right(p, (size_t)front)) return BWH_CHECKSUM;
    if (vertices > INT32_MAX || hexes > INT32_MAX) return BWH_DAMAGED;
    if (max_bytes && vertices * 25 + hexes * 48 + parts * sizeof(bwh_part) > max_bytes) return BWH_LIMIT;
    bwh_mesh *m = d->mesh;
    m->subdivide = get32(p + 32);
    m->part = calloc(parts ? parts : 1, sizeof *m->part);
    if (!m->part) return BWH_MEMORY;
    m->part_count = (size_t)parts;
    bwh_status status = read_parts(d, p + HEADER, hexes, vertices);
    if (status == BWH_OK) status = read_directory(d, p + HEADER + PART * parts, p + front, size - front, vertices);
    if (status == BWH_OK) m->vertex_count = (size_t)vertices, m->hex_count = (size_t)hexes;
    return status;
}

/* ---- streams ------------------------------------------------------------------------------------------------------- */

static bwh_status inflate_stream(stream *t) {
    t->bytes = malloc(t->size ? (size_t)t->size : 1);
    if (!t->bytes) return BWH_MEMORY;
    z_stream z = {.next_in = (Bytef *)t->data, .next_out = t->bytes};
    if (inflateInit(&z) != Z_OK) return BWH_MEMORY;
    uint64_t in = t->stored, out = t->size;
    int result = Z_OK;
    while (result == Z_OK) {
        enum { STEP = 1 << 30 };
        if (!z.avail_in) z.avail_in = (uInt)(in < STEP ? in : STEP), in -= z.avail_in;
        if (!z.avail_out) z.avail_out = (uInt)(out < STEP ? out : STEP), out -= z.avail_out;
        result = inflate(&z, Z_NO_FLUSH);
    }
    bool good = result == Z_STREAM_END && !in && !z.avail_in && !out && !z.avail_out;
    inflateEnd(&z);
    return good ? BWH_OK : BWH_DAMAGED;
}

static bwh_status read_streams(decoder *d) {
    bwh_status status = BWH_OK;
    for (int s = 0; s < STREAMS && status == BWH_OK; s++) {
        stream *t = &d->stream[s];
        if ((uint32_t)crc32_z(0, t->data, (size_t)t->stored) != t->crc) return BWH_CHECKSUM;
        if (t->method) status = inflate_stream(t);
        else t->bytes = (uint8_t *)t->data;
    }
    return status;
}

static uint32_t number_at(const stream *t, size_t count, size_t i) {
    const uint8_t *b = t->bytes + i;
    return (uint32_t)b[0] << 24 | (uint32_t)b[count] << 16 | (uint32_t)b[2 * count] << 8 | b[3 * count];
}

/* ---- coordinates --------------------------------------------------------------------------------------------------- */

static uint64_t ordered(double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits >> 63 ? ~bits : bits | (uint64_t)1 << 63;
}

static double from_ordered(uint64_t bits) {
    double value;
    bits = bits >> 63 ? bits & ~((uint64_t)1 << 63) : ~bits;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* near[m]: the neighbour at the low end of the axes in m. Sums in this order, as the writer has them. */
static double predict(const double *const near[8], unsigned axes, int k) {
    double p = 0;
    switch (axes) {
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

/* The next vertex; near[m] for all m in axes must be decoded. false if there are no more. */
static bool take_vertex(decoder *d, const double *const near[8], unsigned axes) {
    bwh_mesh *m = d->mesh;
    size_t at = d->vertices;
    if (at == m->vertex_count) return false;
    for (int k = 0; k < 3; k++) {
        double p = axes ? predict(near, axes, k) : at ? m->position[at - 1][k] : 0;
        uint64_t code = 0;
        for (int b = 0; b < 8; b++) code = code << 8 | d->stream[COORDINATES + 8 * k + b].bytes[at];
        double value = from_ordered(ordered(p) + (code >> 1 ^ (code & 1 ? ~(uint64_t)0 : 0)));
        if (!isfinite(value)) return false;
        m->position[at][k] = value;
    }
    d->vertices++;
    return true;
}

/* ---- connectivity -------------------------------------------------------------------------------------------------- */

static int64_t guess(const decoder *d, const uint32_t n[3], const uint32_t x[3], const int32_t *p, int64_t last) {
    const size_t step[3] = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * (n[1] + 1)};
    int inside[3] = {0}, count = 0;
    for (int k = 0; k < 3; k++)
        if (x[k] > 0 && x[k] < n[k]) inside[count++] = k;
    int64_t to = last + 1;
    if (count == 2 && x[inside[0]] >= 2 && x[inside[1]] >= 2) {
        size_t a = step[inside[0]], b = step[inside[1]];
        to = (int64_t)*(p - a) + *(p - b) - *(p - a - b);
    } else {
        for (int i = count; i-- > 0;)
            if (x[inside[i]] >= 3) to = 2 * (int64_t)*(p - step[inside[i]]) - *(p - 2 * step[inside[i]]);
    }
    return to < 0 ? 0 : to >= (int64_t)d->vertices ? (int64_t)d->vertices - 1 : to;
}

/* Number of a grid point on the outside into *p; *fresh if it is a new vertex. false if there is no such vertex. */
static bool take_glue(decoder *d, const uint32_t n[3], const uint32_t x[3], int32_t *p, int64_t *last, bool *fresh) {
    uint32_t code = number_at(&d->stream[GLUE], d->glue_count, d->glue_at++);
    *fresh = code == 0;
    if (*fresh) return true;
    int64_t step = (int64_t)((code - 1) >> 1), to;
    if (!d->vertices) return false;
    to = guess(d, n, x, p, *last) + ((code - 1) & 1 ? -step - 1 : step);
    if (to < 0 || to >= (int64_t)d->vertices) return false;
    *p = (int32_t)to, *last = to;
    return true;
}

static bool take_point(decoder *d, const uint32_t n[3], const uint32_t x[3], int32_t *p, int64_t *last) {
    const size_t step[3] = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * (n[1] + 1)};
    bool fresh = true, outside = false;
    for (int k = 0; k < 3; k++) outside |= x[k] == 0 || x[k] == n[k];
    if (outside && !take_glue(d, n, x, p, last, &fresh)) return false;
    if (!fresh) return true;
    const double *near[8] = {0};
    unsigned axes = 0;
    for (int k = 0; k < 3; k++) axes |= x[k] ? 1u << k : 0;
    for (unsigned m = 1; m < 8; m++)
        if ((m & axes) == m) near[m] = d->mesh->position[*(p - (m & 1 ? step[0] : 0) - (m & 2 ? step[1] : 0) - (m & 4 ? step[2] : 0))];
    *p = (int32_t)d->vertices;
    return take_vertex(d, near, axes);
}

static void put_hexes(const decoder *d, const bwh_part *part) {
    size_t h = part->first, row = (size_t)part->n[0] + 1, layer = row * ((size_t)part->n[1] + 1);
    for (uint32_t z = 0; z < part->n[2]; z++)
        for (uint32_t y = 0; y < part->n[1]; y++)
            for (uint32_t x = 0; x < part->n[0]; x++, h++) {
                const int32_t *p = d->grid + x + row * y + layer * z;
                for (size_t c = 0; c < 8; c++) d->mesh->hex[h][c] = p[(c & 1) + (c >> 1 & 1) * row + (c >> 2) * layer];
                d->mesh->block[h] = part->block;
                d->mesh->ijk[h][0] = (int32_t)x, d->mesh->ijk[h][1] = (int32_t)y, d->mesh->ijk[h][2] = (int32_t)z;
            }
}

static bwh_status read_block(decoder *d, const bwh_part *part) {
    const uint32_t *n = part->n;
    uint64_t points = ((uint64_t)n[0] + 1) * ((uint64_t)n[1] + 1) * ((uint64_t)n[2] + 1);
    free(d->grid);
    d->grid = points <= SIZE_MAX / 4 ? malloc((size_t)points * sizeof *d->grid) : NULL;
    if (!d->grid) return BWH_MEMORY;
    int32_t *p = d->grid;
    int64_t last = -1;
    uint32_t x[3];
    for (x[2] = 0; x[2] <= n[2]; x[2]++)
        for (x[1] = 0; x[1] <= n[1]; x[1]++)
            for (x[0] = 0; x[0] <= n[0]; x[0]++)
                if (!take_point(d, n, x, p++, &last)) return BWH_DAMAGED;
    put_hexes(d, part);
    return BWH_OK;
}

static bwh_status read_listed(decoder *d, const bwh_part *part) {
    bwh_mesh *m = d->mesh;
    for (size_t h = part->first; h < part->first + part->count; h++) {
        int32_t *hex = m->hex[h];
        for (unsigned c = 0; c < 8; c++) {
            uint32_t code = number_at(&d->stream[CORNERS], d->corner_count, d->corner_at++);
            if (code > d->vertices) return BWH_DAMAGED;
            hex[c] = (int32_t)(d->vertices - code);
            if (code) continue;
            const double *near[8] = {0};
            for (unsigned a = 1; a < 8; a++)
                if ((a & c) == a) near[a] = m->position[hex[c ^ a]];
            if (!take_vertex(d, near, c)) return BWH_DAMAGED;
        }
        m->block[h] = part->block;
        m->ijk[h][0] = m->ijk[h][1] = m->ijk[h][2] = -1;
    }
    return BWH_OK;
}

static bwh_status read_mesh(decoder *d) {
    bwh_mesh *m = d->mesh;
    size_t v = m->vertex_count ? m->vertex_count : 1, h = m->hex_count ? m->hex_count : 1;
    m->position = malloc(v * sizeof *m->position);
    m->held = malloc(v);
    m->hex = malloc(h * sizeof *m->hex);
    m->block = malloc(h * sizeof *m->block);
    m->ijk = malloc(h * sizeof *m->ijk);
    if (!m->position || !m->held || !m->hex || !m->block || !m->ijk) return BWH_MEMORY;
    for (size_t i = 0; i < m->vertex_count; i++)
        if ((m->held[i] = d->stream[HELD].bytes[i]) > 3) return BWH_DAMAGED;
    bwh_status status = BWH_OK;
    for (size_t i = 0; i < m->part_count && status == BWH_OK; i++) status = m->part[i].n[1] ? read_block(d, &m->part[i]) : read_listed(d, &m->part[i]);
    return status == BWH_OK && d->vertices != m->vertex_count ? BWH_DAMAGED : status;
}

bwh_status bwh_decode(const void *data, size_t size, size_t max_bytes, bwh_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    decoder d = {.mesh = mesh};
    bwh_status status = read_front(&d, data, size, max_bytes);
    if (status == BWH_OK) status = read_streams(&d);
    if (status == BWH_OK) status = read_mesh(&d);
    for (int s = 0; s < STREAMS; s++)
        if (d.stream[s].bytes != d.stream[s].data) free(d.stream[s].bytes);
    free(d.grid);
    if (status != BWH_OK) bwh_clear(mesh);
    return status;
}

void bwh_clear(bwh_mesh *mesh) {
    free(mesh->position), free(mesh->held), free(mesh->hex), free(mesh->block), free(mesh->ijk), free(mesh->part);
    memset(mesh, 0, sizeof *mesh);
}
