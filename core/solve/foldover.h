/* The foldover-free energy of one Jacobian (Garanzha, Kaporin, Kudryavtseva, Protais, Ray, Sokolov: Foldover-free maps in 50 lines of code, 2021):
 *
 *     tr(J^T J) / chi(D)^(2/3) + (D^2 + 1) / chi(D)    with  D = det J,  chi(D) = (D + sqrt(epsilon^2 + D^2)) / 2.
 *
 * With epsilon 0 it is a barrier: infinite where D is not positive.
 */
#ifndef BW_SOLVE_FOLDOVER_H
#define BW_SOLVE_FOLDOVER_H

#include <math.h>

/* The cofactors of j, which are the derivatives of its determinant; the determinant. */
static inline double bw_cofactors(double j[3][3], double cofactor[3][3]) {
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            int a1 = (a + 1) % 3, a2 = (a + 2) % 3, b1 = (b + 1) % 3, b2 = (b + 2) % 3;
            cofactor[a][b] = j[a1][b1] * j[a2][b2] - j[a1][b2] * j[a2][b1];
        }
    return j[0][0] * cofactor[0][0] + j[0][1] * cofactor[0][1] + j[0][2] * cofactor[0][2];
}

/* The energy; j becomes its gradient. `size` weighs the second term. */
static inline double bw_foldover(double j[3][3], double epsilon, double size) {
    double c[3][3], norm = 0, d = bw_cofactors(j, c), root = sqrt(epsilon * epsilon + d * d);
    /* (d + root) / 2, without cancellation where d is negative */
    double chi = d >= 0 ? 0.5 * (d + root) : 0.5 * epsilon * epsilon / (root - d);
    if (!(chi > 0)) return INFINITY;
    double slope = root > 0 ? 0.5 * (1 + d / root) : 1;
    for (int i = 0; i < 9; i++) norm += j[i / 3][i % 3] * j[i / 3][i % 3];
    double third = cbrt(chi), by_norm = 1 / (third * third);
    double by_d = (-2.0 / 3.0 * norm * by_norm * slope + size * (2 * d - (d * d + 1) * slope / chi)) / chi;
    for (int i = 0; i < 9; i++) j[i / 3][i % 3] = 2 * by_norm * j[i / 3][i % 3] + by_d * c[i / 3][i % 3];
    return norm * by_norm + size * (d * d + 1) / chi;
}

#endif
