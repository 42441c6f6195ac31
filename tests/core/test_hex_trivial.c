/* The trivial map of a hex mesh: exactly seamless, singular where the mesh is irregular, and every complex of it is one of grids of hexes. */
#include "core/hex_input_kit.h"

#include "hex/incidence.h"

/* Six times the parametric volume of every hex is six units, in whole tets; every edge of hexes turns as often as it has hexes, no other edge is singular. */
static void check_map(hex_input *in) {
    bw_hex_edges edges;
    kit_expect_ok(&in->ctx, bw_hex_edges_init(&in->ctx, &in->source, &edges));
    double unit = ldexp(1, in->map.exponent), *volume = calloc(in->source.hex_count, sizeof *volume);
    for (size_t t = 0; t < in->mesh.tet_count; t++) {
        double d[3][3];
        for (int i = 0; i < 9; i++) d[i / 3][i % 3] = (double)(in->map.value[t][1 + i / 3][i % 3] - in->map.value[t][0][i % 3]) / unit;
        double det = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                     d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
        assert_true(det > 0);
        volume[in->mesh.tet_id[t]] += det;
    }
    for (size_t h = 0; h < in->source.hex_count; h++) assert_true(volume[h] == 6);
    size_t known = 0;
    for (size_t v = 0; v < in->source.vertex_count; v++)
        for (uint32_t e = edges.begin[v]; e < edges.begin[v + 1]; e++, known++) {
            bw_edge edge = bw_tet_mesh_find_edge(&in->mesh, (bw_vertex[]){(bw_vertex)v, edges.high[e]});
            assert_true(edge != BW_NONE);
            assert_int_equal(in->map.quarters[edge], edges.valence[e]);
            in->map.edge_flags[edge] &= (uint8_t)~BW_EDGE_SINGULAR; /* looked at */
        }
    for (size_t e = 0; e < in->mesh.edge_count; e++) assert_false(in->map.edge_flags[e] & BW_EDGE_SINGULAR);
    assert_true(known > 0);
    free(volume);
    bw_hex_edges_clear(&in->ctx, &edges);
}

static void the_map_is_seamless_and_singular_where_hexes_are_irregular(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    for (int which = 0; which < HEX_KIT_COUNT; which++)
        for (int round = 0; round < 3; round++) {
            bw_context ctx;
            bw_hex_mesh hex;
            hex_input in;
            bw_context_init(&ctx);
            hex_kit_sample(&ctx, which, &hex);
            bw_vertex *number = hex_input_numbers(&random, hex.vertex_count);
            hex_input_read(&in, &hex, NULL, round ? number : NULL);
            hex_input_map(&in);
            assert_int_equal(in.mesh.tet_count, 6 * hex.hex_count);
            assert_int_equal(in.mesh.vertex_count, hex.vertex_count);
            check_map(&in);
            hex_input_clear(&in);
            bw_hex_mesh_clear(&ctx, &hex);
            free(number);
        }
}

static void every_complex_gives_grids_of_hexes(void **state) {
    (void)state;
    size_t tori = 0;
    for (int which = 0; which < HEX_KIT_COUNT; which++)
        for (int variant = 0; variant < 18; variant++) {
            bw_context ctx;
            bw_hex_mesh hex;
            hex_input in;
            bw_context_init(&ctx);
            hex_kit_sample(&ctx, which, &hex);
            hex_input_read(&in, &hex, NULL, NULL);
            hex_input_map(&in);
            hex_input_build(&in, (bw_complex_kind)(variant % 3), (bw_reduce_mode)(variant / 3 % 3), variant >= 9);
            if (bw_hex_mesh_check(&in.ctx, &in.source) != BW_OK) fail_msg("%s, variant %d: %s", hex_kit_names[which], variant, in.ctx.error.message);
            size_t blocks = 0;
            for (size_t h = 0; h < in.source.hex_count; h++)
                if ((size_t)in.source.block[h] >= blocks) blocks = (size_t)in.source.block[h] + 1;
            assert_int_equal(blocks, in.complex.block_count);
            tori += in.complex.torus_splits;
            if (which == HEX_KIT_RING && variant >= 9) /* cut in two: no block touches itself */
                for (size_t p = 0; p < in.complex.patch_count; p++) assert_int_not_equal(in.complex.patch_block[p][0], in.complex.patch_block[p][1]);
            hex_input_clear(&in);
            bw_hex_mesh_clear(&ctx, &hex);
        }
    assert_true(tori > 0);
}

static void walls_are_what_parts_blocks(void **state) {
    (void)state;
    for (int which = 0; which < HEX_KIT_COUNT; which++) {
        bw_context ctx;
        bw_hex_mesh hex;
        hex_input in;
        uint8_t *wall;
        uint32_t *mate;
        size_t inside = 0;
        bw_context_init(&ctx);
        hex_kit_sample(&ctx, which, &hex);
        hex_input_read(&in, &hex, NULL, NULL);
        hex_input_map(&in);
        hex_input_build(&in, BW_COMPLEX_MC, BW_REDUCE_FULL, false);
        kit_expect_ok(&in.ctx, bw_trivial_walls(&in.ctx, &in.cells, &in.complex, &in.source, &wall));
        kit_expect_ok(&in.ctx, bw_hex_mates(&in.ctx, &in.source, &mate));
        for (uint32_t x = 0; x < 6 * in.source.hex_count; x++) {
            bool between = mate[x] != BW_HEX_NO_MATE && in.source.block[x / 6] != in.source.block[mate[x] / 6];
            if (between) assert_int_equal(wall[x] + wall[mate[x]], 1);
            if (wall[x]) assert_int_not_equal(mate[x], BW_HEX_NO_MATE);
            inside += wall[x] && !between;
        }
        assert_true(which != HEX_KIT_RING || inside > 0); /* one block that touches itself */
        bw_free(&in.ctx, wall), bw_free(&in.ctx, mate);
        hex_input_clear(&in);
        bw_hex_mesh_clear(&ctx, &hex);
    }
}

static void the_order_of_hexes_has_no_part_in_the_result(void **state) {
    (void)state;
    kit_random random = kit_random_start(2);
    for (int which = 0; which < HEX_KIT_COUNT; which++) {
        bw_context ctx;
        bw_hex_mesh hex;
        hex_input a, b;
        bw_context_init(&ctx);
        hex_kit_sample(&ctx, which, &hex);
        size_t *order = calloc(hex.hex_count, sizeof *order);
        hex_input_shuffle(&random, order, hex.hex_count);
        hex_input_read(&a, &hex, NULL, NULL), hex_input_read(&b, &hex, order, NULL);
        hex_input_map(&a), hex_input_map(&b);
        assert_memory_equal(a.mesh.tet, b.mesh.tet, a.mesh.tet_count * sizeof *a.mesh.tet);
        assert_memory_equal(a.map.value, b.map.value, a.mesh.tet_count * sizeof *a.map.value);
        hex_input_build(&a, BW_COMPLEX_MC, BW_REDUCE_FULL, false), hex_input_build(&b, BW_COMPLEX_MC, BW_REDUCE_FULL, false);
        for (size_t h = 0; h < hex.hex_count; h++) {
            assert_int_equal(b.source.block[h], a.source.block[order[h]]);
            assert_memory_equal(b.source.ijk[h], a.source.ijk[order[h]], sizeof *a.source.ijk);
            assert_memory_equal(b.source.hex[h], a.source.hex[order[h]], sizeof *a.source.hex);
        }
        free(order);
        hex_input_clear(&a), hex_input_clear(&b);
        bw_hex_mesh_clear(&ctx, &hex);
    }
}

/* ---- hexes that share two or three faces ------------------------------------------------------------------------------ */

static double tight_position[10][3] = {{0, 0, 0}, {1, -1, 0}, {-1, 1, 0}, {2, 2, 0}, {0, 0, 1}, {1, -1, 1}, {-1, 1, 1}, {2, 2, 1}, {-2, -2, 0}, {-2, -2, 1}};

static void tight_pairs_are_split_from_their_centres(void **state) {
    (void)state;
    static bw_hvertex two[2][8] = {{0, 1, 2, 3, 4, 5, 6, 7}, {0, 2, 1, 8, 4, 6, 5, 9}}, three[2][8] = {{0, 1, 2, 3, 4, 5, 6, 7}, {0, 2, 1, 3, 4, 6, 5, 8}};
    kit_random random = kit_random_start(3);
    size_t crossed = 0;
    for (int round = 0; round < 60; round++) {
        bw_hex_mesh hex = {.vertex_count = round % 2 ? 9 : 10, .hex_count = 2, .position = tight_position, .hex = round % 2 ? three : two};
        bw_vertex *number = hex_input_numbers(&random, hex.vertex_count);
        hex_input in;
        hex_input_read(&in, &hex, NULL, number);
        hex_input_map(&in);
        check_map(&in);
        assert_int_equal(in.report.centred, 2);
        crossed += in.report.crossed;
        hex_input_clear(&in);
        hex_input_read(&in, &hex, NULL, number);
        hex_input_map(&in);
        hex_input_build(&in, BW_COMPLEX_BC, BW_REDUCE_NONE, false);
        kit_expect_ok(&in.ctx, bw_hex_mesh_check(&in.ctx, &in.source));
        assert_int_equal(in.complex.block_count, 2);
        hex_input_clear(&in);
        free(number);
    }
    assert_true(crossed > 0);
}

/* ---- what is put right, and what is refused ---------------------------------------------------------------------------- */

static void left_handed_corners_are_put_right(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh hex;
    hex_input in;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_O_GRID, &hex);
    for (int mirrored = 0; mirrored < 2; mirrored++) {
        hex_input_read(&in, &hex, NULL, NULL);
        for (size_t h = 0; h < hex.hex_count && mirrored; h++)
            for (int c = 0; c < 4; c++) {
                bw_vertex keep = in.mesh.hex[h][c];
                in.mesh.hex[h][c] = in.mesh.hex[h][c + 4], in.mesh.hex[h][c + 4] = keep;
            }
        hex_input_map(&in);
        assert_int_equal(in.report.mirrored, mirrored);
        hex_input_build(&in, BW_COMPLEX_MC, BW_REDUCE_FULL, false);
        kit_expect_ok(&in.ctx, bw_hex_mesh_check(&in.ctx, &in.source));
        for (size_t h = 0; h < hex.hex_count; h++) {
            double d[3][3];
            for (int i = 0; i < 9; i++) d[i / 3][i % 3] = in.source.position[in.source.hex[h][1 << i / 3]][i % 3] - in.source.position[in.source.hex[h][0]][i % 3];
            assert_true(d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                            d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]) > 0);
        }
        hex_input_clear(&in);
    }
    bw_hex_mesh_clear(&ctx, &hex);
}

static void components_stand_side_by_side_and_unused_vertices_are_dropped(void **state) {
    (void)state;
    static const hex_kit_box apart[] = {{{0, 0, 0}, {2, 1, 1}}, {{5, 0, 0}, {6, 3, 1}}};
    bw_context ctx;
    bw_hex_mesh hex;
    hex_input in;
    bw_context_init(&ctx);
    hex_kit_boxes(&ctx, apart, 2, 7, &hex);
    size_t used = hex.vertex_count;
    bw_vertex *number = calloc(used, sizeof *number);
    for (size_t v = 0; v < used; v++) number[v] = (bw_vertex)(v + 1 + (v > 3)); /* 0 and 5 are in no hex */
    hex.vertex_count += 2;
    hex_input_read(&in, &(bw_hex_mesh){.vertex_count = used, .hex_count = hex.hex_count, .position = hex.position, .hex = hex.hex}, NULL, NULL);
    bw_free(&in.ctx, in.mesh.position);
    in.mesh.vertex_count = used + 2;
    in.mesh.position = bw_alloc(&in.ctx, used + 2, sizeof *in.mesh.position);
    for (size_t v = 0; v < used; v++) memcpy(in.mesh.position[number[v]], hex.position[v], sizeof *hex.position);
    for (size_t i = 0; i < 8 * hex.hex_count; i++) in.mesh.hex[i / 8][i % 8] = number[in.mesh.hex[i / 8][i % 8]];
    in.mesh.feature_vertex = bw_alloc(&in.ctx, 2, sizeof *in.mesh.feature_vertex);
    in.mesh.feature_vertex_count = 2;
    in.mesh.feature_vertex[0] = 5, in.mesh.feature_vertex[1] = number[0];
    hex_input_map(&in);
    assert_int_equal(in.source.vertex_count, used);
    assert_int_equal(in.mesh.feature_vertex_count, 1);
    assert_int_equal(in.mesh.feature_vertex[0], 0);
    for (size_t v = 0; v < used; v++) assert_int_equal(in.source_vertex[v], number[v]);
    hex_input_build(&in, BW_COMPLEX_MC, BW_REDUCE_FULL, false);
    kit_expect_ok(&in.ctx, bw_hex_mesh_check(&in.ctx, &in.source));
    assert_int_equal(in.complex.block_count, 2);
    hex_input_clear(&in);
    bw_hex_mesh_clear(&ctx, &hex);
    free(number);
}

typedef struct {
    const char *what;
    size_t hexes;
    bw_hvertex hex[3][8];
    bw_status status;
    int64_t named; /* a hex at fault */
} refused;

/* Two unit cubes side by side are 0 1 2 3 4 5 6 7 and 1 8 3 9 5 10 7 11. */
static const refused refusals[] = {
    {"a vertex twice", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {1, 8, 3, 9, 5, 10, 7, 8}}, BW_E_DUPLICATE, 1},
    {"a hex twice", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {0, 1, 2, 3, 4, 5, 6, 7}}, BW_E_DUPLICATE, 1},
    {"three at a face", 3, {{0, 1, 2, 3, 4, 5, 6, 7}, {1, 8, 3, 9, 5, 10, 7, 11}, {1, 12, 3, 13, 5, 14, 7, 15}}, BW_E_NONMANIFOLD, 2},
    {"one listed the other way round", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {8, 1, 9, 3, 10, 5, 11, 7}}, BW_E_INVERTED, 1},
    {"a face twisted", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {1, 8, 3, 9, 7, 10, 5, 11}}, BW_E_NONMANIFOLD, 1},
    {"an edge shared only", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {3, 8, 9, 10, 7, 11, 12, 13}}, BW_E_NONMANIFOLD, 0},
    {"a vertex shared only", 2, {{0, 1, 2, 3, 4, 5, 6, 7}, {7, 8, 9, 10, 11, 12, 13, 14}}, BW_E_NONMANIFOLD, 1},
    {"nothing", 0, {{0}}, BW_E_EMPTY, -1},
};

static void what_is_no_manifold_is_refused_with_its_hexes(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof refusals / sizeof *refusals; i++) {
        const refused *r = &refusals[i];
        double position[16][3];
        for (int k = 0; k < 48; k++) position[k / 3][k % 3] = (k * 7) % 11;
        hex_input in;
        bw_hex_mesh hex = {.vertex_count = 16, .hex_count = r->hexes, .position = position, .hex = (bw_hvertex(*)[8])(uintptr_t)r->hex};
        hex_input_read(&in, &hex, NULL, NULL);
        if (hex_input_split(&in) != r->status) fail_msg("%s: %s: %s", r->what, bw_status_code(in.ctx.error.status), in.ctx.error.message);
        bool named = r->named < 0;
        for (size_t k = 0; k < in.ctx.error.element_count; k++)
            named = named || (!strcmp(in.ctx.error.elements[k].kind, "hex") && in.ctx.error.elements[k].id == r->named);
        if (!named) fail_msg("%s: hex %lld is not named: %s", r->what, (long long)r->named, in.ctx.error.message);
        hex_input_clear(&in);
    }
}

/* ---- memory --------------------------------------------------------------------------------------------------------- */

static bw_status split_once(bw_context *ctx, void *user) {
    hex_input in;
    hex_input_read(&in, user, NULL, NULL);
    bw_tet_mesh mesh = {.vertex_count = in.mesh.vertex_count, .hex_count = in.mesh.hex_count};
    mesh.position = bw_alloc(ctx, mesh.vertex_count, sizeof *mesh.position);
    mesh.hex = bw_alloc(ctx, mesh.hex_count, sizeof *mesh.hex);
    bw_grid_map map = {0};
    bw_hex_mesh source = {0};
    bw_vertex *kept = NULL;
    bw_trivial_report report;
    bw_status status = ctx->error.status;
    if (status == BW_OK) {
        memcpy(mesh.position, in.mesh.position, mesh.vertex_count * sizeof *mesh.position);
        memcpy(mesh.hex, in.mesh.hex, mesh.hex_count * sizeof *mesh.hex);
        status = bw_trivial_map(ctx, &mesh, &map, &source, &kept, &report);
    }
    bw_grid_map_clear(ctx, &map), bw_tet_mesh_clear(ctx, &mesh), bw_hex_mesh_clear(ctx, &source), bw_free(ctx, kept);
    hex_input_clear(&in);
    return status;
}

static void allocations_may_fail_one_by_one(void **state) {
    (void)state;
    static bw_hvertex two[2][8] = {{0, 1, 2, 3, 4, 5, 6, 7}, {0, 2, 1, 8, 4, 6, 5, 9}};
    bw_context ctx;
    bw_hex_mesh hex, tight = {.vertex_count = 10, .hex_count = 2, .position = tight_position, .hex = two};
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &hex);
    assert_true(kit_fail_each_allocation(split_once, &hex) > 10);
    assert_true(kit_fail_each_allocation(split_once, &tight) > 10);
    bw_hex_mesh_clear(&ctx, &hex);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_map_is_seamless_and_singular_where_hexes_are_irregular),
    cmocka_unit_test(every_complex_gives_grids_of_hexes),
    cmocka_unit_test(walls_are_what_parts_blocks),
    cmocka_unit_test(the_order_of_hexes_has_no_part_in_the_result),
    cmocka_unit_test(tight_pairs_are_split_from_their_centres),
    cmocka_unit_test(left_handed_corners_are_put_right),
    cmocka_unit_test(components_stand_side_by_side_and_unused_vertices_are_dropped),
    cmocka_unit_test(what_is_no_manifold_is_refused_with_its_hexes),
    cmocka_unit_test(allocations_may_fail_one_by_one),
};
KIT_MAIN(tests)
