/* Hexahedral mesh as the preimage of the integer grid of an integer-grid map, exactly (Q 3.2, MC 7.1).
 *
 * A lattice point belongs to the simplex of the tet mesh in whose interior it lies, and that simplex to the lowest tet around it. So each vertex and, through its centre,
 * each hex is found once, in the order of tets and, within one, of coordinates: numbers do not depend on threads.
 *
 * The corners of a hex that lie outside the tet of its centre are found by visiting the tets that its open cube meets, each across a facet that meets it. Inside the
 * open cube the map is regular, so whatever way leads to a tet, the composed transition is the same. A corner that is still missing lies beyond some facet of every tet visited that
 * a straight way to it from a general position would cross, so only those facets are followed.
 *
 * Axes of a hex are those of the chart of its tet.
 */
#ifndef BW_HEX_EXTRACT_H
#define BW_HEX_EXTRACT_H

#include "hex/hexmesh.h"
#include "igm/igm.h"

/* Where each hex is in the map. */
typedef struct {
    bw_tet *tet;        /* [hex] that of its centre */
    int64_t (*low)[3];  /* [hex] corner 0 in the chart of that tet, in hexes */
} bw_hex_origin;

void bw_hex_origin_clear(bw_context *ctx, bw_hex_origin *origin);

/* Extracts hexes of 1/subdivide of a unit; block is BW_NONE throughout. Requires a map that bw_igm_check accepts. Errors: BW_E_LIMIT naming the number of hexes if there
 * are more than max_hexes; BW_E_RANGE if they are finer than the grid; BW_E_CHECK if they do not fill the map; BW_E_MEMORY, BW_E_CANCELLED.
 * O(tets + hexes). */
bw_status bw_hex_extract(bw_context *ctx, const bw_igm *igm, int32_t subdivide, uint64_t max_hexes, bw_hex_mesh *mesh, bw_hex_origin *origin);

#endif
