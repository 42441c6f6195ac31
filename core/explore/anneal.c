#include "explore/anneal.h"

#include <string.h>

typedef struct {
    bw_search *s;
    bw_tiling *t;
    bw_patch *list; /* walls that may go, to be tried from the end */
    size_t count, joins;
    bw_patch *free; /* patches that are not always walls */
    size_t free_count;
} annealer;

static bw_status annealer_init(bw_search *s, bw_tiling *t, annealer *a) {
    const bw_space *x = s->space;
    *a = (annealer){.s = s, .t = t};
    a->list = bw_alloc(s->ctx, 8 * x->patch_count + 1, sizeof *a->list);
    a->free = bw_alloc(s->ctx, x->patch_count, sizeof *a->free);
    for (size_t p = 0; p < x->patch_count && s->ctx->error.status == BW_OK; p++)
        if (!t->stays[p]) a->free[a->free_count++] = (bw_patch)p;
    return s->ctx->error.status;
}

static void annealer_clear(annealer *a) { bw_free(a->s->ctx, a->list), bw_free(a->s->ctx, a->free); }

static void shuffle(annealer *a, size_t from) {
    for (size_t i = a->count; i > from + 1; i--) {
        size_t j = from + bw_search_below(a->s, i - from);
        bw_patch swap = a->list[i - 1];
        a->list[i - 1] = a->list[j], a->list[j] = swap;
    }
}

/* Adds the walls of a box to the list, in a random order. */
static void add_sides(annealer *a, bw_block name) {
    size_t from = a->count;
    if (from + 2 * a->s->space->patch_count > 8 * a->s->space->patch_count) return;
    a->count += bw_tiling_sides(a->t, name, a->list + from);
    shuffle(a, from);
}

/* Joins across the listed walls, last first, what makes it no dearer; a box that grew is looked at again. Ends early if the search is cut: each join leaves a complex. */
static bw_status join_listed(annealer *a) {
    const bw_space *x = a->s->space;
    bw_status status = BW_OK;
    while (a->count && status == BW_OK) {
        bw_patch p = a->list[--a->count];
        if (!a->t->wall[p]) continue;
        size_t logged = a->t->logged;
        int64_t before = bw_pricer_total(a->t->pricer);
        bool done;
        if (++a->joins % 64 == 0 && (bw_poll(a->s->ctx) != BW_OK || bw_search_is_cut(a->s))) break;
        status = bw_tiling_join(a->s->ctx, a->t, p, &done);
        if (status != BW_OK || !done) continue;
        if (bw_pricer_total(a->t->pricer) > before) bw_tiling_undo(a->t, logged);
        else add_sides(a, a->t->box[x->patch_block[p][0]]);
    }
    return status == BW_OK ? a->s->ctx->error.status : status;
}

bw_status bw_retract(bw_search *s, bw_tiling *t) {
    annealer a;
    bw_status status = annealer_init(s, t, &a);
    for (size_t i = 0; i < a.free_count && status == BW_OK; i++)
        if (t->wall[a.free[i]]) a.list[a.count++] = a.free[i];
    if (status == BW_OK) shuffle(&a, 0);
    if (status == BW_OK) status = join_listed(&a);
    if (status == BW_OK) bw_search_offer(s, t->wall, bw_pricer_total(t->pricer), t->count);
    bw_tiling_keep(t);
    annealer_clear(&a);
    return status;
}

/* A block a few steps from another, through walls and all. */
static bw_block wander(annealer *a, bw_block from) {
    const bw_space *x = a->s->space;
    for (size_t steps = 1 + bw_search_below(a->s, 6); steps; steps--) {
        size_t sides = x->side_begin[from + 1] - x->side_begin[from];
        int32_t side = x->side[x->side_begin[from] + bw_search_below(a->s, sides)];
        bw_block next = x->patch_block[side >> 1][!(side & 1)];
        if (next != BW_NONE) from = next;
    }
    return from;
}

/* An open patch of a block, by chance; BW_NONE: none was hit. */
static bw_patch open_side(annealer *a, bw_block b) {
    const bw_space *x = a->s->space;
    size_t sides = x->side_begin[b + 1] - x->side_begin[b];
    for (int tries = 0; tries < 4; tries++) {
        bw_patch p = x->side[x->side_begin[b] + bw_search_below(a->s, sides)] >> 1;
        if (!a->t->wall[p]) return p;
    }
    return BW_NONE;
}

/* Cuts one to three boxes that lie close to each other. The walls around them are listed, those just made to be tried last. */
static bw_status cut_some(annealer *a, bw_patch at) {
    const bw_space *x = a->s->space;
    bw_status status = BW_OK;
    bw_patch made[3];
    size_t cuts = 0, wanted = (size_t[4]){1, 1, 2, 3}[bw_search_below(a->s, 4)];
    for (size_t i = 0; i < wanted && status == BW_OK; i++) {
        bool done = false;
        bw_patch p = i ? open_side(a, wander(a, x->patch_block[at][bw_search_below(a->s, 2)])) : at;
        if (p != BW_NONE) status = bw_tiling_cut(a->s->ctx, a->t, p, &done);
        if (done) made[cuts++] = p;
    }
    a->count = 0;
    for (size_t i = 0; i < cuts; i++) a->list[a->count++] = made[i];
    for (size_t i = 0; i < cuts; i++)
        for (int k = 0; k < 2; k++) add_sides(a, a->t->box[x->patch_block[made[i]][k]]);
    if (a->count > cuts) shuffle(a, cuts);
    return status;
}

bw_status bw_anneal(bw_search *s, bw_tiling *t, uint64_t rounds) {
    annealer a;
    bw_status status = annealer_init(s, t, &a);
    uint64_t begin = s->evaluations, until = rounds < UINT64_MAX - begin ? begin + rounds : UINT64_MAX;
    int64_t now = bw_pricer_total(t->pricer), hot = now / 64 + 1;
    while (status == BW_OK && a.free_count && !bw_search_spent(s, until)) {
        bw_patch p = a.free[bw_search_below(s, a.free_count)];
        double left = 1 - (double)(s->evaluations - begin) / (double)rounds;
        int64_t slack = (int64_t)((double)hot * left * left * (double)(bw_search_random(s) >> 40) / (1 << 24));
        if (t->wall[p]) a.list[0] = p, a.count = 1;
        else status = cut_some(&a, p);
        if (status == BW_OK) status = join_listed(&a);
        int64_t then = bw_pricer_total(t->pricer);
        if (s->evaluations % 256 == 0 && status == BW_OK) status = bw_poll(s->ctx);
        if (then > now + slack) {
            bw_tiling_undo(t, 0);
            continue;
        }
        now = then;
        bw_tiling_keep(t);
        bw_search_offer(s, t->wall, now, t->count);
        if (bw_pricer_bytes(t->pricer) > BW_PRICES_MOST) {
            bw_pricer_forget(s->ctx, t->pricer);
            if (status == BW_OK) status = bw_tiling_set(s->ctx, t, t->wall);
        }
    }
    annealer_clear(&a);
    return status;
}
