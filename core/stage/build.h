/* Stage build: from walls to the complex of cuboid blocks (MC 4.1), splitting toroidal blocks (MC 5.3). */
#ifndef BW_STAGE_BUILD_H
#define BW_STAGE_BUILD_H

#include "complex/complex.h"

/* Reads the complex off the walls; while some block is a torus, cuts it open with one more wall (flag BW_SPLIT) and reads
 * again. complex->torus_splits counts those walls. The result has passed bw_complex_check. Errors: BW_E_ALGORITHM for a block that
 * cannot be made a cuboid, BW_E_CHECK, BW_E_LIMIT (more than max_cells cells), BW_E_MEMORY. */
bw_status bw_build_complex(bw_context *ctx, bw_cells *cells, uint64_t max_cells, bw_complex *complex);

#endif
