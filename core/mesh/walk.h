/* Walking around the edges of a cell complex, on its polygons and, through tets that are not opened, on the facets of the tet mesh. */
#ifndef BW_MESH_WALK_H
#define BW_MESH_WALK_H

#include "mesh/cells.h"

/* The other polygon at an edge of polygon `from` of an opened cell. Exists and is unique. */
bw_polygon bw_walk_other(const bw_cells *cells, bw_cedge edge, bw_cell cell, bw_polygon from);

/* Side of a polygon with respect to a plane through its edge `edge` (chart of `tet`): the sign of its interior; 0 if it lies in the plane. */
int bw_walk_side(const bw_cells *cells, bw_polygon polygon, bw_cedge edge, bw_tet tet, bw_plane plane);

/* What continues a polygon straight across one of its edges. */
typedef struct {
    bw_polygon polygon; /* the continuation; or BW_NONE: */
    bw_facet facet;     /* then this facet is, which is no polygon yet; or BW_NONE: then `cell` has to be cut by `plane` to get it */
    bw_cell cell;       /* the cell in which the walk ended, and the plane in its tet's chart */
    bw_plane plane;
    bw_transition chart; /* from the chart of the first cell walked through to that of `cell` */
} bw_continuation;

/* Finds the continuation of an aligned polygon `from` across an edge: what lies half a turn from it, walking from its cell[slot]. Returns false if
 * the walk comes to the boundary first, or to a polygon with one of the flags `end`, the continuation included. */
bool bw_walk_straight(const bw_cells *cells, bw_cedge edge, bw_polygon from, int slot, uint8_t end, bw_continuation *out);

/* The next wall polygon around an edge, starting from polygon `from` through its cell[*slot]; *slot becomes the slot of the cell through which
 * it was reached. *plane (or NULL), in the chart of the first cell, is carried to that of the last. Requires a wall in that direction. */
bw_polygon bw_walk_wall(const bw_cells *cells, bw_cedge edge, bw_polygon from, int *slot, bw_plane *plane);

/* The leaf that holds edge `leaf` among the descendants of polygon p; BW_NONE if there is none. */
bw_polygon bw_walk_descendant(const bw_cells *cells, bw_polygon p, bw_cedge leaf);

#endif
