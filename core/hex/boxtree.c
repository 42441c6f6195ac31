#include "hex/boxtree.h"

#include <math.h>
#include <string.h>

#include "base/index.h"

void bw_boxtree_clear(bw_context *ctx, bw_boxtree *tree) {
    bw_free(ctx, tree->root), bw_free(ctx, tree->item), bw_free(ctx, tree->node);
    memset(tree, 0, sizeof *tree);
}

static double middle(const bw_span *s, int axis) { return 0.5 * (s->low[axis] + s->high[axis]); }

static bool before(const bw_span *span, int axis, int32_t a, int32_t b) {
    double x = middle(&span[a], axis), y = middle(&span[b], axis);
    return x != y ? x < y : a < b;
}

/* Orders items so that none before place `nth` comes after it along an axis: quickselect. */
static void select_nth(const bw_span *span, int axis, int32_t *item, int32_t count, int32_t nth) {
    for (int32_t low = 0, high = count - 1; low < high;) {
        int32_t pivot = item[low + (high - low) / 2], i = low, j = high;
        while (i <= j) {
            while (before(span, axis, item[i], pivot)) i++;
            while (before(span, axis, pivot, item[j])) j--;
            if (i > j) break;
            int32_t swap = item[i];
            item[i++] = item[j], item[j--] = swap;
        }
        if (nth <= j) high = j;
        else if (nth >= i) low = i;
        else return;
    }
}

static int widest_axis(const bw_span *span, const int32_t *item, int32_t count) {
    double low[3], high[3];
    int best = 0;
    for (int k = 0; k < 3; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (int32_t i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) low[k] = fmin(low[k], middle(&span[item[i]], k)), high[k] = fmax(high[k], middle(&span[item[i]], k));
    for (int k = 1; k < 3; k++)
        if (high[k] - low[k] > high[best] - low[best]) best = k;
    return best;
}

/* The tree over item[first .. first + count - 1]; its root is the next node. */
static void grow(bw_boxtree *tree, int32_t first, int32_t count) {
    bw_boxtree_node *n = &tree->node[tree->node_count++];
    int32_t *item = &tree->item[first];
    n->span = tree->span[item[0]];
    for (int32_t i = 1; i < count; i++)
        for (int k = 0; k < 3; k++) {
            n->span.low[k] = fmin(n->span.low[k], tree->span[item[i]].low[k]);
            n->span.high[k] = fmax(n->span.high[k], tree->span[item[i]].high[k]);
        }
    if (count <= BW_BOXTREE_LEAF) {
        n->first = first, n->count = count;
        return;
    }
    select_nth(tree->span, widest_axis(tree->span, item, count), item, count, count / 2);
    grow(tree, first, count / 2);
    n->first = (int32_t)tree->node_count;
    grow(tree, first + count / 2, count - count / 2);
}

bw_status bw_boxtree_init(bw_context *ctx, const bw_span *span, const int32_t *group, size_t items, size_t groups, bw_boxtree *tree) {
    *tree = (bw_boxtree){.span = span, .group_count = groups};
    if (items >= INT32_MAX - groups) return bw_fail(ctx, BW_E_LIMIT, "too many boxes for a tree");
    size_t *begin = bw_alloc(ctx, groups + 2, sizeof *begin);
    tree->root = bw_alloc(ctx, groups, sizeof *tree->root);
    tree->item = bw_alloc(ctx, items, sizeof *tree->item);
    tree->node = bw_alloc(ctx, items + groups, sizeof *tree->node); /* a leaf has two items at least, or is alone in its group */
    bw_status status = ctx->error.status;
    for (size_t i = 0; i < items && status == BW_OK; i++) begin[group[i] + 2]++;
    for (size_t g = 2; g < groups + 2 && status == BW_OK; g++) begin[g] += begin[g - 1];
    for (size_t i = 0; i < items && status == BW_OK; i++) tree->item[begin[group[i] + 1]++] = (int32_t)i;
    for (size_t g = 0; g < groups && status == BW_OK; g++) {
        tree->root[g] = begin[g + 1] > begin[g] ? (int32_t)tree->node_count : BW_NONE;
        if (tree->root[g] != BW_NONE) grow(tree, (int32_t)begin[g], (int32_t)(begin[g + 1] - begin[g]));
        status = bw_poll(ctx);
    }
    bw_free(ctx, begin);
    if (status != BW_OK) bw_boxtree_clear(ctx, tree);
    return status;
}

static bool holds(const bw_span *s, const bw_boxtree_walk *walk) {
    for (int k = 0; k < 3; k++)
        if (walk->point[k] < s->low[k] - walk->slack || walk->point[k] > s->high[k] + walk->slack) return false;
    return true;
}

void bw_boxtree_start(const bw_boxtree *tree, int32_t group, const double point[3], double slack, bw_boxtree_walk *walk) {
    walk->slack = slack;
    walk->depth = walk->left = 0;
    memcpy(walk->point, point, sizeof walk->point);
    if (tree->root[group] != BW_NONE) walk->stack[walk->depth++] = tree->root[group];
}

int32_t bw_boxtree_next(const bw_boxtree *tree, bw_boxtree_walk *walk) {
    for (;;) {
        while (walk->left > 0) {
            int32_t item = tree->item[walk->at++];
            walk->left--;
            if (holds(&tree->span[item], walk)) return item;
        }
        if (walk->depth == 0) return BW_NONE;
        int32_t index = walk->stack[--walk->depth];
        const bw_boxtree_node *n = &tree->node[index];
        if (!holds(&n->span, walk)) continue;
        if (n->count) {
            walk->at = n->first, walk->left = n->count;
        } else { /* halves: the depth is the logarithm of the number of items */
            walk->stack[walk->depth++] = n->first;
            walk->stack[walk->depth++] = index + 1;
        }
    }
}
