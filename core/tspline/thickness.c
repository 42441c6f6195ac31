/* How thick the tubes of extraordinary arcs are: arcs that meet have tubes that do, so these are equally thick. */
#include <stdlib.h>

#include "tspline/parts.h"

static bw_arc root_of(bw_arc *parent, bw_arc a) {
    while (parent[a] != a) a = parent[a] = parent[parent[a]];
    return a;
}

/* Sets of extraordinary arcs that hang together; the root is the least. first: [node] scratch. */
static void unite_at_nodes(const bw_complex *x, bw_arc *parent, bw_arc *first) {
    for (size_t n = 0; n < x->node_count; n++) first[n] = BW_NONE;
    for (bw_arc arc = 0; arc < (bw_arc)x->arc_count; arc++) {
        parent[arc] = arc;
        for (int e = 0; e < 2 && bw_tmesh_is_extraordinary(x, arc); e++) {
            bw_arc *f = &first[x->arc_node[arc][e]];
            if (*f == BW_NONE) *f = arc;
            bw_arc a = root_of(parent, arc), b = root_of(parent, *f);
            parent[a < b ? b : a] = a < b ? a : b;
        }
    }
}

static int compare_numbers(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

/* The shortest distance of nodes on the surface of a block along an axis. value: room for as many. */
static int64_t shortest_gap(const bw_atlas *atlas, size_t block, int64_t *value) {
    size_t begin = atlas->place_begin[block], count = atlas->place_begin[block + 1] - begin;
    int64_t gap = INT64_MAX;
    for (int k = 0; k < 3; k++) {
        for (size_t i = 0; i < count; i++) value[i] = atlas->place[begin + i].at[k].q;
        qsort(value, count, sizeof *value, compare_numbers);
        for (size_t i = 1; i < count; i++)
            if (value[i] > value[i - 1] && value[i] - value[i - 1] < gap) gap = value[i] - value[i - 1];
    }
    return gap;
}

/* A quarter of the gap, which in knots is the gap. */
static void measure(const bw_atlas *atlas, bw_arc *parent, int64_t *value, int64_t *thickness) {
    _Static_assert(BW_TMESH_UNIT == 4, "a tube is a quarter of the shortest distance thick");
    for (size_t b = 0; b < atlas->complex->block_count; b++) {
        int64_t gap = shortest_gap(atlas, b, value);
        for (size_t r = atlas->rib_begin[b]; r < atlas->rib_begin[b + 1]; r++) {
            bw_arc root = root_of(parent, atlas->rib[r].arc);
            if (bw_tmesh_is_extraordinary(atlas->complex, atlas->rib[r].arc) && (!thickness[root] || gap < thickness[root])) thickness[root] = gap;
        }
    }
    for (bw_arc a = 0; a < (bw_arc)atlas->complex->arc_count; a++)
        if (bw_tmesh_is_extraordinary(atlas->complex, a)) thickness[a] = thickness[root_of(parent, a)];
}

bw_status bw_tmesh_find_thickness(bw_context *ctx, bw_tmesh *mesh) {
    const bw_atlas *atlas = mesh->atlas;
    const bw_complex *x = atlas->complex;
    bw_arc *parent = bw_alloc(ctx, x->arc_count, sizeof *parent), *first = bw_alloc(ctx, x->node_count, sizeof *first);
    int64_t *value = bw_alloc(ctx, atlas->place_begin[x->block_count], sizeof *value);
    mesh->thickness = bw_alloc(ctx, x->arc_count, sizeof *mesh->thickness);
    if (parent && first && value && mesh->thickness) {
        unite_at_nodes(x, parent, first);
        measure(atlas, parent, value, mesh->thickness);
    }
    bw_free(ctx, parent), bw_free(ctx, first), bw_free(ctx, value);
    return ctx->error.status;
}
