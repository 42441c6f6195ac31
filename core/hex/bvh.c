#include "hex/bvh.h"

#include <math.h>
#include <string.h>

#include "base/index.h"

enum { LEAF = 4, DEPTH = 128 };

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static double distance(const double a[3], const double b[3]) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return dot(d, d);
}

static double closest_on_segment(const double a[3], const double b[3], const double p[3], double out[3]) {
    double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]}, v[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    double length = dot(u, u), t = length > 0 ? fmin(1, fmax(0, dot(u, v) / length)) : 0;
    for (int k = 0; k < 3; k++) out[k] = t < 1 ? a[k] + t * u[k] : b[k];
    return distance(out, p);
}

static double closest_on_sides(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]) {
    const double *corner[4] = {a, b, c, a};
    double best = INFINITY, q[3];
    for (int i = 0; i < 3; i++) {
        double d = closest_on_segment(corner[i], corner[i + 1], p, q);
        if (d < best) best = d, memcpy(out, q, sizeof q);
    }
    return best;
}

double bw_closest_on_triangle(const double a[3], const double b[3], const double c[3], const double p[3], double out[3]) {
    if (b == c) return closest_on_segment(a, b, p, out);
    double u[3], v[3], w[3], q[3];
    for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = p[k] - a[k];
    double uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), uw = dot(u, w), vw = dot(v, w), det = uu * vv - uv * uv;
    double s = vv * uw - uv * vw, t = uu * vw - uv * uw;
    if (!(det > 0) || s < 0 || t < 0 || s + t > det) return closest_on_sides(a, b, c, p, out);
    for (int k = 0; k < 3; k++) q[k] = a[k] + (s * u[k] + t * v[k]) / det;
    double d = distance(q, p);
    if (det > 1e-12 * uu * vv) {
        memcpy(out, q, sizeof q);
        return d;
    }
    return closest_on_sides(a, b, c, p, out); /* a sliver: its sides are it */
}

/* ---- build ------------------------------------------------------------------------------------------------------ */

typedef struct {
    bw_bvh *tree;
    double (*centre)[3]; /* [item] */
} builder;

static void corners(const bw_bvh *tree, int32_t item, const double *out[3]) {
    const int32_t *t = tree->item[item];
    for (int k = 0; k < 3; k++) out[k] = tree->point[t[k]];
}

static void box_empty(bw_bvh_node *node) {
    for (int k = 0; k < 3; k++) node->low[k] = INFINITY, node->high[k] = -INFINITY;
}

static void box_add(bw_bvh_node *node, const double low[3], const double high[3]) {
    for (int k = 0; k < 3; k++) node->low[k] = fmin(node->low[k], low[k]), node->high[k] = fmax(node->high[k], high[k]);
}

static bool before(const double (*centre)[3], int axis, int32_t a, int32_t b) {
    double x = centre[a][axis], y = centre[b][axis];
    return x != y ? x < y : a < b;
}

/* Orders ids so that the ones before the middle come first along `axis`: quickselect. */
static void select_middle(const double (*centre)[3], int axis, int32_t *ids, size_t count) {
    size_t low = 0, high = count - 1, middle = count / 2;
    while (low < high) {
        int32_t pivot = ids[low + (high - low) / 2];
        size_t i = low, j = high;
        for (;;) {
            while (before(centre, axis, ids[i], pivot)) i++;
            while (before(centre, axis, pivot, ids[j])) j--;
            if (i >= j) break;
            int32_t swap = ids[i];
            ids[i++] = ids[j], ids[j--] = swap;
        }
        size_t end = before(centre, axis, pivot, ids[j]) ? j - 1 : j; /* ids[low..end] are not after the pivot */
        if (middle <= end)
            high = end;
        else
            low = end + 1;
    }
}

/* Axis along which centres spread the most. */
static int longest_axis(const double (*centre)[3], const int32_t *ids, size_t count) {
    bw_bvh_node box;
    box_empty(&box);
    for (size_t i = 0; i < count; i++) box_add(&box, centre[ids[i]], centre[ids[i]]);
    int axis = 0;
    for (int k = 1; k < 3; k++)
        if (box.high[k] - box.low[k] > box.high[axis] - box.low[axis]) axis = k;
    return axis;
}

static int32_t new_node(bw_bvh *tree) {
    box_empty(&tree->node[tree->node_count]);
    return (int32_t)tree->node_count++;
}

static int32_t join(bw_bvh *tree, int32_t node, int32_t left, int32_t right) {
    bw_bvh_node *n = &tree->node[node];
    n->left = left, n->right = right;
    box_add(n, tree->node[left].low, tree->node[left].high);
    box_add(n, tree->node[right].low, tree->node[right].high);
    return node;
}

/* Tree over order[first..first+count-1]. */
static int32_t build_items(builder *b, size_t first, size_t count) {
    bw_bvh *tree = b->tree;
    int32_t node = new_node(tree), *ids = tree->order + first;
    if (count <= LEAF) {
        for (size_t i = 0; i < count; i++) {
            const double *c[3];
            corners(tree, ids[i], c);
            for (int k = 0; k < 3; k++) box_add(&tree->node[node], c[k], c[k]);
        }
        tree->node[node].left = (int32_t)first, tree->node[node].right = -(int32_t)count;
        return node;
    }
    select_middle((const double(*)[3])b->centre, longest_axis((const double(*)[3])b->centre, ids, count), ids, count);
    int32_t left = build_items(b, first, count / 2);
    return join(tree, node, left, build_items(b, first + count / 2, count - count / 2));
}

/* Tree over whole groups. */
static int32_t build_groups(bw_bvh *tree, const double (*centre)[3], int32_t *groups, size_t count) {
    if (count == 1) return tree->root[groups[0]];
    int32_t node = new_node(tree);
    select_middle(centre, longest_axis(centre, groups, count), groups, count);
    int32_t left = build_groups(tree, centre, groups, count / 2);
    return join(tree, node, left, build_groups(tree, centre, groups + count / 2, count - count / 2));
}

/* Items sorted by group into `order`; start[g] is where group g begins. */
static void sort_by_group(bw_bvh *tree, const int32_t *group, size_t *start) {
    for (size_t i = 0; i < tree->item_count; i++) start[group[i] + 1]++;
    for (size_t g = 0; g < tree->group_count; g++) start[g + 1] += start[g];
    for (size_t i = 0; i < tree->item_count; i++) tree->order[start[group[i]]++] = (int32_t)i;
    for (size_t g = tree->group_count; g > 0; g--) start[g] = start[g - 1];
    start[0] = 0;
}

static void build_all(builder *b, const size_t *start, double (*centre)[3], int32_t *groups) {
    bw_bvh *tree = b->tree;
    size_t full = 0;
    for (size_t i = 0; i < tree->item_count; i++) {
        const double *c[3];
        corners(tree, (int32_t)i, c);
        for (int k = 0; k < 3; k++)
            b->centre[i][k] = 0.5 * (fmin(c[0][k], fmin(c[1][k], c[2][k])) + fmax(c[0][k], fmax(c[1][k], c[2][k])));
    }
    for (size_t g = 0; g < tree->group_count; g++) {
        tree->root[g] = BW_NONE;
        if (start[g] == start[g + 1]) continue;
        tree->root[g] = build_items(b, start[g], start[g + 1] - start[g]);
        const bw_bvh_node *n = &tree->node[tree->root[g]];
        for (int k = 0; k < 3; k++) centre[g][k] = 0.5 * (n->low[k] + n->high[k]);
        groups[full++] = (int32_t)g;
    }
    tree->top = full ? build_groups(tree, (const double(*)[3])centre, groups, full) : BW_NONE;
}

bw_status bw_bvh_build(bw_context *ctx, const double (*point)[3], const int32_t (*item)[3], size_t item_count, const int32_t *group,
                       size_t group_count, bw_bvh *tree) {
    *tree = (bw_bvh){.point = point, .item = item, .item_count = item_count, .group_count = group_count, .top = BW_NONE};
    builder b = {.tree = tree};
    size_t *start = bw_alloc(ctx, group_count + 1, sizeof *start);
    double(*centre)[3] = bw_alloc(ctx, group_count, sizeof *centre);
    int32_t *groups = bw_alloc(ctx, group_count, sizeof *groups);
    b.centre = bw_alloc(ctx, item_count, sizeof *b.centre);
    tree->order = bw_alloc(ctx, item_count, sizeof *tree->order);
    tree->root = bw_alloc(ctx, group_count, sizeof *tree->root);
    tree->node = bw_alloc(ctx, 2 * item_count + 1, sizeof *tree->node); /* a binary tree with at most item_count leaves */
    if (start && centre && groups && b.centre && tree->order && tree->root && tree->node) {
        sort_by_group(tree, group, start);
        build_all(&b, start, centre, groups);
    }
    bw_free(ctx, start), bw_free(ctx, centre), bw_free(ctx, groups), bw_free(ctx, b.centre);
    if (ctx->error.status != BW_OK) bw_bvh_clear(ctx, tree);
    return ctx->error.status;
}

void bw_bvh_clear(bw_context *ctx, bw_bvh *tree) {
    bw_free(ctx, tree->order), bw_free(ctx, tree->root), bw_free(ctx, tree->node);
    *tree = (bw_bvh){.top = BW_NONE};
}

/* ---- query ------------------------------------------------------------------------------------------------------ */

static double to_box(const bw_bvh_node *node, const double p[3]) {
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        double d = fmax(0, fmax(node->low[k] - p[k], p[k] - node->high[k]));
        sum += d * d;
    }
    return sum;
}

static void try_leaf(const bw_bvh *tree, const bw_bvh_node *node, const double p[3], bw_bvh_hit *hit) {
    for (int32_t i = 0; i < -node->right; i++) {
        const double *c[3];
        double q[3];
        int32_t item = tree->order[node->left + i];
        corners(tree, item, c);
        double d = bw_closest_on_triangle(c[0], c[1], c[2], p, q);
        if (d < hit->squared || (d == hit->squared && item < hit->item)) {
            hit->item = item, hit->squared = d;
            memcpy(hit->point, q, sizeof q);
        }
    }
}

void bw_bvh_closest(const bw_bvh *tree, int32_t group, const double p[3], double within, bw_bvh_hit *hit) {
    struct {
        int32_t node;
        double squared;
    } stack[DEPTH];
    int depth = 0;
    int32_t root = group == BW_NONE ? tree->top : tree->root[group];
    *hit = (bw_bvh_hit){.item = BW_NONE, .squared = within};
    if (root == BW_NONE) return;
    stack[depth].node = root, stack[depth++].squared = to_box(&tree->node[root], p);
    while (depth) {
        const bw_bvh_node *node = &tree->node[stack[--depth].node];
        if (stack[depth].squared > hit->squared) continue;
        if (node->right < 0) {
            try_leaf(tree, node, p, hit);
            continue;
        }
        double left = to_box(&tree->node[node->left], p), right = to_box(&tree->node[node->right], p);
        bool left_first = left <= right; /* the nearer one is looked at first */
        stack[depth].node = left_first ? node->right : node->left, stack[depth++].squared = fmax(left, right);
        stack[depth].node = left_first ? node->left : node->right, stack[depth++].squared = fmin(left, right);
    }
}
