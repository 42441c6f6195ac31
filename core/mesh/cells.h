/* Cell complex: the tet mesh cut by iso-planes into convex cells (core/README.md, "Cut convex cells").
 *
 * Inside a tet the map is affine, so an iso-surface of the map is an axis-aligned plane there, and a tet cut by such planes is a
 * set of convex polyhedra. Cutting a cell splits that cell only; its neighbours merely get extra vertices and edges on
 * their boundary. Everything is index based, in pooled arrays; what is split keeps its slot and names its children.
 *
 * Most tets of a large mesh are never cut, and cost next to nothing: a tet is *opened* when it is cut. Only opened tets have a list of polygons;
 * a facet becomes a polygon (and its edges complex edges) when it is burnt or a tet beside it is opened, boundary facets at once. Walks
 * pass through what is not opened on the tet mesh itself (mesh/walk.h). A tet's first cell has the tet's number, opened or not.
 *
 * Invariants (bw_cells_check)
 *  1. Conforming: two cells share whole polygons, two polygons share whole edges. Polygons and cells are convex, but may
 *     have consecutive collinear edges and coplanar neighbouring polygons.
 *  2. Every vertex has a carrier, the lowest-dimensional element of the tet mesh that it lies in:
 *       vertex  exact[] unused
 *       edge    point = (1 - s) edge[0] + s edge[1], s = exact[0] / exact[1], 0 < s < 1
 *       facet   exact[k] = floor of coordinate k in the chart of facet_tet[facet][0]; bit k of `fraction` set if the
 *               coordinate is larger than its floor (never for two of the three)
 *       tet     exact[k] = coordinate k in the tet's chart
 *     so comparing a coordinate with an integer needs integer arithmetic only.
 *  3. Every edge has a carrier too, and the iso-planes that made it: none if it lies in a tet edge, one if in a facet, two if in
 *     a tet. Their axes are stored; their values are coordinates of the edge's vertices.
 *  4. Every polygon lies in a facet or, with its iso-plane, in the interior of a tet.
 *  5. A polygon's half-edges form a cycle; all half-edges of an edge form a radial ring, in no particular order.
 *  6. Only leaves (half != BW_NONE) have half-edges and belong to cells.
 *  7. All facets of an opened tet are polygons. A polygon names both its cells, opened or not; the parts of a facet are those of its
 *     polygon, of_facet[facet].
 */
#ifndef BW_MESH_CELLS_H
#define BW_MESH_CELLS_H

#include <gmp.h>

#include "mesh/gridmap.h"

typedef enum { BW_IN_VERTEX, BW_IN_EDGE, BW_IN_FACET, BW_IN_TET } bw_carrier;

typedef int32_t bw_half; /* half-edge */

typedef struct {
    int64_t exact[3];
    int32_t carrier; /* bw_vertex, bw_edge, bw_facet or bw_tet */
    uint8_t kind;    /* bw_carrier */
    uint8_t fraction;
} bw_cell_vertex;

typedef struct {
    int32_t carrier; /* bw_edge, bw_facet or bw_tet */
    bw_cvertex vertex[2];
    bw_half half;    /* any half-edge of the radial ring; BW_NONE if the edge was split */
    bw_cedge child;  /* the part with vertex[0]; that with vertex[1] has the next number */
    uint8_t kind;    /* bw_carrier, not BW_IN_VERTEX */
    uint8_t flags;   /* BW_KEPT; children inherit */
    int8_t axis;     /* in a facet: of its iso-plane, chart of facet_tet[facet][0]; in a tet: along which it runs */
} bw_cell_edge;

typedef struct {
    bw_cvertex origin;
    bw_cedge edge;
    bw_polygon polygon;
    bw_half next;   /* around the polygon */
    bw_half radial; /* next half-edge of the same edge */
} bw_cell_half;

enum { BW_KEPT = 1 /* part of an arc although two walls pass it flat: it bounds rectangles (mesh/rectangles.h, MC 5.4) */ };
enum { BW_WALL = 1, BW_BOUNDARY = 2, BW_SPLIT = 4 /* wall made by torus splitting */, BW_FEATURE = 8 };

typedef struct {
    int32_t carrier;       /* bw_facet; in a tet: the index of its cut in `section` */
    bw_half half;          /* any half-edge; BW_NONE if the polygon was split */
    bw_cell cell[2];       /* cell[1] is BW_NONE on the boundary */
    bw_polygon in_cell[2]; /* next polygon of cell[0], of cell[1] (singly linked, from the cell's first; unused where the cell is not opened);
                              of one that was split in_cell[0] is the first of its two parts, which have consecutive numbers: what
                              names it in a list goes on there */
    int32_t burnt;         /* index of its distance; BW_NONE if it did not burn: no wall, or the boundary */
    int8_t axis;           /* kind BW_IN_TET: of the iso-plane in the tet's chart; else -1 unless the facet is aligned, then chart of facet_tet[0] */
    uint8_t kind;          /* bw_carrier: BW_IN_FACET or BW_IN_TET */
    uint8_t flags;         /* BW_WALL, BW_BOUNDARY; children inherit */
} bw_cell_polygon;

typedef struct {
    const bw_tet_mesh *mesh; /* borrowed */
    const bw_grid_map *map;  /* borrowed */
    size_t vertex_count, edge_count, half_count, polygon_count, cell_count;
    bw_cell_vertex *vertex;
    bw_cell_edge *edge;
    bw_cell_half *half;
    bw_cell_polygon *polygon;
    bw_polygon *list;     /* [cell]: where its list of polygons begins, which may have been split since; BW_NONE for a tet that is not opened */
    bw_tet *cut_from;     /* [cell - tet_count]: the tet that a cell made by a cut lies in */
    int64_t *section;     /* [cell - tet_count]: the value of the plane of the cut that made the cell */
    int64_t *distance;    /* of a wall from its origin along the fire's heading, grid units; negative where it turned back */
    bw_cedge *of_edge;    /* [mesh edge]: the whole edge as a complex edge; BW_NONE if none of its facets is a polygon */
    bw_polygon *of_facet; /* [facet]: the whole facet as a polygon, or BW_NONE */
    size_t distance_count;
    size_t vertex_room, edge_room, half_room, polygon_room, cell_room, cut_room, section_room, distance_room; /* capacities */
    /* scratch of bw_cells_cut */
    int8_t *sign; /* [vertex]: its side in the running cut; 2 = not known */
    size_t sign_room;
    struct bw_cut_face *face; /* the polygons of the cell, and their half-edges */
    struct bw_cut_corner *corner;
    size_t face_room, corner_room;
} bw_cells;

/* The uncut complex, no tet opened: vertices and cells have the numbers of the mesh's vertices and tets, boundary facets are polygons with
 * BW_WALL | BW_BOUNDARY. */
bw_status bw_cells_init(bw_context *ctx, bw_cells *cells, const bw_tet_mesh *mesh, const bw_grid_map *map);
void bw_cells_clear(bw_context *ctx, bw_cells *cells);
/* Gives back the room for further cuts, which take it anew. */
bw_status bw_cells_trim(bw_context *ctx, bw_cells *cells);

/* The polygon of a facet, made if there is none yet. */
bw_status bw_cells_polygon_of(bw_context *ctx, bw_cells *cells, bw_facet facet, bw_polygon *out);
/* Opens a tet, if that was not done; all tets. */
bw_status bw_cells_open(bw_context *ctx, bw_cells *cells, bw_tet tet);
bw_status bw_cells_open_all(bw_context *ctx, bw_cells *cells);

/* Sign of (coordinate of vertex - plane), plane in the chart of `tet`; the vertex lies in the closed tet. Exact. */
int bw_cells_side(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, bw_plane plane);

/* Cuts a cell, opened if it is a tet that was not, by a plane given in the chart of its tet. *section: the polygon in the plane, new, or an existing face of the
 * cell in the plane; BW_NONE if plane and cell share less than a polygon. The two halves are `cell` and the
 * newest cell. O(size of the cell + polygons around its cut edges). */
bw_status bw_cells_cut(bw_context *ctx, bw_cells *cells, bw_cell cell, bw_plane plane, bw_polygon *section);

static inline bool bw_cells_is_open(const bw_cells *cells, bw_cell cell) { return cells->list[cell] != BW_NONE; }
/* The tet that a cell lies in. */
static inline bw_tet bw_cells_tet(const bw_cells *cells, bw_cell cell) {
    size_t tets = cells->mesh->tet_count;
    return (size_t)cell < tets ? cell : cells->cut_from[(size_t)cell - tets];
}
static inline bw_cell bw_cells_across(const bw_cells *cells, bw_polygon p, bw_cell from) {
    return cells->polygon[p].cell[cells->polygon[p].cell[0] == from];
}
static inline bool bw_cells_polygon_is_leaf(const bw_cells *cells, bw_polygon p) {
    return cells->polygon[p].half != BW_NONE;
}
/* The first leaf of a polygon that a list names. */
static inline bw_polygon bw_cells_first_leaf(const bw_cells *cells, bw_polygon p) {
    while (p != BW_NONE && !bw_cells_polygon_is_leaf(cells, p)) p = cells->polygon[p].in_cell[0];
    return p;
}
/* The polygons of an opened cell, one after the other; BW_NONE after the last. */
static inline bw_polygon bw_cells_first_in_cell(const bw_cells *cells, bw_cell cell) {
    return bw_cells_first_leaf(cells, cells->list[cell]);
}
static inline bw_polygon bw_cells_next_in_cell(const bw_cells *cells, bw_polygon p, bw_cell cell) {
    return bw_cells_first_leaf(cells, cells->polygon[p].in_cell[cells->polygon[p].cell[0] != cell]);
}
static inline bool bw_cells_edge_is_leaf(const bw_cells *cells, bw_cedge e) { return cells->edge[e].half != BW_NONE; }
/* The two parts, i = 0 or 1, of what was split. */
static inline bw_polygon bw_cells_polygon_part(const bw_cells *cells, bw_polygon p, int i) {
    return cells->polygon[p].in_cell[0] + i;
}
static inline bw_cedge bw_cells_edge_part(const bw_cells *cells, bw_cedge e, int i) { return cells->edge[e].child + i; }
static inline int64_t bw_cells_distance(const bw_cells *cells, bw_polygon p) {
    return cells->polygon[p].burnt == BW_NONE ? 0 : cells->distance[cells->polygon[p].burnt];
}
/* Both vertices of a half-edge's edge other than its origin. */
static inline bw_cvertex bw_cells_half_end(const bw_cells *cells, bw_half h) {
    return cells->half[cells->half[h].next].origin;
}
/* The half-edge before another around its polygon. O(size of the polygon). */
static inline bw_half bw_cells_half_previous(const bw_cells *cells, bw_half h) {
    bw_half previous = h;
    while (cells->half[previous].next != h) previous = cells->half[previous].next;
    return previous;
}
/* Transition into the chart of cell `to` from that of cell `from` across a polygon they share. */
bw_transition bw_cells_transition(const bw_cells *cells, bw_polygon polygon, bw_cell from);
/* The tet edge that carries a complex edge, or BW_NONE. */
static inline bw_edge bw_cells_mesh_edge(const bw_cells *cells, bw_cedge e) {
    return cells->edge[e].kind == BW_IN_EDGE ? cells->edge[e].carrier : BW_NONE;
}
static inline bool bw_cells_edge_is_singular(const bw_cells *cells, bw_cedge e) {
    return cells->edge[e].kind == BW_IN_EDGE && (cells->map->edge_flags[cells->edge[e].carrier] & BW_EDGE_SINGULAR);
}
static inline bool bw_cells_edge_is_feature(const bw_cells *cells, bw_cedge e) {
    return cells->edge[e].kind == BW_IN_EDGE && (cells->map->edge_flags[cells->edge[e].carrier] & BW_EDGE_FEATURE);
}
/* Number of wall polygons at a leaf. */
static inline int bw_cells_walls_at(const bw_cells *cells, bw_cedge e) {
    int walls = 0;
    bw_half head = cells->edge[e].half, h = head;
    do {
        walls += (cells->polygon[cells->half[h].polygon].flags & BW_WALL) != 0;
        h = cells->half[h].radial;
    } while (h != head);
    return walls;
}
/* Whether an edge with so many wall polygons is part of an arc (MC 4.1). Two pass flat through a regular edge: that they are coplanar is for the
 * check of the blocks' charts to verify. Singular edges and features are parts of arcs, and what is BW_KEPT. */
static inline bool bw_cells_edge_is_arc(const bw_cells *cells, bw_cedge e, int walls) {
    return walls > 2 || (walls > 0 && (walls == 1 || cells->edge[e].flags & BW_KEPT || bw_cells_edge_is_singular(cells, e) ||
                                       bw_cells_edge_is_feature(cells, e)));
}
bool bw_cells_edge_is_boundary(const bw_cells *cells, bw_cedge e);
/* The plane of a polygon in the chart of `tet`, one of the tets it lies in; axis -1 if it is in no iso-plane. */
bw_plane bw_cells_polygon_plane(const bw_cells *cells, bw_polygon polygon, bw_tet tet);
/* Axis along which a complex edge runs in the chart of `tet`; -1 if along none. */
int bw_cells_edge_axis(const bw_cells *cells, bw_cedge edge, bw_tet tet);

/* Floor of coordinate `axis` of a vertex in the chart of `tet`; *fraction is set if the coordinate is larger. */
int64_t bw_cells_floor(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, int axis, bool *fraction);
/* Floors of all three coordinates of a vertex in the chart of `tet`; bit k of the result is set if coordinate k is larger. */
unsigned bw_cells_locate(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, int64_t out[3]);
/* Sign of (coordinate of a - coordinate of b) along an axis of the chart of `tet`. Exact. */
int bw_cells_compare_along(const bw_cells *cells, bw_cvertex a, bw_cvertex b, bw_tet tet, int axis);
/* Exact coordinates of a vertex in the chart of `tet`, in grid units, canonical rationals; out is initialised by the caller. */
void bw_cells_parameter(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, mpq_t out[3]);
/* Position in the input's space, to double rounding. */
void bw_cells_position(const bw_cells *cells, bw_cvertex vertex, double out[3]);

/* Verifies every invariant above. BW_E_CHECK naming the first violation. Linear in the numbers of polygons and cells. */
bw_status bw_cells_check(bw_context *ctx, const bw_cells *cells);

#endif
