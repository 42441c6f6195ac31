/* The energy of a hexahedron's shape: over its 8 corners, each of which is a tet with the corner of an ideal box.
 *
 * For the Jacobian J of a corner, whose columns are its three edges in units of the ideal lengths:
 *
 *     the foldover-free energy (solve/foldover.h) of J,
 *   + (1 + k (1 - s) / 64)^64  with  s = det J / product of the lengths of its columns, the scaled Jacobian; k: sharpness.
 *
 * The second term is exp(k (1 - s)) but for the largest values, and has an exact derivative that costs a few multiplications. With k = 0 it is left out.
 *
 * This is the innermost code of all smoothing: loops over the 8 corners are written so that compilers make vector code of them. Every corner is computed by
 * the same operations in the same order whatever the vectors' length, so all processors give the same bits.
 */
#ifndef BW_HEX_CORNER_ENERGY_H
#define BW_HEX_CORNER_ENERGY_H

/* Infinite if epsilon is 0 and a corner is not positive. slope[c]: gradient with respect to corner c, not meaningful where the value is infinite. */
double bw_corner_energy(const double corner[8][3], const double rest[3], double epsilon, double sharpness, double slope[8][3]);

#endif
