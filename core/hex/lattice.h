/* Lattice points in a tet of an integer-grid map, exactly.
 *
 * Values are scaled so that a lattice step is `unit`, a power of two. Points of the lattice with three even coordinates are vertices of hexes, points with three odd
 * coordinates are centres of hexes: so the edge of a hex is two steps, and one lattice serves both.
 *
 * Facet i of a tet, opposite corner i, is the zero of an affine function that is positive at corner i: `unit` times
 *     offset[i] + normal[i] . (p - base) + (something in [0, 1); zero exactly if not fraction[i])       at a lattice point p.
 * All of it is in 128 bits, so every sign is that of a comparison of integers; nothing is estimated.
 */
#ifndef BW_HEX_LATTICE_H
#define BW_HEX_LATTICE_H

#include "igm/igm.h"

typedef __int128 bw_wide;

typedef struct {
    int64_t factor, unit; /* scaled value = factor * value of the map; lattice step */
    int shift;            /* unit = 2^shift */
    const bw_igm *igm;    /* borrowed */
} bw_lattice;

typedef struct {
    int64_t value[4][3]; /* scaled */
    int64_t base[3];     /* lattice coordinates of a point near */
    bw_wide normal[4][3], offset[4];
    bool fraction[4];
    double local[4][3];  /* corners in steps from base, rounded */
} bw_lattice_tet;

/* Points of one parity with the same first two coordinates: those with last coordinate 2 * k + parity, k = low..high (none if high < low). */
typedef struct {
    int64_t low, high;
    uint8_t flat, at_low, at_high; /* facets that all of them, the first, the last lie on (bit i: facet i) */
    int64_t base_low;              /* last coordinate of the first, from base */
    bw_wide start[4];              /* offset + normal . (p - base) at the first */
} bw_lattice_row;

/* The lattice whose hexes are 1/subdivide of a unit long. BW_E_RANGE if numbers would not fit. */
bw_status bw_lattice_init(bw_context *ctx, const bw_igm *igm, int32_t subdivide, bw_lattice *lattice);
/* Requires a positive tet. BW_E_RANGE if it spans so many hexes that numbers would not fit. */
bw_status bw_lattice_tet_init(bw_context *ctx, const bw_lattice *lattice, bw_tet tet, bw_lattice_tet *out);
/* Range of k of the first coordinate, 2 * k + parity. */
void bw_lattice_columns(const bw_lattice_tet *tet, int parity, int64_t range[2]);
/* Range of k of the second coordinate where the first is x; may be a little too large. */
void bw_lattice_rows(const bw_lattice_tet *tet, int parity, int64_t x, int64_t range[2]);
/* The row where the first two are 2 * xy + parity. */
void bw_lattice_row_init(const bw_lattice_tet *tet, int parity, int64_t x, int64_t y, bw_lattice_row *row);

/* Integer part of facet i's function at a lattice point: negative exactly if the function is. */
static inline bw_wide bw_lattice_side(const bw_lattice_tet *tet, int i, const int64_t p[3]) {
    return tet->offset[i] + tet->normal[i][0] * (p[0] - tet->base[0]) + tet->normal[i][1] * (p[1] - tet->base[1]) +
           tet->normal[i][2] * (p[2] - tet->base[2]);
}
/* Whether the closed facet has a point in the open cube of a hex with this centre. */
bool bw_lattice_facet_in_cube(const bw_lattice *lattice, const bw_lattice_tet *tet, int facet, const int64_t centre[3]);
/* Transition across a facet in steps. BW_E_CHECK if it has no whole shift. */
bw_status bw_lattice_across(bw_context *ctx, const bw_lattice *lattice, bw_facet facet, bw_tet from, bw_transition *out);

/* Whether point k of a row lies on facets: a mask of them. */
static inline uint8_t bw_lattice_mask(const bw_lattice_row *row, int64_t k) {
    return (uint8_t)(row->flat | (k == row->low ? row->at_low : 0) | (k == row->high ? row->at_high : 0));
}

#endif
