#include "quantize/flood.h"

#include <string.h>

enum { STATES_MAX = 1000000, SIDE_BOXES = 12 };

typedef struct {
    int64_t low[3], high[3];
} box;

struct bw_flood_state {
    bw_transition image, input; /* from the chart of the seed to that of the block: of images; of the input, in grid units */
    box part;                   /* of the seed's image, in its chart */
    int32_t before, slot;       /* the state it was reached from, and the slot crossed */
    int32_t crossing;           /* of the graph whose classes are counted: 2 * edge, + 1 if crossed back */
    int32_t home;               /* its block, or in a region its patch */
    int32_t next;               /* older state of the same home */
    int32_t level;
    bw_block block;
    int32_t rim;                /* in a region: any of its patch, seen from the block */
    int8_t side;                /* of the block, where it was entered */
};

/* ---- boxes ---- */

static bool intersect(const box *a, const box *b, box *out) {
    for (int k = 0; k < 3; k++) {
        out->low[k] = a->low[k] > b->low[k] ? a->low[k] : b->low[k];
        out->high[k] = a->high[k] < b->high[k] ? a->high[k] : b->high[k];
        if (out->low[k] > out->high[k]) return false;
    }
    return true;
}

static bool contains(const box *a, const box *b) {
    for (int k = 0; k < 3; k++)
        if (b->low[k] < a->low[k] || b->high[k] > a->high[k]) return false;
    return true;
}

static box spanned(const int64_t a[3], const int64_t b[3]) {
    box out;
    for (int k = 0; k < 3; k++) {
        out.low[k] = a[k] < b[k] ? a[k] : b[k];
        out.high[k] = a[k] < b[k] ? b[k] : a[k];
    }
    return out;
}

static box carry(const bw_transition *t, const box *b) {
    int64_t low[3], high[3];
    bw_transition_apply(t, b->low, low);
    bw_transition_apply(t, b->high, high);
    return spanned(low, high);
}

/* ---- cells ---- */

/* Two points between which a cell lies. */
static void cell_ends(const bw_surface *s, bw_critical_cell cell, int32_t end[2]) {
    end[0] = end[1] = cell.place;
    if (cell.kind == BW_CELL_ARC) memcpy(end, s->edge[cell.place].point, sizeof s->edge->point);
    if (cell.kind == BW_CELL_PATCH) memcpy(end, s->slot_corner[cell.place], sizeof *s->slot_corner);
}

bw_block bw_critical_cell_block(const bw_surface *s, bw_critical_cell cell) {
    if (cell.kind == BW_CELL_PATCH) return bw_surface_slot_block(s, cell.place);
    return s->point[cell.kind == BW_CELL_ARC ? s->edge[cell.place].point[0] : cell.place].block;
}

bw_critical_entity bw_critical_cell_entity(const bw_surface *s, const bw_critical *c, bw_critical_cell cell) {
    if (cell.kind == BW_CELL_PATCH) return bw_critical_region_entity(c, c->patch_region[cell.place >> 1]);
    if (cell.kind == BW_CELL_ARC) return bw_critical_link_entity(c, c->arc_link[s->edge[cell.place].use >> 1]);
    return s->point[cell.place].node;
}

static box image_of(const bw_flood *f, bw_critical_cell cell) {
    int32_t end[2];
    cell_ends(f->surface, cell, end);
    return spanned(f->at[end[0]], f->at[end[1]]);
}

/* ---- setting up ---- */

bw_status bw_flood_init(bw_context *ctx, const bw_surface *surface, const bw_critical *critical, const bw_loops *loops, bw_flood *f) {
    const bw_complex *x = surface->complex;
    size_t homes = x->block_count > x->patch_count ? x->block_count : x->patch_count;
    *f = (bw_flood){.ctx = ctx, .surface = surface, .critical = critical, .loops = loops};
    f->at = bw_alloc(ctx, surface->point_count, sizeof *f->at);
    f->cross = bw_alloc(ctx, 2 * x->patch_count, sizeof *f->cross);
    f->last = bw_alloc(ctx, homes, sizeof *f->last);
    if (ctx->error.status == BW_OK) memset(f->last, 0xff, homes * sizeof *f->last);
    else bw_flood_clear(f);
    return ctx->error.status;
}

void bw_flood_clear(bw_flood *f) {
    void *blocks[] = {f->at, f->cross, f->state, f->class_, f->last, f->meeting};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks && f->ctx; i++) bw_free(f->ctx, blocks[i]);
    *f = (bw_flood){0};
}

void bw_flood_lay_out(bw_flood *f, const int64_t *length) {
    const bw_surface *s = f->surface;
    bw_surface_lay_out(s, length, f->at);
    for (int32_t slot = 0; slot < 2 * (int32_t)s->complex->patch_count; slot++) {
        if (s->complex->patch_block[slot >> 1][1] == BW_NONE) continue;
        int32_t rim = bw_surface_first_rim(s, slot);
        const int64_t *here = f->at[s->rim_point[rim]], *there = f->at[s->rim_point[rim ^ 1]];
        bw_transition *t = &f->cross[slot];
        t->rotation = bw_surface_cross(s, slot).rotation;
        bw_rotate(t->rotation, here, t->shift);
        for (int k = 0; k < 3; k++) t->shift[k] = there[k] - t->shift[k];
    }
}

/* ---- states ---- */

int32_t bw_flood_before(const bw_flood *f, int32_t state, int32_t *slot) {
    *slot = f->state[state].slot;
    return f->state[state].before;
}

/* Whether the points of b's part are where state a has them too. */
static bool covers(const bw_flood_state *a, const bw_flood_state *b, bool inside) {
    if (!contains(&a->part, &b->part) || (a->side != b->side && !inside)) return false;
    int64_t x[3], y[3];
    bw_transition_apply(&a->image, b->part.low, x);
    bw_transition_apply(&b->image, b->part.low, y);
    if (memcmp(x, y, sizeof x)) return false;
    for (int k = 0; k < 3; k++) { /* axes along which the part extends go the same way */
        int8_t i = bw_rotation_image[a->image.rotation][k], j = bw_rotation_image[b->image.rotation][k];
        bool same = i == j && bw_rotation_sign[a->image.rotation][i] == bw_rotation_sign[b->image.rotation][j];
        if (b->part.low[k] < b->part.high[k] && !same) return false;
    }
    return true;
}

static box block_box(const bw_flood *f, bw_block b) { /* a block's points ascend by coordinates: its corners are first and last */
    box out = {{0, 0, 0}, {0, 0, 0}};
    memcpy(out.high, f->at[f->surface->point_begin[b + 1] - 1], sizeof out.high);
    return out;
}

/* Whether the two ways by which states a and b reach one block are a loop that moves every point of the input. */
static bool moves_all(const bw_flood_state *a, const bw_flood_state *b) {
    bw_transition back = bw_transition_inverse(&a->input), around = bw_transition_compose(&back, &b->input);
    int64_t sum[3] = {0, 0, 0}, turned[3];
    memcpy(turned, around.shift, sizeof turned);
    for (int order = 0; order < 12; order++) { /* 12 is a multiple of the order of every rotation: the sum is 12 times the shift along its axis */
        for (int k = 0; k < 3; k++) sum[k] += turned[k];
        bw_rotate(around.rotation, turned, turned);
    }
    return sum[0] || sum[1] || sum[2];
}

/* Adds a state, unless its home was reached with the same images before; then the two ways there may be a loop. */
static bw_status add_state(bw_flood *f, const bw_flood_state *n) {
    const bw_cocycles *loops = f->kind == BW_MEET_NOTHING ? &f->loops->region : &f->loops->volume;
    size_t rank = loops->rank, at = f->state_count;
    if (bw_reserve(f->ctx, &f->state, &f->state_room, at + 1) || bw_reserve(f->ctx, &f->class_, &f->class_room, (at + 1) * rank))
        return f->ctx->error.status;
    for (size_t i = 0; i < rank; i++) {
        int64_t step = n->crossing == BW_NONE ? 0 : loops->value[(size_t)(n->crossing >> 1) * rank + i];
        f->class_[at * rank + i] = n->before == BW_NONE ? 0 : f->class_[(size_t)n->before * rank + i] + (n->crossing & 1 ? -step : step);
    }
    box own = block_box(f, n->block), there = carry(&n->image, &n->part);
    bool inside = contains(&own, &there);
    for (int32_t i = f->last[n->home]; i != BW_NONE; i = f->state[i].next) {
        if (!covers(&f->state[i], n, inside)) continue;
        bool loop = moves_all(&f->state[i], n) || (rank && memcmp(f->class_ + at * rank, f->class_ + (size_t)i * rank, rank * sizeof *f->class_));
        if (loop && f->loop[0] == BW_NONE) f->loop[0] = n->before, f->loop[1] = i, f->loop[2] = n->slot;
        return BW_OK;
    }
    if (at >= STATES_MAX) return bw_fail(f->ctx, BW_E_LIMIT, "a search for what coincides under a quantization has too many states");
    f->state[at] = *n;
    f->state[at].next = f->last[n->home];
    f->last[n->home] = (int32_t)f->state_count++;
    return BW_OK;
}

/* ---- meetings ---- */

/* The box of a cell in the input, in the chart of its block. */
static box input_of(const bw_flood *f, bw_critical_cell cell) {
    int32_t end[2];
    cell_ends(f->surface, cell, end);
    return spanned(f->surface->point[end[0]].at, f->surface->point[end[1]].at);
}

static bw_status meet(bw_flood *f, int32_t state, bw_critical_cell cell) {
    bw_transition back = bw_transition_inverse(&f->state[state].input);
    box own = input_of(f, f->seed), there = input_of(f, cell);
    there = carry(&back, &there);
    bw_meeting m = {.state = state, .cell = cell};
    bool apart = false, across = false;
    for (int k = 0; k < 3; k++) {
        m.gap[k] = there.low[k] > own.high[k] ? there.low[k] - own.high[k] : there.high[k] < own.low[k] ? there.high[k] - own.low[k] : 0;
        bool extends = own.low[k] < own.high[k] || there.low[k] < there.high[k];
        if (m.gap[k] && extends) m.along |= (uint8_t)(1u << k);
        apart = apart || m.gap[k], across = across || (m.gap[k] && !extends);
    }
    if (f->kind == BW_MEET_APART) {
        bw_critical_entity a = bw_critical_cell_entity(f->surface, f->critical, f->seed);
        if (!apart || bw_critical_touch(f->critical, a, bw_critical_cell_entity(f->surface, f->critical, cell))) return BW_OK;
    } else if (!across) {
        return BW_OK;
    }
    if (bw_reserve(f->ctx, &f->meeting, &f->meeting_room, f->meeting_count + 1)) return f->ctx->error.status;
    f->meeting[f->meeting_count++] = m;
    return BW_OK;
}

bool bw_flood_faces(const bw_flood *f, const bw_meeting *m, bool other, int32_t point) {
    box own = input_of(f, other ? m->cell : f->seed);
    int64_t at[3];
    memcpy(at, f->surface->point[point].at, sizeof at);
    if (other) {
        bw_transition back = bw_transition_inverse(&f->state[m->state].input);
        own = carry(&back, &own);
        bw_transition_apply(&back, at, at);
    }
    for (int k = 0; k < 3; k++)
        if (m->along >> k & 1 && at[k] != ((m->gap[k] > 0) == other ? own.low[k] : own.high[k])) return false;
    return true;
}

/* What is critical on a patch where the images `part` are. */
static bw_status meet_patch(bw_flood *f, int32_t state, int32_t slot, const box *part) {
    const bw_surface *s = f->surface;
    const bw_critical *c = f->critical;
    box common;
    if (c->patch_region[slot >> 1] != BW_NONE && meet(f, state, (bw_critical_cell){BW_CELL_PATCH, slot})) return f->ctx->error.status;
    for (int32_t rim = bw_surface_first_rim(s, slot); rim < bw_surface_last_rim(s, slot); rim += 2) {
        const bw_surface_edge *e = &s->edge[s->rim_edge[rim]];
        bw_critical_cell arc = {BW_CELL_ARC, s->rim_edge[rim]}, node = {BW_CELL_NODE, s->rim_point[rim]};
        box image = spanned(f->at[e->point[0]], f->at[e->point[1]]);
        if (c->arc_link[e->use >> 1] != BW_NONE && intersect(part, &image, &common) && meet(f, state, arc)) return f->ctx->error.status;
        if (f->kind != BW_MEET_NODES || !c->node[s->point[node.place].node]) continue;
        image = spanned(f->at[node.place], f->at[node.place]);
        if (contains(part, &image) && meet(f, state, node)) return f->ctx->error.status;
    }
    return BW_OK;
}

/* ---- spreading ---- */

/* The state after `from`, of which only the images `part` go on. */
static bw_flood_state follow(const bw_flood_state *from, int32_t state, const box *part) {
    bw_transition back = bw_transition_inverse(&from->image);
    bw_flood_state n = *from;
    n.part = carry(&back, part);
    n.before = state, n.level = from->level + 1;
    return n;
}

/* Carries a state through a slot. */
static void cross(const bw_flood *f, int32_t slot, bw_flood_state *n) {
    bw_transition across = bw_surface_cross(f->surface, slot);
    n->slot = slot;
    n->side = (int8_t)bw_surface_slot_side(f->surface, slot ^ 1);
    n->image = bw_transition_compose(&f->cross[slot], &n->image);
    n->input = bw_transition_compose(&across, &n->input);
}

/* The state's images `part` are on a patch: what they meet there, and on through the patch. */
static bw_status visit(bw_flood *f, int32_t state, int32_t slot, const box *part) {
    const bw_surface *s = f->surface;
    if (meet_patch(f, state, slot, part)) return f->ctx->error.status;
    bw_block beyond = bw_surface_slot_block(s, slot ^ 1);
    if (beyond == BW_NONE) return BW_OK;
    bw_flood_state n = follow(&f->state[state], state, part);
    n.crossing = slot, n.block = n.home = beyond;
    cross(f, slot, &n);
    return add_state(f, &n);
}

typedef struct {
    box part;
    int side;
} side_box;

/* The images on sides of a block that need not be in its box: those it was entered with, and where an edge's arcs hold them, on the side beyond the edge. */
static size_t carry_along(const bw_flood *f, bw_block b, side_box *list) {
    const bw_surface *s = f->surface;
    size_t n = 1;
    for (size_t i = 0; i < n; i++)
        for (size_t e = s->edge_begin[b]; e < s->edge_begin[b + 1] && n < SIDE_BOXES; e++) {
            int side[2];
            for (int j = 0; j < 2; j++) side[j] = bw_surface_slot_side(s, bw_surface_rim_slot(s, s->edge[e].rim[j]));
            if (side[0] == side[1] || (side[0] != list[i].side && side[1] != list[i].side)) continue;
            box image = spanned(f->at[s->edge[e].point[0]], f->at[s->edge[e].point[1]]);
            side_box on = {.side = side[side[0] == list[i].side]};
            if (!intersect(&list[i].part, &image, &on.part)) continue;
            bool known = false;
            for (size_t k = 0; k < n; k++) known = known || (list[k].side == on.side && contains(&list[k].part, &on.part));
            if (!known) list[n++] = on;
        }
    return n;
}

static bw_status spread(bw_flood *f, int32_t state) {
    const bw_surface *s = f->surface;
    bw_block b = f->state[state].block;
    box own = block_box(f, b), body, part, again;
    side_box list[SIDE_BOXES] = {{carry(&f->state[state].image, &f->state[state].part), f->state[state].side}};
    bool enters = intersect(&list[0].part, &own, &body);
    size_t sides = contains(&own, &list[0].part) ? 0 : carry_along(f, b, list);
    for (size_t i = s->slot_begin[b]; i < s->slot_begin[b + 1]; i++) {
        int32_t slot = s->slot[i];
        box image = spanned(f->at[s->slot_corner[slot][0]], f->at[s->slot_corner[slot][1]]);
        bool through = enters && intersect(&body, &image, &part);
        if (through && visit(f, state, slot, &part)) return f->ctx->error.status;
        for (size_t k = 0; k < sides; k++)
            if (list[k].side == bw_surface_slot_side(s, slot) && intersect(&list[k].part, &image, &again) &&
                !(through && contains(&part, &again)) && visit(f, state, slot, &again))
                return f->ctx->error.status;
    }
    return BW_OK;
}

/* Within a region, from a patch across the arcs that the images are on. */
static bw_status spread_in_region(bw_flood *f, int32_t state) {
    const bw_surface *s = f->surface;
    int32_t slot = bw_surface_rim_slot(s, f->state[state].rim), crossed;
    box images = carry(&f->state[state].image, &f->state[state].part), part;
    for (int32_t rim = bw_surface_first_rim(s, slot); rim < bw_surface_last_rim(s, slot); rim += 2) {
        const bw_surface_edge *e = &s->edge[s->rim_edge[rim]];
        bw_arc a = e->use >> 1;
        box image = spanned(f->at[e->point[0]], f->at[e->point[1]]);
        if (f->critical->arc_link[a] != BW_NONE || !intersect(&images, &image, &part)) continue;
        bw_flood_state n = follow(&f->state[state], state, &part);
        n.rim = bw_critical_continue(s, f->critical->patch_region, rim, &crossed);
        n.crossing = 2 * a + (f->loops->arc_use[a][0] != rim >> 1);
        n.slot = BW_NONE;
        if (crossed != BW_NONE) cross(f, crossed, &n);
        slot = bw_surface_rim_slot(s, n.rim);
        n.home = slot >> 1, n.block = bw_surface_slot_block(s, slot), n.side = (int8_t)bw_surface_slot_side(s, slot);
        slot = bw_surface_rim_slot(s, rim);
        if (add_state(f, &n)) return f->ctx->error.status;
    }
    return BW_OK;
}

/* Any side of its block that a cell lies on. */
static int cell_side(const bw_surface *s, bw_critical_cell cell) {
    if (cell.kind == BW_CELL_PATCH) return bw_surface_slot_side(s, cell.place);
    int32_t rim = cell.kind == BW_CELL_ARC ? s->edge[cell.place].rim[0] : s->point_rim[s->point_rim_begin[cell.place]];
    return bw_surface_slot_side(s, bw_surface_rim_slot(s, rim));
}

bw_status bw_flood_run(bw_flood *f, bw_critical_cell seed, bw_meeting_kind kind) {
    bool in_region = kind == BW_MEET_NOTHING;
    f->state_count = f->meeting_count = 0;
    f->loop[0] = BW_NONE;
    f->seed = seed, f->kind = kind;
    bw_flood_state first = {.part = image_of(f, seed), .before = BW_NONE, .slot = BW_NONE, .crossing = BW_NONE, .next = BW_NONE};
    first.block = first.home = bw_critical_cell_block(f->surface, seed);
    first.side = (int8_t)cell_side(f->surface, seed);
    if (in_region) first.home = seed.place >> 1, first.rim = bw_surface_first_rim(f->surface, seed.place);
    bw_status status = add_state(f, &first);
    for (size_t i = 0; i < f->state_count && status == BW_OK; i++) {
        if (f->meeting_count && f->state[i].level > f->state[f->meeting[0].state].level) break;
        if (i % 256 == 255 && bw_poll(f->ctx)) break;
        status = in_region ? spread_in_region(f, (int32_t)i) : spread(f, (int32_t)i);
    }
    for (size_t i = 0; i < f->state_count; i++) f->last[f->state[i].home] = BW_NONE;
    return status == BW_OK ? bw_poll(f->ctx) : status;
}
