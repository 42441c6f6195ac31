#include "quantize/loops.h"

#include <string.h>

/* ---- graphs ---- */

static void free_graph(bw_context *ctx, bw_cocycle_graph *g) {
    bw_free(ctx, g->edge), bw_free(ctx, g->relation), bw_free(ctx, g->crossing);
    *g = (bw_cocycle_graph){0};
}

static bw_status allocate_graph(bw_context *ctx, size_t vertices, size_t edges, size_t relations, size_t crossings, bw_cocycle_graph *g) {
    g->vertex_count = vertices, g->edge_count = edges;
    g->edge = bw_alloc(ctx, edges, sizeof *g->edge);
    g->relation = bw_alloc(ctx, relations + 1, sizeof *g->relation);
    g->crossing = bw_alloc(ctx, crossings, sizeof *g->crossing);
    if (ctx->error.status == BW_OK) memset(g->edge, 0xff, edges * sizeof *g->edge);
    return ctx->error.status;
}

/* Around an arc inside: each patch once per appearance. */
static void go_around_arc(const bw_surface *s, int32_t first, bw_cocycle_graph *g) {
    size_t n = g->relation[g->relation_count];
    int32_t rim = first;
    do {
        int quarters;
        rim = bw_surface_rim_other(s, rim, &quarters);
        g->crossing[n++] = bw_surface_rim_slot(s, rim);
        rim ^= 1;
    } while (rim != first);
    g->relation[++g->relation_count] = n;
}

static bw_status make_volume_graph(bw_context *ctx, const bw_surface *s, const bw_critical *c, bw_cocycle_graph *g) {
    const bw_complex *x = s->complex;
    if (allocate_graph(ctx, x->block_count, x->patch_count, x->arc_count, x->patch_chain_begin[4 * x->patch_count], g)) return ctx->error.status;
    for (size_t p = 0; p < x->patch_count; p++)
        if (x->patch_block[p][1] != BW_NONE) memcpy(g->edge[p], x->patch_block[p], sizeof *g->edge);
    for (size_t a = 0; a < x->arc_count; a++)
        if (!(x->arc_flags[a] & BW_ARC_BOUNDARY)) go_around_arc(s, s->edge[c->arc_edge[a]].rim[0], g);
    return BW_OK;
}

/* A patch at a node: a rim at which it was entered, and whether the node is where that starts. */
typedef struct {
    int32_t rim;
    bool at_start;
} corner;

/* Across the other arc of a corner's patch at the node; false where that is critical. */
static bool turn(const bw_surface *s, const bw_critical *c, const bw_loops *l, corner *at, int32_t *crossing) {
    int32_t other = bw_surface_rim_turn(s, at->rim, !at->at_start), use = s->complex->patch_chain[other >> 1];
    if (c->arc_link[use >> 1] != BW_NONE) return false;
    *crossing = 2 * (use >> 1) + (l->arc_use[use >> 1][0] != other >> 1);
    at->rim = bw_critical_continue(s, c->patch_region, other, NULL);
    at->at_start = !at->at_start == (s->complex->patch_chain[at->rim >> 1] == use);
    return true;
}

/* Around a node inside a region, if it is one; `seen`: corners of nodes that were gone around, by the rim that starts there. */
static void go_around_node(const bw_surface *s, const bw_critical *c, const bw_loops *l, int32_t first, uint8_t *seen, bw_cocycle_graph *g) {
    size_t n = g->relation[g->relation_count];
    corner at = {first, true};
    if (c->arc_link[s->complex->patch_chain[first >> 1] >> 1] != BW_NONE) return;
    do {
        if (!turn(s, c, l, &at, &g->crossing[n++])) return;
        seen[(at.at_start ? at.rim : bw_surface_rim_turn(s, at.rim, true)) >> 1] = 1;
    } while (at.rim >> 1 != first >> 1 || !at.at_start);
    g->relation[++g->relation_count] = n;
}

static bw_status make_region_graph(bw_context *ctx, const bw_surface *s, const bw_critical *c, bw_loops *l) {
    const bw_complex *x = s->complex;
    size_t uses = x->patch_chain_begin[4 * x->patch_count];
    bw_cocycle_graph *g = &l->region_graph;
    l->arc_use = bw_alloc(ctx, x->arc_count, sizeof *l->arc_use);
    uint8_t *seen = bw_alloc(ctx, uses, 1);
    bw_status status = allocate_graph(ctx, x->patch_count, x->arc_count, uses, uses + 1, g);
    if (status == BW_OK) {
        memset(l->arc_use, 0xff, x->arc_count * sizeof *l->arc_use);
        for (size_t i = 0; i < uses; i++) {
            bw_arc a = x->patch_chain[i] >> 1;
            if (c->patch_region[s->use_patch[i]] == BW_NONE || c->arc_link[a] != BW_NONE) continue;
            int k = l->arc_use[a][0] != BW_NONE;
            l->arc_use[a][k] = (int32_t)i;
            g->edge[a][k] = s->use_patch[i];
        }
        for (size_t i = 0; i < uses; i++)
            if (c->patch_region[s->use_patch[i]] != BW_NONE && !seen[i]) go_around_node(s, c, l, 2 * (int32_t)i, seen, g);
    }
    bw_free(ctx, seen);
    return status;
}

bw_status bw_loops_init(bw_context *ctx, const bw_surface *surface, const bw_critical *critical, bw_loops *l) {
    *l = (bw_loops){0};
    bw_status status = make_volume_graph(ctx, surface, critical, &l->volume_graph);
    if (status == BW_OK) status = bw_cocycles_init(ctx, &l->volume_graph, &l->volume);
    if (status == BW_OK) status = make_region_graph(ctx, surface, critical, l);
    if (status == BW_OK) status = bw_cocycles_init(ctx, &l->region_graph, &l->region);
    if (status != BW_OK) bw_loops_clear(ctx, l);
    return status;
}

void bw_loops_clear(bw_context *ctx, bw_loops *l) {
    free_graph(ctx, &l->volume_graph), free_graph(ctx, &l->region_graph);
    bw_cocycles_clear(ctx, &l->volume), bw_cocycles_clear(ctx, &l->region);
    bw_free(ctx, l->arc_use);
    *l = (bw_loops){0};
}

bw_status bw_loops_volume_corridor(bw_context *ctx, const bw_loops *l, size_t generator, bw_corridor *k, bool *exists) {
    *exists = l->volume.generator[generator] != BW_NONE;
    if (!*exists) return BW_OK;
    int32_t start, *loop = bw_alloc(ctx, 2 * l->volume_graph.vertex_count + 1, sizeof *loop);
    if (!loop) return ctx->error.status;
    size_t n = bw_cocycles_loop(&l->volume_graph, &l->volume, generator, loop, &start);
    bw_corridor_start(k, start);
    for (size_t i = 0; i < n && ctx->error.status == BW_OK; i++) bw_corridor_cross(k, loop[i]);
    bw_free(ctx, loop);
    return ctx->error.status;
}
