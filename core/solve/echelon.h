/* Exact integer solutions of homogeneous integer systems, close to a given point (MC 6.1).
 *
 * The system is brought into reduced row echelon form in integers of any size: every row then reads p x_i +
 * sum a_j x_j = 0 with one implied unknown i and free unknowns j. Free unknowns are rounded to multiples of
 * what they get divided by, d_j = lcm over the rows of p / gcd(p, a_j), so that all implied unknowns are
 * integers.
 *
 * Pivots are chosen for sparsity, and among the entries of a row for a factor of 1, so that divisors stay
 * small: a row 2 u = T implies T. Everything is deterministic.
 */
#ifndef BW_SOLVE_ECHELON_H
#define BW_SOLVE_ECHELON_H

#include "base/context.h"

/* Row r: sum of coefficient[i] x[column[i]] over start[r] <= i < start[r + 1] is 0. Columns of a row ascend.
 */
typedef struct {
    size_t rows, columns;
    const size_t *start;
    const int32_t *column;
    const int64_t *coefficient;
} bw_equations; /* borrowed */

typedef struct {
    size_t rank, free; /* free unknowns that occur in some row */
    int64_t divisor;   /* largest d_j; 1 if none */
} bw_echelon_report;

/* Solves the system: x is integer and exact, free unknowns differ from `estimate` by at most d_j / 2. Errors:
 * BW_E_RANGE if a divisor exceeds max_divisor or an unknown max_value in absolute value; BW_E_MEMORY;
 * BW_E_CANCELLED. */
bw_status bw_echelon_solve(bw_context *ctx, const bw_equations *equations, const int64_t *estimate,
                           int64_t max_divisor, int64_t max_value, int64_t *x, bw_echelon_report *report);

#endif
