/* The exact seamless map: parameters as integers on one dyadic grid (what sanitize makes, MC 6).
 *
 * Invariants (bw_grid_map_check verifies all of them, exactly)
 *  1. parameter = value * 2^-exponent, and |value| <= BW_GRID_MAX.
 *  2. Every tet has positive volume.
 *  3. The transition across a facet maps all three corners exactly. Of it only the rotation is kept, from the chart of facet_tet[f][0] to
 *     that of facet_tet[f][1], for the shift follows from any corner; and whether it is the identity, as it mostly is.
 *  4. A boundary facet is constant in axis align[f] (chart of facet_tet[f][0]).
 *  5. quarters[e] is the parametric angle around edge e in quarter turns; an edge whose angle is not the regular one
 *     (4 inside, 2 on the boundary) is singular and constant in two axes.
 *  6. Feature facets of the mesh are constant in an axis, feature edges in two.
 */
#ifndef BW_MESH_GRIDMAP_H
#define BW_MESH_GRIDMAP_H

#include "exact/rotation.h"
#include "mesh/tetmesh.h"

#define BW_GRID_MAX ((int64_t)1 << 46)

enum { BW_EDGE_BOUNDARY = 1, BW_EDGE_SINGULAR = 2, BW_EDGE_FEATURE = 4 };

enum { BW_TURN_SHIFTED = 32 };

typedef struct {
    int32_t exponent;
    int64_t (*value)[4][3];    /* [tet][corner][axis] */
    uint8_t *turn;             /* [facet]: rotation | BW_TURN_SHIFTED if the shift is not zero; unused on the boundary */
    int8_t *align;             /* [facet]; the constant axis of a boundary facet; -1 inside */
    uint16_t *quarters;        /* [edge] */
    uint8_t *edge_flags;       /* [edge] BW_EDGE_* */
} bw_grid_map;

void bw_grid_map_clear(bw_context *ctx, bw_grid_map *map);
/* Whether the tets beside an inner facet have the same chart: the transition is the identity. */
static inline bool bw_grid_map_same_chart(const bw_grid_map *map, bw_facet facet) { return map->turn[facet] == 0; }
/* Rotation from the chart of facet_tet[facet][0] to that of facet_tet[facet][1]. */
static inline bw_rotation bw_grid_map_rotation(const bw_grid_map *map, bw_facet facet) {
    return (bw_rotation)(map->turn[facet] & ~BW_TURN_SHIFTED);
}
/* Transition from the chart of `from` across `facet`. */
bw_transition bw_grid_map_across(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_facet facet, bw_tet from);
/* Derives turn, align, quarters and edge_flags from `value`, exactly, and verifies every invariant. Errors, each with the elements
 * at fault: BW_E_INVERTED, BW_E_NOT_SEAMLESS, BW_E_NOT_ALIGNED, BW_E_SINGULAR, BW_E_RANGE. */
bw_status bw_grid_map_derive(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map);
/* Sign of a tet's volume, exact. */
int bw_grid_tet_sign(const int64_t value[4][3]);

#endif
