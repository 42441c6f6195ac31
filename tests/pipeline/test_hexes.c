/* Jobs of hexahedra as a user gets them: what a tet job writes comes back in every format, stages one by one give the same bytes, and the input is of the kind
 * that was asked for. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "core/hex_kit.h"
#include "format/hex_write.h"
#include "models/models.h"
#include "pipeline/stages_kit.h"

/* The report of a job; the files are in the folder. */
static json_t *run(const char *input, const char *json, const char *folder) {
    bw_context ctx;
    bw_options options;
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("%s", folder)));
    assert_int_equal(ctx.memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("%s/report.json", folder), 0, NULL);
    assert_non_null(report);
    return report;
}

static int64_t number(const json_t *report, const char *section, const char *group, const char *name) {
    const json_t *at = json_object_get(report, section);
    if (group) at = json_object_get(at, group);
    const json_t *value = json_object_get(at, name);
    if (!json_is_integer(value)) fail_msg("the report has no %s.%s", section, name);
    return json_integer_value(value);
}

static const char *sample(const char *name, const char *path) {
    bw_context ctx;
    bw_model model;
    bw_model_options options;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5;
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

static const char *const raw_counts[] = {"blocks", "patches", "arcs", "nodes", "singular_arcs", "singular_nodes", "t_arcs"};

static void what_a_tet_job_writes_comes_back_in_every_format(void **state) {
    (void)state;
    static const char *const names[] = {"part", "ball", "bearing", "torus-quarter"}, *const formats[] = {"mesh", "vtk", "vtu", "msh", "ovm"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++) {
        const char *input = sample(names[m], kit_temp_path("%s.hexex", names[m]));
        json_t *first = NULL, *tets = run(input, "{\"complex\": \"bc\", \"reduce\": \"none\", \"quantize\": \"positive\", \"subdivide\": 3, "
                                                  "\"hex_formats\": [\"mesh\", \"vtk\", \"vtu\", \"msh\", \"ovm\"]}", names[m]);
        for (size_t f = 0; f < sizeof formats / sizeof *formats; f++) {
            json_t *hexes = run(kit_temp_path("%s/hexmesh.%s", names[m], formats[f]), "{\"kind\": \"hex\", \"complex\": \"bc\", \"reduce\": \"none\"}", "back");
            assert_string_equal(json_string_value(json_object_get(json_object_get(hexes, "input"), "kind")), "hex");
            assert_int_equal(number(hexes, "input", NULL, "hexes"), number(tets, "extract", NULL, "hexes"));
            assert_int_equal(number(hexes, "extract", NULL, "vertices"), number(tets, "extract", NULL, "vertices"));
            assert_false(json_is_true(json_object_get(json_object_get(hexes, "input"), "mirrored")));
            /* the base complex depends on the singularities alone, so it is that of the map */
            for (size_t c = 0; c < sizeof raw_counts / sizeof *raw_counts; c++)
                if (number(hexes, "complex", "raw", raw_counts[c]) != number(tets, "complex", "raw", raw_counts[c]))
                    fail_msg("%s as %s: %lld %s, not %lld", names[m], formats[f], (long long)number(hexes, "complex", "raw", raw_counts[c]), raw_counts[c],
                             (long long)number(tets, "complex", "raw", raw_counts[c]));
            if (first) json_decref(hexes);
            else first = hexes;
        }
        json_decref(first), json_decref(tets);
    }
}

/* ---- one process and stages ------------------------------------------------------------------------------------------ */

static void write_sample(int which, const char *path) {
    bw_context ctx;
    bw_hex_mesh hex;
    bw_hex_skin skin;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, which, &hex);
    kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &hex, &skin));
    kit_expect_ok(&ctx, bw_hex_write_vtk(&ctx, &hex, &skin, path, NULL));
    bw_hex_skin_clear(&ctx, &skin);
    bw_hex_mesh_clear(&ctx, &hex);
}

static void expect_same_file(const char *name) {
    size_t size[2];
    char *bytes[2] = {kit_read_file(kit_temp_path("once/%s", name), &size[0]), kit_read_file(kit_temp_path("stages/%s", name), &size[1])};
    assert_int_equal(size[0], size[1]);
    assert_true(size[0] > 0 || !strcmp(name, "walls.txt")); /* one block has no walls inside */
    assert_memory_equal(bytes[0], bytes[1], size[0]);
    free(bytes[0]), free(bytes[1]);
}

static void one_process_and_stages_agree(void **state) {
    (void)state;
    static const char *const results[] = {"labels.txt", "walls.txt", "blocks.json", "traced.hexex", "view.drc", "hexmesh.mesh", "hexmesh.vtu", "hexmesh.bwh"};
    for (int which = 0; which < HEX_KIT_COUNT; which++)
        for (int quantized = 0; quantized < 2; quantized++) {
            const char *input = kit_temp_path("hexes.vtk");
            write_sample(which, input);
            bw_options options;
            bw_options_defaults(&options);
            options.reduce = BW_REDUCE_FULL;
            options.time_limit = 3600; /* what a clock ends is no answer to compare */
            options.quantize = quantized ? BW_QUANTIZE_POSITIVE : BW_QUANTIZE_NONE;
            bw_context ctx;
            bw_context_init(&ctx);
            kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("once")));
            assert_int_equal(ctx.memory.used, 0);
            run_by_stages(input, kit_temp_path("stages"), &options);
            for (size_t i = 0; i < sizeof results / sizeof *results; i++)
                expect_same_file(results[i]);
        }
}

/* A block map with as many hexes along each arc as there are in the input is the input again; a coarser one has fewer. */
static void a_quantization_gives_another_mesh_and_the_labels_stay_those_of_the_input(void **state) {
    (void)state;
    const char *input = kit_temp_path("hexes.vtk");
    write_sample(HEX_KIT_O_GRID, input);
    json_t *plain = run(input, "{}", "plain"), *same = run(input, "{\"quantize\": \"positive\"}", "same"),
           *coarse = run(input, "{\"quantize\": \"positive\", \"scale\": 0}", "coarse");
    int64_t hexes = number(plain, "input", NULL, "hexes");
    assert_string_equal(json_string_value(json_object_get(json_object_get(plain, "extract"), "from")), "input");
    assert_int_equal(number(plain, "extract", NULL, "hexes"), hexes);
    assert_int_equal(number(same, "extract", NULL, "hexes"), hexes);
    assert_int_equal(number(coarse, "extract", NULL, "hexes"), 5);
    size_t size[2];
    char *labels[2] = {kit_read_file(kit_temp_path("plain/labels.txt"), &size[0]), kit_read_file(kit_temp_path("coarse/labels.txt"), &size[1])};
    assert_string_equal(labels[0], labels[1]);
    int64_t lines = 0;
    for (size_t i = 0; i < size[0]; i++) lines += labels[0][i] == '\n';
    assert_int_equal(lines, hexes);
    free(labels[0]), free(labels[1]);
    json_decref(plain), json_decref(same), json_decref(coarse);
}

/* ---- kinds ------------------------------------------------------------------------------------------------------------ */

static void an_input_of_the_other_kind_is_refused(void **state) {
    (void)state;
    const char *tets = sample("ball", kit_temp_path("ball.hexex")), *hexes = kit_temp_path("hexes.vtk");
    write_sample(HEX_KIT_TEE, hexes);
    const struct {
        const char *input;
        bw_input_kind kind;
        bw_status status;
    } cases[] = {{tets, BW_KIND_HEX, BW_E_KIND}, {hexes, BW_KIND_TET, BW_E_KIND}, {tets, BW_KIND_TET, BW_OK}, {hexes, BW_KIND_HEX, BW_OK}, {hexes, BW_KIND_AUTO, BW_OK}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bw_context ctx;
        bw_options options;
        bw_context_init(&ctx);
        bw_options_defaults(&options);
        options.kind = cases[i].kind, options.until = BW_STAGE_SANITIZE;
        kit_expect_status(&ctx, bw_run(&ctx, &options, cases[i].input, kit_temp_path("kind")), cases[i].status);
        assert_int_equal(ctx.memory.used, 0);
    }
}

/* ---- memory ----------------------------------------------------------------------------------------------------------- */

static bw_status whole_job(bw_context *ctx, void *user) {
    bw_options options;
    bw_options_defaults(&options);
    options.hex_formats = 1u << BW_HEX_FORMAT_MESH;
    return bw_run(ctx, &options, user, kit_temp_path("starved"));
}

static void every_allocation_of_a_job_may_fail(void **state) {
    (void)state;
    assert_true(kit_fail_each_allocation(whole_job, (void *)(uintptr_t)(BW_SOURCE_DIR "/api/examples/formats/hexes.ovm")) > 100);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_a_tet_job_writes_comes_back_in_every_format),
    cmocka_unit_test(one_process_and_stages_agree),
    cmocka_unit_test(a_quantization_gives_another_mesh_and_the_labels_stay_those_of_the_input),
    cmocka_unit_test(an_input_of_the_other_kind_is_refused),
    cmocka_unit_test(every_allocation_of_a_job_may_fail),
};
KIT_MAIN(tests)
