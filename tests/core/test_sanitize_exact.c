/* What is exact already stays what it is, bit for bit; odd meshes come through. */
#include "sanitize_kit.h"

/* The unit cube in six tets around the diagonal 0-7; corner i of the cube is (i & 1, i >> 1 & 1, i >> 2). */
static const int cube_tets[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                    {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};

/* Cubes of side `side` with their low corners at `at`; corners at one place are one vertex. */
static void cubes(sanitized *s, size_t count, const int (*at)[3], double side) {
    double position[64][3];
    int tet[48][4];
    size_t vertices = 0;
    for (size_t c = 0; c < count; c++) {
        int number[8];
        for (int i = 0; i < 8; i++) {
            double p[3] = {side * (at[c][0] + (i & 1)), side * (at[c][1] + (i >> 1 & 1)),
                           side * (at[c][2] + (i >> 2))};
            size_t v = 0;
            while (v < vertices && memcmp(position[v], p, sizeof p)) v++;
            if (v == vertices) memcpy(position[vertices++], p, sizeof p);
            number[i] = (int)v;
        }
        for (int t = 0; t < 6; t++)
            for (int i = 0; i < 4; i++) tet[6 * c + (size_t)t][i] = number[cube_tets[t][i]];
    }
    start_by_hand(s, vertices, (const double(*)[3])position, 6 * count, (const int(*)[4])tet);
}

static void an_integer_grid_map_stays_unchanged(void **state) {
    static const int at[3][3] = {{-2, 5, 0}, {-1, 5, 0}, {-1, 6, 0}};
    sanitized s, before;
    (void)state;
    cubes(&before, 3, at, 1);
    cubes(&s, 3, at, 1);
    sanitize_mesh(&s, 1e-4);
    kit_expect_ok(&s.ctx, s.status);
    assert_true(s.report.already_exact);
    assert_true(s.report.displacement_max == 0);
    assert_int_equal(s.report.system_rows, 0);
    for (size_t i = 0; i < 12 * s.mesh.tet_count; i++)
        assert_true(ldexp((double)s.map.value[i / 12][i % 12 / 3][i % 3], -s.map.exponent) ==
                    before.mesh.parameter[s.mesh.tet_id[i / 12]][i % 12 / 3][i % 3]);
    check_exact(&s);
    drop_sanitized(&before);
    drop_sanitized(&s);
}

static void a_map_on_a_finer_grid_than_usual_stays_unchanged(void **state) {
    static const int at[1][3] = {{0, 0, 0}};
    sanitized s;
    (void)state;
    cubes(&s, 1, at, 1 + ldexp(1, -45)); /* 46 bits */
    sanitize_mesh(&s, 1e-4);
    kit_expect_ok(&s.ctx, s.status);
    assert_true(s.report.already_exact && s.report.displacement_max == 0);
    assert_int_equal(s.report.grid_exponent, 45);
    drop_sanitized(&s);
}

/* The values just found, as the doubles they are. */
static void read_back(const sanitized *from, const bw_model *model, sanitized *to) {
    *to = (sanitized){0};
    bw_context_init(&to->ctx);
    kit_expect_ok(&to->ctx, mesh_from_model(&to->ctx, model, &to->mesh));
    for (size_t i = 0; i < 12 * model->tet_count; i++)
        to->mesh.parameter[from->mesh.tet_id[i / 12]][i % 12 / 3][i % 3] =
            ldexp((double)from->map.value[i / 12][i % 12 / 3][i % 3], -from->map.exponent);
}

static void sanitizing_twice_changes_nothing(void **state) {
    kit_random random = kit_random_start(1);
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++) {
        bw_model_options o = model_options(1, 0.8, 1e-4, (int)(i % 4), kit_random_next(&random));
        bw_model model = make_model(list[i].name, &o);
        sanitized once, twice;
        sanitize_model(&once, &model, 1e-2);
        kit_expect_ok(&once.ctx, once.status);
        assert_false(once.report.already_exact);
        read_back(&once, &model, &twice);
        sanitize_mesh(&twice, 0);
        kit_expect_ok(&twice.ctx, twice.status);
        assert_true(twice.report.already_exact && twice.report.displacement_max == 0);
        int shift = once.map.exponent - twice.map.exponent;
        for (size_t k = 0; k < 12 * model.tet_count; k++)
            assert_true(ldexp((double)twice.map.value[k / 12][k % 12 / 3][k % 3], shift) ==
                        (double)once.map.value[k / 12][k % 12 / 3][k % 3]);
        drop_sanitized(&once);
        drop_sanitized(&twice);
        drop_model(&model);
    }
}

static void mirrored_tets_are_turned_as_a_whole(void **state) {
    bw_model_options o = model_options(1, 0.5, 1e-5, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("ball", &o), mirror = make_model("ball", &o);
    sanitized a, b;
    (void)state;
    for (size_t t = 0; t < mirror.tet_count; t++) {
        int32_t v = mirror.tet[t][2];
        double p[3];
        mirror.tet[t][2] = mirror.tet[t][3], mirror.tet[t][3] = v;
        memcpy(p, mirror.parameter[t][2], sizeof p);
        memcpy(mirror.parameter[t][2], mirror.parameter[t][3], sizeof p);
        memcpy(mirror.parameter[t][3], p, sizeof p);
    }
    sanitize_model(&a, &model, 1e-2);
    sanitize_model(&b, &mirror, 1e-2);
    kit_expect_ok(&a.ctx, a.status);
    kit_expect_ok(&b.ctx, b.status);
    assert_int_equal(a.mesh.mirrored, 0);
    assert_int_equal(b.mesh.mirrored, 1);
    assert_memory_equal(a.mesh.tet, b.mesh.tet, a.mesh.tet_count * sizeof *a.mesh.tet);
    assert_memory_equal(a.map.value, b.map.value, a.mesh.tet_count * sizeof *a.map.value);
    drop_sanitized(&a);
    drop_sanitized(&b);
    drop_model(&model);
    drop_model(&mirror);
}

/* Noise of the size of rounding errors, different in every tet. */
static void shake(sanitized *s, double amount, uint64_t stream) {
    kit_random random = kit_random_start(stream);
    for (size_t i = 0; i < 12 * s->mesh.tet_count; i++)
        s->mesh.parameter[i / 12][i % 12 / 3][i % 3] += kit_random_range(&random, -amount, amount);
}

static void check_touching(const int (*at)[3], size_t count, size_t vertices) {
    for (uint64_t seed = 0; seed < 10; seed++) {
        sanitized s;
        cubes(&s, count, at, 1.1);
        assert_int_equal(s.mesh.vertex_count, vertices);
        shake(&s, 1e-6, seed);
        sanitize_mesh(&s, 1e-4);
        kit_expect_ok(&s.ctx, s.status);
        check_exact(&s);
        assert_true(s.report.displacement_max < 1e-5);
        drop_sanitized(&s);
    }
}

static void parts_that_share_nothing_a_vertex_or_an_edge_are_repaired(void **state) {
    static const int apart[2][3] = {{0, 0, 0}, {3, 0, 0}}, corner[2][3] = {{0, 0, 0}, {1, 1, 1}},
                     edge[2][3] = {{0, 0, 0}, {1, 1, 0}};
    static const int ring[4][3] = {{0, 0, 0}, {1, 1, 0}, {2, 0, 0}, {1, -1, 0}}; /* touching in four edges */
    (void)state;
    check_touching(apart, 2, 16);
    check_touching(corner, 2, 15);
    check_touching(edge, 2, 14);
    check_touching(ring, 4, 24);
}

static void vertices_without_tets_are_left_alone(void **state) {
    static const int at[1][3] = {{0, 0, 0}};
    sanitized s;
    (void)state;
    cubes(&s, 1, at, 1.1);
    s.mesh.position = bw_resize(&s.ctx, s.mesh.position, s.mesh.vertex_count += 5, sizeof *s.mesh.position);
    shake(&s, 1e-6, 1);
    sanitize_mesh(&s, 1e-4);
    kit_expect_ok(&s.ctx, s.status);
    check_exact(&s);
    assert_int_equal(s.mesh.vertex_count, 13);
    drop_sanitized(&s);
}

/* Two cubes in a row: what was a free facet and free edges between them becomes one coordinate plane. */
static void feature_facets_and_edges_become_exactly_aligned(void **state) {
    static const int at[2][3] = {{0, 0, 0}, {1, 0, 0}};
    sanitized s;
    bw_vertex middle[3], n = 0;
    (void)state;
    cubes(&s, 2, at, 1.1);
    for (bw_vertex v = 0; v < (bw_vertex)s.mesh.vertex_count && n < 3; v++)
        if (s.mesh.position[v][0] == 1.1 && !(s.mesh.position[v][1] == 0 && s.mesh.position[v][2] > 0))
            middle[n++] = v;
    s.mesh.feature_facet_count = 1;
    s.mesh.feature_facet = copy_of(&s.ctx, middle, 1, sizeof middle);
    s.mesh.feature_edge_count = 1;
    s.mesh.feature_edge = copy_of(&s.ctx, middle, 1, 2 * sizeof *middle);
    shake(&s, 1e-5, 1);
    sanitize_mesh(&s, 1e-3);
    kit_expect_ok(&s.ctx, s.status);
    for (size_t t = 0; t < s.mesh.tet_count; t++) {
        const int64_t *p[3] = {NULL, NULL, NULL};
        for (int i = 0; i < 3; i++) {
            int c = bw_tet_corner(&s.mesh, (bw_tet)t, middle[i]);
            if (c >= 0) p[i] = s.map.value[t][c];
        }
        if (p[0] && p[1]) assert_true(p[0][0] == p[1][0] && (p[0][1] == p[1][1] || p[0][2] == p[1][2]));
        if (p[0] && p[2]) assert_true(p[0][0] == p[2][0]);
    }
    drop_sanitized(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_integer_grid_map_stays_unchanged),
        cmocka_unit_test(a_map_on_a_finer_grid_than_usual_stays_unchanged),
        cmocka_unit_test(sanitizing_twice_changes_nothing),
        cmocka_unit_test(mirrored_tets_are_turned_as_a_whole),
        cmocka_unit_test(parts_that_share_nothing_a_vertex_or_an_edge_are_repaired),
        cmocka_unit_test(vertices_without_tets_are_left_alone),
        cmocka_unit_test(feature_facets_and_edges_become_exactly_aligned),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
