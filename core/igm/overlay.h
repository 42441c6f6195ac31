/* The block-wise map as an integer-grid map: the mesh refined by the meta-tets, so that the map is affine on every tet (MC 7.1).
 *
 * Every cell of the complex is cut by the meta-tets of its block that it meets, in exact arithmetic; those of a patch without T-nodes are one pyramid, on which
 * the map is affine, and a block of such patches is not cut at all ("most of this refinement is superfluous"). The pieces are convex; faces are triangulated by an order
 * of corners that both sides of them see, and pieces are coned from a point inside. Corners are the same if their exact coordinates in a block, or in
 * a patch between blocks, are the same. So the refined mesh is conforming and every tet positive, whatever the integers.
 *
 * In the end parameters are rounded to a dyadic grid, which integers, and so transitions and alignment, survive: the coarsest tried that keeps every tet positive,
 * down to 2^-40. If a tet is thinner than that the map is given up (the hex mesh, blockfill.h, does not depend on it).
 */
#ifndef BW_IGM_OVERLAY_H
#define BW_IGM_OVERLAY_H

#include "igm/blockwise.h"
#include "igm/igm.h"

typedef struct {
    uint64_t tets, cut_cells; /* cells that lie in more than one meta-tet */
    uint64_t flat;            /* tets that rounding would leave without volume */
} bw_overlay_report;

/* Opens all tets of `cells`. Errors: BW_E_LIMIT if there would be more than max_tets; BW_E_RANGE if the grid is too coarse for the refined mesh;
 * BW_E_MEMORY, BW_E_CANCELLED. The map is verified (bw_grid_map_derive). */
bw_status bw_overlay(bw_context *ctx, const bw_blockwise *map, bw_cells *cells, uint64_t max_tets, bw_igm *out, bw_overlay_report *report);

#endif
