/* Cells of the T-mesh: tubes cut alike on all sides, and the rest of every block in few boxes. */
#include <stdlib.h>
#include <string.h>

#include "tspline/parts.h"

typedef struct {
    bw_context *ctx;
    bw_tmesh *mesh;
    uint8_t *end;      /* [arc] bit e: it is cut beside arc_node[arc][e] */
    int64_t *grid[3];  /* walls of the block at hand: along each axis where tubes begin and end */
    size_t lines[3], line_room[3];
    uint8_t *taken;    /* [place of the grid] */
    size_t *bound;     /* [place]: no box from here has more places */
    size_t taken_room, bound_room, cell_room;
} cutter;

/* ---- cuts of arcs -------------------------------------------------------------------------------------------------- */

/* The end of a rib's arc that is at a place of a block: 0 or 1, or -1. */
static int end_at(const bw_rib *rib, int32_t place) { return rib->place[0] == place ? rib->reversed : rib->place[1] == place ? !rib->reversed : -1; }

/* Where two extraordinary arcs of a block meet at a corner, their tubes share a cube. */
static void mark_corners(cutter *c, bw_block block) {
    const bw_atlas *atlas = c->mesh->atlas;
    for (size_t r = atlas->rib_begin[block]; r < atlas->rib_begin[block + 1]; r++) {
        const bw_rib *a = &atlas->rib[r];
        for (size_t s = atlas->rib_begin[block]; s < r && c->mesh->thickness[a->arc]; s++) {
            const bw_rib *b = &atlas->rib[s];
            if (!c->mesh->thickness[b->arc] || a->axis == b->axis) continue;
            for (int e = 0; e < 2; e++) {
                int at = end_at(b, a->place[e]);
                if (at < 0) continue;
                c->end[a->arc] |= (uint8_t)(1 << end_at(a, a->place[e])), c->end[b->arc] |= (uint8_t)(1 << at);
            }
        }
    }
}

static bw_status cut_arcs(cutter *c) {
    bw_tmesh *mesh = c->mesh;
    const bw_complex *x = mesh->atlas->complex;
    c->end = bw_alloc(c->ctx, x->arc_count, sizeof *c->end);
    mesh->cut = bw_alloc(c->ctx, 2 * x->arc_count, sizeof *mesh->cut);
    mesh->cut_begin = bw_alloc(c->ctx, x->arc_count + 1, sizeof *mesh->cut_begin);
    if (!c->end || !mesh->cut || !mesh->cut_begin) return c->ctx->error.status;
    for (bw_block b = 0; b < (bw_block)x->block_count; b++) mark_corners(c, b);
    for (size_t a = 0, n = 0; a < x->arc_count; a++) {
        if (c->end[a] & 1) mesh->cut[n++] = mesh->thickness[a];
        if (c->end[a] & 2) mesh->cut[n++] = BW_TMESH_UNIT * mesh->atlas->length[a] - mesh->thickness[a];
        mesh->cut_begin[a + 1] = n;
    }
    return BW_OK;
}

/* ---- tubes --------------------------------------------------------------------------------------------------------- */

static int compare_cells(const void *a, const void *b) {
    const bw_tcell *x = a, *y = b;
    for (int k = 0; k < 3; k++)
        if (x->low[k] != y->low[k]) return x->low[k] < y->low[k] ? -1 : 1;
    return 0;
}

static bw_status add_cell(cutter *c, bw_block block, const int64_t low[3], const int64_t high[3]) {
    bw_tmesh *mesh = c->mesh;
    if (mesh->cell_count == INT32_MAX) return bw_fail(c->ctx, BW_E_LIMIT, "the T-mesh has more than 2^31 - 1 cells");
    bw_status status = bw_reserve(c->ctx, &mesh->cell, &c->cell_room, mesh->cell_count + 1);
    if (status != BW_OK) return status;
    bw_tcell *cell = &mesh->cell[mesh->cell_count++];
    *cell = (bw_tcell){.block = block};
    memcpy(cell->low, low, sizeof cell->low), memcpy(cell->high, high, sizeof cell->high);
    return BW_OK;
}

/* The part of a tube from `from` to `to` along a rib: one cell for each quarter turn that the block has there. */
static bw_status add_part(cutter *c, bw_block block, const bw_rib *rib, int64_t from, int64_t to) {
    const int64_t t = c->mesh->thickness[rib->arc], *extent = c->mesh->atlas->extent[block];
    const int u = (rib->axis + 1) % 3, v = (rib->axis + 2) % 3;
    int64_t line[3], end[3], low[3], high[3];
    bw_status status = BW_OK;
    bw_trib_ends(c->mesh->atlas, rib, line, end);
    low[rib->axis] = from, high[rib->axis] = to;
    for (int quarter = 0; quarter < 4 && status == BW_OK; quarter++) {
        low[u] = quarter & 1 ? line[u] : line[u] - t, high[u] = low[u] + t;
        low[v] = quarter & 2 ? line[v] : line[v] - t, high[v] = low[v] + t;
        if (low[u] >= 0 && low[v] >= 0 && high[u] <= BW_TMESH_UNIT * extent[u] && high[v] <= BW_TMESH_UNIT * extent[v])
            status = add_cell(c, block, low, high);
    }
    return status;
}

static bw_status add_tube(cutter *c, bw_block block, const bw_rib *rib) {
    const bw_tmesh *mesh = c->mesh;
    int64_t low[3], high[3], from = 0;
    size_t begin = mesh->cut_begin[rib->arc], end = mesh->cut_begin[rib->arc + 1];
    bw_status status = BW_OK;
    bw_trib_ends(mesh->atlas, rib, low, high);
    for (size_t i = begin; i <= end && status == BW_OK; i++) {
        int64_t to = i < end ? mesh->cut[i] : high[rib->axis] - low[rib->axis];
        status = rib->reversed ? add_part(c, block, rib, high[rib->axis] - to, high[rib->axis] - from)
                               : add_part(c, block, rib, low[rib->axis] + from, low[rib->axis] + to);
        from = to;
    }
    return status;
}

/* Tubes of a block, those cubes once that several have. */
static bw_status add_tubes(cutter *c, bw_block block) {
    const bw_atlas *atlas = c->mesh->atlas;
    bw_tmesh *mesh = c->mesh;
    size_t first = mesh->cell_count, kept = first;
    bw_status status = BW_OK;
    for (size_t r = atlas->rib_begin[block]; r < atlas->rib_begin[block + 1] && status == BW_OK; r++)
        if (mesh->thickness[atlas->rib[r].arc]) status = add_tube(c, block, &atlas->rib[r]);
    if (status != BW_OK || mesh->cell_count == first) return status;
    qsort(&mesh->cell[first], mesh->cell_count - first, sizeof *mesh->cell, compare_cells);
    for (size_t i = first; i < mesh->cell_count; i++)
        if (kept == first || compare_cells(&mesh->cell[kept - 1], &mesh->cell[i])) mesh->cell[kept++] = mesh->cell[i];
    mesh->cell_count = kept;
    return BW_OK;
}

/* ---- the rest ------------------------------------------------------------------------------------------------------ */

static int compare_numbers(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

/* The sides of all tubes, and of the block. */
static bw_status lay_grid(cutter *c, bw_block block, size_t first) {
    const bw_tmesh *mesh = c->mesh;
    size_t count = 2 * (mesh->cell_count - first) + 2;
    for (int k = 0; k < 3; k++) {
        bw_status status = bw_reserve(c->ctx, &c->grid[k], &c->line_room[k], count);
        if (status != BW_OK) return status;
        size_t n = 0, kept = 0;
        c->grid[k][n++] = 0, c->grid[k][n++] = BW_TMESH_UNIT * mesh->atlas->extent[block][k];
        for (size_t i = first; i < mesh->cell_count; i++) c->grid[k][n++] = mesh->cell[i].low[k], c->grid[k][n++] = mesh->cell[i].high[k];
        qsort(c->grid[k], n, sizeof *c->grid[k], compare_numbers);
        for (size_t i = 0; i < n; i++)
            if (!kept || c->grid[k][kept - 1] != c->grid[k][i]) c->grid[k][kept++] = c->grid[k][i];
        c->lines[k] = kept;
    }
    return BW_OK;
}

static size_t place_of(const cutter *c, size_t i, size_t j, size_t k) { return i + (c->lines[0] - 1) * (j + (c->lines[1] - 1) * k); }

static size_t line_of(const cutter *c, int axis, int64_t at) {
    const int64_t *found = bsearch(&at, c->grid[axis], c->lines[axis], sizeof at, compare_numbers);
    return (size_t)(found - c->grid[axis]);
}

/* Whether all places of a box are free; or takes them. */
static bool visit(cutter *c, const size_t low[3], const size_t high[3], bool take) {
    for (size_t k = low[2]; k < high[2]; k++)
        for (size_t j = low[1]; j < high[1]; j++)
            for (size_t i = low[0]; i < high[0]; i++) {
                if (take) c->taken[place_of(c, i, j, k)] = 1;
                else if (c->taken[place_of(c, i, j, k)]) return false;
            }
    return true;
}

/* Makes a box longer along an axis, upwards, for as long as what is added is free. */
static void extend(cutter *c, const size_t low[3], size_t high[3], int axis) {
    size_t from[3] = {low[0], low[1], low[2]}, to[3] = {high[0], high[1], high[2]};
    for (from[axis] = high[axis], to[axis] = high[axis] + 1; to[axis] < c->lines[axis] && visit(c, from, to, false); from[axis]++, to[axis]++)
        high[axis] = to[axis];
}

/* The largest box from a place upwards, of those that are made longer along one axis after the other. */
static size_t grow(cutter *c, const size_t low[3], size_t high[3]) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2}, {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    size_t best = 0;
    for (int o = 0; o < 6; o++) {
        size_t to[3] = {low[0] + 1, low[1] + 1, low[2] + 1}, count = 1;
        for (int k = 0; k < 3; k++) extend(c, low, to, order[o][k]);
        for (int k = 0; k < 3; k++) count *= to[k] - low[k];
        if (count > best) best = count, memcpy(high, to, sizeof to);
    }
    return best;
}

/* The free place from which the box is largest. Boxes only get smaller while others are taken, so what a place had before bounds what it has, and few are looked at again. */
static size_t find_largest(cutter *c, size_t low[3], size_t high[3]) {
    for (;;) {
        size_t at[3], place = 0, first = 0, best = 0;
        for (at[2] = 0; at[2] + 1 < c->lines[2]; at[2]++)
            for (at[1] = 0; at[1] + 1 < c->lines[1]; at[1]++)
                for (at[0] = 0; at[0] + 1 < c->lines[0]; at[0]++, place++)
                    if (!c->taken[place] && c->bound[place] > best) best = c->bound[first = place], memcpy(low, at, sizeof at);
        if (!best || (c->bound[first] = grow(c, low, high)) == best) return best;
    }
}

static bw_status fill(cutter *c, bw_block block, size_t places) {
    size_t low[3], high[3];
    for (size_t i = 0; i < places; i++) c->bound[i] = places;
    while (find_largest(c, low, high)) {
        int64_t from[3], to[3];
        visit(c, low, high, true);
        for (int k = 0; k < 3; k++) from[k] = c->grid[k][low[k]], to[k] = c->grid[k][high[k]];
        bw_status status = add_cell(c, block, from, to);
        if (status == BW_OK) status = bw_poll(c->ctx);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

static bw_status cut_block(cutter *c, bw_block block) {
    bw_tmesh *mesh = c->mesh;
    size_t first = mesh->cell_count, places = 1;
    bw_status status = add_tubes(c, block);
    if (status == BW_OK) status = lay_grid(c, block, first);
    for (int k = 0; k < 3 && status == BW_OK; k++)
        if (__builtin_mul_overflow(places, c->lines[k] - 1, &places)) status = bw_fail(c->ctx, BW_E_LIMIT, "block %d has too many tubes", block);
    if (status == BW_OK) status = bw_reserve(c->ctx, &c->taken, &c->taken_room, places);
    if (status == BW_OK) status = bw_reserve(c->ctx, &c->bound, &c->bound_room, places);
    if (status != BW_OK) return status;
    memset(c->taken, 0, places);
    for (size_t i = first; i < mesh->cell_count; i++) {
        size_t low[3], high[3];
        for (int k = 0; k < 3; k++) low[k] = line_of(c, k, mesh->cell[i].low[k]), high[k] = line_of(c, k, mesh->cell[i].high[k]);
        visit(c, low, high, true);
    }
    status = fill(c, block, places);
    if (status != BW_OK) return status;
    qsort(&mesh->cell[first], mesh->cell_count - first, sizeof *mesh->cell, compare_cells);
    mesh->refined_blocks += mesh->cell_count - first > 1;
    mesh->cell_begin[block + 1] = mesh->cell_count;
    return bw_poll(c->ctx);
}

bw_status bw_tmesh_cut(bw_context *ctx, bw_tmesh *mesh) {
    cutter c = {.ctx = ctx, .mesh = mesh};
    size_t blocks = mesh->atlas->complex->block_count;
    mesh->cell_begin = bw_alloc(ctx, blocks + 1, sizeof *mesh->cell_begin);
    bw_status status = mesh->cell_begin ? cut_arcs(&c) : ctx->error.status;
    for (bw_block b = 0; b < (bw_block)blocks && status == BW_OK; b++) status = cut_block(&c, b);
    for (int k = 0; k < 3; k++) bw_free(ctx, c.grid[k]);
    bw_free(ctx, c.end), bw_free(ctx, c.taken), bw_free(ctx, c.bound);
    return status;
}
