/* The integer-grid map of a frame: a start by least squares, untangling, and refinement where that is not enough (Q 6).
 *
 *   1. Least squares: Jacobians near those of the input's map, scaled to the number of hexes; the weights of inverted tets are doubled and it is solved again (stiffening).
 *   2. Untangling by a foldover-free energy (solve/untangle.h), which then, as a barrier, makes the shapes better without losing validity.
 *   3. What is still inverted is split (split.h), and 2 is done again. A map may also be without inverted tets and wind around an edge twice, where all vertices around it are held:
 *      these edges are split too, and it starts anew.
 *   4. Values are rounded to a dyadic grid: unknowns only, so that transitions and constants stay exact; the grid is made finer if that inverts a tet.
 *
 * Shapes are measured against the input's map; if that fails, against the tets in space, which may be less distorted; then
 * the constants are moved from those of the input's map to the integers in small steps.
 */
#ifndef BW_IGM_PARAMETRIZE_H
#define BW_IGM_PARAMETRIZE_H

#include "igm/frame.h"
#include "igm/igm.h"

typedef struct {
    bool valid;                /* every tet is positive, exactly; else there is no map */
    size_t inverted_fit;       /* tets: after the first least squares, */
    size_t inverted_stiffened; /* after stiffening, */
    size_t inverted_untangled; /* after untangling, */
    size_t inverted;           /* and at the end */
    int stiffenings, iterations, restarts, refinements;
    size_t splits;             /* edges split */
    size_t tets;               /* at the end */
    double distortion_mean, distortion_max; /* of the map against the input's, scaled: the energy of solve/distortion.h over 5; 1 at best */
    double seconds_fit, seconds_untangle, seconds_verify;
} bw_parametrize_report;

/* Makes the map from a frame, which is refined where needed. If report->valid is false, *igm is empty and that is no error. Errors: BW_E_MEMORY, BW_E_CANCELLED, BW_E_CHECK if
 * the map does not pass bw_igm_check although all tets are positive. `input`: the mesh that the frame was made of, for its features. */
bw_status bw_parametrize(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame, bw_igm *igm, bw_parametrize_report *report);

#endif
