/* view.drc: what a viewer draws, as Draco meshes with ids, all on one lattice.
 *
 * Little-endian throughout:
 *
 *     0   8   magic "BWVIEW\r\n"
 *     8   4   u32 version (BW_VIEW_VERSION)
 *     12  4   u32 number of parts n
 *     16  24  f64 origin[3] of the lattice, in the input's space
 *     40  8   f64 step of the lattice: position = origin + step * integer, integers 0 .. 65535 on each axis
 *     48  n * 32  directory: char name[16] zero padded, u64 offset from the file's start, u64 length
 *     ...     the parts, one Draco stream each
 *
 * Parts (attribute 0: int32 position[3] on the lattice; attribute 1: int32 ids, constant over a triangle):
 *
 *     "walls"   mesh: every patch once
 *               ids: patch, block, block on the other side or -1, flags (BW_PATCH_*)
 *     "skins"   mesh: the sides of every block, seen from outside
 *               ids: block, patch, side 0..5
 *     "curves"  points in order: the arcs one after another, each from its first node to its last; a line
 *               joins consecutive points of the same arc
 *               ids: arc, flags (BW_ARC_*), quarter turns around it
 *
 * A triangle that has no area on the lattice is kept; one that repeats a vertex cannot occur. A change of
 * this layout, of the ids or of a flag's bit raises BW_VIEW_VERSION.
 */
#ifndef BW_FORMAT_VIEW_H
#define BW_FORMAT_VIEW_H

#include "complex/complex.h"
#include "format/tessellate.h"

enum { BW_VIEW_VERSION = 1, BW_VIEW_BITS = 16, BW_VIEW_HEADER = 48, BW_VIEW_ENTRY = 32 };

typedef struct {
    double origin[3], step;
} bw_view_lattice;

/* The lattice over the bounding box of the mesh's vertices that belong to tets. */
bw_view_lattice bw_view_lattice_of(const bw_tet_mesh *mesh);
void bw_view_quantize(const bw_view_lattice *lattice, const double position[3], int32_t out[3]);

/* Writes the file. position: of every vertex of the cell complex. bytes: its size. BW_E_IO, BW_E_MEMORY. */
bw_status bw_view_write(bw_context *ctx, bw_tessellation *tessellation, const bw_complex *complex,
                        const double (*position)[3], const char *path, uint64_t *bytes);

#endif
