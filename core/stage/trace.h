/* Stage trace: the walls of the motorcycle complex or the base complex (MC 5.2, Algorithm 2), on the convex-cell complex. The walls of the
 * motorcycle complex burn all at once, or serially and sparsely (MC 4.2, last remark; mesh/fire_serial.h). */
#ifndef BW_STAGE_TRACE_H
#define BW_STAGE_TRACE_H

#include "base/kinds.h"
#include "mesh/cells.h"

/* Burns walls from all singular edges: cuts the cells that the fire crosses and flags the polygons it burns BW_WALL, with
 * their distance from the origin. Deterministic: ties are broken by age in the queue.
 * `cells` is freshly made by bw_cells_init. Errors: BW_E_LIMIT when cuts add more than
 * max_cells cells, BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_trace(bw_context *ctx, bw_cells *cells, bw_complex_kind kind, uint64_t max_cells);

#endif
