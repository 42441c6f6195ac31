/* Hex mesh straight from blocks and positive integer lengths: the preimage of the integer grid under the block-wise map (igm/blockwise.h).
 *
 * Which vertices a hex has follows from the integers alone: nodes, inner points of arcs, of patches and of blocks are numbered in this order, and a
 * block finds those on its sides by the places that its patches have there. So the mesh is conforming and has a grid of n0 x n1 x n2 hexes for every
 * block whatever rounding does. Positions: the inverse of the map, in doubles; what is on an arc or a boundary patch comes out on its mesh edge or facet.
 */
#ifndef BW_HEX_BLOCKFILL_H
#define BW_HEX_BLOCKFILL_H

#include "hex/hexmesh.h"
#include "igm/blockwise.h"

/* `subdivide` >= 1: each integer unit becomes that many hexes along each axis. Hexes are ordered by block, then by place in it, first axis fastest. The mesh is
 * the same at any number of threads. O(hexes log tets). BW_E_LIMIT beyond 2^31 - 1 vertices or hexes; BW_E_CHECK if patches do not
 * fit together, which the atlas excludes. */
bw_status bw_blockfill(bw_context *ctx, const bw_blockwise *map, int32_t subdivide, bw_hex_mesh *mesh);

#endif
