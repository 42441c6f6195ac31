#include "stage/build.h"

#include "mesh/walk.h"

/* Where a torus is cut open: strictly inside an edge at which two of its walls meet at a right angle, perpendicular to it. */
typedef struct {
    bw_cell cell;
    bw_plane plane;
    int64_t length;
} start;

/* Considers the edges of one wall polygon of a cell: keeps the longest right-angled one. */
static void consider(const bw_cells *c, bw_polygon p, bw_cell cell, start *best) {
    bw_half h = c->polygon[p].half;
    do {
        bw_cedge e = c->half[h].edge;
        h = c->half[h].next;
        int slot = c->polygon[p].cell[0] != cell;
        bool flat = true;
        bw_tet tet = c->cell[cell].tet;
        int axis = bw_cells_edge_axis(c, e, tet);
        if (axis < 0) continue;
        bool fraction;
        int64_t x[2];
        for (int i = 0; i < 2; i++) x[i] = bw_cells_floor(c, c->edge[e].vertex[i], tet, axis, &fraction);
        int64_t low = x[0] < x[1] ? x[0] : x[1], length = x[0] < x[1] ? x[1] - x[0] : x[0] - x[1];
        if (length < 2 || length <= best->length) continue;
        bw_walk_wall(c, e, p, &slot, &flat);
        if (!flat) *best = (start){cell, {low + length / 2, (int8_t)axis}, length};
    } while (h != c->polygon[p].half);
}

static start find_start(const bw_cells *c, const bw_complex *x, bw_cell member) {
    start best = {.cell = BW_NONE};
    for (size_t cell = (size_t)member; cell < c->cell_count; cell++) {
        if (x->cell_block[cell] != x->cell_block[member]) continue;
        for (bw_polygon p = c->cell[cell].first; p != BW_NONE; p = bw_cells_next_in_cell(c, p, (bw_cell)cell))
            if (c->polygon[p].flags & BW_WALL) consider(c, p, (bw_cell)cell, &best);
    }
    return best;
}

/* An edge on the block's own boundary has walls that were there before. */
static bool is_rim(const bw_cells *c, bw_cedge e) {
    bw_half head = c->edge[e].half, h = head;
    do {
        uint8_t flags = c->polygon[c->half[h].polygon].flags;
        if (flags & BW_WALL && !(flags & BW_SPLIT)) return true;
        h = c->half[h].radial;
    } while (h != head);
    return false;
}

typedef struct {
    bw_context *ctx;
    bw_cells *cells;
    uint64_t max_cells;
    bw_polygon *stack;
    size_t count, room;
} splitter;

static bw_status add_wall(splitter *s, bw_cell cell, bw_plane plane, bw_polygon known) {
    bw_polygon p = known;
    bw_status status = bw_reserve(s->ctx, &s->stack, &s->room, s->count + 1);
    if (status == BW_OK && s->cells->cell_count >= s->max_cells)
        status = bw_fail(s->ctx, BW_E_LIMIT, "opening a toroidal block cuts the mesh into more than %llu cells",
                         (unsigned long long)s->max_cells);
    if (status == BW_OK && p == BW_NONE) status = bw_cells_cut(s->ctx, s->cells, cell, plane, &p);
    if (status != BW_OK || s->cells->polygon[p].flags & BW_WALL) return status;
    s->cells->polygon[p].flags |= BW_WALL | BW_SPLIT;
    s->cells->polygon[p].distance = 0;
    s->stack[s->count++] = p;
    return BW_OK;
}

/* The fire of MC 5.3: spreads in one iso-plane up to the walls of the block. */
static bw_status flood(splitter *s, const start *from) {
    bw_cells *c = s->cells;
    bw_status status = add_wall(s, from->cell, from->plane, BW_NONE);
    while (s->count && status == BW_OK) {
        bw_polygon p = s->stack[--s->count];
        if (!bw_cells_polygon_is_leaf(c, p)) { /* split since it was burnt: both halves go on */
            status = bw_reserve(s->ctx, &s->stack, &s->room, s->count + 2);
            for (int i = 0; i < 2 && status == BW_OK; i++) s->stack[s->count++] = c->polygon[p].child[i];
            continue;
        }
        bw_half h = c->polygon[p].half;
        do {
            bw_continuation to;
            bw_cedge e = c->half[h].edge;
            if (!is_rim(c, e) && bw_walk_straight(c, e, p, &to)) status = add_wall(s, to.cell, to.plane, to.polygon);
            h = c->half[h].next;
        } while (h != c->polygon[p].half && status == BW_OK);
    }
    return status;
}

static bw_status split_tori(bw_context *ctx, bw_cells *cells, const bw_complex *complex, const bw_torus_list *tori, uint64_t max_cells) {
    splitter s = {.ctx = ctx, .cells = cells, .max_cells = max_cells};
    bw_status status = BW_OK;
    for (size_t i = 0; i < tori->count && status == BW_OK; i++) {
        start from = find_start(cells, complex, tori->cell[i]);
        if (from.cell == BW_NONE) {
            double centre[3];
            bw_tet tet = cells->cell[tori->cell[i]].tet;
            bw_tet_centre(cells->mesh, tet, centre);
            bw_fail_element(ctx, "tet", tet, centre);
            status = bw_fail(ctx, BW_E_ALGORITHM, "the block that holds tet %d is no cuboid and has no right-angled edge to open it at", tet);
        } else {
            status = flood(&s, &from);
        }
        if (status == BW_OK) status = bw_poll(ctx);
    }
    bw_free(ctx, s.stack);
    return status;
}

bw_status bw_build_complex(bw_context *ctx, bw_cells *cells, uint64_t max_cells, bw_complex *complex) {
    bw_torus_list tori = {0};
    size_t splits = 0;
    bw_status status = bw_complex_build(ctx, cells, complex, &tori);
    while (status == BW_OK && tori.count) {
        splits += tori.count;
        status = split_tori(ctx, cells, complex, &tori, max_cells);
        bw_complex_clear(ctx, complex);
        if (status == BW_OK && splits > cells->mesh->tet_count + 1)
            status = bw_fail(ctx, BW_E_ALGORITHM, "opening toroidal blocks does not end");
        if (status == BW_OK) status = bw_complex_build(ctx, cells, complex, &tori);
    }
    bw_free(ctx, tori.cell);
    complex->torus_splits = splits;
    bw_progress(ctx, 0.7);
    if (status == BW_OK) status = bw_complex_check(ctx, cells, complex);
    return status;
}
