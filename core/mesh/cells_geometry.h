/* Where the vertices of a cell complex are: the arithmetic behind cells.h, shared by its two sources only. */
#ifndef BW_MESH_CELLS_GEOMETRY_H
#define BW_MESH_CELLS_GEOMETRY_H

#include "mesh/cells.h"

/* Vertex where a plane (chart of `tet`) crosses an edge strictly between its ends. Exact. */
bw_cell_vertex bw_cells_crossing(const bw_cells *cells, bw_cedge edge, bw_tet tet, bw_plane plane);
/* A plane in the chart of `tet`, seen from the home chart of one of its facets. *sign: -1 if the coordinate is reversed. */
bw_plane bw_cells_plane_at_home(const bw_cells *cells, bw_facet facet, bw_tet tet, bw_plane plane, int *sign);

#endif
