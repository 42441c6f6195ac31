/* The classical alternative to quantization, for comparison: rounding (Q 3.3, 7.2).
 *
 * In a seamless map whose charts are cut open along a spanning tree of blocks these have to be integers: coordinates of links across them (two), of regions across
 * them (one), of feature vertices (three), and the translations of the transitions across the cut. They are rounded one after another, that nearest to an integer
 * first, and after each the others move to where the map's arcs change least (least squares, as the quantization's objective has it); that is incremental rounding with
 * interleaved optimization, on the complex in the place of the tets. Where the integers chosen before leave one no choice or only every second or
 * fourth integer, it takes what is left, exactly; so arcs always get integer lengths and patches stay rectangles. Nothing else is looked at: what collapses or turns over on the way
 * are the conflicts.
 */
#ifndef BW_QUANTIZE_ROUNDING_H
#define BW_QUANTIZE_ROUNDING_H

#include "quantize/model.h"
#include "quantize/validity.h"

typedef struct bw_rounding bw_rounding;

typedef struct {
    double scale;
    size_t integers;                 /* that were rounded; the others followed from them */
    bool valid;
    uint64_t broken[BW_RULE_COUNT];  /* validity constraints that the result breaks: conflicts, by rule */
    uint64_t conflicts;              /* all of them */
    uint64_t hexes;                  /* 0 if not valid */
    double objective;                /* sum over arcs of (length - scale * input length)^2 */
} bw_rounding_result;

/* Finds the integers of a map and their dependencies; all is borrowed until bw_rounding_free. BW_E_RANGE if factors grow beyond 2^62. */
bw_status bw_rounding_new(bw_context *ctx, bw_validity *validity, const bw_quant_model *model, bw_rounding **out);
void bw_rounding_free(bw_context *ctx, bw_rounding *rounding); /* NULL is fine */

/* Rounds the map enlarged by `scale`: length[arc], and what is wrong with them. O(integers^2 * unknowns). */
bw_status bw_rounding_run(bw_rounding *rounding, double scale, int64_t *length, bw_rounding_result *result);

/* The coarsest scale for which rounding is valid, as Q 7.2 looks for it: by bisection, although it may be valid for coarser ones again and not for finer ones.
 * `steps` halvings, from a scale found by doubling. result->valid is false if it is not even where the shortest arc comes to 2^10. */
bw_status bw_rounding_coarsest(bw_rounding *rounding, int steps, int64_t *length, bw_rounding_result *result);

#endif
