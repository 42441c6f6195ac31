/* Stage reduce: wall retraction (MC 4.2, 5.4), with a search for a good order of removal. */
#ifndef BW_STAGE_REDUCE_H
#define BW_STAGE_REDUCE_H

#include "complex/reduction.h"

typedef struct {
    bw_reduce_mode mode;
    bool split_self_adjacent;
    int effort; /* 0: farthest first only, as the paper does; 1..3: that, then a local search of growing length */
} bw_reduce_options;

typedef struct {
    size_t blocks_before, blocks_farthest_first, blocks, patches_removed;
    uint64_t runs; /* orders of removal tried */
} bw_reduce_report;

/* Removes walls from `cells` and builds `complex` anew. The result is irreducible in the chosen mode and has passed bw_complex_check
 * (BW_E_CHECK otherwise). Deterministic: the search has a fixed seed and a length that depends on the complex only. */
bw_status bw_reduce(bw_context *ctx, bw_cells *cells, bw_complex *complex, const bw_reduce_options *options,
                    bw_reduce_report *report);

#endif
