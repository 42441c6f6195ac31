/* Quantizations of one complex in several sizes: the model and what is learnt about validity are kept from one to the next.
 *
 *     open -> solve, solve, ..., aim -> close
 *
 * Every answer is valid by the oracle it was opened with, and says how good it is proven to be (bw_quant_result).
 *
 * Narrower ranges are solved first, each as it would be alone, and start the next: so a wider range is never worse. That is not implied by optimality, for validity
 * constraints are sufficient, not necessary: one that keeps two entities apart says in which direction (Q 5.3.2), and which ones
 * are learnt depends on the way that the search took.
 */
#ifndef BW_QUANTIZE_QUANTIZER_H
#define BW_QUANTIZE_QUANTIZER_H

#include "quantize/solve.h"

typedef struct {
    bw_quant_model model;
    bw_quant_moves moves;
    bw_quant_problem level[3]; /* the ranges from positive to the one wanted */
    size_t levels, used;       /* used: how many of them are solved now, the last of which is the answer's */
    bw_quant_oracle oracle;
    int64_t *value; /* [class] of the last answer */
    int64_t *best;  /* [class] scratch */
} bw_quantizer;

/* The problem in the range that is solved now. */
static inline bw_quant_problem *bw_quantizer_problem(bw_quantizer *q) { return &q->level[q->used - 1]; }

bw_status bw_quantizer_open(bw_context *ctx, const bw_complex *complex, int32_t grid_exponent, bw_quantize_range range,
                            const bw_quant_oracle *oracle, bw_quantizer *q);
void bw_quantizer_close(bw_context *ctx, bw_quantizer *q);

/* From now on answers are of this range, at most the one the quantizer was opened with. */
void bw_quantizer_use(bw_quantizer *q, bw_quantize_range range);

/* The best quantization for a scale (0: the coarsest). Its lengths are q->value, on classes. BW_E_RANGE if arcs would be longer than 2^40. */
bw_status bw_quantizer_solve(bw_context *ctx, bw_quantizer *q, double scale, double seconds, bw_quant_result *result);

/* The scale whose best quantization comes nearest to `hexes` hexes, found by bisection: counts jump where lengths do, so there may be none very
 * near. Nearer ones that no scale is best for are tried as well, from there. *scale and *result: of the nearest one found. */
bw_status bw_quantizer_aim(bw_context *ctx, bw_quantizer *q, uint64_t hexes, double seconds, double *scale, bw_quant_result *result);

/* The quantization of fewest hexes (fewest.h); of several one near the coarsest. In *result objective, bound and heuristic are numbers of hexes. */
bw_status bw_quantizer_fewest(bw_context *ctx, bw_quantizer *q, double seconds, bw_quant_result *result);

typedef struct {
    uint64_t hexes, zero_arcs, negative_arcs;
    double distortion; /* root mean square of length - scale * input length over arcs, relative to that of scale * input length; 0 at scale 0 */
} bw_quant_figures;

bw_quant_figures bw_quantizer_figures(bw_quantizer *q);

#endif
