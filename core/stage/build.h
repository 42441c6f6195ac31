/* Stage build: from walls to the complex of cuboid blocks (MC 4.1), splitting toroidal and, on request, self-adjacent blocks (MC 5.3). */
#ifndef BW_STAGE_BUILD_H
#define BW_STAGE_BUILD_H

#include "complex/complex.h"

typedef struct {
    uint64_t max_cells; /* that all cuts, of trace too, may add to those of the tets */
    bool split_self_adjacent; /* blocks that touch themselves across opposite sides get a wall in their middle */
} bw_build_options;

/* Reads the complex off the walls; while some block is a torus, cuts it open with more walls (flag BW_SPLIT) and reads again.
 * complex->torus_splits counts these blocks. A block that touches itself around a singular arc of one quarter turn cannot be split from
 * itself and stays. The result has passed bw_complex_check. Errors: BW_E_ALGORITHM for a block that cannot be made a
 * cuboid, BW_E_CHECK, BW_E_LIMIT (more than max_cells cells added), BW_E_MEMORY. */
bw_status bw_build_complex(bw_context *ctx, bw_cells *cells, const bw_build_options *options, bw_complex *complex);

#endif
