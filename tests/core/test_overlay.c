/* The refined block-wise map is an integer-grid map by its own validator, and the preimage of the integer grid is the hex mesh that was promised. */
#include "core/igm_kit.h"

#include <stdio.h>
#include <time.h>

#include "format/igm_hexex.h"
#include "hex/blockfill.h"
#include "hex/extract.h"
#include "igm/overlay.h"
#include "igm/overlay_points.h"

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* The vertices of two hex meshes are the same points, to rounding. */
static void compare_vertices(const char *name, const bw_hex_mesh *a, const bw_hex_mesh *b) {
    size_t n = a->vertex_count, far = 0;
    assert_int_equal(n, b->vertex_count);
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, size = 0;
    for (size_t v = 0; v < n; v++)
        for (int k = 0; k < 3; k++) low[k] = fmin(low[k], a->position[v][k]), high[k] = fmax(high[k], a->position[v][k]);
    for (int k = 0; k < 3; k++) size = fmax(size, high[k] - low[k]);
    for (size_t v = 0; v < n && n <= 1000; v++) {
        double best = INFINITY;
        for (size_t w = 0; w < n; w++) {
            double d = 0;
            for (int k = 0; k < 3; k++) d = fmax(d, fabs(a->position[v][k] - b->position[w][k]));
            best = fmin(best, d);
        }
        far += best > 1e-6 * size;
    }
    if (far) fail_msg("%s: %zu of %zu vertices are elsewhere", name, far, n);
}

static bw_overlay_report check(quantizable *q, double scale, uint64_t max_tets) {
    bw_atlas atlas;
    bw_blockwise map;
    bw_igm igm;
    bw_overlay_report report;
    bw_hex_mesh direct, extracted;
    bw_hex_origin origin;
    igm_quantize(q, BW_QUANTIZE_POSITIVE, scale);
    kit_expect_ok(&q->ctx, bw_atlas_init(&q->ctx, &q->cells, &q->complex, q->length, &atlas));
    kit_expect_ok(&q->ctx, bw_blockwise_init(&q->ctx, &atlas, &map));
    kit_expect_ok(&q->ctx, bw_blockfill(&q->ctx, &map, 1, &direct));
    double since = now();
    bw_status status = bw_overlay(&q->ctx, &map, &q->cells, max_tets, &igm, &report);
    if (status == BW_E_RANGE || status == BW_E_LIMIT) {
        printf("%s scale %g: %s\n", q->name, scale, q->ctx.error.message);
        q->ctx.error = (bw_error){.status = BW_OK};
    } else {
        if (status != BW_OK) printf("%s scale %g\n", q->name, scale);
        kit_expect_ok(&q->ctx, status);
        printf("%-50s scale %g: %6zu tets -> %7zu, %.2f s\n", q->name, scale, q->mesh.tet_count, igm.mesh.tet_count, now() - since);
        kit_expect_ok(&q->ctx, bw_igm_check(&q->ctx, &igm));
        kit_expect_ok(&q->ctx, bw_hex_extract(&q->ctx, &igm, 1, UINT64_MAX, &extracted, &origin));
        assert_int_equal(extracted.hex_count, direct.hex_count);
        compare_vertices(q->name, &direct, &extracted);
        bw_hex_mesh_clear(&q->ctx, &extracted);
        bw_hex_origin_clear(&q->ctx, &origin);
    }
    bw_igm_clear(&q->ctx, &igm);
    bw_hex_mesh_clear(&q->ctx, &direct);
    bw_blockwise_clear(&q->ctx, &map);
    bw_atlas_clear(&q->ctx, &atlas);
    return report;
}

static void sample_models_have_refined_maps(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    uint64_t cut = 0;
    for (size_t i = 0; i < count; i++)
        for (int mode = BW_REDUCE_NONE; mode <= BW_REDUCE_FULL; mode += 2) {
            quantizable q;
            bw_model_options options;
            bw_model_options_defaults(&options);
            options.size = 1, options.noise = 0.5, options.seed = i, options.features = mode == BW_REDUCE_FULL;
            quantizable_open(&q, models[i].name, &options, BW_COMPLEX_MC, (bw_reduce_mode)mode);
            cut += check(&q, 1, UINT64_MAX).cut_cells;
            quantizable_close(&q);
        }
    assert_true(cut > 0);
}

static void flat_manifolds_have_refined_maps(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check(&q, 3, UINT64_MAX);
        quantizable_close(&q);
    }
}

typedef struct {
    bw_blockwise *map;
    bw_cells *cells;
} again;

static bw_status overlay_again(bw_context *ctx, void *user) {
    again *a = user;
    bw_igm igm;
    bw_overlay_report report;
    bw_status status = bw_overlay(ctx, a->map, a->cells, UINT64_MAX, &igm, &report);
    bw_igm_clear(ctx, &igm);
    return status;
}

static void limits_and_failing_allocations_leave_nothing(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.features = 1;
    quantizable_open(&q, "l-shape", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 1);
    bw_atlas atlas;
    bw_blockwise map;
    bw_igm igm;
    bw_overlay_report report;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
    kit_expect_ok(&q.ctx, bw_blockwise_init(&q.ctx, &atlas, &map));
    kit_expect_status(&q.ctx, bw_overlay(&q.ctx, &map, &q.cells, 100, &igm, &report), BW_E_LIMIT);
    assert_int_equal(igm.mesh.tet_count, 0);
    q.ctx.error = (bw_error){.status = BW_OK};
    kit_fail_each_allocation(overlay_again, &(again){&map, &q.cells}); /* all tets are open by now */
    bw_blockwise_clear(&q.ctx, &map);
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

/* Features of a refined mesh are parts of those of the mesh: as long, as large, as many. */
static size_t of_gmp; /* bytes that GMP holds */

static void *gmp_new(size_t size) {
    of_gmp += size;
    return malloc(size);
}

static void *gmp_resize(void *block, size_t before, size_t size) {
    of_gmp += size - before;
    return realloc(block, size);
}

static void gmp_free(void *block, size_t size) {
    of_gmp -= size;
    free(block);
}

/* What GMP takes for exact points counts as the job's memory, and against its limit. */
static void exact_numbers_count_as_the_jobs_memory(void **state) {
    (void)state;
    bw_context ctx;
    bw_exact_points points = {0};
    mpq_t x[3];
    mp_set_memory_functions(gmp_new, gmp_resize, gmp_free);
    of_gmp = 0;
    bw_context_init(&ctx);
    mpq_inits(x[0], x[1], x[2], NULL);
    for (int round = 0; round < 2; round++) { /* the second takes the numbers of the first */
        for (long i = 1; i <= 5000; i++) {
            int32_t at;
            for (int k = 0; k < 3; k++) {
                mpz_ui_pow_ui(mpq_numref(x[k]), 3, (unsigned long)(i % 200 + 50 * round));
                mpz_mul_si(mpq_numref(x[k]), mpq_numref(x[k]), i + k);
                mpz_ui_pow_ui(mpq_denref(x[k]), 2, (unsigned long)i % 300);
                mpq_canonicalize(x[k]);
            }
            kit_expect_ok(&ctx, bw_exact_points_find(&ctx, &points, round, (const mpq_t *)x, &at));
        }
        size_t own = points.room * sizeof *points.point + points.slots * sizeof *points.slot, counted = ctx.memory.used - own;
        if (counted < of_gmp || counted > 3 * of_gmp) fail_msg("%zu bytes counted, %zu of GMP", counted, of_gmp);
        bw_exact_points_empty(&points);
    }
    ctx.memory.limit = ctx.memory.used + 1000;
    bw_status status = BW_OK;
    for (long i = 1; i <= 5000 && status == BW_OK; i++) {
        int32_t at;
        mpz_ui_pow_ui(mpq_numref(x[0]), 5, 2000), mpz_add_ui(mpq_numref(x[0]), mpq_numref(x[0]), (unsigned long)i);
        status = bw_exact_points_find(&ctx, &points, 2, (const mpq_t *)x, &at);
    }
    assert_int_equal(status, BW_E_MEMORY);
    mpq_clears(x[0], x[1], x[2], NULL);
    bw_exact_points_clear(&ctx, &points);
    assert_int_equal(ctx.memory.used, 0);
    assert_int_equal(of_gmp, 0);
    mp_set_memory_functions(NULL, NULL, NULL);
}

static void features_are_carried_over(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5, options.features = 1;
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 1);
    bw_atlas atlas;
    bw_blockwise map;
    bw_igm igm;
    bw_overlay_report report;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
    kit_expect_ok(&q.ctx, bw_blockwise_init(&q.ctx, &atlas, &map));
    kit_expect_ok(&q.ctx, bw_overlay(&q.ctx, &map, &q.cells, UINT64_MAX, &igm, &report));
    double length[2] = {0, 0};
    const bw_tet_mesh *meshes[2] = {&q.mesh, &igm.mesh};
    for (int m = 0; m < 2; m++)
        for (size_t e = 0; e < meshes[m]->feature_edge_count; e++) {
            const double *a = meshes[m]->position[meshes[m]->feature_edge[e][0]], *b = meshes[m]->position[meshes[m]->feature_edge[e][1]];
            length[m] += sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) + (a[2] - b[2]) * (a[2] - b[2]));
        }
    assert_true(length[0] > 0);
    assert_true(fabs(length[0] - length[1]) < 1e-9 * length[0]);
    assert_int_equal(q.mesh.feature_vertex_count, igm.mesh.feature_vertex_count);
    for (size_t i = 0; i < q.mesh.feature_vertex_count; i++)
        assert_memory_equal(q.mesh.position[q.mesh.feature_vertex[i]], igm.mesh.position[igm.mesh.feature_vertex[i]], sizeof *q.mesh.position);
    bw_igm_clear(&q.ctx, &igm);
    bw_blockwise_clear(&q.ctx, &map);
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

static int read_independently(const char *path) {
    kit_result r = kit_run((const char *[]){"python3", BW_SOURCE_DIR "/tests/core/integer_grid.py", path, NULL});
    printf("%s%s", r.out, r.err);
    int code = r.exit;
    kit_result_clear(&r);
    return code;
}

static void an_independent_reader_agrees(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.5;
    quantizable_open(&q, "ball", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 1);
    bw_atlas atlas;
    bw_blockwise map;
    bw_igm igm;
    bw_overlay_report report;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
    kit_expect_ok(&q.ctx, bw_blockwise_init(&q.ctx, &atlas, &map));
    kit_expect_ok(&q.ctx, bw_overlay(&q.ctx, &map, &q.cells, UINT64_MAX, &igm, &report));
    assert_true(report.cut_cells > 100);
    const char *path = kit_temp_path("integer_grid.hexex");
    kit_expect_ok(&q.ctx, bw_igm_hexex_write(&q.ctx, &igm, path, NULL));
    assert_int_equal(read_independently(path), 0);
    igm.map.value[igm.mesh.tet_count / 2][1][0]++; /* the smallest step there is */
    kit_expect_ok(&q.ctx, bw_igm_hexex_write(&q.ctx, &igm, path, NULL));
    assert_int_equal(read_independently(path), 1);
    bw_igm_clear(&q.ctx, &igm);
    bw_blockwise_clear(&q.ctx, &map);
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

/* BW_SCALE: another size, and all models; else every fourth. */
static void shared_models_have_refined_maps(void **state) {
    (void)state;
    const char *folder = kit_shared("data/tet"), *scale = getenv("BW_SCALE");
    size_t count, refused = 0;
    char **names = kit_names(folder, ".hexex", &count);
    assert_true(count > 0);
    for (size_t i = scale ? 0 : 1; i < count; i += scale ? 1 : 4) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_FULL);
        refused += check(&q, scale ? strtod(scale, NULL) : 0, 2000000).flat > 0;
        quantizable_close(&q);
    }
    kit_names_free(names, count);
    printf("%zu of %zu are too thin for the grid\n", refused, count);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sample_models_have_refined_maps),
    cmocka_unit_test(flat_manifolds_have_refined_maps),
    cmocka_unit_test(limits_and_failing_allocations_leave_nothing),
    cmocka_unit_test(exact_numbers_count_as_the_jobs_memory),
    cmocka_unit_test(features_are_carried_over),
    cmocka_unit_test(an_independent_reader_agrees),
    cmocka_unit_test(shared_models_have_refined_maps),
};
KIT_MAIN(tests)
