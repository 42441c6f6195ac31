/* Triangulation of a cell complex: which diagonals its polygons get and from which point its cells are coned.
 *
 * A polygon of n vertices always gets n - 2 triangles, none of them flat, the same seen from both of its
 * cells. A cell is coned from one of its own vertices where that makes no flat tet: every polygon in a
 * supporting plane through the vertex must have the vertex in all of its triangles. Otherwise from a point
 * added inside. The choice decides the size of the traced mesh: a cell coned from a vertex has about half as
 * many tets as one coned from inside.
 *
 * Invariants
 *  1. straight[h]: the polygon of h has an angle of 180 degrees at the origin of h. Exact.
 *  2. fan[p] (n > 3): a half-edge of p whose origin belongs to all triangles of p; both neighbours of the
 *     origin are true corners, so no triangle is flat. BW_NONE: no such vertex; ears are clipped until there
 *     is one.
 *  3. apex[c]: a vertex of cell c, or a point added strictly inside it.
 *  4. All choices depend on the complex alone, not on addresses or threads.
 */
#ifndef BW_FORMAT_TESSELLATE_H
#define BW_FORMAT_TESSELLATE_H

#include "format/points.h"

typedef struct {
    const bw_cells *cells; /* borrowed */
    bw_points points;
    uint8_t *straight; /* [half] */
    int32_t *size;     /* [polygon] vertices; 0 if not a leaf */
    bw_half *fan;      /* [polygon] */
    bw_point *apex;    /* [cell] */
    int8_t *side;      /* [polygon] what bw_tessellation_side gives for its cell[0]; 0: not yet asked for */
    size_t *tet_begin; /* [tet + 1]: its cells, ascending */
    bw_cell *tet_cell;
    int32_t largest; /* vertices of the largest polygon */
    size_t inside;   /* cells coned from an added point */
    bw_half *ring;   /* scratch of bw_tessellation_triangles: 2 * largest */
} bw_tessellation;

/* Decides everything, after opening all tets. `cells` must outlive the tessellation. O(n) but for cells with very many polygons. */
bw_status bw_tessellate(bw_context *ctx, bw_tessellation *out, bw_cells *cells);
void bw_tessellation_clear(bw_context *ctx, bw_tessellation *tessellation);

/* The size[p] - 2 triangles of a polygon, in the sense of its half-edges. Not for two threads at a time. */
void bw_tessellation_triangles(const bw_tessellation *tessellation, bw_polygon polygon,
                               bw_cvertex (*triangle)[3]);

/* On which side of a polygon its cell[slot] is: the sign of the tet (point inside the cell, v0, v1, v2), v
 * being a triangle of the polygon in the sense of bw_tessellation_triangles. Exact. Opens the chart unless
 * the answer is known. */
bw_status bw_tessellation_side(bw_context *ctx, bw_tessellation *tessellation, bw_chart *chart,
                               bw_polygon polygon, int slot, int *side);

/* Number of tets of all cells. O(n). */
uint64_t bw_tessellation_count(const bw_tessellation *tessellation);

/* Tets of one cell, positive in the parametrization; exactly verified. `chart` is open on the cell's tet.
 * `tet` grows. */
typedef struct {
    bw_point (*tet)[4];
    size_t count, room;
    bw_cvertex (*triangle)[3]; /* scratch */
    size_t triangle_room;
} bw_cell_tets;
bw_status bw_tessellation_cell(bw_context *ctx, bw_tessellation *tessellation, bw_chart *chart, bw_cell cell,
                               bw_cell_tets *out);
void bw_cell_tets_clear(bw_context *ctx, bw_cell_tets *tets);

#endif
