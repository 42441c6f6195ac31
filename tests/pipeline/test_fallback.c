/* No job ends without a mesh: where the map that was asked for is not found, a larger quantization, a positive one or the guaranteed route answers, and the report says
 * which, why, and what it cost in hexes. A limit of work makes the quality route fail where it would not. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdio.h>
#include <string.h>

#include "blockwright.h"
#include "models/models.h"

static json_t *run(const char *input, const char *size, int work) {
    bw_context ctx;
    bw_options options;
    char json[200];
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    snprintf(json, sizeof json, "{\"quantize\": \"any\", %s, \"max_map_work\": %d, \"until\": \"extract\", \"smooth\": \"off\"}", size, work);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("out")));
    assert_int_equal(ctx.memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("out/report.json"), 0, NULL);
    assert_non_null(report);
    return report;
}

static json_t *member(const json_t *report, const char *section, const char *name) {
    json_t *value = json_object_get(json_object_get(report, section), name);
    if (!value) fail_msg("the report has no %s.%s", section, name);
    return value;
}

static const char *text(const json_t *report, const char *name) { return json_string_value(member(report, "reparametrize", name)); }
static long long count(const json_t *report, const char *section, const char *name) { return json_integer_value(member(report, section, name)); }

static bool is(const json_t *report, const char *route, const char *requantized) {
    return !strcmp(text(report, "route"), route) && !strcmp(text(report, "requantized"), requantized);
}

/* The mesh that was made is the one that the report accounts for, and the costs are told step by step. */
static void expect_account(const json_t *report) {
    char cost[100];
    long long hexes = count(report, "reparametrize", "hexes");
    assert_int_equal(hexes, count(report, "quantization", "hexes"));
    assert_int_equal(hexes, count(report, "extract", "promised"));
    assert_int_equal(hexes, count(report, "extract", "hexes"));
    assert_true(hexes > count(report, "reparametrize", "hexes_asked"));
    snprintf(cost, sizeof cost, "%s lengths instead: %lld hexes, not ", text(report, "requantized"), hexes);
    if (!strstr(text(report, "reason"), cost)) fail_msg("\"%s\" is not in: %s", cost, text(report, "reason"));
    assert_non_null(strstr(text(report, "reason"), "at the limit of work"));
}

/* One limit lets the map of the larger quantization pass, and not that of the coarsest. */
static void a_larger_quantization_has_a_map(void **state) {
    (void)state;
    bool seen = false;
    for (int work = 10; work <= 40 && !seen; work++) {
        json_t *report = run(kit_shared("data/tet/hm_n02c_skijump_anti_box_cyl.hexex"), "\"scale\": 0", work);
        seen = is(report, "quality", "larger");
        if (seen) {
            expect_account(report);
            assert_true(json_is_false(member(report, "reparametrize", "limited")));
            assert_string_equal(json_string_value(member(report, "extract", "from")), "map");
        }
        json_decref(report);
    }
    assert_true(seen);
}

static void a_larger_quantization_that_is_positive_is_filled_by_blocks(void **state) {
    (void)state;
    json_t *report = run(kit_shared("data/tet/mm2017_ECM_femur_shell0.hexex"), "\"scale\": 0", 1);
    assert_true(is(report, "guaranteed", "larger"));
    expect_account(report);
    assert_string_equal(json_string_value(member(report, "extract", "from")), "blocks");
    json_decref(report);
}

static void positive_lengths_are_taken_where_no_map_is_found(void **state) {
    (void)state;
    json_t *report = run(kit_shared("data/tet/hm_s07c_notch.hexex"), "\"scale\": 0", 1);
    assert_true(is(report, "guaranteed", "positive"));
    expect_account(report);
    assert_non_null(strstr(text(report, "reason"), "larger lengths instead"));
    assert_int_equal(count(report, "quantization", "zero_arcs"), 0);
    json_decref(report);
}

static void lengths_that_are_positive_cost_no_hexes(void **state) {
    (void)state;
    bw_context ctx;
    bw_model model;
    bw_model_options options;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5;
    kit_expect_ok(&ctx, bw_model_make(&ctx, "tee", &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, kit_temp_path("tee.hexex")));
    bw_model_clear(&ctx, &model);
    json_t *report = run(kit_temp_path("tee.hexex"), "\"scale\": 0", 1);
    assert_true(is(report, "guaranteed", "none"));
    assert_int_equal(count(report, "reparametrize", "hexes"), count(report, "reparametrize", "hexes_asked"));
    long long n = count(report, "extract", "subdivide"); /* a hex mesh of them would not be simple */
    assert_int_equal(count(report, "extract", "hexes"), n * n * n * count(report, "reparametrize", "hexes"));
    assert_true(json_is_true(member(report, "reparametrize", "limited")));
    assert_true(json_number_value(member(report, "reparametrize", "work")) < 2);
    json_decref(report);
    report = run(kit_temp_path("tee.hexex"), "\"scale\": 0", 400);
    assert_true(is(report, "quality", "none"));
    assert_string_equal(text(report, "reason"), "");
    json_decref(report);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_larger_quantization_has_a_map),
    cmocka_unit_test(a_larger_quantization_that_is_positive_is_filled_by_blocks),
    cmocka_unit_test(positive_lengths_are_taken_where_no_map_is_found),
    cmocka_unit_test(lengths_that_are_positive_cost_no_hexes),
};
KIT_MAIN(tests)
