/* Reader of legacy VTK files: an UNSTRUCTURED_GRID of tets with twelve parameters per tet, or of hexes.
 *
 *     # vtk DataFile Version 3.0          2.0 to 5.1
 *     title
 *     ASCII                               or BINARY (big-endian)
 *     DATASET UNSTRUCTURED_GRID
 *     POINTS n double
 *     CELLS n size                        4 v0 v1 v2 v3 per tet, 8 v0 ... v7 per hex; from version 5 on lists
 *                                         OFFSETS and CONNECTIVITY
 *     CELL_TYPES n                        10 per tet, 12 per hex
 *     CELL_DATA n
 *     SCALARS parametrization double 12   or an array of 12 components in a FIELD
 *     LOOKUP_TABLE default
 *
 * vtk_grid.h tells which arrays are used, and how features are marked. Points come before cells. Other
 * attributes and point data are passed over; arrays of strings or bits are refused. Keywords may be of either
 * case.
 *
 * The input is hostile until read (input_scan.h). Errors, each with its line, or its byte in BINARY files,
 * and the element ("vertex", "cell"): BW_E_SYNTAX, BW_E_TRUNCATED, BW_E_COUNT, BW_E_INDEX, BW_E_NUMBER,
 * BW_E_LINE, BW_E_EMPTY (neither tets nor hexes), BW_E_MEMORY, BW_E_CANCELLED. O(bytes).
 */
#ifndef BW_FORMAT_VTK_H
#define BW_FORMAT_VTK_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* *mesh is overwritten; on failure it is left empty. */
bw_status bw_vtk_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh);

#endif
