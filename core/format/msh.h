/* Reader of Gmsh's .msh, versions 4.1 and 2.2, text and binary: hexes; or tets with three parameters at each of
 * their four nodes.
 *
 *     $MeshFormat         4.1 0 8; binary files of either byte order
 *     $PhysicalNames      optional: dimension, tag, "name"
 *     $Entities           4.1: which physical groups an entity is in
 *     $Nodes              tags need be neither contiguous nor in order; nodes are numbered as they come
 *     $Elements           tets (type 4) or hexes (5); besides them points (15), lines (1), triangles (2) and quads (3)
 *     $ElementNodeData    of tets: 3 components, 4 nodes per element: u v w of each node, in the order of the
 *                         element's nodes
 *
 * Parameters: the view named "parametrization", "uvw" or "param" (looked for in this order, letters of either
 * case are the same), or the only one of 3 components. It must have each tet once; rows of other than 4 nodes
 * are passed over.
 * Features: the points, lines, triangles and quads in a physical group whose name begins with "feature". Without any
 * physical names all of them are features. In version 2.2 the first tag of an element is its group. Tets, hexes and
 * features come in the order of the elements. Other sections are passed over.
 *
 * The input is hostile until read (input_scan.h). Errors, each with its line, or its byte in binary files,
 * and the element ("vertex", "element", "tet"): as of bw_vtk_read_memory; BW_E_TRUNCATED also if a tet has no
 * parameters. O(n log n) at worst, for tags out of order.
 */
#ifndef BW_FORMAT_MSH_H
#define BW_FORMAT_MSH_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* *mesh is overwritten; on failure it is left empty. */
bw_status bw_msh_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh);

#endif
