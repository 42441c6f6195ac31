/* What vertices of a hex mesh lie on, by the simplex of the tet mesh in whose interior they are (bw_hex_mesh.held, .carrier).
 *
 * A facet holds if it is on the boundary or a feature. An edge is a curve if it is a feature, if it is singular and on the boundary, or if other than none or two
 * of its facets hold: there surfaces meet or end. A vertex is a point if it is a feature, or if curves end or meet there or a curve changes its angle.
 */
#ifndef BW_HEX_CARRIER_H
#define BW_HEX_CARRIER_H

#include "hex/hexmesh.h"
#include "igm/igm.h"
#include "mesh/cells.h" /* bw_carrier */

typedef struct {
    uint8_t *facet;      /* [facet] BW_HELD_SURFACE or _NOT */
    uint8_t *edge;       /* [edge] BW_HELD_CURVE, _SURFACE or _NOT */
    uint8_t *vertex;     /* [vertex] BW_HELD_* */
    int32_t *edge_on;    /* [edge] its lowest facet that holds, where it is no curve */
    int32_t *vertex_on;  /* [vertex] of its curves the lowest, else of its facets that hold (a point is its own) */
    bw_tet *edge_tet;    /* [edge] its lowest tet */
    bw_tet *vertex_tet;  /* [vertex] likewise; BW_NONE if no tet uses it */
} bw_carriers;

bw_status bw_carriers_init(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_carriers *carriers);
void bw_carriers_clear(bw_context *ctx, bw_carriers *carriers);

/* What bw_hex_mesh says of a vertex. */
typedef struct {
    int32_t carrier;
    uint8_t held; /* BW_HELD_* */
} bw_hold;

/* Of a point in the interior of a simplex (of a vertex: itself), `within` being a tet that has it. */
static inline bw_hold bw_carriers_hold(const bw_carriers *c, bw_carrier kind, int32_t simplex, bw_tet within) {
    bw_hold hold = {within, BW_HELD_NOT};
    if (kind == BW_IN_FACET) hold = (bw_hold){simplex, c->facet[simplex]};
    if (kind == BW_IN_EDGE) hold = (bw_hold){c->edge[simplex] == BW_HELD_CURVE ? simplex : c->edge_on[simplex], c->edge[simplex]};
    if (kind == BW_IN_VERTEX) hold = (bw_hold){c->vertex[simplex] == BW_HELD_POINT ? simplex : c->vertex_on[simplex], c->vertex[simplex]};
    if (hold.held == BW_HELD_NOT) hold.carrier = within;
    return hold;
}

#endif
