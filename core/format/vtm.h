/* Writes a block complex for VTK and ParaView: complex.vtm, a multi-block data set, and one .vtu per kind of
 * element beside it.
 *
 *   blocks.vtu   a polyhedron per cell of the cell complex   block, tet (of the input)
 *   walls.vtu    a polygon per polygon of a patch            patch, blocks (2: those beside it, -1 outside),
 *                                                            distance (from the wall's origin), boundary,
 *                                                            flags (BW_PATCH_*)
 *   arcs.vtu     a polyline per arc, from its first node     arc, length, quarters, singular, boundary, t,
 *                                                            flags (BW_ARC_*)
 *   nodes.vtu    a vertex per node                           node, singular, boundary, flags (BW_NODE_*)
 *
 * Ids are those of the complex, as in blocks.json. Lengths and distances are in the map. The faces of a
 * polyhedron point outwards. Block k is what the threshold block = k leaves; a block's skin alone would not
 * fill it. The same complex gives the same bytes.
 */
#ifndef BW_FORMAT_VTM_H
#define BW_FORMAT_VTM_H

#include "complex/complex.h"

enum { BW_VTM_FILES = 5 };

typedef struct {
    const char *name; /* "blocks.vtu"; static */
    uint64_t bytes;
} bw_vtm_written;

/* Writes the files into the folder, each under another name first, complex.vtm last. position: [vertex of the
 * cell complex], at least those (the points of a tessellation begin with them). All tets are opened. On failure nothing of the
 * file at fault is left. O(n). */
bw_status bw_vtm_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex,
                       const double (*position)[3], const char *out_dir,
                       bw_vtm_written written[BW_VTM_FILES]);

#endif
