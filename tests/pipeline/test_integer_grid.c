/* Integer-grid maps as a user gets them: integer_grid.hexex is read by a program of its own, with exact fractions (tests/igm/check_integer_grid.py), and the report says
 * by which route. The reader must find damage as well. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "format/igm_hexex.h"
#include "models/models.h"

static const char *sample(const char *name, int features) {
    bw_context ctx;
    bw_model model;
    bw_model_options options;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5, options.scramble = BW_SCRAMBLE_TETS, options.features = features;
    const char *path = kit_temp_path("%s.hexex", name);
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

/* The report of a job. */
static json_t *run(const char *input, const char *json, int threads, const char *out) {
    bw_context ctx;
    bw_options options;
    bw_context_init(&ctx);
    ctx.threads = threads;
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("%s", out)));
    assert_int_equal(ctx.memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("%s/report.json", out), 0, NULL);
    assert_non_null(report);
    return report;
}

static const char *text(const json_t *report, const char *name) {
    return json_string_value(json_object_get(json_object_get(report, "reparametrize"), name));
}

static void expect_reader(const char *map, const char *input, int code, const char *word) {
    const char *argv[] = {"python3", BW_SOURCE_DIR "/tests/igm/check_integer_grid.py", map, input, NULL};
    kit_result r = kit_run(argv);
    if (r.exit != code || !strstr(r.out, word)) fail_msg("%s: exit %d, %s%s", map, r.exit, r.out, r.err);
    kit_result_clear(&r);
}

static void check(const char *input, const char *json) {
    json_t *report = run(input, json, 1, "one");
    if (strcmp(text(report, "route"), "quality")) fail_msg("%s %s: %s", input, json, text(report, "reason"));
    json_decref(report);
    expect_reader(kit_temp_path("one/integer_grid.hexex"), input, 0, " 0 faults");
}

static void maps_of_sample_models_are_integer_grid_maps(void **state) {
    (void)state;
    static const char *const names[] = {"cuboid", "cylinder", "ball", "torus-quarter", "tee"};
    static const char *const sizes[] = {"{\"quantize\": \"any\", \"scale\": 0}", "{\"quantize\": \"positive\", \"scale\": 0.7}"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) check(sample(names[i], i % 2), sizes[i % 3 == 0]);
}

static void maps_of_shared_models_are_integer_grid_maps(void **state) {
    (void)state;
    static const char *const names[] = {"mm2019_DSM_double-torus", "hm_s10c_cyl_cutsphere"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char name[120];
        snprintf(name, sizeof name, "data/tet/%s.hexex", names[i]);
        check(kit_shared(name), i % 2 ? "{\"quantize\": \"any\", \"scale\": 1}" : "{\"quantize\": \"any\", \"scale\": 0}");
    }
}

static void the_map_is_the_same_at_any_number_of_threads(void **state) {
    (void)state;
    const char *input = sample("tee", 0), *json = "{\"quantize\": \"any\", \"scale\": 0.5}";
    size_t size[2];
    json_decref(run(input, json, 1, "one"));
    json_decref(run(input, json, 2, "two"));
    char *a = kit_read_file(kit_temp_path("one/integer_grid.hexex"), &size[0]), *b = kit_read_file(kit_temp_path("two/integer_grid.hexex"), &size[1]);
    assert_int_equal(size[0], size[1]);
    assert_memory_equal(a, b, size[0]);
    free(a), free(b);
}

static void the_guaranteed_route_takes_positive_lengths(void **state) {
    (void)state;
    const char *input = sample("part", 0);
    json_t *report = run(input, "{\"quantize\": \"any\", \"scale\": 0, \"route\": \"guaranteed\"}", 1, "guaranteed");
    assert_string_equal(text(report, "route"), "guaranteed");
    assert_int_equal(json_integer_value(json_object_get(json_object_get(report, "quantization"), "zero_arcs")), 0);
    assert_false(kit_exists(kit_temp_path("guaranteed/integer_grid.hexex")));
    assert_true(json_integer_value(json_object_get(json_object_get(report, "extract"), "hexes")) > 0);
    json_decref(report);
}

/* One number of one tet changed: the reader says so. */
static void the_reader_finds_damage(void **state) {
    (void)state;
    const char *input = sample("cylinder", 0);
    json_decref(run(input, "{\"quantize\": \"any\", \"scale\": 1}", 1, "one"));
    size_t size;
    char *map = kit_read_file(kit_temp_path("one/integer_grid.hexex"), &size);
    for (int damage = 0; damage < 6; damage++) {
        char *line = map + size - 1;
        for (int back = 0; back <= 7 * damage + 1 && line > map; line--) back += line[-1] == '\n'; /* the start of a line near the end */
        line++;
        char *number = line;
        for (int skip = 0; skip < 4 + 2 * damage; number++) skip += *number == ' ';
        char *digit = number + (*number == '-'), was = *digit;
        *digit = was == '9' ? '8' : (char)(was + 1);
        kit_write_file(kit_temp_path("damaged.hexex"), map, size);
        *digit = was;
        expect_reader(kit_temp_path("damaged.hexex"), input, 1, "fault");
    }
    free(map);
}

static void decimals_are_exact(void **state) {
    (void)state;
    static const struct {
        int64_t value;
        int32_t exponent;
        const char *text;
    } cases[] = {{0, 20, "0"}, {1, 0, "1"}, {-3, 1, "-1.5"}, {1, 3, "0.125"}, {-1, 3, "-0.125"}, {(7 << 4) + 1, 4, "7.0625"},
                 {1, 20, "0.00000095367431640625"}, {-((int64_t)1 << 46), 36, "-1024"}, {1, 40, "0.0000000000009094947017729282379150390625"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char out[BW_DYADIC_TEXT];
        bw_dyadic_text(cases[i].value, cases[i].exponent, out);
        assert_string_equal(out, cases[i].text);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(maps_of_sample_models_are_integer_grid_maps),
    cmocka_unit_test(maps_of_shared_models_are_integer_grid_maps),
    cmocka_unit_test(the_map_is_the_same_at_any_number_of_threads),
    cmocka_unit_test(the_guaranteed_route_takes_positive_lengths),
    cmocka_unit_test(the_reader_finds_damage),
    cmocka_unit_test(decimals_are_exact),
};
KIT_MAIN(tests)
