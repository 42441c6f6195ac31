/* /v1/capabilities promises nothing that POST /v1/jobs does not keep, and follows the settings. */
#include "daemon_kit.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bw_api.h"

static kit_daemon d;
static char input[BW_SHA256_TEXT];

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--max-upload", "3M", "--max-uploads", "5", "--owner-bytes", "2G", "--owner-running", "1", "--workers", "1",
                                              "--stage-memory", "1G", "--stage-wall-seconds", "77", NULL});
    kit_upload(&d, "sanitize sleep 1\n", input);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static json_t *capabilities(void) {
    kit_reply r = kit_get(&d, "/v1/capabilities");
    assert_int_equal(r.status, 200);
    return kit_json(&r);
}

/* Sends a job with this one option, whose value is given away. */
static void expect_option(const char *name, json_t *value, bool accepted) {
    json_t *job = json_pack("{s:s, s:{s:o}}", "input", input, "options", name, value);
    char *text = json_dumps(job, JSON_REAL_PRECISION(17));
    kit_reply r = kit_request(&d, "POST", "/v1/jobs", "Content-Type: application/json", text, strlen(text));
    if (r.status != (accepted ? 201 : 400)) fail_msg("%ld for %s: %s", r.status, text, r.body);
    kit_free(&r);
    free(text);
    json_decref(job);
}

static json_t *number(const json_t *schema, double value) {
    bool whole = strcmp(kit_text(schema, "type"), "integer") == 0;
    return whole ? json_integer((json_int_t)value) : json_real(value);
}

/* The bound holds, and beyond it (direction -1 or 1) nothing does. */
static void expect_bound(const char *name, const json_t *schema, const char *key, int direction) {
    const json_t *bound = json_object_get(schema, key);
    if (!bound) return;
    double at = json_number_value(bound);
    bool whole = strcmp(kit_text(schema, "type"), "integer") == 0;
    expect_option(name, number(schema, at), *key != 'e');
    expect_option(name, number(schema, at + direction * (whole ? 1 : at > 0 ? at * 1e-15 : 1e-300)), false);
}

/* As many items as there may be, and one more. */
static void expect_length(const char *name, const json_t *schema) {
    const json_t *items = json_object_get(schema, "items"), *most = json_object_get(schema, "maxItems");
    json_t *words = json_object_get(items, "enum"), *item = words ? json_array_get(words, 0) : json_object_get(items, "minimum");
    for (json_int_t more = 0; most && more < 2; more++) {
        json_t *list = json_array();
        for (json_int_t i = 0; i < json_integer_value(most) + more; i++) json_array_append_new(list, json_copy(item));
        expect_option(name, list, more == 0);
    }
}

static void options_have_the_defaults_and_bounds_that_it_tells(void **state) {
    (void)state;
    json_t *all = capabilities(), *options = json_object_get(all, "options"), *schema, *word;
    const char *name;
    size_t i;
    assert_int_equal(json_object_size(options), BW_API_OPTION_COUNT);
    json_object_foreach(options, name, schema) {
        expect_option(name, json_deep_copy(json_object_get(schema, "default")), true);
        json_array_foreach(json_object_get(schema, "enum"), i, word) expect_option(name, json_copy(word), true);
        if (json_object_get(schema, "enum")) expect_option(name, json_string("none of them"), false);
        expect_bound(name, schema, "minimum", -1);
        expect_bound(name, schema, "maximum", 1);
        expect_bound(name, schema, "exclusiveMaximum", 1);
        expect_length(name, schema);
    }
    json_decref(all);
}

static void stages_are_those_that_jobs_go_through(void **state) {
    (void)state;
    json_t *all = capabilities(), *stages = json_object_get(all, "stages"), *stage;
    size_t i;
    assert_int_equal(json_array_size(stages), BW_API_STAGE_COUNT);
    json_array_foreach(stages, i, stage) {
        assert_string_equal(kit_text(stage, "name"), bw_api_stages[i].name);
        assert_int_equal(json_integer_value(json_object_get(stage, "version")), bw_api_stages[i].version);
    }
    json_decref(all);
}

static void limits_are_those_that_were_set(void **state) {
    (void)state;
    json_t *all = capabilities(), *limits = json_object_get(all, "limits"), *worker = json_object_get(all, "worker");
    assert_int_equal(json_integer_value(json_object_get(limits, "upload_bytes")), 3 << 20);
    assert_int_equal(json_integer_value(json_object_get(limits, "uploads")), 5);
    assert_int_equal(json_integer_value(json_object_get(limits, "owner_bytes")), 2LL << 30);
    assert_int_equal(json_integer_value(json_object_get(limits, "owner_running")), 1);
    assert_true(json_is_null(json_object_get(limits, "owner_jobs")));
    assert_int_equal(json_integer_value(json_object_get(limits, "workers")), 1);
    assert_int_equal(json_integer_value(json_object_get(worker, "stage_memory")), 1 << 30);
    assert_int_equal(json_integer_value(json_object_get(worker, "stage_wall_seconds")), 77);
    kit_reply r = kit_get(&d, "/readyz");
    json_t *ready = kit_json(&r);
    assert_true(json_equal(worker, json_object_get(ready, "limits")));
    json_decref(ready);
    json_decref(all);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(options_have_the_defaults_and_bounds_that_it_tells),
        cmocka_unit_test(stages_are_those_that_jobs_go_through),
        cmocka_unit_test(limits_are_those_that_were_set),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
