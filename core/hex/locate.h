/* Points of the map in space: finds the tet of a block, or the triangle of a patch, that holds a point of its chart, and maps the point along it.
 *
 * A tet may be in several blocks, once for each chart in which it reaches into the block's box: inside the box these do not overlap. A patch
 * is looked up in its own plane, so that what is on the boundary of the mesh is found on a boundary facet, and comes out on it.
 * All in doubles: where rounding leaves a point outside of everything the nearest candidate is taken. Nothing but positions depends on it.
 */
#ifndef BW_HEX_LOCATE_H
#define BW_HEX_LOCATE_H

#include "hex/boxtree.h"
#include "hex/carrier.h"
#include "igm/blockwise.h"

typedef struct {
    bw_tet tet;
    int32_t chart; /* of complex->chart */
} bw_block_tet;

/* A triangle of a patch: a facet, or a part of a polygon in a tet. */
typedef struct {
    double uv[3][2]; /* in the frame of the patch, grid units */
    int32_t corner[3]; /* mesh vertices of a facet; else vertices of the cell complex */
    int32_t carrier; /* bw_facet or bw_tet */
    uint8_t kind;    /* bw_carrier */
} bw_patch_triangle;

typedef struct {
    const bw_blockwise *map; /* borrowed; NULL: of blocks only */
    const bw_cells *cells;
    const bw_complex *complex;
    bw_carriers carriers;
    size_t tet_count, triangle_count;
    bw_block_tet *tet;
    bw_patch_triangle *triangle;
    bw_span *tet_span, *triangle_span;
    bw_boxtree tets, triangles; /* by block, by patch */
} bw_locator;

/* O(n log n) in the number of cells. */
bw_status bw_locator_init(bw_context *ctx, const bw_blockwise *map, bw_locator *locator);
/* Of points in blocks only: positions and holds are found, nothing of patches, arcs and nodes may be asked. */
bw_status bw_locator_init_blocks(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_locator *locator);
void bw_locator_clear(bw_context *ctx, bw_locator *locator);

/* A point of a block's chart; of a patch's frame; a node. For several threads at a time. */
void bw_locate_in_block(const bw_locator *locator, bw_block block, const double p[3], double position[3], bw_hold *hold);
void bw_locate_in_patch(const bw_locator *locator, bw_patch patch, const double p[2], double position[3], bw_hold *hold);
void bw_locate_node(const bw_locator *locator, bw_node node, double position[3], bw_hold *hold);
/* Points that divide an arc into `parts` of equal length, the ends left out. O(edges of the arc + parts). */
void bw_locate_on_arc(const bw_locator *locator, bw_arc arc, size_t parts, double (*position)[3], bw_hold *hold);

#endif
