/* blocks.json: nodes, arcs, patches and blocks of a complex (api/schemas/blocks.schema.json).
 *
 * One element a line, in the order and with the numbering of complex.h. Lengths come twice: in parameter
 * units as doubles, and in units of the exact grid (`..._grid`; integers, as text from 2^53 on). In a chain,
 * i means arc i from its first node to its second, -1 - i the same arc the other way round. The transition of
 * a patch carries the chart of its first block to that of its second: v[i] = sign(r[i]) u[|r[i]| - 1] +
 * shift[i]. Where the complex was quantized, every arc has its integer `quantized` and every block three `hexes`: its extents in
 * integers.
 *
 * The same input gives the same bytes. A member that goes away or changes its meaning raises
 * BW_BLOCKS_VERSION; a new one does not.
 */
#ifndef BW_FORMAT_BLOCKS_JSON_H
#define BW_FORMAT_BLOCKS_JSON_H

#include "complex/complex.h"

enum { BW_BLOCKS_VERSION = 1 };

/* The cell on side `which` (0 or 1: the place in patch_block) of a polygon of a patch. */
bw_cell bw_patch_cell(const bw_cells *cells, const bw_complex *complex, bw_patch patch, bw_polygon polygon,
                      int which);
/* From the chart of patch_block[patch][0] to that of patch_block[patch][1]; not for a boundary patch. */
bw_transition bw_patch_transition(const bw_cells *cells, const bw_complex *complex, bw_patch patch);

/* kind: "mc", "bc" or "serial". length: integer lengths of the arcs, or NULL. volume: of every block in the input's space; position: of every vertex of the cell
 * complex. bytes: size of the file. BW_E_IO. */
bw_status bw_blocks_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const char *kind,
                          const int64_t *length, const double *volume, const double (*position)[3], const char *path,
                          uint64_t *bytes);

#endif
