/* Job options: one canonical form, and cache keys that depend on exactly what they should. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "server/joboptions.h"

static const char a[] = "00000000000000000000000000000000000000000000000000000000000000aa";
static const char b[] = "00000000000000000000000000000000000000000000000000000000000000bb";

static json_t *check(const char *text) {
    char detail[200];
    json_t *given = json_loads(text, 0, NULL), *all = NULL;
    if (!bw_joboptions_check(given, &all, detail, sizeof detail)) all = NULL;
    json_decref(given);
    return all;
}

static void key_of(const char *input, const char *parameters, const char *options, int stage, char out[BW_SHA256_TEXT]) {
    json_t *all = check(options);
    assert_non_null(all);
    assert_true(bw_cache_key(input, parameters, all, stage, "", out));
    json_decref(all);
}

static void the_owner_of_an_output_is_part_of_its_key(void **state) {
    (void)state;
    char shared[BW_SHA256_TEXT], mine[BW_SHA256_TEXT], his[BW_SHA256_TEXT];
    json_t *all = check("{}");
    assert_non_null(all);
    assert_true(bw_cache_key(a, "", all, 3, "", shared) && bw_cache_key(a, "", all, 3, "job1", mine) && bw_cache_key(a, "", all, 3, "job2", his));
    assert_string_not_equal(shared, mine);
    assert_string_not_equal(shared, his);
    assert_string_not_equal(mine, his);
    json_decref(all);
}

static void key(const char *input, const char *options, int stage, char out[BW_SHA256_TEXT]) {
    key_of(input, "", options, stage, out);
}

static bool same_key(const char *one, const char *other, int stage) {
    char x[BW_SHA256_TEXT], y[BW_SHA256_TEXT];
    key(a, one, stage, x);
    key(a, other, stage, y);
    return strcmp(x, y) == 0;
}

static void equal_requests_have_equal_forms(void **state) {
    (void)state;
    const char *same[][2] = {{"{}", "{\"complex\":\"mc\"}"},
                             {"{\"kind\":\"auto\"}", "{}"},
                             {"{\"repair\":false}", "{}"},
                             {"{\"rounding\":false}", "{}"},
                             {"{\"tolerance\":0}", "{\"tolerance\":0.0}"},
                             {"{\"hex_formats\":[\"bwh\",\"vtu\",\"mesh\",\"vtu\"]}", "{}"},
                             {"{\"complex\":\"bc\",\"max_cells\":7}", "{\"max_cells\":7,\"complex\":\"bc\"}"}};
    for (size_t i = 0; i < sizeof same / sizeof *same; i++) {
        json_t *x = check(same[i][0]), *y = check(same[i][1]);
        assert_true(json_equal(x, y));
        assert_int_equal(json_object_size(x), BW_API_OPTION_COUNT);
        json_decref(x);
        json_decref(y);
    }
}

static void a_refusal_names_the_option_and_what_it_may_be(void **state) {
    (void)state;
    const char *cases[][2] = {{"{\"kind\":\"quad\"}", "option kind must be one of auto, tet, hex"},
                              {"{\"complex\":\"x\"}", "option complex must be one of mc, bc, serial"},
                              {"{\"max_cells\":0}", "option max_cells must be an integer at least 1 and at most 2000000000"},
                              {"{\"tolerance\":1}", "option tolerance must be a number at least 0 and less than 0.1"},
                              {"{\"repair\":\"yes\"}", "option repair must be true or false"},
                              {"{\"rounding\":1}", "option rounding must be true or false"},
                              {"{\"hex_formats\":[\"vtu\",\"stl\"]}",
                               "option hex_formats must be a list of up to 8 names, each one of mesh, vtk, vtu, msh, ovm, inp, cgns, bwh"},
                              {"{\"hex_formats\":\"vtu\"}",
                               "option hex_formats must be a list of up to 8 names, each one of mesh, vtk, vtu, msh, ovm, inp, cgns, bwh"},
                              {"{\"colour\":1}", "there is no option 'colour'"},
                              {"[]", "options must be an object"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char detail[200];
        json_t *given = json_loads(cases[i][0], 0, NULL), *all;
        assert_false(bw_joboptions_check(given, &all, detail, sizeof detail));
        assert_string_equal(detail, cases[i][1]);
        for (size_t room = 1; room < 60; room++) assert_false(bw_joboptions_check(given, &all, detail, room));
        json_decref(given);
    }
}

static void keys_differ_by_input_stage_and_the_options_of_this_and_earlier_stages(void **state) {
    (void)state;
    char x[BW_SHA256_TEXT], y[BW_SHA256_TEXT];
    for (int s = 0; s < BW_API_STAGE_COUNT; s++) {
        key(a, "{}", s, x);
        key(b, "{}", s, y);
        assert_string_not_equal(x, y);
        for (int other = 0; other < s; other++) {
            key(a, "{}", other, y);
            assert_string_not_equal(x, y);
        }
        assert_false(same_key("{}", "{\"tolerance\":0.01}", s));              /* sanitize is the first stage */
        assert_int_equal(same_key("{}", "{\"complex\":\"bc\"}", s), s < 1);   /* trace is the second */
        assert_int_equal(same_key("{}", "{\"max_cells\":9}", s), s < 1);
        assert_true(same_key("{}", "{\"until\":\"sanitize\"}", s));           /* where to stop changes no output */
    }
}

static void a_file_of_parameters_changes_every_key(void **state) {
    (void)state;
    const char *files[][2] = {{a, ""}, {a, a}, {a, b}, {b, a}, {b, ""}};
    enum { FILES = sizeof files / sizeof *files };
    for (int s = 0; s < BW_API_STAGE_COUNT; s++) {
        char keys[FILES][BW_SHA256_TEXT];
        for (int i = 0; i < FILES; i++) {
            key_of(files[i][0], files[i][1], "{}", s, keys[i]);
            for (int other = 0; other < i; other++) assert_string_not_equal(keys[i], keys[other]);
        }
    }
}

static void stages_to_run_follow_until(void **state) {
    (void)state;
    for (int s = 0; s < BW_API_STAGE_COUNT; s++) {
        char text[60];
        snprintf(text, sizeof text, "{\"until\":\"%s\"}", bw_api_stages[s].name);
        json_t *all = check(text);
        assert_int_equal(bw_joboptions_stages(all), s + 1);
        json_decref(all);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_owner_of_an_output_is_part_of_its_key),
        cmocka_unit_test(equal_requests_have_equal_forms),
        cmocka_unit_test(a_refusal_names_the_option_and_what_it_may_be),
        cmocka_unit_test(keys_differ_by_input_stage_and_the_options_of_this_and_earlier_stages),
        cmocka_unit_test(a_file_of_parameters_changes_every_key),
        cmocka_unit_test(stages_to_run_follow_until),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
