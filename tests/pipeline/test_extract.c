/* The hex mesh as a user gets it: as many hexes as the quantization promised, refined where asked for or needed, refused with a number where there would be too many. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "models/models.h"

static const char *sample(const char *name) {
    bw_context ctx;
    bw_model_options options;
    bw_model model;
    const char *path = kit_temp_path("%s.hexex", name);
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.5;
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

/* Runs a job and returns its report, to be given to json_decref. */
static json_t *run(const char *input, const char *options_json, bw_context *ctx, bw_status expected) {
    bw_options options;
    bw_context_init(ctx);
    bw_options_defaults(&options);
    kit_expect_ok(ctx, bw_options_from_json(ctx, &options, options_json, strlen(options_json)));
    kit_expect_status(ctx, bw_run(ctx, &options, input, kit_temp_path("out")), expected);
    assert_int_equal(ctx->memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("out/report.json"), 0, NULL);
    assert_non_null(report);
    return report;
}

static long long count(const json_t *report, const char *section, const char *name) {
    const json_t *value = json_object_get(json_object_get(report, section), name);
    if (!json_is_integer(value)) fail_msg("the report has no %s.%s", section, name);
    return json_integer_value(value);
}

static void the_mesh_has_as_many_hexes_as_were_promised(void **state) {
    (void)state;
    static const char *const ranges[] = {"positive", "nonnegative", "any"};
    size_t models;
    const bw_model_info *model = bw_model_list(&models);
    for (size_t i = 0; i < models; i++) {
        char options[160];
        bw_context ctx;
        snprintf(options, sizeof options, "{\"quantize\": \"%s\", \"scale\": %g, \"smooth\": \"off\", \"hex_formats\": []}", ranges[i % 3], i % 2 ? 1.0 : 2.0);
        json_t *report = run(sample(model[i].name), options, &ctx, BW_OK);
        long long n = count(report, "extract", "subdivide");
        assert_int_equal(count(report, "extract", "hexes"), count(report, "extract", "promised"));
        assert_int_equal(count(report, "extract", "hexes"), n * n * n * count(report, "quantization", "hexes"));
        json_t *base = json_object_get(report, "base_complex");
        assert_int_equal(count(base, "planned", "hexes"), count(report, "quantization", "hexes"));
        assert_int_equal(count(base, "planned", "blocks"), count(base, "after", "blocks"));
        json_decref(report);
    }
}

static void hexes_are_cut_where_that_is_asked_for(void **state) {
    (void)state;
    for (int n = 1; n <= 4; n++) {
        char options[160];
        bw_context ctx;
        snprintf(options, sizeof options, "{\"quantize\": \"positive\", \"scale\": 0, \"subdivide\": %d, \"smooth\": \"off\"}", n);
        json_t *report = run(sample("cylinder"), options, &ctx, BW_OK);
        assert_int_equal(count(report, "extract", "subdivide"), n);
        assert_int_equal(count(report, "extract", "hexes"), n * n * n * count(report, "quantization", "hexes"));
        json_decref(report);
    }
}

/* The coarsest ring is one hex around, whose ends are one face. */
static void a_ring_of_one_hex_is_cut_in_three(void **state) {
    (void)state;
    bw_context ctx;
    json_t *report = run(sample("torus"), "{\"quantize\": \"positive\", \"scale\": 0}", &ctx, BW_OK);
    assert_int_equal(count(report, "quantization", "hexes"), 1);
    assert_int_equal(count(report, "extract", "subdivide_asked"), 1);
    assert_int_equal(count(report, "extract", "subdivide"), 3);
    assert_int_equal(count(report, "extract", "hexes"), 27);
    json_decref(report);
}

static void too_many_hexes_are_refused_with_their_number_before_a_map_is_made(void **state) {
    (void)state;
    static const char *const routes[] = {"auto", "quality", "guaranteed"};
    for (int i = 0; i < 3; i++) {
        bw_context ctx;
        char words[80], options[160];
        snprintf(options, sizeof options, "{\"quantize\": \"positive\", \"scale\": 0, \"subdivide\": 10, \"max_hexes\": 999, \"route\": \"%s\"}", routes[i]);
        json_t *report = run(sample("ball"), options, &ctx, BW_E_LIMIT);
        snprintf(words, sizeof words, "would have %lld hexes, more than 999", 1000 * count(report, "quantization", "hexes"));
        if (!strstr(ctx.error.message, words)) fail_msg("\"%s\" expected in: %s", words, ctx.error.message);
        assert_string_equal(ctx.stage, "reparametrize");
        json_decref(report);
    }
}

static void as_many_hexes_as_may_be_are_made(void **state) {
    (void)state;
    bw_context ctx;
    char options[120];
    json_t *report = run(sample("ball"), "{\"quantize\": \"positive\", \"scale\": 0, \"until\": \"quantize\"}", &ctx, BW_OK);
    snprintf(options, sizeof options, "{\"quantize\": \"positive\", \"scale\": 0, \"subdivide\": 2, \"max_hexes\": %lld}", 8 * count(report, "quantization", "hexes"));
    json_decref(report);
    json_decref(run(sample("ball"), options, &ctx, BW_OK));
}

typedef struct {
    int steps;
    double last;
} shown;

static void watch_map(void *user, const char *stage, double fraction) {
    shown *s = user;
    if (strcmp(stage, "reparametrize")) return;
    assert_true(fraction >= s->last);
    s->steps += fraction > s->last, s->last = fraction;
}

static void progress_is_shown_while_a_map_is_made(void **state) {
    (void)state;
    bw_context ctx;
    bw_options options;
    shown seen = {0};
    static const char json[] = "{\"quantize\": \"positive\", \"route\": \"quality\", \"until\": \"reparametrize\"}";
    const char *input = sample("ball");
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
    ctx.progress = watch_map, ctx.user = &seen;
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("out")));
    assert_true(seen.steps > 2);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_mesh_has_as_many_hexes_as_were_promised),
        cmocka_unit_test(hexes_are_cut_where_that_is_asked_for),
        cmocka_unit_test(a_ring_of_one_hex_is_cut_in_three),
        cmocka_unit_test(too_many_hexes_are_refused_with_their_number_before_a_map_is_made),
        cmocka_unit_test(progress_is_shown_while_a_map_is_made),
        cmocka_unit_test(as_many_hexes_as_may_be_are_made),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
