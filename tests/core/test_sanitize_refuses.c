/* What sanitization refuses, with the status and the elements at fault. */
#include "sanitize_kit.h"

static bw_model damaged(const char *name, bw_model_damage_kind kind, uint64_t seed) {
    bw_model_options o = model_options(1, 0.6, 0, BW_SCRAMBLE_NONE, seed);
    bw_model model = make_model(name, &o);
    bw_context ctx;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_model_damage(&ctx, &model, kind, seed));
    return model;
}

static void every_damage_is_refused_for_what_it_is(void **state) {
    static const struct {
        bw_model_damage_kind kind;
        bw_status status;
        const char *element;
    } cases[] = {{BW_DAMAGE_INVERT, BW_E_INVERTED, "tet"},
                 {BW_DAMAGE_DUPLICATE, BW_E_DUPLICATE, "tet"},
                 {BW_DAMAGE_NONMANIFOLD, BW_E_NONMANIFOLD, "facet"},
                 {BW_DAMAGE_SEAM, BW_E_NOT_SEAMLESS, "facet"},
                 {BW_DAMAGE_TILT, BW_E_NOT_ALIGNED, "facet"}};
    static const char *const names[] = {"l-shape", "cylinder", "ball", "torus-half"};
    kit_random random = kit_random_start(1);
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        for (int k = 0; k < 8; k++) {
            bw_model model = damaged(names[k % 4], cases[i].kind, kit_random_next(&random));
            sanitized s;
            sanitize_model(&s, &model, 1e-4);
            kit_expect_status(&s.ctx, s.status, cases[i].status);
            assert_true(s.ctx.error.element_count >= 1);
            if (cases[i].kind != BW_DAMAGE_NONMANIFOLD)
                assert_string_equal(s.ctx.error.elements[0].kind, cases[i].element);
            drop_sanitized(&s);
            drop_model(&model);
        }
}

static void an_inverted_tet_is_named_and_no_other(void **state) {
    bw_model_options o = model_options(1, 0.6, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("ball", &o);
    sanitized s;
    (void)state;
    for (int k = 0; k < 3; k++) { /* reflected at one facet's plane is enough: swap two corners' parameters */
        double p = model.parameter[137][0][k];
        model.parameter[137][0][k] = model.parameter[137][1][k];
        model.parameter[137][1][k] = p;
    }
    sanitize_model(&s, &model, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_INVERTED);
    assert_int_equal(s.ctx.error.element_count, 1);
    assert_int_equal(s.ctx.error.elements[0].id, 137);
    assert_true(s.ctx.error.elements[0].has_position);
    drop_sanitized(&s);
    drop_model(&model);
}

static void a_degenerate_tet_is_refused(void **state) {
    bw_model_options o = model_options(1, 0, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("cuboid", &o);
    sanitized s;
    (void)state;
    memcpy(model.parameter[3][2], model.parameter[3][1], sizeof model.parameter[3][1]);
    sanitize_model(&s, &model, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_INVERTED);
    assert_int_equal(s.ctx.error.elements[0].id, 3);
    drop_sanitized(&s);
    drop_model(&model);
}

static void tolerance_decides_and_all_facets_at_fault_are_counted(void **state) {
    bw_model_options o = model_options(1, 0.5, 1e-3, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("ball", &o);
    sanitized s;
    (void)state;
    sanitize_model(&s, &model, 1e-5);
    kit_expect_status(&s.ctx, s.status, BW_E_NOT_SEAMLESS);
    assert_true(s.ctx.error.element_count > BW_ELEMENTS_KEPT);
    assert_true(s.report.residual_seamless_max > 1e-5);
    double residual = fmax(s.report.residual_seamless_max, 0);
    drop_sanitized(&s);
    sanitize_model(&s, &model, 10 * residual);
    kit_expect_ok(&s.ctx, s.status);
    drop_sanitized(&s);
    drop_model(&model);
}

/* Tets around the diagonal of parameter space whose charts close after a third of a turn: no map may have
 * that inside. */
static void a_singular_edge_along_a_diagonal_is_refused(void **state) {
    const double wedge = M_PI / 9;
    double position[8][3];
    int tet[9][4];
    sanitized s;
    (void)state;
    for (int i = 0; i < 8; i++) { /* 0, 1: the edge; 2..7: a ring of six in space */
        double a = i * M_PI / 3;
        double p[3] = {i < 2 ? 0 : cos(a), i < 2 ? 0 : sin(a), i == 1};
        memcpy(position[i], p, sizeof p);
    }
    for (int t = 0; t < 6; t++) {
        int corners[4] = {0, 1, 2 + t, 2 + (t + 1) % 6};
        memcpy(tet[t], corners, sizeof corners);
    }
    start_by_hand(&s, 8, (const double(*)[3])position, 6, (const int(*)[4])tet);
    const double u[3] = {sqrt(0.5), -sqrt(0.5), 0}, v[3] = {sqrt(1 / 6.), sqrt(1 / 6.), -2 * sqrt(1 / 6.)};
    for (int t = 0; t < 6; t++) /* six wedges of 20 degrees: 120 in all */
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++) {
                double a = wedge * (t + (i == 3));
                s.mesh.parameter[t][i][k] = i == 0 ? 0 : i == 1 ? 1 : cos(a) * u[k] + sin(a) * v[k];
            }
    sanitize_mesh(&s, 1e9); /* the boundary is nowhere aligned; let that pass */
    kit_expect_status(&s.ctx, s.status, BW_E_SINGULAR);
    bool found = false;
    for (size_t i = 0; i < s.ctx.error.element_count && i < BW_ELEMENTS_KEPT; i++) {
        const bw_vertex *e = s.mesh.edge[s.ctx.error.elements[i].id];
        assert_string_equal(s.ctx.error.elements[i].kind, "edge");
        found = found || (e[0] == 0 && e[1] == 1);
    }
    assert_true(found);
    drop_sanitized(&s);
}

static void tets_on_one_side_of_their_facet_are_refused(void **state) {
    static const double position[5][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.2, 0.3, 1.5}};
    static const int tet[2][4] = {{0, 1, 2, 3}, {0, 1, 2, 4}};
    sanitized s;
    (void)state;
    start_by_hand(&s, 5, position, 2, tet);
    sanitize_mesh(&s, 1e9);
    kit_expect_status(&s.ctx, s.status, BW_E_INVERTED);
    assert_string_equal(s.ctx.error.elements[0].kind, "facet");
    drop_sanitized(&s);
}

static void parameters_that_the_grid_cannot_hold_are_refused(void **state) {
    bw_model_options o = model_options(1, 0, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("cuboid", &o);
    sanitized s;
    (void)state;
    for (int i = 0; i < 4; i++)
        model.parameter[5][i][0] += ldexp(1, 46); /* its chart is far away from all others */
    sanitize_model(&s, &model, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_RANGE);
    assert_string_equal(s.ctx.error.elements[0].kind, "tet");
    drop_sanitized(&s);
    for (size_t i = 0; i < 12 * model.tet_count; i++) model.parameter[i / 12][i % 12 / 3][i % 3] *= 1e290;
    sanitize_model(&s, &model, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_RANGE);
    drop_sanitized(&s);
    drop_model(&model);
}

static void a_mesh_without_tets_is_refused(void **state) {
    sanitized s = {0};
    (void)state;
    bw_context_init(&s.ctx);
    sanitize_mesh(&s, 1e-4);
    kit_expect_status(&s.ctx, s.status, BW_E_EMPTY);
    drop_sanitized(&s);
}

static bw_status with_feature_edge(bw_vertex a, bw_vertex b, sanitized *s) {
    bw_model_options o = model_options(1, 0, 0, BW_SCRAMBLE_NONE, 1);
    bw_model model = make_model("cuboid", &o);
    *s = (sanitized){0};
    bw_context_init(&s->ctx);
    kit_expect_ok(&s->ctx, mesh_from_model(&s->ctx, &model, &s->mesh));
    bw_free(&s->ctx, s->mesh.feature_edge);
    s->mesh.feature_edge = bw_alloc(&s->ctx, 1, sizeof *s->mesh.feature_edge);
    s->mesh.feature_edge_count = 1;
    s->mesh.feature_edge[0][0] = a, s->mesh.feature_edge[0][1] = b;
    drop_model(&model);
    sanitize_mesh(s, 1e-4);
    return s->status;
}

/* Of the pairs of vertices of a cuboid some are aligned edges, some diagonal edges, some no edges. */
static void features_must_be_aligned_edges_of_the_mesh(void **state) {
    sanitized s;
    int seen[3] = {0, 0, 0};
    (void)state;
    for (bw_vertex a = 0; a < 8; a++)
        for (bw_vertex b = 0; b < a; b++) {
            bw_status status = with_feature_edge(a, b, &s);
            bool edge = false;
            int differ = 0;
            for (size_t e = 0; e < s.mesh.edge_count; e++)
                edge = edge || (s.mesh.edge[e][0] == b && s.mesh.edge[e][1] == a);
            for (int k = 0; k < 3; k++) differ += fabs(s.mesh.position[a][k] - s.mesh.position[b][k]) > 1e-9;
            bw_status expected = !edge ? BW_E_INDEX : differ > 1 ? BW_E_NOT_ALIGNED : BW_OK;
            seen[!edge ? 0 : differ > 1 ? 1 : 2]++;
            kit_expect_status(&s.ctx, status, expected);
            drop_sanitized(&s);
        }
    assert_true(seen[0] && seen[1] && seen[2]);
}

static void a_job_that_is_cancelled_stops(void **state) {
    static const volatile sig_atomic_t yes = 1;
    bw_model_options o = model_options(1, 0, 1e-4, BW_SCRAMBLE_NONE, 1);
    bw_model model = make_model("ball", &o);
    sanitized s = {0};
    (void)state;
    bw_context_init(&s.ctx);
    kit_expect_ok(&s.ctx, mesh_from_model(&s.ctx, &model, &s.mesh));
    s.ctx.cancel = &yes;
    sanitize_mesh(&s, 1e-2);
    kit_expect_status(&s.ctx, s.status, BW_E_CANCELLED);
    drop_sanitized(&s);
    drop_model(&model);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_damage_is_refused_for_what_it_is),
        cmocka_unit_test(an_inverted_tet_is_named_and_no_other),
        cmocka_unit_test(a_degenerate_tet_is_refused),
        cmocka_unit_test(tolerance_decides_and_all_facets_at_fault_are_counted),
        cmocka_unit_test(a_singular_edge_along_a_diagonal_is_refused),
        cmocka_unit_test(tets_on_one_side_of_their_facet_are_refused),
        cmocka_unit_test(parameters_that_the_grid_cannot_hold_are_refused),
        cmocka_unit_test(a_mesh_without_tets_is_refused),
        cmocka_unit_test(features_must_be_aligned_edges_of_the_mesh),
        cmocka_unit_test(a_job_that_is_cancelled_stops),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
