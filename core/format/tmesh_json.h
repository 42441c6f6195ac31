/* tmesh.json: a T-mesh for solid T-splines (api/schemas/tmesh.schema.json); tspline/tmesh.h tells what it is.
 *
 * One element a line. Coordinates are knots: integers, as text from 2^53 on, in the chart of a cell's block, which is the one of blocks.json; `knots` tells their unit. Corners, sides
 * and axes are numbered as in complex.h.
 *
 *   vertices     position in space; boundary; extraordinary: on an extraordinary arc
 *   cells        block, low and high corner (their difference: the knot intervals), vertices of the corners
 *   faces        what two cells share, or one and the outside: cells, their sides, the rectangle as the first cell's block sees it, and the patch of blocks.json that it lies in, if it is
 *                between blocks
 *   transitions  of inner patches: from the chart of the first block of the patch to that of the second, v[i] = sign(r[i]) u[|r[i]| - 1] + shift[i], in knots. The first cell of a
 *                face lies in the first block of its patch, on the patch's first side
 *   t_joints     vertices on cells that are not their corners: vertex, cell, and the axes along which it is between the cell's ends (one: on an edge; two: on a side)
 *   extraordinary_arcs  arc of blocks.json, its quarter turns, whether it is on the boundary, thickness of its tube, the vertices along it from its first node
 *
 * The same input gives the same bytes. A member that goes away or changes its meaning raises BW_TMESH_VERSION; a new one does not.
 */
#ifndef BW_FORMAT_TMESH_JSON_H
#define BW_FORMAT_TMESH_JSON_H

#include "tspline/tmesh.h"

enum { BW_TMESH_VERSION = 1 };

/* kind: "mc", "bc" or "serial". bytes: size of the file. BW_E_IO. */
bw_status bw_tmesh_write(bw_context *ctx, const bw_tmesh *mesh, const double (*position)[3], const char *kind, const char *path, uint64_t *bytes);

/* tmesh.vtu: its cells as VTK hexahedra with straight edges, T-joints hanging. Cell arrays block, extraordinary (how many edges of the cell are); point arrays boundary, extraordinary.
 * BW_E_IO. */
bw_status bw_tmesh_write_vtu(bw_context *ctx, const bw_tmesh *mesh, const double (*position)[3], const char *path, uint64_t *bytes);

#endif
