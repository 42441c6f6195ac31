/* Searching: enumeration finds what trying all orders finds, the exact search proves it, tilings keep their invariants through cuts, joins and the way back,
 * and whatever is found is a complex of as many blocks as were counted. */
#include "core/explore_kit.h"
#include "explore/anneal.h"
#include "explore/explore.h"
#include "explore/hashset.h"

typedef struct {
    bw_pricer *pricer;
    bw_search search;
} searching;

static const double blocks_only[BW_COST_TERMS] = {[BW_COST_BLOCKS] = 1};

static void searching_open(searching *s, explorable *e, const double weight[BW_COST_TERMS]) {
    kit_expect_ok(&e->model.ctx, bw_pricer_new(&e->model.ctx, &e->space, weight, NULL, &s->pricer));
    kit_expect_ok(&e->model.ctx, bw_search_init(&e->model.ctx, &e->space, s->pricer, e->space.must, 1, &s->search));
}

static void searching_close(searching *s, explorable *e) {
    bw_search_clear(&s->search);
    bw_pricer_free(&e->model.ctx, s->pricer);
}

/* ---- all orders ---------------------------------------------------------------------------------------------------- */

typedef struct {
    explorable *e;
    searching *s;
    bw_hashset walls;
    int64_t best;
    size_t tried;
} brute;

/* Tries every order of the first `count` sheets from `at` on; the others come after them. */
static void try_orders(brute *b, bw_sheet *order, size_t at, size_t count) {
    if (at == count) {
        int64_t cost;
        bool added;
        bw_serial_insert(&b->e->serial, order);
        kit_expect_ok(&b->e->model.ctx, bw_search_price_serial(&b->s->search, &b->e->serial, &cost));
        kit_expect_ok(&b->e->model.ctx, bw_hashset_add(&b->e->model.ctx, &b->walls, b->e->serial.hash, &added));
        if (cost < b->best) b->best = cost;
        b->tried++;
        return;
    }
    for (size_t i = at; i < count; i++) {
        bw_sheet swap = order[at];
        order[at] = order[i], order[i] = swap;
        try_orders(b, order, at + 1, count);
        swap = order[at], order[at] = order[i], order[i] = swap;
    }
}

/* Sheets of a component come first; returns their number. */
static size_t component_first(const bw_space *space, int32_t component, bw_sheet *order) {
    size_t count = 0, rest = space->sheet_count;
    for (bw_sheet s = 0; s < (bw_sheet)space->sheet_count; s++)
        if (space->sheet_component[s] == component) order[count++] = s;
        else order[--rest] = s;
    return count;
}

/* The walls of the other components as the serial insertion at hand has them. */
static void walls_around(const explorable *e, int32_t component) {
    for (size_t p = 0; p < e->space.patch_count; p++) e->wall[p] = e->space.given[p];
    for (size_t k = 0; k < e->space.sheet_count; k++)
        for (size_t i = e->space.sheet_begin[k]; i < e->space.sheet_begin[k + 1]; i++)
            if (e->space.sheet_component[k] != component && e->serial.reached[i]) e->wall[e->space.sheet_patch[i]] = 1;
}

/* Each way of enumerating a component against all orders of its sheets. */
static void expect_all_orders(explorable *e, searching *s, int32_t component, bw_sheet *part) {
    bw_context *ctx = &e->model.ctx;
    bw_enumeration found;
    brute b = {.e = e, .s = s, .best = INT64_MAX};
    size_t sheets = component_first(&e->space, component, e->order);
    try_orders(&b, e->order, 0, sheets);
    walls_around(e, component);
    kit_expect_ok(ctx, bw_enumerate(&s->search, e->wall, component, SIZE_MAX, BW_EXPLORE_EXPAND_RANDOM, UINT64_MAX, part, &found));
    assert_true(found.complete);
    assert_int_equal(found.leaves, b.walls.count);
    assert_int_equal(found.best, b.best);
    kit_expect_ok(ctx, bw_enumerate_all(&s->search, e->wall, component, INT64_MAX, UINT64_MAX, UINT64_MAX, part, &found));
    assert_true(found.complete);
    assert_int_equal(found.leaves, b.walls.count);
    assert_int_equal(found.best, b.best);
    kit_expect_ok(ctx, bw_enumerate_all(&s->search, e->wall, component, b.best + (1 << BW_COST_SHIFT), UINT64_MAX, UINT64_MAX, part, &found));
    assert_true(found.complete || found.bounded);
    assert_int_equal(found.best, b.best);
    memcpy(e->order, part, sheets * sizeof *part); /* the order told is one of the best */
    bw_serial_insert(&e->serial, e->order);
    int64_t cost;
    kit_expect_ok(ctx, bw_search_price_serial(&s->search, &e->serial, &cost));
    assert_int_equal(cost, b.best);
    print_message("%s: %zu orders of %zu sheets, %zu distinct complexes, %.0f blocks at least\n", e->model.name, b.tried, sheets, b.walls.count, bw_cost_value(b.best));
    bw_hashset_clear(ctx, &b.walls);
}

static void enumeration_finds_what_all_orders_give(void **state) {
    (void)state;
    static const explore_case small[] = {{"bearing", 2, 1, 0}, {"bearing", 3, 2, 0}, {"part", 2, 1, 0}};
    size_t compared = 0;
    for (size_t i = 0; i < sizeof small / sizeof *small; i++) {
        explorable e;
        searching s;
        explorable_open(&e, &small[i]);
        searching_open(&s, &e, blocks_only);
        bw_sheet *part = malloc(e.space.sheet_count * sizeof *part);
        assert_non_null(part);
        for (int32_t c = 0; c < (int32_t)e.space.component_count; c++) {
            if (component_first(&e.space, c, e.order) > 8) continue;
            expect_all_orders(&e, &s, c, part);
            compared++;
        }
        free(part);
        searching_close(&s, &e);
        explorable_close(&e);
    }
    assert_true(compared >= 2);
}

/* However the states of a level are ranked, and wherever the work ends: only an enumeration that saw all leaves says so. */
static void an_enumeration_that_is_cut_short_is_not_complete(void **state) {
    (void)state;
    explorable e;
    searching s;
    explorable_open(&e, &(explore_case){"bearing", 2, 1, 0});
    searching_open(&s, &e, blocks_only);
    bw_sheet *part = malloc(e.space.sheet_count * sizeof *part);
    assert_non_null(part);
    bw_serial_insert(&e.serial, e.order);
    walls_around(&e, 0);
    for (int expand = BW_EXPLORE_EXPAND_RANDOM; expand <= BW_EXPLORE_EXPAND_CHEAPEST; expand++) {
        bw_enumeration all, some;
        size_t complete = 0;
        s.search.evaluations = 0;
        kit_expect_ok(&e.model.ctx, bw_enumerate(&s.search, e.wall, 0, SIZE_MAX, (bw_explore_expand)expand, UINT64_MAX, part, &all));
        assert_true(all.complete && all.leaves > 1);
        uint64_t whole = s.search.evaluations;
        for (uint64_t n = 1; n <= 30; n++) { /* the first few, then some up to one more than all */
            uint64_t until = n <= 15 ? n : (n - 15) * whole / 15 + 1;
            s.search.evaluations = 0;
            kit_expect_ok(&e.model.ctx, bw_enumerate(&s.search, e.wall, 0, SIZE_MAX, (bw_explore_expand)expand, until, part, &some));
            if (some.complete && some.leaves != all.leaves)
                fail_msg("ranked by %d, %llu evaluations: %llu of %llu leaves are called all", expand, (unsigned long long)until, (unsigned long long)some.leaves,
                         (unsigned long long)all.leaves);
            complete += some.complete;
        }
        assert_true(complete > 0);
    }
    free(part);
    searching_close(&s, &e);
    explorable_close(&e);
}

/* Orders by chance never lead out of what a complete enumeration saw. */
static void no_order_is_better_than_the_proven_optimum(void **state) {
    (void)state;
    static const explore_case cases[] = {{"cylinder", 3, 2, 1e-5}, {"bearing", 2, 1, 0}, {"plate", 2, 1, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        explorable e;
        bw_explore_found found;
        explorable_open(&e, &cases[i]);
        bw_explore_choice choice = {.method = BW_EXPLORE_EXACT, .weight = {1}, .seed = 1, .work = 1000000};
        kit_expect_ok(&e.model.ctx, bw_explore(&e.model.ctx, &e.space, &choice, e.wall, &found));
        if (!found.proven) fail_msg("%s: not proven", e.model.name);
        kit_random random = kit_random_start(300 + i);
        for (int round = 0; round < 3000; round++) {
            explorable_shuffle(&e, &random);
            bw_serial_insert(&e.serial, e.order);
            bw_serial_walls(&e.serial, e.wall);
            assert_true(bw_regions_close(&e.regions, e.wall));
            if ((double)e.regions.count < found.serial) fail_msg("%s: an order gives %zu blocks, %.0f are proven least", e.model.name, e.regions.count, found.serial);
        }
        explorable_close(&e);
    }
}

/* ---- methods ------------------------------------------------------------------------------------------------------- */

static void what_a_method_counts_is_what_is_built(void **state) {
    (void)state;
    for (int i = 0; i < EXPLORE_CASES; i++) {
        explorable e;
        explorable_open(&e, &explore_cases[i]);
        uint8_t *again = malloc(e.space.patch_count);
        assert_non_null(again);
        for (int method = BW_EXPLORE_AUTO; method <= BW_EXPLORE_EXACT; method++)
            for (int cost = 0; cost < 2; cost++) {
                bw_explore_found found, twice;
                bw_explore_choice choice = {.method = (bw_explore_method)method, .beam = 20, .expand = (bw_explore_expand)cost, .seed = 7, .work = 3000, .retract = true};
                choice.weight[cost ? BW_COST_CUBES : BW_COST_BLOCKS] = 1;
                kit_expect_ok(&e.model.ctx, bw_explore(&e.model.ctx, &e.space, &choice, e.wall, &found));
                size_t built = explorable_build(&e, e.wall);
                if (built != found.best_blocks) fail_msg("%s, method %d: %zu blocks counted, %zu built", e.model.name, method, found.best_blocks, built);
                if (found.best > found.serial || found.serial > found.start) fail_msg("%s, method %d: %g, %g, %g", e.model.name, method, found.start, found.serial, found.best);
                kit_expect_ok(&e.model.ctx, bw_explore(&e.model.ctx, &e.space, &choice, again, &twice));
                assert_memory_equal(again, e.wall, e.space.patch_count);
                for (size_t p = 0; p < e.space.patch_count; p++) assert_true(!e.space.must[p] || e.wall[p]);
            }
        free(again);
        explorable_close(&e);
    }
}

static void a_search_that_is_asked_to_finish_keeps_the_best(void **state) {
    (void)state;
    explorable e;
    bw_explore_found found;
    volatile sig_atomic_t finish = 1;
    explorable_open(&e, &(explore_case){"bearing", 2, 2, 1e-5});
    e.model.ctx.finish = &finish;
    bw_explore_choice choice = {.method = BW_EXPLORE_AUTO, .weight = {1}, .seed = 1, .work = 1000000000, .retract = true};
    kit_expect_ok(&e.model.ctx, bw_explore(&e.model.ctx, &e.space, &choice, e.wall, &found));
    assert_int_equal(found.cut, BW_CUT_FINISH);
    assert_true(found.evaluations < 1000);
    assert_int_equal(explorable_build(&e, e.wall), found.best_blocks);
    explorable_close(&e);
}

/* Retraction counts no evaluations, but may take long all the same. */
static void a_retraction_can_be_cancelled_or_asked_to_finish(void **state) {
    (void)state;
    for (int cancelled = 0; cancelled < 2; cancelled++) {
        explorable e;
        searching s;
        bw_tiling t;
        volatile sig_atomic_t now = 1;
        explorable_open(&e, &(explore_case){"bearing", 2, 2, 1e-5});
        bw_context *ctx = &e.model.ctx;
        searching_open(&s, &e, blocks_only);
        memset(e.wall, 1, e.space.patch_count);
        kit_expect_ok(ctx, bw_tiling_init(ctx, &e.space, s.pricer, e.space.must, e.wall, &t));
        size_t before = t.count;
        if (cancelled) ctx->cancel = &now;
        else ctx->finish = &now;
        kit_expect_status(ctx, bw_retract(&s.search, &t), cancelled ? BW_E_CANCELLED : BW_OK);
        if (!cancelled) {
            assert_int_equal(s.search.cut, BW_CUT_FINISH);
            kit_expect_ok(ctx, bw_tiling_check(ctx, &t));
            assert_int_equal(explorable_build(&e, t.wall), t.count);
            ctx->finish = NULL, s.search.cut = BW_CUT_NOT;
            size_t then = t.count;
            kit_expect_ok(ctx, bw_retract(&s.search, &t)); /* what was left to do */
            assert_true(t.count < then && then <= before);
        }
        bw_tiling_clear(ctx, &t);
        searching_close(&s, &e);
        explorable_close(&e);
    }
}

/* ---- tilings ------------------------------------------------------------------------------------------------------- */

static void cuts_and_joins_keep_a_tiling_and_can_be_undone(void **state) {
    (void)state;
    static const double costs[][BW_COST_TERMS] = {{[BW_COST_BLOCKS] = 1}, {[BW_COST_CUBES] = 1}, {[BW_COST_BLOCKS] = 1, [BW_COST_CUBES] = 0.25}};
    for (int i = 0; i < EXPLORE_CASES; i++) {
        explorable e;
        searching s;
        bw_tiling t;
        explorable_open(&e, &explore_cases[i]);
        bw_context *ctx = &e.model.ctx;
        searching_open(&s, &e, costs[i % 3]);
        bw_serial_insert(&e.serial, e.order);
        bw_serial_walls(&e.serial, e.wall);
        assert_true(bw_regions_close(&e.regions, e.wall));
        kit_expect_ok(ctx, bw_tiling_init(ctx, &e.space, s.pricer, e.space.must, e.wall, &t));
        t.round = UINT32_MAX - 20; /* a long search comes there, and then begins to count anew */
        kit_random random = kit_random_start(400 + (uint64_t)i);
        size_t cuts = 0, joins = 0;
        for (int round = 0; round < 200; round++) {
            uint64_t hash = t.hash;
            int64_t cost = bw_pricer_total(s.pricer);
            size_t count = t.count;
            for (int k = 0; k < 4; k++) {
                bool done;
                bw_patch p = (bw_patch)kit_random_below(&random, e.space.patch_count);
                bool cut = !t.wall[p];
                kit_expect_ok(ctx, cut ? bw_tiling_cut(ctx, &t, p, &done) : bw_tiling_join(ctx, &t, p, &done));
                cuts += done && cut, joins += done && !cut;
            }
            if (round % 16 == 0) kit_expect_ok(ctx, bw_tiling_check(ctx, &t));
            if (round % 2) {
                bw_tiling_undo(&t, 0);
                assert_int_equal(t.hash, hash);
                assert_int_equal(t.count, count);
                assert_int_equal(bw_pricer_total(s.pricer), cost);
            } else {
                bw_tiling_keep(&t);
            }
        }
        kit_expect_ok(ctx, bw_tiling_check(ctx, &t));
        int64_t total = bw_pricer_total(s.pricer), anew;
        kit_expect_ok(ctx, bw_search_price(&s.search, t.wall, &anew)); /* by another way: regions, not boxes */
        assert_int_equal(total, anew);
        if (e.space.variable_patches > 10) assert_true(cuts && joins);
        assert_int_equal(explorable_build(&e, t.wall), t.count);
        bw_tiling_clear(ctx, &t);
        searching_close(&s, &e);
        explorable_close(&e);
    }
}

/* A map may have walls one grid unit apart that are 2^45 units long. */
static void a_very_flat_box_is_dear(void **state) {
    (void)state;
    static const double most[BW_COST_TERMS] = {[BW_COST_CUBES] = 1000};
    explorable e;
    explorable_open(&e, &(explore_case){"cuboid", 3, 1, 0});
    int64_t before = 0;
    memset(e.wall, 1, e.space.patch_count);
    for (int bits = 0; bits <= 45; bits++) {
        searching s;
        bw_tiling t;
        for (int k = 0; k < 3; k++) e.space.block_extent[0][k] = k ? 1 : (int64_t)1 << bits;
        searching_open(&s, &e, most);
        kit_expect_ok(&e.model.ctx, bw_tiling_init(&e.model.ctx, &e.space, s.pricer, e.space.must, e.wall, &t));
        int64_t cost = bw_pricer_total(s.pricer);
        if (cost < before || cost <= 0) fail_msg("1 : 2^%d costs %lld, 1 : 2^%d %lld", bits, (long long)cost, bits - 1, (long long)before);
        if (bits <= 20) assert_int_equal(cost, (int64_t)1000 << (BW_COST_SHIFT + bits));
        for (int i = 0; i < 100000; i++) bw_pricer_add(s.pricer, t.of[0].price);
        assert_true(bw_pricer_total(s.pricer) > cost);
        for (int i = 0; i < 100000; i++) bw_pricer_remove(s.pricer, t.of[0].price);
        assert_int_equal(bw_pricer_total(s.pricer), cost);
        before = cost;
        bw_tiling_clear(&e.model.ctx, &t);
        searching_close(&s, &e);
    }
    explorable_close(&e);
}

static void a_damaged_tiling_is_found(void **state) {
    (void)state;
    explorable e;
    searching s;
    bw_tiling t;
    explorable_open(&e, &(explore_case){"bearing", 2, 1, 0});
    bw_context *ctx = &e.model.ctx;
    searching_open(&s, &e, blocks_only);
    bw_serial_insert(&e.serial, e.order);
    bw_serial_walls(&e.serial, e.wall);
    kit_expect_ok(ctx, bw_tiling_init(ctx, &e.space, s.pricer, e.space.must, e.wall, &t));
    for (int damage = 0; damage < 4; damage++) {
        bw_context apart = *ctx;
        size_t p = 0;
        bw_block b = 0;
        while (!t.wall[p] || t.stays[p]) p++;
        while (t.box[b] != b) b++;
        if (damage == 0) t.count++;
        else if (damage == 1) t.wall[p] = 0;
        else if (damage == 2) t.of[b].size++;
        else t.box[b] = BW_NONE + 1 + (b == 0);
        kit_expect_status(&apart, bw_tiling_check(&apart, &t), BW_E_CHECK);
        ctx->memory = apart.memory;
        if (damage == 0) t.count--;
        else if (damage == 1) t.wall[p] = 1;
        else if (damage == 2) t.of[b].size--;
        else t.box[b] = b;
        kit_expect_ok(ctx, bw_tiling_check(ctx, &t));
    }
    bw_tiling_clear(ctx, &t);
    searching_close(&s, &e);
    explorable_close(&e);
}

/* ---- the space ----------------------------------------------------------------------------------------------------- */

static void a_damaged_space_is_found(void **state) {
    (void)state;
    explorable e;
    explorable_open(&e, &(explore_case){"bearing", 2, 1, 0});
    bw_space *x = &e.space;
    for (int damage = 0; damage < 5; damage++) {
        bw_context apart = e.model.ctx;
        size_t rim = 0, seed = 0, link = 0;
        while (x->rim[rim].straight == BW_NONE) rim++;
        while (seed < x->patch_count && !x->must[x->sheet_patch[seed]]) seed++;
        bw_rim kept = x->rim[rim];
        bw_sheet linked = x->link[link];
        if (damage == 0) x->rim[rim].straight = (bw_patch)((size_t)(kept.straight + 1) % x->patch_count);
        else if (damage == 1) x->must[x->sheet_patch[0]] = 0;
        else if (damage == 2) x->sheet_seeds[0] = 0;
        else if (damage == 3) x->link[link] = linked == 0 ? 1 : 0;
        else x->sheet_component[linked]++;
        kit_expect_status(&apart, bw_space_check(&apart, x), BW_E_CHECK);
        x->rim[rim] = kept, x->link[link] = linked;
        if (damage == 1) x->must[x->sheet_patch[0]] = 1;
        else if (damage == 2) x->sheet_seeds[0] = 1;
        else if (damage == 4) x->sheet_component[linked]--;
        e.model.ctx.memory = apart.memory;
    }
    explorable_close(&e);
}

static bw_status explore_all(bw_context *ctx, void *user) {
    explorable *e = user;
    bw_space space = {0};
    bw_explore_found found;
    bw_explore_choice choice = {.method = BW_EXPLORE_AUTO, .weight = {1, 0, 0, 0.5}, .beam = 5, .seed = 1, .work = 300, .retract = true};
    bw_status status = bw_space_init(ctx, &e->model.cells, &e->model.raw, &space);
    if (status == BW_OK) status = bw_explore(ctx, &space, &choice, e->wall, &found);
    bw_space_clear(ctx, &space);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    explorable e;
    explorable_open(&e, &(explore_case){"bearing", 2, 1, 0});
    size_t runs = kit_fail_each_allocation(explore_all, &e);
    assert_true(runs > 50);
    explorable_close(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(enumeration_finds_what_all_orders_give),
        cmocka_unit_test(an_enumeration_that_is_cut_short_is_not_complete),
        cmocka_unit_test(no_order_is_better_than_the_proven_optimum),
        cmocka_unit_test(what_a_method_counts_is_what_is_built),
        cmocka_unit_test(a_search_that_is_asked_to_finish_keeps_the_best),
        cmocka_unit_test(a_retraction_can_be_cancelled_or_asked_to_finish),
        cmocka_unit_test(cuts_and_joins_keep_a_tiling_and_can_be_undone),
        cmocka_unit_test(a_very_flat_box_is_dear),
        cmocka_unit_test(a_damaged_tiling_is_found),
        cmocka_unit_test(a_damaged_space_is_found),
        cmocka_unit_test(every_allocation_may_fail),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
