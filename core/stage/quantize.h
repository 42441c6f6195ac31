/* Stage quantize: integer lengths of all arcs, valid, with a proof of how good they are (Q 3 to 5). */
#ifndef BW_STAGE_QUANTIZE_H
#define BW_STAGE_QUANTIZE_H

#include "base/kinds.h"
#include "complex/complex.h"
#include "format/report_json.h"
#include "quantize/verify.h"

enum { BW_SCALES_MAX = BW_REPORT_SWEEP };

/* As bw_verify. */
typedef bw_status bw_quantize_verifier(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *verdict);

typedef struct {
    bw_quantize_range range; /* not BW_QUANTIZE_NONE */
    double scale;            /* arcs are to be as long as scale times their input length; 0: the coarsest there is */
    bool fewest_hexes;       /* instead of a scale: as few hexes as there can be */
    bool rounding;           /* report what rounding makes of the size found, and its own coarsest size (quantize/rounding.h) */
    uint64_t target_hexes;   /* not 0: take the scale that comes nearest to this number of hexes instead */
    double seconds;          /* limit of the search for each size */
    size_t scale_count;      /* sizes for the table of the report */
    double scales[BW_SCALES_MAX];
    bw_quantize_verifier *verifier; /* NULL: bw_verify. Tests put one here that refuses */
} bw_quantize_options;

/* Finds the quantization: (*length)[arc], owned by the caller (bw_free), NULL on failure, and fills report->quantization and report->base_complex.planned. The same input gives the same lengths, unless
 * the time limit cuts the search (status gap or heuristic).
 *
 * Every result, those of the table of sizes too, is verified by contraction (quantize/verify.h), which knows nothing of the constraints that it was found with.
 * One that is refused, or too large to be verified, is replaced by that of the next narrower range (`fallback` of the report, and a line in the log);
 * positive lengths are always verified.
 *
 * Errors: BW_E_RANGE if arcs would be longer than 2^40 or there would be more than 2^53 hexes; BW_E_ALGORITHM; BW_E_CHECK if a positive result
 * is refused; BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_quantize(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_quantize_options *options,
                      int64_t **length, bw_report *report);

#endif
