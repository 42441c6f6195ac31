/* From a solved frame to an integer-grid map: rounding to a dyadic grid, the refined mesh, exact verification. */
#ifndef BW_IGM_ASSEMBLE_H
#define BW_IGM_ASSEMBLE_H

#include "igm/frame.h"
#include "igm/igm.h"

/* Rounds x to the coarsest of a few grids on which every tet is positive, exactly, and makes the map. *valid is false, and *igm empty, if there is none, or if the map winds
 * around an edge more often than the input's: that, too, has only positive tets. `wound` ([tet of the frame], zero before)
 * then marks the tets around such edges. `input`: the mesh that the frame was made of. Errors: BW_E_CHECK if the map is right in
 * both and no integer-grid map nevertheless; BW_E_MEMORY. */
bw_status bw_igm_assemble(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, const double *x, bw_igm *igm, bool *valid, uint8_t *wound);

#endif
