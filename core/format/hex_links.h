/* The outside of blocks as rectangles of quads: where a block meets one other block in one way, or one surface of the boundary. */
#ifndef BW_FORMAT_HEX_LINKS_H
#define BW_FORMAT_HEX_LINKS_H

#include "hex/grid.h"

/* Grid points from `from` to `to` (of block group `group`, both ends included, equal along the normal). Inside: the same points of `other` run from other_from to other_to, and
 * axis i of group runs along axis abs(turn[i]) - 1 of other, backwards if turn[i] < 0. */
typedef struct {
    size_t group, other; /* other: a group, unless surface >= 0 */
    int32_t surface;     /* -1 inside */
    int32_t from[3], to[3], other_from[3], other_to[3];
    int turn[3];
} bw_hex_link;

typedef struct {
    size_t count, room;
    bw_hex_link *link; /* each of two blocks that meet is `group` of one of them only */
} bw_hex_links;

/* All groups must be grids (bw_hex_grid_fill). Greedy: each rectangle starts at the first quad left, and grows along one axis, then the other. O(n log n).
 * Errors: BW_E_MEMORY. */
bw_status bw_hex_links_init(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_groups *blocks, bw_hex_links *links);
void bw_hex_links_clear(bw_context *ctx, bw_hex_links *links);
/* The same link from the other side. */
bw_hex_link bw_hex_link_turned(const bw_hex_link *link);

#endif
