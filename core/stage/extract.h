/* Stage extract: the hex mesh of an integer-grid map, or of blocks that were given positive lengths; labelled, and checked. */
#ifndef BW_STAGE_EXTRACT_H
#define BW_STAGE_EXTRACT_H

#include "complex/complex.h"
#include "format/report_json.h"
#include "hex/hexmesh.h"
#include "igm/igm.h"

typedef struct {
    int32_t subdivide;  /* hexes along the edge of a unit cube: at least 1 */
    uint64_t max_hexes;
} bw_extract_options;

typedef struct {
    const bw_cells *cells;
    const bw_complex *complex;
    const int64_t *length; /* [arc]; without a map all positive */
    const bw_igm *igm;     /* NULL: none */
} bw_extract_input; /* all borrowed */

/* From so many hexes along a unit on, no two edges or faces have the same vertices, whatever is glued to itself. */
enum { BW_SUBDIVIDE_SIMPLE = 3 };

/* Makes *hex (owned by the caller, empty on failure): the preimage of the integer grid of the map, or without one block by block (hex/blockfill.h).
 *
 * Verifies: as many hexes as the quantization says, block by block; conforming and manifold; of the Euler characteristic and the number of components of the input. A
 * quantization may be valid and yet close up within one or two hexes, as the coarsest of a ring: then two faces have the same vertices, which no file of a hex mesh
 * can tell apart, and the mesh is made with more hexes along a unit, BW_SUBDIVIDE_SIMPLE at most.
 *
 * Fills report->extract and report->base_complex.after. Errors: BW_E_LIMIT with the number of hexes if there are more than max_hexes; BW_E_RANGE; BW_E_CHECK; BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_extract(bw_context *ctx, const bw_extract_input *in, const bw_extract_options *options, bw_hex_mesh *hex, bw_report *report);

/* Gives the hexes of an input of hexahedra their blocks and places in them, and what their vertices lie on (hex/trivial.h); proves it. Fills report->base_complex.before, and report->extract, which
 * bw_extract overwrites. BW_E_CHECK, BW_E_MEMORY. */
bw_status bw_extract_labels(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_hex_mesh *source, bw_report *report);

#endif
