/* Hexahedral mesh, and what each of its vertices lies on.
 *
 * Corners are numbered by bits, like those of a block (complex.h): bit k set is the high end of axis k. A hex is positive if axes 0, 1, 2 are right-handed in space.
 *
 *          6-------7
 *         /|      /|        2
 *        4-------5 |        | 1
 *        | 2-----|-3        |/
 *        |/      |/         +--- 0
 *        0-------1
 *
 * Faces are numbered 2 * axis + (0 low | 1 high), edges 4 * axis + bits, as in complex.h. File formats number corners otherwise; their writers permute.
 *
 * Invariants (bw_hex_mesh_check verifies 1 to 4)
 *  1. Indices are in range, no hex repeats a vertex, every vertex is in a hex.
 *  2. Conforming and manifold: no quad is in more than two hexes, hexes that share one see it in opposite senses; the link of every vertex is a sphere, or a
 *     disk on the boundary.
 *  3. A vertex on a quad of one hex only is held by the surface, a curve or a point; others only by features inside.
 *  4. Either no hex has a block, or all have one and those of each fill a box: axes 0, 1, 2 of a hex are those of its block, ijk counts from 0, each
 *     place is taken once, and hexes next to each other in the box share the face between them. (Corners 0..7 of hex (i, j, k) are the grid points (i, j, k) + bits.)
 *  5. Vertices and hexes are numbered the same at any thread count.
 */
#ifndef BW_HEX_HEXMESH_H
#define BW_HEX_HEXMESH_H

#include "base/context.h"
#include "base/index.h"

typedef int32_t bw_hvertex; /* of a hex mesh */
typedef int32_t bw_hex;

/* What a vertex lies on, by dimension: how many directions it may move in. */
enum {
    BW_HELD_POINT,   /* a feature vertex, or a point where curves end or meet */
    BW_HELD_CURVE,   /* a singular or feature edge of the boundary, or a feature edge inside */
    BW_HELD_SURFACE, /* the boundary, or a feature facet inside */
    BW_HELD_NOT
};

typedef struct {
    size_t vertex_count, hex_count;
    double (*position)[3];  /* [vertex][xyz], in the input's space and unit */
    uint8_t *held;          /* [vertex] BW_HELD_* */
    int32_t *carrier;       /* [vertex] of the tet mesh that this was made from (bw_igm.mesh, or the job's): the vertex, edge or facet for BW_HELD_POINT, _CURVE,
                               _SURFACE, a tet that holds it for _NOT */
    bw_hvertex (*hex)[8];   /* [hex][corner] */
    bw_block *block;        /* [hex]; BW_NONE: not known */
    int32_t (*ijk)[3];      /* [hex] place in its block, in hexes (finer than its integer lengths if subdivided) */
    int32_t subdivide;      /* edge of a unit cube of the integer-grid map, in hexes */
} bw_hex_mesh;

void bw_hex_mesh_clear(bw_context *ctx, bw_hex_mesh *mesh);
/* BW_E_CHECK naming the first violation; BW_E_MEMORY, BW_E_CANCELLED. O(n log n). */
bw_status bw_hex_mesh_check(bw_context *ctx, const bw_hex_mesh *mesh);
/* Invariants 1 and 2 of what a file says; vertices may be in no hex, indices are in range, `held` is not looked at. Errors, with the hexes at fault: BW_E_DUPLICATE
 * (a vertex or a hex twice), BW_E_NONMANIFOLD, BW_E_INVERTED (neighbours that list their corners in opposite senses). O(n log n). */
bw_status bw_hex_mesh_check_input(bw_context *ctx, const bw_hex_mesh *mesh);

#endif
