#include "quantize/cocycle.h"

#include <stdlib.h>

#include "base/index.h"
#include "quantize/eliminate.h"

/* A spanning forest, breadth first: parent[vertex]. tree[edge]: whether it is part of it. */
static bw_status grow_forest(bw_context *ctx, const bw_cocycle_graph *g, bw_cocycles *c, uint8_t *tree) {
    size_t *begin = bw_alloc(ctx, g->vertex_count + 2, sizeof *begin);
    int32_t *out = bw_alloc(ctx, 2 * g->edge_count, sizeof *out), *queue = bw_alloc(ctx, g->vertex_count, sizeof *queue);
    uint8_t *reached = bw_alloc(ctx, g->vertex_count, 1);
    if (ctx->error.status == BW_OK) {
        for (size_t e = 0; e < g->edge_count; e++)
            for (int i = 0; i < 2 && g->edge[e][0] != BW_NONE; i++) begin[g->edge[e][i] + 2]++;
        for (size_t v = 2; v < g->vertex_count + 2; v++) begin[v] += begin[v - 1];
        for (int32_t e = 0; e < (int32_t)g->edge_count; e++)
            for (int i = 0; i < 2 && g->edge[e][0] != BW_NONE; i++) out[begin[g->edge[e][i] + 1]++] = 2 * e + i;
        for (size_t root = 0; root < g->vertex_count; root++) {
            size_t head = 0, tail = 0;
            if (reached[root]) continue;
            reached[root] = 1;
            c->parent[root] = BW_NONE;
            for (queue[tail++] = (int32_t)root; head < tail; head++)
                for (size_t i = begin[queue[head]]; i < begin[queue[head] + 1]; i++) {
                    int32_t to = g->edge[out[i] >> 1][!(out[i] & 1)];
                    if (reached[to]) continue;
                    reached[to] = tree[out[i] >> 1] = 1;
                    c->parent[to] = out[i];
                    queue[tail++] = to;
                }
        }
    }
    bw_free(ctx, begin), bw_free(ctx, out), bw_free(ctx, queue), bw_free(ctx, reached);
    return ctx->error.status;
}

static int by_unknown(const void *a, const void *b) {
    const bw_eliminate_term *x = a, *y = b;
    return (x->unknown > y->unknown) - (x->unknown < y->unknown);
}

/* The relations as equations on the edges outside the forest, without those that say nothing. */
static size_t write_equations(const bw_cocycle_graph *g, const uint8_t *tree, size_t *begin, bw_eliminate_term *term) {
    size_t rows = 0;
    for (size_t r = 0; r < g->relation_count; r++) {
        size_t first = begin[rows], n = first, out = first;
        for (size_t i = g->relation[r]; i < g->relation[r + 1]; i++)
            if (!tree[g->crossing[i] >> 1]) term[n++] = (bw_eliminate_term){g->crossing[i] >> 1, g->crossing[i] & 1 ? -1 : 1};
        if (n > first) qsort(term + first, n - first, sizeof *term, by_unknown);
        for (size_t i = first; i < n;) {
            bw_eliminate_term sum = term[i++];
            while (i < n && term[i].unknown == sum.unknown) sum.factor += term[i++].factor;
            if (sum.factor) term[out++] = sum;
        }
        if (out > first) begin[++rows] = out;
    }
    return rows;
}

/* Values of all unknowns, extra ones included, from the free ones. */
static bw_status expand(bw_context *ctx, const bw_cocycle_graph *g, const bw_elimination *gone, const uint8_t *tree, bw_cocycles *c) {
    uint8_t *implied = bw_alloc(ctx, gone->count, 1);
    int32_t *free_of = bw_alloc(ctx, gone->count, sizeof *free_of);
    if (!implied || !free_of) goto out;
    for (size_t i = 0; i < gone->step_count; i++) implied[gone->step[i].unknown] = 1;
    for (size_t u = 0; u < gone->count; u++) {
        bool is_free = !implied[u] && (u >= g->edge_count || (!tree[u] && g->edge[u][0] != BW_NONE));
        free_of[u] = is_free ? (int32_t)c->rank++ : BW_NONE;
    }
    c->generator = bw_alloc(ctx, c->rank, sizeof *c->generator);
    int64_t *value = c->value = bw_alloc(ctx, gone->count * c->rank, sizeof *value);
    if (!c->generator || !value) goto out;
    for (size_t u = 0; u < gone->count; u++) {
        if (free_of[u] == BW_NONE) continue;
        value[u * c->rank + (size_t)free_of[u]] = 1;
        c->generator[free_of[u]] = u < g->edge_count ? (int32_t)u : BW_NONE;
    }
    for (size_t i = gone->step_count; i-- > 0;) {
        const bw_eliminate_step *s = &gone->step[i];
        for (size_t t = s->begin; t < s->end; t++)
            for (size_t k = 0; k < c->rank; k++) {
                int64_t product;
                if (__builtin_mul_overflow(gone->term[t].factor, value[(size_t)gone->term[t].unknown * c->rank + k], &product) || llabs(product) >> 40)
                    bw_fail(ctx, BW_E_RANGE, "the topology of the complex needs numbers beyond 2^40");
                else
                    value[(size_t)s->unknown * c->rank + k] += product;
            }
    }
out:
    bw_free(ctx, implied), bw_free(ctx, free_of);
    return ctx->error.status;
}

bw_status bw_cocycles_init(bw_context *ctx, const bw_cocycle_graph *g, bw_cocycles *c) {
    *c = (bw_cocycles){0};
    size_t terms = g->relation_count ? g->relation[g->relation_count] : 0;
    bw_elimination gone = {0};
    uint8_t *tree = bw_alloc(ctx, g->edge_count, 1);
    int64_t *size = bw_alloc(ctx, g->edge_count, sizeof *size);
    size_t *begin = bw_alloc(ctx, g->relation_count + 1, sizeof *begin);
    bw_eliminate_term *term = bw_alloc(ctx, terms, sizeof *term);
    c->parent = bw_alloc(ctx, g->vertex_count, sizeof *c->parent);
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = grow_forest(ctx, g, c, tree);
    if (status == BW_OK) {
        bw_eliminate_input input = {write_equations(g, tree, begin, term), g->edge_count, begin, term, size};
        status = bw_eliminate(ctx, &input, &gone);
    }
    if (status == BW_OK) status = expand(ctx, g, &gone, tree, c);
    bw_elimination_clear(ctx, &gone);
    bw_free(ctx, tree), bw_free(ctx, size), bw_free(ctx, begin), bw_free(ctx, term);
    if (status != BW_OK) bw_cocycles_clear(ctx, c);
    return status;
}

void bw_cocycles_clear(bw_context *ctx, bw_cocycles *c) {
    bw_free(ctx, c->value), bw_free(ctx, c->generator), bw_free(ctx, c->parent);
    *c = (bw_cocycles){0};
}

/* The crossings from a vertex up to its root, as they are crossed going up. */
static size_t climb(const bw_cocycle_graph *g, const bw_cocycles *c, int32_t vertex, int32_t *way) {
    size_t n = 0;
    for (int32_t p; (p = c->parent[vertex]) != BW_NONE; vertex = g->edge[p >> 1][p & 1]) way[n++] = p ^ 1;
    return n;
}

size_t bw_cocycles_loop(const bw_cocycle_graph *g, const bw_cocycles *c, size_t generator, int32_t *loop, int32_t *start) {
    int32_t edge = c->generator[generator], *other = loop + g->vertex_count;
    size_t n = climb(g, c, g->edge[edge][1], loop), m = climb(g, c, g->edge[edge][0], other);
    while (n && m && loop[n - 1] == other[m - 1]) n--, m--;
    for (size_t i = 0; i < m; i++) loop[n + i] = other[i]; /* up from the edge's end to where the ways meet, then down to its start, */
    for (size_t i = 0; i < m / 2; i++) {
        int32_t swap = loop[n + i];
        loop[n + i] = loop[n + m - 1 - i], loop[n + m - 1 - i] = swap;
    }
    for (size_t i = n; i < n + m; i++) loop[i] ^= 1;
    loop[n + m] = 2 * edge; /* and across */
    *start = g->edge[edge][1];
    return n + m + 1;
}
