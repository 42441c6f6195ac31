/* Sanitization repairs every sample model, whatever its charts, and keeps what the map means (MC 6). */
#include "sanitize_kit.h"

#include "mesh/seams.h"

static double shortest_edge(const bw_model *m) {
    double least = INFINITY;
    for (size_t t = 0; t < m->tet_count; t++)
        for (int e = 0; e < 6; e++) {
            const double *a = m->parameter[t][bw_tet_edge_corners[e][0]],
                         *b = m->parameter[t][bw_tet_edge_corners[e][1]];
            least = fmin(least, sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                                     (a[2] - b[2]) * (a[2] - b[2])));
        }
    return least;
}

/* Walking around edges, which the map's own derivation does not do, gives the same quarter turns. */
static void check_turns(sanitized *s) {
    bw_hinges hinges = {0};
    bw_seams seams = {0};
    kit_expect_ok(&s->ctx, bw_hinges_init(&s->ctx, &hinges, &s->mesh));
    kit_expect_ok(&s->ctx,
                  bw_seams_init(&s->ctx, &seams, &s->mesh, &hinges, (const int64_t(*)[4][3])s->map.value, NULL,
                                0));
    assert_true(seams.exact);
    assert_int_equal(hinges.count, s->mesh.edge_count);
    for (size_t h = 0; h < hinges.count; h++) {
        assert_int_equal(seams.quarters[h], s->map.quarters[h]);
        assert_int_equal(hinges.ring[h].open, s->map.edge_flags[h] & BW_EDGE_BOUNDARY);
    }
    bw_seams_clear(&s->ctx, &seams);
    bw_hinges_clear(&s->ctx, &hinges);
}

/* Perturbed and clean, the same mesh has the same singular edges; nothing moves further than its errors
 * reach. */
static void check_repair(const char *name, bw_model_options o, double perturb) {
    print_message("%s: size %d noise %g perturb %g scramble %d features %d seed %llu\n", name, o.size,
                  o.noise, perturb, o.scramble, o.features, (unsigned long long)o.seed);
    o.perturb = 0;
    bw_model clean = make_model(name, &o);
    o.perturb = perturb;
    bw_model model = make_model(name, &o);
    sanitized a, b;
    sanitize_model(&a, &clean, 1e-9);
    sanitize_model(&b, &model, 8 * perturb);
    kit_expect_ok(&a.ctx, a.status);
    kit_expect_ok(&b.ctx, b.status);
    assert_false(b.report.already_exact);
    check_exact(&b);
    check_turns(&b);
    assert_memory_equal(a.map.quarters, b.map.quarters, a.mesh.edge_count * sizeof *a.map.quarters);
    assert_null(b.mesh.parameter);
    assert_true(b.report.system_rank <= b.report.system_columns);
    assert_int_equal(b.report.system_rank + b.report.free_variables, b.report.system_columns);
    double reach = perturb * shortest_edge(&clean);
    print_message("   displacement %.2f times the perturbation, %zu x %zu\n",
                  b.report.displacement_max / reach, b.report.system_rows, b.report.system_columns);
    assert_true(b.report.displacement_max > 0 && b.report.displacement_max < 40 * reach);
    drop_sanitized(&a);
    drop_sanitized(&b);
    drop_model(&clean);
    drop_model(&model);
}

static void every_model_is_repaired_in_every_kind_of_chart(void **state) {
    kit_random random = kit_random_start(1);
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++)
        for (int scramble = BW_SCRAMBLE_NONE; scramble <= BW_SCRAMBLE_TETS; scramble++) {
            bw_model_options o =
                model_options(1, scramble % 2 ? 0 : 0.7, 0, scramble, kit_random_next(&random));
            check_repair(list[i].name, o, scramble % 2 ? 1e-3 : 1e-7);
        }
}

static void small_models_are_repaired_for_many_seeds(void **state) {
    static const char *const names[] = {"l-shape",       "plus",       "ball", "cylinder",
                                        "torus-quarter", "torus-half", "tee"};
    kit_random random = kit_random_start(2);
    (void)state;
    for (int i = 0; i < 40; i++) {
        int scramble = (int)kit_random_below(&random, 4);
        bw_model_options o =
            model_options(1, kit_random_range(&random, 0.1, 1), 0, scramble, kit_random_next(&random));
        o.stretch = kit_random_range(&random, 0.3, 3);
        o.features = (int)kit_random_below(&random, 2);
        check_repair(names[kit_random_below(&random, 7)], o, pow(10, -kit_random_range(&random, 2.5, 9)));
    }
}

static void finer_models_are_repaired(void **state) {
    kit_random random = kit_random_start(3);
    (void)state;
    check_repair("cylinder", model_options(2, 1, 0, BW_SCRAMBLE_BLOCKS, kit_random_next(&random)), 1e-4);
    check_repair("hollow-torus", model_options(2, 0.5, 0, BW_SCRAMBLE_CELLS, kit_random_next(&random)), 1e-4);
    check_repair("part", model_options(2, 0.5, 0, BW_SCRAMBLE_NONE, kit_random_next(&random)), 1e-4);
}

static void the_result_does_not_depend_on_the_run(void **state) {
    bw_model_options o = model_options(2, 0.8, 1e-4, BW_SCRAMBLE_TETS, kit_seed());
    bw_model model = make_model("torus-quarter", &o);
    sanitized a, b;
    (void)state;
    sanitize_model(&a, &model, 1e-2);
    sanitize_model(&b, &model, 1e-2);
    kit_expect_ok(&a.ctx, a.status);
    kit_expect_ok(&b.ctx, b.status);
    assert_memory_equal(a.map.value, b.map.value, a.mesh.tet_count * sizeof *a.map.value);
    assert_true(a.report.displacement_max == b.report.displacement_max);
    drop_sanitized(&a);
    drop_sanitized(&b);
    drop_model(&model);
}

typedef struct {
    const char *name;
    size_t cut_sheets, align_sheets, branches, nodes;
} figures;

/* Figures that follow from the shape. A cuboid's boundary is its cube graph and needs no cut. A ring of
 * square section is cut by one disc; its four sides, cut there too, are one strip each, whatever the twist by
 * which the disc glues them to each other; the disc's rim has four edges, and four edges run once around the
 * ring. */
static void the_cut_of_simple_models_is_the_simple_one(void **state) {
    static const figures list[] = {{"cuboid", 0, 6, 12, 8},       {"l-shape", 0, 8, 18, 12},
                                   {"plus", 0, 30, 60, 32},       {"torus", 1, 4, 8, 4},
                                   {"torus-quarter", 1, 4, 8, 4}, {"torus-half", 1, 4, 8, 4}};
    (void)state;
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        bw_model_options o = model_options(1, 0, 1e-5, BW_SCRAMBLE_NONE, kit_seed());
        bw_model model = make_model(list[i].name, &o);
        sanitized s;
        sanitize_model(&s, &model, 1e-3);
        kit_expect_ok(&s.ctx, s.status);
        print_message("%s: sheets %zu + %zu branches %zu nodes %zu\n", list[i].name, s.report.cut_sheets,
                      s.report.align_sheets, s.report.branches, s.report.nodes);
        assert_int_equal(s.report.cut_sheets, list[i].cut_sheets);
        assert_int_equal(s.report.align_sheets, list[i].align_sheets);
        assert_int_equal(s.report.branches, list[i].branches);
        assert_int_equal(s.report.nodes, list[i].nodes);
        drop_sanitized(&s);
        drop_model(&model);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_model_is_repaired_in_every_kind_of_chart),
        cmocka_unit_test(small_models_are_repaired_for_many_seeds),
        cmocka_unit_test(the_cut_of_simple_models_is_the_simple_one),
        cmocka_unit_test(finer_models_are_repaired),
        cmocka_unit_test(the_result_does_not_depend_on_the_run),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
