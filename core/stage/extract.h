/* Stage extract: the hex mesh of an integer-grid map, checked. */
#ifndef BW_STAGE_EXTRACT_H
#define BW_STAGE_EXTRACT_H

#include "format/report_json.h"
#include "hex/hexmesh.h"
#include "igm/igm.h"

typedef struct {
    int32_t subdivide;  /* hexes along the edge of a unit cube: at least 1 */
    uint64_t max_hexes;
} bw_extract_options;

/* Extracts *hex (owned by the caller, empty on failure) and verifies it: conforming and manifold, of the Euler characteristic and the number of components of the map's
 * mesh, as many hexes in each block as the quantization says. Fills report->extract. Errors: BW_E_LIMIT with the number of hexes if there are more than
 * max_hexes; BW_E_RANGE; BW_E_CHECK; BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_extract(bw_context *ctx, const bw_igm *igm, const bw_extract_options *options, bw_hex_mesh *hex, bw_report *report);

#endif
