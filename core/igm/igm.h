/* Integer-grid map: a tet mesh with an exact seamless map whose unit is the edge of a hexahedron (Q 3.2, definition 3).
 *
 * The preimage of the integer grid is a hexahedral mesh: hex/extract.h reads it off.
 *
 * Invariants (bw_igm_check verifies all of them, exactly)
 *  1. Those of the map (gridmap.h): every tet positive, seamless, aligned; its singular edges are those of the input.
 *  2. The shift of every transition is a multiple of a whole unit, 2^exponent.
 *  3. The constant axes of boundary facets, of feature facets, and of singular and feature edges have whole values.
 *
 * The mesh is that of the job, or a refinement of it: tets whose corners are all held were split (split.h), so its surface and its features are the same point sets.
 */
#ifndef BW_IGM_IGM_H
#define BW_IGM_IGM_H

#include "mesh/gridmap.h"

typedef struct {
    bw_tet_mesh mesh; /* own */
    bw_grid_map map;
    bw_block *home; /* [tet] the block in whose integer chart (atlas.h) its values are, and which has a part of it in the input's map; NULL: not known */
} bw_igm;

void bw_igm_clear(bw_context *ctx, bw_igm *igm);
/* BW_E_CHECK naming the first violation. O(n). */
bw_status bw_igm_check(bw_context *ctx, const bw_igm *igm);

#endif
