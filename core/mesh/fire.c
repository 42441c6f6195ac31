#include "mesh/fire.h"

#include <string.h>

#include "mesh/walk.h"

struct bw_fire_entry {
    int64_t distance;
    uint64_t age;
    bw_cedge edge;
    bw_polygon from;
    uint8_t late;    /* 0: the edge lies inside a tet, its entry goes first */
    uint8_t heading; /* 2 * axis + (1 if towards smaller values), chart of the first cell of `from`; or EVERYWHERE */
};
typedef bw_fire_entry entry;

/* The heading of fire that a point lit: it spreads in its plane to all sides, and its distance is the length of the way it took. */
enum { EVERYWHERE = 6 };

void bw_fire_init(bw_fire *fire, bw_context *ctx, bw_cells *cells, const bw_fire_rules *rules) {
    memset(fire, 0, sizeof *fire);
    fire->ctx = ctx, fire->cells = cells, fire->rules = *rules;
}

void bw_fire_clear(bw_fire *fire) {
    bw_free(fire->ctx, fire->heap);
    bw_free(fire->ctx, fire->around);
    fire->heap = NULL, fire->around = NULL;
}

/* ---- the queue ----------------------------------------------------------------------------------------------------- */

/* Distance, then age, as one number: no branch can foretell how two of them compare. */
static unsigned __int128 place_of(const entry *x) {
    return (unsigned __int128)((uint64_t)x->distance ^ (uint64_t)1 << 63) << 64 | x->age;
}

static bool before(const entry *a, const entry *b) {
    if (a->late != b->late) return a->late < b->late;
    return place_of(a) < place_of(b);
}

static bw_status push(bw_fire *f, entry x) {
    bw_status status = bw_reserve(f->ctx, &f->heap, &f->room, f->count + 1);
    if (status != BW_OK) return status;
    x.late = f->cells->edge[x.edge].kind != BW_IN_TET;
    size_t i = f->count++;
    for (; i > 0 && before(&x, &f->heap[(i - 1) / 4]); i = (i - 1) / 4) f->heap[i] = f->heap[(i - 1) / 4];
    f->heap[i] = x;
    return BW_OK;
}

static entry pop(bw_fire *f) {
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

/* ---- burning ------------------------------------------------------------------------------------------------------- */

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

/* How far apart two edges of one polygon are: of their low corners, along the axis where it is most. */
static int64_t step_between(const bw_cells *c, bw_cedge from, bw_cedge to, bw_tet tet) {
    int64_t most = 0;
    for (uint8_t axis = 0; axis < 3; axis++) {
        int64_t step = lowest(c, to, tet, (uint8_t)(2 * axis)) - lowest(c, from, tet, (uint8_t)(2 * axis));
        if (step < 0) step = -step;
        if (step > most) most = step;
    }
    return most;
}

/* Of fire that enters a polygon at one edge and stands at another. Hexes are counted, whichever way it goes (MC 5.1); their faces are halved, and diagonals pass for nothing. */
static int64_t step_to(const bw_cells *c, bw_cedge from, bw_cedge to, bw_tet tet, uint8_t heading) {
    if (c->mesh->of_hexes) return bw_cells_edge_axis(c, to, tet) < 0 ? 0 : (int64_t)1 << c->map->exponent;
    return heading == EVERYWHERE ? step_between(c, from, to, tet) : lowest(c, to, tet, heading) - lowest(c, from, tet, heading);
}

/* A heading carried along a rotation. */
static uint8_t turn(bw_rotation r, uint8_t heading) {
    if (heading == EVERYWHERE) return heading;
    for (uint8_t i = 0; i < 3; i++)
        if (bw_rotation_axis[r][i] == heading >> 1)
            return (uint8_t)(2 * i + ((heading & 1) ^ (bw_rotation_sign[r][i] < 0)));
    __builtin_unreachable(); /* every axis is the image of one axis */
}

/* Burns a polygon reached across `edge` (BW_NONE: lit by itself) and sets its other edges on fire. `heading` is in the chart of `cell`,
 * one of its cells. */
static bw_status burn(bw_fire *f, bw_polygon p, bw_cedge edge, bw_cell cell, int64_t distance, uint8_t heading) {
    bw_cells *c = f->cells;
    bw_status status = bw_reserve(f->ctx, &c->distance, &c->distance_room, c->distance_count + 1);
    if (status != BW_OK) return status;
    c->polygon[p].flags |= (uint8_t)(BW_WALL | f->rules.flags);
    c->polygon[p].burnt = (int32_t)c->distance_count;
    c->distance[c->distance_count++] = distance;
    if (c->polygon[p].cell[0] != cell) heading = turn(bw_cells_transition(c, p, cell).rotation, heading);
    bw_tet tet = bw_cells_tet(c, c->polygon[p].cell[0]);
    bw_cedge start = edge == BW_NONE ? c->half[c->polygon[p].half].edge : edge;
    bw_half h = c->polygon[p].half;
    do {
        bw_cedge e = c->half[h].edge;
        if (e != edge && !bw_cells_edge_is_boundary(c, e) && !bw_cells_edge_is_singular(c, e)) {
            entry x = {.distance = distance + step_to(c, start, e, tet, heading), .age = f->age++, .edge = e, .from = p, .heading = heading};
            status = push(f, x);
            if (status != BW_OK) return status;
        }
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    return BW_OK;
}

bw_status bw_fire_cut(bw_fire *f, bw_cell cell, bw_plane plane, bw_polygon *section) {
    bw_status status = bw_cells_cut(f->ctx, f->cells, cell, plane, section);
    if (status == BW_OK && f->cells->cell_count - f->cells->mesh->tet_count > f->rules.max_cells)
        status = bw_fail(f->ctx, BW_E_LIMIT, "the walls' cuts add more than %llu cells to the mesh; raise --max-cells if the "
                         "parametrization's iso-surfaces really are that long", (unsigned long long)f->rules.max_cells);
    return status;
}

/* Makes the polygon of a continuation that is none yet. */
static bw_status make_polygon(bw_fire *f, bw_continuation *at) {
    if (at->facet != BW_NONE) return bw_cells_polygon_of(f->ctx, f->cells, at->facet, &at->polygon);
    return at->polygon == BW_NONE ? bw_fire_cut(f, at->cell, at->plane, &at->polygon) : BW_OK;
}

/* ---- ignition ------------------------------------------------------------------------------------------------------ */

/* The cells around an edge, each once, in the order of the radial ring. */
static bw_status cells_at_edge(bw_fire *f, bw_cedge e, size_t *count) {
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

/* The plane of constant `axis` through an axis-parallel edge, in the chart of `tet`. */
static bw_plane plane_through(const bw_cells *c, bw_cedge e, bw_tet tet, int axis) {
    bool fraction;
    return (bw_plane){bw_cells_floor(c, c->edge[e].vertex[0], tet, axis, &fraction), (int8_t)axis};
}

/* Burns an aligned polygon of `cell` at the edge that lit it; its fire heads away from there. */
static bw_status burn_from(bw_fire *f, bw_polygon p, bw_cedge e, bw_cell cell) {
    const bw_cells *c = f->cells;
    bw_tet tet = bw_cells_tet(c, cell);
    int third = 3 - bw_cells_polygon_plane(c, p, tet).axis - bw_cells_edge_axis(c, e, tet);
    bool backwards = bw_walk_side(c, p, e, tet, plane_through(c, e, tet, third)) < 0;
    return burn(f, p, e, cell, 0, (uint8_t)(2 * third + backwards));
}

/* Ignition in one cell at an edge: burns what the cell has, or gets by a cut, of the plane of constant `axis` through the edge. */
static bw_status ignite_in_cell(bw_fire *f, bw_cedge e, bw_cell cell, int axis) {
    bw_cells *c = f->cells;
    bw_tet tet = bw_cells_tet(c, cell);
    bw_plane plane = plane_through(c, e, tet, axis);
    bw_polygon at[3] = {polygon_at(c, e, cell), BW_NONE, BW_NONE};
    at[1] = bw_walk_other(c, e, cell, at[0]);
    int side[2] = {bw_walk_side(c, at[0], e, tet, plane), bw_walk_side(c, at[1], e, tet, plane)};
    if (side[0] * side[1] < 0) {
        bw_status status = bw_fire_cut(f, cell, plane, &at[2]);
        if (status != BW_OK) return status;
    }
    for (int i = 0; i < 3; i++) {
        if (at[i] == BW_NONE || (i < 2 && side[i]) || c->polygon[at[i]].flags & BW_WALL) continue;
        bw_status status = burn_from(f, at[i], e, cell);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

bw_status bw_fire_ignite_edge(bw_fire *f, bw_cedge e) {
    for (int i = 1; i < 3; i++) {
        size_t count;
        bw_status status = cells_at_edge(f, e, &count);
        for (size_t j = 0; j < count && status == BW_OK; j++) {
            int along = bw_cells_edge_axis(f->cells, e, bw_cells_tet(f->cells, f->around[j]));
            status = ignite_in_cell(f, e, f->around[j], (along + i) % 3);
        }
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

bw_status bw_fire_ignite_at(bw_fire *f, bw_cedge e, bw_continuation at) {
    bw_status status = make_polygon(f, &at);
    return status == BW_OK ? burn_from(f, at.polygon, e, at.cell) : status;
}

static bool polygon_has_vertex(const bw_cells *c, bw_polygon p, bw_cvertex v) {
    bw_half h = c->polygon[p].half;
    do {
        if (c->half[h].origin == v) return true;
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    return false;
}

static bool cell_has_vertex(const bw_cells *c, bw_cell cell, bw_cvertex v) {
    for (bw_polygon p = bw_cells_first_in_cell(c, cell); p != BW_NONE; p = bw_cells_next_in_cell(c, p, cell))
        if (polygon_has_vertex(c, p, v)) return true;
    return false;
}

/* The cells of a tet, by flooding through its iso-planes; those at the vertex come first. */
static bw_status cells_at_vertex(bw_fire *f, bw_tet tet, bw_cvertex v, size_t *count) {
    bw_cells *c = f->cells;
    bw_status status = bw_reserve(f->ctx, &f->around, &f->around_room, 16);
    size_t n = 0, at_vertex = 0;
    if (status == BW_OK) status = bw_cells_open(f->ctx, c, tet);
    if (status != BW_OK) return status;
    f->around[n++] = tet; /* the first cell of a tet keeps its number */
    for (size_t i = 0; i < n && status == BW_OK; i++) {
        bw_cell cell = f->around[i];
        for (bw_polygon p = bw_cells_first_in_cell(c, cell); p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell)) {
            if (c->polygon[p].kind != BW_IN_TET) continue;
            bw_cell to = bw_cells_across(c, p, cell);
            bool known = false;
            for (size_t j = 0; j < n && !known; j++) known = f->around[j] == to;
            if (known) continue;
            status = bw_reserve(f->ctx, &f->around, &f->around_room, n + 1);
            if (status == BW_OK) f->around[n++] = to;
        }
    }
    for (size_t i = 0; i < n; i++)
        if (cell_has_vertex(c, f->around[i], v)) f->around[at_vertex++] = f->around[i];
    *count = at_vertex;
    return status;
}

/* Burns what a cell at a vertex has, or gets by a cut, of a plane through the vertex. */
static bw_status ignite_cell_at_vertex(bw_fire *f, bw_cell cell, bw_cvertex v, bw_plane plane) {
    bw_cells *c = f->cells;
    bw_polygon section;
    bw_status status = bw_fire_cut(f, cell, plane, &section);
    if (status != BW_OK || section == BW_NONE) return status;
    for (bw_polygon p = bw_cells_first_in_cell(c, cell); p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell)) {
        bw_plane q = bw_cells_polygon_plane(c, p, bw_cells_tet(c, cell));
        if (q.axis == plane.axis && q.value == plane.value && !(c->polygon[p].flags & BW_WALL) && polygon_has_vertex(c, p, v))
            status = burn(f, p, BW_NONE, cell, 0, EVERYWHERE);
    }
    return status;
}

bw_status bw_fire_ignite_vertex(bw_fire *f, bw_vertex vertex, const bw_tet *tets, size_t tet_count, unsigned axes) {
    const bw_tet_mesh *mesh = f->cells->mesh;
    bw_status status = BW_OK;
    bw_transition *chart = bw_alloc(f->ctx, tet_count, sizeof *chart); /* from the first tet's chart */
    uint8_t *known = bw_alloc(f->ctx, tet_count, 1);
    if (!chart || !known) status = f->ctx->error.status;
    if (status == BW_OK) known[0] = 1;
    for (bool grown = true; grown && status == BW_OK;) { /* carry the chart through the facets at the vertex */
        grown = false;
        for (size_t i = 0; i < tet_count; i++)
            for (size_t j = 0; j < tet_count && known[i]; j++)
                for (int k = 0; k < 4 && !known[j]; k++) {
                    bw_facet facet = mesh->tet_facet[tets[i]][k];
                    if (mesh->tet[tets[i]][k] == vertex || bw_tet_across(mesh, facet, tets[i]) != tets[j]) continue;
                    bw_transition step = bw_grid_map_across(mesh, f->cells->map, facet, tets[i]);
                    chart[j] = bw_transition_compose(&step, &chart[i]);
                    known[j] = 1, grown = true;
                }
    }
    for (int8_t axis = 0; axis < 3; axis++)
        for (size_t i = 0; i < tet_count && status == BW_OK && axes >> axis & 1; i++) {
            const int64_t *at = f->cells->map->value[tets[0]][bw_tet_corner(mesh, tets[0], vertex)];
            bw_plane plane = bw_transition_plane(&chart[i], (bw_plane){at[axis], axis});
            size_t count;
            status = cells_at_vertex(f, tets[i], vertex, &count);
            for (size_t j = 0; j < count && status == BW_OK; j++) status = ignite_cell_at_vertex(f, f->around[j], vertex, plane);
        }
    bw_free(f->ctx, chart);
    bw_free(f->ctx, known);
    return status;
}

bw_status bw_fire_ignite_polygon(bw_fire *f, bw_polygon p) {
    if (f->cells->polygon[p].flags & BW_WALL) return BW_OK;
    bw_cell cell = f->cells->polygon[p].cell[0];
    bw_plane plane = bw_cells_polygon_plane(f->cells, p, bw_cells_tet(f->cells, cell));
    return burn(f, p, BW_NONE, cell, 0, (uint8_t)(2 * ((plane.axis + 1) % 3)));
}

bw_status bw_fire_ignite_plane(bw_fire *f, bw_cell cell, bw_plane plane) {
    bw_polygon section;
    bw_status status = bw_fire_cut(f, cell, plane, &section);
    if (status != BW_OK || section == BW_NONE || f->cells->polygon[section].flags & BW_WALL) return status;
    return burn(f, section, BW_NONE, cell, 0, (uint8_t)(2 * ((plane.axis + 1) % 3)));
}

/* ---- spreading ----------------------------------------------------------------------------------------------------- */

/* MC Algorithm 1 and 2: at most two burnt polygons at the edge. */
static bool alive(const bw_cells *c, bw_cedge e) { return bw_cells_walls_at(c, e) <= 2; }

static bw_status cross(bw_fire *f, entry x) {
    bw_cells *c = f->cells;
    if (!bw_cells_edge_is_leaf(c, x.edge)) {
        bw_cedge whole = x.edge;
        for (int i = 0; i < 2; i++) {
            x.edge = bw_cells_edge_part(c, whole, i);
            bw_status status = push(f, x);
            if (status != BW_OK) return status;
        }
        return BW_OK;
    }
    if (f->rules.stops_at_walls && !alive(c, x.edge)) return BW_OK;
    bw_continuation to;
    bw_polygon from = bw_walk_descendant(c, x.from, x.edge);
    if (from == BW_NONE || !bw_walk_straight(c, x.edge, from, 0, 0, &to))
        return bw_fail(f->ctx, BW_E_INTERNAL, "a wall has no continuation across complex edge %d", x.edge);
    bw_status status = make_polygon(f, &to);
    if (status != BW_OK) return status;
    if (c->polygon[to.polygon].flags & BW_WALL) return BW_OK;
    return burn(f, to.polygon, x.edge, to.cell, x.distance, turn(to.chart.rotation, x.heading));
}

bw_status bw_fire_run(bw_fire *f) {
    bw_status status = BW_OK;
    for (uint64_t steps = 0; f->count && status == BW_OK; steps++) {
        status = cross(f, pop(f));
        if (status == BW_OK && steps % 4096 == 0) {
            status = bw_poll(f->ctx);
            if (!f->silent) bw_progress(f->ctx, (double)steps / (double)(steps + 8 * f->count + 1));
        }
    }
    return status;
}
