/* Integer cocycles of a graph with relations: which loops can be contracted, and generators of those that cannot.
 *
 * A graph stands for a space cut into cells: its vertices are the cells, its edges the walls one can cross, its relations the small loops
 * around what is not a wall (around an interior arc of the volume, an interior node of a surface). An integer for each edge, added when
 * it is crossed forth and subtracted when back, is a cocycle if every relation adds up to 0. The sums along a loop, one for each
 * of `rank` independent cocycles, are then its class: loops that can be deformed into each other have the same, and a loop that can be contracted has
 * class 0. rank is the first Betti number.
 *
 * Generators: crossing generator[i] forth and returning through the forest is a loop of class (0, .., 1 at i, .., 0).
 */
#ifndef BW_QUANTIZE_COCYCLE_H
#define BW_QUANTIZE_COCYCLE_H

#include "base/context.h"

typedef struct {
    size_t vertex_count, edge_count;
    int32_t (*edge)[2];    /* vertices; BW_NONE twice: no edge */
    size_t relation_count;
    size_t *relation;      /* [relation + 1] */
    int32_t *crossing;     /* 2 * edge, + 1 if crossed back */
} bw_cocycle_graph;        /* borrowed */

typedef struct {
    size_t rank;
    int64_t *value;     /* [edge * rank + i] */
    int32_t *generator; /* [rank]: an edge; BW_NONE for a cocycle that no single edge tells from the others */
    int32_t *parent;    /* [vertex]: the crossing that leads to it in the forest, or BW_NONE at a root */
} bw_cocycles;

/* BW_E_RANGE where numbers grow beyond 2^40. */
bw_status bw_cocycles_init(bw_context *ctx, const bw_cocycle_graph *graph, bw_cocycles *cocycles);
void bw_cocycles_clear(bw_context *ctx, bw_cocycles *cocycles);

/* The loop of a generator: its crossings in order; `loop` has room for 2 * vertex_count + 1 of them. The generator comes last.
 * *start: the vertex it starts from. */
size_t bw_cocycles_loop(const bw_cocycle_graph *graph, const bw_cocycles *cocycles, size_t generator, int32_t *loop, int32_t *start);

#endif
