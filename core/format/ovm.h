/* Reader of OpenVolumeMesh's text form (.ovm): a hex mesh, or a tet mesh whose parameters are a property of its halffaces.
 *
 *     OVM ASCII
 *     Vertices     n, then n lines  x y z
 *     Edges        n, then n lines  v0 v1            halfedge 2e runs from v0 to v1, 2e + 1 back
 *     Faces        n, then n lines  3 he he he       (of hexes: 4 he he he he) halfface 2f is the face as listed, 2f + 1 is turned over
 *     Polyhedra    n, then n lines  4 hf hf hf hf    (hexes: 6 of them, in any order)
 *     HFProp vec3d "HexHex::Parametrization"         then a line per halfface  u v w
 *
 * Parameters: the value of a halfface of a tet is the parameter, in this tet, of the corner opposite to it
 * (the README of libHexHex tells so: "each (non-boundary) halfface is expected to store the vertex parameter
 * of its opposing vertex in its incident cell"); values of halffaces on the outside must be numbers and are
 * not used. Names, looked for in this order, letters of either case are the same: "HexHex::Parametrization",
 * "parametrization", "uvw", "param"; else the only HFProp of type vec3d.
 * Features: VProp, EProp, FProp of type int or bool named "feature", non-zero there; none without such a
 * property.
 *
 * Corners of a tet: 0, 1, 2 are those of its first halfface, in the order in which its halfedges begin; 3 is
 * the other one. Of a hex: those of its first halfface go around its low face of axis 2. Properties of other types and names are passed over. From # to the end of a line there may
 * be comments.
 *
 * The input is hostile until read (input_scan.h). Errors, each with its line and the element ("vertex",
 * "edge", "face", "tet", "halfface"): as of bw_vtk_read_memory. Faces that are neither triangles nor quads and
 * polyhedra that are neither tets nor hexes are BW_E_SYNTAX, and so are meshes of both. O(bytes).
 */
#ifndef BW_FORMAT_OVM_H
#define BW_FORMAT_OVM_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* *mesh is overwritten; on failure it is left empty. */
bw_status bw_ovm_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh);

#endif
