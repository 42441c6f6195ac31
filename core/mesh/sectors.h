/* Sectors: the constraints at every vertex, reduced to the core system, and the way back (MC 6.2).
 *
 * The cut divides the tets around a vertex into sectors; in combed charts all tets of a sector share the
 * vertex's value. One sector is the reference, with value u (three unknowns); crossing sheets from there
 * expresses every other sector's value as a rotation of u plus sheet translations. What remains at the vertex
 * are linear equations with integer coefficients: every further crossing from sector a to sector b of sheet s
 * R_s (R_a u + tau_a) + T_s = R_b u + tau_b an aligned facet in sector a with constant axis k (R_a u +
 * tau_a)[k] = A_s an explicitly aligned hinge in sector a, for both its axes     (R_a u + tau_a)[i] = L_h
 * Around a singular edge the first kind is (I - M) u = ..., M the monodromy: MC's fixed points. Eliminating u
 * from the equations of a vertex leaves rows without u: conditions on the sheets' unknowns T, A, L alone.
 * They are collected, without repetition, in the core system. All vertices inside a branch give the same row,
 * so the system's size is that of the cut, not of the mesh; at most three rows p u_i + ... = 0. If p = 1, u_i
 * is implied and integer. If p > 1 (a half turn: 2 u = T; a quarter turn has determinant 2), u_i enters the
 * core system as an unknown of its own, and the row with it: then an integer solution of the core system
 * makes u integer as well. MC keeps u at nodes in the core system and eliminates everything else by hand;
 * this is the same system after eliminating u at nodes too, and it needs no case distinction between nodes,
 * branches with and without ends, and sheets that touch the boundary: every vertex, whatever it is,
 * contributes its equations. A vertex at which parts of the mesh merely touch has one u per part.
 *
 * Unknowns, as columns: T (3 per cut sheet), A (1 per align sheet), L (2 per explicitly aligned hinge), then
 * the u that need one.
 */
#ifndef BW_MESH_SECTORS_H
#define BW_MESH_SECTORS_H

#include "mesh/cutset.h"

typedef struct {
    const bw_tet_mesh *mesh;
    const bw_hinges *hinges;
    const bw_seams *seams;
    const bw_cutset *cut;
    const int64_t (*value)[4][3]; /* the input on the grid */
} bw_sector_input;                /* all borrowed */

/* Homogeneous equations, row r: sum of coefficient[i] * x[column[i]] over start[r] <= i < start[r + 1], equal
 * to 0. */
typedef struct {
    size_t row_count, column_count;
    size_t *start;
    int32_t *column;
    int64_t *coefficient;
    int64_t *estimate; /* [column] what the input has for the unknown */
    size_t start_room, column_room, coefficient_room, estimate_room;
} bw_core_system;

/* O(tets + size of the cut). */
bw_status bw_sectors_system(bw_context *ctx, const bw_sector_input *input, bw_core_system *system);
void bw_core_system_clear(bw_context *ctx, bw_core_system *system);

/* Writes the values of all corners, in their own charts, that follow from an integer solution x of the core
 * system, |x| <= 2 * BW_COMBED_MAX; what x leaves open is taken from the input. BW_E_RANGE with the tet if a
 * value leaves the grid. O(tets). */
bw_status bw_sectors_place(bw_context *ctx, const bw_sector_input *input, const int64_t *x,
                           int64_t (*value)[4][3]);

#endif
