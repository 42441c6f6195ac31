/* The grid of vertices of a box, from those of the blocks of the base complex that it is made of; part of cost.c. */
#ifndef BW_EXPLORE_GRIDS_H
#define BW_EXPLORE_GRIDS_H

#include "explore/cost.h"

typedef struct {
    bw_hvertex *vertex;
    size_t room;
} bw_grid_filler;

/* n: hexes along the axes of the box; vertex: its grid points, the first axis fastest, valid until the next call. Errors: BW_E_MEMORY. */
bw_status bw_grid_fill(bw_context *ctx, const bw_block_grids *grids, const bw_space *space, const bw_block_box *box, bw_grid_filler *filler, uint32_t n[3],
                       const bw_hvertex **vertex);
void bw_grid_filler_clear(bw_context *ctx, bw_grid_filler *filler);

#endif
