/* The documented examples of input formats (api/examples/formats) are one and the same mesh, and it goes
 * through the pipeline. */
#include "kit/kit.h"

#include <stdio.h>
#include <string.h>

#include "format/input.h"
#include "stage/sanitize.h"

#define FOLDER BW_SOURCE_DIR "/api/examples/formats/"

static bw_context ctx;

static void expect_same(const bw_tet_mesh *a, const bw_tet_mesh *b) {
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->tet_count, b->tet_count);
    assert_memory_equal(a->position, b->position, a->vertex_count * sizeof *a->position);
    assert_memory_equal(a->tet, b->tet, a->tet_count * sizeof *a->tet);
    assert_memory_equal(a->parameter, b->parameter, a->tet_count * sizeof *a->parameter);
    assert_int_equal(a->feature_vertex_count, 1);
    assert_int_equal(b->feature_vertex_count, 1);
    assert_int_equal(b->feature_edge_count, 1);
    assert_int_equal(b->feature_facet_count, 2);
    assert_int_equal(a->feature_vertex[0], b->feature_vertex[0]);
    assert_memory_equal(a->feature_edge, b->feature_edge, sizeof *a->feature_edge);
}

static void all_examples_are_the_same_mesh(void **state) {
    (void)state;
    static const char *const names[] = {"cube.vtk", "cube.vtu", "cube.msh", "cube.mesh", "cube.ovm"};
    bw_tet_mesh wanted, got;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_input_read(&ctx, FOLDER "cube.hexex", NULL, &wanted));
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[500];
        snprintf(path, sizeof path, FOLDER "%s", names[i]);
        bool medit = !strcmp(names[i], "cube.mesh");
        kit_expect_ok(&ctx, bw_input_read(&ctx, path, medit ? FOLDER "cube.parameters" : NULL, &got));
        expect_same(&wanted, &got);
        bw_tet_mesh_clear(&ctx, &got);
    }
    bw_tet_mesh_clear(&ctx, &wanted);
    assert_int_equal(ctx.memory.used, 0);
}

/* Two hexes; where a format says the corners of a hex by its faces, which corner comes first is its own matter. */
static void all_examples_of_hexes_are_the_same_mesh(void **state) {
    (void)state;
    static const char *const names[] = {"hexes.mesh", "hexes.vtk", "hexes.vtu", "hexes.msh", "hexes.ovm"};
    static const bw_vertex corner[2][8] = {{0, 1, 3, 4, 6, 7, 9, 10}, {1, 2, 4, 5, 7, 8, 10, 11}}, quad[4] = {1, 4, 10, 7}, edge[2] = {0, 1};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[500];
        bw_tet_mesh got;
        bw_context_init(&ctx);
        snprintf(path, sizeof path, FOLDER "%s", names[i]);
        kit_expect_ok(&ctx, bw_input_read(&ctx, path, NULL, &got));
        assert_int_equal(got.vertex_count, 12);
        assert_int_equal(got.tet_count, 0);
        assert_int_equal(got.hex_count, 2);
        assert_memory_equal(got.hex, corner, sizeof corner);
        for (int v = 0; v < 12; v++) assert_true(got.position[v][0] == v % 3 && got.position[v][1] == v / 3 % 2 && got.position[v][2] == v / 6);
        assert_int_equal(got.feature_vertex_count, 1);
        assert_int_equal(got.feature_edge_count, 1);
        assert_int_equal(got.feature_quad_count, 1);
        assert_int_equal(got.feature_vertex[0], 0);
        assert_memory_equal(got.feature_edge, edge, sizeof edge);
        for (int k = 0; k < 4; k++) /* in either sense */
            assert_true(got.feature_quad[0][k] == quad[k] || got.feature_quad[0][k] == quad[(4 - k) % 4]);
        bw_tet_mesh_clear(&ctx, &got);
        assert_int_equal(ctx.memory.used, 0);
    }
}

/* Binary forms, voxels, an older version: the seeds of fuzzing. */
static void hexes_are_read_in_other_forms_too(void **state) {
    (void)state;
    static const char *const names[] = {"medit/hexes_binary_2", "medit/hexes_binary_3_swapped", "medit/hexes_binary_4", "vtk/hexes_voxel", "msh/hexes_2"};
    static const bw_vertex corner[2][8] = {{0, 1, 3, 4, 6, 7, 9, 10}, {1, 2, 4, 5, 7, 8, 10, 11}}, quad[4] = {1, 4, 10, 7};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[500];
        bw_tet_mesh got;
        bw_context_init(&ctx);
        snprintf(path, sizeof path, BW_SOURCE_DIR "/tests/fuzz/corpus/%s", names[i]);
        kit_expect_ok(&ctx, bw_input_read(&ctx, path, NULL, &got));
        assert_int_equal(got.vertex_count, 12);
        assert_int_equal(got.hex_count, 2);
        assert_memory_equal(got.hex, corner, sizeof corner);
        assert_int_equal(got.feature_quad_count, 1);
        assert_memory_equal(got.feature_quad, quad, sizeof quad);
        bw_tet_mesh_clear(&ctx, &got);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void the_example_is_a_seamless_map(void **state) {
    (void)state;
    bw_tet_mesh mesh;
    bw_grid_map map = {0};
    bw_sanitize_report report;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_input_read(&ctx, FOLDER "cube.vtu", NULL, &mesh));
    kit_expect_ok(&ctx, bw_sanitize(&ctx, &(bw_sanitize_options){.tolerance = 0}, &mesh, &map, &report));
    assert_true(report.already_exact);
    bw_grid_map_clear(&ctx, &map);
    bw_tet_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(all_examples_are_the_same_mesh),
    cmocka_unit_test(all_examples_of_hexes_are_the_same_mesh),
    cmocka_unit_test(hexes_are_read_in_other_forms_too),
    cmocka_unit_test(the_example_is_a_seamless_map),
};
KIT_MAIN(tests)
