/* Which blocks a set of walls makes.
 *
 * Blocks between walls that serial insertion left are cuboids with 8 corners, or close on themselves and have none (MC 5.3). The latter get one more wall, or
 * two, straight across; then the number of blocks is that of the finished complex.
 */
#ifndef BW_EXPLORE_REGIONS_H
#define BW_EXPLORE_REGIONS_H

#include "explore/space.h"

typedef struct {
    const bw_space *space;
    int32_t *label;  /* [block] its region, by the last bw_regions_close */
    size_t count;
    uint8_t *corners; /* [region] */
    bw_block *queue;
    bw_patch *list;  /* the walls that were added, in order */
    size_t added;
} bw_regions;

bw_status bw_regions_init(bw_context *ctx, const bw_space *space, bw_regions *regions);
void bw_regions_clear(bw_context *ctx, bw_regions *regions);
/* Adds to `wall` what opens the blocks that close on themselves, labels blocks and counts them. False if a region is neither a cuboid nor closes on itself: then
 * the walls were not those of a complex. O(patches) and as much again for each wall added. */
bool bw_regions_close(bw_regions *regions, uint8_t *wall);

/* Blocks that any complex with these walls has at least: as many as there are regions, and an eighth of the corners that are closed already. */
size_t bw_regions_least(bw_regions *regions, const uint8_t *wall);

#endif
