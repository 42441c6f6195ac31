/* Reader of Medit meshes, .mesh (text) and .meshb (binary, versions 1 to 4, either byte order): of hexes; or of tets with a side
 * file of parameters, for Medit has no place for values at the corners of tets.
 *
 * Mesh: Dimension 3, Vertices, Tetrahedra or Hexahedra; features are Corners and RequiredVertices, Ridges and
 * RequiredEdges (numbers in Edges), RequiredTriangles (numbers in Triangles), RequiredQuadrilaterals (numbers in
 * Quadrilaterals). What is listed in two of them is one feature, at its first place. Prisms and Pyramids are
 * refused, other sections are passed over; reference numbers are read and not
 * used. Everything counts from 1.
 *
 * Side file, text:
 *
 *     parameters 2                                   the word, and the number of tets
 *     u0 v0 w0  u1 v1 w1  u2 v2 w2  u3 v3 w3         one line per tet in the order of Tetrahedra, corners in
 *                                                    the tet's order
 *     ...
 *
 * From # to the end of the line both files may have comments.
 *
 * The input is hostile until read (input_scan.h). Errors, each with its line (byte in .meshb) and the
 * element: as of bw_vtk_read_memory; those of the side file begin with "parameters:". Tets without a side file
 * (NULL), or with that of another number of tets, and hexes with one: BW_E_PARAMETERS. O(bytes).
 */
#ifndef BW_FORMAT_MEDIT_H
#define BW_FORMAT_MEDIT_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* *mesh is overwritten; on failure it is left empty. `parameters` may be NULL, which is an error told after
 * the mesh was read. */
bw_status bw_medit_read_memory(bw_context *ctx, const void *data, size_t size, const void *parameters,
                               size_t parameters_size, bw_tet_mesh *mesh);

#endif
