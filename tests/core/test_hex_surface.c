/* Surfaces and curves of a tet mesh, and closest points on them (hex/surface.h, hex/bvh.h). */
#include "core/hex_tets_kit.h"

static void closest_points_are_those_of_a_search_through_all(void **state) {
    (void)state;
    enum { POINTS = 300, ITEMS = 400, GROUPS = 7, QUERIES = 300 };
    static double point[POINTS][3];
    static int32_t item[ITEMS][3], group[ITEMS];
    bw_context ctx;
    bw_bvh tree;
    kit_random random = kit_random_start(11);
    bw_context_init(&ctx);
    for (int i = 0; i < POINTS * 3; i++) point[i / 3][i % 3] = kit_random_range(&random, -1, 1);
    for (int i = 0; i < ITEMS; i++) {
        for (int k = 0; k < 3; k++) item[i][k] = (int32_t)kit_random_below(&random, POINTS);
        if (i % 3 == 0) item[i][2] = item[i][1]; /* a segment */
        group[i] = (int32_t)kit_random_below(&random, GROUPS);
    }
    kit_expect_ok(&ctx, bw_bvh_build(&ctx, (const double(*)[3])point, (const int32_t(*)[3])item, ITEMS, group, GROUPS, &tree));
    for (int i = 0; i < QUERIES; i++) {
        double p[3], best = INFINITY, q[3];
        int32_t which = (int32_t)kit_random_below(&random, GROUPS + 1) - 1;
        for (int k = 0; k < 3; k++) p[k] = kit_random_range(&random, -2, 2);
        for (int t = 0; t < ITEMS; t++)
            if (which == BW_NONE || group[t] == which)
                best = fmin(best, bw_closest_on_triangle(point[item[t][0]], point[item[t][1]], point[item[t][2]], p, q));
        bw_bvh_hit hit;
        bw_bvh_closest(&tree, which, p, INFINITY, &hit);
        assert_true(hit.squared == best);
        bw_bvh_closest(&tree, which, p, 0.5 * best, &hit);
        assert_int_equal(hit.item, BW_NONE);
    }
    bw_bvh_clear(&ctx, &tree);
    assert_int_equal(ctx.memory.used, 0);
}

static void closest_point_on_a_triangle_is_no_farther_than_any_other_of_it(void **state) {
    (void)state;
    kit_random random = kit_random_start(12);
    for (int i = 0; i < 2000; i++) {
        double c[3][3], p[3], q[3], thin = i % 4 ? 1 : 1e-9; /* some are slivers */
        for (int k = 0; k < 9; k++) c[k / 3][k % 3] = kit_random_range(&random, -1, 1) * (k % 3 == 2 ? thin : 1);
        for (int k = 0; k < 3; k++) p[k] = kit_random_range(&random, -2, 2);
        if (i % 8 == 0)
            for (int k = 0; k < 3; k++) c[2][k] = 0.5 * (c[0][k] + c[1][k]); /* some have no area */
        double best = bw_closest_on_triangle(c[0], c[1], c[2], p, q);
        for (int a = 0; a <= 10; a++)
            for (int b = 0; b <= 10 - a; b++) {
                double d = 0;
                for (int k = 0; k < 3; k++) {
                    double x = (c[0][k] * (10 - a - b) + c[1][k] * a + c[2][k] * b) / 10 - p[k];
                    d += x * x;
                }
                assert_true(best <= d + 1e-12);
            }
    }
}

static void a_box_has_six_faces_and_twelve_edges(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    size_t points = 0;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
    hex_tets_make(&ctx, &mesh, &tets);
    const bw_hex_surface *s = &tets.surface;
    for (size_t v = 0; v < tets.mesh.vertex_count; v++) points += s->point[v];
    assert_int_equal(s->region_count, 6);
    assert_int_equal(s->curve_count, 12);
    assert_int_equal(points, 8);
    assert_int_equal(s->flat_curves, 0);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        bw_hex_surface_hold hold = bw_hex_surface_holds(s, mesh.held[v], mesh.carrier[v], mesh.position[v]);
        double p[3], direction[3][3];
        memcpy(p, mesh.position[v], sizeof p);
        assert_int_equal(hold.held, mesh.held[v]);
        assert_int_equal(bw_hex_surface_project(s, hold, p, direction), mesh.held[v]);
        for (int k = 0; k < 3; k++) assert_float_equal(p[k], mesh.position[v][k], 1e-14);
    }
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

/* Maps the cube -1..1 to a ball; its edges are singular, but nothing is sharp there. */
static void round_off(bw_hex_mesh *mesh, int n) {
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        double *p = mesh->position[v], most = 0, length = 0;
        for (int k = 0; k < 3; k++) {
            p[k] = 2 * (double)(v / (k == 0 ? 1 : k == 1 ? (size_t)n + 1 : ((size_t)n + 1) * ((size_t)n + 1)) % ((size_t)n + 1)) / n - 1;
            most = fmax(most, fabs(p[k])), length += p[k] * p[k];
        }
        for (int k = 0; k < 3 && length > 0; k++) p[k] *= most / sqrt(length);
    }
}

static void singular_edges_of_a_ball_hold_nothing(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, 6, &mesh);
    round_off(&mesh, 6);
    hex_kit_hold(&ctx, &mesh);
    hex_tets_make(&ctx, &mesh, &tets);
    assert_int_equal(tets.surface.flat_curves, 12);
    assert_int_equal(tets.surface.curve_count, 0);
    assert_int_equal(tets.surface.region_count, 1);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        bw_hex_surface_hold hold = bw_hex_surface_holds(&tets.surface, mesh.held[v], mesh.carrier[v], mesh.position[v]);
        assert_int_equal(hold.held, mesh.held[v] == BW_HELD_NOT ? BW_HELD_NOT : BW_HELD_SURFACE);
    }
    bw_hex_surface marked; /* unless the user says that they are features */
    for (size_t e = 0; e < tets.mesh.edge_count; e++)
        if (tets.edge_flags[e]) tets.edge_flags[e] |= BW_EDGE_FEATURE;
    kit_expect_ok(&ctx, bw_hex_surface_build(&ctx, &tets.mesh, tets.edge_flags, &marked));
    assert_int_equal(marked.curve_count, 12);
    assert_int_equal(marked.region_count, 6);
    bw_hex_surface_clear(&ctx, &marked);
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static void a_rim_that_meets_no_other_is_one_closed_curve(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_RING, &mesh); /* a square swept around: four rims */
    hex_tets_make(&ctx, &mesh, &tets);
    assert_int_equal(tets.surface.curve_count, 4);
    assert_int_equal(tets.surface.region_count, 4);
    assert_int_equal(tets.surface.segment_count, 4 * 16);
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static bw_status build_surface(bw_context *ctx, void *user) {
    const hex_tets *tets = user;
    bw_hex_surface s;
    bw_status status = bw_hex_surface_build(ctx, &tets->mesh, tets->edge_flags, &s);
    if (status == BW_OK) bw_hex_surface_clear(ctx, &s);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    hex_tets_make(&ctx, &mesh, &tets);
    assert_true(kit_fail_each_allocation(build_surface, &tets) > 25);
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(closest_points_are_those_of_a_search_through_all),
    cmocka_unit_test(closest_point_on_a_triangle_is_no_farther_than_any_other_of_it),
    cmocka_unit_test(a_box_has_six_faces_and_twelve_edges),
    cmocka_unit_test(singular_edges_of_a_ball_hold_nothing),
    cmocka_unit_test(a_rim_that_meets_no_other_is_one_closed_curve),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
