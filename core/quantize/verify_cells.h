/* The contracted complex: blocks cut along all planes that matter, and what touches identified.
 *
 * A plane of a block matters if some block ends in it: planes are carried on through contacts from the ends of all blocks. Between two such planes nothing changes, so however
 * long the lengths are, one cell does. A block without extent along an axis has one plane there and no cell.
 *
 * Elements of a block with n[k] planes along axis k; those of other blocks follow on. Identified are elements of different blocks (and of one with itself), by
 * disjoint sets:
 *     point    n[0] n[1] n[2]
 *     edge     along axis a: one less of them along a
 *     square   across axis a: one less along both other axes
 *     cube     one less along all
 *     corner   of a square, 4 each: bit 0 at the high end of axis a + 1, bit 1 of axis a + 2
 *     rim      edge of a square, 4 each: 2 * (0 along axis a + 1 | 1 along a + 2) + (0 at the low | 1 at the high end of the other axis)
 * Corners and rims are joined only from square to square and around cubes, so they tell what hangs together by hexes; points and edges also what merely touches.
 */
#ifndef BW_QUANTIZE_VERIFY_CELLS_H
#define BW_QUANTIZE_VERIFY_CELLS_H

#include "quantize/verify_parts.h"

typedef struct {
    bw_verifier *v;
    size_t *plane_begin; /* [3 * block + axis] */
    int64_t *plane;      /* ascending coordinates, q */
    size_t *point_base;  /* [block + 1] */
    size_t *edge_base;   /* [3 * block + axis] and the end */
    size_t *square_base;
    size_t *cube_base;   /* [block + 1] */
    size_t points, edges, squares, cubes;
    int32_t *point, *edge, *square, *corner, *rim; /* parents; after bw_cells_join the roots */
} bw_cell_grid;

/* Cuts and glues; sets v->too_fine and stops where that would take too many elements. Close it in any case. */
bw_status bw_grid_open(bw_verifier *v, bw_cell_grid *g);
void bw_grid_close(bw_cell_grid *g);

static inline size_t bw_grid_planes(const bw_cell_grid *g, size_t block, int axis) {
    return g->plane_begin[3 * block + (size_t)axis + 1] - g->plane_begin[3 * block + (size_t)axis];
}
static inline const int64_t *bw_grid_plane(const bw_cell_grid *g, size_t block, int axis) {
    return &g->plane[g->plane_begin[3 * block + (size_t)axis]];
}
/* Number of a plane of a block; BW_NONE if there is none at that coordinate. O(log n). */
int bw_grid_find_plane(const bw_cell_grid *g, size_t block, int axis, int64_t at);

/* Elements by the numbers of their lowest planes. */
size_t bw_grid_point(const bw_cell_grid *g, size_t block, const int at[3]);
size_t bw_grid_edge(const bw_cell_grid *g, size_t block, int axis, const int at[3]);
size_t bw_grid_square(const bw_cell_grid *g, size_t block, int axis, const int at[3]);

/* A contact in numbers of planes: along lateral axis i of the first block, count[i] planes, which are in the second block along axis to[i] those
 * of index[1][i]. */
typedef struct {
    int axis[2], to[2]; /* lateral axes */
    bool turned[2];     /* they run against each other */
    int first[2], last[2]; /* planes of the first block */
    int start[2];       /* plane of the second block that is first[i] */
    int normal[2], level[2]; /* of the first and the second block: axis and plane of the contact */
} bw_grid_contact;

/* Requires a contact between blocks (of a boundary contact only the first block's part is set). */
bw_status bw_grid_contact_open(const bw_cell_grid *g, const bw_contact *c, bw_grid_contact *out);
/* Squares of a contact: lowest planes in the first block, for i in first[0]..last[0] - 1 and j likewise. */
static inline void bw_grid_contact_at(const bw_grid_contact *c, int i, int j, int at[3]) {
    at[c->normal[0]] = c->level[0], at[c->axis[0]] = i, at[c->axis[1]] = j;
}

#endif
