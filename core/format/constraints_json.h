/* constraints.json: what a parametrizer has to keep for its map to realize the quantization (api/schemas/constraints.schema.json; Q 6, equation 13).
 *
 * One difference a line (quantize/differential.h). Vertices and tets have their numbers in the input, counted from 0; the tets of a path follow each other across
 * common facets, and `vector` and `axes` are in the chart of the last one:
 *
 *     sum of weight * u(vertex) at `to`, in the last tet  -  T (the same at `from`, in the first tet)  =  vector     in the directions `axes`
 *
 * The same input gives the same bytes. A member that goes away or changes its meaning raises BW_CONSTRAINTS_VERSION; a new one does not.
 */
#ifndef BW_FORMAT_CONSTRAINTS_JSON_H
#define BW_FORMAT_CONSTRAINTS_JSON_H

#include "quantize/differential.h"

enum { BW_CONSTRAINTS_VERSION = 1 };

/* bytes: size of the file. BW_E_IO. */
bw_status bw_constraints_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_differential *differential,
                               const char *path, uint64_t *bytes);

#endif
