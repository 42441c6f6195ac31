/* A block of a complex as a box of blocks of its base complex. */
#ifndef BW_EXPLORE_BOX_H
#define BW_EXPLORE_BOX_H

#include "explore/space.h"

typedef struct {
    size_t count;
    bw_block *block;      /* [count] those it is made of; the first is the one it was asked for by */
    bw_transition *chart; /* [count] from the chart of each to that of the box, whose low corner is the origin */
    int64_t extent[3];
} bw_block_box;

/* Room for any box of a space; laid out again and again. */
typedef struct {
    bw_block_box box;
    int32_t *place; /* [block] in the box; BW_NONE: not in it */
} bw_box_layout;

bw_status bw_box_layout_init(bw_context *ctx, const bw_space *space, bw_box_layout *layout);
void bw_box_layout_clear(bw_context *ctx, bw_box_layout *layout);
/* The box that holds a block, between walls that make cuboids. O(blocks in it). Valid until the next call. */
const bw_block_box *bw_box_lay_out(const bw_space *space, const uint8_t *wall, bw_block from, bw_box_layout *layout);

#endif
