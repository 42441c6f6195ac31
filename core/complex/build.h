/* What the sources that read a block complex off its walls share: complex.c calls arcs.c, blocks.c, patches.c in this order. */
#ifndef BW_COMPLEX_BUILD_H
#define BW_COMPLEX_BUILD_H

#include "complex/complex.h"

/* What the walls around an edge of the cell complex make of it: a kind in the lowest two bits and a number above. While they are counted the kind is
 * how many they are, 3 standing for more, and the number all polygons joined by exclusive or: of two, either gives the other. */
typedef uint32_t bw_build_edge;
enum { BW_EDGE_FREE, BW_EDGE_ON_ARC /* number: the arc */, BW_EDGE_FLAT /* the two polygons */, BW_EDGE_WAITS /* for its arc */ };

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    bw_complex *complex;
    bw_complex *before;     /* NULL, or the complex when there were more walls: gives its arrays of cells and charts away */
    bw_build_edge *edge;    /* [edge of the cell complex] */
    int64_t (*low)[3];      /* [block]: its box in its chart, before the low corner is moved to the origin */
    int64_t (*high)[3];
    uint8_t *not_cuboid;    /* [block] */
    uint8_t (*polygon_side)[2]; /* [polygon]: the side of the block of cell[i] in which a wall polygon lies */
    bw_patch *polygon_patch; /* [polygon]; BW_NONE for those that are no walls */
    uint8_t *polygon_slot;  /* [polygon]: which of its cells is on side 0 of its patch */
} bw_build;

/* Nodes and arcs with their edges, lengths and flags (all but BW_ARC_T). */
bw_status bw_build_arcs(bw_build *b);
/* Blocks: cells, charts, boxes, and in which of their sides walls lie. */
bw_status bw_build_blocks(bw_build *b);
/* Patches with polygons, blocks and sides; after arcs and blocks. */
bw_status bw_build_patches(bw_build *b);
/* Corners, chains and side lists of patches and blocks; BW_ARC_T. Only where every block is a cuboid. */
bw_status bw_build_chains(bw_build *b);

/* Coordinates of a vertex in the chart of the block of `cell`, whose box starts at the origin; exact[k] tells whether coordinate k is an integer,
 * otherwise out[k] is its floor. */
void bw_build_locate(const bw_build *b, bw_cvertex vertex, bw_cell cell, int64_t out[3], bool exact[3]);

#endif
