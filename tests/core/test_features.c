/* Feature vertices, edges and facets end on nodes, arcs and walls, and are still there after reduction. */
#include "kit/kit.h"

#include "core/sample_map.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/trace.h"

typedef struct {
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
    bw_complex_kind kind;
} fixture;

static const bw_complex_kind kinds[] = {BW_COMPLEX_MC, BW_COMPLEX_SERIAL};

/* A cuboid whose tets lie on a grid: its interior has vertices, edges and facets to mark. */
static void start(bw_context *ctx, fixture *f, bw_complex_kind kind) {
    memset(f, 0, sizeof *f);
    f->kind = kind;
    bw_context_init(ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 3, options.noise = 0;
    kit_expect_ok(ctx, sample_map(ctx, "cuboid", &options, &f->mesh, &f->map));
}

static void finish(bw_context *ctx, fixture *f) {
    bw_complex_clear(ctx, &f->complex);
    bw_cells_clear(ctx, &f->cells);
    bw_grid_map_clear(ctx, &f->map);
    bw_tet_mesh_clear(ctx, &f->mesh);
    assert_int_equal(ctx->memory.used, 0);
}

static void trace_with_features(bw_context *ctx, fixture *f) {
    kit_expect_ok(ctx, bw_grid_map_derive(ctx, &f->mesh, &f->map));
    kit_expect_ok(ctx, bw_cells_init(ctx, &f->cells, &f->mesh, &f->map));
    kit_expect_ok(ctx, bw_trace(ctx, &f->cells, f->kind, 1000000));
    kit_expect_ok(ctx, bw_build_complex(ctx, &f->cells, &(bw_build_options){.max_cells = 1000000}, &f->complex));
    kit_expect_ok(ctx, bw_cells_check(ctx, &f->cells));
}

/* The raw blocks and those left by full reduction; the checks of both complexes look at the features. */
static void expect_blocks(bw_context *ctx, fixture *f, size_t raw, size_t reduced) {
    trace_with_features(ctx, f);
    assert_int_equal(f->complex.block_count, raw);
    bw_reduce_report report;
    kit_expect_ok(ctx, bw_reduce(ctx, &f->cells, &f->complex, &(bw_reduce_options){.mode = BW_REDUCE_FULL, .effort = 1}, &report));
    assert_int_equal(f->complex.block_count, reduced);
}

static bool is_inner_vertex(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_vertex v) {
    for (size_t e = 0; e < mesh->edge_count; e++)
        if ((mesh->edge[e][0] == v || mesh->edge[e][1] == v) && map->edge_flags[e] & BW_EDGE_BOUNDARY) return false;
    return true;
}

static void vertex_becomes_a_node(bw_complex_kind kind) {
    bw_context ctx;
    fixture f;
    start(&ctx, &f, kind);
    bw_vertex v = 0;
    while (!is_inner_vertex(&f.mesh, &f.map, v)) v++;
    f.mesh.feature_vertex = bw_alloc(&ctx, 1, sizeof *f.mesh.feature_vertex);
    f.mesh.feature_vertex[0] = v, f.mesh.feature_vertex_count = 1;
    expect_blocks(&ctx, &f, 8, 8); /* nothing else holds the vertex: its walls stay */
    int features = 0;
    for (size_t n = 0; n < f.complex.node_count; n++)
        features += f.complex.node_flags[n] & BW_NODE_FEATURE && f.complex.node_vertex[n] == v;
    assert_int_equal(features, 1);
    finish(&ctx, &f);
}

static void an_inner_vertex_becomes_a_node(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) vertex_becomes_a_node(kinds[k]);
}

static void edge_becomes_part_of_an_arc(bw_complex_kind kind) {
    bw_context ctx;
    fixture f;
    start(&ctx, &f, kind);
    bw_edge e = 0;
    for (;; e++) {
        const bw_vertex *end = f.mesh.edge[e];
        bw_tet t = 0;
        while (bw_tet_corner(&f.mesh, t, end[0]) < 0 || bw_tet_corner(&f.mesh, t, end[1]) < 0) t++;
        const int64_t *a = f.map.value[t][bw_tet_corner(&f.mesh, t, end[0])], *b = f.map.value[t][bw_tet_corner(&f.mesh, t, end[1])];
        int differing = (a[0] != b[0]) + (a[1] != b[1]) + (a[2] != b[2]);
        if (differing == 1 && is_inner_vertex(&f.mesh, &f.map, end[0]) && is_inner_vertex(&f.mesh, &f.map, end[1])) break;
    }
    f.mesh.feature_edge = bw_alloc(&ctx, 1, sizeof *f.mesh.feature_edge);
    memcpy(f.mesh.feature_edge[0], f.mesh.edge[e], sizeof f.mesh.edge[e]);
    f.mesh.feature_edge_count = 1;
    trace_with_features(&ctx, &f);
    assert_int_equal(f.complex.block_count, kind == BW_COMPLEX_SERIAL ? 3 : 4); /* two walls through the edge, or a wall and half of one */
    bw_reduce_report report;
    kit_expect_ok(&ctx, bw_reduce(&ctx, &f.cells, &f.complex, &(bw_reduce_options){.mode = BW_REDUCE_FULL, .effort = 1}, &report));
    assert_in_range(f.complex.block_count, 2, 3);
    finish(&ctx, &f);
}

static void an_inner_edge_becomes_part_of_an_arc(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) edge_becomes_part_of_an_arc(kinds[k]);
}

static void facet_becomes_part_of_a_wall(bw_complex_kind kind) {
    bw_context ctx;
    fixture f;
    start(&ctx, &f, kind);
    bw_facet found = BW_NONE;
    for (size_t i = 0; i < f.mesh.facet_count && found == BW_NONE; i++) {
        if (f.mesh.facet_tet[i][1] == BW_NONE) continue;
        const int64_t *u[3];
        for (int k = 0; k < 3; k++)
            u[k] = f.map.value[f.mesh.facet_tet[i][0]][bw_tet_corner(&f.mesh, f.mesh.facet_tet[i][0], f.mesh.facet[i][k])];
        for (int k = 0; k < 3; k++)
            if (u[0][k] == u[1][k] && u[0][k] == u[2][k]) found = (bw_facet)i;
    }
    assert_true(found != BW_NONE);
    f.mesh.feature_facet = bw_alloc(&ctx, 1, sizeof *f.mesh.feature_facet);
    memcpy(f.mesh.feature_facet[0], f.mesh.facet[found], sizeof f.mesh.facet[found]);
    f.mesh.feature_facet_count = 1;
    expect_blocks(&ctx, &f, 2, 2);
    finish(&ctx, &f);
}

static void an_inner_facet_becomes_part_of_a_wall(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) facet_becomes_part_of_a_wall(kinds[k]);
}

static void an_oblique_feature_is_refused(void **state) {
    (void)state;
    bw_context ctx;
    fixture f;
    start(&ctx, &f, BW_COMPLEX_MC);
    bw_edge e = 0;
    for (;; e++) { /* a diagonal: longer than both sides of its square */
        const bw_vertex *end = f.mesh.edge[e];
        bw_tet t = 0;
        while (bw_tet_corner(&f.mesh, t, end[0]) < 0 || bw_tet_corner(&f.mesh, t, end[1]) < 0) t++;
        const int64_t *a = f.map.value[t][bw_tet_corner(&f.mesh, t, end[0])], *b = f.map.value[t][bw_tet_corner(&f.mesh, t, end[1])];
        if ((a[0] != b[0]) + (a[1] != b[1]) + (a[2] != b[2]) > 1) break;
    }
    f.mesh.feature_edge = bw_alloc(&ctx, 1, sizeof *f.mesh.feature_edge);
    memcpy(f.mesh.feature_edge[0], f.mesh.edge[e], sizeof f.mesh.edge[e]);
    f.mesh.feature_edge_count = 1;
    kit_expect_status(&ctx, bw_grid_map_derive(&ctx, &f.mesh, &f.map), BW_E_NOT_ALIGNED);
    finish(&ctx, &f);
}

/* The sharp edges and corners of every model, as marked by the generator. */
static void sharp_edges_of_models_survive(void **state) {
    (void)state;
    size_t models;
    const bw_model_info *list = bw_model_list(&models);
    for (size_t m = 0; m < 2 * models; m++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_model_options options;
        bw_model_options_defaults(&options);
        options.size = 1, options.noise = 0.4, options.features = 1, options.seed = kit_seed();
        bw_model model;
        fixture f;
        memset(&f, 0, sizeof f);
        bw_sanitize_report sanitized;
        kit_expect_ok(&ctx, bw_model_make(&ctx, list[m / 2].name, &options, &model));
        f.kind = kinds[m % 2];
        f.mesh.vertex_count = model.vertex_count, f.mesh.tet_count = model.tet_count;
        f.mesh.position = model.position, f.mesh.tet = model.tet, f.mesh.parameter = model.parameter;
        f.mesh.feature_vertex = model.feature_vertex, f.mesh.feature_vertex_count = model.feature_vertex_count;
        f.mesh.feature_edge = model.feature_edge, f.mesh.feature_edge_count = model.feature_edge_count;
        model.position = NULL, model.tet = NULL, model.parameter = NULL, model.feature_vertex = NULL, model.feature_edge = NULL;
        bw_model_clear(&ctx, &model);
        kit_expect_ok(&ctx, bw_sanitize(&ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &f.mesh, &f.map, &sanitized));
        trace_with_features(&ctx, &f);
        assert_int_equal(f.complex.block_count > 0, 1);
        bw_reduce_report report;
        kit_expect_ok(&ctx, bw_reduce(&ctx, &f.cells, &f.complex, &(bw_reduce_options){.mode = BW_REDUCE_FULL}, &report));
        finish(&ctx, &f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_inner_vertex_becomes_a_node),
        cmocka_unit_test(an_inner_edge_becomes_part_of_an_arc),
        cmocka_unit_test(an_inner_facet_becomes_part_of_a_wall),
        cmocka_unit_test(an_oblique_feature_is_refused),
        cmocka_unit_test(sharp_edges_of_models_survive),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
