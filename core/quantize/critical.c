#include "quantize/critical.h"

#include <stdlib.h>
#include <string.h>

/* ---- patches ---- */

int32_t bw_critical_continue(const bw_surface *s, const int32_t *patch_region, int32_t rim, int32_t *crossed) {
    int quarters, first;
    rim = bw_surface_rim_other(s, rim, &first);
    if (crossed) *crossed = first == 1 ? bw_surface_rim_slot(s, rim) : BW_NONE;
    if (first == 1) { /* the patch between two blocks */
        if (s->rim_edge[rim ^ 1] == BW_NONE) return BW_NONE;
        rim = bw_surface_rim_other(s, rim ^ 1, &quarters);
        if (quarters != 1) return BW_NONE;
    }
    return patch_region[bw_surface_rim_slot(s, rim) >> 1] == BW_NONE ? BW_NONE : rim;
}

static bool patch_is_critical(const bw_cells *cells, const bw_complex *x, size_t p) {
    if (x->patch_flags[p] & BW_PATCH_BOUNDARY) return true;
    for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1] && x->patch_flags[p] & BW_PATCH_FEATURE; i++)
        if (cells->polygon[x->patch_polygon[i]].flags & BW_FEATURE) return true;
    return false;
}

/* ---- arcs ---- */

enum { NOT_SET = -2 }; /* of what is critical, until it is numbered */

/* Singular arcs, features, and where critical patches do not continue flat in pairs. `uses` and `first`: appearances of an arc on rims of
 * critical patches. */
static bool arc_is_critical(const bw_surface *s, const bw_critical *c, size_t a, int32_t uses, int32_t first) {
    if (s->complex->arc_flags[a] & (BW_ARC_SINGULAR | BW_ARC_FEATURE)) return true;
    if (uses != 2) return uses > 0;
    int32_t rim = 2 * first; /* every patch has a block on its side 0 */
    int32_t on = bw_critical_continue(s, c->patch_region, rim, NULL);
    return on == BW_NONE || on >> 1 == first;
}

static bw_status mark_arcs(bw_context *ctx, const bw_surface *s, bw_critical *c) {
    const bw_complex *x = s->complex;
    int32_t *uses = bw_alloc(ctx, x->arc_count, sizeof *uses), *first = bw_alloc(ctx, x->arc_count, sizeof *first);
    if (uses && first) {
        for (size_t p = 0; p < x->patch_count; p++)
            for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4] && c->patch_region[p] != BW_NONE; i++)
                if (!uses[x->patch_chain[i] >> 1]++) first[x->patch_chain[i] >> 1] = (int32_t)i;
        for (size_t a = 0; a < x->arc_count; a++) c->arc_link[a] = arc_is_critical(s, c, a, uses[a], first[a]) ? NOT_SET : BW_NONE;
        for (size_t e = s->edge_count; e-- > 0;) c->arc_edge[s->edge[e].use >> 1] = (int32_t)e;
    }
    bw_free(ctx, uses), bw_free(ctx, first);
    return ctx->error.status;
}

/* ---- nodes ---- */

/* The star of a regular node, walked through patches: places of the node, and rotations from the chart of the first one's block. */
typedef struct {
    int32_t *point;
    bw_rotation *rotation;
    uint8_t *seen; /* [point] */
    size_t count;
} star;

static int find_direction(const bw_surface *s, star *t, int32_t start, bw_arc_use use) {
    int found = BW_NONE;
    t->count = 0;
    t->point[t->count] = start, t->rotation[t->count++] = 0;
    t->seen[start] = 1;
    for (size_t i = 0; i < t->count; i++)
        for (size_t k = s->point_rim_begin[t->point[i]]; k < s->point_rim_begin[t->point[i] + 1]; k++) {
            int32_t rim = s->point_rim[k], beside[2] = {rim, bw_surface_rim_turn(s, rim, false)};
            for (int j = 0; j < 2; j++) {
                const bw_surface_edge *e = &s->edge[s->rim_edge[beside[j]]];
                bool up = e->point[0] == t->point[i];
                if ((up ? e->use : e->use ^ 1) != use || found != BW_NONE) continue;
                bw_rotation back = bw_rotation_inverse(t->rotation[i]);
                int axis = bw_rotation_image[back][e->axis];
                found = 2 * axis + (up == (bw_rotation_sign[back][axis] > 0));
            }
            int32_t to = s->rim_point[rim ^ 1];
            if (to == BW_NONE || t->seen[to]) continue;
            bw_transition across = bw_surface_cross(s, bw_surface_rim_slot(s, rim));
            t->point[t->count] = to, t->rotation[t->count++] = bw_rotation_compose(across.rotation, t->rotation[i]);
            t->seen[to] = 1;
        }
    for (size_t i = 0; i < t->count; i++) t->seen[t->point[i]] = 0;
    return found;
}

/* Whether one critical arc runs on in another: the uses lead away from their common node. */
static bool runs_on(const bw_surface *s, const bw_critical *c, star *t, bw_arc_use a, bw_arc_use b) {
    const bw_complex *x = s->complex;
    if (x->arc_flags[a >> 1] != x->arc_flags[b >> 1] && ((x->arc_flags[a >> 1] ^ x->arc_flags[b >> 1]) & ~BW_ARC_T)) return false;
    if (x->arc_quarters[a >> 1] != x->arc_quarters[b >> 1]) return false;
    if (x->arc_flags[a >> 1] & BW_ARC_SINGULAR) return true;
    const bw_surface_edge *e = &s->edge[c->arc_edge[a >> 1]];
    int along = 2 * e->axis + (e->use == a);
    return find_direction(s, t, e->point[e->use != a], b) == (along ^ 1);
}

/* The critical uses that lead away from every node: end[2 * node + i]; more than two are only counted. */
static void list_ends(const bw_complex *x, const bw_critical *c, bw_arc_use (*end)[2], int32_t *ends) {
    for (bw_arc_use u = 0; u < 2 * (bw_arc_use)x->arc_count; u++) {
        if (c->arc_link[u >> 1] == BW_NONE) continue;
        bw_node n = bw_arc_use_start(x, u);
        if (ends[n] < 2) end[n][ends[n]] = u;
        ends[n]++;
    }
}

/* ---- links ---- */

/* Follows a link from a use to where it ends. */
static void follow(const bw_complex *x, bw_critical *c, const bw_arc_use (*end)[2], bw_arc_use use, size_t *count) {
    for (bw_node n;; use = end[n][0] == (use ^ 1) ? end[n][1] : end[n][0]) {
        if (c->arc_link[use >> 1] != NOT_SET) break; /* around */
        c->arc_link[use >> 1] = (int32_t)c->link_count;
        c->link_arc[(*count)++] = use;
        n = bw_arc_use_end(x, use);
        if (c->node[n]) break;
    }
    c->link_begin[++c->link_count] = *count;
}

static bw_status number_links(bw_context *ctx, const bw_surface *s, bw_critical *c) {
    const bw_complex *x = s->complex;
    size_t count = 0;
    bw_arc_use(*end)[2] = bw_alloc(ctx, x->node_count, sizeof *end);
    int32_t *ends = bw_alloc(ctx, x->node_count, sizeof *ends);
    star t = {bw_alloc(ctx, s->point_count, sizeof *t.point), bw_alloc(ctx, s->point_count, sizeof *t.rotation),
              bw_alloc(ctx, s->point_count, 1), 0};
    if (ctx->error.status == BW_OK) {
        list_ends(x, c, end, ends);
        for (size_t n = 0; n < x->node_count; n++) {
            bool ordinary = ends[n] == 0 || (ends[n] == 2 && runs_on(s, c, &t, end[n][0], end[n][1]));
            c->node[n] = !ordinary || x->node_flags[n] & BW_NODE_FEATURE;
            c->node_count += c->node[n];
        }
        for (int closed = 0; closed < 2; closed++) /* links with ends, then cycles */
            for (bw_arc_use u = 0; u < 2 * (bw_arc_use)x->arc_count; u++)
                if (c->arc_link[u >> 1] == NOT_SET && (closed || c->node[bw_arc_use_start(x, u)]))
                    follow(x, c, (const bw_arc_use(*)[2])end, u, &count);
    }
    bw_free(ctx, end), bw_free(ctx, ends), bw_free(ctx, t.point), bw_free(ctx, t.rotation), bw_free(ctx, t.seen);
    return ctx->error.status;
}

bool bw_critical_link_is_cycle(const bw_complex *x, const bw_critical *c, size_t link) {
    return !c->node[bw_arc_use_start(x, c->link_arc[c->link_begin[link]])];
}

/* ---- regions ---- */

static bw_status number_regions(bw_context *ctx, const bw_surface *s, bw_critical *c) {
    const bw_complex *x = s->complex;
    bw_patch *queue = bw_alloc(ctx, x->patch_count, sizeof *queue);
    for (size_t seed = 0; seed < x->patch_count && queue; seed++) {
        if (c->patch_region[seed] != NOT_SET) continue;
        size_t head = 0, tail = 0;
        queue[tail++] = (bw_patch)seed;
        c->patch_region[seed] = (int32_t)c->region_count;
        for (; head < tail; head++)
            for (size_t i = x->patch_chain_begin[4 * queue[head]]; i < x->patch_chain_begin[4 * queue[head] + 4]; i++) {
                if (c->arc_link[x->patch_chain[i] >> 1] != BW_NONE) continue;
                bw_patch on = bw_surface_rim_slot(s, bw_critical_continue(s, c->patch_region, 2 * (int32_t)i, NULL)) >> 1;
                if (c->patch_region[on] != NOT_SET) continue;
                c->patch_region[on] = (int32_t)c->region_count;
                queue[tail++] = on;
            }
        c->region_count++;
    }
    bw_free(ctx, queue);
    return ctx->error.status;
}

/* ---- what touches ---- */

static int by_number(const void *a, const void *b) {
    const int64_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Pairs (entity, what it holds) as one number each. */
static size_t list_touches(const bw_complex *x, const bw_critical *c, int64_t *out) {
    size_t n = 0;
    for (size_t v = 0; v < x->node_count; v++) out[n++] = (int64_t)v << 32 | (int64_t)v;
    for (int32_t l = 0; l < (int32_t)c->link_count; l++) {
        int64_t own = bw_critical_link_entity(c, l);
        bw_node end[2] = {bw_arc_use_start(x, c->link_arc[c->link_begin[l]]), bw_arc_use_end(x, c->link_arc[c->link_begin[l + 1] - 1])};
        out[n++] = own << 32 | own;
        for (int i = 0; i < 2; i++)
            if (c->node[end[i]]) out[n++] = own << 32 | end[i];
    }
    for (size_t p = 0; p < x->patch_count; p++) {
        if (c->patch_region[p] == BW_NONE) continue;
        int64_t own = bw_critical_region_entity(c, c->patch_region[p]);
        out[n++] = own << 32 | own;
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) {
            int32_t link = c->arc_link[x->patch_chain[i] >> 1];
            bw_node node = bw_arc_use_start(x, x->patch_chain[i]);
            if (link != BW_NONE) out[n++] = own << 32 | bw_critical_link_entity(c, link);
            if (c->node[node]) out[n++] = own << 32 | node;
        }
    }
    return n;
}

static bw_status number_touches(bw_context *ctx, const bw_complex *x, bw_critical *c) {
    size_t entities = x->node_count + c->link_count + c->region_count, count = 0;
    size_t most = x->node_count + 3 * c->link_count + x->patch_count + 2 * x->patch_chain_begin[4 * x->patch_count];
    int64_t *list = bw_alloc(ctx, most, sizeof *list);
    c->touch_begin = bw_alloc(ctx, entities + 1, sizeof *c->touch_begin);
    c->touch = bw_alloc(ctx, most, sizeof *c->touch);
    if (ctx->error.status == BW_OK) {
        size_t n = list_touches(x, c, list);
        qsort(list, n, sizeof *list, by_number);
        for (size_t i = 0; i < n; i++) {
            if (i && list[i] == list[i - 1]) continue;
            c->touch[count++] = (int32_t)(list[i] & 0x7fffffff);
            c->touch_begin[(list[i] >> 32) + 1] = count;
        }
    }
    bw_free(ctx, list);
    return ctx->error.status;
}

bool bw_critical_touch(const bw_critical *c, bw_critical_entity a, bw_critical_entity b) {
    size_t i = c->touch_begin[a], j = c->touch_begin[b];
    while (i < c->touch_begin[a + 1] && j < c->touch_begin[b + 1]) {
        if (c->touch[i] == c->touch[j]) return true;
        if (c->touch[i] < c->touch[j]) i++;
        else j++;
    }
    return false;
}

bw_status bw_critical_init(bw_context *ctx, const bw_cells *cells, const bw_surface *surface, bw_critical *c) {
    const bw_complex *x = surface->complex;
    *c = (bw_critical){.nodes = x->node_count};
    c->node = bw_alloc(ctx, x->node_count, 1);
    c->arc_link = bw_alloc(ctx, x->arc_count, sizeof *c->arc_link);
    c->patch_region = bw_alloc(ctx, x->patch_count, sizeof *c->patch_region);
    c->link_begin = bw_alloc(ctx, x->arc_count + 1, sizeof *c->link_begin);
    c->link_arc = bw_alloc(ctx, x->arc_count, sizeof *c->link_arc);
    c->arc_edge = bw_alloc(ctx, x->arc_count, sizeof *c->arc_edge);
    bw_status status = ctx->error.status;
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++)
        c->patch_region[p] = patch_is_critical(cells, x, p) ? NOT_SET : BW_NONE;
    if (status == BW_OK) status = mark_arcs(ctx, surface, c);
    if (status == BW_OK) status = number_links(ctx, surface, c);
    if (status == BW_OK) status = number_regions(ctx, surface, c);
    if (status == BW_OK) status = number_touches(ctx, x, c);
    if (status != BW_OK) bw_critical_clear(ctx, c);
    return status;
}

void bw_critical_clear(bw_context *ctx, bw_critical *c) {
    void *blocks[] = {c->node, c->arc_link, c->patch_region, c->link_begin, c->link_arc, c->touch_begin, c->touch, c->arc_edge};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    *c = (bw_critical){0};
}
