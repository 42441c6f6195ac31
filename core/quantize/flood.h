/* What coincides with a critical cell under a quantization: floods at distance zero (Q 5.3.2, 5.4).
 *
 * A quantization sends every block to a box and every place of its surface to a point of it; blocks without extent are sent to rectangles, segments, points.
 * Two points of the volume are zero-connected if a path leads from one to the other along which that image does not move. The flood of a cell (a node, an
 * arc or a patch in one place) is all that is zero-connected to its points. Q 5.4 finds it by a forest of arcs that grows from the cell monotonely, in each
 * direction across it, in the blocks at distance zero (R0). Here blocks without extent are walked through themselves: a state is
 *
 *     a block, the transition from the cell's chart to the block's, and the part of the cell, a box of integers, whose points reach the block,
 *
 * and it spreads through each patch whose rectangle meets the part, which becomes smaller by it. This finds the same blocks without following arcs: T-joints, where no
 * arc leads across, are a matter of boxes that meet; and as blocks have no negative extent, each is crossed from its one side to the other or stood still
 * in, so paths are weakly monotone by themselves.
 *
 * Negative arcs. Nodes of the blocks above a wall and of those below it may change places along the wall, and then blocks lie beside each other
 * that do not touch in the complex. An image on the wall that has left the box of the block it is in goes on through patches of the same side only (and those of
 * the next side where an arc of their common edge holds it): it is carried along the wall, but not through the block.
 *
 * A meeting is a critical cell that a state touches and that may not coincide with the flood's cell. If all that is zero-connected can be contracted validly,
 * then onto one node, or into one link or one region, and each critical cell in it extends from there (Q 5.3.2: paths within the confinement zones).
 * Hence two cells may not coincide
 *   - if in the input they lie apart in a direction perpendicular to both: a direction perpendicular to both leads out of neither (BW_MEET_ACROSS);
 *   - or if their entities have no node or link in common (BW_MEET_APART). This adds what only negative lengths can do: two links in
 *     one plane that cross because the end of one has passed the other.
 *
 * Loops. If a block is reached with the same image in two ways, the loop of both has collapsed. It is no contractible one if its class is not 0; or
 * if it moves every point of the input's chart: going around it is a rotation of the input about a common point or axis if all that is
 * zero-connected can be contracted.
 */
#ifndef BW_QUANTIZE_FLOOD_H
#define BW_QUANTIZE_FLOOD_H

#include "quantize/critical.h"
#include "quantize/loops.h"

typedef enum { BW_CELL_NODE, BW_CELL_ARC, BW_CELL_PATCH } bw_critical_kind;

/* A critical cell in one place: a point, an edge or a slot. */
typedef struct {
    bw_critical_kind kind;
    int32_t place;
} bw_critical_cell;

typedef struct {
    int32_t state;         /* its block, and the way to it */
    bw_critical_cell cell;
    int64_t gap[3];        /* grid units, chart of the flood's cell: from it to this one, where their boxes in the input are apart; else 0 */
    uint8_t along;         /* bits of those directions in which they are apart, but at least one of them extends */
} bw_meeting;

typedef struct bw_flood_state bw_flood_state;

/* Which meetings count. */
typedef enum {
    BW_MEET_ACROSS, /* of arcs and patches, apart across both */
    BW_MEET_NODES,  /* and with nodes */
    BW_MEET_APART,  /* of arcs and patches, apart in any direction, of entities that do not touch */
    BW_MEET_NOTHING /* none: a flood within the region of a patch, from patch to patch, that looks for loops of the region */
} bw_meeting_kind;

typedef struct {
    bw_context *ctx;
    const bw_surface *surface;   /* borrowed */
    const bw_critical *critical;
    const bw_loops *loops;
    int64_t (*at)[3];            /* [point] image */
    bw_transition *cross;        /* [slot]: transition of images across it, from its block to the block beyond */
    bw_flood_state *state;
    size_t state_count, state_room;
    int64_t *class_;             /* [state * rank], of the volume or of the regions */
    size_t class_room;
    int32_t *last;               /* [block or patch]: its newest state, or BW_NONE */
    bw_meeting *meeting;         /* those of the nearest states that have any */
    size_t meeting_count, meeting_room;
    int32_t loop[3];             /* two states, and the slot crossed from the first to where the second is (BW_NONE: to another patch of the same block);
                                    loop[0] BW_NONE: no loop */
    bw_critical_cell seed;
    bw_meeting_kind kind;
} bw_flood;

bw_status bw_flood_init(bw_context *ctx, const bw_surface *surface, const bw_critical *critical, const bw_loops *loops, bw_flood *flood);
void bw_flood_clear(bw_flood *flood);

/* The images of all places under lengths that make patches rectangles and give no block a negative extent. */
void bw_flood_lay_out(bw_flood *flood, const int64_t *length);
/* Floods from a cell as far as its nearest meetings. Deterministic. BW_E_LIMIT if it has a million states. */
bw_status bw_flood_run(bw_flood *flood, bw_critical_cell seed, bw_meeting_kind kind);

/* The state that a state was reached from (BW_NONE: it is the first one), and the slot crossed (BW_NONE: both are in one block). */
int32_t bw_flood_before(const bw_flood *flood, int32_t state, int32_t *slot);

/* Where a cell's points lie in the input: whether a point of it is at the end that looks towards the other one, in the directions along which they are apart. */
bool bw_flood_faces(const bw_flood *flood, const bw_meeting *meeting, bool other, int32_t point);

/* The block of a cell's place. */
bw_block bw_critical_cell_block(const bw_surface *surface, bw_critical_cell cell);
/* Its node, link or region. */
bw_critical_entity bw_critical_cell_entity(const bw_surface *surface, const bw_critical *critical, bw_critical_cell cell);

#endif
