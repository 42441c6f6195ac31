/* Block complex: nodes, arcs, patches and blocks (MC 4.1), over the leaves of a cell complex.
 *
 * A block is a cuboid in the map. Its sides are numbered
 *     2 * axis + (0 low | 1 high)        axis of the block's own chart, 0..5
 * its corners by bits (bit k set: high end of axis k), 0..7, and its edges
 *     4 * axis + bits                    axis the edge runs along; bit 0 / 1: high end of the next / next but one axis, 0..11
 *
 *          6-------7
 *         /|      /|        2
 *        4-------5 |        | 1
 *        | 2-----|-3        |/
 *        |/      |/         +--- 0
 *        0-------1
 *
 * A side is tiled by one or more patches, an edge is a chain of one or more arcs; a patch has 4 sides, each a chain of arcs.
 * T-joints: an arc is a T-arc if some block has it inside a side.
 * Blocks may be self-adjacent (both sides of a patch the same block).
 *
 * Lists of lists are stored as `begin` arrays of count + 1 offsets into one flat array.
 */
#ifndef BW_COMPLEX_COMPLEX_H
#define BW_COMPLEX_COMPLEX_H

#include "mesh/cells.h"

enum { BW_NODE_SINGULAR = 1, BW_NODE_BOUNDARY = 2, BW_NODE_FEATURE = 4 };
enum { BW_ARC_SINGULAR = 1, BW_ARC_BOUNDARY = 2, BW_ARC_T = 4, BW_ARC_FEATURE = 8 };
enum {
    BW_PATCH_BOUNDARY = 1,
    BW_PATCH_SINGULAR = 2, /* a rim arc is singular */
    BW_PATCH_TORUS = 4,    /* made by torus splitting */
    BW_PATCH_FEATURE = 8   /* holds a feature facet, or a feature node that nothing else holds: reduction keeps it */
};

/* An arc as part of a chain: arc index * 2 + 1 if walked from its second node to its first. */
typedef int32_t bw_arc_use;

typedef struct {
    size_t node_count, arc_count, patch_count, block_count;

    bw_cvertex *node_vertex; /* [node] */
    uint8_t *node_flags;

    bw_node (*arc_node)[2];  /* [arc] */
    int64_t *arc_length;     /* grid units */
    uint16_t *arc_quarters;  /* parametric angle around the arc in quarter turns */
    uint8_t *arc_flags;
    size_t *arc_edge_begin;  /* [arc + 1]: its edges, in order from the first node */
    bw_cedge *arc_edge;

    bw_block (*patch_block)[2]; /* [patch]; BW_NONE outside */
    uint8_t (*patch_side)[2];   /* the side of patch_block[i] that it lies in */
    int64_t (*patch_extent)[2]; /* grid units: along sides 0 and 2, along sides 1 and 3 */
    int64_t (*patch_low)[3];    /* its low corner in the chart of patch_block[0] */
    int64_t *patch_distance;    /* from the wall's origin (minimum over its polygons) */
    uint8_t *patch_flags;
    size_t *patch_polygon_begin;
    bw_polygon *patch_polygon;
    size_t *patch_chain_begin;  /* [4 * patch + side]: arc uses of the side, a closed walk over sides 0..3 */
    bw_arc_use *patch_chain;
    bw_node (*patch_corner)[4]; /* corner i starts side i */

    int64_t (*block_extent)[3]; /* [block] grid units */
    bw_node (*block_corner)[8];
    size_t *block_side_begin;   /* [6 * block + side] */
    bw_patch *block_side;
    size_t *block_edge_begin;   /* [12 * block + edge]: arc uses from the low to the high end */
    bw_arc_use *block_edge;
    bw_block *cell_block;       /* [cell] */
    int32_t *cell_chart;        /* [cell]: its chart */
    size_t chart_count;
    bw_transition *chart;       /* [chart]: from the chart of a tet to that of a block, whose low corner is the origin; may repeat */

    size_t cell_count;          /* of the cell complex when this was built */
    size_t torus_splits;        /* blocks that were tori and got a wall */
} bw_complex;

void bw_complex_clear(bw_context *ctx, bw_complex *complex);

/* From the chart of a cell's tet to that of its block. */
static inline const bw_transition *bw_complex_chart(const bw_complex *complex, bw_cell cell) {
    return &complex->chart[complex->cell_chart[cell]];
}

bw_node bw_arc_use_start(const bw_complex *complex, bw_arc_use use);
bw_node bw_arc_use_end(const bw_complex *complex, bw_arc_use use);
/* From the chart of patch_block[patch][1] to that of patch_block[patch][0], for a patch inside. */
bw_transition bw_complex_across(const bw_cells *cells, const bw_complex *complex, bw_patch patch);

/* A cell of every block that is not a cuboid: after tracing these are the tori of MC 5.3. */
typedef struct {
    bw_cell *cell;
    size_t count, room;
} bw_torus_list;

/* Reads the complex off the walls of a cell complex. Where some blocks are no cuboids, *tori gets a cell of each and the complex is left without
 * chains, corners and side lists; the caller splits them and builds anew. Errors: BW_E_CHECK naming what is not as MC 4.1 says. */
bw_status bw_complex_build(bw_context *ctx, const bw_cells *cells, bw_complex *complex, bw_torus_list *tori);

/* The same for a complex of these cells that was built before some of their walls were taken away: its blocks are joined where no wall parts
 * them any more, which is much less work than to find them. */
bw_status bw_complex_rebuild(bw_context *ctx, const bw_cells *cells, bw_complex *complex, bw_torus_list *tori);

/* Verifies every property of MC 4.1 and of the numbering above. BW_E_CHECK naming the first violation. */
bw_status bw_complex_check(bw_context *ctx, const bw_cells *cells, const bw_complex *complex);

#endif
