/* The exact seamless map: parameters as integers on one dyadic grid (what sanitize makes, MC 6).
 *
 * Invariants (bw_grid_map_check verifies all of them, exactly)
 *  1. parameter = value * 2^-exponent, and |value| <= BW_GRID_MAX.
 *  2. Every tet has positive volume.
 *  3. rotation[f] is that of the transition which carries the chart of facet_tet[f][0] to that of facet_tet[f][1]; it maps all three corners
 *     exactly, so its shift follows from any of them.
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

typedef struct {
    int32_t exponent;
    int64_t (*value)[4][3];    /* [tet][corner][axis] */
    bw_rotation *rotation;     /* [facet]; unused on the boundary */
    int8_t *align;             /* [facet]; the constant axis of a boundary facet; -1 inside */
    uint16_t *quarters;        /* [edge] */
    uint8_t *edge_flags;       /* [edge] BW_EDGE_* */
} bw_grid_map;

void bw_grid_map_clear(bw_context *ctx, bw_grid_map *map);
/* Transition from the chart of `from` across `facet`. */
bw_transition bw_grid_map_across(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_facet facet, bw_tet from);
/* Derives rotation, align, quarters and edge_flags from `value`, exactly, and verifies every invariant. Errors, each with the elements
 * at fault: BW_E_INVERTED, BW_E_NOT_SEAMLESS, BW_E_NOT_ALIGNED, BW_E_SINGULAR, BW_E_RANGE. */
bw_status bw_grid_map_derive(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map);
/* Sign of a tet's volume, exact. */
int bw_grid_tet_sign(const int64_t value[4][3]);

#endif
