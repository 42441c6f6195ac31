/* Homogeneous integer equations solved for all their integer solutions: the presolve of the quantization.
 *
 * Equations are taken shortest first. One with a factor of 1 (or -1) gives an unknown away: it is implied by the others. One without is
 * brought there by changes of unknowns x_p = t - sum q_i x_i with integer q_i, as in Euclid's algorithm; t is an extra unknown. So the map from the
 * unknowns that are left to the solutions is one to one in integers, which echelon.h, made for one solution near a point, does not give.
 */
#ifndef BW_QUANTIZE_ELIMINATE_H
#define BW_QUANTIZE_ELIMINATE_H

#include "base/context.h"

typedef struct {
    int32_t unknown;
    int64_t factor;
} bw_eliminate_term;

typedef struct {
    int32_t unknown; /* = sum of its terms */
    size_t begin, end;
} bw_eliminate_step;

/* Unknowns 0 .. count - 1 are the caller's, the rest extra. Steps in the order they were made: the terms of one are unknowns implied by later
 * steps, or by none. */
typedef struct {
    size_t count;
    bw_eliminate_step *step;
    size_t step_count, step_room;
    bw_eliminate_term *term;
    size_t term_count, term_room;
} bw_elimination;

typedef struct {
    size_t rows, unknowns;
    const size_t *begin; /* [row + 1] */
    const bw_eliminate_term *term; /* ascending unknowns */
    const int64_t *size; /* [unknown]: of equal candidates the largest is given away */
} bw_eliminate_input;    /* borrowed */

/* BW_E_RANGE if a factor exceeds 2^40. */
bw_status bw_eliminate(bw_context *ctx, const bw_eliminate_input *input, bw_elimination *out);
void bw_elimination_clear(bw_context *ctx, bw_elimination *out);

#endif
