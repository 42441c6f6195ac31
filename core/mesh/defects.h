/* Defects: tets that are inverted or degenerate in the parametrization, grouped by place.
 *
 * Invariants
 *  1. Tets are listed in the order of the mesh, and each is listed once.
 *  2. Two listed tets that share a vertex are in one region; regions are numbered by their lowest tet.
 */
#ifndef BW_MESH_DEFECTS_H
#define BW_MESH_DEFECTS_H

#include "mesh/tetmesh.h"

typedef struct {
    size_t count;  /* regions */
    size_t *first; /* [region + 1] into tet */
    bw_tet *tet;
} bw_defects;

/* Finds the tets whose volume in `value` is not positive, exactly. Takes no memory if there are none.
 * O(tets). */
bw_status bw_defects_init(bw_context *ctx, bw_defects *defects, const bw_tet_mesh *mesh,
                          const int64_t (*value)[4][3]);
void bw_defects_clear(bw_context *ctx, bw_defects *defects);

static inline size_t bw_defects_tets(const bw_defects *defects) {
    return defects->count ? defects->first[defects->count] : 0;
}
/* Where a region is in the model. */
void bw_defects_place(const bw_defects *defects, const bw_tet_mesh *mesh, size_t region, bw_region *out);
/* Adds a region and its tets to the error. */
void bw_defects_blame(bw_context *ctx, const bw_defects *defects, const bw_tet_mesh *mesh, size_t region);

#endif
