/* The validator of the cell complex: see the invariants in cells.h. */
#include <string.h>

#include "base/parallel.h"
#include "mesh/cells.h"
#include "mesh/walk.h"

static bw_status violated(bw_context *ctx, const char *what, int64_t id) {
    return bw_fail(ctx, BW_E_CHECK, "cell complex: %s (%lld)", what, (long long)id);
}

static bw_status check_half(bw_context *ctx, const bw_cells *c, bw_half h, bw_polygon p) {
    const bw_cell_half *x = &c->half[h];
    const bw_cell_edge *e = &c->edge[x->edge];
    bw_cvertex end = bw_cells_half_end(c, h);
    if (x->polygon != p) return violated(ctx, "a half-edge names another polygon", h);
    if (!bw_cells_edge_is_leaf(c, x->edge)) return violated(ctx, "a half-edge lies on an edge that was split", h);
    if (!((e->vertex[0] == x->origin && e->vertex[1] == end) || (e->vertex[1] == x->origin && e->vertex[0] == end)))
        return violated(ctx, "a half-edge and its edge have different ends", h);
    bool found = false;
    size_t turns = 0;
    for (bw_half r = c->edge[x->edge].half;; r = c->half[r].radial) {
        found = found || r == h;
        if (c->half[r].edge != x->edge) return violated(ctx, "a radial ring holds another edge's half-edge", r);
        if (c->half[r].radial == c->edge[x->edge].half || ++turns > c->half_count) break;
    }
    return found ? BW_OK : violated(ctx, "a half-edge is missing from its radial ring", h);
}

static bw_status check_polygon(bw_context *ctx, const bw_cells *c, bw_polygon p) {
    size_t n = 0;
    bw_half h = c->polygon[p].half;
    do {
        bw_status status = check_half(ctx, c, h, p);
        if (status != BW_OK) return status;
        if (++n > c->half_count) return violated(ctx, "a polygon's cycle does not close", p);
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    if (n < 3) return violated(ctx, "a polygon has fewer than three vertices", p);
    if (c->polygon[p].cell[0] == BW_NONE) return violated(ctx, "a polygon has no first cell", p);
    return BW_OK;
}

/* Every vertex of a cell lies on the cell's side of each of its iso-planes: cell[0] below, cell[1] above; coplanar is in the plane. */
static bw_status check_convex(bw_context *ctx, const bw_cells *c, bw_cell cell, bw_polygon wall) {
    const bw_cell_polygon *w = &c->polygon[wall];
    if (w->kind != BW_IN_TET) return BW_OK;
    int outside = w->cell[0] == cell ? 1 : -1;
    bw_plane plane = {w->value, w->axis};
    for (bw_polygon p = c->cell[cell].first; p != BW_NONE; p = bw_cells_next_in_cell(c, p, cell)) {
        bw_half h = c->polygon[p].half;
        do {
            int side = bw_cells_side(c, c->half[h].origin, c->cell[cell].tet, plane);
            if (side == outside || (p == wall && side)) return violated(ctx, "a cell's vertex lies beyond its plane", cell);
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    return BW_OK;
}

/* The cell's polygons close up: each of their edges is in exactly two of them; by Euler's formula they form a sphere if they
 * are connected, which two faces per edge and one ring per vertex give: V - E + F = 2. */
static bw_status check_cell(bw_context *ctx, const bw_cells *c, bw_cell cell, bw_cell *seen) {
    long vertices = 0, halves = 0, polygons = 0;
    for (bw_polygon p = c->cell[cell].first; p != BW_NONE; p = bw_cells_next_in_cell(c, p, cell)) {
        polygons++;
        if (!bw_cells_polygon_is_leaf(c, p)) return violated(ctx, "a cell lists a polygon that was split", cell);
        if (c->polygon[p].cell[0] != cell && c->polygon[p].cell[1] != cell)
            return violated(ctx, "a cell lists a polygon that does not name it", cell);
        if (c->polygon[p].kind == BW_IN_TET ? c->polygon[p].carrier != c->cell[cell].tet
                                            : c->mesh->facet_tet[c->polygon[p].carrier][0] != c->cell[cell].tet &&
                                                  c->mesh->facet_tet[c->polygon[p].carrier][1] != c->cell[cell].tet)
            return violated(ctx, "a cell and its polygon lie in different tets", cell);
        bw_half h = c->polygon[p].half;
        do {
            halves++;
            if (seen[c->half[h].origin] != cell) vertices++;
            seen[c->half[h].origin] = cell;
            bw_polygon other = bw_walk_other(c, c->half[h].edge, cell, p);
            if (other == BW_NONE) return violated(ctx, "a cell is open at an edge", cell);
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
        bw_status status = check_convex(ctx, c, cell, p);
        if (status != BW_OK) return status;
    }
    if (2 * vertices - halves + 2 * polygons != 4) return violated(ctx, "a cell is not a ball", cell);
    return BW_OK;
}

typedef struct {
    const bw_cells *cells;
    bw_cell *seen[BW_PARALLEL_MOST]; /* [vertex], one per range: the cell in which a vertex was counted last */
} task;

static bw_status check_polygons(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const bw_cells *cells = ((const task *)user)->cells;
    bw_status status = BW_OK;
    (void)range;
    for (size_t p = begin; p < end && status == BW_OK; p++)
        if (bw_cells_polygon_is_leaf(cells, (bw_polygon)p)) status = check_polygon(ctx, cells, (bw_polygon)p);
    return status;
}

static bw_status check_cells(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const task *t = user;
    bw_status status = BW_OK;
    for (size_t c = begin; c < end && status == BW_OK; c++) status = check_cell(ctx, t->cells, (bw_cell)c, t->seen[range]);
    return status;
}

bw_status bw_cells_check(bw_context *ctx, const bw_cells *cells) {
    enum { LEAST = 2048 }; /* fewer items are not worth a thread */
    task t = {.cells = cells};
    int ranges = bw_parallel_ranges(ctx, cells->cell_count, LEAST);
    for (int i = 0; i < ranges; i++) {
        t.seen[i] = bw_alloc(ctx, cells->vertex_count, sizeof *t.seen[i]);
        if (t.seen[i]) memset(t.seen[i], -1, cells->vertex_count * sizeof *t.seen[i]);
    }
    bw_status status = ctx->error.status;
    if (status == BW_OK)
        status = bw_parallel(ctx, cells->polygon_count, bw_parallel_ranges(ctx, cells->polygon_count, LEAST), check_polygons, &t);
    if (status == BW_OK) status = bw_parallel(ctx, cells->cell_count, ranges, check_cells, &t);
    for (int i = 0; i < ranges; i++) bw_free(ctx, t.seen[i]);
    return status;
}
