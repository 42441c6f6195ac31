#include "explore/explore.h"

#include <stdlib.h>
#include <string.h>

#include "explore/anneal.h"
#include "explore/swap.h"

enum { EXHAUSTIVE_STATES = 200000, BOUNDED_STATES = 2000000, RETRACTIONS = 32 };
/* What auto does with components: those of so many sheets are enumerated exactly, with a beam, or only tested for a bound at the root. */
enum { AUTO_EXACT_SHEETS = 32, AUTO_BEAM_SHEETS = 100, AUTO_STATES = 20000, AUTO_BEAM = 100, AUTO_SHARE = 4 };

/* How a component is to be enumerated: states at most without a bound, with one, and the beam; 0: not at all. */
typedef struct {
    uint64_t exhaustive, bounded;
    size_t beam;
} effort;

typedef struct {
    bw_context *ctx;
    const bw_space *space;
    const bw_explore_choice *choice;
    bw_search search;
    bw_serial serial;
    bw_sheet *order, *part, *kept; /* [sheet] */
    uint8_t *around;        /* [patch] */
    bw_explore_component *component;
    bw_explore_found *found;
} explorer;

/* ---- components ---------------------------------------------------------------------------------------------------- */

/* The walls that sheets of other components make, with the given ones. */
static void walls_around(explorer *e, int32_t component) {
    const bw_space *x = e->space;
    for (size_t p = 0; p < x->patch_count; p++) e->around[p] = x->given[p];
    for (size_t s = 0; s < x->sheet_count; s++)
        for (size_t i = x->sheet_begin[s]; i < x->sheet_begin[s + 1]; i++)
            if (x->sheet_component[s] != component && e->serial.reached[i]) e->around[x->sheet_patch[i]] = 1;
}

/* Gives the sheets of a component the places they have, in another order. */
static void reorder(explorer *e, int32_t component, const bw_sheet *part) {
    memcpy(e->order, e->serial.order, e->space->sheet_count * sizeof *e->order);
    for (size_t i = 0, k = 0; i < e->space->sheet_count; i++)
        if (e->space->sheet_component[e->order[i]] == component) e->order[i] = part[k++];
    bw_serial_insert(&e->serial, e->order);
}

/* The same, if that is cheaper. */
static bw_status reorder_if_better(explorer *e, int32_t component) {
    int64_t before, after;
    bw_sheet *kept = e->kept;
    memcpy(kept, e->serial.order, e->space->sheet_count * sizeof *kept);
    bw_status status = bw_search_price_serial(&e->search, &e->serial, &before);
    reorder(e, component, e->part);
    if (status == BW_OK) status = bw_search_price_serial(&e->search, &e->serial, &after);
    if (status == BW_OK && after > before) bw_serial_insert(&e->serial, kept);
    return status;
}

static void count_components(const bw_space *x, bw_explore_component *out) {
    for (size_t s = 0; s < x->sheet_count; s++) {
        size_t c = (size_t)x->sheet_component[s];
        if (c < x->component_count) out[c].sheets++, out[c].links += x->link_begin[s + 1] - x->link_begin[s];
    }
    for (size_t c = 0; c < x->component_count; c++) out[c].links /= 2;
}

/* Work that a component may still have, so that those after it, and other methods, have some too. */
static uint64_t share(const explorer *e, size_t component) {
    uint64_t left = e->search.work > e->search.evaluations ? e->search.work - e->search.evaluations : 0;
    if (e->choice->method == BW_EXPLORE_AUTO) left /= AUTO_SHARE;
    return e->search.evaluations + left / (e->space->component_count - component);
}

static effort effort_for(const explorer *e, const bw_explore_component *of) {
    switch (e->choice->method) {
    case BW_EXPLORE_EXACT: return (effort){EXHAUSTIVE_STATES, BOUNDED_STATES, 0};
    case BW_EXPLORE_ENUMERATE:
    case BW_EXPLORE_ENUMERATE_SWAP: return (effort){0, 0, e->choice->beam};
    default: break;
    }
    bool small = of->sheets <= AUTO_EXACT_SHEETS;
    return (effort){small ? AUTO_STATES : 0, small ? AUTO_STATES : 2, of->sheets <= AUTO_BEAM_SHEETS ? AUTO_BEAM : 0};
}

/* All orders of a component that make a difference; where they are too many, and a bound is known, all but those that are no better than the order at hand. */
static bw_status enumerate_exactly(explorer *e, int32_t component, effort how, bw_enumeration *found) {
    int64_t known;
    bw_search *s = &e->search;
    bw_status status = BW_OK;
    if (how.exhaustive) status = bw_enumerate_all(s, e->around, component, INT64_MAX, how.exhaustive, share(e, (size_t)component), e->part, found);
    if (status != BW_OK || found->complete || !how.bounded || !bw_pricer_counts(s->pricer)) return status;
    size_t place = 0;
    for (size_t i = 0; i < e->space->sheet_count; i++)
        if (e->space->sheet_component[e->serial.order[i]] == component) e->part[place++] = e->serial.order[i];
    status = bw_search_price_serial(s, &e->serial, &known);
    if (status == BW_OK) status = bw_enumerate_all(s, e->around, component, known, how.bounded, share(e, (size_t)component), e->part, found);
    return status;
}

/* Finds the best order of each component on its own; the others stand as they are. */
static bw_status enumerate_components(explorer *e) {
    const bw_space *x = e->space;
    bw_status status = BW_OK;
    for (size_t c = 0; c < x->component_count && status == BW_OK && e->search.cut == BW_CUT_NOT; c++) {
        bw_explore_component *of = &e->component[c];
        effort how = effort_for(e, of);
        bw_enumeration found = {0};
        walls_around(e, (int32_t)c);
        status = enumerate_exactly(e, (int32_t)c, how, &found);
        bool sure = found.complete || found.bounded, made = how.exhaustive || sure || how.beam;
        if (status == BW_OK && !sure && how.beam)
            status = bw_enumerate(&e->search, e->around, (int32_t)c, how.beam, e->choice->expand, share(e, c), e->part, &found);
        of->states = found.states, of->leaves = found.leaves, of->complete = found.complete, of->bounded = found.bounded;
        if (status == BW_OK && made) status = reorder_if_better(e, (int32_t)c);
    }
    return status;
}

/* ---- methods ------------------------------------------------------------------------------------------------------- */

/* The cost of the order at hand; it is what serial insertion came to so far. */
static bw_status price_order(explorer *e, double *cost, size_t *blocks) {
    int64_t price = 0;
    bw_status status = bw_search_price_serial(&e->search, &e->serial, &price);
    *cost = bw_cost_value(price), *blocks = e->search.regions.count;
    return status;
}

static bw_status swap_order(explorer *e) {
    int64_t cost;
    return bw_swap(&e->search, &e->serial, UINT64_MAX, &cost);
}

/* Retraction of the best complex so far, in several orders, and the search from there on. */
static bw_status improve_walls(explorer *e, bool anneal) {
    bw_search *s = &e->search;
    bw_tiling t;
    memcpy(e->around, s->best, e->space->patch_count);
    bw_status status = bw_tiling_init(e->ctx, e->space, s->pricer, s->stays, e->around, &t);
    for (int i = 0; i < RETRACTIONS && status == BW_OK; i++) {
        if (i) status = bw_tiling_set(e->ctx, &t, e->around);
        if (status == BW_OK) status = bw_retract(s, &t);
        if (s->cut != BW_CUT_NOT) break;
    }
    if (status == BW_OK) status = bw_tiling_set(e->ctx, &t, s->best);
    if (status == BW_OK && anneal && s->cut == BW_CUT_NOT && s->work > s->evaluations) status = bw_anneal(s, &t, s->work - s->evaluations);
    bw_tiling_clear(e->ctx, &t);
    return status;
}

static bw_status run(explorer *e) {
    bw_explore_method method = e->choice->method;
    bool swaps = method != BW_EXPLORE_ENUMERATE;
    bool anneals = method == BW_EXPLORE_ANNEAL || method == BW_EXPLORE_AUTO;
    bw_status status = bw_random_order(&e->search, &e->serial);
    if (status == BW_OK) status = price_order(e, &e->found->start, &e->found->start_blocks);
    if (status == BW_OK && (method == BW_EXPLORE_ENUMERATE || method == BW_EXPLORE_ENUMERATE_SWAP)) status = enumerate_components(e);
    if (status == BW_OK && swaps) status = swap_order(e);
    if (status == BW_OK && (method == BW_EXPLORE_EXACT || method == BW_EXPLORE_AUTO)) status = enumerate_components(e);
    if (status == BW_OK) status = price_order(e, &e->found->serial, &e->found->serial_blocks);
    if (status == BW_OK && e->search.best_cost < INT64_MAX) { /* on the way there may have been a better one */
        e->found->serial = bw_cost_value(e->search.best_cost), e->found->serial_blocks = e->search.best_blocks;
    }
    if (status == BW_OK && (e->choice->retract || anneals)) status = improve_walls(e, anneals);
    return status;
}

/* ---- the report ---------------------------------------------------------------------------------------------------- */

static void list_components(explorer *e) {
    bw_explore_found *f = e->found;
    size_t n = e->space->component_count, least = 0;
    for (size_t over = n; over > BW_EXPLORE_LISTED;) { /* the smallest number of sheets that leaves few enough */
        over = 0, least++;
        for (size_t c = 0; c < n; c++) over += e->component[c].sheets >= least;
    }
    for (size_t c = 0; c < n; c++)
        if (e->component[c].sheets >= least && f->listed < BW_EXPLORE_LISTED) f->component[f->listed++] = e->component[c];
}

static void report(explorer *e) {
    const bw_space *x = e->space;
    bw_explore_found *f = e->found;
    f->lines = x->line_count, f->sheets = x->sheet_count, f->links = bw_space_links(x), f->components = x->component_count;
    f->crossings = x->crossings, f->crossings_open = x->crossings_open, f->variable_patches = x->variable_patches;
    f->best = bw_cost_value(e->search.best_cost), f->best_blocks = e->search.best_blocks;
    f->evaluations = e->search.evaluations, f->improved = e->search.improved, f->cut = e->search.cut;
    f->seconds = bw_seconds_now() - e->search.since;
    bool all = true;
    for (size_t c = 0; c < x->component_count; c++) all = all && (e->component[c].complete || e->component[c].bounded);
    /* The number of blocks is a sum over components (space.h, 5), other costs are sums only if there is one. */
    f->proven = all && (bw_pricer_counts(e->search.pricer) || x->component_count <= 1);
    list_components(e);
}

static bw_status prepare(explorer *e, bw_pricer **pricer) {
    const bw_space *x = e->space;
    const bw_explore_choice *c = e->choice;
    e->order = bw_alloc(e->ctx, x->sheet_count, sizeof *e->order);
    e->kept = bw_alloc(e->ctx, x->sheet_count, sizeof *e->kept);
    e->part = bw_alloc(e->ctx, x->sheet_count, sizeof *e->part);
    e->around = bw_alloc(e->ctx, x->patch_count, 1);
    e->component = bw_alloc(e->ctx, x->component_count, sizeof *e->component);
    bw_status status = bw_pricer_new(e->ctx, x, c->weight, c->grids, pricer);
    if (status == BW_OK) status = bw_search_init(e->ctx, x, *pricer, x->must, c->seed, &e->search);
    if (status == BW_OK) status = bw_serial_init(e->ctx, x, &e->serial);
    if (status != BW_OK) return status;
    e->search.work = c->work, e->search.seconds = c->seconds;
    count_components(x, e->component);
    return BW_OK;
}

bw_status bw_explore(bw_context *ctx, const bw_space *space, const bw_explore_choice *choice, uint8_t *wall, bw_explore_found *found) {
    explorer e = {.ctx = ctx, .space = space, .choice = choice, .found = found};
    bw_pricer *pricer = NULL;
    memset(found, 0, sizeof *found);
    bw_status status = prepare(&e, &pricer);
    if (status == BW_OK) status = run(&e);
    if (status == BW_OK) {
        memcpy(wall, e.search.best, space->patch_count);
        report(&e);
    }
    bw_search_clear(&e.search);
    bw_serial_clear(ctx, &e.serial);
    bw_pricer_free(ctx, pricer);
    bw_free(ctx, e.order), bw_free(ctx, e.part), bw_free(ctx, e.kept), bw_free(ctx, e.around), bw_free(ctx, e.component);
    return status;
}
