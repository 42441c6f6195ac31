/* The valid quantization of fewest hexes, with a proof: sum over blocks of the product of its three extents.
 *
 * The objective of Q is the sum of squared lengths also where the coarsest quantization is wanted, and its optimum is not always the one of fewest hexes. A
 * product is not convex, but where extents are at least L1, L2, L3 >= 0 it is at least
 *
 *     L2 L3 e1 + L1 L3 e2 + L1 L2 e3 - 2 L1 L2 L3,
 *
 * with equality where no two of them exceed their bound. So the search branches on extents: each node has its bounds, its own linear objective from them, and
 * the linear program under that bounds its hexes from below.
 */
#ifndef BW_QUANTIZE_FEWEST_H
#define BW_QUANTIZE_FEWEST_H

#include "quantize/heuristic.h"
#include "quantize/solve.h"

/* `value`: valid values to start from; gets the best found, always valid. In result objective, bound and heuristic are numbers of hexes. Constraints that are learnt stay
 * in p->rows. Of equally few hexes the first found are kept. seconds: time limit. */
bw_status bw_quant_fewest(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                          double seconds, int64_t *value, bw_quant_result *result);

#endif
