/* What coding a hex mesh by its blocks costs (X 4.1), estimated and measured: the report's section compression, and hexmesh.bwh. */
#include "kit/kit.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "bwh.h"
#include "models/models.h"

static json_t *run(const char *input, const char *options_json) {
    bw_context ctx;
    bw_options options;
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, options_json, strlen(options_json)));
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("out")));
    assert_int_equal(ctx.memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("out/report.json"), 0, NULL);
    assert_non_null(report);
    return report;
}

static double number(const json_t *object, const char *name) {
    const json_t *value = json_object_get(object, name);
    if (!json_is_number(value)) fail_msg("there is no %s", name);
    return json_number_value(value);
}

static bwh_mesh decoded(void) {
    size_t size;
    bwh_mesh mesh;
    char *data = kit_read_file(kit_temp_path("out/hexmesh.bwh"), &size);
    assert_int_equal(bwh_decode(data, size, 0, &mesh), BWH_OK);
    free(data);
    return mesh;
}

static int by_place(const void *a, const void *b) {
    return memcmp(a, b, 3 * sizeof(double));
}

/* The same vertices, in another order. */
static void expect_same_positions(bwh_mesh *a, double (*position)[3], size_t count) {
    assert_int_equal(a->vertex_count, count);
    qsort(a->position, count, sizeof *a->position, by_place);
    qsort(position, count, sizeof *position, by_place);
    assert_memory_equal(a->position, position, count * sizeof *position);
}

/* Vertices of a Medit file, as text. */
static double (*medit_vertices(const char *path, size_t *count))[3] {
    size_t size;
    char *text = kit_read_file(path, &size), *at = strstr(text, "Vertices");
    assert_non_null(at);
    *count = strtoul(at + strlen("Vertices"), &at, 10);
    double(*position)[3] = malloc(*count * sizeof *position);
    for (size_t v = 0; v < *count; v++) {
        for (int k = 0; k < 3; k++) position[v][k] = strtod(at, &at);
        strtod(at, &at); /* reference */
    }
    free(text);
    return position;
}

/* ---- the shared hex meshes ------------------------------------------------------------------------------------------ */

static const char *const files[] = {"block_out", "cap_out", "hanger_stresstest_out", "impeller_stresstest_out"};
static const char *const variants[] = {"keep-singular", "full"}, *const variant_names[] = {"MC+", "MC"};

/* At 12 bits the whole file, connectivity and header and all, beside the estimate for coordinates alone. */
static void files_are_smaller_than_the_estimate(void **state) {
    (void)state;
    for (int f = 0; f < 4; f++)
        for (int i = 0; i < 2; i++) {
            const char *input = kit_shared("data/hex");
            char path[512], options[160];
            snprintf(path, sizeof path, "%s/%s.mesh", input, files[f]);
            snprintf(options, sizeof options, "{\"reduce\": \"%s\", \"effort\": 0, \"hex_formats\": [\"bwh\"], \"bwh_bits\": 12}", variants[i]);
            json_t *report = run(path, options), *c = json_object_get(report, "compression"), *w = json_object_get(c, "written");
            double pooled = number(c, "estimate_pooled"), blocks = number(c, "estimate_blocks"), whole = number(w, "bits_per_vertex");
            printf("%-24s %-3s %4.0f blocks: E_g %.2f pooled, %.2f by blocks; written %.2f, coordinates %.2f\n", files[f], variant_names[i], number(c, "blocks"), pooled,
                   blocks, whole, number(w, "bits_per_vertex_places"));
            assert_true(number(w, "bits_per_vertex_places") < whole);
            assert_true(whole <= 1.05 * fmin(pooled, blocks));
            bwh_mesh mesh = decoded();
            assert_true(mesh.step > 0 && fabs(mesh.step - 2 * number(w, "error_max")) < 1e-12);
            bwh_clear(&mesh);
            json_decref(report);
        }
}

static void lossless_files_are_lossless(void **state) {
    (void)state;
    for (int f = 0; f < 4; f++) {
        char path[512];
        size_t count;
        snprintf(path, sizeof path, "%s/%s.mesh", kit_shared("data/hex"), files[f]);
        json_t *report = run(path, "{\"effort\": 0, \"hex_formats\": [\"bwh\"]}"), *w = json_object_get(json_object_get(report, "compression"), "written");
        double(*position)[3] = medit_vertices(path, &count);
        bwh_mesh mesh = decoded();
        expect_same_positions(&mesh, position, count);
        assert_true(mesh.step == 0 && number(w, "error_max") == 0 && number(w, "bits") == 0);
        assert_true(number(w, "bits_per_vertex") < 60); /* 192 raw */
        printf("%s: %.2f bits per vertex, lossless\n", files[f], number(w, "bits_per_vertex"));
        bwh_clear(&mesh);
        free(position);
        json_decref(report);
    }
}

/* E_g and cubes as an independent program finds them from the labels that the job writes. */
static void the_estimate_is_that_of_another_program(void **state) {
    (void)state;
    const char *tool = kit_shared("tools/hex_blocks/check_blocks.py");
    char path[512], labels[512], walls[512], json[512];
    snprintf(path, sizeof path, "%s/block_out.mesh", kit_shared("data/hex"));
    json_t *report = run(path, "{\"effort\": 0, \"hex_formats\": []}"), *c = json_object_get(report, "compression");
    snprintf(labels, sizeof labels, "%s", kit_temp_path("out/labels.txt"));
    snprintf(walls, sizeof walls, "%s", kit_temp_path("out/walls.txt"));
    snprintf(json, sizeof json, "%s", kit_temp_path("checked.json"));
    kit_result numpy = kit_run((const char *const[]){"/usr/bin/python3", "-c", "import numpy", NULL});
    bool there = numpy.exit == 0;
    kit_result_clear(&numpy);
    if (!there) kit_skip("numpy is not installed");
    kit_result r = kit_run((const char *const[]){"/usr/bin/python3", tool, path, labels, "--walls", walls, "--json", json, NULL});
    if (r.exit) fail_msg("check_blocks: %s%s", r.out, r.err);
    kit_result_clear(&r);
    json_t *checked = json_load_file(json, 0, NULL);
    assert_non_null(checked);
    assert_null(json_object_get(c, "written")); /* no hexmesh.bwh was asked for */
    assert_true(number(c, "blocks") == number(checked, "E_n"));
    assert_true(fabs(number(c, "estimate_pooled") - number(checked, "E_g")) < 0.02); /* axes are named otherwise: what is half way may be rounded the other way */
    assert_true(fabs(number(c, "estimate_blocks") - number(checked, "E_g_block_entropies")) < 0.02);
    assert_true(fabs(number(c, "cube_ratio") - number(checked, "IGA_edge_counts")) < 1e-9 * number(c, "cube_ratio"));
    assert_true(fabs(number(c, "cube_ratio_lengths") - number(checked, "IGA_lengths")) < 1e-9 * number(c, "cube_ratio_lengths"));
    json_decref(checked);
    json_decref(report);
}

/* ---- hexes made of tets --------------------------------------------------------------------------------------------- */

static void hexes_of_a_tet_job_have_it_too(void **state) {
    (void)state;
    bw_context ctx;
    bw_model_options options;
    bw_model model;
    const char *path = kit_temp_path("cylinder.hexex");
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 1;
    kit_expect_ok(&ctx, bw_model_make(&ctx, "cylinder", &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    json_t *report = run(path, "{\"quantize\": \"positive\", \"target_hexes\": 2000, \"bwh_bits\": 14}"), *c = json_object_get(report, "compression");
    assert_true(number(c, "vertices") == number(json_object_get(report, "extract"), "vertices"));
    assert_true(number(json_object_get(c, "written"), "bits") == 14);
    assert_true(number(c, "cube_ratio") >= number(c, "blocks"));
    bwh_mesh mesh = decoded();
    assert_true((double)mesh.vertex_count == number(c, "vertices") && mesh.step > 0);
    bwh_clear(&mesh);
    json_decref(report);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(hexes_of_a_tet_job_have_it_too),
    cmocka_unit_test(files_are_smaller_than_the_estimate),
    cmocka_unit_test(lossless_files_are_lossless),
    cmocka_unit_test(the_estimate_is_that_of_another_program),
};
KIT_MAIN(tests)
