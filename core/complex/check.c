/* The validator of the block complex: every property of MC 4.1, from the finished structure.
 *
 *  blocks    are cuboids: positive extents, six sides tiled exactly by their patches (areas and rectangles inside the side), twelve edges
 *            covered by their chains, eight corners; the charts of their cells agree, every wall polygon lies in a side
 *  edges     of 90 degrees: every arc that a block touches lies along an edge of the block or inside a side of it
 *  patches   are rectangles: their chains form a closed walk, opposite sides are equally long
 *  regular   every singular edge is part of an arc
 *  features  facets are walls, edges are parts of arcs, vertices are nodes
 *  topology  nodes - arcs + patches - blocks is the Euler characteristic of the mesh
 *  volume    the volumes of all boxes add up to that of the map. The chart of a block is a local homeomorphism onto its box that takes
 *            boundary to boundary, hence a covering of one or more sheets; equal sums mean one sheet each.
 */
#include "base/parallel.h"
#include "complex/complex.h"

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *x;
} checker;

/* The checker for a range of items, which has a context of its own. */
static checker of_range(bw_context *ctx, const void *user) {
    checker k = *(const checker *)user;
    k.ctx = ctx;
    return k;
}

#define VIOLATED(k, ...) bw_fail((k)->ctx, BW_E_CHECK, "block complex: " __VA_ARGS__)

static int64_t chain_length(const bw_complex *x, const bw_arc_use *chain, size_t begin, size_t end) {
    int64_t length = 0;
    for (size_t i = begin; i < end; i++) length += x->arc_length[chain[i] >> 1];
    return length;
}

static bool chain_is_connected(const bw_complex *x, const bw_arc_use *chain, size_t begin, size_t end) {
    for (size_t i = begin + 1; i < end; i++)
        if (bw_arc_use_end(x, chain[i - 1]) != bw_arc_use_start(x, chain[i])) return false;
    return begin < end;
}

static bw_status check_arcs(const checker *k) {
    const bw_complex *x = k->x;
    for (size_t a = 0; a < x->arc_count; a++) {
        if (x->arc_node[a][0] == BW_NONE || x->arc_node[a][1] == BW_NONE) return VIOLATED(k, "arc %zu has no nodes", a);
        if (x->arc_length[a] <= 0) return VIOLATED(k, "arc %zu has no length", a);
        for (size_t i = x->arc_edge_begin[a]; i < x->arc_edge_begin[a + 1]; i++) {
            bool singular = bw_cells_edge_is_singular(k->cells, x->arc_edge[i]);
            if (singular != ((x->arc_flags[a] & BW_ARC_SINGULAR) != 0)) return VIOLATED(k, "arc %zu is singular in parts only", a);
        }
    }
    return BW_OK;
}

static bw_status check_patches(const checker *k) {
    const bw_complex *x = k->x;
    for (size_t p = 0; p < x->patch_count; p++) {
        for (size_t s = 0; s < 4; s++) {
            size_t begin = x->patch_chain_begin[4 * p + s], end = x->patch_chain_begin[4 * p + s + 1];
            if (!chain_is_connected(x, x->patch_chain, begin, end)) return VIOLATED(k, "side %zu of patch %zu is no chain", s, p);
            if (bw_arc_use_start(x, x->patch_chain[begin]) != x->patch_corner[p][s] ||
                bw_arc_use_end(x, x->patch_chain[end - 1]) != x->patch_corner[p][(s + 1) % 4])
                return VIOLATED(k, "side %zu of patch %zu does not join its corners", s, p);
            if (chain_length(x, x->patch_chain, begin, end) != x->patch_extent[p][s & 1])
                return VIOLATED(k, "side %zu of patch %zu has another length than the patch", s, p);
        }
        if (x->patch_block[p][0] == BW_NONE) return VIOLATED(k, "patch %zu has no block", p);
        if ((x->patch_block[p][1] == BW_NONE) != ((x->patch_flags[p] & BW_PATCH_BOUNDARY) != 0))
            return VIOLATED(k, "patch %zu is on the boundary in parts only", p);
    }
    return BW_OK;
}

static bw_status check_block(const checker *k, size_t block) {
    const bw_complex *x = k->x;
    for (int a = 0; a < 3; a++)
        if (x->block_extent[block][a] <= 0) return VIOLATED(k, "block %zu has no extent along axis %d", block, a);
    for (size_t s = 0; s < 6; s++) {
        const int64_t *extent = x->block_extent[block];
        __int128 whole = (__int128)extent[(s / 2 + 1) % 3] * extent[(s / 2 + 2) % 3], area = 0;
        for (size_t i = x->block_side_begin[6 * block + s]; i < x->block_side_begin[6 * block + s + 1]; i++) {
            bw_patch p = x->block_side[i];
            area += (__int128)x->patch_extent[p][0] * x->patch_extent[p][1];
        }
        if (area != whole) return VIOLATED(k, "side %zu of block %zu is not covered by its patches", s, block);
    }
    for (size_t e = 0; e < 12; e++) {
        size_t begin = x->block_edge_begin[12 * block + e], end = x->block_edge_begin[12 * block + e + 1];
        if (!chain_is_connected(x, x->block_edge, begin, end)) return VIOLATED(k, "edge %zu of block %zu is no chain", e, block);
        if (chain_length(x, x->block_edge, begin, end) != x->block_extent[block][e / 4])
            return VIOLATED(k, "edge %zu of block %zu has another length than the block", e, block);
        size_t axis = e / 4, low = (e & 1) << (axis + 1) % 3 | (e >> 1 & 1) << (axis + 2) % 3;
        if (bw_arc_use_start(x, x->block_edge[begin]) != x->block_corner[block][low] ||
            bw_arc_use_end(x, x->block_edge[end - 1]) != x->block_corner[block][low | 1u << axis])
            return VIOLATED(k, "edge %zu of block %zu does not join its corners", e, block);
    }
    return BW_OK;
}

/* Whether two neighbouring cells of a block have the same chart; `across` leads from that of cell[0] to that of cell[1]. */
static bool same_chart(const bw_complex *x, const bw_cell cell[2], const bw_transition *across) {
    if (x->cell_block[cell[0]] != x->cell_block[cell[1]]) return false;
    if (!across && x->cell_chart[cell[0]] == x->cell_chart[cell[1]]) return true;
    bw_transition other = *bw_complex_chart(x, cell[1]);
    if (across) other = bw_transition_compose(&other, across);
    return bw_transition_equal(&other, bw_complex_chart(x, cell[0]));
}

/* Neighbouring cells of a block have the same chart: in tets that are not opened, ... */
static bw_status check_facets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker own = of_range(ctx, user), *k = &own;
    const bw_cells *c = k->cells;
    (void)range;
    for (size_t f = begin; f < end; f++) {
        if (c->of_facet[f] != BW_NONE) continue;
        const bw_tet *tet = c->mesh->facet_tet[f];
        bw_transition across;
        bool same = bw_grid_map_same_chart(c->map, (bw_facet)f);
        if (!same) across = bw_grid_map_across(c->mesh, c->map, (bw_facet)f, tet[0]);
        if (!same_chart(k->x, tet, same ? NULL : &across)) return VIOLATED(k, "cells %d and %d of one block are laid out differently", tet[0], tet[1]);
    }
    return BW_OK;
}

/* Every wall polygon lies in a side of the box of its block. */
static bw_status check_wall(const checker *k, bw_polygon p) {
    const bw_cells *c = k->cells;
    const bw_complex *x = k->x;
    const bw_cell_polygon *q = &c->polygon[p];
    for (int s = 0; s < 2 && q->cell[s] != BW_NONE; s++) {
        bw_plane plane = bw_cells_polygon_plane(c, p, bw_cells_tet(c, q->cell[s]));
        if (plane.axis < 0) return VIOLATED(k, "wall polygon %d is not aligned", p);
        plane = bw_transition_plane(bw_complex_chart(x, q->cell[s]), plane);
        if (plane.value != 0 && plane.value != x->block_extent[x->cell_block[q->cell[s]]][plane.axis])
            return VIOLATED(k, "wall polygon %d is in no side of block %d", p, x->cell_block[q->cell[s]]);
    }
    return BW_OK;
}

/* ... and across polygons. */
static bw_status check_polygons(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker own = of_range(ctx, user), *k = &own;
    const bw_cells *c = k->cells;
    bw_status status = BW_OK;
    (void)range;
    for (size_t p = begin; p < end && status == BW_OK; p++) {
        const bw_cell_polygon *q = &c->polygon[p];
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p)) continue;
        if (q->flags & BW_WALL) {
            status = check_wall(k, (bw_polygon)p);
            continue;
        }
        bw_transition across;
        bool same = q->kind == BW_IN_TET || bw_grid_map_same_chart(c->map, q->carrier);
        if (!same) across = bw_cells_transition(c, (bw_polygon)p, q->cell[0]);
        if (!same_chart(k->x, q->cell, same ? NULL : &across))
            status = VIOLATED(k, "cells %d and %d of one block are laid out differently", q->cell[0], q->cell[1]);
    }
    return status;
}

/* Runs a check of items on the job's threads. */
static bw_status check_all(bw_context *ctx, size_t count, bw_parallel_work *check, void *user) {
    enum { PIECE = 4096 }; /* fewer items are not worth a thread; walls lie together, so the cost of items differs */
    return bw_parallel_pieces(ctx, count, PIECE, bw_parallel_ranges(ctx, count, PIECE), check, user);
}

/* Whether a vertex lies in the box of the block of `cell`, one of its cells. */
static bool is_inside(const checker *k, bw_cell cell, bw_cvertex vertex) {
    const bw_transition *chart = bw_complex_chart(k->x, cell);
    const int64_t *extent = k->x->block_extent[k->x->cell_block[cell]];
    int64_t at[3];
    unsigned fractions = bw_cells_locate(k->cells, vertex, bw_cells_tet(k->cells, cell), at);
    for (int i = 0; i < 3; i++) {
        int axis = bw_rotation_axis[chart->rotation][i];
        int64_t fraction = fractions >> axis & 1; /* the coordinate lies in low..low + fraction */
        int64_t low = chart->shift[i] + (bw_rotation_sign[chart->rotation][i] > 0 ? at[axis] : -at[axis] - fraction);
        if (low < 0 || low + fraction > extent[i]) return false;
    }
    return true;
}

/* Every block lies in its box. A coordinate of its chart, which is one-to-one near every point inside, is largest and smallest on its walls; these are flat
 * in the chart, so it is on their rims: on arcs. */
static bw_status check_inside(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker own = of_range(ctx, user), *k = &own;
    const bw_cells *c = k->cells;
    (void)range;
    for (size_t i = begin; i < end; i++) {
        const bw_cell_edge *e = &c->edge[k->x->arc_edge[i]];
        bw_half h = e->half;
        do {
            const bw_cell_polygon *p = &c->polygon[c->half[h].polygon]; /* all cells up to the next wall have the wall's chart */
            for (int s = 0; s < 4 && p->flags & BW_WALL; s++) {
                bw_cell cell = p->cell[s >> 1];
                if (cell != BW_NONE && !is_inside(k, cell, e->vertex[s & 1]))
                    return VIOLATED(k, "an arc around block %d leaves its box in cell %d", k->x->cell_block[cell], cell);
            }
            h = c->half[h].radial;
        } while (h != e->half);
    }
    return BW_OK;
}

static bw_status check_singular(const checker *k) {
    const bw_cells *c = k->cells;
    uint8_t *on_arc = bw_alloc(k->ctx, c->edge_count, 1);
    if (!on_arc) return k->ctx->error.status;
    bw_status status = BW_OK;
    for (size_t i = 0; i < k->x->arc_edge_begin[k->x->arc_count]; i++) on_arc[k->x->arc_edge[i]] = 1;
    for (size_t e = 0; e < c->edge_count && status == BW_OK; e++)
        if (bw_cells_edge_is_leaf(c, (bw_cedge)e) && bw_cells_edge_is_singular(c, (bw_cedge)e) && !on_arc[e])
            status = VIOLATED(k, "the singular edge %d is no part of an arc", c->edge[e].carrier);
    for (size_t e = 0; e < c->mesh->edge_count && status == BW_OK; e++)
        if (c->map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE) && c->of_edge[e] == BW_NONE)
            status = VIOLATED(k, "the singular or feature edge %zu is no part of an arc", e);
    bw_free(k->ctx, on_arc);
    return status;
}

/* Features end on walls, arcs and nodes. */
static bw_status check_features(const checker *k) {
    const bw_cells *c = k->cells;
    const bw_tet_mesh *m = c->mesh;
    const bw_complex *x = k->x;
    for (size_t p = 0; p < c->polygon_count; p++)
        if (bw_cells_polygon_is_leaf(c, (bw_polygon)p) && c->polygon[p].flags & BW_FEATURE && !(c->polygon[p].flags & BW_WALL))
            return VIOLATED(k, "a feature facet is no wall (facet %d)", c->polygon[p].carrier);
    for (size_t i = 0; i < m->feature_facet_count; i++) {
        bw_polygon p = c->of_facet[bw_tet_mesh_find_facet(m, m->feature_facet[i])];
        if (p == BW_NONE || !(c->polygon[p].flags & BW_FEATURE)) return VIOLATED(k, "feature facet %zu is no wall", i);
    }
    if (m->feature_edge_count + m->feature_vertex_count == 0) return BW_OK;
    uint8_t *edge_on_arc = bw_alloc(k->ctx, c->edge_count, 1), *vertex_is_node = bw_alloc(k->ctx, c->vertex_count, 1);
    bw_status status = k->ctx->error.status;
    for (size_t i = 0; status == BW_OK && i < x->arc_edge_begin[x->arc_count]; i++) edge_on_arc[x->arc_edge[i]] = 1;
    for (size_t i = 0; status == BW_OK && i < x->node_count; i++) vertex_is_node[x->node_vertex[i]] = 1;
    for (size_t e = 0; status == BW_OK && e < c->edge_count; e++)
        if (bw_cells_edge_is_leaf(c, (bw_cedge)e) && bw_cells_edge_is_feature(c, (bw_cedge)e) && !edge_on_arc[e])
            status = VIOLATED(k, "the feature edge %d is no part of an arc", c->edge[e].carrier);
    for (size_t i = 0; status == BW_OK && i < m->feature_vertex_count; i++)
        if (!vertex_is_node[m->feature_vertex[i]]) status = VIOLATED(k, "the feature vertex %d is no node", m->feature_vertex[i]);
    bw_free(k->ctx, edge_on_arc);
    bw_free(k->ctx, vertex_is_node);
    return status;
}

static bw_status check_topology(const checker *k) {
    const bw_tet_mesh *m = k->cells->mesh;
    const bw_complex *x = k->x;
    uint8_t *used = bw_alloc(k->ctx, m->vertex_count, 1);
    if (!used) return k->ctx->error.status;
    int64_t mesh = (int64_t)m->facet_count - (int64_t)m->edge_count - (int64_t)m->tet_count;
    for (size_t t = 0; t < 4 * m->tet_count; t++) {
        mesh += !used[m->tet[t / 4][t % 4]];
        used[m->tet[t / 4][t % 4]] = 1;
    }
    bw_free(k->ctx, used);
    int64_t complex = (int64_t)x->node_count - (int64_t)x->arc_count + (int64_t)x->patch_count - (int64_t)x->block_count;
    return mesh == complex ? BW_OK
                           : VIOLATED(k, "its Euler characteristic is %lld, that of the mesh %lld", (long long)complex, (long long)mesh);
}

/* An exact sum of products a * b * c of differences of grid values: |a b| < 2^98, so that 2^28 summands fit. */
typedef struct {
    __int128 high, low; /* high * 2^48 + low */
} volume;

static void add_product(volume *sum, __int128 ab, int64_t c) {
    sum->high += (ab >> 48) * c;
    sum->low += (ab & (((__int128)1 << 48) - 1)) * c;
}

/* Whether two sums are equal. */
static bool same_volume(const volume *a, const volume *b) {
    __int128 low = a->low - b->low, high = b->high - a->high;
    return (low & (((__int128)1 << 48) - 1)) == 0 && low >> 48 == high;
}

/* Six times the volume of the map, in parts: exact, so it does not matter who added what. */
typedef struct {
    const bw_cells *cells;
    volume part[BW_PARALLEL_MOST];
} map_volume;

static bw_status add_tets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    map_volume *m = user;
    volume sum = {0, 0};
    (void)ctx;
    for (size_t t = begin; t < end; t++) {
        int64_t d[3][3];
        for (int i = 0; i < 9; i++)
            d[i / 3][i % 3] = m->cells->map->value[t][i / 3 + 1][i % 3] - m->cells->map->value[t][0][i % 3];
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3, l = (i + 2) % 3;
            add_product(&sum, (__int128)d[1][j] * d[2][l] - (__int128)d[1][l] * d[2][j], d[0][i]);
        }
    }
    m->part[range].high += sum.high, m->part[range].low += sum.low;
    return BW_OK;
}

static bw_status check_volume(const checker *k) {
    volume boxes = {0, 0};
    map_volume tets = {.cells = k->cells};
    for (size_t b = 0; b < k->x->block_count; b++) {
        const int64_t *extent = k->x->block_extent[b];
        add_product(&boxes, (__int128)6 * extent[0] * extent[1], extent[2]);
    }
    bw_status status = check_all(k->ctx, k->cells->mesh->tet_count, add_tets, &tets);
    for (int i = 1; i < BW_PARALLEL_MOST; i++) tets.part[0].high += tets.part[i].high, tets.part[0].low += tets.part[i].low;
    if (status != BW_OK) return status;
    return same_volume(&boxes, &tets.part[0]) ? BW_OK : VIOLATED(k, "the volumes of its blocks do not add up to the map's");
}

bw_status bw_complex_check(bw_context *ctx, const bw_cells *cells, const bw_complex *complex) {
    checker k = {ctx, cells, complex};
    bw_status status = check_arcs(&k);
    if (status == BW_OK) status = check_patches(&k);
    for (size_t b = 0; b < complex->block_count && status == BW_OK; b++) status = check_block(&k, b);
    if (status == BW_OK) status = check_all(ctx, cells->mesh->facet_count, check_facets, &k);
    if (status == BW_OK) status = check_all(ctx, cells->polygon_count, check_polygons, &k);
    if (status == BW_OK) status = check_all(ctx, complex->arc_edge_begin[complex->arc_count], check_inside, &k);
    if (status == BW_OK) status = check_singular(&k);
    if (status == BW_OK) status = check_features(&k);
    if (status == BW_OK) status = check_topology(&k);
    if (status == BW_OK) status = check_volume(&k);
    return status;
}
