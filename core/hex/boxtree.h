/* Which boxes hold a point: a tree of boxes over the items of each group.
 *
 * Invariants
 *  1. A node's box holds those of its items; leaves have at most BW_BOXTREE_LEAF items.
 *  2. Splits are at the median of the middles of boxes, along the axis in which these spread the most, ties by item: the same tree for the same items.
 */
#ifndef BW_HEX_BOXTREE_H
#define BW_HEX_BOXTREE_H

#include "base/context.h"

enum { BW_BOXTREE_LEAF = 4, BW_BOXTREE_DEPTH = 64 };

typedef struct {
    double low[3], high[3];
} bw_span;

typedef struct {
    bw_span span;
    int32_t first; /* of a leaf: its first item in `item`; else the second child, the first one being the next node */
    int32_t count; /* of a leaf: its items; else 0 */
} bw_boxtree_node;

typedef struct {
    const bw_span *span; /* borrowed; [item] */
    size_t group_count, node_count;
    int32_t *root;       /* [group]; BW_NONE: no items */
    int32_t *item;       /* by group, then by leaf */
    bw_boxtree_node *node;
} bw_boxtree;

/* `group` of each item, 0 .. groups - 1. O(n log n). */
bw_status bw_boxtree_init(bw_context *ctx, const bw_span *span, const int32_t *group, size_t items, size_t groups, bw_boxtree *tree);
void bw_boxtree_clear(bw_context *ctx, bw_boxtree *tree);

/* A walk over the items of a group whose boxes, made larger by `slack` on all sides, hold a point. */
typedef struct {
    double point[3], slack;
    int32_t stack[BW_BOXTREE_DEPTH];
    int32_t depth, at, left; /* items left in the leaf that the walk is in */
} bw_boxtree_walk;

void bw_boxtree_start(const bw_boxtree *tree, int32_t group, const double point[3], double slack, bw_boxtree_walk *walk);
/* The next item; BW_NONE at the end. */
int32_t bw_boxtree_next(const bw_boxtree *tree, bw_boxtree_walk *walk);

#endif
