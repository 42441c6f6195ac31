/* Paths of arcs through a row of blocks: how two places lie to each other, as a linear form in the lengths of arcs.
 *
 * A corridor is a block and the slots crossed from one block to the next. Laid out in the chart of its first block it is regular, so every path of
 * arcs in it from one place to another has the same displacement, in grid units and under every quantization whose patches are
 * rectangles (Q 5, "local q-charts"). The shortest path in the input's lengths is taken, as Q 5.4 does: few arcs, and mostly one way.
 */
#ifndef BW_QUANTIZE_CORRIDOR_H
#define BW_QUANTIZE_CORRIDOR_H

#include "quantize/constraint.h"
#include "quantize/surface.h"

typedef struct {
    bw_arc_use use;
    int8_t axis, sign; /* the direction it is walked in, in the chart of the first block */
} bw_corridor_step;

typedef struct {
    bw_context *ctx;
    const bw_surface *surface; /* borrowed */
    bw_block block;            /* the first one */
    int32_t *slot;             /* crossed, in order; each belongs to the block reached before */
    size_t count, slot_room;
    bw_corridor_step *path;    /* the last path found */
    size_t path_count, path_room;
    /* scratch of the search */
    bw_block *blocks;          /* [count + 1] */
    bw_rotation *rotation;     /* from the first chart */
    size_t *offset;            /* of a block's points among the stops */
    size_t blocks_room, rotation_room, offset_room;
    int64_t *distance;         /* [stop] */
    int32_t *from;             /* [stop]: the rim or edge it was reached by, the stop before */
    int32_t *before;
    uint8_t *done;
    struct bw_corridor_entry *heap;
    bw_term *term;
    size_t distance_room, from_room, before_room, done_room, heap_room, heap_count, term_room;
} bw_corridor;

void bw_corridor_init(bw_context *ctx, const bw_surface *surface, bw_corridor *corridor);
void bw_corridor_clear(bw_corridor *corridor);

/* An empty corridor that starts in a block. */
void bw_corridor_start(bw_corridor *corridor, bw_block block);
bw_status bw_corridor_cross(bw_corridor *corridor, int32_t slot);

/* Finds the shortest path from one of the points `from` in the first block to one of the points `to` in the last one: corridor->path. */
bw_status bw_corridor_find(bw_corridor *corridor, const int32_t *from, size_t from_count, const int32_t *to, size_t to_count);
/* The displacement along the path with these lengths (of arcs), in the chart of the first block. */
void bw_corridor_displacement(const bw_corridor *corridor, const int64_t *length, int64_t out[3]);
/* Appends: sum over axes of sign[axis] * displacement[axis] >= bound. */
bw_status bw_corridor_constrain(bw_corridor *corridor, const int sign[3], int64_t bound, bw_rule rule, bw_constraint_list *list);

#endif
