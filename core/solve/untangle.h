/* Untangling: moves the free coordinates of tets until every tet is positive, each as near as may be to the shape it should have.
 *
 *     new -> fit, fit, ... (a start) -> run -> free
 *
 * The energy is a sum of distortion.h, minimized for a falling sequence of eps. Once all determinants are positive eps is 0: then the energy is a barrier, no tet inverts
 * again, and what is left is shape. Newton's method with the Hessian's positive part, factored anew in each step: on real maps it needs 20 to 60 steps where L-BFGS (lbfgs.h), also with a
 * Laplacian for preconditioner, needs thousands of evaluations and stops in more cases without having removed the last inverted tets. (core/README.md has the figures.)
 *
 * Floating point only: whoever rounds the result verifies it. The same input gives the same bits at any thread count.
 */
#ifndef BW_SOLVE_UNTANGLE_H
#define BW_SOLVE_UNTANGLE_H

#include "base/context.h"

/* Coordinate k of corner i is at[i][k] + sign[i][k] * x[variable[i][k]]; at[i][k] alone if variable[i][k] is -1. */
typedef struct {
    double at[4][3];
    int32_t variable[4][3];
    int8_t sign[4][3];
    double rest[3][3]; /* inverse of the matrix whose columns are the wanted edges from corner 0; positive determinant */
} bw_untangle_tet;

typedef struct {
    int rounds;     /* Newton steps at most while tets are not positive */
    int patience;   /* ... and without removing one */
    int polish;     /* steps at most afterwards */
    double from;    /* the first eps is this part of the most negative determinant; 0: 1, for a start far from valid */
    double settled; /* stop when such a step gains less than this part of the energy */
    double shown, share; /* progress of the stage at the start, and what `rounds` steps add to it; share 0: not reported */
} bw_untangle_options;

typedef struct {
    int rounds, iterations;      /* steps while tets were not positive; all */
    size_t inverted_before, inverted;
    double smallest;             /* least determinant at the end; the tets are positive if it is */
    double energy;               /* mean over tets at the end, 5 at least; infinite if a tet is not positive */
} bw_untangle_report;

typedef struct bw_untangler bw_untangler;

/* `tet` is borrowed. BW_E_MEMORY. */
bw_status bw_untangler_new(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count, bw_untangler **out);
void bw_untangler_free(bw_context *ctx, bw_untangler *untangler); /* NULL is fine */

/* x = the minimum of the sum over tets of weight[tet] * |J - target[tet]|^2; target NULL: 0, the harmonic map. Where nothing decides, x stays near 0. */
bw_status bw_untangler_fit(bw_context *ctx, bw_untangler *untangler, const double *weight, const double (*target)[3][3], double *x);
/* x: start and result. Units in which the wanted edges have about length 1 are best. */
bw_status bw_untangler_run(bw_context *ctx, bw_untangler *untangler, const bw_untangle_options *options, double *x, bw_untangle_report *report);

/* All of it, starting from the harmonic map if tets are not positive: for it all that matters is what may not move; a vertex far out of place is back at
 * once, where the energy alone would be caught in a local minimum. */
bw_status bw_untangle(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count, double *x, bw_untangle_report *report);

/* Jacobian of one tet, and its determinant. */
void bw_untangle_jacobian(const bw_untangle_tet *tet, const double *x, double out[3][3]);
double bw_untangle_volume(const bw_untangle_tet *tet, const double *x);

#endif
