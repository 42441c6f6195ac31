/* Reduction: whatever is left is a valid, irreducible complex of the same body, and no singular wall is
 * missing that had to stay. */
#include "core/reduce_kit.h"

static const bw_reduce_mode modes[] = {BW_REDUCE_KEEP_SINGULAR, BW_REDUCE_FULL};

#define EXPECT(condition, r, ...)                                                                            \
    do {                                                                                                     \
        if (!(condition)) {                                                                                  \
            print_message("%s: ", (r)->name);                                                                \
            fail_msg(__VA_ARGS__);                                                                           \
        }                                                                                                    \
    } while (0)

/* ---- properties of every result --------------------------------------------------------------------- */

static __int128 side_area(const bw_complex *x, bw_block b, int side) {
    const int64_t *extent = x->block_extent[b];
    return (__int128)extent[(side / 2 + 1) % 3] * extent[(side / 2 + 2) % 3];
}

/* Whether two different blocks share nothing but one patch. */
static bool meet_once(const bw_complex *x, size_t patch) {
    const bw_block *b = x->patch_block[patch];
    size_t times = 0;
    for (size_t q = 0; q < x->patch_count; q++) {
        const bw_block *c = x->patch_block[q];
        times += (c[0] == b[0] && c[1] == b[1]) || (c[0] == b[1] && c[1] == b[0]);
    }
    return times == 1;
}

/* Irreducible by areas: no patch that may go is as large as the sides of both its blocks. */
static bool area_says_irreducible(const reducible *r, const bw_complex *x, bw_reduce_mode mode, bool split) {
    for (size_t p = 0; p < x->patch_count; p++) {
        const bw_block *b = x->patch_block[p];
        __int128 area = (__int128)x->patch_extent[p][0] * x->patch_extent[p][1];
        if (b[1] == BW_NONE || b[0] == b[1]) continue;
        if (mode == BW_REDUCE_KEEP_SINGULAR && reducible_is_singular(r, x, p)) continue;
        if (split && !meet_once(x, p)) continue;
        if (area == side_area(x, b[0], x->patch_side[p][0]) &&
            area == side_area(x, b[1], x->patch_side[p][1]))
            return false;
    }
    return true;
}

/* Walls only go, never on the boundary, and with keep-singular none of a patch with a singular edge in its
 * rim. */
static void expect_walls(const reducible *r, bw_reduce_mode mode) {
    for (size_t p = 0; p < r->cells.polygon_count; p++) {
        uint8_t was = r->polygon_flags[p], is = r->cells.polygon[p].flags;
        EXPECT(is == was || (was & BW_WALL && !(was & BW_BOUNDARY) && is == 0), r,
               "polygon %zu: flags %d became %d", p, was, is);
    }
    for (size_t p = 0; p < r->raw.patch_count && mode == BW_REDUCE_KEEP_SINGULAR; p++) {
        if (!reducible_is_singular(r, &r->raw, p)) continue;
        for (size_t i = r->raw.patch_polygon_begin[p]; i < r->raw.patch_polygon_begin[p + 1]; i++)
            EXPECT(r->cells.polygon[r->raw.patch_polygon[i]].flags & BW_WALL, r,
                   "patch %zu is singular, and is gone", p);
    }
}

static void expect_same_body(const reducible *r, const bw_complex *x) {
    mpz_t before, after;
    mpz_inits(before, after, NULL);
    complex_volume(&r->raw, before), complex_volume(x, after);
    EXPECT(mpz_cmp(before, after) == 0, r, "the volume changed");
    EXPECT(complex_euler(x) == complex_euler(&r->raw), r, "Euler characteristic %ld became %ld",
           complex_euler(&r->raw), complex_euler(x));
    mpz_clears(before, after, NULL);
}

static bool touches_itself_across(const bw_complex *x) {
    for (size_t p = 0; p < x->patch_count; p++)
        if (x->patch_block[p][0] == x->patch_block[p][1] &&
            x->patch_side[p][0] >> 1 == x->patch_side[p][1] >> 1 &&
            x->patch_side[p][0] != x->patch_side[p][1])
            return true;
    return false;
}

static void expect_valid(reducible *r, const bw_complex *x, const bw_reduce_options *how,
                         const bw_reduce_report *report) {
    kit_expect_ok(&r->ctx, bw_cells_check(&r->ctx, &r->cells));
    kit_expect_ok(&r->ctx, bw_complex_check(&r->ctx, &r->cells, x));
    bw_reduction_rules rules = {how->mode, how->split_self_adjacent, NULL};
    bw_patch left = bw_complex_removable_patch(x, &rules);
    EXPECT(left == BW_NONE, r, "patch %d could be removed", left);
    EXPECT(area_says_irreducible(r, x, how->mode, how->split_self_adjacent), r,
           "a patch is a whole side of both its blocks");
    EXPECT(!how->split_self_adjacent || !touches_itself_across(x), r,
           "a block touches itself across opposite sides");
    EXPECT(report->blocks == x->block_count && report->blocks_before == r->raw.block_count, r,
           "the report counts other blocks");
    EXPECT(report->blocks <= report->blocks_farthest_first &&
               report->blocks_farthest_first <= report->blocks_before,
           r, "blocks %zu, farthest first %zu, before %zu", report->blocks, report->blocks_farthest_first,
           report->blocks_before);
    expect_walls(r, how->mode);
    expect_same_body(r, x);
}

static size_t reduce_and_expect(reducible *r, const bw_reduce_options *how) {
    bw_complex x;
    bw_reduce_report report;
    bw_status status = reducible_reduce(&r->ctx, r, how, &x, &report);
    if (status != BW_OK) print_message("%s:\n", r->name);
    kit_expect_ok(&r->ctx, status);
    expect_valid(r, &x, how, &report);
    size_t blocks = x.block_count;
    bw_complex_clear(&r->ctx, &x);
    return blocks;
}

static void reduce_every_way(reducible *r, bool split) {
    size_t before = r->raw.block_count;
    EXPECT(!split || !touches_itself_across(&r->raw), r, "a block touches itself across opposite sides");
    for (int m = 0; m < 2; m++) {
        bw_reduce_options how = {modes[m], split, 0};
        size_t paper = reduce_and_expect(r, &how);
        how.effort = 1;
        size_t blocks = reduce_and_expect(r, &how);
        EXPECT(blocks <= before, r, "%s: %zu blocks became %zu", m ? "full" : "keep-singular", before,
               blocks);
        EXPECT(blocks <= paper, r, "%s: %zu blocks with effort 1, %zu with 0", m ? "full" : "keep-singular",
               blocks, paper);
        before = blocks; /* full removes no less than keep-singular */
    }
}

static void every_result_is_valid_and_irreducible(void **state) {
    (void)state;
    size_t models;
    const bw_model_info *list = bw_model_list(&models);
    for (size_t m = 0; m < models; m++)
        for (int i = 0; i < 12; i++) {
            bool large = list[m].blocks_bc > 20, split = i / 3 & 1;
            bw_model_options options =
                reduce_options_of(i < 6 || large ? 1 : 2, kit_seed() + (uint64_t)i / 6);
            if (i >= 6 && !large) options.scramble = BW_SCRAMBLE_BLOCKS, options.perturb = 1e-7;
            if (large && i >= 6) continue;
            reducible r;
            reducible_open(&r, list[m].name, &options, (bw_complex_kind)(i % 3), split);
            reduce_every_way(&r, split);
            reducible_close(&r);
        }
}

/* ---- numbers ---------------------------------------------------------------------------------------- */

/* Blocks with effort 1, mc. With keep-singular none of these can lose a wall: each of them has a singular
 * edge or is all that keeps a torus open. Full: l-shape   not convex, so two plus      only one block holds
 * the middle, and with it at most two opposite arms: four arms are left cylinder  a ring around the core that
 * touches itself; one block alone would be regular inside ball      MC Table 2 (sphere) tee, plate: the
 * fewest that a search of any length has found */
static const struct {
    const char *name;
    size_t keep, full;
} known[] = {{"cuboid", 1, 1},     {"l-shape", 3, 2}, {"plus", 7, 5}, {"cylinder", 5, 2},
             {"ball", 7, 2},       {"torus", 1, 1},   {"tee", 9, 4},  {"torus-quarter", 1, 1},
             {"torus-half", 1, 1}, {"plate", 21, 7}};

static void known_models_get_their_known_minimum(void **state) {
    (void)state;
    for (size_t m = 0; m < sizeof known / sizeof *known; m++)
        for (int kind = BW_COMPLEX_MC; kind <= BW_COMPLEX_BC; kind++) {
            bw_model_options options = reduce_options_of(1, kit_seed() + 5);
            reducible r;
            reducible_open(&r, known[m].name, &options, (bw_complex_kind)kind, false);
            size_t keep = reduce_and_expect(&r, &(bw_reduce_options){BW_REDUCE_KEEP_SINGULAR, false, 1});
            size_t full = reduce_and_expect(&r, &(bw_reduce_options){BW_REDUCE_FULL, false, 1});
            EXPECT(keep == known[m].keep && full == known[m].full, &r,
                   "keep-singular %zu, full %zu; %zu, %zu expected", keep, full, known[m].keep,
                   known[m].full);
            reducible_close(&r);
        }
}

static void more_effort_is_never_worse(void **state) {
    (void)state;
    static const char *const names[] = {"plate", "bearing", "part"};
    for (int m = 0; m < 3; m++) {
        bw_model_options options = reduce_options_of(1, kit_seed());
        reducible r;
        reducible_open(&r, names[m], &options, BW_COMPLEX_MC, false);
        size_t best = r.raw.block_count;
        for (int effort = 0; effort <= 2; effort++) {
            size_t blocks = reduce_and_expect(&r, &(bw_reduce_options){BW_REDUCE_FULL, false, effort});
            EXPECT(blocks <= best, &r, "%zu blocks with effort %d, %zu with less", blocks, effort, best);
            best = blocks;
        }
        EXPECT(best < r.raw.block_count, &r, "nothing was removed");
        reducible_close(&r);
    }
}

static void mode_none_changes_nothing(void **state) {
    (void)state;
    bw_model_options options = reduce_options_of(1, kit_seed());
    reducible r;
    reducible_open(&r, "plate", &options, BW_COMPLEX_MC, false);
    bw_complex x;
    bw_reduce_report report;
    kit_expect_ok(&r.ctx,
                  reducible_reduce(&r.ctx, &r, &(bw_reduce_options){BW_REDUCE_NONE, false, 3}, &x, &report));
    assert_int_equal(x.block_count, r.raw.block_count);
    assert_int_equal(report.patches_removed, 0);
    assert_int_equal(report.runs, 0);
    for (size_t p = 0; p < r.cells.polygon_count; p++)
        assert_int_equal(r.cells.polygon[p].flags, r.polygon_flags[p]);
    bw_complex_clear(&r.ctx, &x);
    reducible_close(&r);
}

static void the_same_walls_go_each_time(void **state) {
    (void)state;
    bw_model_options options = reduce_options_of(1, kit_seed());
    reducible r[2];
    for (int i = 0; i < 2; i++) { /* traced twice, too */
        reducible_open(&r[i], "part", &options, BW_COMPLEX_MC, false);
        for (int twice = 0; twice < 2; twice++)
            reduce_and_expect(&r[i], &(bw_reduce_options){BW_REDUCE_FULL, false, 1});
    }
    assert_int_equal(r[0].cells.polygon_count, r[1].cells.polygon_count);
    for (size_t p = 0; p < r[0].cells.polygon_count; p++)
        assert_int_equal(r[0].cells.polygon[p].flags, r[1].cells.polygon[p].flags);
    for (size_t e = 0; e < r[0].cells.edge_count; e++)
        assert_int_equal(r[0].cells.edge[e].flags, r[1].cells.edge[e].flags);
    for (int i = 0; i < 2; i++) {
        uint8_t *first = malloc(r[i].cells.polygon_count);
        for (size_t p = 0; p < r[i].cells.polygon_count; p++) first[p] = r[i].cells.polygon[p].flags;
        reduce_and_expect(&r[i], &(bw_reduce_options){BW_REDUCE_FULL, false, 1});
        for (size_t p = 0; p < r[i].cells.polygon_count; p++)
            assert_int_equal(first[p], r[i].cells.polygon[p].flags);
        free(first);
        reducible_close(&r[i]);
    }
}

/* ---- what the tests above would find ---------------------------------------------------------------- */

/* Irreducible for real: whichever wall that may go is taken away from the reduced complex, what is left is no
 * complex of cuboids. */
static size_t expect_every_wall_is_needed(reducible *r, const bw_complex *x, bw_reduce_mode mode) {
    size_t tried = 0;
    for (size_t p = 0; p < x->patch_count; p++) {
        if (x->patch_flags[p] & BW_PATCH_BOUNDARY) continue;
        if (mode == BW_REDUCE_KEEP_SINGULAR && reducible_is_singular(r, x, p)) continue;
        size_t begin = x->patch_polygon_begin[p], end = x->patch_polygon_begin[p + 1], tori;
        uint8_t flags = r->cells.polygon[x->patch_polygon[begin]].flags;
        for (size_t i = begin; i < end; i++) r->cells.polygon[x->patch_polygon[i]].flags = 0;
        bw_context ctx;
        bw_context_init(&ctx);
        bw_complex without;
        bw_status status = reducible_read(&ctx, r, &without, &tori);
        if (status == BW_OK && tori == 0) status = bw_complex_check(&ctx, &r->cells, &without);
        EXPECT(status == BW_E_CHECK || tori > 0, r, "all is well without patch %zu", p);
        bw_complex_clear(&ctx, &without);
        for (size_t i = begin; i < end; i++) r->cells.polygon[x->patch_polygon[i]].flags = flags;
        tried++;
    }
    return tried;
}

static void without_any_wall_that_is_left_some_block_is_no_cuboid(void **state) {
    (void)state;
    static const char *const names[] = {"l-shape",       "plus", "cylinder", "ball",
                                        "torus-quarter", "tee",  "plate",    "bearing"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++)
        for (int mode = 0; mode < 2; mode++) {
            bw_model_options options = reduce_options_of(1, kit_seed() + 3);
            reducible r;
            reducible_open(&r, names[m], &options, BW_COMPLEX_MC, false);
            bw_complex x;
            bw_reduce_report report;
            bw_reduce_options how = {modes[mode], false, 1};
            kit_expect_ok(&r.ctx, reducible_reduce(&r.ctx, &r, &how, &x, &report));
            size_t tried = expect_every_wall_is_needed(&r, &x, modes[mode]);
            assert_true(mode == 0 || tried > 0);
            bw_complex_clear(&r.ctx, &x);
            reducible_close(&r);
        }
}

/* A removed wall is put back: where that makes a complex, the independent test names a patch of it. */
static void a_wall_too_many_is_found(void **state) {
    (void)state;
    bw_model_options options = reduce_options_of(1, kit_seed());
    reducible r;
    reducible_open(&r, "part", &options, BW_COMPLEX_MC, false);
    for (int m = 0; m < 2; m++) {
        bw_reduction_rules rules = {modes[m], false, NULL};
        assert_int_not_equal(bw_complex_removable_patch(&r.raw, &rules), BW_NONE);
        assert_false(area_says_irreducible(&r, &r.raw, modes[m], false));
        reduce_and_expect(&r, &(bw_reduce_options){modes[m], false, 1});
        size_t found = 0, tori;
        for (size_t p = 0; p < r.raw.patch_count; p++) {
            if (r.cells.polygon[r.raw.patch_polygon[r.raw.patch_polygon_begin[p]]].flags & BW_WALL) continue;
            reducible_set_wall(&r, p, true);
            bw_context ctx;
            bw_context_init(&ctx);
            bw_complex x;
            if (reducible_read(&ctx, &r, &x, &tori) == BW_OK && tori == 0) {
                if (bw_complex_removable_patch(&x, &rules) == BW_NONE ||
                    area_says_irreducible(&r, &x, modes[m], false))
                    fail_msg("patch %zu was put back and is not found", p);
                found++;
            }
            bw_complex_clear(&ctx, &x);
            reducible_set_wall(&r, p, false);
        }
        assert_true(found > 0);
    }
    reducible_close(&r);
}

/* ---- failures --------------------------------------------------------------------------------------- */

static bw_status reduce_and_clear(bw_context *ctx, void *user) {
    bw_complex x;
    bw_reduce_report report;
    bw_status status =
        reducible_reduce(ctx, user, &(bw_reduce_options){BW_REDUCE_FULL, false, 0}, &x, &report);
    bw_complex_clear(ctx, &x);
    return status;
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    bw_model_options options = reduce_options_of(1, kit_seed());
    reducible r;
    reducible_open(&r, "ball", &options, BW_COMPLEX_MC, false);
    assert_true(kit_fail_each_allocation(reduce_and_clear, &r) > 50);
    reducible_close(&r);
}

static void reduction_can_be_cancelled(void **state) {
    (void)state;
    static volatile sig_atomic_t cancel = 1;
    bw_model_options options = reduce_options_of(1, kit_seed());
    reducible r;
    reducible_open(&r, "ball", &options, BW_COMPLEX_MC, false);
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.cancel = &cancel;
    kit_expect_status(&ctx, reduce_and_clear(&ctx, &r), BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, 0);
    reducible_close(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_result_is_valid_and_irreducible),
        cmocka_unit_test(known_models_get_their_known_minimum),
        cmocka_unit_test(more_effort_is_never_worse),
        cmocka_unit_test(mode_none_changes_nothing),
        cmocka_unit_test(the_same_walls_go_each_time),
        cmocka_unit_test(without_any_wall_that_is_left_some_block_is_no_cuboid),
        cmocka_unit_test(a_wall_too_many_is_found),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(reduction_can_be_cancelled),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
