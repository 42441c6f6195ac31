/* Maps without any singularity become valid complexes of cuboids: tori, solid and closed, turned and sliding.
 * There is nothing there from which a wall could start, and no corner to keep one. */
#include "core/flat_kit.h"

#include <gmp.h>
#include <stdlib.h>

#include "blockwright.h"
#include "complex/reduction.h"
#include "core/traced_check.h"
#include "exact/rotation.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
    const flat_shape *shape;
} fixture;

/* Every tet in a chart of its own. */
static void scramble(bw_model *m, kit_random *random) {
    for (size_t t = 0; t < m->tet_count; t++) {
        uint64_t r = kit_random_below(random, BW_ROTATIONS);
        for (int i = 0; i < 4; i++) {
            double u[3];
            memcpy(u, m->parameter[t][i], sizeof u);
            for (int k = 0; k < 3; k++)
                m->parameter[t][i][k] =
                    bw_rotation_sign[r][k] * u[bw_rotation_axis[r][k]] + (double)(r + 3 * (uint64_t)k);
        }
    }
}

static void disturb(bw_model *m, double error, kit_random *random) {
    for (size_t i = 0; i < 12 * m->tet_count; i++)
        m->parameter[i / 12][i / 3 % 4][i % 3] += kit_random_range(random, -error, error);
}

/* Sanitized. seed bit 0: charts scrambled; bit 1: errors for sanitize to remove. */
static void open_shape(fixture *f, const flat_shape *shape, uint64_t seed) {
    *f = (fixture){.shape = shape};
    bw_context_init(&f->ctx);
    bw_model model;
    bw_sanitize_report report;
    kit_random random = kit_random_start(seed);
    kit_expect_ok(&f->ctx, flat_make(&f->ctx, shape, 0.2, kit_seed() + seed, &model));
    if (seed & 1) scramble(&model, &random);
    if (seed & 2) disturb(&model, 1e-7, &random);
    f->mesh.vertex_count = model.vertex_count, f->mesh.tet_count = model.tet_count;
    f->mesh.position = model.position, f->mesh.tet = model.tet, f->mesh.parameter = model.parameter;
    kit_expect_ok(&f->ctx, bw_sanitize(&f->ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &f->mesh, &f->map, &report));
    assert_int_equal(report.singular_interior + report.singular_boundary, 0);
    assert_int_equal(report.already_exact, !(seed & 2));
}

static bw_status trace_and_build(bw_context *ctx, fixture *f, bool split) {
    bw_build_options build = {.max_cells = 1000000, .split_self_adjacent = split};
    bw_status status = bw_cells_init(ctx, &f->cells, &f->mesh, &f->map);
    if (status == BW_OK) status = bw_trace(ctx, &f->cells, BW_COMPLEX_MC, 1000000);
    if (status == BW_OK) status = bw_build_complex(ctx, &f->cells, &build, &f->complex);
    return status;
}

static void drop_cells(bw_context *ctx, fixture *f) {
    bw_complex_clear(ctx, &f->complex);
    bw_cells_clear(ctx, &f->cells);
    memset(&f->complex, 0, sizeof f->complex);
    memset(&f->cells, 0, sizeof f->cells);
}

static void close_shape(fixture *f) {
    drop_cells(&f->ctx, f);
    bw_grid_map_clear(&f->ctx, &f->map);
    bw_tet_mesh_clear(&f->ctx, &f->mesh);
    assert_int_equal(f->ctx.memory.used, 0);
}

/* ---- ignition where there is nothing ---------------------------------------------------------------- */

static void expect_cuboids(fixture *f) {
    const bw_complex *x = &f->complex;
    kit_expect_ok(&f->ctx, bw_cells_check(&f->ctx, &f->cells));
    kit_expect_ok(&f->ctx, bw_complex_check(&f->ctx, &f->cells, x));
    assert_int_equal(x->node_count - x->arc_count + x->patch_count,
                     x->block_count); /* Euler characteristic 0 */
    double volume = 0, known = 24. * f->shape->cells[0] * f->shape->cells[1] * f->shape->cells[2] / 3 *
                               0.375 * 0.3125 * 0.3125;
    for (size_t b = 0; b < x->block_count; b++) {
        double box = 1;
        for (int k = 0; k < 3; k++) box *= ldexp((double)x->block_extent[b][k], -f->map.exponent);
        volume += box;
    }
    if (fabs(volume - known) > 1e-5 * known)
        fail_msg("%s: volume %.9g, known %.9g", f->shape->name, volume, known);
}

/* Where no iso-surface slides or turns, the planes through one point are closed surfaces, and cut the torus
 * open to one block. */
static bool closes(const flat_shape *shape) {
    return shape->slide == 0 && shape->quarters == 0;
}

static void every_flat_manifold_becomes_cuboids(void **state) {
    (void)state;
    for (int i = 0; i < FLAT_SHAPES; i++)
        for (uint64_t seed = 0; seed < 4; seed++)
            for (int split = 0; split < 2; split++) {
                fixture f;
                open_shape(&f, &flat_shapes[i], seed);
                bw_status status = trace_and_build(&f.ctx, &f, split);
                if (status != BW_OK)
                    print_message("%s, seed %d, split %d\n", f.shape->name, (int)seed, split);
                kit_expect_ok(&f.ctx, status);
                assert_true(f.complex.torus_splits >= 1);
                expect_cuboids(&f);
                if (closes(f.shape) && !split && !(seed & 2)) assert_int_equal(f.complex.block_count, 1);
                for (size_t p = 0; p < f.complex.patch_count && split; p++)
                    assert_false(f.complex.patch_block[p][0] == f.complex.patch_block[p][1]);
                close_shape(&f);
            }
}

static void tracing_leaves_them_whole(void **state) {
    (void)state;
    for (int i = 0; i < FLAT_SHAPES; i++) {
        fixture f;
        open_shape(&f, &flat_shapes[i], 0);
        kit_expect_ok(&f.ctx, bw_cells_init(&f.ctx, &f.cells, &f.mesh, &f.map));
        kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_BC, 1000000));
        assert_int_equal(f.cells.cell_count, f.mesh.tet_count);
        bw_torus_list tori = {0};
        kit_expect_ok(&f.ctx, bw_complex_build(&f.ctx, &f.cells, &f.complex, &tori));
        assert_int_equal(tori.count, 1);
        bw_free(&f.ctx, tori.cell);
        close_shape(&f);
    }
}

static void they_are_reduced_like_any_other(void **state) {
    (void)state;
    for (int i = 0; i < FLAT_SHAPES; i++)
        for (int split = 0; split < 2; split++) {
            fixture f;
            bw_reduce_report report;
            bw_reduce_options how = {BW_REDUCE_FULL, split, 1};
            open_shape(&f, &flat_shapes[i], 0);
            kit_expect_ok(&f.ctx, trace_and_build(&f.ctx, &f, split));
            kit_expect_ok(&f.ctx, bw_reduce(&f.ctx, &f.cells, &f.complex, &how, &report));
            expect_cuboids(&f);
            bw_reduction_rules rules = {how.mode, how.split_self_adjacent, NULL};
            assert_int_equal(bw_complex_removable_patch(&f.complex, &rules), BW_NONE);
            assert_true(report.blocks <= report.blocks_before);
            print_message("%-24s %-5s %2zu blocks, reduced %2zu\n", f.shape->name, split ? "split" : "allow",
                          report.blocks_before, report.blocks);
            close_shape(&f);
        }
}

/* ---- as jobs ---------------------------------------------------------------------------------------- */

static void their_results_are_exact(void **state) {
    (void)state;
    for (int i = 0; i < FLAT_SHAPES; i++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_model model;
        const char *input = kit_temp_path("flat-%d.hexex", i), *out = kit_temp_path("flat-%d", i);
        kit_expect_ok(&ctx, flat_make(&ctx, &flat_shapes[i], 0.2, kit_seed(), &model));
        kit_expect_ok(&ctx, bw_model_save(&ctx, &model, input));
        bw_model_clear(&ctx, &model);
        bw_options options;
        bw_options_defaults(&options);
        options.reduce = i & 1 ? BW_REDUCE_FULL : BW_REDUCE_NONE;
        kit_expect_ok(&ctx, bw_run(&ctx, &options, input, out));
        char *text = kit_read_file(kit_temp_path("flat-%d/traced.hexex", i), NULL);
        traced_verdict verdict;
        assert_true(traced_check(text, true, &verdict));
        if (traced_faults(&verdict)) traced_print(flat_shapes[i].name, &verdict);
        assert_int_equal(traced_faults(&verdict), 0);
        free(text);
        assert_int_equal(ctx.memory.used, 0);
    }
}

/* ---- failures --------------------------------------------------------------------------------------- */

static bw_status build_and_clear(bw_context *ctx, void *user) {
    fixture *f = user;
    bw_status status = trace_and_build(ctx, f, false);
    drop_cells(ctx, f);
    return status;
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    static const flat_shape small = {"small", {3, 3, 2}, 0, 0, false};
    fixture f;
    open_shape(&f, &small, 0);
    assert_true(kit_fail_each_allocation(build_and_clear, &f) > 50);
    close_shape(&f);
}

static void one_cell_more_than_cuts_may_add_is_a_limit(void **state) {
    (void)state;
    fixture f;
    open_shape(&f, &flat_shapes[0], 0);
    bw_build_options build = {.max_cells = UINT64_MAX};
    size_t added = 0;
    for (int run = 0; run < 3; run++) {
        kit_expect_ok(&f.ctx, bw_cells_init(&f.ctx, &f.cells, &f.mesh, &f.map));
        kit_expect_status(&f.ctx, bw_build_complex(&f.ctx, &f.cells, &build, &f.complex), run == 2 ? BW_E_LIMIT : BW_OK);
        if (run == 0) added = f.cells.cell_count - f.mesh.tet_count;
        build.max_cells = run == 0 ? added : added - 1;
        bw_complex_clear(&f.ctx, &f.complex);
        bw_cells_clear(&f.ctx, &f.cells);
    }
    assert_true(added > 20);
    close_shape(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_flat_manifold_becomes_cuboids),
        cmocka_unit_test(tracing_leaves_them_whole),
        cmocka_unit_test(they_are_reduced_like_any_other),
        cmocka_unit_test(their_results_are_exact),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(one_cell_more_than_cuts_may_add_is_a_limit),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
