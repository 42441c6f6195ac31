/* What cannot be repaired with certainty is refused by place; repair changes nothing about other defects. */
#include "core/fold_kit.h"

static void expect_place(const sanitized *s, const double at[3], double within) {
    expect_refused(s);
    for (size_t r = 0; r < s->ctx.error.region_count && r < BW_REGIONS_KEPT; r++) {
        double far = 0;
        for (int k = 0; k < 3; k++) far = fmax(far, fabs(s->ctx.error.regions[r].centre[k] - at[k]));
        assert_true(far <= within);
    }
}

static void a_collapsed_corner_of_the_model_is_refused_by_place(void **state) {
    sanitized s;
    double at[3], extent;
    (void)state;
    start_cuboid(&s, 6, 0.5, at, &extent);
    memcpy(at, s.mesh.position[0], sizeof at);
    collapse(&s, at, 0.4 * extent, true);
    repair_mesh(&s, 1e-6);
    print_message("%s\n", s.ctx.error.message);
    expect_place(&s, at, 0.6 * extent);
    drop_sanitized(&s);
}

static void a_collapsed_region_that_is_too_large_is_refused(void **state) {
    sanitized s;
    double middle[3], extent;
    (void)state;
    start_cuboid(&s, 18, 0, middle, &extent);
    collapse(&s, middle, 2 * extent, false);
    repair_mesh(&s, 1e-6);
    print_message("%s\n", s.ctx.error.message);
    expect_place(&s, middle, 0.1 * extent);
    assert_non_null(strstr(s.ctx.error.message, "too many tets"));
    drop_sanitized(&s);
}

/* ---- what may not move ---- */

static void a_singular_edge_folded_between_held_vertices_is_refused(void **state) {
    bw_model_options o = model_options(2, 0.3, 0, BW_SCRAMBLE_NONE, kit_seed());
    kit_random random = kit_random_start(4);
    folder f;
    (void)state;
    fold_start(&f, make_model("ball", &o), 1e-9);
    for (int i = 0; i < 2; i++) {
        sanitized s;
        bw_vertex v;
        fold_star star;
        fold_copy(&f, &s);
        do assert_true(fold_pick(&f, &random, FOLD_SINGULAR, FOLD_BOUNDARY, &v, &star));
        while (star.free & (star.free - 1));
        fold_past(&f, &random, &star, 4, &s); /* past its neighbours on the singular edge */
        bw_free(&s.ctx, s.mesh.feature_vertex);
        s.mesh.feature_vertex = bw_alloc(&s.ctx, s.mesh.vertex_count, sizeof *s.mesh.feature_vertex);
        s.mesh.feature_vertex_count = 0;
        for (size_t k = 0; k < s.mesh.vertex_count; k++)
            if (f.kind[k] & FOLD_SINGULAR)
                s.mesh.feature_vertex[s.mesh.feature_vertex_count++] = (bw_vertex)k;
        repair_mesh(&s, 1e-6);
        print_message("%s\n", s.ctx.error.message);
        expect_refused(&s);
        drop_sanitized(&s);
    }
    fold_end(&f);
}

static void a_tet_whose_chart_fits_no_neighbour_is_refused_by_place(void **state) {
    bw_model_options o = model_options(2, 0.6, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("ball", &o);
    sanitized s = {0};
    (void)state;
    bw_context_init(&s.ctx);
    kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
    for (int k = 0; k < 3; k++) {
        double p = s.mesh.parameter[137][0][k];
        s.mesh.parameter[137][0][k] = s.mesh.parameter[137][1][k];
        s.mesh.parameter[137][1][k] = p;
    }
    repair_mesh(&s, 1e-4);
    expect_refused(&s);
    assert_int_equal(s.ctx.error.region_count, 1);
    assert_int_equal(s.ctx.error.regions[0].tets[0], 137);
    assert_non_null(strstr(s.ctx.error.message, "which transitions"));
    drop_sanitized(&s);
    drop_model(&model);
}

static void a_tet_listed_the_other_way_round_is_refused_by_place(void **state) {
    bw_model_options o = model_options(2, 0.6, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("ball", &o);
    bw_context ctx;
    sanitized s = {0};
    (void)state;
    bw_context_init(&ctx);
    bw_context_init(&s.ctx);
    kit_expect_ok(&ctx, bw_model_damage(&ctx, &model, BW_DAMAGE_INVERT, 7));
    kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
    repair_mesh(&s, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_INVERTED);
    assert_int_equal(s.ctx.error.region_count, 1);
    assert_int_equal(s.ctx.error.regions[0].tet_count, 1);
    drop_sanitized(&s);
    drop_model(&model);
}

/* A defect of another kind, away from the fold, is what it was without the fold. */
static void repair_is_for_volumes_only(void **state) {
    static const struct {
        bw_model_damage_kind kind;
        bw_status status;
    } cases[] = {{BW_DAMAGE_DUPLICATE, BW_E_DUPLICATE},
                 {BW_DAMAGE_NONMANIFOLD, BW_E_NONMANIFOLD},
                 {BW_DAMAGE_SEAM, BW_E_NOT_SEAMLESS},
                 {BW_DAMAGE_TILT, BW_E_NOT_ALIGNED}};
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bw_model_options o = model_options(3, 0.5, 0, BW_SCRAMBLE_NONE, 5);
        o.folds = 1;
        bw_model model = make_model("l-shape", &o);
        sanitized s = {0};
        bw_context ctx;
        bw_context_init(&ctx);
        bw_context_init(&s.ctx);
        kit_expect_ok(&ctx, bw_model_damage(&ctx, &model, cases[i].kind, 9));
        kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
        repair_mesh(&s, 1e-4);
        kit_expect_status(&s.ctx, s.status, cases[i].status);
        drop_sanitized(&s);
        drop_model(&model);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_collapsed_corner_of_the_model_is_refused_by_place),
        cmocka_unit_test(a_collapsed_region_that_is_too_large_is_refused),
        cmocka_unit_test(a_singular_edge_folded_between_held_vertices_is_refused),
        cmocka_unit_test(a_tet_whose_chart_fits_no_neighbour_is_refused_by_place),
        cmocka_unit_test(a_tet_listed_the_other_way_round_is_refused_by_place),
        cmocka_unit_test(repair_is_for_volumes_only),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
