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
    /* written out: this is the innermost code of all optimization */
    cofactor[0][0] = j[1][1] * j[2][2] - j[1][2] * j[2][1], cofactor[0][1] = j[1][2] * j[2][0] - j[1][0] * j[2][2];
    cofactor[0][2] = j[1][0] * j[2][1] - j[1][1] * j[2][0], cofactor[1][0] = j[2][1] * j[0][2] - j[2][2] * j[0][1];
    cofactor[1][1] = j[2][2] * j[0][0] - j[2][0] * j[0][2], cofactor[1][2] = j[2][0] * j[0][1] - j[2][1] * j[0][0];
    cofactor[2][0] = j[0][1] * j[1][2] - j[0][2] * j[1][1], cofactor[2][1] = j[0][2] * j[1][0] - j[0][0] * j[1][2];
    cofactor[2][2] = j[0][0] * j[1][1] - j[0][1] * j[1][0];
    return j[0][0] * cofactor[0][0] + j[0][1] * cofactor[0][1] + j[0][2] * cofactor[0][2];
}

/* The energy; j becomes its gradient. `size` weighs the second term. */
static inline double bw_foldover(double j[3][3], double epsilon, double size) {
    double c[3][3], d = bw_cofactors(j, c), root = sqrt(epsilon * epsilon + d * d);
    /* (d + root) / 2, without cancellation where d is negative */
    double chi = d >= 0 ? 0.5 * (d + root) : 0.5 * epsilon * epsilon / (root - d);
    if (!(chi > 0)) return INFINITY;
    double slope = root > 0 ? 0.5 * (1 + d / root) : 1;
    double norm = j[0][0] * j[0][0] + j[0][1] * j[0][1] + j[0][2] * j[0][2] + j[1][0] * j[1][0] + j[1][1] * j[1][1] + j[1][2] * j[1][2] +
                  j[2][0] * j[2][0] + j[2][1] * j[2][1] + j[2][2] * j[2][2];
    double third = cbrt(chi), by_norm = 1 / (third * third);
    double by_d = (-2.0 / 3.0 * norm * by_norm * slope + size * (2 * d - (d * d + 1) * slope / chi)) / chi;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) j[i][k] = 2 * by_norm * j[i][k] + by_d * c[i][k];
    return norm * by_norm + size * (d * d + 1) / chi;
}

#endif
