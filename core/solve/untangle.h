/* Untangling: moves the free coordinates of tets until every tet is positive, each as near as may be to the
 * shape it should have.
 *
 * The energy is the one of Garanzha, Kaporin, Kudryavtseva, Protais, Ray, Sokolov: Foldover-free maps in 50
 * lines of code (2021): with J the Jacobian from the wanted shape to the present one and D its determinant,
 *
 *     sum over tets of  tr(J^T J) / chi(D)^(2/3) + (D^2 + 1) / chi(D)
 *     with  chi(D) = (D + sqrt(eps^2 + D^2)) / 2,
 *
 * minimized for a falling sequence of eps. Once all D are positive eps is 0: then the energy is a barrier, no
 * tet inverts again, and what is left is shape. The descent starts from the harmonic map, for which all that
 * matters is what may not move; a vertex far out of place is back at once, where the energy alone would be
 * caught in a local minimum. Floating point only: whoever rounds the result verifies it.
 */
#ifndef BW_SOLVE_UNTANGLE_H
#define BW_SOLVE_UNTANGLE_H

#include "base/context.h"

/* Coordinate k of corner i is at[i][k] + sign[i][k] * x[variable[i][k]]; at[i][k] alone if variable[i][k] is
 * -1. */
typedef struct {
    double at[4][3];
    int32_t variable[4][3];
    int8_t sign[4][3];
    double rest[3][3]; /* inverse of the matrix whose columns are the wanted edges from corner 0; positive
                          determinant */
} bw_untangle_tet;

typedef struct {
    int rounds, iterations;
    double smallest; /* least D at the end; the tets are positive if it is */
} bw_untangle_report;

/* x: start and result. Units in which the wanted edges have about length 1 are best. */
bw_status bw_untangle(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count,
                      double *x, bw_untangle_report *report);
/* Determinant of the Jacobian of one tet. */
double bw_untangle_volume(const bw_untangle_tet *tet, const double *x);

#endif
