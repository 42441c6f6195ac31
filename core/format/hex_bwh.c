#include "format/hex_bwh.h"

#include <string.h>
#include <zlib.h>

#include "format/bwh_links.h"
#include "format/bwh_places.h"
#include "format/output.h"
#include "hex/grid.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "structures are written as they are");

/* Models of the shape. */
enum {
    LISTED,                          /* is a part listed hex by hex? */
    BLOCK,                           /* number: block + 1 from that of the part before + 1, folded */
    SIZE = BLOCK + 128,              /* numbers: hexes along an axis, or listed */
    KNOWN = SIZE + 3 * 128,          /* [kind of guess][status of neighbours, base 3]: is a point on the outside a vertex that is there? */
    GUESSED = KNOWN + 4 * 27,        /* likewise: is it the one guessed? */
    LINKED = GUESSED + 4 * 27,       /* else: is it next to the older vertex beside it? */
    LINK = LINKED + 1,               /* [tree of 3] the how manieth there */
    STEP = LINK + 8,                 /* number: else how far from one more than the last, folded */
    CHOICE = STEP + 128,             /* [corner][tree of 3] of hexes listed */
    BACK = CHOICE + 8 * 8,           /* number: how far back a corner is */
    HELD = BACK + 128,               /* [axes at an end][held of neighbours, base 5][tree of 2] */
    MODELS = HELD + 4 * 125 * 4
};

/* How a corner of a hex listed by itself is told. */
enum { CORNER_NEW, CORNER_AS_BEFORE, CORNER_OF_LAST, CORNER_BACK = CORNER_OF_LAST + 3 };

typedef struct {
    bw_context *ctx;
    const bw_hex_mesh *mesh;
    bw_hex_groups blocks;
    uint8_t *uses;       /* [vertex] hexes it is in; 255: that many or more */
    int32_t *number;     /* [vertex] its new number, or -1 */
    uint8_t *held;       /* [number] */
    bw_hvertex *grid;    /* [point] of the block at hand: x fastest */
    size_t grid_room;
    int32_t first, last; /* numbers: of the first new vertex of the block at hand, of the last that it found there (-1: none) */
    int32_t *seen;       /* [number] the last block that has it outside, as block_count was then */
    int32_t block_count; /* grids so far */
    bw_bwh_links links;
    int32_t block;       /* of the part before */
    bw_range_encoder coder;
    bw_bit_model model[MODELS];
    bw_bwh_places places;
} encoder;

static uint64_t folded(int64_t d) {
    return d < 0 ? 2 * (uint64_t)-(d + 1) + 1 : 2 * (uint64_t)d;
}

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

/* ---- vertices ------------------------------------------------------------------------------------------------------ */

/* Gives v the next number. ends: axes along which it is at an end of its block. */
static void put_vertex(encoder *e, bw_hvertex v, const bw_bwh_near *near, int ends) {
    static const int step[3] = {1, 3, 9};
    int context = ends;
    for (int k = 0; k < 3; k++) context = 5 * context + (near->axes >> k & 1 ? e->held[near->at[step[k]]] : 4);
    bw_range_put_tree(&e->coder, &e->model[HELD + 4 * context], 2, e->mesh->held[v]);
    e->held[e->places.count] = e->mesh->held[v];
    e->number[v] = (int32_t)e->places.count;
    bw_bwh_places_put(&e->places, e->mesh->position[v], near);
}

/* ---- blocks -------------------------------------------------------------------------------------------------------- */

/* A point of the grid at hand. */
typedef struct {
    const uint32_t *n;
    uint32_t x[3];
    size_t step[3];
    const bw_hvertex *at;
} point;

/* How a point on the outside was guessed at. */
typedef enum {
    BY_NUMBER, /* nothing next to it is older than the block: by its numbers, should they go on */
    BY_FACE,   /* next to two older vertices along a face */
    BY_LINE,   /* straight on from two older ones */
    BY_LINK    /* next to one older vertex */
} guess_kind;

typedef struct {
    guess_kind kind;
    int32_t number, beside; /* what it is; an older vertex next to it, -1: none */
} guess;

/* Numbers of the points one step back along axis k, and the one along l from there; l < 0: none. */
static int32_t back(const encoder *e, const point *p, int k, int l) {
    return e->number[*(p->at - p->step[k] - (l < 0 ? 0 : p->step[l]))];
}

static bool at_end(const point *p, int k) {
    return p->x[k] == 0 || p->x[k] == p->n[k];
}

/* Is the edge to the point one step back along axis k there, on the outside, and that vertex older than the block? */
static bool older_along(const encoder *e, const point *p, int k) {
    return p->x[k] && (at_end(p, (k + 1) % 3) || at_end(p, (k + 2) % 3)) && back(e, p, k, -1) < e->first;
}

/* What is next to both u and v but is not w, and not yet in the block. */
static int32_t across(const encoder *e, int32_t u, int32_t v, int32_t w) {
    const int32_t *list = bw_bwh_links_of(&e->links, u);
    for (int i = 0; i < BW_BWH_LINKS && list[i] >= 0; i++)
        if (list[i] != w && e->seen[list[i]] != e->block_count && bw_bwh_links_find(&e->links, v, list[i]) >= 0) return list[i];
    return -1;
}

/* Is there a vertex next to both t and v, besides u? */
static bool share_face(const encoder *e, int32_t t, int32_t u, int32_t v) {
    const int32_t *list = bw_bwh_links_of(&e->links, v);
    for (int i = 0; i < BW_BWH_LINKS && list[i] >= 0; i++)
        if (list[i] != u && bw_bwh_links_find(&e->links, t, list[i]) >= 0) return true;
    return false;
}

/* What is next to u, in no face with t beside it, and not yet in the block. */
static int32_t straight(const encoder *e, int32_t t, int32_t u) {
    const int32_t *list = bw_bwh_links_of(&e->links, u);
    for (int i = 0; i < BW_BWH_LINKS && list[i] >= 0; i++)
        if (list[i] != t && e->seen[list[i]] != e->block_count && !share_face(e, t, u, list[i])) return list[i];
    return -1;
}

/* What is next to u, and not yet in the block. */
static int32_t any_link(const encoder *e, int32_t u) {
    const int32_t *list = bw_bwh_links_of(&e->links, u);
    for (int i = 0; i < BW_BWH_LINKS && list[i] >= 0; i++)
        if (e->seen[list[i]] != e->block_count) return list[i];
    return -1;
}

/* Along a face as an affine function of the place, else one more than the last. */
static int32_t next_number(const encoder *e, const point *p) {
    int inside[3], count = 0;
    for (int k = 0; k < 3; k++)
        if (!at_end(p, k)) inside[count++] = k;
    int64_t to = (int64_t)e->last + 1, most = (int64_t)e->places.count - 1;
    if (count == 2 && p->x[inside[0]] >= 2 && p->x[inside[1]] >= 2) {
        int a = inside[0], b = inside[1];
        to = (int64_t)back(e, p, a, -1) + back(e, p, b, -1) - back(e, p, a, b);
    } else {
        for (int i = count; i-- > 0;)
            if (p->x[inside[i]] >= 3) to = 2 * (int64_t)back(e, p, inside[i], -1) - back(e, p, inside[i], inside[i]);
    }
    return (int32_t)(to < 0 ? 0 : to > most ? most : to);
}

static guess guess_at(const encoder *e, const point *p) {
    guess g = {BY_NUMBER, -1, -1};
    bool older[3];
    for (int k = 0; k < 3; k++) {
        older[k] = older_along(e, p, k);
        if (older[k] && g.beside < 0) g.beside = back(e, p, k, -1);
    }
    for (int c = 2; c >= 0 && g.number < 0; c--) { /* axes a < b, face across c */
        int a = c == 0, b = 2 - (c == 2);
        if (older[a] && older[b] && at_end(p, c)) g = (guess){BY_FACE, across(e, back(e, p, a, -1), back(e, p, b, -1), back(e, p, a, b)), g.beside};
    }
    for (int k = 0; k < 3 && g.number < 0; k++)
        if (older[k] && p->x[k] >= 2 && back(e, p, k, k) < e->first) g = (guess){BY_LINE, straight(e, back(e, p, k, k), back(e, p, k, -1)), g.beside};
    if (g.number < 0 && g.beside >= 0) g = (guess){BY_LINK, any_link(e, g.beside), g.beside};
    if (g.number < 0) g.kind = BY_NUMBER, g.number = next_number(e, p);
    return g;
}

/* A vertex that was not guessed: by its place among those next to an older one, else by its number. */
static void put_other(encoder *e, const guess *g, int32_t number) {
    int place = g->beside < 0 ? -1 : bw_bwh_links_find(&e->links, g->beside, number);
    if (g->beside >= 0) bw_range_put(&e->coder, &e->model[LINKED], place >= 0);
    if (place >= 0) bw_range_put_tree(&e->coder, &e->model[LINK], 3, (unsigned)place);
    else bw_range_put_number(&e->coder, &e->model[STEP], folded((int64_t)number - e->last - 1));
}

/* Which vertex a point on the outside is, if it is there. */
static void put_glue(encoder *e, const point *p) {
    guess g = guess_at(e, p);
    int context = (int)g.kind;
    for (int k = 0; k < 3; k++) context = 3 * context + (!p->x[k] ? 0 : back(e, p, k, -1) >= e->first ? 1 : 2);
    int32_t number = e->number[*p->at];
    bw_range_put(&e->coder, &e->model[KNOWN + context], number >= 0);
    if (number < 0) return;
    bw_range_put(&e->coder, &e->model[GUESSED + context], number == g.number);
    if (number != g.number) put_other(e, &g, number);
    e->last = number;
}

static void put_new(encoder *e, const point *p, int ends) {
    bw_bwh_near near = {0};
    uint32_t most[3]; /* steps that matter */
    bool all = p->x[0] && p->x[1] && p->x[2];
    for (int k = 0; k < 3; k++) {
        near.axes |= p->x[k] ? 1u << k : 0;
        most[k] = p->x[k] > 1 && !all ? 2 : p->x[k] > 0;
    }
    memset(near.at, 0xff, sizeof near.at);
    for (uint32_t z = 0; z <= most[2]; z++)
        for (uint32_t y = 0; y <= most[1]; y++)
            for (uint32_t x = 0; x <= most[0]; x++)
                if (x || y || z) near.at[x + 3 * y + 9 * z] = e->number[*(p->at - x * p->step[0] - y * p->step[1] - z * p->step[2])];
    put_vertex(e, *p->at, &near, ends);
}

static void put_point(encoder *e, const point *p) {
    int ends = 0;
    for (int k = 0; k < 3; k++) ends += at_end(p, k);
    if (ends) put_glue(e, p);
    if (e->number[*p->at] < 0) put_new(e, p, ends);
    if (ends) e->seen[e->number[*p->at]] = e->block_count;
}
/* Edges of the grid on its outside. */
static bw_status link_point(encoder *e, const point *p) {
    bw_status status = BW_OK;
    for (int k = 0; k < 3 && status == BW_OK; k++)
        if (p->x[k] && (at_end(p, (k + 1) % 3) || at_end(p, (k + 2) % 3))) status = bw_bwh_links_add(e->ctx, &e->links, back(e, p, k, -1), e->number[*p->at]);
    return status;
}

static bw_status put_grid(encoder *e, const uint32_t n[3]) {
    point p = {.n = n, .step = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * ((size_t)n[1] + 1)}, .at = e->grid};
    bw_status status = BW_OK;
    e->first = (int32_t)e->places.count, e->last = -1, e->block_count++;
    for (p.x[2] = 0; p.x[2] <= n[2]; p.x[2]++)
        for (p.x[1] = 0; p.x[1] <= n[1]; p.x[1]++) {
            if (p.x[1] % 256 == 0 && bw_poll(e->ctx)) return e->ctx->error.status;
            for (p.x[0] = 0; p.x[0] <= n[0]; p.x[0]++, p.at++) put_point(e, &p);
        }
    p.at = e->grid;
    for (p.x[2] = 0; p.x[2] <= n[2]; p.x[2]++)
        for (p.x[1] = 0; p.x[1] <= n[1]; p.x[1]++)
            for (p.x[0] = 0; p.x[0] <= n[0] && status == BW_OK; p.x[0]++, p.at++) status = link_point(e, &p);
    return status;
}

/* ---- hexes one by one ---------------------------------------------------------------------------------------------- */

typedef struct {
    int32_t number[8], back[8]; /* corners of the hex before, and how far back they were; -1, 0: there is none */
} listed;

/* The corner of the hex before that this one is, as CORNER_OF_LAST + axis, or CORNER_BACK. */
static unsigned choose(const encoder *e, const listed *last, unsigned c, int32_t number) {
    if (number < 0) return CORNER_NEW;
    if (last->back[c] && (int32_t)e->places.count - last->back[c] == number) return CORNER_AS_BEFORE;
    for (unsigned k = 0; k < 3; k++)
        if (last->number[c ^ 1u << k] == number) return CORNER_OF_LAST + k;
    return CORNER_BACK;
}

static void put_hex(encoder *e, const bw_hvertex hex[8], listed *last) {
    listed now;
    for (unsigned c = 0; c < 8; c++) {
        unsigned choice = choose(e, last, c, e->number[hex[c]]);
        bw_range_put_tree(&e->coder, &e->model[CHOICE + 8 * c], 3, choice);
        now.back[c] = choice == CORNER_NEW ? 0 : (int32_t)e->places.count - e->number[hex[c]];
        if (choice == CORNER_BACK) bw_range_put_number(&e->coder, &e->model[BACK], (uint64_t)now.back[c]);
        if (choice == CORNER_NEW) {
            bw_bwh_near near = {.axes = c};
            for (unsigned i = 0; i < 27; i++) {
                unsigned m = (i % 3) | (i / 3 % 3) << 1 | (i / 9) << 2;
                near.at[i] = i && i % 3 < 2 && i / 3 % 3 < 2 && i / 9 < 2 && (m & c) == m ? e->number[hex[c ^ m]] : -1;
            }
            put_vertex(e, hex[c], &near, 3);
        }
        now.number[c] = e->number[hex[c]];
    }
    *last = now;
}

/* ---- parts --------------------------------------------------------------------------------------------------------- */

/* Sizes of a part that is a grid, whose vertices are then in e->grid; else *grid is false. */
static bw_status measure(encoder *e, size_t g, uint32_t n[3], bool *grid) {
    *grid = bw_hex_grid_measure(e->mesh, &e->blocks, g, n);
    if (!*grid) return BW_OK;
    bw_status status = make_room(e, n);
    if (status == BW_OK) *grid = fill_grid(e, g, n);
    return status;
}

/* All sizes come before all vertices, so that a reader knows how much there is. */
static bw_status put_size(encoder *e, size_t g, bool *is_grid) {
    uint32_t n[3];
    bw_status status = measure(e, g, n, is_grid);
    if (status != BW_OK) return status;
    bw_range_put(&e->coder, &e->model[LISTED], !*is_grid);
    bw_range_put_number(&e->coder, &e->model[BLOCK], folded((int64_t)e->blocks.key[g] - e->block - 1));
    e->block = e->blocks.key[g];
    if (!*is_grid) n[0] = (uint32_t)(e->blocks.begin[g + 1] - e->blocks.begin[g]);
    for (int k = 0; k < (*is_grid ? 3 : 1); k++) bw_range_put_number(&e->coder, &e->model[SIZE + 128 * k], n[k]);
    return bw_poll(e->ctx);
}

static bw_status put_part(encoder *e, size_t g, bool is_grid) {
    if (is_grid) {
        uint32_t n[3];
        bw_status status = measure(e, g, n, &is_grid);
        if (status == BW_OK) status = put_grid(e, n);
        if (status != BW_OK) return status;
    } else {
        listed last = {{-1, -1, -1, -1, -1, -1, -1, -1}, {0}};
        for (size_t i = e->blocks.begin[g]; i < e->blocks.begin[g + 1]; i++) {
            if (i % 65536 == 0 && bw_poll(e->ctx)) return e->ctx->error.status;
            put_hex(e, e->mesh->hex[e->blocks.item[i]], &last);
        }
    }
    return e->ctx->error.status == BW_OK ? bw_poll(e->ctx) : e->ctx->error.status;
}

static bw_status put_parts(encoder *e) {
    bool *is_grid = bw_alloc(e->ctx, e->blocks.count, sizeof *is_grid);
    bw_status status = is_grid ? BW_OK : e->ctx->error.status;
    for (size_t g = 0; g < e->blocks.count && status == BW_OK; g++) status = put_size(e, g, &is_grid[g]);
    for (size_t g = 0; g < e->blocks.count && status == BW_OK; g++) status = put_part(e, g, is_grid[g]);
    bw_free(e->ctx, is_grid);
    if (status == BW_OK && e->places.count != e->mesh->vertex_count) status = bw_fail(e->ctx, BW_E_CHECK, "a vertex is in no hex");
    bw_range_encoder_finish(&e->coder);
    bw_range_encoder_finish(&e->places.coder);
    bw_bit_writer_finish(&e->places.plain);
    return status == BW_OK ? e->ctx->error.status : status;
}

/* ---- the file ------------------------------------------------------------------------------------------------------ */

static uint32_t crc_of(uint32_t crc, const void *data, size_t size) {
    return (uint32_t)crc32_z(crc, size ? data : (const void *)"", size);
}

static bw_status write_file(encoder *e, const char *path, bw_bwh_sizes *sizes) {
    const bw_bwh_places *p = &e->places;
    size_t bits = p->plain.count;
    if (e->coder.count > UINT32_MAX || p->coder.count > UINT32_MAX) return bw_fail(e->ctx, BW_E_LIMIT, "too much for the compact form");
    bw_bwh_header header = {.magic = "\x89"
                                     "BWH\r\n\x1a\n",
                            .version = BW_BWH_VERSION,
                            .part_count = (uint32_t)e->blocks.count,
                            .vertex_count = e->mesh->vertex_count,
                            .hex_count = e->mesh->hex_count,
                            .subdivide = (uint32_t)e->mesh->subdivide,
                            .kind = (uint8_t)p->kind,
                            .parameter = (uint8_t)p->parameter,
                            .shape_size = (uint32_t)e->coder.count,
                            .places_size = (uint32_t)p->coder.count};
    double lattice[6];
    size_t extra = p->kind == BW_BWH_LATTICE ? sizeof lattice : 0;
    memcpy(lattice, p->low, sizeof p->low), memcpy(lattice + 3, p->step, sizeof p->step);
    header.file_size = sizeof header + extra + e->coder.count + p->coder.count + bits;
    header.body_crc = crc_of(crc_of(crc_of(0, e->coder.byte, e->coder.count), p->coder.byte, p->coder.count), p->plain.byte, bits);
    header.crc = crc_of(crc_of(0, &header, sizeof header), lattice, extra);
    bw_output out;
    bw_output_open(e->ctx, &out, path);
    bw_put_bytes(&out, &header, sizeof header);
    bw_put_bytes(&out, lattice, extra);
    bw_put_bytes(&out, e->coder.byte, e->coder.count);
    bw_put_bytes(&out, p->coder.byte, p->coder.count);
    if (bits) bw_put_bytes(&out, p->plain.byte, bits);
    *sizes = (bw_bwh_sizes){.header = sizeof header + extra, .shape = e->coder.count, .places = p->coder.count + bits};
    memcpy(sizes->step, p->step, sizeof p->step);
    return bw_output_close(&out, NULL);
}

/* ---- all of it ----------------------------------------------------------------------------------------------------- */

static bw_status prepare(encoder *e, int bits) {
    bw_context *ctx = e->ctx;
    size_t n = e->mesh->vertex_count;
    bw_range_encoder_init(ctx, &e->coder);
    bw_bit_models_init(e->model, MODELS);
    if (e->mesh->hex_count >= INT32_MAX || n >= INT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "too many hexes for the compact form");
    bw_status status = bw_hex_groups_of_blocks(ctx, e->mesh, &e->blocks);
    if (status == BW_OK) status = bw_bwh_places_init(ctx, e->mesh, bits, &e->places);
    if (status != BW_OK) return status;
    e->uses = bw_alloc(ctx, n, 1);
    e->number = bw_alloc(ctx, n, sizeof *e->number);
    e->held = bw_alloc(ctx, n, 1);
    e->seen = bw_alloc(ctx, n, sizeof *e->seen);
    if (!e->uses || !e->number || !e->held || !e->seen || bw_bwh_links_init(ctx, n, &e->links)) return ctx->error.status;
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
    bw_free(e->ctx, e->uses), bw_free(e->ctx, e->number), bw_free(e->ctx, e->held), bw_free(e->ctx, e->seen), bw_free(e->ctx, e->grid);
    bw_bwh_links_clear(e->ctx, &e->links);
    bw_range_encoder_clear(&e->coder);
    if (e->places.ctx) bw_bwh_places_clear(&e->places);
}

bw_status bw_bwh_write(bw_context *ctx, const bw_hex_mesh *mesh, int bits, const char *path, bw_bwh_sizes *sizes) {
    encoder *e = bw_alloc(ctx, 1, sizeof *e);
    if (!e) return ctx->error.status;
    bw_bwh_sizes own;
    e->ctx = ctx, e->mesh = mesh, e->block = -1;
    bw_status status = prepare(e, bits);
    if (status == BW_OK) status = put_parts(e);
    if (status == BW_OK) status = write_file(e, path, sizes ? sizes : &own);
    clear(e);
    bw_free(ctx, e);
    return status;
}

bw_status bw_hex_write_bwh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    (void)skin;
    bw_bwh_sizes sizes = {0};
    bw_status status = bw_bwh_write(ctx, mesh, 0, path, &sizes);
    if (bytes) *bytes = sizes.header + sizes.shape + sizes.places;
    return status;
}
