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

bool bw_walk_straight(const bw_cells *cells, bw_cedge edge, bw_polygon from, bw_continuation *out) {
    bw_cell cell = cells->polygon[from].cell[0];
    bw_transition chart;
    memset(&chart, 0, sizeof chart);
    bw_plane plane = bw_cells_polygon_plane(cells, from, cells->cell[cell].tet);
    bw_polygon at = from;
    int first = 0, sense = 1; /* sense: whether the plane's axis points as in the first chart */
    for (;;) {
        bw_polygon next = bw_walk_other(cells, edge, cell, at);
        int side = sense * bw_walk_side(cells, next, edge, cells->cell[cell].tet, plane);
        *out = (bw_continuation){side ? BW_NONE : next, cell, plane, chart};
        if (side == 0 || (first && side != first)) return true;
        first = side;
        bw_cell beyond = bw_cells_across(cells, next, cell);
        if (beyond == BW_NONE) return false;
        if (cells->polygon[next].kind == BW_IN_FACET) {
            bw_transition step = bw_cells_transition(cells, next, cell);
            plane = bw_transition_plane(&step, plane);
            sense *= bw_rotation_sign[step.rotation][plane.axis];
            chart = bw_transition_compose(&step, &chart);
        }
        cell = beyond, at = next;
    }
}

bw_polygon bw_walk_wall(const bw_cells *cells, bw_cedge edge, bw_polygon from, int *slot, bool *flat) {
    bw_cell cell = cells->polygon[from].cell[*slot];
    bw_plane plane = {0, 0};
    if (flat) plane = bw_cells_polygon_plane(cells, from, cells->cell[cell].tet);
    for (bw_polygon at = from;;) {
        bw_polygon next = bw_walk_other(cells, edge, cell, at);
        if (cells->polygon[next].flags & BW_WALL) {
            *slot = cells->polygon[next].cell[0] != cell;
            if (flat) *flat = bw_walk_side(cells, next, edge, cells->cell[cell].tet, plane) == 0;
            return next;
        }
        if (flat) {
            bw_transition step = bw_cells_transition(cells, next, cell);
            plane = bw_transition_plane(&step, plane);
        }
        cell = bw_cells_across(cells, next, cell);
        at = next;
    }
}

bw_polygon bw_walk_descendant(const bw_cells *cells, bw_polygon p, bw_cedge leaf) {
    if (bw_cells_polygon_is_leaf(cells, p)) return p;
    bw_half head = cells->edge[leaf].half, h = head;
    do {
        bw_polygon q = cells->half[h].polygon;
        while (q != BW_NONE && q != p) q = cells->polygon[q].parent;
        if (q == p) return cells->half[h].polygon;
        h = cells->half[h].radial;
    } while (h != head);
    return BW_NONE;
}
