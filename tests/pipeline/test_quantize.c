/* Integer lengths as a user gets them: blocks.json and report.json say the same, and what is asked for is what is done. */
#include "kit/kit.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "models/models.h"

static const char *sample(const char *name) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.5;
    bw_model model;
    const char *path = kit_temp_path("%s.hexex", name);
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

typedef struct {
    json_t *report, *blocks;
    const json_t *found; /* report.quantization */
} outcome;

static outcome run(const char *input, const char *options_json) {
    bw_context ctx;
    bw_options options;
    outcome o;
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, options_json, strlen(options_json)));
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("out")));
    assert_int_equal(ctx.memory.used, 0);
    o.report = json_load_file(kit_temp_path("out/report.json"), 0, NULL);
    o.blocks = json_load_file(kit_temp_path("out/blocks.json"), 0, NULL);
    assert_true(o.report && o.blocks);
    o.found = json_object_get(o.report, "quantization");
    return o;
}

static void outcome_clear(outcome *o) {
    json_decref(o->report);
    json_decref(o->blocks);
}

static double number(const json_t *object, const char *key) {
    assert_true(json_is_number(json_object_get(object, key)));
    return json_number_value(json_object_get(object, key));
}

/* Sum of the integer lengths of a chain; arcs that are walked backwards are -1 - arc. */
static int64_t chain_length(const outcome *o, const json_t *chain) {
    const json_t *arcs = json_object_get(o->blocks, "arcs");
    int64_t sum = 0;
    for (size_t i = 0; i < json_array_size(chain); i++) {
        json_int_t use = json_integer_value(json_array_get(chain, i));
        const json_t *length = json_object_get(json_array_get(arcs, (size_t)(use < 0 ? -1 - use : use)), "quantized");
        assert_true(json_is_integer(length));
        sum += json_integer_value(length);
    }
    return sum;
}

/* What the report says follows from the lengths in blocks.json, and these fit together. */
static void expect_consistent(const outcome *o) {
    size_t i;
    json_t *item;
    int64_t hexes = 0;
    double objective = 0, scale = number(o->found, "scale");
    json_array_foreach(json_object_get(o->blocks, "patches"), i, item) {
        const json_t *chains = json_object_get(item, "chains");
        for (size_t side = 0; side < 2; side++)
            assert_int_equal(chain_length(o, json_array_get(chains, side)), chain_length(o, json_array_get(chains, side + 2)));
    }
    json_array_foreach(json_object_get(o->blocks, "blocks"), i, item) {
        const json_t *extent = json_object_get(item, "hexes"), *edges = json_object_get(item, "edges");
        int64_t volume = 1;
        for (size_t e = 0; e < 12; e++)
            assert_int_equal(chain_length(o, json_array_get(edges, e)), json_integer_value(json_array_get(extent, e / 4)));
        for (size_t k = 0; k < 3; k++) volume *= json_integer_value(json_array_get(extent, k));
        hexes += volume;
    }
    json_array_foreach(json_object_get(o->blocks, "arcs"), i, item) {
        double away = number(item, "quantized") - scale * number(item, "length");
        assert_true(number(item, "quantized") >= 1 || strcmp(json_string_value(json_object_get(o->found, "range")), "positive"));
        objective += away * away;
    }
    assert_int_equal(hexes, (int64_t)number(o->found, "hexes"));
    assert_true(fabs(objective - number(o->found, "objective")) < 1e-6 * (1 + objective));
    assert_true(number(o->found, "bound") <= number(o->found, "objective"));
}

static void lengths_in_blocks_json_are_what_the_report_says(void **state) {
    (void)state;
    static const char *const names[] = {"cuboid", "part", "ball", "torus-quarter", "bearing", "tee"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        for (size_t k = 0; k < 4; k++) {
            static const char *const ranges[] = {"positive", "nonnegative", "any", "positive"};
            char json[100];
            snprintf(json, sizeof json, "{\"quantize\": \"%s\", \"scale\": %g}", ranges[k], k == 3 ? 2.5 : 0);
            outcome o = run(sample(names[i]), json);
            expect_consistent(&o);
            assert_string_equal(json_string_value(json_object_get(o.found, "status")), "optimal");
            assert_true(json_is_true(json_object_get(o.found, "verified")));
            outcome_clear(&o);
        }
}

static void without_a_request_there_are_no_lengths(void **state) {
    (void)state;
    outcome o = run(sample("part"), "{}");
    assert_null(o.found);
    assert_null(json_object_get(json_array_get(json_object_get(o.blocks, "arcs"), 0), "quantized"));
    assert_null(json_object_get(json_array_get(json_object_get(o.blocks, "blocks"), 0), "hexes"));
    outcome_clear(&o);
}

static void a_number_of_hexes_is_come_near_to(void **state) {
    (void)state;
    static const int targets[] = {50, 400, 3000, 100000};
    for (size_t i = 0; i < sizeof targets / sizeof *targets; i++) {
        char json[100];
        snprintf(json, sizeof json, "{\"quantize\": \"positive\", \"target_hexes\": %d}", targets[i]);
        outcome o = run(sample("part"), json);
        expect_consistent(&o);
        double miss = fabs(number(o.found, "hexes") - targets[i]) / targets[i];
        assert_int_equal(json_is_true(json_object_get(o.found, "target_met")), miss <= 0.05);
        if (targets[i] >= 400 && miss > 0.05) fail_msg("%d hexes asked for, %g found", targets[i], number(o.found, "hexes"));
        outcome_clear(&o);
    }
}

static void a_list_of_scales_gives_a_table(void **state) {
    (void)state;
    outcome o = run(sample("bearing"), "{\"quantize\": \"positive\", \"scales\": [0, 0.5, 1, 2, 4], \"scale\": 2}");
    const json_t *sweep = json_object_get(o.found, "sweep");
    assert_int_equal(json_array_size(sweep), 5);
    for (size_t i = 1; i < 5; i++) {
        assert_true(number(json_array_get(sweep, i), "hexes") >= number(json_array_get(sweep, i - 1), "hexes"));
        assert_true(number(json_array_get(sweep, i), "scale") == ldexp(1, (int)i - 2));
    }
    size_t size, circles = 0; /* four charts of five points; at scale 0 there is no distortion */
    char *svg = kit_read_file(kit_temp_path("out/sizes.svg"), &size);
    for (const char *at = svg; (at = strstr(at, "class=\"full\"")); at++) circles++;
    assert_int_equal(circles, 19);
    free(svg);
    const json_t *same = json_array_get(sweep, 3);
    assert_true(fabs(number(same, "objective") - number(o.found, "objective")) < 1e-9);
    outcome_clear(&o);
}

static void fewest_hexes_are_no_more_than_those_of_the_coarsest(void **state) {
    (void)state;
    static const char *const names[] = {"part", "bearing", "tee"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        outcome fewest = run(sample(names[i]), "{\"quantize\": \"positive\", \"fewest_hexes\": true}");
        double hexes = number(fewest.found, "hexes");
        assert_true(hexes == number(fewest.found, "objective") && hexes == number(fewest.found, "bound"));
        assert_string_equal(json_string_value(json_object_get(fewest.found, "goal")), "hexes");
        outcome_clear(&fewest);
        outcome coarsest = run(sample(names[i]), "{\"quantize\": \"positive\", \"scale\": 0}");
        assert_true(hexes <= number(coarsest.found, "hexes"));
        outcome_clear(&coarsest);
    }
}

static void a_search_without_time_says_so(void **state) {
    (void)state;
    outcome o = run(sample("bearing"), "{\"quantize\": \"positive\", \"time_limit\": 0, \"scale\": 0.37}");
    expect_consistent(&o);
    const char *status = json_string_value(json_object_get(o.found, "status"));
    double gap = number(o.found, "gap");
    assert_true(!strcmp(status, "heuristic") || (!strcmp(status, "optimal") && gap == 0));
    outcome_clear(&o);
}

static void rounding_is_compared_where_that_is_asked_for(void **state) {
    (void)state;
    static const char *const names[] = {"part", "cylinder", "hollow-torus"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        for (int coarse = 0; coarse < 2; coarse++) {
            char json[100];
            snprintf(json, sizeof json, "{\"quantize\": \"%s\", \"scale\": %d, \"rounding\": true}", i ? "any" : "positive", coarse ? 0 : 12);
            outcome o = run(sample(names[i]), json);
            const json_t *r = json_object_get(o.found, "rounding");
            assert_true(json_is_object(r));
            double kinds = number(r, "negative_blocks") + number(r, "links") + number(r, "separations") + number(r, "loops");
            assert_true(kinds == number(r, "conflicts"));
            assert_int_equal(json_is_true(json_object_get(r, "valid")), !coarse);
            assert_int_equal(number(r, "conflicts") > 0, coarse);
            assert_true(number(r, "integers") > 0 && number(r, "integers") <= number(o.found, "free_integers"));
            assert_true(json_is_true(json_object_get(r, "coarsest_valid")));
            if (coarse && i) assert_true(number(r, "coarsest_hexes") >= number(o.found, "hexes"));
            if (!coarse && i) assert_true(number(r, "objective") >= number(o.found, "bound") - 1e-6);
            outcome_clear(&o);
        }
    outcome without = run(sample("part"), "{\"quantize\": \"any\"}");
    assert_null(json_object_get(without.found, "rounding"));
    outcome_clear(&without);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lengths_in_blocks_json_are_what_the_report_says),
        cmocka_unit_test(without_a_request_there_are_no_lengths),
        cmocka_unit_test(a_number_of_hexes_is_come_near_to),
        cmocka_unit_test(a_list_of_scales_gives_a_table),
        cmocka_unit_test(fewest_hexes_are_no_more_than_those_of_the_coarsest),
        cmocka_unit_test(a_search_without_time_says_so),
        cmocka_unit_test(rounding_is_compared_where_that_is_asked_for),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
