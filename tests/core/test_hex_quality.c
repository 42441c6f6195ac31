/* Quality of hex meshes whose figures are known (hex/quality.h). */
#include "core/hex_tets_kit.h"

#include "hex/quality.h"

static const double near_zero = 1e-12;

/* The unit cube with corner 7 elsewhere. */
static void cube_with(double x, double y, double z, double corner[8][3]) {
    for (int c = 0; c < 8; c++)
        for (int k = 0; k < 3; k++) corner[c][k] = c >> k & 1;
    corner[7][0] = x, corner[7][1] = y, corner[7][2] = z;
}

static void scaled_jacobian_of_known_shapes(void **state) {
    (void)state;
    double p[8][3];
    cube_with(1, 1, 1, p);
    assert_float_equal(bw_hex_scaled_jacobian((const double(*)[3])p), 1, near_zero);
    for (int c = 0; c < 8; c++) p[c][0] *= 1e-5, p[c][2] *= 3; /* a box is as good as a cube */
    assert_float_equal(bw_hex_scaled_jacobian((const double(*)[3])p), 1, near_zero);
    cube_with(1, 1, 1, p);
    for (int c = 0; c < 8; c++) p[c][0] += p[c][1]; /* sheared by 45 degrees */
    assert_float_equal(bw_hex_scaled_jacobian((const double(*)[3])p), sqrt(0.5), near_zero);
    for (int c = 0; c < 8; c++) p[c][2] = -p[c][2]; /* mirrored */
    assert_float_equal(bw_hex_scaled_jacobian((const double(*)[3])p), -sqrt(0.5), near_zero);
    cube_with(1, 1, 0, p); /* corner 7 down on corner 3: an edge without length */
    assert_float_equal(bw_hex_scaled_jacobian((const double(*)[3])p), 0, 0);
    cube_with(.7, .7, .7, p); /* corner 7 is on its side of the plane x + y + z = 2 of its neighbours */
    for (int c = 0; c < 8; c++) {
        double d = bw_hex_corner_jacobian((const double(*)[3])p, c);
        assert_true(c == 7 ? d > 0 && d < 0.3 : c == 3 || c == 5 || c == 6 ? d > 0.3 && d < 0.99 : d > 0.99);
    }
    cube_with(.6, .6, .6, p); /* it has passed the plane, and is the only inverted one */
    for (int c = 0; c < 8; c++) assert_true((bw_hex_corner_jacobian((const double(*)[3])p, c) <= 0) == (c == 7));
}

static void make_one(bw_context *ctx, double corner[8][3], bw_hex_mesh *mesh) {
    hex_kit_cube(ctx, 1, mesh);
    for (int c = 0; c < 8; c++) memcpy(mesh->position[mesh->hex[0][c]], corner[c], sizeof corner[c]);
}

static void volume_is_that_of_the_trilinear_map(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_quality q;
    double p[8][3];
    bw_context_init(&ctx);
    cube_with(1.6, 1, 1, p); /* x = u + 0.6 u v w: the integral of 1 + 0.6 v w */
    make_one(&ctx, p, &mesh);
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &mesh, &q));
    assert_float_equal(q.volume, 1.15, near_zero);
    assert_float_equal(q.edge_length.max, 1.6, near_zero);
    assert_int_equal(q.boundary[1], 12);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static void valences_and_bins_count_every_edge_and_hex(void **state) {
    (void)state;
    static const uint64_t irregular_inside[HEX_KIT_COUNT] = {0, 16, 3, 48, 0, 0};
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        bw_hex_quality q;
        bw_hex_skin skin;
        uint64_t edges = 0, hexes = 0, irregular = 0;
        hex_kit_sample(&ctx, i, &mesh);
        kit_expect_ok(&ctx, bw_hex_measure(&ctx, &mesh, &q));
        kit_expect_ok(&ctx, bw_hex_skin_init_all(&ctx, &mesh, &skin));
        for (int n = 0; n < BW_HEX_VALENCES; n++) edges += q.inner[n] + q.boundary[n], irregular += n == 4 ? 0 : q.inner[n];
        for (int n = 0; n < BW_HEX_BINS; n++) hexes += q.histogram[n];
        assert_int_equal(edges, skin.edge_count);
        assert_int_equal(hexes, mesh.hex_count);
        assert_int_equal(irregular, irregular_inside[i]);
        assert_true(q.nonpositive == 0 && q.scaled_jacobian.min > 0 && q.scaled_jacobian.min <= q.scaled_jacobian.mean);
        assert_float_equal(q.worst[0].scaled_jacobian, q.scaled_jacobian.min, 0);
        bw_hex_skin_clear(&ctx, &skin);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
    assert_int_equal(ctx.memory.used, 0);
}

static void the_worst_hex_is_named_with_its_place(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_quality before, after;
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, 5, &mesh);
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &mesh, &before));
    bw_hvertex corner = mesh.hex[124][7]; /* a corner of the cube: of one hex only */
    for (int k = 0; k < 3; k++) mesh.position[corner][k] -= 0.4;
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &mesh, &after));
    assert_int_equal(before.nonpositive, 0);
    assert_int_equal(after.nonpositive, 1);
    assert_int_equal(after.worst[0].hex, 124);
    assert_true(after.worst[0].scaled_jacobian < 0 && after.worst[1].scaled_jacobian > 0);
    for (int k = 0; k < 3; k++) assert_true(after.worst[0].centre[k] > 0.7 && after.worst[0].centre[k] < 1);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static void a_position_that_is_no_number_is_counted_as_not_positive(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_quality q;
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, 2, &mesh);
    mesh.position[mesh.hex[7][7]][0] = NAN; /* a corner of the cube: of one hex only */
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &mesh, &q));
    assert_int_equal(q.histogram[BW_HEX_BINS - 1], 7);
    assert_int_equal(q.nonpositive + q.histogram[BW_HEX_BINS - 1], 8);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static void measuring_can_be_cancelled(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_quality q;
    volatile sig_atomic_t cancel = 1;
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, 2, &mesh);
    ctx.cancel = &cancel;
    assert_int_equal(bw_hex_measure(&ctx, &mesh, &q), BW_E_CANCELLED);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static void distance_to_itself_is_zero_and_a_moved_vertex_is_seen(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    bw_hex_distance d;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_O_GRID, &mesh);
    hex_tets_make(&ctx, &mesh, &tets);
    kit_expect_ok(&ctx, bw_hex_measure_distance(&ctx, &mesh, &tets.surface, &d));
    assert_true(d.to_input < 1e-14 && d.from_input < 1e-14 && d.curves < 1e-14);
    assert_float_equal(d.diagonal, 3, 0.01); /* a box of 2 x 2 x 1 */
    assert_float_equal(d.input_volume, 4, 0.01);
    for (size_t v = 0; v < mesh.vertex_count; v++) /* the corner (1, 1, 1) moves out by (1, 1, 1) / 2 */
        if (fmin(mesh.position[v][0], fmin(mesh.position[v][1], mesh.position[v][2])) > 0.9)
            for (int k = 0; k < 3; k++) mesh.position[v][k] += 0.5;
    kit_expect_ok(&ctx, bw_hex_measure_distance(&ctx, &mesh, &tets.surface, &d));
    assert_float_equal(d.to_input, (float)(0.5 * sqrt(3)), 0.01);
    assert_float_equal(d.curves, (float)(0.5 * sqrt(3)), 0.01);
    assert_true(d.from_input > 0 && d.from_input < 0.5);
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

typedef struct {
    const bw_hex_mesh *mesh;
    const bw_hex_surface *surface;
} measured;

static bw_status measure_all(bw_context *ctx, void *user) {
    measured *m = user;
    bw_hex_quality q;
    bw_hex_distance d;
    return bw_hex_measure(ctx, m->mesh, &q) ? ctx->error.status : bw_hex_measure_distance(ctx, m->mesh, m->surface, &d);
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    hex_tets tets;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    hex_tets_make(&ctx, &mesh, &tets);
    measured m = {&mesh, &tets.surface};
    assert_true(kit_fail_each_allocation(measure_all, &m) > 15);
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(scaled_jacobian_of_known_shapes),
    cmocka_unit_test(volume_is_that_of_the_trilinear_map),
    cmocka_unit_test(valences_and_bins_count_every_edge_and_hex),
    cmocka_unit_test(the_worst_hex_is_named_with_its_place),
    cmocka_unit_test(a_position_that_is_no_number_is_counted_as_not_positive),
    cmocka_unit_test(measuring_can_be_cancelled),
    cmocka_unit_test(distance_to_itself_is_zero_and_a_moved_vertex_is_seen),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
