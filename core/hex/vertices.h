/* Vertices of the hex mesh: the lattice points of every closed tet, numbered.
 *
 * Invariants
 *  1. Of each tet the table has every vertex in it, those on its surface too: slices of equal first coordinate, in them rows of equal second one, in
 *     them consecutive points. Finding one is three look-ups.
 *  2. A point has the same number in every tet that has it. Its own tet is the lowest around the simplex in whose interior it lies, which numbers it.
 *  3. Coordinates are in hexes: vertex k is the lattice point 2 * k, the centre of hex k the lattice point 2 * k + 1 (lattice.h).
 */
#ifndef BW_HEX_VERTICES_H
#define BW_HEX_VERTICES_H

#include "hex/carrier.h"
#include "hex/extract.h"
#include "hex/lattice.h"

typedef struct {
    int32_t first;   /* coordinate of the first row, or point */
    uint32_t begin;  /* in the list of rows, or points; the next one's is the end */
} bw_hex_span;

typedef struct {
    bw_lattice lattice;
    bw_carriers carriers;
    uint32_t *column_begin; /* [tet + 1] */
    int32_t *column_first;  /* [tet] first coordinate of the first column */
    bw_hex_span *column, *row;
    bw_hvertex *id;         /* of points */
} bw_hex_vertices;

/* Counts and makes room in *points, *mesh and *origin; then fills all but the hexes' corners. On failure too all three are to be cleared. Errors as bw_hex_extract. */
bw_status bw_hex_vertices_init(bw_context *ctx, const bw_igm *igm, int32_t subdivide, uint64_t max_hexes, bw_hex_vertices *points, bw_hex_mesh *mesh, bw_hex_origin *origin);
void bw_hex_vertices_clear(bw_context *ctx, bw_hex_vertices *points);

/* The vertex at k in the chart of a tet; BW_NONE if the closed tet does not have it. */
static inline bw_hvertex bw_hex_vertices_find(const bw_hex_vertices *p, bw_tet tet, const int64_t k[3]) {
    uint32_t c = p->column_begin[tet], c_end = p->column_begin[tet + 1];
    int64_t i = k[0] - p->column_first[tet];
    if (i < 0 || i >= c_end - c) return BW_NONE;
    const bw_hex_span *column = &p->column[c + i];
    i = k[1] - column->first;
    if (i < 0 || i >= column[1].begin - column->begin) return BW_NONE;
    const bw_hex_span *row = &p->row[column->begin + i];
    i = k[2] - row->first;
    return i < 0 || i >= row[1].begin - row->begin ? BW_NONE : p->id[row->begin + i];
}

#endif
