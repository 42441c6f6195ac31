/* The integer-grid map of a frame: a start by least squares, untangling, and refinement where that is not enough (Q 6).
 *
 *   1. Least squares: Jacobians near those of the input's map, scaled to the number of hexes; the weights of inverted tets are doubled and it is solved again (stiffening).
 *   2. Untangling by a foldover-free energy (solve/untangle.h).
 *   3. The same energy, as a barrier, makes the shapes better without losing validity.
 *   4. Values are rounded to a dyadic grid: unknowns only, so that transitions and constants stay exact; the grid is made finer if that inverts a tet.
 *   5. What stays inverted is split (split.h), and 2 is done again. A map may also be without inverted tets and wind around an edge twice, where all vertices around it are held:
 *      these edges are split too, and it starts anew.
 *
 * In 1 and 2 shapes are measured against the input's map *with every block stretched to its integers* (one without extent as thick as a quarter of a hex), in 3 against the input's
 * map. A coarse quantization makes a short block of the input as long as its neighbours. Measured against the input itself every tet there is far from its shape, and the
 * nearest way out is to fold; measured against the stretched block it is at rest. If it fails the start is made near the stretched blocks, too.
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
    double work;               /* steps, of least squares and of Newton's method alike; on a refined mesh they count for more */
    bool limited;              /* max_work ended it */
    size_t splits;             /* edges split */
    size_t tets;               /* at the end */
    double distortion_mean, distortion_max; /* of the map against the input's, scaled: the energy of solve/distortion.h over 5; 1 at best */
    double seconds_fit, seconds_untangle, seconds_verify;
} bw_parametrize_report;

/* Makes the map from a frame, which is refined where needed. `max_work`: steps, as report->work counts them. If report->valid is false, *igm is empty and that is no error. Errors: BW_E_MEMORY, BW_E_CANCELLED, BW_E_CHECK if
 * the map does not pass bw_igm_check although all tets are positive. `input`: the mesh that the frame was made of, for its features. */
bw_status bw_parametrize(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame, int max_work, bw_igm *igm, bw_parametrize_report *report);

#endif
