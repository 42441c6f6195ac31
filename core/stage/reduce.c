/* The reduction of MC 5.4 is greedy, and its result depends on the order of removal. The paper's order, farthest first, comes first; then the
 * order is treated as the solution of a local search: some patches get another place in it, the reduction is run again, and what
 * is no worse is kept. A run touches no cell, so thousands of orders cost less than one trace.
 */
#include "stage/reduce.h"

#include <string.h>

/* Patch visits that a search may spend, by effort; runs = budget / patches, within these bounds. */
static const uint64_t budget[4] = {0, 60000, 30000000, 300000000};
static const uint64_t most_runs[4] = {0, 400, 4000, 40000};
/* Runs without fewer blocks after which it ends, beyond as many as it took to come there. */
static const uint64_t patience[4] = {0, 100, 1000, 10000};

typedef struct {
    bw_context *ctx;
    bw_reduction *reduction;
    bw_reduction_rules rules;
    size_t patches, blocks;
    int64_t *key, *best_key;
    uint8_t *removed, *kept;
    uint64_t random;
} search;

static uint64_t next_random(search *s) { /* splitmix64 */
    uint64_t z = s->random += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Runs with the present keys and keeps the outcome if it is no worse. */
static bw_status attempt(search *s) {
    size_t blocks;
    bw_status status = bw_reduction_run(s->ctx, s->reduction, &s->rules, s->removed, NULL, &blocks);
    if (status == BW_OK && blocks <= s->blocks) {
        s->blocks = blocks;
        memcpy(s->best_key, s->key, s->patches * sizeof *s->key);
    }
    return status;
}

/* Moves a few patches of the best order to random places: mostly two to five, at times a tenth of them. */
static void perturb(search *s) {
    memcpy(s->key, s->best_key, s->patches * sizeof *s->key);
    size_t moves = 2 + next_random(s) % 4;
    if (next_random(s) % 8 == 0) moves += s->patches / 10;
    int64_t highest = s->best_key[0];
    for (size_t p = 0; p < s->patches; p++)
        if (s->best_key[p] > highest) highest = s->best_key[p];
    for (; moves; moves--) s->key[next_random(s) % s->patches] = (int64_t)(next_random(s) % ((uint64_t)highest + 2));
}

static bw_status search_orders(search *s, const bw_complex *x, int effort, bw_reduce_report *report) {
    for (size_t p = 0; p < s->patches; p++) s->key[p] = x->patch_distance[p] < 0 ? 0 : x->patch_distance[p];
    bw_status status = attempt(s); /* farthest first */
    report->blocks_farthest_first = s->blocks;
    uint64_t runs = s->patches ? budget[effort] / s->patches : 0;
    if (runs > most_runs[effort]) runs = most_runs[effort];
    s->rules.key = s->key;
    uint64_t improved = 0; /* the run that was the last to leave fewer blocks */
    for (report->runs = 1; report->runs <= runs && report->runs < 2 * improved + patience[effort] && status == BW_OK && s->blocks > 1;
         report->runs++) {
        size_t before = s->blocks;
        perturb(s);
        status = attempt(s);
        if (s->blocks < before) improved = report->runs;
        if (report->runs % 64 == 0) bw_progress(s->ctx, (double)report->runs / (double)runs);
    }
    if (status != BW_OK) return status;
    s->rules.key = s->best_key; /* once more, for what it removes */
    return bw_reduction_run(s->ctx, s->reduction, &s->rules, s->removed, s->kept, &s->blocks);
}

static void take_walls_away(bw_cells *cells, const bw_complex *x, const search *s, bw_reduce_report *report) {
    for (size_t p = 0; p < x->patch_count; p++) {
        report->patches_removed += s->removed[p];
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1] && s->removed[p]; i++)
            cells->polygon[x->patch_polygon[i]].flags &= (uint8_t) ~(BW_WALL | BW_SPLIT);
    }
    for (size_t a = 0; a < x->arc_count; a++)
        for (size_t i = x->arc_edge_begin[a]; i < x->arc_edge_begin[a + 1]; i++) {
            if (s->kept[a]) cells->edge[x->arc_edge[i]].flags |= BW_KEPT;
            else cells->edge[x->arc_edge[i]].flags &= (uint8_t)~BW_KEPT; /* between patches that have become one */
        }
}

static bw_status remove_walls(bw_context *ctx, bw_cells *cells, const bw_complex *x, const bw_reduce_options *options,
                              bw_reduce_report *report) {
    search s = {.ctx = ctx, .patches = x->patch_count, .blocks = x->block_count};
    s.rules = (bw_reduction_rules){options->mode, options->split_self_adjacent, NULL};
    s.key = bw_alloc(ctx, s.patches, sizeof *s.key);
    s.best_key = bw_alloc(ctx, s.patches, sizeof *s.best_key);
    s.removed = bw_alloc(ctx, s.patches, 1);
    s.kept = bw_alloc(ctx, x->arc_count, 1);
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = bw_reduction_new(ctx, cells, x, &s.reduction);
    if (status == BW_OK) status = search_orders(&s, x, options->effort, report);
    if (status == BW_OK) take_walls_away(cells, x, &s, report);
    bw_reduction_free(ctx, s.reduction);
    bw_free(ctx, s.key), bw_free(ctx, s.best_key), bw_free(ctx, s.removed), bw_free(ctx, s.kept);
    return status;
}

bw_status bw_reduce(bw_context *ctx, bw_cells *cells, bw_complex *complex, const bw_reduce_options *options, bw_reduce_report *report) {
    memset(report, 0, sizeof *report);
    report->blocks_before = report->blocks = report->blocks_farthest_first = complex->block_count;
    if (options->mode == BW_REDUCE_NONE) return BW_OK;
    size_t splits = complex->torus_splits;
    bw_status status = remove_walls(ctx, cells, complex, options, report);
    if (status != BW_OK) return status;
    bw_torus_list tori = {0};
    status = bw_complex_rebuild(ctx, cells, complex, &tori);
    if (status == BW_OK && tori.count) status = bw_fail(ctx, BW_E_CHECK, "reduction left %zu blocks that are no cuboids", tori.count);
    bw_free(ctx, tori.cell);
    complex->torus_splits = splits;
    report->blocks = complex->block_count;
    if (status == BW_OK) status = bw_complex_check(ctx, cells, complex);
    bw_reduction_rules rules = {options->mode, options->split_self_adjacent, NULL};
    if (status == BW_OK && bw_complex_removable_patch(complex, &rules) != BW_NONE)
        status = bw_fail(ctx, BW_E_CHECK, "patch %d is left though it can be removed", bw_complex_removable_patch(complex, &rules));
    return status;
}
