/* Loops of the volume and of the regions of a block complex that cannot be contracted: classes and generators (Q 5.3.3, 5.3.4).
 *
 * volume  graph: blocks, joined across patches; relations: around every arc inside. A crossing is the number of a slot: 2 * patch + i leads out of
 *         patch_block[patch][i].
 * region  graph: critical patches, joined across the arcs inside regions, of all regions at once; relations: around every node inside a region.
 */
#ifndef BW_QUANTIZE_LOOPS_H
#define BW_QUANTIZE_LOOPS_H

#include "quantize/cocycle.h"
#include "quantize/corridor.h"
#include "quantize/critical.h"

typedef struct {
    bw_cocycle_graph volume_graph, region_graph;
    bw_cocycles volume, region;
    int32_t (*arc_use)[2]; /* [arc] inside a region: its two appearances in patch_chain on critical patches; the region graph's edge leads from
                              the first one's patch to the second one's */
} bw_loops;

bw_status bw_loops_init(bw_context *ctx, const bw_surface *surface, const bw_critical *critical, bw_loops *loops);
void bw_loops_clear(bw_context *ctx, bw_loops *loops);

/* A generator of the volume as a corridor that ends in the block it starts from. *exists is false for one that no single crossing stands for. */
bw_status bw_loops_volume_corridor(bw_context *ctx, const bw_loops *loops, size_t generator, bw_corridor *corridor, bool *exists);

#endif
