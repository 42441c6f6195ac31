/* Quantizations without linear programming: from the input's own lengths, greatly enlarged, down by integer sheets.
 *
 * A move is an integer solution of the equalities with few non-zero classes: a free unknown alone, or two of them one way or against each
 * other. What it inflates or deflates is a sheet of the complex. Along a move the objective is a parabola, so its best step is known at once and
 * is cut to what range and constraints allow. The search goes downhill only and takes moves in a fixed order; validity is asked for at every local
 * minimum: where it fails, what was learnt is kept and the search begins anew from the last valid values (Q 5.2, with descent in the place of the solver).
 */
#ifndef BW_QUANTIZE_HEURISTIC_H
#define BW_QUANTIZE_HEURISTIC_H

#include "quantize/problem.h"

typedef struct {
    size_t count;
    size_t *begin; /* [count + 1] */
    size_t begin_room;
    bw_quant_term *term; /* class, factor */
    size_t term_room;
} bw_quant_moves;

bw_status bw_quant_moves_init(bw_context *ctx, const bw_quant_model *model, bw_quant_moves *moves);
void bw_quant_moves_clear(bw_context *ctx, bw_quant_moves *moves);

/* Moves values, which must be allowed, downhill to a local minimum. */
bw_status bw_quant_descend(bw_context *ctx, const bw_quant_problem *p, const bw_quant_moves *moves, int64_t *value);

/* Finds valid values. `start`: valid values, or NULL: what is found is no worse; thorough: leaves local minima by excursions through invalid values, whose price
 * rises until they are allowed again, from where it stands and from kicked values. Without a limit it ends by itself: the input's lengths in grid units are
 * valid. BW_E_ALGORITHM if not even those are. */
bw_status bw_quant_heuristic(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                             bool thorough, const int64_t *start, int64_t *value);

#endif
