/* api/openapi.yaml and the core must say the same: stages and their versions, failures, defaults and ranges of options. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "blockwright.h"
#include "bw_api.h"
#include "server/joboptions.h"
#include "server/http/routes.h"

static void stages_have_the_names_order_and_versions_of_the_core(void **state) {
    (void)state;
    assert_int_equal(BW_API_STAGE_COUNT, BW_STAGE_COUNT);
    for (int i = 0; i < BW_STAGE_COUNT; i++) {
        assert_string_equal(bw_api_stages[i].name, bw_stage_name((bw_stage)i));
        assert_int_equal(bw_api_stages[i].version, bw_stage_version((bw_stage)i));
    }
}

static void every_status_of_the_core_is_a_problem_type_that_says_the_same(void **state) {
    (void)state;
    for (int s = 0; s < BW_STATUS_COUNT; s++) {
        int hits = 0;
        for (int p = 0; p < BW_PROBLEM_COUNT; p++) {
            const bw_problem_type *t = &bw_problem_types[p];
            if (strcmp(t->code, bw_status_code((bw_status)s)) != 0) continue;
            hits++;
            assert_string_equal(t->title, bw_status_text((bw_status)s));
            assert_string_equal(t->failure_class, bw_class_name(bw_status_class((bw_status)s)));
            assert_int_equal(t->http, bw_status_http((bw_status)s));
        }
        assert_int_equal(hits, s == BW_OK ? 0 : 1);
    }
}

static void problem_types_are_well_formed(void **state) {
    (void)state;
    for (int p = 0; p < BW_PROBLEM_COUNT; p++) {
        const bw_problem_type *t = &bw_problem_types[p];
        assert_true(t->http >= 400 && t->http < 600);
        assert_true(strncmp(t->type, "/problems/", 10) == 0 && strcmp(t->type + 10, t->code) == 0);
    }
}

/* Reads the option's JSON the way a worker does. */
static bw_status core_takes(const char *json, bw_options *options) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_options_defaults(options);
    return bw_options_from_json(&ctx, options, json, strlen(json));
}

static void defaults_of_options_are_those_of_the_core(void **state) {
    (void)state;
    char detail[200];
    json_t *all;
    bw_options stated, plain;
    assert_true(bw_joboptions_check(NULL, &all, detail, sizeof detail));
    char *text = json_dumps(all, JSON_REAL_PRECISION(17));
    bw_options_defaults(&plain);
    assert_int_equal(core_takes(text, &stated), BW_OK);
    assert_int_equal(stated.complex, plain.complex);
    assert_int_equal(stated.until, plain.until);
    assert_true(stated.tolerance == plain.tolerance);
    assert_true(stated.max_cells == plain.max_cells);
    assert_int_equal(stated.hex_formats, plain.hex_formats);
    assert_int_equal(stated.bwh_bits, plain.bwh_bits);
    free(text);
    json_decref(all);
}

static void what_the_daemon_accepts_the_core_accepts(void **state) {
    (void)state;
    const char *values[] = {"-1", "0", "1e-300", "0.0001", "0.0999", "0.1", "0.5", "1", "2", "2000000000", "2000000001", "1.5",
                            "\"mc\"", "\"bc\"", "\"encode\"", "\"trace\"", "\"\"", "true", "null", "[]", "1e400",
                            "[\"cgns\",\"mesh\",\"vtk\",\"vtu\",\"msh\",\"ovm\",\"inp\",\"bwh\"]", "[\"\"]"};
    int accepted = 0;
    for (int o = 0; o < BW_API_OPTION_COUNT; o++)
        for (size_t v = 0; v < sizeof values / sizeof *values; v++) {
            char json[100], detail[200];
            bw_options options;
            json_t *all;
            snprintf(json, sizeof json, "{\"%s\":%s}", bw_api_options[o].name, values[v]);
            json_t *given = json_loads(json, 0, NULL);
            if (!given || !bw_joboptions_check(given, &all, detail, sizeof detail)) {
                json_decref(given);
                continue;
            }
            char *text = json_dumps(all, JSON_REAL_PRECISION(17));
            if (core_takes(text, &options) != BW_OK) fail_msg("the core refuses %s", text);
            accepted++;
            free(text);
            json_decref(all);
            json_decref(given);
        }
    assert_true(accepted >= 10);
}

static void every_operation_has_a_handler(void **state) {
    (void)state;
    for (int i = 0; i < BW_OP_COUNT; i++) assert_non_null(bw_routes[i].handle);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stages_have_the_names_order_and_versions_of_the_core),
        cmocka_unit_test(every_status_of_the_core_is_a_problem_type_that_says_the_same),
        cmocka_unit_test(problem_types_are_well_formed),
        cmocka_unit_test(defaults_of_options_are_those_of_the_core),
        cmocka_unit_test(what_the_daemon_accepts_the_core_accepts),
        cmocka_unit_test(every_operation_has_a_handler),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
