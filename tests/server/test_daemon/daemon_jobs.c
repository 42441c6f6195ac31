/* A job's way through the daemon: accepted, run stage by stage, results served, work shared between jobs. */
#include <stdio.h>
#include <string.h>

#include "daemon_kit.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, NULL);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static void a_job_runs_all_stages_and_its_results_are_the_workers_bytes(void **state) {
    (void)state;
    char id[32], hash[BW_SHA256_TEXT];
    size_t i;
    json_t *item;
    kit_submit(&d, "* log hello\nencode bytes 5000\n", NULL, id);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 4);
    assert_true(json_number_value(json_object_get(job, "progress")) == 1);
    json_decref(job);
    kit_reply r = kit_get(&d, "/v1/jobs/%s/results", id);
    assert_int_equal(r.status, 200);
    json_t *results = kit_json(&r), *list = json_object_get(results, "results");
    assert_int_equal(json_array_size(list), 3);
    json_array_foreach(list, i, item) {
        kit_reply file = kit_get(&d, "%s", kit_text(item, "href"));
        assert_int_equal(file.status, 200);
        assert_int_equal(file.size, json_integer_value(json_object_get(item, "bytes")));
        assert_string_equal(file.type, kit_text(item, "media_type"));
        kit_hash(file.body, file.size, hash);
        assert_string_equal(hash, kit_text(item, "sha256"));
        kit_free(&file);
    }
    json_decref(results);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_job_runs_all_stages_and_its_results_are_the_workers_bytes),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
