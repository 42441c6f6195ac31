/* The surfaces of all blocks, laid out in the blocks' charts: where every node, arc and patch of the complex lies in every block that touches it.
 *
 * A block may meet a node, an arc or a patch in several places (self-adjacency), so places have numbers of their own:
 *
 *     point   a node in one place of a block's surface
 *     edge    an arc in one place of a block's surface; it runs along an axis of the block's chart and belongs to two rims
 *     slot    a patch in one of its two blocks: 2 * patch + i is the place in patch_block[patch][i]
 *     rim     one arc of a patch's rim, seen in one of the blocks of the patch: 2 * (index in patch_chain) + i
 *
 * All rims of slot 2p + i are 2 * k + i for k from patch_chain_begin[4p] to patch_chain_begin[4p + 4]; rim ^ 1 is the same piece seen from the block beyond.
 *
 * Invariants (bw_surface_init fails where one does not hold: BW_E_CHECK)
 *  1. In grid units every place has one position: rims that meet in a point agree on it.
 *  2. The surface of a block is closed: each edge has exactly two rims.
 */
#ifndef BW_QUANTIZE_SURFACE_H
#define BW_QUANTIZE_SURFACE_H

#include "complex/complex.h"

typedef struct {
    int64_t at[3]; /* grid units, in the block's chart */
    bw_node node;
    bw_block block;
} bw_surface_point;

typedef struct {
    int32_t point[2]; /* the second has the larger coordinate */
    int32_t rim[2];
    bw_arc_use use;   /* as walked from point[0] to point[1] */
    int8_t axis;
} bw_surface_edge;

typedef struct {
    const bw_complex *complex; /* borrowed */
    size_t point_count, edge_count;
    size_t *point_begin;       /* [block + 1]: points of a block ascend by coordinates, so its first is its low corner */
    bw_surface_point *point;
    size_t *edge_begin;        /* [block + 1] */
    bw_surface_edge *edge;
    size_t *slot_begin;        /* [block + 1] (and one more, scratch of setting up) */
    int32_t *slot;
    int32_t (*slot_corner)[2]; /* [slot]: points of lowest and of highest coordinates; BW_NONE if there is no block */
    bw_patch *use_patch;       /* [index in patch_chain] */
    int32_t *rim_point;        /* [rim]: where its arc use starts; BW_NONE if there is no block */
    int32_t *rim_edge;         /* [rim] */
    size_t *point_rim_begin;   /* [point + 1]: the rims that start at a point, one of each slot around it */
    int32_t *point_rim;
    bw_transition *across;     /* [patch]: grid units, from the chart of its second block to that of its first */
    int32_t (*step)[2];        /* [point - blocks]: an edge and the point reached by it, in an order in which the other end is reached before */
} bw_surface;

/* Linear in the complex but for sorting. */
bw_status bw_surface_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_surface *surface);
void bw_surface_clear(bw_context *ctx, bw_surface *surface);

static inline bw_block bw_surface_slot_block(const bw_surface *s, int32_t slot) { return s->complex->patch_block[slot >> 1][slot & 1]; }
static inline int bw_surface_slot_side(const bw_surface *s, int32_t slot) { return s->complex->patch_side[slot >> 1][slot & 1]; }
/* The rims of a slot are first, first + 2, ..., last - 2. */
static inline int32_t bw_surface_first_rim(const bw_surface *s, int32_t slot) {
    return 2 * (int32_t)s->complex->patch_chain_begin[4 * (slot >> 1)] + (slot & 1);
}
static inline int32_t bw_surface_last_rim(const bw_surface *s, int32_t slot) {
    return 2 * (int32_t)s->complex->patch_chain_begin[4 * (slot >> 1) + 4] + (slot & 1);
}
/* The slot that a rim belongs to. */
static inline int32_t bw_surface_rim_slot(const bw_surface *s, int32_t rim) { return 2 * s->use_patch[rim >> 1] + (rim & 1); }
/* Where a rim ends. */
int32_t bw_surface_rim_end(const bw_surface *surface, int32_t rim);
/* The next rim, or the one before, around the slot. */
int32_t bw_surface_rim_turn(const bw_surface *surface, int32_t rim, bool forward);
/* The other rim of a rim's edge: of the same block. *quarters: the angle of the block between both, 1 or 2. */
int32_t bw_surface_rim_other(const bw_surface *surface, int32_t rim, int *quarters);
/* From the chart of the block of a slot to that of the block beyond, grid units. */
bw_transition bw_surface_cross(const bw_surface *surface, int32_t slot);

/* Positions of all points under a quantization, in the charts of their blocks: at[point]. The lengths must satisfy every rectangularity. */
void bw_surface_lay_out(const bw_surface *surface, const int64_t *length, int64_t (*at)[3]);

#endif
