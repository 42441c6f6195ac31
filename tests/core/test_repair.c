/* Local defects are repaired where the fix is certain, wherever they are, and nothing that the map means
 * changes. */
#include "core/fold_kit.h"

/* Least ratio of a tet's volume in the map after to before. */
static double thinnest(const folder *f, const sanitized *s) {
    double least = INFINITY, scale = ldexp(1, 3 * (s->map.exponent - f->clean.map.exponent));
    for (size_t t = 0; t < s->mesh.tet_count; t++) {
        double volume[2];
        for (int i = 0; i < 2; i++) {
            int64_t(*u)[3] = i ? s->map.value[t] : f->clean.map.value[t];
            double d[3][3];
            for (int c = 0; c < 9; c++) d[c / 3][c % 3] = (double)(u[c / 3 + 1][c % 3] - u[0][c % 3]);
            volume[i] = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) -
                        d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                        d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
        }
        least = fmin(least, volume[1] / (scale * volume[0]));
    }
    return least;
}

static void move_by(const folder *f, const fold_star *star, double reach, sanitized *s) {
    int64_t extent[3], delta[3];
    fold_extent(f, star, extent);
    for (int k = 0; k < 3; k++) delta[k] = star->free & 1 << k ? llrint(reach * (double)extent[k]) : 0;
    fold_move(f, star, s, delta);
}

/* How far the vertex can be moved, in units of a tet, until the first tet at it is flat. */
static double reach_of_flat(const folder *f, const fold_star *star) {
    double low = 0, high = 4;
    for (int step = 0; step < 60; step++) {
        double middle = 0.5 * (low + high);
        bool flat = false;
        int64_t extent[3], d[3];
        fold_extent(f, star, extent);
        for (size_t i = 0; i < star->count; i++) {
            int64_t u[4][3];
            memcpy(u, f->clean.map.value[star->corner[i] / 4], sizeof u);
            for (int k = 0; k < 3; k++) d[k] = star->free & 1 << k ? llrint(middle * (double)extent[k]) : 0;
            bw_rotate(star->turn[i], d, d);
            for (int k = 0; k < 3; k++) u[star->corner[i] % 4][k] += d[k];
            flat = flat || bw_grid_tet_sign((const int64_t(*)[3])u) <= 0;
        }
        if (flat)
            high = middle;
        else
            low = middle;
    }
    return low;
}

typedef struct {
    const char *place;
    int is, not ;
} place;

static const place places[] = {
    {"inside", 0, FOLD_BOUNDARY | FOLD_SINGULAR | FOLD_NEAR_SINGULAR},
    {"on the boundary", FOLD_BOUNDARY, FOLD_SINGULAR},
    {"beside a singular edge", FOLD_NEAR_SINGULAR, FOLD_BOUNDARY},
    {"on an inner singular edge", FOLD_SINGULAR, FOLD_BOUNDARY},
    {"on a sharp edge", FOLD_SINGULAR | FOLD_BOUNDARY, 0},
    {"at a seam", FOLD_SEAM, FOLD_BOUNDARY | FOLD_SINGULAR},
    {"at a seam on the boundary", FOLD_SEAM | FOLD_BOUNDARY, 0},
    {"on a feature edge", FOLD_FEATURE, 0},
};
enum { PLACES = sizeof places / sizeof *places };

/* One fold; true if tets were inverted, and then they have been repaired. */
static bool fold_and_repair(const folder *f, const place *where, kit_random *random, double *least) {
    sanitized s;
    bw_vertex v;
    fold_star star;
    if (!fold_pick(f, random, where->is, where->not, &v, &star)) return false;
    fold_copy(f, &s);
    fold_past(f, random, &star, 1.3, &s);
    repair_mesh(&s, 1e-6);
    if (s.status) print_message("%s: vertex %d, axes %d\n", where->place, v, star.free);
    kit_expect_ok(&s.ctx, s.status);
    bool folded = s.report.repaired;
    if (folded) {
        assert_true(s.report.defective_tets >= 1 && s.report.region_count == 1 &&
                    s.report.vertices_moved >= 1);
        assert_true(s.report.repair_displacement_max > 0 && !s.report.already_exact);
        fold_expect_same_meaning(f, &s);
        check_exact(&s);
        double thin = thinnest(f, &s);
        assert_true(thin > 0);
        *least = fmin(*least, thin);
    }
    drop_sanitized(&s);
    return folded;
}

static void a_fold_is_repaired_wherever_it_is(void **state) {
    static const char *const names[] = {"ball", "cylinder", "torus-quarter", "plus"};
    size_t done[PLACES] = {0};
    kit_random random = kit_random_start(1);
    (void)state;
    for (size_t n = 0; n < sizeof names / sizeof *names; n++)
        for (int scramble = BW_SCRAMBLE_NONE; scramble <= BW_SCRAMBLE_TETS; scramble++) {
            bw_model_options o = model_options(2, 0.5, 0, scramble, kit_random_next(&random));
            folder f;
            double least = INFINITY;
            o.features = 1;
            fold_start(&f, make_model(names[n], &o), 1e-9);
            for (size_t p = 0; p < PLACES; p++)
                for (int i = 0; i < 2; i++) done[p] += fold_and_repair(&f, &places[p], &random, &least);
            print_message("%s, charts %d: thinnest tet has %.3f of its volume\n", names[n], scramble, least);
            fold_end(&f);
        }
    for (size_t p = 0; p < PLACES; p++) {
        print_message("%s: %zu\n", places[p].place, done[p]);
        assert_true(done[p] >= 5);
    }
}

/* Random models of every family, some with errors, with several folds of random reach. What comes out is
 * either a map that turns around every edge as the clean one, or refused by place. */
static void random_folds_are_repaired_or_refused_by_place(void **state) {
    size_t count, repaired = 0, refused = 0;
    const bw_model_info *list = bw_model_list(&count);
    kit_random random = kit_random_start(2);
    (void)state;
    for (size_t i = 0; i < 3 * count; i++) {
        bw_model_options o =
            model_options(1 + (int)kit_random_below(&random, 2), kit_random_unit(&random), 0,
                          (int)kit_random_below(&random, 4), kit_random_next(&random) % 1000000);
        o.features = (int)kit_random_below(&random, 2);
        o.stretch = exp2(kit_random_range(&random, -1, 1));
        bw_model model = make_model(list[i % count].name, &o);
        sanitized clean, s;
        sanitize_model(&clean, &model, 1e-9);
        kit_expect_ok(&clean.ctx, clean.status);
        drop_model(&model);
        o.folds = 1 + (int)kit_random_below(&random, 6);
        o.perturb = kit_random_below(&random, 2) ? pow(10, kit_random_range(&random, -9, -3)) : 0;
        model = make_model(list[i % count].name, &o);
        s = (sanitized){0};
        bw_context_init(&s.ctx);
        kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
        repair_mesh(&s, 0.02);
        print_message("%s size %d noise %.2f perturb %.1g scramble %d features %d stretch %.2f folds %d seed "
                      "%llu: %s\n",
                      list[i % count].name, o.size, o.noise, o.perturb, o.scramble, o.features, o.stretch,
                      o.folds, (unsigned long long)o.seed, s.status ? s.ctx.error.message : "repaired");
        if (s.status) {
            expect_refused(&s);
            refused++;
        } else {
            check_exact(&s);
            assert_memory_equal(clean.map.quarters, s.map.quarters,
                                s.mesh.edge_count * sizeof *s.map.quarters);
            repaired += s.report.repaired;
        }
        drop_sanitized(&clean);
        drop_sanitized(&s);
        drop_model(&model);
    }
    print_message("%zu repaired, %zu refused\n", repaired, refused);
    assert_true(repaired >= 9 * refused && repaired > count);
}

enum { TRIES = 25 };

/* The noisy map's tets are positive, but not those of the exact one next to it: found only after the system
 * is solved. */
static void tets_that_only_the_exact_map_inverts_are_repaired(void **state) {
    bw_model_options o = model_options(2, 0.5, 0, BW_SCRAMBLE_BLOCKS, kit_seed());
    kit_random random = kit_random_start(3);
    size_t late = 0;
    folder f;
    (void)state;
    fold_start(&f, make_model("cylinder", &o), 1e-9);
    for (int i = 0; i < TRIES; i++) {
        sanitized plain, s;
        bw_vertex v;
        fold_star star;
        assert_true(fold_pick(&f, &random, 0, FOLD_BOUNDARY | FOLD_SINGULAR, &v, &star));
        double flat = reach_of_flat(&f, &star);
        for (int repair = 0; repair < 2; repair++) {
            sanitized *to = repair ? &s : &plain;
            kit_random noise = kit_random_start(100 + (uint64_t)i);
            fold_copy(&f, to);
            move_by(&f, &star, flat, to);
            for (size_t k = 0; k < 12 * to->mesh.tet_count; k++)
                to->mesh.parameter[k / 12][k % 12 / 3][k % 3] += kit_random_range(&noise, -1e-6, 1e-6);
            if (repair)
                repair_mesh(to, 1e-2);
            else
                sanitize_mesh(to, 1e-2);
        }
        kit_expect_ok(&s.ctx, s.status);
        check_exact(&s);
        assert_memory_equal(s.map.quarters, f.clean.map.quarters, s.mesh.edge_count * sizeof *s.map.quarters);
        assert_int_equal(plain.status != BW_OK, s.report.repaired);
        late += plain.status && strstr(plain.ctx.error.message, "flat");
        drop_sanitized(&plain);
        drop_sanitized(&s);
    }
    print_message("%zu of %d were found after solving\n", late, TRIES);
    assert_true(late >= 1);
    fold_end(&f);
}

static void a_collapsed_region_inside_one_chart_is_spread_out_again(void **state) {
    (void)state;
    for (int noise = 0; noise < 2; noise++) {
        sanitized s;
        double middle[3], extent;
        start_cuboid(&s, 6, 0.5 * noise, middle, &extent);
        collapse(&s, middle, 0.3 * extent, false);
        repair_mesh(&s, 1e-6);
        kit_expect_ok(&s.ctx, s.status);
        print_message("%zu tets in %zu regions, %zu vertices, %d rings\n", s.report.defective_tets,
                      s.report.region_count, s.report.vertices_moved, s.report.rings);
        assert_true(s.report.defective_tets > 100);
        check_exact(&s);
        drop_sanitized(&s);
    }
}

/* ---- the same result ---- */

static void the_result_does_not_depend_on_the_order_of_the_tets(void **state) {
    bw_model_options o = model_options(2, 0.8, 1e-5, BW_SCRAMBLE_CELLS, kit_seed());
    kit_random random = kit_random_start(5);
    o.folds = 12;
    bw_model model = make_model("torus-quarter", &o);
    sanitized first;
    (void)state;
    for (int shuffle = 0; shuffle < 5; shuffle++) {
        sanitized s = {0};
        bw_context_init(&s.ctx);
        s.ctx.threads = 1 + shuffle % 2;
        kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
        for (size_t i = s.mesh.tet_count; shuffle && i > 1; i--) {
            size_t k = (size_t)kit_random_below(&random, i);
            bw_vertex tet[4];
            double parameter[4][3];
            memcpy(tet, s.mesh.tet[k], sizeof tet);
            memcpy(s.mesh.tet[k], s.mesh.tet[i - 1], sizeof tet);
            memcpy(s.mesh.tet[i - 1], tet, sizeof tet);
            memcpy(parameter, s.mesh.parameter[k], sizeof parameter);
            memcpy(s.mesh.parameter[k], s.mesh.parameter[i - 1], sizeof parameter);
            memcpy(s.mesh.parameter[i - 1], parameter, sizeof parameter);
        }
        repair_mesh(&s, 1e-2);
        kit_expect_ok(&s.ctx, s.status);
        assert_true(s.report.repaired);
        if (shuffle) {
            assert_memory_equal(s.map.value, first.map.value, s.mesh.tet_count * sizeof *s.map.value);
            assert_int_equal(s.report.vertices_moved, first.report.vertices_moved);
            drop_sanitized(&s);
        } else {
            first = s;
        }
    }
    drop_sanitized(&first);
    drop_model(&model);
}

static bw_status repair_once(bw_context *ctx, void *user) {
    bw_tet_mesh mesh = {0};
    bw_grid_map map = {0};
    bw_sanitize_report report;
    bw_sanitize_options options = {.tolerance = 1e-2, .repair = true};
    bw_status status = mesh_from_model(ctx, user, &mesh);
    if (status == BW_OK) status = bw_sanitize(ctx, &options, &mesh, &map, &report);
    if (status == BW_OK) assert_true(report.repaired);
    bw_tet_mesh_clear(ctx, &mesh);
    bw_grid_map_clear(ctx, &map);
    return status;
}

static void every_failing_allocation_is_reported(void **state) {
    bw_model_options o = model_options(1, 0.5, 1e-4, BW_SCRAMBLE_NONE, 3);
    (void)state;
    o.folds = 6;
    bw_model model = make_model("plus", &o);
    print_message("%zu allocations\n", kit_fail_each_allocation(repair_once, &model) - 1);
    drop_model(&model);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fold_is_repaired_wherever_it_is),
        cmocka_unit_test(random_folds_are_repaired_or_refused_by_place),
        cmocka_unit_test(tets_that_only_the_exact_map_inverts_are_repaired),
        cmocka_unit_test(a_collapsed_region_inside_one_chart_is_spread_out_again),
        cmocka_unit_test(the_result_does_not_depend_on_the_order_of_the_tets),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
