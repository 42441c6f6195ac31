/* The brush fire of MC 5.2.
 *
 * An entry of the queue says that fire stands at `edge`, coming from the burnt polygon `from`, after travelling `distance` in direction
 * `heading`. When it is taken out, and the edge is alive, the fire crosses: the polygon that continues `from` straight across
 * the edge is found or made by one cut, burnt, and the fire stands at its other edges.
 *
 *   kept from the paper   entries inside a tet go first, so a wall crosses a tet whole before the next (5.2.1); distances count
 *                         along the heading only (5.2.2); an edge with three burnt polygons is not crossed again (alive)
 *   different             a cell is cut when the fire crosses into it, not when it arrives: what dies leaves no cut; entries of edges
 *                         and polygons that were split meanwhile are resolved through the split records when taken out
 *
 * The base complex is the same fire without the alive test (MC 2): it stops at singular edges and at the boundary only.
 */
#include "stage/trace.h"

#include "mesh/walk.h"

typedef struct {
    int64_t distance;
    uint64_t age;
    bw_cedge edge;
    bw_polygon from;
    uint8_t late;    /* 0: the edge lies inside a tet, its entry goes first */
    uint8_t heading; /* 2 * axis + (1 if towards smaller values), chart of the first cell of `from` */
} entry;

typedef struct {
    bw_context *ctx;
    bw_cells *cells;
    bw_complex_kind kind;
    uint64_t max_cells, age;
    entry *heap;
    size_t count, room;
    bw_cell *around; /* scratch of list_cells */
    size_t around_room;
} fire;

static bool before(const entry *a, const entry *b) {
    if (a->late != b->late) return a->late < b->late;
    if (a->distance != b->distance) return a->distance < b->distance;
    return a->age < b->age;
}

static bw_status push(fire *f, entry x) {
    bw_status status = bw_reserve(f->ctx, &f->heap, &f->room, f->count + 1);
    if (status != BW_OK) return status;
    x.late = f->cells->edge[x.edge].kind != BW_IN_TET;
    size_t i = f->count++;
    for (; i > 0 && before(&x, &f->heap[(i - 1) / 4]); i = (i - 1) / 4) f->heap[i] = f->heap[(i - 1) / 4];
    f->heap[i] = x;
    return BW_OK;
}

static entry pop(fire *f) {
    entry top = f->heap[0], last = f->heap[--f->count];
    size_t i = 0;
    for (;;) {
        size_t best = 4 * i + 1;
        if (best >= f->count) break;
        for (size_t c = best + 1; c < f->count && c < 4 * i + 5; c++)
            if (before(&f->heap[c], &f->heap[best])) best = c;
        if (!before(&f->heap[best], &last)) break;
        f->heap[i] = f->heap[best];
        i = best;
    }
    f->heap[i] = last;
    return top;
}

/* Smallest coordinate of an edge's ends along a heading. */
static int64_t lowest(const bw_cells *c, bw_cedge e, bw_tet tet, uint8_t heading) {
    int64_t x[2];
    for (int i = 0; i < 2; i++) {
        bool fraction;
        x[i] = bw_cells_floor(c, c->edge[e].vertex[i], tet, heading >> 1, &fraction);
        if (heading & 1) x[i] = -x[i];
    }
    return x[0] < x[1] ? x[0] : x[1];
}

/* A heading carried along a rotation. */
static uint8_t turn(bw_rotation r, uint8_t heading) {
    for (uint8_t i = 0; i < 3; i++)
        if (bw_rotation_axis[r][i] == heading >> 1)
            return (uint8_t)(2 * i + ((heading & 1) ^ (bw_rotation_sign[r][i] < 0)));
    __builtin_unreachable(); /* every axis is the image of one axis */
}

/* Burns a polygon reached across `edge` and sets its other edges on fire. `heading` is in the chart of `cell`, one of its cells. */
static bw_status burn(fire *f, bw_polygon p, bw_cedge edge, bw_cell cell, int64_t distance, uint8_t heading) {
    bw_cells *c = f->cells;
    c->polygon[p].flags |= BW_WALL;
    c->polygon[p].distance = distance;
    if (c->polygon[p].cell[0] != cell) heading = turn(bw_cells_transition(c, p, cell).rotation, heading);
    bw_tet tet = c->cell[c->polygon[p].cell[0]].tet;
    int64_t base = lowest(c, edge, tet, heading);
    bw_half h = c->polygon[p].half;
    do {
        bw_cedge e = c->half[h].edge;
        if (e != edge && !bw_cells_edge_is_boundary(c, e) && !bw_cells_edge_is_singular(c, e)) {
            entry x = {.distance = distance + lowest(c, e, tet, heading) - base, .age = f->age++, .edge = e, .from = p,
                       .heading = heading};
            bw_status status = push(f, x);
            if (status != BW_OK) return status;
        }
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    return BW_OK;
}

static bw_status limited_cut(fire *f, bw_cell cell, bw_plane plane, bw_polygon *section) {
    if (f->cells->cell_count >= f->max_cells)
        return bw_fail(f->ctx, BW_E_LIMIT, "the walls cut the mesh into more than %llu cells; raise --max-cells if the "
                       "parametrization's iso-surfaces really are that long", (unsigned long long)f->max_cells);
    return bw_cells_cut(f->ctx, f->cells, cell, plane, section);
}

/* The cells around an edge, each once, in the order of the radial ring. */
static bw_status list_cells(fire *f, bw_cedge e, size_t *count) {
    bw_cells *c = f->cells;
    bw_half head = c->edge[e].half, h = head;
    *count = 0;
    do {
        for (int i = 0; i < 2; i++) {
            bw_cell cell = c->polygon[c->half[h].polygon].cell[i];
            bool known = cell == BW_NONE;
            for (size_t j = 0; j < *count && !known; j++) known = f->around[j] == cell;
            if (known) continue;
            bw_status status = bw_reserve(f->ctx, &f->around, &f->around_room, *count + 1);
            if (status != BW_OK) return status;
            f->around[(*count)++] = cell;
        }
        h = c->half[h].radial;
    } while (h != head);
    return BW_OK;
}

static bw_polygon polygon_at(const bw_cells *c, bw_cedge e, bw_cell cell) {
    return bw_walk_other(c, e, cell, BW_NONE);
}

/* Ignition in one cell at a singular edge that runs along axis `along` of its chart: burns what the cell has, or gets by a
 * cut, of the plane of constant `axis` through the edge. */
static bw_status ignite_in_cell(fire *f, bw_cedge e, bw_cell cell, int axis, int along) {
    bw_cells *c = f->cells;
    bw_tet tet = c->cell[cell].tet;
    int third = 3 - axis - along;
    bool fraction;
    bw_plane plane[2]; /* through the edge: the wall's, and the one that tells on which side of the edge it is */
    for (int i = 0; i < 2; i++) {
        plane[i].axis = (int8_t)(i ? third : axis);
        plane[i].value = bw_cells_floor(c, c->edge[e].vertex[0], tet, plane[i].axis, &fraction);
    }
    bw_polygon at[3] = {polygon_at(c, e, cell), BW_NONE, BW_NONE};
    at[1] = bw_walk_other(c, e, cell, at[0]);
    int side[2] = {bw_walk_side(c, at[0], e, tet, plane[0]), bw_walk_side(c, at[1], e, tet, plane[0])};
    if (side[0] * side[1] < 0) {
        bw_status status = limited_cut(f, cell, plane[0], &at[2]);
        if (status != BW_OK) return status;
    }
    for (int i = 0; i < 3; i++) {
        if (at[i] == BW_NONE || (i < 2 && side[i]) || c->polygon[at[i]].flags & BW_WALL) continue;
        uint8_t heading = (uint8_t)(2 * third + (bw_walk_side(c, at[i], e, tet, plane[1]) < 0));
        bw_status status = burn(f, at[i], e, cell, 0, heading);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

/* Around one leaf of a singular edge: the planes of both other axes, in every cell. */
static bw_status ignite_edge(fire *f, bw_cedge e) {
    for (int i = 1; i < 3; i++) {
        size_t count;
        bw_status status = list_cells(f, e, &count);
        for (size_t j = 0; j < count && status == BW_OK; j++) {
            int along = bw_cells_edge_axis(f->cells, e, f->cells->cell[f->around[j]].tet);
            status = ignite_in_cell(f, e, f->around[j], (along + i) % 3, along);
        }
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

static bw_status ignite_tree(fire *f, bw_cedge e) {
    if (bw_cells_edge_is_leaf(f->cells, e)) return ignite_edge(f, e);
    for (int i = 0; i < 2; i++) {
        bw_status status = ignite_tree(f, f->cells->edge[e].child[i]);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

/* MC Algorithm 1 and 2: at most two burnt polygons at the edge. */
static bool alive(const bw_cells *c, bw_cedge e) {
    int burnt = 0;
    bw_half head = c->edge[e].half, h = head;
    do {
        burnt += (c->polygon[c->half[h].polygon].flags & BW_WALL) != 0;
        h = c->half[h].radial;
    } while (h != head);
    return burnt <= 2;
}

static bw_status cross(fire *f, entry x) {
    bw_cells *c = f->cells;
    if (!bw_cells_edge_is_leaf(c, x.edge)) {
        bw_cedge child[2] = {c->edge[x.edge].child[0], c->edge[x.edge].child[1]};
        for (int i = 0; i < 2; i++) {
            x.edge = child[i];
            bw_status status = push(f, x);
            if (status != BW_OK) return status;
        }
        return BW_OK;
    }
    if (f->kind == BW_COMPLEX_MC && !alive(c, x.edge)) return BW_OK;
    bw_continuation to;
    bw_polygon from = bw_walk_descendant(c, x.from, x.edge);
    if (from == BW_NONE || !bw_walk_straight(c, x.edge, from, &to))
        return bw_fail(f->ctx, BW_E_INTERNAL, "a wall has no continuation across complex edge %d", x.edge);
    if (to.polygon == BW_NONE) {
        bw_status status = limited_cut(f, to.cell, to.plane, &to.polygon);
        if (status != BW_OK) return status;
    }
    if (c->polygon[to.polygon].flags & BW_WALL) return BW_OK;
    return burn(f, to.polygon, x.edge, to.cell, x.distance, turn(to.chart.rotation, x.heading));
}

bw_status bw_trace(bw_context *ctx, bw_cells *cells, bw_complex_kind kind, uint64_t max_cells) {
    fire f = {.ctx = ctx, .cells = cells, .kind = kind, .max_cells = max_cells};
    bw_status status = BW_OK;
    for (size_t e = 0; e < cells->mesh->edge_count && status == BW_OK; e++)
        if (cells->map->edge_flags[e] & BW_EDGE_SINGULAR) status = ignite_tree(&f, (bw_cedge)e);
    for (uint64_t steps = 0; f.count && status == BW_OK; steps++) {
        status = cross(&f, pop(&f));
        if (status == BW_OK && steps % 4096 == 0) {
            status = bw_poll(ctx);
            bw_progress(ctx, (double)steps / (double)(steps + 8 * f.count + 1));
        }
    }
    bw_free(ctx, f.heap);
    bw_free(ctx, f.around);
    return status;
}
