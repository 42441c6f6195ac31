#include "bwh.h"

#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#if FLT_EVAL_METHOD != 0
#error "predictions are sums of doubles, rounded after each step"
#endif

enum { VERSION = 2, HEADER = 64, LATTICE_SIZE = 48, MOST_DIGITS = 15, LEAST_BITS = 1, MOST_BITS = 24, MODEL_MOST = 127 };
enum { DOUBLES, DECIMAL, LATTICE };
/* No byte of a range-coded stream stands for more: a decision costs 0.0024 bits at least, a vertex takes 21 of them, a part 15, a point on the outside or a corner one. */
enum { VERTICES_MOST = 192, PARTS_MOST = 256, POINTS_MOST = 4096 };

/* Models of the shape, and of the places. */
enum {
    LISTED, BLOCK, SIZE = BLOCK + 128, KNOWN = SIZE + 3 * 128, GUESSED = KNOWN + 4 * 27, LINKED = GUESSED + 4 * 27, LINK = LINKED + 1, STEP = LINK + 8,
    CHOICE = STEP + 128, BACK = CHOICE + 64, HELD = BACK + 128, SHAPE_MODELS = HELD + 4 * 125 * 4
};
enum { HIGH, LOW = 4 * 17 * 8, SIGN = LOW + 4 * 65 * 5 * 16, NEXT = SIGN + 4 * 27, PLACE_MODELS = NEXT + 65 };
enum { BY_NUMBER, BY_FACE, BY_LINE, BY_LINK }; /* how a point on the outside was guessed at */
enum { LINKS = 8 };                              /* vertices on walls that one knows to be next to it */
enum { CORNER_NEW, CORNER_AS_BEFORE, CORNER_OF_LAST, CORNER_BACK = CORNER_OF_LAST + 3 };

const uint8_t bwh_ring[8] = {0, 1, 3, 2, 4, 5, 7, 6};

typedef struct {
    uint16_t zero, seen;
} model;

typedef struct {
    const uint8_t *data;
    size_t size, at;
    uint32_t range, code;
    bool over; /* read beyond the end */
} coder;

typedef struct {
    bwh_mesh *mesh;
    coder shape, places;
    const uint8_t *plain;
    size_t plain_size, plain_at;
    uint64_t hold;
    int have;
    unsigned kind, parameter;
    double low[3], step[3];
    size_t vertices;      /* numbered so far */
    uint8_t (*bits)[3], (*sign)[3]; /* [vertex] of what was not foreseen */
    int32_t *grid;        /* of the block at hand */
    int32_t first, last;  /* its first new vertex, and the last older one that it found; -1: none */
    int32_t *seen;        /* [vertex] the last grid that has it outside, from 1 */
    int32_t grids;        /* so far */
    int32_t *row;         /* [vertex] of link; -1: none */
    int32_t (*link)[LINKS]; /* [row] vertices next to it on the outside of grids that are done, then -1 */
    size_t rows, room;
    uint32_t rate[MODEL_MOST + 1], crc_table[256];
    model shape_model[SHAPE_MODELS], place_model[PLACE_MODELS];
} decoder;

/* Neighbours: at[i + 3 j + 9 k] is i, j, k steps back along the axes, -1 if it is not there. */
typedef struct {
    unsigned axes;
    int32_t at[27];
} near_by;

static uint32_t get32(const uint8_t *p) {
    return p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}
static uint64_t get64(const uint8_t *p) {
    return get32(p) | (uint64_t)get32(p + 4) << 32;
}
static double get_double(const uint8_t *p) {
    uint64_t bits = get64(p);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
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

/* ---- entropy coding ------------------------------------------------------------------------------------------------ */

static uint8_t next_byte(coder *c) {
    if (c->at < c->size) return c->data[c->at++];
    c->over = true;
    return 0;
}

static void coder_init(coder *c, const uint8_t *data, size_t size) {
    *c = (coder){.data = data, .size = size, .range = UINT32_MAX};
    for (int i = 0; i < 5; i++) c->code = c->code << 8 | next_byte(c);
}

static inline void normalize(coder *c) {
    while (c->range < 1u << 24) c->range <<= 8, c->code = c->code << 8 | next_byte(c);
}

static inline unsigned get_bit(const decoder *d, coder *c, model *m) {
    uint32_t bound = (c->range >> 12) * (uint32_t)(m->zero >> 4), rate = d->rate[m->seen];
    unsigned bit = c->code >= bound;
    if (bit) {
        c->code -= bound, c->range -= bound;
        m->zero = (uint16_t)(m->zero - (m->zero * rate >> 16));
    } else {
        c->range = bound;
        m->zero = (uint16_t)(m->zero + ((65536 - m->zero) * rate >> 16));
    }
    m->seen = (uint16_t)(m->seen + (m->seen < MODEL_MOST));
    normalize(c);
    return bit;
}

static unsigned get_tree(const decoder *d, coder *c, model *m, int depth) {
    unsigned node = 1;
    for (int i = 0; i < depth; i++) node = 2 * node + get_bit(d, c, &m[node]);
    return node - (1u << depth);
}

/* false if it has more than 40 bits: nothing has. */
static bool get_number(const decoder *d, coder *c, model *m, uint64_t *value) {
    unsigned bits = get_tree(d, c, m, 7);
    *value = bits > 0;
    for (unsigned i = 1; i < bits && bits <= 40; i++) {
        c->range >>= 1;
        unsigned bit = c->code >= c->range;
        if (bit) c->code -= c->range;
        *value = *value << 1 | bit;
        normalize(c);
    }
    return bits <= 40;
}

static uint64_t get_plain(decoder *d, int count) {
    if (count > 32) {
        uint64_t low = get_plain(d, 32);
        return low | get_plain(d, count - 32) << 32;
    }
    for (; d->have < count; d->have += 8) {
        uint64_t byte = d->plain_at < d->plain_size ? d->plain[d->plain_at] : 0;
        d->plain_at++;
        d->hold |= byte << d->have;
    }
    uint64_t value = d->hold & (((uint64_t)1 << count) - 1);
    d->hold >>= count, d->have -= count;
    return value;
}

static int64_t unfold(uint64_t z) {
    return z & 1 ? -(int64_t)(z >> 1) - 1 : (int64_t)(z >> 1);
}

static bool ran_out(const decoder *d) {
    return d->shape.over || d->places.over || d->plain_at > d->plain_size;
}

/* All of each stream was read, and no bit is left. */
static bool all_read(const decoder *d) {
    return !ran_out(d) && d->shape.at == d->shape.size && d->places.at == d->places.size && d->plain_at == d->plain_size && !d->hold;
}

/* ---- checksums ----------------------------------------------------------------------------------------------------- */

static void crc_init(decoder *d) {
    for (uint32_t i = 0; i < 256; i++) {
        uint32_t c = i;
        for (int k = 0; k < 8; k++) c = c & 1 ? c >> 1 ^ 0xedb88320u : c >> 1;
        d->crc_table[i] = c;
    }
}

static uint32_t crc_of(const decoder *d, uint32_t crc, const uint8_t *p, size_t size) {
    crc = ~crc;
    for (size_t i = 0; i < size; i++) crc = d->crc_table[(crc ^ p[i]) & 255] ^ crc >> 8;
    return ~crc;
}

/* ---- header, parts ------------------------------------------------------------------------------------------------- */

static bool is_lattice_right(const decoder *d) {
    for (int k = 0; k < 3; k++)
        if (!isfinite(d->low[k]) || !isfinite(d->step[k]) || !(d->step[k] > 0)) return false;
    d->mesh->step = fmax(fmax(d->step[0], d->step[1]), d->step[2]);
    return true;
}

static bool is_kind_right(const decoder *d) {
    switch (d->kind) {
    case DOUBLES: return d->parameter < 64;
    case DECIMAL: return d->parameter <= MOST_DIGITS;
    case LATTICE: return d->parameter >= LEAST_BITS && d->parameter <= MOST_BITS;
    default: return false;
    }
}

static bool checksums_are_right(const decoder *d, const uint8_t *p, size_t front, size_t size) {
    static const uint8_t zero[4];
    uint32_t crc = crc_of(d, crc_of(d, 0, p, 60), zero, 4);
    return crc_of(d, crc, p + HEADER, front - HEADER) == get32(p + 60) && crc_of(d, 0, p + front, size - front) == get32(p + 56);
}

static bwh_status read_front(decoder *d, const uint8_t *p, size_t size, uint64_t max_bytes) {
    static const uint8_t magic[8] = {0x89, 'B', 'W', 'H', '\r', '\n', 0x1a, '\n'};
    if (size < 8 || memcmp(p, magic, 8)) return BWH_NOT_BWH;
    if (size < 12) return BWH_TRUNCATED;
    if (get32(p + 8) != VERSION) return BWH_VERSION;
    if (size < HEADER || get64(p + 40) != size) return BWH_TRUNCATED;
    d->kind = p[36], d->parameter = p[37];
    size_t front = HEADER + (d->kind == LATTICE ? LATTICE_SIZE : 0);
    uint64_t shape = get32(p + 48), places = get32(p + 52);
    if (front > size || shape + places > size - front) return BWH_TRUNCATED;
    if (!checksums_are_right(d, p, front, size)) return BWH_CHECKSUM;
    uint64_t parts = get32(p + 12), vertices = get64(p + 16), hexes = get64(p + 24);
    for (int k = 0; k < 3 && d->kind == LATTICE; k++) d->low[k] = get_double(p + HEADER + 8 * k), d->step[k] = get_double(p + HEADER + 24 + 8 * k);
    if (!is_kind_right(d) || p[38] || p[39] || (d->kind == LATTICE && !is_lattice_right(d))) return BWH_DAMAGED;
    if (vertices > INT32_MAX || hexes > INT32_MAX || parts > hexes) return BWH_DAMAGED;
    if (vertices > places * VERTICES_MOST || parts > shape * PARTS_MOST) return BWH_DAMAGED;
    if (max_bytes && vertices * 25 + hexes * 48 + parts * sizeof(bwh_part) > max_bytes) return BWH_LIMIT;
    coder_init(&d->shape, p + front, (size_t)shape);
    coder_init(&d->places, p + front + shape, (size_t)places);
    d->plain = p + front + shape + places, d->plain_size = size - front - (size_t)(shape + places);
    bwh_mesh *m = d->mesh;
    m->subdivide = get32(p + 32);
    m->vertex_count = (size_t)vertices, m->hex_count = (size_t)hexes, m->part_count = (size_t)parts;
    return BWH_OK;
}

/* Hexes of a part, and its grid points inside and outside, or corners listed; false if it is too large. */
static bool count_part(const bwh_part *part, uint64_t *hexes, uint64_t *inside, uint64_t *outside) {
    uint64_t n[3] = {part->n[0], part->n[1], part->n[2]};
    *hexes = n[0], *inside = 0, *outside = 8 * n[0];
    if (!n[1]) return true;
    if (n[0] * n[1] > INT32_MAX || n[0] * n[1] * n[2] > INT32_MAX) return false;
    *hexes = n[0] * n[1] * n[2];
    *inside = (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
    *outside = (n[0] + 1) * (n[1] + 1) * (n[2] + 1) - *inside;
    return part->block >= 0;
}

static bwh_status read_part(decoder *d, bwh_part *part, int64_t *block) {
    uint64_t value;
    bool listed = get_bit(d, &d->shape, &d->shape_model[LISTED]);
    if (!get_number(d, &d->shape, &d->shape_model[BLOCK], &value)) return BWH_DAMAGED;
    *block += 1 + unfold(value);
    if (*block < -1 || *block > INT32_MAX) return BWH_DAMAGED;
    *part = (bwh_part){.block = (int32_t)*block};
    for (int k = 0; k < (listed ? 1 : 3); k++) {
        if (!get_number(d, &d->shape, &d->shape_model[SIZE + 128 * k], &value) || !value || value > INT32_MAX) return BWH_DAMAGED;
        part->n[k] = (uint32_t)value;
    }
    return ran_out(d) ? BWH_DAMAGED : BWH_OK;
}

static bwh_status read_parts(decoder *d) {
    bwh_mesh *m = d->mesh;
    uint64_t sum = 0, fresh = 0, points = 0, hexes, inside, outside;
    int64_t block = -1;
    m->part = calloc(m->part_count ? m->part_count : 1, sizeof *m->part);
    if (!m->part) return BWH_MEMORY;
    for (size_t i = 0; i < m->part_count; i++) {
        bwh_part *part = &m->part[i];
        bwh_status status = read_part(d, part, &block);
        if (status != BWH_OK) return status;
        if (!count_part(part, &hexes, &inside, &outside)) return BWH_DAMAGED;
        part->first = (size_t)sum, part->count = (size_t)hexes;
        sum += hexes, fresh += inside, points += outside;
        if (sum > m->hex_count || fresh > m->vertex_count) return BWH_DAMAGED; /* a point inside is always a new vertex */
    }
    return sum == m->hex_count && points <= (uint64_t)d->shape.size * POINTS_MOST ? BWH_OK : BWH_DAMAGED;
}

/* ---- coordinates --------------------------------------------------------------------------------------------------- */

static uint64_t ordered(double value, unsigned drop) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits >> 63 ? ~bits : bits | (uint64_t)1 << 63) >> drop;
}

static double from_ordered(uint64_t bits, unsigned drop) {
    double value;
    bits <<= drop;
    bits = bits >> 63 ? bits & ~((uint64_t)1 << 63) : ~(bits | (((uint64_t)1 << drop) - 1));
    memcpy(&value, &bits, sizeof value);
    return value;
}

#define NEAR(i) (d->mesh->position[near->at[i]][k])

static double from_line(const decoder *d, const near_by *near, int s, int k) {
    return near->at[2 * s] < 0 ? NEAR(s) : NEAR(s) + NEAR(s) - NEAR(2 * s);
}

static double from_parallelogram(const decoder *d, const near_by *near, int s, int t, int k) {
    double corner = NEAR(s) + NEAR(t) - NEAR(s + t), error = 0;
    bool far_s = near->at[2 * s] >= 0, far_t = near->at[2 * t] >= 0;
    if (far_s) {
        double e = NEAR(s) - NEAR(2 * s) - NEAR(s + t) + NEAR(2 * s + t);
        error = e + e;
    }
    if (far_t) {
        double e = NEAR(t) - NEAR(s + t) - NEAR(2 * t) + NEAR(s + 2 * t);
        error = error + e + e;
    }
    if (far_s && far_t) error = error - (NEAR(s + t) - NEAR(2 * s + t) - NEAR(s + 2 * t) + NEAR(2 * s + 2 * t));
    return fabs(error) < 1e-300 ? corner : corner + 0.25 * error;
}

static double foresee(const decoder *d, const near_by *near, int k) {
    double x;
    switch (near->axes) {
    case 0: x = d->vertices ? d->mesh->position[d->vertices - 1][k] : 0; break;
    case 1: x = from_line(d, near, 1, k); break;
    case 2: x = from_line(d, near, 3, k); break;
    case 4: x = from_line(d, near, 9, k); break;
    case 3: x = from_parallelogram(d, near, 1, 3, k); break;
    case 5: x = from_parallelogram(d, near, 1, 9, k); break;
    case 6: x = from_parallelogram(d, near, 3, 9, k); break;
    default: x = NEAR(1) + NEAR(3) + NEAR(9) - NEAR(4) - NEAR(10) - NEAR(12) + NEAR(13); break;
    }
    return isfinite(x) ? x : 0;
}

#undef NEAR

/* Magnitude of what was not foreseen, and its sign. */
static uint64_t get_rest(decoder *d, unsigned class, unsigned expected, unsigned signs, int k, bool *negative) {
    coder *c = &d->places;
    model *m = d->place_model;
    unsigned high = get_tree(d, c, &m[HIGH + (class * 17 + expected / 4) * 8], 3);
    if (high > 4) high = 4; /* no writer has more */
    unsigned bits = 16 * high + get_tree(d, c, &m[LOW + ((class * 65 + expected) * 5 + high) * 16], 4);
    if (bits > 64) bits = 64;
    d->bits[d->vertices][k] = (uint8_t)bits, d->sign[d->vertices][k] = 0;
    *negative = false;
    if (!bits) return 0;
    *negative = get_bit(d, c, &m[SIGN + class * 27 + signs]);
    d->sign[d->vertices][k] = *negative ? 2 : 1;
    if (bits == 1) return 1;
    uint64_t size = 2 + get_bit(d, c, &m[NEXT + bits]);
    return bits > 2 ? size << (bits - 2) | get_plain(d, (int)bits - 2) : size;
}

/* Into *value what is coded; false if no writer writes that. */
static bool get_value(decoder *d, const near_by *near, int k, double *value) {
    static const int step[3] = {1, 3, 9};
    unsigned class = 0, bits = 0, signs = 0;
    for (int a = 0; a < 3; a++)
        if (near->axes >> a & 1) {
            int32_t u = near->at[step[a]];
            class++, bits += d->bits[u][k], signs = 3 * signs + d->sign[u][k];
        }
    bool negative;
    double foreseen = foresee(d, near, k);
    uint64_t size = get_rest(d, class, class ? bits / class : 0, signs, k, &negative);
    if (d->kind == DOUBLES) {
        *value = from_ordered(ordered(foreseen, d->parameter) + (negative ? 0 - size : size), d->parameter);
        return isfinite(*value);
    }
    if (size > (uint64_t)1 << 50) return false;
    *value = floor(foreseen + 0.5) + (negative ? -(double)size : (double)size);
    return d->kind == LATTICE ? *value >= 0 && *value < (double)((uint32_t)1 << d->parameter) : fabs(*value) <= (double)((uint64_t)1 << 44);
}

/* The next vertex. ends: axes along which it is at an end of its block. false if there are no more, or this is none. */
static bool take_vertex(decoder *d, const near_by *near, unsigned ends) {
    static const int step[3] = {1, 3, 9};
    bwh_mesh *m = d->mesh;
    if (d->vertices == m->vertex_count || ran_out(d)) return false;
    unsigned context = ends;
    for (int k = 0; k < 3; k++) context = 5 * context + (near->axes >> k & 1 ? m->held[near->at[step[k]]] : 4);
    m->held[d->vertices] = (uint8_t)get_tree(d, &d->shape, &d->shape_model[HELD + 4 * context], 2);
    for (int k = 0; k < 3; k++)
        if (!get_value(d, near, k, &m->position[d->vertices][k])) return false;
    d->vertices++;
    return true;
}

/* From what was coded to coordinates. */
static bool finish_positions(const decoder *d) {
    double scale = 1;
    for (unsigned i = 0; i < d->parameter && d->kind == DECIMAL; i++) scale *= 10;
    for (size_t v = 0; v < d->mesh->vertex_count && d->kind != DOUBLES; v++)
        for (int k = 0; k < 3; k++) {
            double *x = &d->mesh->position[v][k];
            if (d->kind == DECIMAL) {
                *x = *x / scale;
            } else {
                double product = *x * d->step[k]; /* exact */
                *x = d->low[k] + product;
                if (!isfinite(*x)) return false;
            }
        }
    return true;
}

/* ---- blocks -------------------------------------------------------------------------------------------------------- */

typedef struct {
    const uint32_t *n;
    uint32_t x[3];
    size_t step[3];
    int32_t *at;
} point;

static bool at_end(const point *p, int k) {
    return p->x[k] == 0 || p->x[k] == p->n[k];
}

/* The point one step back along axis k, and the one along l from there; l < 0: none. */
static int32_t back(const point *p, int k, int l) {
    return *(p->at - p->step[k] - (l < 0 ? 0 : p->step[l]));
}

/* ---- what is next to what on the walls of the grids that are done ---- */

static const int32_t *links_of(const decoder *d, int32_t v) {
    static const int32_t none[LINKS] = {-1, -1, -1, -1, -1, -1, -1, -1};
    return d->row[v] < 0 ? none : d->link[d->row[v]];
}

static bool are_linked(const decoder *d, int32_t from, int32_t to) {
    const int32_t *list = links_of(d, from);
    for (int i = 0; i < LINKS && list[i] >= 0; i++)
        if (list[i] == to) return true;
    return false;
}

static bool add_link(decoder *d, int32_t from, int32_t to) {
    if (d->row[from] < 0) {
        if (d->rows == d->room) {
            size_t room = d->room + d->room / 2 + 256;
            void *more = room <= SIZE_MAX / sizeof *d->link ? realloc(d->link, room * sizeof *d->link) : NULL;
            if (!more) return false;
            d->link = more, d->room = room;
        }
        d->row[from] = (int32_t)d->rows++;
        memset(d->link[d->row[from]], 0xff, sizeof *d->link);
    }
    int32_t *list = d->link[d->row[from]];
    for (int i = 0; i < LINKS && list[i] != to; i++)
        if (list[i] < 0) {
            list[i] = to;
            break;
        }
    return true;
}

/* Edges on the outside. */
static bool link_point(decoder *d, const point *p) {
    for (int k = 0; k < 3; k++)
        if (p->x[k] && (at_end(p, (k + 1) % 3) || at_end(p, (k + 2) % 3)))
            if (!add_link(d, back(p, k, -1), *p->at) || !add_link(d, *p->at, back(p, k, -1))) return false;
    return true;
}

static bool is_seen(const decoder *d, int32_t v) {
    return d->seen[v] == d->grids;
}

/* What is next to both u and v but is not w, and not yet in the grid; -1: nothing. */
static int32_t across(const decoder *d, int32_t u, int32_t v, int32_t w) {
    const int32_t *list = links_of(d, u);
    for (int i = 0; i < LINKS && list[i] >= 0; i++)
        if (list[i] != w && !is_seen(d, list[i]) && are_linked(d, v, list[i])) return list[i];
    return -1;
}

static bool share_face(const decoder *d, int32_t t, int32_t u, int32_t v) {
    const int32_t *list = links_of(d, v);
    for (int i = 0; i < LINKS && list[i] >= 0; i++)
        if (list[i] != u && are_linked(d, t, list[i])) return true;
    return false;
}

/* What is next to u, in no face with t beside it, and not yet in the grid. */
static int32_t straight(const decoder *d, int32_t t, int32_t u) {
    const int32_t *list = links_of(d, u);
    for (int i = 0; i < LINKS && list[i] >= 0; i++)
        if (list[i] != t && !is_seen(d, list[i]) && !share_face(d, t, u, list[i])) return list[i];
    return -1;
}

static int32_t any_link(const decoder *d, int32_t u) {
    const int32_t *list = links_of(d, u);
    for (int i = 0; i < LINKS && list[i] >= 0; i++)
        if (!is_seen(d, list[i])) return list[i];
    return -1;
}

/* ---- points ---- */

static int32_t next_number(const decoder *d, const point *p) {
    int inside[3] = {0}, count = 0;
    for (int k = 0; k < 3; k++)
        if (!at_end(p, k)) inside[count++] = k;
    int64_t to = (int64_t)d->last + 1, most = (int64_t)d->vertices - 1;
    if (count == 2 && p->x[inside[0]] >= 2 && p->x[inside[1]] >= 2) {
        int a = inside[0], b = inside[1];
        to = (int64_t)back(p, a, -1) + back(p, b, -1) - back(p, a, b);
    } else {
        for (int i = count; i-- > 0;)
            if (p->x[inside[i]] >= 3) to = 2 * (int64_t)back(p, inside[i], -1) - back(p, inside[i], inside[i]);
    }
    return (int32_t)(to < 0 ? 0 : to > most ? most : to);
}

/* What a point on the outside may be, and how that is known; *beside: an older vertex next to it, -1: none. */
static int32_t guess(const decoder *d, const point *p, unsigned *kind, int32_t *beside) {
    bool older[3];
    int32_t to = -1;
    *beside = -1;
    for (int k = 0; k < 3; k++) {
        older[k] = p->x[k] && (at_end(p, (k + 1) % 3) || at_end(p, (k + 2) % 3)) && back(p, k, -1) < d->first;
        if (older[k] && *beside < 0) *beside = back(p, k, -1);
    }
    *kind = BY_FACE;
    for (int c = 2; c >= 0 && to < 0; c--) {
        int a = c == 0, b = 2 - (c == 2);
        if (older[a] && older[b] && at_end(p, c)) to = across(d, back(p, a, -1), back(p, b, -1), back(p, a, b));
    }
    if (to < 0) *kind = BY_LINE;
    for (int k = 0; k < 3 && to < 0; k++)
        if (older[k] && p->x[k] >= 2 && back(p, k, k) < d->first) to = straight(d, back(p, k, k), back(p, k, -1));
    if (to < 0) *kind = BY_LINK;
    if (to < 0 && *beside >= 0) to = any_link(d, *beside);
    if (to < 0) *kind = BY_NUMBER, to = next_number(d, p);
    return to;
}

/* A vertex that was not guessed; -1: there is none such. */
static int32_t take_other(decoder *d, int32_t beside) {
    uint64_t folded;
    if (beside >= 0 && get_bit(d, &d->shape, &d->shape_model[LINKED])) return links_of(d, beside)[get_tree(d, &d->shape, &d->shape_model[LINK], 3)];
    if (!get_number(d, &d->shape, &d->shape_model[STEP], &folded)) return -1;
    int64_t to = (int64_t)d->last + 1 + unfold(folded);
    return to >= 0 && to < (int64_t)d->vertices ? (int32_t)to : -1;
}

/* Number of a point on the outside; *fresh if it is a new vertex. false if there is no such vertex. */
static bool take_glue(decoder *d, const point *p, bool *fresh) {
    unsigned context;
    int32_t beside, to = guess(d, p, &context, &beside);
    for (int k = 0; k < 3; k++) context = 3 * context + (!p->x[k] ? 0 : back(p, k, -1) >= d->first ? 1 : 2);
    *fresh = !get_bit(d, &d->shape, &d->shape_model[KNOWN + context]);
    if (*fresh) return true;
    if (!get_bit(d, &d->shape, &d->shape_model[GUESSED + context])) to = take_other(d, beside);
    if (to < 0) return false;
    *p->at = d->last = to;
    return true;
}

static bool take_new(decoder *d, const point *p, unsigned ends) {
    near_by near = {0};
    uint32_t most[3];
    bool all = p->x[0] && p->x[1] && p->x[2];
    for (int k = 0; k < 3; k++) {
        near.axes |= p->x[k] ? 1u << k : 0;
        most[k] = p->x[k] > 1 && !all ? 2 : p->x[k] > 0;
    }
    memset(near.at, 0xff, sizeof near.at);
    for (uint32_t z = 0; z <= most[2]; z++)
        for (uint32_t y = 0; y <= most[1]; y++)
            for (uint32_t x = 0; x <= most[0]; x++)
                if (x || y || z) near.at[x + 3 * y + 9 * z] = *(p->at - x * p->step[0] - y * p->step[1] - z * p->step[2]);
    *p->at = (int32_t)d->vertices;
    return take_vertex(d, &near, ends);
}

static bool take_point(decoder *d, const point *p) {
    bool fresh = true;
    unsigned ends = 0;
    for (int k = 0; k < 3; k++) ends += at_end(p, k);
    if (ends && !take_glue(d, p, &fresh)) return false;
    if (fresh ? !take_new(d, p, ends) : ran_out(d)) return false;
    if (ends) d->seen[*p->at] = d->grids;
    return true;
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
    point p = {.n = n, .step = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * ((size_t)n[1] + 1)}, .at = d->grid};
    d->first = (int32_t)d->vertices, d->last = -1, d->grids++;
    for (p.x[2] = 0; p.x[2] <= n[2]; p.x[2]++)
        for (p.x[1] = 0; p.x[1] <= n[1]; p.x[1]++)
            for (p.x[0] = 0; p.x[0] <= n[0]; p.x[0]++, p.at++)
                if (!take_point(d, &p)) return BWH_DAMAGED;
    p.at = d->grid;
    for (p.x[2] = 0; p.x[2] <= n[2]; p.x[2]++)
        for (p.x[1] = 0; p.x[1] <= n[1]; p.x[1]++)
            for (p.x[0] = 0; p.x[0] <= n[0]; p.x[0]++, p.at++)
                if (!link_point(d, &p)) return BWH_MEMORY;
    put_hexes(d, part);
    return BWH_OK;
}

/* ---- hexes one by one ---------------------------------------------------------------------------------------------- */

/* A corner that is there: its number, or -1. before, back: of the hex before. */
static int64_t take_corner(decoder *d, unsigned choice, unsigned c, const int32_t before[8], const int32_t back[8]) {
    uint64_t value;
    switch (choice) {
    case CORNER_AS_BEFORE: return back[c] ? (int64_t)d->vertices - back[c] : -1;
    case CORNER_OF_LAST:
    case CORNER_OF_LAST + 1:
    case CORNER_OF_LAST + 2: return before[c ^ 1u << (choice - CORNER_OF_LAST)];
    case CORNER_BACK: return get_number(d, &d->shape, &d->shape_model[BACK], &value) && value && value <= d->vertices ? (int64_t)(d->vertices - value) : -1;
    default: return -1;
    }
}

static bool take_hex(decoder *d, int32_t hex[8], const int32_t before[8], const int32_t back[8], int32_t back_now[8]) {
    for (unsigned c = 0; c < 8; c++) {
        unsigned choice = get_tree(d, &d->shape, &d->shape_model[CHOICE + 8 * c], 3);
        if (choice != CORNER_NEW) {
            int64_t number = take_corner(d, choice, c, before, back);
            if (number < 0 || ran_out(d)) return false;
            hex[c] = (int32_t)number, back_now[c] = (int32_t)((int64_t)d->vertices - number);
            continue;
        }
        near_by near = {.axes = c};
        memset(near.at, 0xff, sizeof near.at);
        for (unsigned m = 1; m < 8; m++)
            if ((m & c) == m) near.at[(m & 1) + (m & 2 ? 3 : 0) + (m & 4 ? 9 : 0)] = hex[c ^ m];
        hex[c] = (int32_t)d->vertices, back_now[c] = 0;
        if (!take_vertex(d, &near, 3)) return false;
    }
    return true;
}

static bwh_status read_listed(decoder *d, const bwh_part *part) {
    bwh_mesh *m = d->mesh;
    int32_t none[8], back[2][8] = {{0}};
    memset(none, 0xff, sizeof none);
    for (size_t i = 0; i < part->count; i++) {
        size_t h = part->first + i;
        if (!take_hex(d, m->hex[h], i ? m->hex[h - 1] : none, back[i & 1], back[~i & 1])) return BWH_DAMAGED;
        m->block[h] = part->block;
        m->ijk[h][0] = m->ijk[h][1] = m->ijk[h][2] = -1;
    }
    return BWH_OK;
}

/* ---- all of it ----------------------------------------------------------------------------------------------------- */

/* NULL too if the size is more than a size_t holds, as it may be where that has 32 bits. */
static void *room_for(size_t count, size_t size) {
    if (count > SIZE_MAX / size) return NULL;
    return malloc(count ? count * size : 1);
}

static bwh_status read_mesh(decoder *d) {
    bwh_mesh *m = d->mesh;
    size_t v = m->vertex_count, h = m->hex_count;
    m->position = room_for(v, sizeof *m->position);
    m->held = room_for(v, 1);
    m->hex = room_for(h, sizeof *m->hex);
    m->block = room_for(h, sizeof *m->block);
    m->ijk = room_for(h, sizeof *m->ijk);
    d->bits = room_for(v, sizeof *d->bits);
    d->sign = room_for(v, sizeof *d->sign);
    d->seen = calloc(v ? v : 1, sizeof *d->seen);
    d->row = room_for(v, sizeof *d->row);
    if (!m->position || !m->held || !m->hex || !m->block || !m->ijk || !d->bits || !d->sign || !d->seen || !d->row) return BWH_MEMORY;
    memset(d->row, 0xff, v * sizeof *d->row);
    bwh_status status = BWH_OK;
    for (size_t i = 0; i < m->part_count && status == BWH_OK; i++) status = m->part[i].n[1] ? read_block(d, &m->part[i]) : read_listed(d, &m->part[i]);
    if (status == BWH_OK && (d->vertices != m->vertex_count || !all_read(d) || !finish_positions(d))) status = BWH_DAMAGED;
    return status;
}

static void models_init(decoder *d) {
    crc_init(d);
    for (int i = 0; i < SHAPE_MODELS; i++) d->shape_model[i].zero = 1 << 15;
    for (int i = 0; i < PLACE_MODELS; i++) d->place_model[i].zero = 1 << 15;
    for (uint32_t n = 0; n <= MODEL_MOST; n++) d->rate[n] = 131072 / (2 * n + 3);
}

bwh_status bwh_decode(const void *data, size_t size, size_t max_bytes, bwh_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    decoder *d = calloc(1, sizeof *d);
    if (!d) return BWH_MEMORY;
    d->mesh = mesh;
    models_init(d);
    bwh_status status = read_front(d, data, size, max_bytes);
    if (status == BWH_OK) status = read_parts(d);
    if (status == BWH_OK) status = read_mesh(d);
    free(d->grid), free(d->bits), free(d->sign), free(d->seen), free(d->row), free(d->link);
    free(d);
    if (status != BWH_OK) bwh_clear(mesh);
    return status;
}

void bwh_clear(bwh_mesh *mesh) {
    free(mesh->position), free(mesh->held), free(mesh->hex), free(mesh->block), free(mesh->ijk), free(mesh->part);
    memset(mesh, 0, sizeof *mesh);
}
