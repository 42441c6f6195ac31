/* sizes.svg: the table over sizes of a quantized job (report.quantization.sweep) as four charts over scale: hexes, objective, zero arcs, distortion.
 *
 * Scales are equally spaced in ascending order, each with its number under it, so that 0 (the coarsest) has a place. Hexes are on a logarithmic axis. A
 * filled point is a proven optimum, a hollow one is not. The same table gives the same bytes.
 */
#ifndef BW_FORMAT_SIZES_SVG_H
#define BW_FORMAT_SIZES_SVG_H

#include "format/report_json.h"

/* bytes: size of the file. BW_E_IO. */
bw_status bw_sizes_write(bw_context *ctx, const bw_report *report, const char *path, uint64_t *bytes);

#endif
