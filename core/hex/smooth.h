/* Geometric optimization of a hex mesh: vertices move, on what holds them, until scaled Jacobians are positive and as good as may be.
 *
 * Every corner of a hexahedron is a tet with an ideal shape: the corner of a box (hex/corner_energy.h). First the foldover-free energy of corners is minimized by
 * L-BFGS for a falling epsilon, around those that are inverted, or everywhere if these are many; then as a barrier; then with an energy of the scaled Jacobians, which weighs
 * the worst most, and in the end only around the worst. Interior vertices have three variables, vertices on a surface two in its tangent plane,
 * those on a curve one, points none; after each round they are projected to what holds them (hex/surface.h) and get new directions. What that spoils is taken back, hexahedron by
 * hexahedron. Rounds end where they bring nothing.
 *
 * A mesh of more than `whole` hexes is optimized only around the hexes that need it. The work is limited by counts, never by a clock.
 *
 * Ensured
 *  1. Connectivity, held and carrier stay as they are.
 *  2. The mesh that is returned has no more hexes and no more corners that are not positive than the one that came in; if as many, mean + 2 min(least, 0.2)
 *     + least / 50 of its scaled Jacobians is not smaller.
 *  3. Vertices on surfaces and curves end on them. Where a hex is not positive otherwise, or hardly, they may leave them, by `leave` at most.
 *  4. The same bits at any number of threads.
 */
#ifndef BW_HEX_SMOOTH_H
#define BW_HEX_SMOOTH_H

#include "hex/hexmesh.h"
#include "hex/surface.h"

typedef struct {
    int rounds;     /* of untangling, at most */
    uint64_t work;  /* evaluations of a hexahedron that improving may take, about; each round takes some all the same */
    size_t whole;   /* hexes, at most, of a mesh that is optimized as a whole */
    double leave;   /* how far vertices may leave what holds them, in mean lengths of their edges; 0: never */
} bw_smooth_options;

typedef struct {
    double least, mean;     /* scaled Jacobian of hexes */
    uint64_t hexes;         /* whose scaled Jacobian is not positive */
    uint64_t corners;       /* likewise */
} bw_smooth_state;

typedef struct {
    bw_smooth_state before, after;
    uint64_t rounds, iterations, work;
    double moved_max, moved_mean; /* over all vertices */
    double off_max, off_mean;     /* distance from what holds a vertex, over those that are held on a surface or curve */
    uint64_t left;                /* vertices that left it */
} bw_smooth_report;

void bw_smooth_options_defaults(bw_smooth_options *options);
/* Errors: BW_E_MEMORY, BW_E_CANCELLED; the mesh then is as it was. */
bw_status bw_hex_smooth(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, const bw_smooth_options *options,
                        bw_smooth_report *report);

#endif
