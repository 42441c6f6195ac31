#include "hex/blockfill.h"

#include <string.h>

#include "base/parallel.h"
#include "hex/locate.h"

typedef struct {
    bw_context *ctx;
    const bw_blockwise *map;
    const bw_complex *complex;
    bw_locator locator;
    bw_hex_mesh *mesh;
    int64_t fine;           /* hexes per integer unit */
    int64_t (*extent)[3];   /* [block] in hexes */
    int64_t (*rectangle)[2]; /* [patch] in hexes */
    size_t *arc_first, *patch_first, *block_first; /* their first inner vertex; [count + 1] */
    size_t *hex_first;      /* [block + 1] */
    size_t *side_first;     /* [6 * block + side]: into side_vertex */
    bw_hvertex *side_vertex; /* vertices of each side, first of the axes (side / 2 + 1, side / 2 + 2) mod 3 fastest */
    size_t *row_first;      /* [patch_count + block_count + 1] rows of inner vertices */
    size_t *line_first;     /* [block + 1] rows of hexes */
} filler;

/* ---- numbers ------------------------------------------------------------------------------------------------------- */

enum { LEAST_ROWS = 64 }; /* for a thread */

static size_t inner(int64_t n) { return n > 0 ? (size_t)n - 1 : 0; }

static bw_status too_many(filler *f) { return bw_fail(f->ctx, BW_E_LIMIT, "the hex mesh would have more than 2^31 - 1 vertices or hexes"); }

/* begin[i + 1] = begin[i] + a * b * c. */
static bw_status append(filler *f, size_t *begin, size_t i, size_t a, size_t b, size_t c) {
    size_t product;
    if (__builtin_mul_overflow(a, b, &product) || __builtin_mul_overflow(product, c, &product) ||
        __builtin_add_overflow(begin[i], product, &begin[i + 1]) || begin[i + 1] >= INT32_MAX)
        return too_many(f);
    return BW_OK;
}

static void size_patches(filler *f) {
    const bw_complex *x = f->complex;
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t k = 0; k < 2; k++)
            for (size_t i = x->patch_chain_begin[4 * p + k]; i < x->patch_chain_begin[4 * p + k + 1]; i++)
                f->rectangle[p][k] += f->fine * f->map->atlas->length[x->patch_chain[i] >> 1];
}

static bw_status number_vertices(filler *f) {
    const bw_complex *x = f->complex;
    bw_status status = BW_OK;
    f->arc_first[0] = x->node_count;
    for (size_t a = 0; a < x->arc_count && status == BW_OK; a++) status = append(f, f->arc_first, a, inner(f->fine * f->map->atlas->length[a]), 1, 1);
    f->patch_first[0] = f->arc_first[x->arc_count];
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++)
        status = append(f, f->patch_first, p, inner(f->rectangle[p][0]), inner(f->rectangle[p][1]), 1);
    f->block_first[0] = f->patch_first[x->patch_count];
    for (size_t b = 0; b < x->block_count && status == BW_OK; b++) {
        const int64_t *n = f->extent[b];
        status = append(f, f->block_first, b, inner(n[0]), inner(n[1]), inner(n[2]));
        if (status == BW_OK) status = append(f, f->hex_first, b, (size_t)n[0], (size_t)n[1], (size_t)n[2]);
        if (status == BW_OK) status = append(f, f->line_first, b, 1, (size_t)n[1], (size_t)n[2]);
    }
    return status;
}

static bw_status number_rows(filler *f) {
    const bw_complex *x = f->complex;
    bw_status status = BW_OK;
    for (size_t i = 0; i < x->patch_count + x->block_count && status == BW_OK; i++) {
        const int64_t *n = i < x->patch_count ? f->rectangle[i] : f->extent[i - x->patch_count];
        status = append(f, f->row_first, i, inner(n[1]), i < x->patch_count ? 1 : inner(n[2]), 1);
    }
    return status;
}

/* ---- vertices on the sides of blocks ------------------------------------------------------------------------------- */

static size_t side_place(const filler *f, bw_block b, int side, const int64_t at[3]) {
    int u = (side / 2 + 1) % 3, v = (side / 2 + 2) % 3;
    return f->side_first[6 * (size_t)b + (size_t)side] + (size_t)(at[u] + (f->extent[b][u] + 1) * at[v]);
}

static bw_status lay_out_sides(filler *f) {
    size_t total = 0;
    for (size_t k = 0; k < 6 * f->complex->block_count; k++) {
        const int64_t *n = f->extent[k / 6];
        f->side_first[k] = total;
        total += (size_t)(n[(k % 6 / 2 + 1) % 3] + 1) * (size_t)(n[(k % 6 / 2 + 2) % 3] + 1); /* not more than 24 per hex, of which there are less than 2^31 */
    }
    f->side_vertex = bw_alloc(f->ctx, total, sizeof *f->side_vertex);
    for (size_t i = 0; f->side_vertex && i < total; i++) f->side_vertex[i] = BW_NONE;
    return f->ctx->error.status;
}

/* Puts a vertex of a patch, at u, v of its frame, into the side of its block. */
static bw_status put(filler *f, bw_patch p, int slot, int64_t u, int64_t v, size_t vertex) {
    bw_transition frame = f->map->image[p][slot];
    for (int k = 0; k < 3; k++) frame.shift[k] *= f->fine;
    bw_block b = f->complex->patch_block[p][slot];
    int64_t at[3] = {u, v, 0};
    bw_transition_apply(&frame, at, at);
    for (int k = 0; k < 3; k++)
        if (at[k] < 0 || at[k] > f->extent[b][k]) return bw_fail(f->ctx, BW_E_CHECK, "a vertex of patch %d is outside of block %d", p, b);
    bw_hvertex *place = &f->side_vertex[side_place(f, b, f->complex->patch_side[p][slot], at)];
    if (*place != BW_NONE && *place != (bw_hvertex)vertex) return bw_fail(f->ctx, BW_E_CHECK, "patches do not fit together in a side of block %d", b);
    *place = (bw_hvertex)vertex;
    return BW_OK;
}

/* Walks around a patch: nodes and inner points of the arcs of its sides. */
static bw_status put_rim(filler *f, bw_patch p, int slot) {
    const bw_complex *x = f->complex;
    int64_t at[2] = {0, 0};
    bw_status status = BW_OK;
    for (size_t side = 0; side < 4; side++)
        for (size_t i = x->patch_chain_begin[4 * (size_t)p + side]; i < x->patch_chain_begin[4 * (size_t)p + side + 1]; i++) {
            bw_arc_use use = x->patch_chain[i];
            size_t first = f->arc_first[use >> 1], count = f->arc_first[(use >> 1) + 1] - first;
            for (size_t k = 0; k <= count && status == BW_OK; k++) {
                size_t vertex = k == 0 ? (size_t)bw_arc_use_start(x, use) : first + (use & 1 ? count - k : k - 1);
                status = put(f, p, slot, at[0], at[1], vertex);
                at[side & 1] += side < 2 ? 1 : -1;
            }
        }
    return status;
}

static bw_status put_patch(filler *f, bw_patch p, int slot) {
    bw_status status = put_rim(f, p, slot);
    size_t vertex = f->patch_first[p];
    for (int64_t v = 1; v < f->rectangle[p][1]; v++)
        for (int64_t u = 1; u < f->rectangle[p][0] && status == BW_OK; u++) status = put(f, p, slot, u, v, vertex++);
    return status == BW_OK ? bw_poll(f->ctx) : status;
}

static bw_status fill_sides(filler *f) {
    bw_status status = lay_out_sides(f);
    for (size_t i = 0; i < 2 * f->complex->patch_count && status == BW_OK; i++)
        if (f->complex->patch_block[i / 2][i % 2] != BW_NONE) status = put_patch(f, (bw_patch)(i / 2), (int)(i % 2));
    return status;
}

/* ---- hexes --------------------------------------------------------------------------------------------------------- */

static bw_hvertex vertex_at(const filler *f, bw_block b, const int64_t at[3]) {
    const int64_t *n = f->extent[b];
    for (int k = 0; k < 3; k++)
        if (at[k] == 0 || at[k] == n[k]) return f->side_vertex[side_place(f, b, 2 * k + (at[k] != 0), at)];
    return (bw_hvertex)(f->block_first[b] + (size_t)(at[0] - 1 + (n[0] - 1) * (at[1] - 1 + (n[1] - 1) * (at[2] - 1))));
}

/* The range of `begin` (increasing) that holds i. */
static size_t find(const size_t *begin, size_t count, size_t i) {
    size_t low = 0, high = count;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (begin[middle] <= i) low = middle;
        else high = middle;
    }
    return low;
}

static bw_status make_hexes(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const filler *f = user;
    bw_hex_mesh *m = f->mesh;
    (void)range;
    for (size_t line = begin; line < end; line++) {
        size_t b = find(f->line_first, f->complex->block_count, line), in_block = line - f->line_first[b];
        const int64_t *n = f->extent[b];
        int64_t at[3] = {0, (int64_t)in_block % n[1], (int64_t)in_block / n[1]};
        size_t hex = f->hex_first[b] + in_block * (size_t)n[0];
        for (; at[0] < n[0]; at[0]++, hex++) {
            for (int c = 0; c < 8; c++)
                m->hex[hex][c] = vertex_at(f, (bw_block)b, (int64_t[3]){at[0] + (c & 1), at[1] + (c >> 1 & 1), at[2] + (c >> 2)});
            m->block[hex] = (bw_block)b;
            for (int k = 0; k < 3; k++) m->ijk[hex][k] = (int32_t)at[k];
        }
        if (line % 1024 == 0 && bw_poll(ctx) != BW_OK) return ctx->error.status;
    }
    return BW_OK;
}

/* ---- positions ----------------------------------------------------------------------------------------------------- */

static void set(const filler *f, size_t vertex, const double position[3], bw_hold hold) {
    memcpy(f->mesh->position[vertex], position, sizeof f->mesh->position[vertex]);
    f->mesh->held[vertex] = hold.held;
    f->mesh->carrier[vertex] = hold.carrier;
}

static bw_status place_curves(filler *f) {
    const bw_complex *x = f->complex;
    double at[3];
    bw_hold hold;
    for (size_t n = 0; n < x->node_count; n++) {
        bw_locate_node(&f->locator, (bw_node)n, at, &hold);
        set(f, n, at, hold);
    }
    size_t most = 0;
    for (size_t a = 0; a < x->arc_count; a++)
        if (f->arc_first[a + 1] - f->arc_first[a] > most) most = f->arc_first[a + 1] - f->arc_first[a];
    double(*position)[3] = bw_alloc(f->ctx, most, sizeof *position);
    bw_hold *holds = bw_alloc(f->ctx, most, sizeof *holds);
    bw_status status = f->ctx->error.status;
    for (size_t a = 0; a < x->arc_count && status == BW_OK; a++) {
        size_t count = f->arc_first[a + 1] - f->arc_first[a];
        bw_locate_on_arc(&f->locator, (bw_arc)a, count + 1, position, holds);
        for (size_t i = 0; i < count; i++) set(f, f->arc_first[a] + i, position[i], holds[i]);
    }
    bw_free(f->ctx, position), bw_free(f->ctx, holds);
    return status;
}

static void place_patch_row(const filler *f, bw_patch p, int64_t v) {
    size_t vertex = f->patch_first[p] + inner(f->rectangle[p][0]) * (size_t)(v - 1);
    for (int64_t u = 1; u < f->rectangle[p][0]; u++, vertex++) {
        double q[2] = {(double)u / (double)f->fine, (double)v / (double)f->fine}, at[3];
        bw_hold hold;
        bw_blockwise_back_on_patch(f->map, p, q, q);
        bw_locate_in_patch(&f->locator, p, q, at, &hold);
        set(f, vertex, at, hold);
    }
}

static void place_block_row(const filler *f, bw_block b, int64_t j, int64_t k) {
    const int64_t *n = f->extent[b];
    size_t vertex = f->block_first[b] + inner(n[0]) * (size_t)(j - 1 + (n[1] - 1) * (k - 1));
    for (int64_t i = 1; i < n[0]; i++, vertex++) {
        double q[3] = {(double)i / (double)f->fine, (double)j / (double)f->fine, (double)k / (double)f->fine}, p[3], at[3];
        bw_hold hold;
        bw_blockwise_back(f->map, b, q, p);
        bw_locate_in_block(&f->locator, b, p, at, &hold);
        set(f, vertex, at, hold);
    }
}

static bw_status place_rows(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const filler *f = user;
    size_t patches = f->complex->patch_count, blocks = f->complex->block_count;
    (void)range;
    for (size_t row = begin; row < end; row++) {
        size_t i = find(f->row_first, patches + blocks, row);
        int64_t in = (int64_t)(row - f->row_first[i]);
        if (i < patches) {
            place_patch_row(f, (bw_patch)i, in + 1);
        } else {
            int64_t across = f->extent[i - patches][1] - 1;
            place_block_row(f, (bw_block)(i - patches), in % across + 1, in / across + 1);
        }
        if (row % 64 == 0 && bw_poll(ctx) != BW_OK) return ctx->error.status;
    }
    return BW_OK;
}

/* ---- everything ---------------------------------------------------------------------------------------------------- */

static bw_status allocate(filler *f) {
    const bw_complex *x = f->complex;
    bw_context *ctx = f->ctx;
    f->extent = bw_alloc(ctx, x->block_count, sizeof *f->extent);
    f->rectangle = bw_alloc(ctx, x->patch_count, sizeof *f->rectangle);
    f->arc_first = bw_alloc(ctx, x->arc_count + 1, sizeof *f->arc_first);
    f->patch_first = bw_alloc(ctx, x->patch_count + 1, sizeof *f->patch_first);
    f->block_first = bw_alloc(ctx, x->block_count + 1, sizeof *f->block_first);
    f->hex_first = bw_alloc(ctx, x->block_count + 1, sizeof *f->hex_first);
    f->line_first = bw_alloc(ctx, x->block_count + 1, sizeof *f->line_first);
    f->side_first = bw_alloc(ctx, 6 * x->block_count, sizeof *f->side_first);
    f->row_first = bw_alloc(ctx, x->patch_count + x->block_count + 1, sizeof *f->row_first);
    return ctx->error.status;
}

static bw_status allocate_mesh(filler *f) {
    bw_context *ctx = f->ctx;
    bw_hex_mesh *m = f->mesh;
    m->vertex_count = f->block_first[f->complex->block_count];
    m->hex_count = f->hex_first[f->complex->block_count];
    m->subdivide = (int32_t)f->fine;
    m->position = bw_alloc(ctx, m->vertex_count, sizeof *m->position);
    m->held = bw_alloc(ctx, m->vertex_count, sizeof *m->held);
    m->carrier = bw_alloc(ctx, m->vertex_count, sizeof *m->carrier);
    m->hex = bw_alloc(ctx, m->hex_count, sizeof *m->hex);
    m->block = bw_alloc(ctx, m->hex_count, sizeof *m->block);
    m->ijk = bw_alloc(ctx, m->hex_count, sizeof *m->ijk);
    return ctx->error.status;
}

/* All but positions. */
static bw_status connect(filler *f) {
    bw_status status = allocate(f);
    if (status != BW_OK) return status;
    for (size_t i = 0; i < 3 * f->complex->block_count; i++)
        if (__builtin_mul_overflow(f->fine, f->map->atlas->extent[i / 3][i % 3], &f->extent[i / 3][i % 3])) return too_many(f);
    size_patches(f);
    status = number_vertices(f);
    if (status == BW_OK) status = number_rows(f);
    if (status == BW_OK) status = fill_sides(f);
    if (status == BW_OK) status = allocate_mesh(f);
    if (status != BW_OK) return status;
    size_t lines = f->line_first[f->complex->block_count];
    return bw_parallel(f->ctx, lines, bw_parallel_ranges(f->ctx, lines, LEAST_ROWS), make_hexes, f);
}

static bw_status place_all(filler *f) {
    size_t rows = f->row_first[f->complex->patch_count + f->complex->block_count];
    bw_status status = bw_locator_init(f->ctx, f->map, &f->locator);
    if (status == BW_OK) status = place_curves(f);
    return status == BW_OK ? bw_parallel(f->ctx, rows, bw_parallel_ranges(f->ctx, rows, LEAST_ROWS), place_rows, f) : status;
}

static void clear(filler *f) {
    bw_locator_clear(f->ctx, &f->locator);
    void *scratch[] = {f->extent, f->rectangle, f->arc_first, f->patch_first, f->block_first, f->hex_first, f->line_first, f->side_first,
                       f->side_vertex, f->row_first};
    for (size_t i = 0; i < sizeof scratch / sizeof *scratch; i++) bw_free(f->ctx, scratch[i]);
}

bw_status bw_blockfill(bw_context *ctx, const bw_blockwise *map, int32_t subdivide, bw_hex_mesh *mesh) {
    filler f = {.ctx = ctx, .map = map, .complex = map->atlas->complex, .mesh = mesh, .fine = subdivide};
    memset(mesh, 0, sizeof *mesh);
    if (subdivide < 1) return bw_fail(ctx, BW_E_USAGE, "a hex mesh cannot be subdivided %d times", subdivide);
    bw_status status = connect(&f);
    if (status == BW_OK) status = place_all(&f);
    clear(&f);
    if (status != BW_OK) bw_hex_mesh_clear(ctx, mesh);
    return status;
}
