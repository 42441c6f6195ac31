/* The best quantization, with a proof (Q 5.2, 5.6).
 *
 * On integers a parabola is the maximum of the lines through its neighbouring points, so the objective is linear in integers with one more column per
 * class, and a search by branch and cut (solve/program.h) finds the optimum exactly. Lines are added where a relaxation needs them, validity constraints
 * where integer values break them, both inside one search: it is never begun anew. The heuristic's values start it, and are the answer if time runs
 * out before anything better is found.
 */
#ifndef BW_QUANTIZE_SOLVE_H
#define BW_QUANTIZE_SOLVE_H

#include "quantize/heuristic.h"

typedef enum {
    BW_QUANT_OPTIMAL,  /* nothing that satisfies the constraints learnt is better; they are those of Q 5.3: sufficient for validity */
    BW_QUANT_GAP,      /* searched, not to the end: bound says how far it may be */
    BW_QUANT_HEURISTIC /* the search never began, or found nothing better than the start and no bound better than the simple one */
} bw_quant_status;

const char *bw_quant_status_name(bw_quant_status status); /* "optimal", "gap", "heuristic" */

typedef struct {
    bw_quant_status status;
    double objective, bound;  /* bound: nothing that satisfies the constraints is below it */
    double simple_bound;      /* without linear programming */
    double heuristic;         /* objective of the values that started the search */
    uint64_t nodes, relaxations, rounds, rows; /* rounds of separation; constraints found by it */
    double seconds, seconds_separation;
} bw_quant_result;

/* objective - bound relative to the objective. */
double bw_quant_gap(const bw_quant_result *result);

/* Solves `p` for its scale. `start`: valid values, or NULL; `value` gets the best found, always valid. Constraints found stay in p->rows, so the next
 * scale starts with them. seconds: time limit for the search; 0: only the heuristic. */
bw_status bw_quant_solve(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                         double seconds, const int64_t *start, int64_t *value, bw_quant_result *result);

#endif
