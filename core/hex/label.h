/* Block and place in it of every hex, and with that the proof that a mesh is the one that the quantization promised.
 *
 * A flood over the faces of the mesh from one hex, whose cube in the plan (plan.h) is assumed, gives every hex a cube. It is accepted if each hex reached again is
 * given the same cube in the same position, faces of the boundary are those of the plan, no cube is taken twice and none is left: then mesh and plan are the same complex of
 * cubes. It must also be the plan's in place: every critical node that is a vertex of the tet mesh is the corner of the plan that it should be,
 * and vertices inside a boundary region are on a patch of that region. What a plan can still be turned into itself by, keeping all of these, is a symmetry that nothing tells.
 *
 * First is tried where a critical node is; a mesh without any is tried from every cube.
 */
#ifndef BW_HEX_LABEL_H
#define BW_HEX_LABEL_H

#include "hex/hexmesh.h"
#include "hex/plan.h"
#include "igm/igm.h"

/* Sets block and ijk and turns the corners of each hex to the axes of its block. `igm`: the map that the mesh was extracted from, whose mesh is that of `cells` or one with
 * more vertices. BW_E_CHECK if it is not the mesh of the plan, saying what stopped the attempt that got farthest. O(hexes)
 * for each start tried. */
bw_status bw_hex_label(bw_context *ctx, const bw_hex_plan *plan, const bw_igm *igm, bw_hex_mesh *mesh);

#endif
