/* The guaranteed integer-grid map: block by block, piecewise affine (MC 7.1). Needs positive lengths, and nothing else.
 *
 * sigma maps the box of every block in the map onto its integer box. It is given by meta-tets: a point inside the block, joined to the triangles
 * of its sides; these are the triangles of its patches, each the star of a point inside the patch over its rim, arc by arc. Both boxes, and
 * both rectangles of a patch, are convex, and the nodes on a rim are in the same cyclic order in both: so no meta-tet is degenerate or inverted in
 * either, whatever the lengths. A patch is triangulated once, for the blocks on both sides of it, and has all nodes of its rim as corners, T-nodes among them:
 * so sigma is continuous across walls. On a patch without T-nodes it is affine, in a block of such patches as well.
 *
 * Centres: of a patch or block in the map the middle; their images by interpolation between opposite sides there, rounded.
 *
 * All coordinates are integers: in the map half grid units, for the middle of a box is always one; in integer boxes 2^-BW_IMAGE_BITS.
 *
 * Invariants (bw_blockwise_check verifies all of them, exactly)
 *  1. Every meta-tet is positive in both boxes.
 *  2. Their volumes add up to those of the boxes. With 3, sigma is a bijection of each block.
 *  3. Points of patches lie in the sides of their blocks, in both boxes; nodes where the atlas has them, so that patches agree on their arcs.
 */
#ifndef BW_IGM_BLOCKWISE_H
#define BW_IGM_BLOCKWISE_H

#include "igm/atlas.h"

enum { BW_IMAGE_BITS = 16 };

/* A point of a patch in its frame: u, v are the axes of its sides 0 and 1, from its low corner. */
typedef struct {
    int64_t real[2];  /* half grid units */
    int64_t image[2]; /* 2^-BW_IMAGE_BITS */
} bw_patch_point;

/* A point of a block in its charts. */
typedef struct {
    int64_t real[3], image[3];
} bw_block_point;

typedef struct {
    const bw_atlas *atlas;      /* borrowed */
    bw_transition (*real)[2];   /* [patch][slot] from the frame (u, v, 0) of a patch to the chart of patch_block[slot], grid units */
    bw_transition (*image)[2];  /* likewise to its integer chart, in units */
    size_t *rim_begin;          /* [patch + 1] */
    bw_patch_point *rim;        /* nodes around the patch, counter-clockwise in u, v */
    bw_patch_point *patch_centre;
    bw_block_point *block_centre;
    size_t *tile_begin;         /* [6 * block + side + 1] */
    int32_t *tile;              /* 2 * patch + slot of each unit square of a side: low axis first, axes (side / 2 + 1, side / 2 + 2) mod 3 */
} bw_blockwise;

/* Requires an atlas that bw_atlas_check accepts. BW_E_USAGE if a length is not positive; BW_E_RANGE beyond 2^30; BW_E_CHECK if rectangles do not tile a side.
 * O(size of the complex + area of the integer sides). */
bw_status bw_blockwise_init(bw_context *ctx, const bw_atlas *atlas, bw_blockwise *map);
void bw_blockwise_clear(bw_context *ctx, bw_blockwise *map);
/* BW_E_CHECK naming the first violation. */
bw_status bw_blockwise_check(bw_context *ctx, const bw_blockwise *map);

/* Meta-tet `k` of a patch, on its side `slot`: block centre, patch centre, rim k, rim k + 1. Positive if *turned is false, else rims are to be swapped. */
void bw_blockwise_tet(const bw_blockwise *map, bw_patch patch, int slot, size_t k, bw_block_point corner[4], bool *turned);

/* The inverse of sigma, in doubles: from an integer chart, in units, to the chart, in grid units; of a point of a patch in its frame. */
void bw_blockwise_back(const bw_blockwise *map, bw_block block, const double q[3], double p[3]);
void bw_blockwise_back_on_patch(const bw_blockwise *map, bw_patch patch, const double q[2], double p[2]);

#endif
