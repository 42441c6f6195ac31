/* Wall retraction (MC 4.2, 5.4) on the block complex alone: which patches can go so that every block stays a cuboid.
 *
 * A patch between two different blocks is removable if it is a whole side of both: then their union is a cuboid (Definition 1). Removing it
 * merges the blocks; an arc left with two walls that pass it flat vanishes and the two patches beside it become one, which
 * may now be removable itself. Nothing here looks at cells: the caller takes the walls of the removed patches away and
 * builds the complex anew, which checks the outcome independently. Patches stay rectangles throughout: where a boundary patch would become
 * L-shaped (only blocks have to be cuboids by MC 5.4), the arc in it is kept.
 *
 * Invariants
 *  1. Blocks and patches are disjoint-set forests. A block's root holds the box of the union in its own chart; `chart` leads
 *     from a block's chart to its parent's. A patch's root holds distance, area and flags of the union.
 *  2. walls[a] counts the appearances of arc a on rims of patches that are left.
 */
#ifndef BW_COMPLEX_REDUCTION_H
#define BW_COMPLEX_REDUCTION_H

#include "base/kinds.h"
#include "complex/complex.h"

typedef struct {
    bw_reduce_mode mode;
    bool split_self_adjacent; /* never merge two blocks that touch elsewhere too */
    /* Order of removal: larger key first, then lower patch. NULL: parametric distance, farthest first (MC 5.4). [patch] */
    const int64_t *key;
} bw_reduction_rules;

typedef struct bw_reduction bw_reduction;

/* Prepares a reduction of a complex, borrowed with its cells until bw_reduction_free. */
bw_status bw_reduction_new(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_reduction **out);
void bw_reduction_free(bw_context *ctx, bw_reduction *reduction); /* NULL is fine */

/* Removes until nothing is removable, from the unreduced complex each time it is called. removed[patch] (patch_count bytes) is set to 1 for
 * what has to go; *blocks is the number of blocks left. kept[arc] (arc_count bytes; may be NULL) is set to 1 for the arcs that must stay although
 * two walls pass them flat, because they bound rectangles whose union is none. O(patches log patches) in practice. */
bw_status bw_reduction_run(bw_context *ctx, bw_reduction *reduction, const bw_reduction_rules *rules, uint8_t *removed,
                           uint8_t *kept, size_t *blocks);

/* The first patch of a complex that could be removed on its own; BW_NONE if the complex is irreducible. An independent test,
 * on the finished complex. O(patches). */
bw_patch bw_complex_removable_patch(const bw_complex *complex, const bw_reduction_rules *rules);

#endif
