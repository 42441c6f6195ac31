/* Closest points on triangles and segments: a tree of boxes (bounding volume hierarchy).
 *
 * Items are triangles of points, by index; an item whose last two corners are the same is a segment. Items belong to groups, and a
 * query asks one group or all: the tree is a tree of the groups' trees.
 *
 * Invariants
 *  1. A node's box holds its items exactly; siblings may overlap.
 *  2. Splits are at the median of centres along the longest side of the box, ties by index: the same tree for the same items.
 */
#ifndef BW_HEX_BVH_H
#define BW_HEX_BVH_H

#include "base/context.h"

typedef struct {
    double low[3], high[3];
    int32_t left, right; /* children; for a leaf the first entry of `order`, and -(number of entries) */
} bw_bvh_node;

typedef struct {
    const double (*point)[3];   /* borrowed */
    const int32_t (*item)[3];   /* borrowed */
    size_t item_count, group_count, node_count;
    int32_t *order;             /* items in leaves */
    int32_t *root;              /* [group]; BW_NONE: it is empty */
    int32_t top;                /* root over all groups; BW_NONE: no items */
    bw_bvh_node *node;
} bw_bvh;

typedef struct {
    int32_t item;
    double point[3];
    double squared; /* distance, squared */
} bw_bvh_hit;

/* Borrows point and item. `group`: of each item, 0..group_count-1. O(n log n). Errors: BW_E_MEMORY. */
bw_status bw_bvh_build(bw_context *ctx, const double (*point)[3], const int32_t (*item)[3], size_t item_count, const int32_t *group,
                       size_t group_count, bw_bvh *tree);
void bw_bvh_clear(bw_context *ctx, bw_bvh *tree);
/* The closest point of a group, or of all if `group` is BW_NONE; hit->item is BW_NONE if there are no items, or none nearer than
 * sqrt(within). */
void bw_bvh_closest(const bw_bvh *tree, int32_t group, const double p[3], double within, bw_bvh_hit *hit);
/* The closest point on a triangle (a segment if b and c are one pointer); the distance squared. */
double bw_closest_on_triangle(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]);

#endif
