#include "explore/enumerate.h"

#include <stdlib.h>
#include <string.h>

#include "explore/hashset.h"
#include "explore/tree.h"

enum { ROOT = -1, NOT_FOUND = -2 };

/* How a state came about: the sheet chosen in the state before it. */
typedef struct {
    int32_t before; /* ROOT: the root */
    int32_t sheet;
} origin;

typedef struct {
    int64_t rank;
    uint32_t state, sheet; /* the state of this level, the sheet to choose there */
} child;

typedef struct {
    bw_search *s;
    bw_tree tree;
    const uint8_t *around;
    uint64_t *level, *next;    /* states */
    size_t level_count, next_count, level_room, next_room;
    int32_t *level_origin, *next_origin;
    size_t level_origin_room, next_origin_room;
    origin *origins;
    size_t origin_count, origin_room;
    child *children;
    size_t child_count, child_room;
    bool open;                 /* a state of this level is no leaf */
    bw_hashset seen, settled, leaves;
    uint64_t *state;           /* scratch */
    uint8_t *wall;             /* scratch [patch] */
    int64_t best;
    int32_t best_origin;
    bw_enumeration *found;
} enumerator;

static bw_status enumerator_init(enumerator *e, bw_search *s, const uint8_t *around, int32_t component, bw_enumeration *found) {
    *e = (enumerator){.s = s, .around = around, .best = INT64_MAX, .best_origin = NOT_FOUND, .found = found};
    *found = (bw_enumeration){.best = INT64_MAX};
    bw_status status = bw_tree_init(s->ctx, s->space, component, &e->tree);
    e->state = bw_alloc(s->ctx, e->tree.words, sizeof *e->state);
    e->wall = bw_alloc(s->ctx, s->space->patch_count, 1);
    found->sheets = e->tree.count;
    return status == BW_OK ? s->ctx->error.status : status;
}

static void enumerator_clear(enumerator *e) {
    bw_context *ctx = e->s->ctx;
    bw_tree_clear(ctx, &e->tree);
    void *blocks[] = {e->level, e->next, e->level_origin, e->next_origin, e->origins, e->children, e->state, e->wall};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    bw_hashset_clear(ctx, &e->seen), bw_hashset_clear(ctx, &e->settled), bw_hashset_clear(ctx, &e->leaves);
}

/* The walls of a state, with those of the other components. */
static void put_walls(enumerator *e, const uint64_t *state) {
    memcpy(e->wall, e->around, e->s->space->patch_count);
    for (size_t i = 0; i < e->tree.wall_words; i++)
        for (uint64_t bits = state[i]; bits; bits &= bits - 1) e->wall[64 * i + (size_t)__builtin_ctzll(bits)] = 1;
}

static bw_status price(enumerator *e, const uint64_t *state, int64_t *cost) {
    put_walls(e, state);
    return bw_search_price(e->s, e->wall, cost);
}

static bw_status take_leaf(enumerator *e, const uint64_t *state, int32_t from) {
    bool added;
    int64_t cost;
    bw_status status = bw_hashset_add(e->s->ctx, &e->leaves, bw_tree_hash_walls(&e->tree, state), &added);
    if (status != BW_OK || !added) return status;
    status = price(e, state, &cost);
    if (status == BW_OK && cost < e->best) e->best = cost, e->best_origin = from;
    return status;
}

static bw_status add_origin(enumerator *e, int32_t before, size_t sheet, int32_t *at) {
    bw_status status = bw_reserve(e->s->ctx, &e->origins, &e->origin_room, e->origin_count + 1);
    if (status != BW_OK) return status;
    *at = (int32_t)e->origin_count;
    e->origins[e->origin_count++] = (origin){before, (int32_t)sheet};
    return BW_OK;
}

/* The order of the best leaf: the choices that led to it, and what settled between them. */
static void replay(enumerator *e, int32_t leaf, bw_sheet *order) {
    size_t inserted = 0, at = e->tree.count; /* choices are put down from the end, where what is inserted comes only after they are made */
    for (int32_t i = leaf; i >= 0; i = e->origins[i].before) order[--at] = e->origins[i].sheet;
    bw_tree_root(&e->tree, e->state);
    while (bw_tree_settle(&e->tree, e->state, order, &inserted)) {
        int32_t sheet = order[at++];
        bw_tree_choose(&e->tree, e->state, (size_t)sheet);
        order[inserted++] = e->tree.sheet[sheet];
    }
}

/* ---- level by level ------------------------------------------------------------------------------------------------ */

static bool in_reach(const enumerator *e, uint64_t until) {
    return e->s->cut == BW_CUT_NOT && e->s->evaluations < until && e->s->evaluations < e->s->work;
}

static bw_status list_children(enumerator *e, size_t state, bw_explore_expand expand) {
    const uint64_t *words = e->level + state * e->tree.words;
    bw_status status = bw_reserve(e->s->ctx, &e->children, &e->child_room, e->child_count + e->tree.count);
    size_t first = e->child_count;
    for (size_t i = 0; i < e->tree.count && status == BW_OK; i++)
        if (bw_tree_bit(words + e->tree.wall_words, i)) e->children[e->child_count++] = (child){0, (uint32_t)state, (uint32_t)i};
    e->open = true;
    for (size_t i = first; i < e->child_count && status == BW_OK && e->s->cut == BW_CUT_NOT; i++) {
        child *c = &e->children[i];
        if (expand == BW_EXPLORE_EXPAND_RANDOM) {
            c->rank = (int64_t)(bw_search_random(e->s) >> 1);
            continue;
        }
        memcpy(e->state, words, e->tree.words * sizeof *e->state);
        bw_tree_choose(&e->tree, e->state, c->sheet);
        bw_tree_finish(&e->tree, e->state);
        bw_search_spent(e->s, UINT64_MAX);
        status = price(e, e->state, &c->rank);
        if (status == BW_OK && e->s->evaluations % 64 == 0) status = bw_poll(e->s->ctx);
    }
    return status;
}

static int by_rank(const void *a, const void *b) {
    const child *x = a, *y = b;
    if (x->rank != y->rank) return x->rank < y->rank ? -1 : 1;
    if (x->state != y->state) return x->state < y->state ? -1 : 1;
    return (x->sheet > y->sheet) - (x->sheet < y->sheet);
}

/* Settles the states of a level; leaves are priced, what may follow the others is listed. */
static bw_status expand_level(enumerator *e, bw_explore_expand expand, uint64_t until) {
    bw_status status = BW_OK;
    e->child_count = 0, e->open = false;
    for (size_t i = 0; i < e->level_count && status == BW_OK; i++) {
        uint64_t *state = e->level + i * e->tree.words;
        e->found->states++;
        bool spent = bw_search_spent(e->s, until);
        if (bw_tree_settle(&e->tree, state, NULL, NULL) == 0) status = take_leaf(e, state, e->level_origin[i]);
        else if (!spent) status = list_children(e, i, expand);
        if (spent) {
            e->found->complete = false;
            break;
        }
        if (i % 64 == 0 && status == BW_OK) status = bw_poll(e->s->ctx);
    }
    return status;
}

/* Makes the states of the next level, the first `beam` different ones by rank. */
static bw_status make_next(enumerator *e, size_t beam) {
    bw_context *ctx = e->s->ctx;
    size_t words = e->tree.words;
    bw_status status = BW_OK;
    e->next_count = 0;
    bw_hashset_empty(&e->seen);
    if (e->child_count) qsort(e->children, e->child_count, sizeof *e->children, by_rank);
    for (size_t i = 0; i < e->child_count && status == BW_OK; i++) {
        if (e->next_count == beam) {
            e->found->complete = false;
            break;
        }
        status = bw_reserve(ctx, &e->next, &e->next_room, (e->next_count + 1) * words);
        if (status == BW_OK) status = bw_reserve(ctx, &e->next_origin, &e->next_origin_room, e->next_count + 1);
        if (status != BW_OK) return status;
        uint64_t *state = e->next + e->next_count * words;
        memcpy(state, e->level + e->children[i].state * words, words * sizeof *state);
        bw_tree_choose(&e->tree, state, e->children[i].sheet);
        bool added;
        status = bw_hashset_add(ctx, &e->seen, bw_tree_hash(&e->tree, state), &added);
        if (status != BW_OK || !added) continue;
        status = add_origin(e, e->level_origin[e->children[i].state], e->children[i].sheet, &e->next_origin[e->next_count]);
        e->next_count++;
        if (status == BW_OK && e->next_count % 256 == 0) status = bw_poll(ctx);
    }
    return status;
}

static void swap_levels(enumerator *e) {
    uint64_t *states = e->level;
    int32_t *origins = e->level_origin;
    size_t room = e->level_room, origin_room = e->level_origin_room;
    e->level = e->next, e->level_origin = e->next_origin, e->level_room = e->next_room, e->level_origin_room = e->next_origin_room;
    e->level_count = e->next_count;
    e->next = states, e->next_origin = origins, e->next_room = room, e->next_origin_room = origin_room;
}

static bw_status start(enumerator *e) {
    bw_status status = bw_reserve(e->s->ctx, &e->level, &e->level_room, e->tree.words);
    if (status == BW_OK) status = bw_reserve(e->s->ctx, &e->level_origin, &e->level_origin_room, 1);
    if (status != BW_OK) return status;
    bw_tree_root(&e->tree, e->level);
    e->level_origin[0] = ROOT;
    e->level_count = 1;
    return BW_OK;
}

/* Some leaf, where none was reached, so that there is an answer. */
static bw_status any_leaf(enumerator *e) {
    int32_t at = ROOT;
    bw_tree_root(&e->tree, e->state);
    bw_status status = BW_OK;
    while (status == BW_OK && bw_tree_settle(&e->tree, e->state, NULL, NULL)) {
        size_t sheet = 0;
        while (!bw_tree_bit(e->tree.choices, sheet)) sheet++;
        bw_tree_choose(&e->tree, e->state, sheet);
        status = add_origin(e, at, sheet, &at);
    }
    return status == BW_OK ? take_leaf(e, e->state, at) : status;
}

static bw_status finish(enumerator *e, bw_status status, bw_sheet *order) {
    if (status == BW_OK && e->best_origin == NOT_FOUND) status = any_leaf(e);
    if (status == BW_OK) {
        replay(e, e->best_origin, order);
        e->found->best = e->best;
        e->found->leaves = e->leaves.count;
    }
    enumerator_clear(e);
    return status;
}

bw_status bw_enumerate(bw_search *s, const uint8_t *around, int32_t component, size_t beam, bw_explore_expand expand, uint64_t until, bw_sheet *order, bw_enumeration *found) {
    enumerator e;
    bw_status status = enumerator_init(&e, s, around, component, found);
    if (status == BW_OK) status = start(&e);
    found->complete = true;
    while (status == BW_OK && e.level_count) {
        found->levels++;
        status = expand_level(&e, expand, until);
        if (status != BW_OK) break;
        if (!in_reach(&e, until)) { /* what was listed, or would have been, is not looked at */
            found->complete = found->complete && !e.open;
            break;
        }
        status = make_next(&e, beam);
        if (status == BW_OK) swap_levels(&e);
    }
    return finish(&e, status, order);
}

/* ---- all of them --------------------------------------------------------------------------------------------------- */

/* Whether every leaf below the state settled last has as many blocks as the best at least: walls only part blocks, and only add corners. */
static bool is_hopeless(enumerator *e, const uint64_t *state) {
    bw_tree_sure_walls(&e->tree, state, e->tree.after);
    put_walls(e, e->tree.after);
    return bw_search_bound(e->s, e->wall) >= e->best;
}

typedef struct {
    uint64_t *state; /* [depth][words] */
    int32_t *origin; /* [depth] */
    size_t *next;    /* [depth] the sheet to be tried next */
    size_t depth;
    bool cut, bounded;
} descent;

static bw_status descent_init(bw_context *ctx, const enumerator *e, descent *d) {
    size_t most = e->tree.count + 2; /* every step down inserts a sheet */
    *d = (descent){.state = bw_alloc(ctx, most * e->tree.words, sizeof *d->state), .origin = bw_alloc(ctx, most, sizeof *d->origin),
                   .next = bw_alloc(ctx, most, sizeof *d->next), .depth = 1};
    if (ctx->error.status != BW_OK) return ctx->error.status;
    bw_tree_root(&e->tree, d->state);
    d->origin[0] = ROOT;
    return BW_OK;
}

static void descent_clear(bw_context *ctx, descent *d) { bw_free(ctx, d->state), bw_free(ctx, d->origin), bw_free(ctx, d->next); }

/* Settles the state that was stepped down to. *down: there is something below it. */
static bw_status enter(enumerator *e, descent *d, bool prune, bool *down) {
    uint64_t *state = d->state + (d->depth - 1) * e->tree.words;
    bool fresh;
    e->found->states++;
    d->next[d->depth - 1] = 0;
    if (d->depth > e->found->levels) e->found->levels = d->depth;
    bool leaf = bw_tree_settle(&e->tree, state, NULL, NULL) == 0;
    *down = false;
    if (leaf) return take_leaf(e, state, d->origin[d->depth - 1]);
    bw_status status = bw_hashset_add(e->s->ctx, &e->settled, bw_tree_hash(&e->tree, state), &fresh);
    if (status != BW_OK || !fresh) return status;
    *down = !prune || e->best == INT64_MAX || !is_hopeless(e, state);
    d->bounded = d->bounded || !*down;
    return e->found->states % 256 ? BW_OK : bw_poll(e->s->ctx);
}

/* Steps down from the deepest state to the next one that was not seen, or back up. *down: a step down. */
static bw_status step(enumerator *e, descent *d, bool *down) {
    size_t words = e->tree.words, at = d->depth - 1, sheet = d->next[at];
    uint64_t *state = d->state + at * words, *below = state + words;
    *down = false;
    while (sheet < e->tree.count && !bw_tree_bit(state + e->tree.wall_words, sheet)) sheet++;
    d->next[at] = sheet + 1;
    if (sheet == e->tree.count) {
        d->depth--;
        return BW_OK;
    }
    memcpy(below, state, words * sizeof *below);
    bw_tree_choose(&e->tree, below, sheet);
    bw_status status = bw_hashset_add(e->s->ctx, &e->seen, bw_tree_hash(&e->tree, below), down);
    if (status != BW_OK || !*down) return status;
    d->depth++;
    return add_origin(e, d->origin[at], sheet, &d->origin[at + 1]);
}

bw_status bw_enumerate_all(bw_search *s, const uint8_t *around, int32_t component, int64_t known, uint64_t most_states, uint64_t until, bw_sheet *order,
                           bw_enumeration *found) {
    enumerator e;
    descent d = {0};
    bool fresh = true, below = false; /* the deepest state was not looked at yet; there is something below it */
    bw_status status = enumerator_init(&e, s, around, component, found);
    if (status == BW_OK) status = descent_init(s->ctx, &e, &d);
    e.best = known;
    while (status == BW_OK && d.depth && !d.cut) {
        if (!fresh) {
            status = step(&e, &d, &fresh);
            continue;
        }
        fresh = false;
        d.cut = bw_search_spent(s, until) || found->states >= most_states;
        if (!d.cut) status = enter(&e, &d, known < INT64_MAX, &below);
        if (!below) d.depth--;
    }
    found->complete = !d.cut && !d.bounded, found->bounded = !d.cut && d.bounded;
    descent_clear(s->ctx, &d);
    if (status == BW_OK && known < INT64_MAX && e.best_origin == NOT_FOUND) { /* nothing below what is known */
        found->best = known, found->leaves = e.leaves.count;
        enumerator_clear(&e);
        return BW_OK;
    }
    return finish(&e, status, order);
}
