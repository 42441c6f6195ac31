#include "quantize/surface.h"

#include <stdlib.h>
#include <string.h>

/* ---- walking ---- */

int32_t bw_surface_rim_turn(const bw_surface *s, int32_t rim, bool forward) {
    int32_t slot = bw_surface_rim_slot(s, rim), first = bw_surface_first_rim(s, slot), last = bw_surface_last_rim(s, slot);
    if (forward) return rim + 2 == last ? first : rim + 2;
    return rim == first ? last - 2 : rim - 2;
}

int32_t bw_surface_rim_end(const bw_surface *s, int32_t rim) {
    const bw_surface_edge *e = &s->edge[s->rim_edge[rim]];
    return e->point[e->point[0] == s->rim_point[rim]];
}

int32_t bw_surface_rim_other(const bw_surface *s, int32_t rim, int *quarters) {
    const bw_surface_edge *e = &s->edge[s->rim_edge[rim]];
    int32_t other = e->rim[e->rim[0] == rim];
    int side = bw_surface_slot_side(s, bw_surface_rim_slot(s, rim));
    *quarters = bw_surface_slot_side(s, bw_surface_rim_slot(s, other)) == side ? 2 : 1;
    return other;
}

bw_transition bw_surface_cross(const bw_surface *s, int32_t slot) {
    return slot & 1 ? s->across[slot >> 1] : bw_transition_inverse(&s->across[slot >> 1]);
}

void bw_surface_lay_out(const bw_surface *s, const int64_t *length, int64_t (*at)[3]) {
    size_t blocks = s->complex->block_count;
    for (size_t b = 0; b < blocks; b++) memset(at[s->point_begin[b]], 0, sizeof *at);
    for (size_t i = 0; i < s->point_count - blocks; i++) {
        const bw_surface_edge *e = &s->edge[s->step[i][0]];
        int32_t to = s->step[i][1], from = e->point[e->point[0] == to];
        memcpy(at[to], at[from], sizeof *at);
        at[to][e->axis] += to == e->point[1] ? length[e->use >> 1] : -length[e->use >> 1];
    }
}

/* ---- setting up ---- */

/* Where a rim starts. */
typedef struct {
    int64_t at[3];
    bw_block block;
    int32_t rim;
} start;

/* A rim as an edge: equal but for the rim where two rims are one edge. */
typedef struct {
    int32_t low, high, arc, rim;
} piece;

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    bw_surface *s;
    start *list; /* of all rims that a block has */
    piece *pieces;
    size_t count;
} setup;

static int compare_places(const start *x, const start *y) {
    if (x->block != y->block) return x->block < y->block ? -1 : 1;
    for (int k = 0; k < 3; k++)
        if (x->at[k] != y->at[k]) return x->at[k] < y->at[k] ? -1 : 1;
    return 0;
}

static int compare_starts(const void *a, const void *b) {
    const start *x = a, *y = b;
    int order = compare_places(x, y);
    return order ? order : (x->rim > y->rim) - (x->rim < y->rim);
}

static int compare_edges(const piece *x, const piece *y) {
    if (x->low != y->low) return x->low < y->low ? -1 : 1;
    if (x->high != y->high) return x->high < y->high ? -1 : 1;
    return (x->arc > y->arc) - (x->arc < y->arc);
}

static int compare_pieces(const void *a, const void *b) {
    const piece *x = a, *y = b;
    int order = compare_edges(x, y);
    return order ? order : (x->rim > y->rim) - (x->rim < y->rim);
}

/* The rim of a slot, walked in the chart of its block: sides 0 and 2 run along the axis after the normal of the first block, forth and back, sides 1
 * and 3 along the next one (complex/chains.c). */
static void walk_slot(setup *u, int32_t slot) {
    const bw_complex *x = u->s->complex;
    size_t p = (size_t)slot >> 1;
    int normal = x->patch_side[p][0] >> 1;
    bw_transition chart = {{0, 0, 0}, 0};
    if (slot & 1) chart = bw_transition_inverse(&u->s->across[p]);
    int64_t at[3];
    memcpy(at, x->patch_low[p], sizeof at);
    for (size_t side = 0; side < 4; side++)
        for (size_t i = x->patch_chain_begin[4 * p + side]; i < x->patch_chain_begin[4 * p + side + 1]; i++) {
            start *r = &u->list[u->count++];
            r->block = bw_surface_slot_block(u->s, slot);
            r->rim = 2 * (int32_t)i + (slot & 1);
            bw_transition_apply(&chart, at, r->at);
            int64_t length = x->arc_length[x->patch_chain[i] >> 1];
            at[(normal + 1 + (int)(side & 1)) % 3] += side < 2 ? length : -length;
        }
}

static void list_slots(setup *u) {
    const bw_complex *x = u->s->complex;
    for (size_t p = 0; p < x->patch_count; p++) {
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) u->s->use_patch[i] = (bw_patch)p;
        if (x->patch_block[p][1] != BW_NONE) u->s->across[p] = bw_complex_across(u->cells, x, (bw_patch)p);
        for (int i = 0; i < 2; i++) {
            if (x->patch_block[p][i] == BW_NONE) continue;
            u->s->slot_begin[x->patch_block[p][i] + 2]++;
            walk_slot(u, 2 * (int32_t)p + i);
        }
    }
    for (size_t b = 2; b < x->block_count + 2; b++) u->s->slot_begin[b] += u->s->slot_begin[b - 1];
    for (size_t p = 0; p < x->patch_count; p++)
        for (int i = 0; i < 2; i++)
            if (x->patch_block[p][i] != BW_NONE) u->s->slot[u->s->slot_begin[x->patch_block[p][i] + 1]++] = 2 * (int32_t)p + i;
}

static bw_status number_points(setup *u) {
    bw_surface *s = u->s;
    for (size_t i = 0; i < u->count; i++) {
        const start *r = &u->list[i];
        bw_node node = bw_arc_use_start(s->complex, s->complex->patch_chain[r->rim >> 1]);
        if (!i || compare_places(r, r - 1)) {
            bw_surface_point *p = &s->point[s->point_count];
            memcpy(p->at, r->at, sizeof p->at);
            p->node = node, p->block = r->block;
            s->point_rim_begin[s->point_count++] = i;
        } else if (s->point[s->point_count - 1].node != node) {
            return bw_fail(u->ctx, BW_E_CHECK, "block surfaces: nodes %d and %d lie in one place of block %d", node,
                           s->point[s->point_count - 1].node, r->block);
        }
        s->rim_point[r->rim] = (int32_t)s->point_count - 1;
        s->point_rim[i] = r->rim;
    }
    s->point_rim_begin[s->point_count] = u->count;
    for (size_t i = s->point_count; i-- > 0;) s->point_begin[s->point[i].block] = i;
    s->point_begin[s->complex->block_count] = s->point_count;
    return BW_OK;
}

static void set_edge(bw_surface *s, const piece *c, bw_surface_edge *e) {
    const int64_t *low = s->point[c->low].at, *high = s->point[c->high].at;
    *e = (bw_surface_edge){.point = {c->low, c->high}, .rim = {c->rim, BW_NONE}};
    e->use = s->complex->patch_chain[c->rim >> 1] ^ (s->rim_point[c->rim] != c->low);
    while (e->axis < 2 && low[e->axis] == high[e->axis]) e->axis++;
}

static bw_status number_edges(setup *u) {
    bw_surface *s = u->s;
    for (size_t i = 0; i < u->count; i++) {
        int32_t rim = u->list[i].rim, slot = bw_surface_rim_slot(s, rim), last = bw_surface_last_rim(s, slot);
        int32_t from = s->rim_point[rim], to = s->rim_point[rim + 2 == last ? bw_surface_first_rim(s, slot) : rim + 2];
        u->pieces[i] = (piece){from < to ? from : to, from < to ? to : from, s->complex->patch_chain[rim >> 1] >> 1, rim};
    }
    if (u->count) qsort(u->pieces, u->count, sizeof *u->pieces, compare_pieces);
    for (size_t i = 0; i < u->count; i++) {
        const piece *c = &u->pieces[i];
        bool is_new = !i || compare_edges(c, c - 1);
        bw_surface_edge *e = &s->edge[is_new ? s->edge_count : s->edge_count - 1];
        if (is_new) {
            set_edge(s, c, e);
            s->edge_begin[s->point[c->low].block + 1] = ++s->edge_count;
        } else {
            e->rim[1] = c->rim;
        }
        s->rim_edge[c->rim] = (int32_t)s->edge_count - 1;
        bool ends = i + 1 == u->count || compare_edges(c, c + 1);
        if (ends == is_new)
            return bw_fail(u->ctx, BW_E_CHECK, "block surfaces: arc %d does not join two patches of block %d", c->arc, s->point[c->low].block);
    }
    for (size_t b = 0; b < s->complex->block_count; b++)
        if (s->edge_begin[b + 1] == 0) s->edge_begin[b + 1] = s->edge_begin[b];
    return BW_OK;
}

static void find_corners(bw_surface *s) {
    for (int32_t slot = 0; slot < 2 * (int32_t)s->complex->patch_count; slot++) {
        int32_t *corner = s->slot_corner[slot];
        corner[0] = corner[1] = BW_NONE;
        if (bw_surface_slot_block(s, slot) == BW_NONE) continue;
        for (int32_t rim = bw_surface_first_rim(s, slot); rim < bw_surface_last_rim(s, slot); rim += 2) {
            int32_t p = s->rim_point[rim]; /* points ascend by coordinates, the first one first: in a rectangle the corners are first and last */
            if (corner[0] == BW_NONE || p < corner[0]) corner[0] = p;
            if (corner[1] == BW_NONE || p > corner[1]) corner[1] = p;
        }
    }
}

/* Reaches all points of every block from its low corner, along edges. */
static bw_status order_points(setup *u) {
    bw_surface *s = u->s;
    uint8_t *reached = bw_alloc(u->ctx, s->point_count, 1);
    int32_t *queue = bw_alloc(u->ctx, s->point_count, sizeof *queue);
    size_t steps = 0;
    for (size_t b = 0; b < s->complex->block_count && queue && reached; b++) {
        size_t head = 0, tail = 0;
        queue[tail++] = (int32_t)s->point_begin[b];
        reached[s->point_begin[b]] = 1;
        for (; head < tail; head++)
            for (size_t i = s->point_rim_begin[queue[head]]; i < s->point_rim_begin[queue[head] + 1]; i++) {
                int32_t to = bw_surface_rim_end(s, s->point_rim[i]);
                if (reached[to]) continue;
                reached[to] = 1;
                s->step[steps][0] = s->rim_edge[s->point_rim[i]], s->step[steps++][1] = to;
                queue[tail++] = to;
            }
        if (tail != s->point_begin[b + 1] - s->point_begin[b]) bw_fail(u->ctx, BW_E_CHECK, "block surfaces: that of block %zu is in pieces", b);
    }
    bw_free(u->ctx, reached), bw_free(u->ctx, queue);
    return u->ctx->error.status;
}

static bw_status allocate(setup *u) {
    bw_surface *s = u->s;
    const bw_complex *x = s->complex;
    size_t uses = x->patch_chain_begin[4 * x->patch_count];
    u->list = bw_alloc(u->ctx, 2 * uses, sizeof *u->list);
    u->pieces = bw_alloc(u->ctx, 2 * uses, sizeof *u->pieces);
    s->point_begin = bw_alloc(u->ctx, x->block_count + 1, sizeof *s->point_begin);
    s->point = bw_alloc(u->ctx, 2 * uses, sizeof *s->point);
    s->edge_begin = bw_alloc(u->ctx, x->block_count + 1, sizeof *s->edge_begin);
    s->edge = bw_alloc(u->ctx, uses, sizeof *s->edge);
    s->slot_begin = bw_alloc(u->ctx, x->block_count + 2, sizeof *s->slot_begin);
    s->slot = bw_alloc(u->ctx, 2 * x->patch_count, sizeof *s->slot);
    s->slot_corner = bw_alloc(u->ctx, 2 * x->patch_count, sizeof *s->slot_corner);
    s->use_patch = bw_alloc(u->ctx, uses, sizeof *s->use_patch);
    s->rim_point = bw_alloc(u->ctx, 2 * uses, sizeof *s->rim_point);
    s->rim_edge = bw_alloc(u->ctx, 2 * uses, sizeof *s->rim_edge);
    s->point_rim_begin = bw_alloc(u->ctx, 2 * uses + 1, sizeof *s->point_rim_begin);
    s->point_rim = bw_alloc(u->ctx, 2 * uses, sizeof *s->point_rim);
    s->across = bw_alloc(u->ctx, x->patch_count, sizeof *s->across);
    s->step = bw_alloc(u->ctx, 2 * uses, sizeof *s->step);
    if (u->ctx->error.status != BW_OK) return u->ctx->error.status;
    memset(s->rim_point, 0xff, 2 * uses * sizeof *s->rim_point);
    memset(s->rim_edge, 0xff, 2 * uses * sizeof *s->rim_edge);
    return BW_OK;
}

bw_status bw_surface_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_surface *surface) {
    *surface = (bw_surface){.complex = complex};
    setup u = {.ctx = ctx, .cells = cells, .s = surface};
    bw_status status = allocate(&u);
    if (status == BW_OK) {
        list_slots(&u);
        if (u.count) qsort(u.list, u.count, sizeof *u.list, compare_starts);
        status = number_points(&u);
    }
    if (status == BW_OK) status = number_edges(&u);
    if (status == BW_OK) find_corners(surface);
    if (status == BW_OK) status = order_points(&u);
    bw_free(ctx, u.list), bw_free(ctx, u.pieces);
    if (status != BW_OK) bw_surface_clear(ctx, surface);
    return status;
}

void bw_surface_clear(bw_context *ctx, bw_surface *s) {
    void *blocks[] = {s->point_begin, s->point, s->edge_begin, s->edge, s->slot_begin, s->slot, s->slot_corner, s->use_patch, s->rim_point,
                      s->rim_edge, s->point_rim_begin, s->point_rim, s->across, s->step};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    *s = (bw_surface){0};
}
