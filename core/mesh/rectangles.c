#include "mesh/rectangles.h"

/* Half a turn around a vertex within a wall, from an arc edge: where it ends, free of arcs. */
typedef struct {
    bw_cedge edge;      /* an edge of the wall lies there; or BW_NONE: */
    bw_polygon polygon; /* this polygon of the wall does, and is parted by `plane` in the chart of `cell` */
    bw_cell cell;
    bw_plane plane;
} opposite;

static bw_cvertex other_end(const bw_cells *c, bw_cedge e, bw_cvertex v) { return c->edge[e].vertex[c->edge[e].vertex[0] == v]; }

/* The other edge of a polygon at a vertex of its edge e. */
static bw_cedge next_at_vertex(const bw_cells *c, bw_polygon p, bw_cvertex v, bw_cedge e) {
    bw_half h = c->polygon[p].half;
    while (c->half[h].origin != v) h = c->half[h].next;
    return c->half[h].edge == e ? c->half[bw_cells_half_previous(c, h)].edge : c->half[h].edge;
}

/* Turns around vertex v from its edge e through the wall polygon p. False if there is an arc within half a turn, inclusive. */
static bool turn_around(const bw_cells *c, bw_cvertex v, bw_cedge e, bw_polygon p, opposite *out) {
    int slot = 0, side = 0;
    bw_tet tet = bw_cells_tet(c, c->polygon[p].cell[0]);
    int axis = 3 - bw_cells_edge_axis(c, e, tet) - bw_cells_polygon_plane(c, p, tet).axis;
    bool fraction;
    bw_plane across = {bw_cells_floor(c, v, tet, axis, &fraction), (int8_t)axis}; /* through e, perpendicular to the wall */
    for (;;) {
        bw_cedge next = next_at_vertex(c, p, v, e);
        int beyond = bw_cells_side(c, other_end(c, next, v), tet, across);
        if (!side) side = beyond;
        *out = (opposite){beyond ? BW_NONE : next, p, c->polygon[p].cell[slot], across};
        if (beyond && beyond != side) return true;
        if (bw_cells_edge_is_arc(c, next, bw_cells_walls_at(c, next))) return false;
        if (!beyond) return true;
        p = bw_walk_wall(c, next, p, &slot, &across);
        tet = bw_cells_tet(c, c->polygon[p].cell[slot]);
        side = bw_cells_side(c, other_end(c, next, v), tet, across);
        e = next;
    }
}

/* The edge of a section in the plane of a wall polygon that it parted. */
static bw_cedge edge_in_wall(const bw_cells *c, bw_polygon section, bw_polygon wall) {
    bw_half h = c->polygon[section].half;
    for (;; h = c->half[h].next)
        for (bw_half r = c->half[h].radial; r != h; r = c->half[r].radial)
            if (c->half[r].polygon == bw_cells_polygon_part(c, wall, 0)) return c->half[h].edge;
}

/* Draws the first edge of a line from a vertex. */
static bw_status draw_edge(bw_fire *fire, const opposite *at, bw_cedge *drawn) {
    bw_cells *c = fire->cells;
    bw_status status = BW_OK;
    *drawn = at->edge;
    if (at->edge == BW_NONE) {
        bw_polygon section;
        status = bw_fire_cut(fire, at->cell, at->plane, &section);
        if (status == BW_OK) *drawn = edge_in_wall(c, section, at->polygon);
    }
    if (status == BW_OK) c->edge[*drawn].flags |= BW_KEPT;
    return status;
}

/* Whether a line that reached vertex v along edge e goes on: not if there is an arc at v. */
static bool goes_on(const bw_cells *c, bw_cvertex v, bw_cedge e, opposite *at) {
    bw_half head = c->edge[e].half, h = head;
    do {
        bw_polygon p = c->half[h].polygon;
        if (c->polygon[p].flags & BW_WALL && !turn_around(c, v, e, p, at)) return false;
        h = c->half[h].radial;
    } while (h != head);
    return true;
}

static bw_status draw_line(bw_fire *fire, bw_cvertex v, opposite at) {
    for (;;) {
        bw_cedge e;
        bw_status status = draw_edge(fire, &at, &e);
        if (status != BW_OK) return status;
        v = other_end(fire->cells, e, v);
        if (!goes_on(fire->cells, v, e, &at)) return BW_OK;
    }
}

/* The leaf of a tet edge at one of its ends. */
static bw_cedge leaf_at(const bw_cells *c, bw_cedge e, bw_cvertex v) {
    while (!bw_cells_edge_is_leaf(c, e)) e = bw_cells_edge_part(c, e, c->edge[e].vertex[1] == v);
    return e;
}

/* The first wall at an edge around whose end v the next arc is too far. */
static bool find_gap(const bw_cells *c, bw_cvertex v, bw_cedge e, opposite *at) {
    bw_half head = c->edge[e].half, h = head;
    do {
        bw_polygon p = c->half[h].polygon;
        if (c->polygon[p].flags & BW_WALL && turn_around(c, v, e, p, at)) return true;
        h = c->half[h].radial;
    } while (h != head);
    return false;
}

static bw_status part_around(bw_fire *fire, bw_cvertex v, bw_edge edge) {
    bw_status status = BW_OK;
    opposite at;
    while (status == BW_OK && find_gap(fire->cells, v, leaf_at(fire->cells, fire->cells->of_edge[edge], v), &at)) status = draw_line(fire, v, at);
    return status;
}

bw_status bw_rectangles(bw_fire *fire) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    bw_status status = BW_OK;
    for (size_t i = 0; i < 2 * mesh->edge_count && status == BW_OK; i++)
        if (fire->cells->map->edge_flags[i / 2] & BW_EDGE_SINGULAR)
            status = part_around(fire, mesh->edge[i / 2][i % 2], (bw_edge)(i / 2));
    return status;
}
