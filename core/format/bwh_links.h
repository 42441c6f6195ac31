/* Which vertices are next to each other on the walls of the blocks that are done: by that a block guesses what it meets (hex_bwh.h).
 *
 * A vertex keeps the first BW_BWH_LINKS that come, in that order; a regular one inside has six, and no list takes long to walk. api/bwh.md tells how readers do
 * the same.
 */
#ifndef BW_FORMAT_BWH_LINKS_H
#define BW_FORMAT_BWH_LINKS_H

#include "base/context.h"

enum { BW_BWH_LINKS = 8 };

typedef struct {
    int32_t *row;              /* [number] -1: it has none */
    int32_t (*to)[BW_BWH_LINKS]; /* [row] numbers, then -1 */
    size_t row_count, room;
} bw_bwh_links;

bw_status bw_bwh_links_init(bw_context *ctx, size_t vertices, bw_bwh_links *links);
void bw_bwh_links_clear(bw_context *ctx, bw_bwh_links *links);
/* Both ways. O(1). */
bw_status bw_bwh_links_add(bw_context *ctx, bw_bwh_links *links, int32_t a, int32_t b);
/* BW_BWH_LINKS numbers, -1 after the last. Good until the next bw_bwh_links_add. */
const int32_t *bw_bwh_links_of(const bw_bwh_links *links, int32_t v);
/* Place of `to` among those of `from`, or -1. */
int bw_bwh_links_find(const bw_bwh_links *links, int32_t from, int32_t to);

#endif
