#include "mesh/walk.h"

#include <string.h>

bw_polygon bw_walk_other(const bw_cells *cells, bw_cedge edge, bw_cell cell, bw_polygon from) {
    bw_half head = cells->edge[edge].half, h = head;
    do {
        bw_polygon p = cells->half[h].polygon;
        if (p != from && (cells->polygon[p].cell[0] == cell || cells->polygon[p].cell[1] == cell)) return p;
        h = cells->half[h].radial;
    } while (h != head);
    return BW_NONE;
}

int bw_walk_side(const bw_cells *cells, bw_polygon polygon, bw_cedge edge, bw_tet tet, bw_plane plane) {
    bw_half h = cells->polygon[polygon].half;
    while (cells->half[h].edge != edge) h = cells->half[h].next;
    /* Vertices past the edge's end, collinear ones have sign 0 as well. */
    for (bw_half x = cells->half[cells->half[h].next].next; x != h; x = cells->half[x].next) {
        int sign = bw_cells_side(cells, cells->half[x].origin, tet, plane);
        if (sign) return sign;
    }
    return 0;
}

/* A face of a cell: a polygon, or (BW_NONE) a facet that is no polygon yet. */
typedef struct {
    bw_polygon polygon;
    bw_facet facet;
} face;

/* The facet of a tet at an edge of the mesh, other than `from`. */
static bw_facet other_facet(const bw_tet_mesh *mesh, bw_tet tet, bw_edge edge, bw_facet from) {
    const bw_vertex *end = mesh->edge[edge];
    for (int i = 0; i < 4; i++) {
        bw_vertex v = mesh->tet[tet][i];
        if (v != end[0] && v != end[1] && mesh->tet_facet[tet][i] != from) return mesh->tet_facet[tet][i];
    }
    __builtin_unreachable(); /* two facets hold the edge */
}

/* The other face of a cell at an edge of its face `from`. */
static face next_face(const bw_cells *c, bw_cedge edge, bw_cell cell, face from) {
    if (bw_cells_is_open(c, cell) || c->edge[edge].kind != BW_IN_EDGE) /* an edge within a facet parts its polygon */
        return (face){bw_walk_other(c, edge, cell, from.polygon), BW_NONE};
    bw_facet at = from.polygon == BW_NONE ? from.facet : c->polygon[from.polygon].carrier;
    bw_facet facet = other_facet(c->mesh, cell, c->edge[edge].carrier, at);
    bw_polygon p = c->of_facet[facet];
    if (p == BW_NONE) return (face){BW_NONE, facet};
    return (face){bw_cells_polygon_is_leaf(c, p) ? p : bw_walk_descendant(c, p, edge), BW_NONE};
}

static int face_side(const bw_cells *c, face f, bw_cedge edge, bw_tet tet, bw_plane plane) {
    if (f.polygon != BW_NONE) return bw_walk_side(c, f.polygon, edge, tet, plane);
    const bw_vertex *end = c->mesh->edge[c->edge[edge].carrier];
    for (int i = 0; i < 4; i++) {
        bw_vertex v = c->mesh->tet[tet][i];
        if (v == end[0] || v == end[1] || c->mesh->tet_facet[tet][i] == f.facet) continue;
        int64_t x = c->map->value[tet][i][plane.axis];
        return (x > plane.value) - (x < plane.value);
    }
    __builtin_unreachable(); /* the third corner of the facet */
}

/* The cell beyond a face of `cell`. */
static bw_cell beyond(const bw_cells *c, face f, bw_cell cell) {
    return f.polygon == BW_NONE ? bw_tet_across(c->mesh, f.facet, cell) : bw_cells_across(c, f.polygon, cell);
}

/* Whether the chart changes across a face of `cell`; then *across is the transition. */
static bool changes_chart(const bw_cells *c, face f, bw_cell cell, bw_transition *across) {
    if (f.polygon != BW_NONE && c->polygon[f.polygon].kind == BW_IN_TET) return false;
    bw_facet facet = f.polygon == BW_NONE ? f.facet : c->polygon[f.polygon].carrier;
    if (bw_grid_map_same_chart(c->map, facet)) return false;
    *across = bw_grid_map_across(c->mesh, c->map, facet, bw_cells_tet(c, cell));
    return true;
}

bool bw_walk_straight(const bw_cells *cells, bw_cedge edge, bw_polygon from, int slot, uint8_t end, bw_continuation *out) {
    bw_cell cell = cells->polygon[from].cell[slot];
    bw_transition chart, across;
    memset(&chart, 0, sizeof chart);
    bw_plane plane = bw_cells_polygon_plane(cells, from, bw_cells_tet(cells, cell));
    face at = {from, BW_NONE};
    int first = 0, sense = 1; /* sense: whether the plane's axis points as in the first chart */
    for (;;) {
        at = next_face(cells, edge, cell, at);
        int side = sense * face_side(cells, at, edge, bw_cells_tet(cells, cell), plane);
        *out = (bw_continuation){side ? BW_NONE : at.polygon, side ? BW_NONE : at.facet, cell, plane, chart};
        bool inside = first && side && side != first; /* the continuation parts the cell */
        if (!inside && at.polygon != BW_NONE && cells->polygon[at.polygon].flags & end) return false;
        if (side == 0 || inside) return true;
        first = side;
        bw_cell from_cell = cell;
        cell = beyond(cells, at, cell);
        if (cell == BW_NONE) return false;
        if (!changes_chart(cells, at, from_cell, &across)) continue;
        plane = bw_transition_plane(&across, plane);
        sense *= bw_rotation_sign[across.rotation][plane.axis];
        chart = bw_transition_compose(&across, &chart);
    }
}

bw_polygon bw_walk_wall(const bw_cells *cells, bw_cedge edge, bw_polygon from, int *slot, bw_plane *plane) {
    bw_cell cell = cells->polygon[from].cell[*slot];
    bw_transition across;
    for (face at = {from, BW_NONE};;) {
        at = next_face(cells, edge, cell, at);
        if (at.polygon != BW_NONE && cells->polygon[at.polygon].flags & BW_WALL) {
            *slot = cells->polygon[at.polygon].cell[0] != cell;
            return at.polygon;
        }
        if (plane && changes_chart(cells, at, cell, &across)) *plane = bw_transition_plane(&across, *plane);
        cell = beyond(cells, at, cell);
    }
}

bw_polygon bw_walk_descendant(const bw_cells *cells, bw_polygon p, bw_cedge leaf) {
    if (bw_cells_polygon_is_leaf(cells, p)) {
        bw_half head = cells->edge[leaf].half, h = head;
        while (cells->half[h].polygon != p && (h = cells->half[h].radial) != head) {}
        return cells->half[h].polygon == p ? p : BW_NONE;
    }
    bw_polygon found = bw_walk_descendant(cells, bw_cells_polygon_part(cells, p, 0), leaf);
    return found == BW_NONE ? bw_walk_descendant(cells, bw_cells_polygon_part(cells, p, 1), leaf) : found;
}
