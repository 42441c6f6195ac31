/* The outside of hex meshes whose surfaces and irregular edges are known (hex/skin.h). */
#include "core/hex_kit.h"

#include <stdio.h>

static const struct {
    size_t quads, surfaces, inside, boundary; /* inside, boundary: irregular edges */
} expected[HEX_KIT_COUNT] = {
    {2 * (5 * 4 + 5 * 4 + 4 * 4), 6, 0, 4 * (5 + 4 + 4)},
    {4 * 3 * 4 + 2 * 5 * 9, 3, 4 * 4, 4 * 3 * 2},
    {5 * 4 * 3 + 2 * 5 * 4, 7, 3, 5 * 4 * 2 + 5 * 3},
    {4 * 2 * 12, 1, 4 * 12, 0},
    {2 * (5 * 3 + 5 * 4 + 3 * 4), 6, 0, 4 * (5 + 3 + 4)},
    {4 * 3 * 16, 4, 0, 4 * 16},
};

static void skins_of_samples_are_as_known(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        bw_hex_skin skin;
        hex_kit_sample(&ctx, i, &mesh);
        kit_expect_ok(&ctx, bw_hex_mesh_check(&ctx, &mesh));
        kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
        size_t inside = 0;
        for (size_t e = 0; e < skin.edge_count; e++) inside += !skin.edge[e].boundary;
        printf("%s: %zu quads, %zu surfaces, %zu irregular edges\n", hex_kit_names[i], skin.quad_count, skin.surface_count, skin.edge_count);
        assert_int_equal(skin.quad_count, expected[i].quads);
        assert_int_equal(skin.surface_count, expected[i].surfaces);
        assert_int_equal(inside, expected[i].inside);
        assert_int_equal(skin.edge_count - inside, expected[i].boundary);
        bw_hex_skin_clear(&ctx, &skin);
        bw_hex_mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static bw_status skin_of(bw_context *ctx, void *user) {
    bw_hex_skin skin;
    bw_status status = bw_hex_skin_init(ctx, user, &skin);
    bw_hex_skin_clear(ctx, &skin);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TORUS, &mesh);
    assert_true(kit_fail_each_allocation(skin_of, &mesh) > 5);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(skins_of_samples_are_as_known),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
