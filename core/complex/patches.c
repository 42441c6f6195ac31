/* Patches: maximal coplanar wall pieces between arcs (MC 4.1), and which block is on which side of each. */
#include "base/parallel.h"
#include "complex/build.h"
#include "mesh/walk.h"

/* The side of a block in which a wall polygon lies, seen from the cell in its slot; -1 outside. */
static int64_t seen_from(const bw_build *b, bw_polygon p, int slot) {
    bw_cell cell = b->cells->polygon[p].cell[slot];
    return cell == BW_NONE ? -1 : 8 * (int64_t)b->complex->cell_block[cell] + b->polygon_side[p][slot];
}

/* Which cell of polygon q is on side 0 of the patch, as that in the slot of its neighbour p is. What the cells see tells them apart, unless a block touches
 * one of its sides with that side itself: then one has to walk around the edge between them. */
static int slot_beside(const bw_build *b, bw_polygon p, bw_cedge e, bw_polygon q) {
    int slot = b->polygon_slot[p];
    int64_t seen[2] = {seen_from(b, p, slot), seen_from(b, p, !slot)};
    int64_t other[2] = {seen_from(b, q, 0), seen_from(b, q, 1)};
    bool first = other[0] == seen[0] && other[1] == seen[1], second = other[1] == seen[0] && other[0] == seen[1];
    if (first != second) return second;
    bool inside = b->cells->polygon[p].cell[slot] != BW_NONE;
    if (!inside) slot = !slot;
    bw_walk_wall(b->cells, e, p, &slot, NULL);
    return inside ? slot : !slot;
}

/* Tells the processor what looking at a polygon's edges will need: the polygons across, and what is known of them. */
static void fetch_neighbours(const bw_build *b, bw_polygon p) {
    const bw_cells *c = b->cells;
    bw_half h = c->polygon[p].half;
    do {
        bw_build_edge e = b->edge[c->half[h].edge];
        h = c->half[h].next;
        if ((e & 3) != BW_EDGE_FLAT) continue;
        bw_polygon q = (bw_polygon)(e >> 2) ^ p;
        __builtin_prefetch(&c->polygon[q]);
        __builtin_prefetch(&b->polygon_patch[q]);
        __builtin_prefetch(&b->polygon_side[q]);
        __builtin_prefetch(&b->polygon_slot[q]);
    } while (h != c->polygon[p].half);
}

static void fetch_edges(const bw_build *b, bw_polygon p) {
    const bw_cells *c = b->cells;
    bw_half h = c->polygon[p].half;
    do {
        __builtin_prefetch(&b->edge[c->half[h].edge]);
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
}

/* Grows a patch from one polygon across the edges that are no arcs, each between two wall polygons, keeping its two sides apart. */
static bw_status grow(bw_build *b, bw_polygon seed, bw_patch patch, bw_polygon *list, size_t *count) {
    const bw_cells *c = b->cells;
    size_t at = *count;
    list[(*count)++] = seed;
    b->polygon_patch[seed] = patch;
    b->polygon_slot[seed] = 0;
    for (; at < *count; at++) {
        bw_polygon p = list[at];
        if (at + 8 < *count) __builtin_prefetch(&c->polygon[list[at + 8]]);
        if (at + 6 < *count) __builtin_prefetch(&c->half[c->polygon[list[at + 6]].half]);
        if (at + 4 < *count) fetch_edges(b, list[at + 4]);
        if (at + 2 < *count) fetch_neighbours(b, list[at + 2]);
        bw_half h = c->polygon[p].half;
        do {
            bw_cedge e = c->half[h].edge;
            h = c->half[h].next;
            if ((b->edge[e] & 3) != BW_EDGE_FLAT) continue;
            bw_polygon q = (bw_polygon)(b->edge[e] >> 2) ^ p;
            if (b->polygon_patch[q] != BW_NONE) continue;
            b->polygon_patch[q] = patch;
            b->polygon_slot[q] = (uint8_t)slot_beside(b, p, e, q);
            list[(*count)++] = q;
        } while (h != c->polygon[p].half);
    }
    return bw_poll(b->ctx);
}

static void fetch_blocks(const bw_build *b, bw_polygon p) {
    const bw_cell_polygon *q = &b->cells->polygon[p];
    for (int s = 0; s < 2 && q->cell[s] != BW_NONE; s++) __builtin_prefetch(&b->complex->cell_block[q->cell[s]]);
    if (q->burnt != BW_NONE) __builtin_prefetch(&b->cells->distance[q->burnt]);
}

static bw_status describe(bw_context *ctx, const bw_build *b, bw_patch patch) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    const bw_polygon *list = &x->patch_polygon[x->patch_polygon_begin[patch]];
    size_t n = x->patch_polygon_begin[patch + 1] - x->patch_polygon_begin[patch];
    x->patch_distance[patch] = INT64_MAX;
    for (size_t i = 0; i < n; i++) {
        const bw_cell_polygon *q = &c->polygon[list[i]];
        if (i + 16 < n) __builtin_prefetch(&c->polygon[list[i + 16]]);
        if (i + 8 < n) fetch_blocks(b, list[i + 8]);
        int64_t distance = bw_cells_distance(c, list[i]);
        if (distance < x->patch_distance[patch]) x->patch_distance[patch] = distance;
        if (q->flags & BW_BOUNDARY) x->patch_flags[patch] |= BW_PATCH_BOUNDARY;
        if (q->flags & BW_FEATURE) x->patch_flags[patch] |= BW_PATCH_FEATURE;
        if (q->flags & BW_SPLIT) x->patch_flags[patch] |= BW_PATCH_TORUS;
        for (int s = 0; s < 2; s++) {
            int slot = b->polygon_slot[list[i]] ^ s;
            bw_block block = q->cell[slot] == BW_NONE ? BW_NONE : x->cell_block[q->cell[slot]];
            uint8_t side = block == BW_NONE ? 0 : b->polygon_side[list[i]][slot];
            if (i == 0) x->patch_block[patch][s] = block, x->patch_side[patch][s] = side;
            else if (x->patch_block[patch][s] != block || x->patch_side[patch][s] != side)
                return bw_fail(ctx, BW_E_CHECK, "patch %d is not flat: its polygons lie in different sides of block %d", patch, block);
        }
    }
    return BW_OK;
}

static bw_status describe_patches(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_status status = BW_OK;
    (void)range;
    for (size_t p = begin; p < end && status == BW_OK; p++) status = describe(ctx, user, (bw_patch)p);
    return status;
}

bw_status bw_build_patches(bw_build *b) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    size_t walls = 0, count = 0;
    for (size_t p = 0; p < c->polygon_count; p++) {
        b->polygon_patch[p] = BW_NONE;
        walls += bw_cells_polygon_is_leaf(c, (bw_polygon)p) && c->polygon[p].flags & BW_WALL;
    }
    x->patch_polygon = bw_alloc(b->ctx, walls, sizeof *x->patch_polygon);
    x->patch_polygon_begin = bw_alloc(b->ctx, walls + 1, sizeof *x->patch_polygon_begin);
    bw_status status = b->ctx->error.status;
    for (size_t p = 0; p < c->polygon_count && status == BW_OK; p++) {
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p) || !(c->polygon[p].flags & BW_WALL) || b->polygon_patch[p] != BW_NONE) continue;
        status = grow(b, (bw_polygon)p, (bw_patch)x->patch_count, x->patch_polygon, &count);
        x->patch_polygon_begin[++x->patch_count] = count;
    }
    x->patch_block = bw_alloc(b->ctx, x->patch_count, sizeof *x->patch_block);
    x->patch_side = bw_alloc(b->ctx, x->patch_count, sizeof *x->patch_side);
    x->patch_extent = bw_alloc(b->ctx, x->patch_count, sizeof *x->patch_extent);
    x->patch_low = bw_alloc(b->ctx, x->patch_count, sizeof *x->patch_low);
    x->patch_distance = bw_alloc(b->ctx, x->patch_count, sizeof *x->patch_distance);
    x->patch_flags = bw_alloc(b->ctx, x->patch_count, 1);
    int ranges = bw_parallel_ranges(b->ctx, walls, 16384);
    return bw_parallel_pieces(b->ctx, x->patch_count, 1, ranges, describe_patches, b);
}
