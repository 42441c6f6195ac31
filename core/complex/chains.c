/* Chains and corners: the four sides of every patch and the twelve edges of every block as chains of arcs (MC 4.1). */
#include <stdlib.h>
#include <string.h>

#include "complex/build.h"

/* One appearance of an arc in the chain `key`, over the interval start..end of the chain's coordinate. */
typedef struct {
    int64_t start, end;
    int32_t key;
    bw_arc_use use; /* as walked towards larger coordinates */
} appearance;

typedef struct {
    appearance *item;
    size_t count, room;
} appearances;

static int compare(const void *a, const void *b) {
    const appearance *x = a, *y = b;
    if (x->key != y->key) return x->key < y->key ? -1 : 1;
    if (x->start != y->start) return x->start < y->start ? -1 : 1;
    return (x->use > y->use) - (x->use < y->use);
}

static bw_status add(bw_build *b, appearances *list, appearance x) {
    bw_status status = bw_reserve(b->ctx, &list->item, &list->room, list->count + 1);
    if (status == BW_OK) list->item[list->count++] = x;
    return status;
}

bw_node bw_arc_use_start(const bw_complex *complex, bw_arc_use use) { return complex->arc_node[use >> 1][use & 1]; }
bw_node bw_arc_use_end(const bw_complex *complex, bw_arc_use use) { return complex->arc_node[use >> 1][!(use & 1)]; }

/* Where an arc lies in the chart of the block of `cell`, a cell at its first edge. */
typedef struct {
    int64_t at[3];  /* its first node */
    int64_t start, end; /* its interval along `axis` */
    int axis;
    bool reversed;  /* its first node is at the interval's end */
} placement;

static bw_status place(bw_build *b, bw_arc a, bw_cell cell, placement *out) {
    const bw_cells *c = b->cells;
    const bw_complex *x = b->complex;
    bw_cedge e = x->arc_edge[x->arc_edge_begin[a]];
    if (x->arc_node[a][0] == BW_NONE || x->arc_node[a][1] == BW_NONE)
        return bw_fail(b->ctx, BW_E_CHECK, "arc %d is a circle without nodes", a);
    bw_cvertex first = x->node_vertex[x->arc_node[a][0]];
    bw_cvertex second = c->edge[e].vertex[c->edge[e].vertex[0] == first];
    bool exact[3];
    bw_build_locate(b, first, cell, out->at, exact);
    if (!exact[0] || !exact[1] || !exact[2]) return bw_fail(b->ctx, BW_E_CHECK, "a node of arc %d is not on the grid", a);
    bw_tet tet = bw_cells_tet(c, cell);
    int local = bw_cells_edge_axis(c, e, tet);
    if (local < 0) return bw_fail(b->ctx, BW_E_CHECK, "arc %d is not parallel to an axis", a);
    bw_plane turned = bw_transition_plane(bw_complex_chart(x, cell), (bw_plane){0, (int8_t)local});
    int sign = bw_rotation_sign[bw_complex_chart(x, cell)->rotation][turned.axis] * bw_cells_compare_along(c, second, first, tet, local);
    out->axis = turned.axis;
    out->reversed = sign < 0;
    out->start = out->at[out->axis] - (sign < 0 ? x->arc_length[a] : 0);
    out->end = out->start + x->arc_length[a];
    return BW_OK;
}

/* ---- patches ------------------------------------------------------------------------------------------------------- */

/* An appearance of an arc on the rim of a patch. */
typedef struct {
    placement at; /* in the chart of the block on side 0 of the patch */
    bw_patch patch;
    bw_arc arc;
} rim;

typedef struct {
    rim *item;
    size_t count, room;
} rims;

typedef struct {
    int64_t low[3], high[3];
} box;

static void widen(box *r, const placement *at) {
    for (int k = 0; k < 3; k++) {
        int64_t low = k == at->axis ? at->start : at->at[k], high = k == at->axis ? at->end : at->at[k];
        if (low < r->low[k]) r->low[k] = low;
        if (high > r->high[k]) r->high[k] = high;
    }
}

/* All rims, from the walls around the first edge of each arc; extent[patch] becomes the box of its rim. */
static bw_status collect_rims(bw_build *b, rims *list, box *extent) {
    const bw_cells *c = b->cells;
    const bw_complex *x = b->complex;
    for (size_t p = 0; p < x->patch_count; p++)
        for (int k = 0; k < 3; k++) extent[p].low[k] = INT64_MAX, extent[p].high[k] = INT64_MIN;
    for (bw_arc a = 0; a < (bw_arc)x->arc_count; a++) {
        bw_half head = c->edge[x->arc_edge[x->arc_edge_begin[a]]].half, h = head;
        do {
            bw_polygon p = c->half[h].polygon;
            h = c->half[h].radial;
            if (b->polygon_patch[p] == BW_NONE) continue;
            bw_status status = bw_reserve(b->ctx, &list->item, &list->room, list->count + 1);
            rim *r = &list->item[list->count];
            if (status == BW_OK) status = place(b, a, c->polygon[p].cell[b->polygon_slot[p]], &r->at);
            if (status != BW_OK) return status;
            r->arc = a, r->patch = b->polygon_patch[p];
            widen(&extent[r->patch], &r->at);
            list->count++;
        } while (h != head);
    }
    return BW_OK;
}

/* Sides of a patch in the plane of axes u, v: 0: v low, 1: u high, 2: v high, 3: u low. */
static bw_status add_to_side(bw_build *b, appearances *list, const rim *r, const box *extent) {
    const placement *at = &r->at;
    int normal = b->complex->patch_side[r->patch][0] >> 1, u = (normal + 1) % 3, v = (normal + 2) % 3;
    if (at->axis == normal) return bw_fail(b->ctx, BW_E_CHECK, "arc %d on the rim of patch %d leaves its plane", r->arc, r->patch);
    int across = at->axis == u ? v : u;
    bool high = at->at[across] == extent->high[across];
    if (!high && at->at[across] != extent->low[across])
        return bw_fail(b->ctx, BW_E_CHECK, "patch %d is not a rectangle: arc %d crosses it", r->patch, r->arc);
    int side = at->axis == u ? (high ? 2 : 0) : (high ? 1 : 3);
    return add(b, list, (appearance){at->start, at->end, 4 * r->patch + side, 2 * r->arc + at->reversed});
}

/* The appearances of arcs on the sides of patches, and how large these are. */
static bw_status measure_patches(bw_build *b, appearances *list, box *extent) {
    bw_complex *x = b->complex;
    rims all = {0};
    bw_status status = collect_rims(b, &all, extent);
    for (size_t i = 0; i < all.count && status == BW_OK; i++) status = add_to_side(b, list, &all.item[i], &extent[all.item[i].patch]);
    bw_free(b->ctx, all.item);
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++) {
        memcpy(x->patch_low[p], extent[p].low, sizeof x->patch_low[p]);
        int normal = x->patch_side[p][0] >> 1;
        for (int i = 0; i < 2; i++) {
            int k = (normal + 1 + i) % 3;
            x->patch_extent[p][i] = extent[p].high[k] - extent[p].low[k];
        }
    }
    return status;
}

/* ---- chains -------------------------------------------------------------------------------------------------------- */

static void reverse_chain(bw_arc_use *chain, size_t n) {
    for (size_t i = 0; i < n; i++) chain[i] ^= 1;
    for (size_t i = 0; i < n / 2; i++) {
        bw_arc_use swap = chain[i];
        chain[i] = chain[n - 1 - i], chain[n - 1 - i] = swap;
    }
}

/* Writes sorted appearances as chains; chain k must cover low(k)..high(k) without gap or overlap. Reversed chains are walked from the
 * high end. */
static bw_status write_chains(bw_build *b, const char *what, appearances *list, size_t chains, const int64_t (*range)[2],
                              const uint8_t *reversed, size_t *begin, bw_arc_use *out) {
    if (list->count) qsort(list->item, list->count, sizeof *list->item, compare);
    size_t at = 0;
    for (size_t k = 0; k < chains; k++) {
        size_t first = at;
        int64_t reached = range[k][0];
        begin[k] = first;
        for (; at < list->count && list->item[at].key == (int32_t)k; at++) {
            const appearance *a = &list->item[at];
            if (a->start != reached || (at > first && bw_arc_use_start(b->complex, a->use) != bw_arc_use_end(b->complex, a[-1].use)))
                return bw_fail(b->ctx, BW_E_CHECK, "%s %zu has a gap or an overlap in its chain of arcs", what, k);
            reached = a->end;
            out[at] = a->use;
        }
        if (reached != range[k][1] || at == first) return bw_fail(b->ctx, BW_E_CHECK, "%s %zu is not covered by its chain of arcs", what, k);
        if (reversed && reversed[k & 3]) reverse_chain(out + first, at - first);
    }
    begin[chains] = at;
    return BW_OK;
}

static bw_status build_patch_chains(bw_build *b) {
    bw_complex *x = b->complex;
    appearances list = {0};
    size_t n = x->patch_count;
    box *extent = bw_alloc(b->ctx, n, sizeof *extent);
    int64_t(*range)[2] = bw_alloc(b->ctx, 4 * n, sizeof *range);
    static const uint8_t reversed[4] = {0, 0, 1, 1};
    bw_status status = extent && range ? measure_patches(b, &list, extent) : b->ctx->error.status;
    for (size_t p = 0; p < n && status == BW_OK; p++)
        for (int s = 0; s < 4; s++) {
            int axis = ((x->patch_side[p][0] >> 1) + 1 + (s & 1)) % 3;
            range[4 * p + (size_t)s][0] = extent[p].low[axis], range[4 * p + (size_t)s][1] = extent[p].high[axis];
        }
    x->patch_chain_begin = bw_alloc(b->ctx, 4 * n + 1, sizeof *x->patch_chain_begin);
    x->patch_chain = bw_alloc(b->ctx, list.count, sizeof *x->patch_chain);
    x->patch_corner = bw_alloc(b->ctx, n, sizeof *x->patch_corner);
    if (status == BW_OK) status = b->ctx->error.status;
    if (status == BW_OK)
        status = write_chains(b, "patch side", &list, 4 * n, (const int64_t(*)[2])range, reversed, x->patch_chain_begin, x->patch_chain);
    for (size_t k = 0; k < 4 * n && status == BW_OK; k++)
        x->patch_corner[k / 4][k % 4] = bw_arc_use_start(x, x->patch_chain[x->patch_chain_begin[k]]);
    bw_free(b->ctx, extent), bw_free(b->ctx, range), bw_free(b->ctx, list.item);
    return status;
}

/* ---- blocks -------------------------------------------------------------------------------------------------------- */

/* An arc in one cell at its first edge: along an edge of the cell's block, or inside one of its sides (a T-joint). */
static bw_status add_to_block(bw_build *b, appearances *list, bw_arc a, bw_cell cell, size_t since) {
    bw_complex *x = b->complex;
    bw_block block = x->cell_block[cell];
    placement at;
    bw_status status = place(b, a, cell, &at);
    if (status != BW_OK) return status;
    int ends = 0, bits = 0;
    for (int i = 0; i < 2; i++) {
        int k = (at.axis + 1 + i) % 3;
        bool high = at.at[k] == x->block_extent[block][k];
        ends += high || at.at[k] == 0;
        bits |= high << i;
    }
    if (ends == 0) return bw_fail(b->ctx, BW_E_CHECK, "arc %d lies inside block %d", a, block);
    if (ends == 1) {
        x->arc_flags[a] |= BW_ARC_T;
        return BW_OK;
    }
    appearance n = {at.start, at.end, 12 * block + 4 * at.axis + bits, 2 * a + at.reversed};
    for (size_t i = since; i < list->count; i++) /* several cells of a block may meet at the arc */
        if (!compare(&list->item[i], &n)) return BW_OK;
    return add(b, list, n);
}

static bw_status collect_block_edges(bw_build *b, appearances *list) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    for (bw_arc a = 0; a < (bw_arc)x->arc_count; a++) {
        size_t since = list->count;
        bw_half head = c->edge[x->arc_edge[x->arc_edge_begin[a]]].half, h = head;
        do {
            for (int i = 0; i < 2; i++) {
                bw_cell cell = c->polygon[c->half[h].polygon].cell[i];
                bw_status status = cell == BW_NONE ? BW_OK : add_to_block(b, list, a, cell, since);
                if (status != BW_OK) return status;
            }
            h = c->half[h].radial;
        } while (h != head);
    }
    return BW_OK;
}

/* Corners from the block edges along axis 0; those along axes 1 and 2 must agree. */
static bw_status find_corners(bw_build *b) {
    bw_complex *x = b->complex;
    for (size_t k = 0; k < 12 * x->block_count; k++) {
        size_t block = k / 12;
        int axis = (int)(k % 12 / 4), bits = (int)(k % 4);
        int low = (bits & 1) << (axis + 1) % 3 | (bits >> 1) << (axis + 2) % 3;
        bw_node end[2] = {bw_arc_use_start(x, x->block_edge[x->block_edge_begin[k]]),
                          bw_arc_use_end(x, x->block_edge[x->block_edge_begin[k + 1] - 1])};
        for (int i = 0; i < 2; i++) {
            bw_node *corner = &x->block_corner[block][low | i << axis];
            if (axis > 0 && *corner != end[i]) return bw_fail(b->ctx, BW_E_CHECK, "the edges of block %zu do not meet in its corners", block);
            *corner = end[i];
        }
    }
    return BW_OK;
}

static bw_status build_block_edges(bw_build *b) {
    bw_complex *x = b->complex;
    appearances list = {0};
    size_t n = x->block_count;
    int64_t(*range)[2] = bw_alloc(b->ctx, 12 * n, sizeof *range);
    bw_status status = range ? collect_block_edges(b, &list) : b->ctx->error.status;
    for (size_t k = 0; k < 12 * n && status == BW_OK; k++) range[k][1] = x->block_extent[k / 12][k % 12 / 4];
    x->block_edge_begin = bw_alloc(b->ctx, 12 * n + 1, sizeof *x->block_edge_begin);
    x->block_edge = bw_alloc(b->ctx, list.count, sizeof *x->block_edge);
    x->block_corner = bw_alloc(b->ctx, n, sizeof *x->block_corner);
    if (status == BW_OK) status = b->ctx->error.status;
    if (status == BW_OK)
        status = write_chains(b, "block edge", &list, 12 * n, (const int64_t(*)[2])range, NULL, x->block_edge_begin, x->block_edge);
    if (status == BW_OK) status = find_corners(b);
    bw_free(b->ctx, range), bw_free(b->ctx, list.item);
    return status;
}

static bw_status list_sides(bw_build *b) {
    bw_complex *x = b->complex;
    size_t n = 6 * x->block_count;
    size_t *begin = x->block_side_begin = bw_alloc(b->ctx, n + 2, sizeof *begin);
    if (!begin) return b->ctx->error.status;
    for (size_t i = 0; i < 2 * x->patch_count; i++)
        if (x->patch_block[i / 2][i % 2] != BW_NONE) begin[6 * x->patch_block[i / 2][i % 2] + x->patch_side[i / 2][i % 2] + 2]++;
    for (size_t k = 2; k < n + 2; k++) begin[k] += begin[k - 1];
    x->block_side = bw_alloc(b->ctx, begin[n + 1], sizeof *x->block_side);
    if (!x->block_side) return b->ctx->error.status;
    for (size_t i = 0; i < 2 * x->patch_count; i++)
        if (x->patch_block[i / 2][i % 2] != BW_NONE)
            x->block_side[begin[6 * x->patch_block[i / 2][i % 2] + x->patch_side[i / 2][i % 2] + 1]++] = (bw_patch)(i / 2);
    return BW_OK;
}

/* Patches that reduction has to know: those with a singular arc on their rim, and those at a feature node that no singular or feature
 * arc holds in place; without its walls such a node would vanish. */
static bw_status mark_patches(bw_build *b) {
    bw_complex *x = b->complex;
    uint8_t *held = bw_alloc(b->ctx, x->node_count, 1);
    if (!held) return b->ctx->error.status;
    for (size_t a = 0; a < x->arc_count; a++)
        for (int i = 0; i < 2 && x->arc_flags[a] & (BW_ARC_SINGULAR | BW_ARC_FEATURE); i++) held[x->arc_node[a][i]] = 1;
    for (size_t k = 0; k < 4 * x->patch_count; k++)
        for (size_t i = x->patch_chain_begin[k]; i < x->patch_chain_begin[k + 1]; i++) {
            bw_node n = bw_arc_use_start(x, x->patch_chain[i]);
            if (x->arc_flags[x->patch_chain[i] >> 1] & BW_ARC_SINGULAR) x->patch_flags[k / 4] |= BW_PATCH_SINGULAR;
            if (x->node_flags[n] & BW_NODE_FEATURE && !held[n]) x->patch_flags[k / 4] |= BW_PATCH_FEATURE;
        }
    bw_free(b->ctx, held);
    return BW_OK;
}

bw_status bw_build_chains(bw_build *b) {
    bw_status status = build_patch_chains(b);
    if (status == BW_OK) status = build_block_edges(b);
    if (status == BW_OK) status = list_sides(b);
    if (status == BW_OK) status = mark_patches(b);
    return status;
}
