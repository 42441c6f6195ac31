/* Unconstrained minimization: limited-memory BFGS with a bisecting line search for the weak Wolfe conditions.
 *
 * The energy may be infinite (a barrier); the line search backs off from there. Sums run in index order, so
 * the same start gives the same end, bit for bit.
 */
#ifndef BW_SOLVE_LBFGS_H
#define BW_SOLVE_LBFGS_H

#include "base/context.h"

/* Value at x, and the gradient (not read where the value is infinite or not a number). */
typedef double bw_lbfgs_energy(void *user, const double *x, double *gradient);

typedef struct {
    int iterations; /* at most */
    double step;    /* length of the first step, largest component */
    double settled; /* stop when an iteration gains less than this part of the energy */
} bw_lbfgs_options;

typedef struct {
    int iterations;
    double before, after;
} bw_lbfgs_report;

/* Requires a finite energy at x. x becomes the best point found. Errors: BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_lbfgs(bw_context *ctx, size_t n, double *x, bw_lbfgs_energy *energy, void *user,
                   const bw_lbfgs_options *options, bw_lbfgs_report *report);

#endif
