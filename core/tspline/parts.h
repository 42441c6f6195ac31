/* What the sources of the T-mesh share; bw_tmesh_init calls them in this order. */
#ifndef BW_TSPLINE_PARTS_H
#define BW_TSPLINE_PARTS_H

#include "tspline/tmesh.h"

/* thickness.c: thickness of each extraordinary arc. */
bw_status bw_tmesh_find_thickness(bw_context *ctx, bw_tmesh *mesh);
/* cells.c: cuts of arcs, and all cells. */
bw_status bw_tmesh_cut(bw_context *ctx, bw_tmesh *mesh);
/* vertices.c: points, vertices, corners of cells, T-joints. */
bw_status bw_tmesh_number(bw_context *ctx, bw_tmesh *mesh);
/* faces.c */
bw_status bw_tmesh_join(bw_context *ctx, bw_tmesh *mesh);

/* Both ends of a rib, in knots. */
static inline void bw_trib_ends(const bw_atlas *atlas, const bw_rib *rib, int64_t low[3], int64_t high[3]) {
    for (int k = 0; k < 3; k++) {
        low[k] = BW_TMESH_UNIT * atlas->place[rib->place[0]].at[k].q;
        high[k] = BW_TMESH_UNIT * atlas->place[rib->place[1]].at[k].q;
    }
}

/* Whether a point is in a patch as its block on side `slot` sees it. */
static inline bool bw_tpatch_has(const bw_atlas *atlas, bw_patch patch, int slot, const int64_t at[3]) {
    const bw_box *box = &atlas->box[patch][slot];
    for (int k = 0; k < 3; k++)
        if (at[k] < BW_TMESH_UNIT * box->low[k].q || at[k] > BW_TMESH_UNIT * box->high[k].q) return false;
    return true;
}

#endif
