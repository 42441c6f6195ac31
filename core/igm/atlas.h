/* Integer charts of blocks: where everything on the surface of a block is once its arcs have integer lengths.
 *
 * Block b is the box [0, extent[b][0]] x [0, extent[b][1]] x [0, extent[b][2]] of its own integer chart, which has the axes of its chart in the map; an extent may be
 * 0. Every node on its surface has a place there, every arc is a rib between two places, every patch a rectangle. Nothing is said of what is inside.
 * With negative lengths a rib may point against its axis, and a rectangle be turned over: then high.q < low.q.
 *
 * Invariants (bw_atlas_check verifies all)
 *  1. In a block places differ in p, in grid units, and are sorted by it; q is the integer place: 0 or extent along an axis where p is, between them where no
 *     length is negative.
 *  2. The two charts beside an inner patch are joined by `across` in p and by `integer` in q. Both have the same rotation, and both carry each node on the rim of the
 *     patch from its place on one side to its place on the other.
 *  3. Around every regular inner arc the transitions `integer` compose to the identity; around a singular one they leave the arc's points where they are.
 */
#ifndef BW_IGM_ATLAS_H
#define BW_IGM_ATLAS_H

#include "quantize/verify_parts.h" /* bw_place, bw_rib, bw_box */

typedef struct {
    const bw_cells *cells;     /* borrowed */
    const bw_complex *complex; /* borrowed */
    const int64_t *length;     /* borrowed; [arc] */
    int64_t (*extent)[3];      /* [block] */
    bw_transition *across;     /* [patch] from the chart of patch_block[0] to that of patch_block[1], grid units; unused on the boundary */
    bw_transition *integer;    /* [patch] likewise between integer charts */
    bw_box (*box)[2];          /* [patch][slot] its rectangle in the chart of patch_block[slot] */
    size_t *place_begin;       /* [block + 1] */
    bw_place *place;
    size_t *rib_begin;         /* [block + 1] */
    bw_rib *rib;
} bw_atlas;

/* Requires a complex that bw_complex_check accepts. Errors: BW_E_CHECK if the lengths do not close up or an extent is negative; BW_E_MEMORY.
 * O(n log n) in the size of the complex. */
bw_status bw_atlas_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_atlas *atlas);
void bw_atlas_clear(bw_context *ctx, bw_atlas *atlas);
/* BW_E_CHECK naming the first violation. */
bw_status bw_atlas_check(bw_context *ctx, const bw_atlas *atlas);

/* The place (index into place) at a point in grid units; BW_NONE if there is none. O(log n). */
int32_t bw_atlas_find(const bw_atlas *atlas, bw_block block, const int64_t p[3]);
/* The slot of a patch that rib r of `block` has there: of patch[i] of the rib. */
int bw_atlas_slot(const bw_atlas *atlas, bw_block block, const bw_rib *rib, int i);
/* The transition out of patch_block[patch][slot] across the patch, in integer units. */
static inline bw_transition bw_atlas_out(const bw_atlas *atlas, bw_patch patch, int slot) {
    return slot ? bw_transition_inverse(&atlas->integer[patch]) : atlas->integer[patch];
}

#endif
