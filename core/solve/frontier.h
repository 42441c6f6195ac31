/* Nodes of a search tree that wait to be looked at: lowest bound first; of equal bounds the youngest, for it is deepest. */
#ifndef BW_SOLVE_FRONTIER_H
#define BW_SOLVE_FRONTIER_H

#include "base/context.h"

typedef struct {
    double bound;
    int32_t node; /* numbered in the order they were made */
} bw_waiting;

typedef struct {
    bw_waiting *item; /* a heap: item[0] is next */
    size_t count, room;
} bw_frontier;

bw_status bw_frontier_push(bw_context *ctx, bw_frontier *frontier, int32_t node, double bound);
/* Takes the next one out. Requires that there is one. */
int32_t bw_frontier_pop(bw_frontier *frontier);
void bw_frontier_clear(bw_context *ctx, bw_frontier *frontier);

#endif
