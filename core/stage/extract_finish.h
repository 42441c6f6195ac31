/* Stage extract, second part: geometric optimization of the hex mesh, and its quality. */
#ifndef BW_STAGE_EXTRACT_FINISH_H
#define BW_STAGE_EXTRACT_FINISH_H

#include "format/report_json.h"
#include "hex/hexmesh.h"

/* `mesh`: the one that hex->carrier refers to, edge_flags: BW_EDGE_* of its edges (bw_grid_map). Moves vertices of *hex if `smooth`, never to a worse mesh (hex/smooth.h), measures
 * it, and fills report->hex_quality. After a failure *hex is a valid mesh, smoothed or not. Errors: BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_extract_finish(bw_context *ctx, const bw_tet_mesh *mesh, const uint8_t *edge_flags, bool smooth, bw_hex_mesh *hex, bw_report *report);

#endif
