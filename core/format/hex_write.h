/* Writers of hex meshes, one file each (hex_<format>.c): what bw_hex_mesh says, in the words of every format.
 *
 * All of them
 *  - write positions so that they read back as the same doubles, vertices and hexes in the order of the mesh;
 *  - permute corners to the format's order, in which a positive hex is positive too, and list quads of the boundary counter-clockwise seen from outside;
 *  - name blocks by their index in blocks.json; where a format's tags begin at 1, tag = block + 1. What is told of a hex whose block is not known stands at each format;
 *  - give the same bytes for the same mesh; *bytes (may be NULL) is the file's size; the file is created or emptied first.
 * Errors: BW_E_IO, BW_E_MEMORY, BW_E_CANCELLED.
 */
#ifndef BW_FORMAT_HEX_WRITE_H
#define BW_FORMAT_HEX_WRITE_H

#include "base/kinds.h"
#include "hex/skin.h"

/* Corners in the order of VTK, Medit, Gmsh, Abaqus and CGNS: around the low face, then around the high one. */
extern const uint8_t bw_hex_ring[8];

/* Scaled Jacobian of a hex: the least, over its corners, of the volume spanned by the three edges there, made unit vectors. */
double bw_hex_write_jacobian(const bw_hex_mesh *mesh, size_t hex);

/* Medit. References: of a hex its block + 1 (0: not known), of a boundary quad its surface + 1, of an edge (the irregular ones) how many hexes it has, of a vertex what holds it
 * (bw_hex_mesh.held: 0 point ... 3 nothing). Corners and RequiredVertices are the points; Ridges are the edges of the boundary. (RequiredEdges would say more, but meshio refuses them.) */
bw_status bw_hex_write_medit(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* Legacy VTK, ASCII. Cell arrays block (-1: not known), ijk, scaled_jacobian; point array held. */
bw_status bw_hex_write_vtk(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* VTK's XML form, arrays as of bw_hex_write_vtk, appended raw. */
bw_status bw_hex_write_vtu(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* Gmsh 4.1, ASCII. Physical groups "block N", "surface N", "inner edges of N hexes", "boundary edges of N hexes", "points"; hexes without block are in "no block",
 * tagged after the last block. Tags of hexes are their index + 1, in the order of blocks. */
bw_status bw_hex_write_msh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* OpenVolumeMesh, text form, with properties block (of cells; -1: not known) and held (of vertices). */
bw_status bw_hex_write_ovm(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* Abaqus. C3D8 elements in the set HEXES; ELSET BLOCK_N (BLOCK_NONE: not known), NSET and SURFACE SURFACE_N. */
bw_status bw_hex_write_inp(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* CGNS, as an ADF file: a structured zone "Block_N" per block; wherever two blocks meet, GridConnectivity1to1 on rectangles as large as can be, in both; conditions BCWall
 * named "Surface_N" on sides of the boundary, with a family each. If a hex has no place in a block that fills its box, all hexes are one unstructured zone "Hexes",
 * with sections of quads and conditions for the surfaces. Also BW_E_LIMIT for more than 2^31 coordinates, connections or the like: the library counts in 32 bits. */
bw_status bw_hex_write_cgns(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

/* The compact form: format/hex_bwh.h. */

typedef struct {
    const char *name; /* of the format, and the end of its file's name */
    bw_status (*write)(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);
} bw_hex_format_info;

extern const bw_hex_format_info bw_hex_formats[BW_HEX_FORMAT_COUNT];
bw_status bw_hex_format_from_name(const char *name, bw_hex_format *format); /* BW_E_USAGE (not recorded) if there is none */

#endif
