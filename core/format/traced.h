/* traced.hexex: the cell complex as a tet mesh with exact rational parameters, its walls, and the features of
 * the input.
 *
 *     N, then N lines    x y z             the input's vertices come first, in their order
 *     M, then M lines    v0 v1 v2 v3  u0 v0 w0 ... u3 v3 w3
 *                                          parameters p/q in lowest terms, integers without /q
 *     W, then W lines    a b c distance    every triangle on a wall or on the boundary
 *     FV FE FF, then their lines           only if the input has features: cut where the mesh was cut
 *
 * A distance counts from the wall's origin, in the direction in which the wall started, in parameter units.
 * Tets are listed in the order of the input tets they come from. A tet that was not cut keeps its corners as
 * they were listed, and where the input lists negative tets, so does this file.
 */
#ifndef BW_FORMAT_TRACED_H
#define BW_FORMAT_TRACED_H

#include "format/tessellate.h"

typedef struct {
    uint64_t vertices, tets, walls, bytes;
} bw_traced_counts;

/* Writes the file. position: of all points (bw_points_positions). cell_volume (may be NULL): gets each cell's
 * volume in the input's space. BW_E_IO; BW_E_CHECK if a tet is not positive or a feature is none of the
 * mesh's edges or facets. O(tets). */
bw_status bw_traced_write(bw_context *ctx, bw_tessellation *tessellation, const double (*position)[3],
                          const char *path, bw_traced_counts *counts, double *cell_volume);

#endif
