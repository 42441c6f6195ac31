/* T-mesh: a block complex refined around its extraordinary arcs, so that solid T-splines can be set up on it (MC 7.2, Fig. 15).
 *
 * An arc is extraordinary if the cubes around it are not part of a regular grid: inside, other than four quarter turns; on the boundary, three or more. (A convex edge
 * of the boundary, one quarter turn, is singular, but a spline ends there as it does at any corner of a box.)
 *
 * The paper shows the refinement in a picture and names the rules of others for it. What is taken here follows from local knot vectors: a cubic function reaches two knot
 * intervals beyond its vertex. So every extraordinary arc gets a tube of cells of its own, with an interval between it and the rest of each block around it:
 *
 *      +------------------+            +------------------+        cross section of an arc. A block that has the arc inside a side (half a
 *      |                  |            |                  |        turn) gets two cells of the tube.
 *      |                  |            |                  |
 *      |                  |    ->      |                  |        Around the arc the tube is a regular grid: one cell per quarter turn, walls
 *      |                  |            +-----+------------+        between them, and all are cut alike along the arc: at nodes, and where
 *      |                  |            |tube |            |        tubes meet, which share a cube there. The rest of the block is filled with
 *      arc----------------+            arc---+------------+        boxes, few and large; it meets the tube as it likes
 *
 * So no T-joint is on an extraordinary arc, or on a wall that leaves it within the tube, and nothing is continued from block to block, which would lead to the base complex. (Walls
 * beside tubes that run through their blocks were tried: blocks of the motorcycle complex have many tubes, and 300 added cells became 1 500.) That functions from afar overlap an
 * arc, and conditions for linear independence, are matters of the space that is chosen (MC 7.2 refers to others for them): nothing is refined for them.
 *
 * Coordinates are knots: integers, 1 / BW_TMESH_UNIT of a unit of the lengths that the T-mesh was made with: grid units of the map, or hexes. A cell's knot
 * intervals are its extents. Arcs that hang together have tubes of one thickness: a quarter of the shortest distance of nodes along an axis of a block that has one of them.
 *
 * Invariants (bw_tmesh_check verifies them against the complex, and by nothing that made the T-mesh)
 *  1. The cells of a block fill its box without overlap.
 *  2. Each side of a cell is tiled by its faces; a face is the same rectangle in both cells, across the walls too.
 *  3. At each extraordinary arc there is one cell per quarter turn, and all of them are cut at the same places along the arc.
 *  4. Two cells at extraordinary arcs that share a face which touches one of the arcs share a whole side of both.
 *  5. The extraordinary arcs of a cell meet in one of its corners, and it is thinner than half of its block across each.
 *  6. Cells that meet in a point have the same vertex there, if it is a corner of both; T-joints are those vertices that lie on a cell without being its corners.
 */
#ifndef BW_TSPLINE_TMESH_H
#define BW_TSPLINE_TMESH_H

#include "igm/atlas.h"

enum { BW_TMESH_UNIT = 4 };
enum { BW_TVERTEX_BOUNDARY = 1, BW_TVERTEX_EXTRAORDINARY = 2 /* on an extraordinary arc */ };

typedef struct {
    int64_t low[3], high[3]; /* in the chart of the block, whose low corner is the origin */
    bw_block block;
    int32_t corner[8];       /* vertices; bits as of a block's corners (complex.h) */
} bw_tcell;

/* What two cells share, or a cell and the outside. */
typedef struct {
    int64_t low[3], high[3]; /* in the chart of the block of cell[0]; equal along the normal */
    int32_t cell[2];         /* [1]: BW_NONE outside */
    uint8_t side[2];         /* of each cell: 2 * axis + (0 low | 1 high) */
    bw_patch patch;          /* that it lies in, cell[0] in patch_block[patch][0]; BW_NONE within a block */
} bw_tface;

/* A vertex on a cell that is not one of its corners. */
typedef struct {
    int32_t vertex, cell;
    uint8_t inside; /* axes of the cell, by bits, along which it is between the ends: one on an edge, two on a side */
} bw_tjoint;

/* One vertex of the T-mesh as one block sees it. */
typedef struct {
    int64_t at[3];
    bw_block block;
    int32_t vertex;
} bw_tpoint;

typedef struct {
    const bw_atlas *atlas; /* borrowed */
    size_t cell_count, face_count, joint_count, vertex_count, point_count, refined_blocks;
    size_t *cell_begin;    /* [block + 1] */
    bw_tcell *cell;        /* by block, then by low corner */
    bw_tface *face;
    bw_tjoint *joint;
    bw_tpoint *point;      /* all places of all vertices; [vertex_place[v]] is one of vertex v */
    size_t *vertex_place;  /* [vertex] */
    uint8_t *vertex_flags;
    int64_t *thickness;    /* [arc]; 0: not extraordinary */
    size_t *cut_begin;     /* [arc + 1]: where an extraordinary arc is cut between its ends, ascending from its first node */
    int64_t *cut;
    int32_t *arc_vertex;   /* vertices along an extraordinary arc, ends included: two more than cuts, from cut_begin[arc] + 2 * arc */
} bw_tmesh;

bool bw_tmesh_is_extraordinary(const bw_complex *complex, bw_arc arc);

/* Requires an atlas that bw_atlas_check accepts, of positive lengths: those of quantization, or arc_length itself. BW_E_USAGE if one is not positive, BW_E_RANGE if a block is longer than
 * 2^56; BW_E_LIMIT beyond 2^31 - 1 cells or points; BW_E_CANCELLED. O(sum over blocks of cells^2), which are few. */
bw_status bw_tmesh_init(bw_context *ctx, const bw_atlas *atlas, bw_tmesh *mesh);
void bw_tmesh_clear(bw_context *ctx, bw_tmesh *mesh);
/* BW_E_CHECK naming the first violation; BW_E_CANCELLED. */
bw_status bw_tmesh_check(bw_context *ctx, const bw_tmesh *mesh);

/* Position of every vertex in the input's space, in doubles. O(n log n). */
bw_status bw_tmesh_positions(bw_context *ctx, const bw_tmesh *mesh, double (*position)[3]);

/* The vertices along an extraordinary arc. */
static inline const int32_t *bw_tmesh_along(const bw_tmesh *mesh, bw_arc arc, size_t *count) {
    *count = mesh->cut_begin[arc + 1] - mesh->cut_begin[arc] + 2;
    return &mesh->arc_vertex[mesh->cut_begin[arc] + 2 * (size_t)arc];
}

/* The transition out of patch_block[patch][slot] across the patch, in knots. */
bw_transition bw_tmesh_out(const bw_atlas *atlas, bw_patch patch, int slot);

#endif
