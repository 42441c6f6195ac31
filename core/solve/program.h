/* Linear programs with integer columns: one interface in front of the linear programming library (CLP).
 *
 * minimize sum cost[c] x[c]  subject to  lower <= row . x <= upper,  lower[c] <= x[c] <= upper[c],  some x[c] integer.
 *
 * Rows may be added at any time and are never taken away. bw_program_relax solves the relaxation without integrality, warm from the last basis:
 * after a change of bounds or new rows that is a few dual simplex steps. bw_program_branch (branch.c) finds integer optima.
 *
 * Deterministic: one thread, no clock but the deadline. Values are floating point: what follows from them is proven up to BW_PROGRAM_EPSILON; callers
 * round integer columns and verify in integers. The library's own blocks are not counted in the job's memory.
 */
#ifndef BW_SOLVE_PROGRAM_H
#define BW_SOLVE_PROGRAM_H

#include <stdbool.h>

#include "base/context.h"

#define BW_PROGRAM_EPSILON 1e-6 /* a column is integral, a row holds, a bound is reached within this */
#define BW_PROGRAM_INFINITY 1e30

typedef struct bw_program bw_program;

typedef enum {
    BW_PROGRAM_OPTIMAL,
    BW_PROGRAM_INFEASIBLE, /* or worse than the cutoff */
    BW_PROGRAM_UNBOUNDED,
    BW_PROGRAM_STOPPED /* iteration limit, or numerical trouble: nothing is known */
} bw_program_status;

bw_status bw_program_new(bw_context *ctx, bw_program **out);
void bw_program_free(bw_context *ctx, bw_program *program); /* NULL is fine */

/* Columns must all be there before the first row. Indices count from 0 in the order of the calls. */
bw_status bw_program_add_column(bw_context *ctx, bw_program *program, double lower, double upper, double cost, bool integer);
/* `column` distinct, any order; copied. */
bw_status bw_program_add_row(bw_context *ctx, bw_program *program, size_t n, const int *column, const double *factor,
                             double lower, double upper);
size_t bw_program_columns(const bw_program *program);
size_t bw_program_rows(const bw_program *program);
bool bw_program_is_integer(const bw_program *program, size_t column);

void bw_program_get_bounds(const bw_program *program, size_t column, double *lower, double *upper);
void bw_program_set_bounds(bw_program *program, size_t column, double lower, double upper);
void bw_program_set_cost(bw_program *program, size_t column, double cost);

/* Solves the relaxation. Stops early with BW_PROGRAM_INFEASIBLE once its value is known to exceed `cutoff` (BW_PROGRAM_INFINITY: never). *value is
 * set if optimal. BW_E_MEMORY. */
bw_status bw_program_relax(bw_context *ctx, bw_program *program, double cutoff, bw_program_status *status, double *value);
/* As bw_program_relax with at most `steps` simplex steps; STOPPED leaves in *value the value reached, which is a lower bound if the basis before was
 * optimal for looser bounds. */
bw_status bw_program_try(bw_context *ctx, bw_program *program, int steps, double cutoff, bw_program_status *status, double *value);
const double *bw_program_solution(const bw_program *program); /* [column], of the last relaxation; borrowed until the next call */

/* The basis: bw_program_basis_size bytes now; rows that came later than a stored basis are taken as slack. */
size_t bw_program_basis_size(const bw_program *program);
void bw_program_get_basis(const bw_program *program, unsigned char *basis);
bw_status bw_program_set_basis(bw_context *ctx, bw_program *program, const unsigned char *basis, size_t size);

/* ---- integer optima ------------------------------------------------------------------------------------------------ */

typedef struct {
    /* Called with every solution x of a relaxation that matters (value below the cutoff). May add rows that x violates and that hold for all
     * solutions sought, and may lower *cutoff to the value of a solution it has found and kept. An integral x that no row is added for is
     * taken as settled: the callback has dealt with it. */
    bw_status (*look)(void *user, bw_program *program, const double *x, double value, bool integral, double *cutoff);
    void *user;
    double cutoff;      /* value of the best solution known; BW_PROGRAM_INFINITY */
    double step;        /* solutions better than the cutoff are better by at least this; 0 if nothing is known */
    double seconds;     /* time limit */
    uint64_t node_limit;
} bw_branch_options;

typedef struct {
    bool exhausted; /* nothing is left to look at: the cutoff is the optimum */
    double cutoff, bound; /* bound: no solution is below it, up to the cutoff */
    uint64_t nodes, relaxations;
} bw_branch_result;

/* Branch and cut: best bound first, diving; pseudo-costs started by trial steps (strong branching). Bounds of the columns are
 * restored. BW_E_MEMORY, BW_E_CANCELLED, BW_E_ALGORITHM if the relaxation is unbounded, or what the callback returns. */
bw_status bw_program_branch(bw_context *ctx, bw_program *program, const bw_branch_options *options, bw_branch_result *result);

#endif
