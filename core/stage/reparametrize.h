/* Stage reparametrize: a map that takes the integer lengths of a quantization, or the decision to do without one (Q 6, MC 7.1).
 *
 * Two routes. Quality: an integer-grid map of the tet mesh, with as little distortion as may be (igm/parametrize.h); verified exactly. Guaranteed: no map of the mesh
 * is needed, hexes are cut out of the blocks themselves (igm/blockwise.h, hex/blockfill.h); it takes positive lengths, and then always answers.
 *
 * Where the quality route finds no map and lengths are not all positive, another quantization is asked for: first one a little larger of the same kind, then a positive
 * one, which ends in one of the routes in any case. The report says which, why, and how many hexes it costs.
 */
#ifndef BW_STAGE_REPARAMETRIZE_H
#define BW_STAGE_REPARAMETRIZE_H

#include "base/kinds.h"
#include "format/report_json.h"
#include "igm/igm.h"

/* Another quantization of the same complex: of positive lengths, if `positive` is set; of about target_hexes hexes, if that is not 0, else of the size that the job asked
 * for. *length is owned by the caller; fills report->quantization. */
typedef bw_status bw_requantize(bw_context *ctx, void *user, bool positive, uint64_t target_hexes, int64_t **length, bw_report *report);

typedef struct {
    bw_igm_route route;
    int max_work;       /* for the map of one quantization: see bw_parametrize */
    int32_t subdivide;  /* what extract will make of these lengths: a mesh with more than max_hexes is refused before its map is made */
    uint64_t max_hexes;
    bw_requantize *requantize;
    void *user;
} bw_reparametrize_options;

/* (*length)[arc] may be replaced. *mapped: *igm is the map; else it is empty, and lengths are positive: the guaranteed route. Fills report->reparametrize. Requires
 * report->quantization. Errors: BW_E_LIMIT with the number of hexes if there would be more than max_hexes; BW_E_ALGORITHM if the route quality alone is wanted and fails; BW_E_CHECK;
 * BW_E_MEMORY, BW_E_CANCELLED; those of requantize. */
bw_status bw_reparametrize(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_reparametrize_options *options, int64_t **length,
                           bw_igm *igm, bool *mapped, bw_report *report);

#endif
