/* A job's way through the daemon: accepted, run stage by stage, results served, work shared between jobs. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bw_api.h"
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
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), BW_API_STAGE_COUNT);
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

static void a_file_of_parameters_reaches_the_first_stage_only(void **state) {
    (void)state;
    char id[32], hash[BW_SHA256_TEXT];
    for (int i = 0; i < 2; i++) { /* the same input, another file */
        const char *side = i ? "# two\n" : "# one\n";
        kit_submit_both(&d, "* log both\n", side, NULL, id);
        json_t *job = kit_wait(&d, id, 20), *attempt;
        assert_string_equal(kit_text(job, "state"), "successful");
        kit_hash(side, strlen(side), hash);
        assert_string_equal(kit_text(job, "parameters"), hash);
        size_t k;
        json_array_foreach(json_object_get(job, "attempts"), k, attempt)
            assert_true(json_is_false(json_object_get(attempt, "reused")));
        json_decref(job);
        kit_reply r = kit_get(&d, "/v1/jobs/%s/results/script.txt", id);
        assert_int_equal(r.status, 200);
        assert_memory_equal(r.body, side, strlen(side));
        assert_memory_equal(r.body + strlen(side), "* log both\n# sanitize\n", 22); /* once, not by every stage again */
        kit_free(&r);
    }
}

/* How many attempts of the job found their stage in the cache. */
static size_t reused(const json_t *job) {
    size_t i, n = 0;
    json_t *attempt;
    json_array_foreach(json_object_get(job, "attempts"), i, attempt)
        n += json_is_true(json_object_get(attempt, "reused"));
    return n;
}

static void a_second_equal_job_reuses_every_stage(void **state) {
    (void)state;
    char first[32], second[32];
    kit_submit(&d, "encode bytes 77\n", NULL, first);
    json_decref(kit_wait(&d, first, 20));
    kit_submit(&d, "encode bytes 77\n", "{\"complex\":\"mc\"}", second); /* the default, said aloud */
    json_t *job = kit_wait(&d, second, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(reused(job), BW_API_STAGE_COUNT);
    json_decref(job);
    kit_reply a = kit_get(&d, "/v1/jobs/%s/results/data.bin", first);
    kit_reply b = kit_get(&d, "/v1/jobs/%s/results/data.bin", second);
    assert_int_equal(a.size, 77);
    assert_int_equal(b.size, 77);
    assert_memory_equal(a.body, b.body, 77);
    kit_free(&a);
    kit_free(&b);
}

static void a_job_reuses_the_stages_before_the_first_one_its_options_change(void **state) {
    (void)state;
    const char *script = "# options\n";
    const struct {
        const char *options;
        size_t stages, reused;
    } cases[] = {{"{\"until\":\"trace\"}", 2, 0},          {"{}", BW_API_STAGE_COUNT, 2},
                 {"{\"complex\":\"bc\"}", BW_API_STAGE_COUNT, 1},             {"{\"max_cells\":5}", BW_API_STAGE_COUNT, 1},
                 {"{\"tolerance\":0.05}", BW_API_STAGE_COUNT, 0},              {"{\"tolerance\":0.05,\"complex\":\"bc\"}", BW_API_STAGE_COUNT, 1},
                 {"{\"reduce\":\"full\"}", BW_API_STAGE_COUNT, 3},
                 {"{\"until\":\"build\",\"max_cells\":5}", 3, 3}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char id[32];
        kit_submit(&d, script, cases[i].options, id);
        json_t *job = kit_wait(&d, id, 20);
        assert_string_equal(kit_text(job, "state"), "successful");
        assert_int_equal(json_array_size(json_object_get(job, "attempts")), cases[i].stages);
        assert_int_equal(reused(job), cases[i].reused);
        json_decref(job);
    }
}

static void expect_kind(const char *script, const char *options, const char *state, const char *kind) {
    char id[32];
    kit_submit(&d, script, options, id);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), state);
    assert_string_equal(kit_text(job, "kind"), kind);
    json_decref(job);
}

static void a_job_tells_what_kind_its_input_was_found_to_be(void **state) {
    (void)state;
    expect_kind("sanitize kind hex\n", "{\"until\":\"sanitize\"}", "successful", "hex");
    expect_kind("sanitize kind hex\n", "{\"until\":\"sanitize\"}", "successful", "hex"); /* no worker told it, the cache did */
    expect_kind("sanitize kind hex\n", "{\"until\":\"trace\"}", "successful", "hex"); /* and nobody says otherwise */
    expect_kind("sanitize kind tet\ntrace fail check-failed\n", NULL, "failed", "tet");
    expect_kind("sanitize kind tet\nsanitize fail inverted\n", NULL, "failed", ""); /* it is told with what was made */
    expect_kind("sanitize kind octahedral\n", NULL, "successful", "");
    expect_kind("# says nothing\n", NULL, "successful", "");
}

static void equal_jobs_at_the_same_time_make_each_output_once(void **state) {
    (void)state;
    char ids[6][32];
    size_t worked = 0;
    for (int i = 0; i < 6; i++) kit_submit(&d, "* sleep 20\n# together\n", NULL, ids[i]);
    for (int i = 0; i < 6; i++) {
        json_t *job = kit_wait(&d, ids[i], 20);
        assert_string_equal(kit_text(job, "state"), "successful");
        worked += BW_API_STAGE_COUNT - reused(job);
        json_decref(job);
    }
    assert_int_equal(worked, BW_API_STAGE_COUNT);
}

static void a_job_that_stops_early_has_no_results(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "# early\n", "{\"until\":\"build\"}", id);
    json_decref(kit_wait(&d, id, 20));
    kit_reply r = kit_get(&d, "/v1/jobs/%s/results", id);
    assert_int_equal(r.status, 200);
    json_t *results = kit_json(&r);
    assert_int_equal(json_array_size(json_object_get(results, "results")), 0);
    json_decref(results);
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/report", id), 404, "no-such-result");
}

static void the_log_has_what_the_workers_said_and_cannot_be_forged(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "build log first\rsecond\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_reply r = kit_get(&d, "/v1/jobs/%s/log", id);
    assert_string_equal(r.type, "text/plain; charset=utf-8");
    assert_non_null(strstr(r.body, " build#3 first second\n"));
    kit_free(&r);
}

static void a_running_job_tells_stage_and_progress(void **state) {
    (void)state;
    char id[32];
    double one = 1.0 / BW_API_STAGE_COUNT, begun = 1.02 * one; /* stages count alike; trace is the second */
    double progress = 0;
    kit_submit(&d, "trace sleep 400\n", NULL, id);
    for (int i = 0; i < 300 && progress <= begun; i++, kit_sleep_ms(5)) {
        json_t *job = kit_job(&d, id);
        progress = json_number_value(json_object_get(job, "progress"));
        if (progress > begun) {
            assert_string_equal(kit_text(job, "state"), "running");
            assert_string_equal(kit_text(job, "stage"), "trace");
        }
        json_decref(job);
    }
    assert_true(progress > begun && progress <= 2 * one);
    json_decref(kit_wait(&d, id, 20));
}

static void a_stopped_daemon_goes_on_where_it_was(void **state) {
    (void)state;
    char ids[5][32], script[60];
    for (int i = 0; i < 5; i++) {
        snprintf(script, sizeof script, "trace sleep 100\n# stop %d\n", i);
        kit_submit(&d, script, NULL, ids[i]);
    }
    kit_wait_state(&d, ids[0], "running", 10);
    assert_int_equal(kit_stop(&d), 0);
    kit_restart(&d, NULL);
    for (int i = 0; i < 5; i++) {
        json_t *job = kit_wait(&d, ids[i], 20);
        assert_string_equal(kit_text(job, "state"), "successful");
        json_decref(job);
    }
}

/* Cache files without rows are deleted at the start, rows without files forgotten: both kinds of job still succeed. */
static void a_damaged_cache_is_put_right_at_the_start(void **state) {
    (void)state;
    char id[32], command[400];
    kit_submit(&d, "# cache\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_stop(&d);
    snprintf(command, sizeof command, "rm -r %s/cache/* && mkdir %s/cache/00 && touch %s/cache/00/%064d", d.data, d.data,
             d.data, 0);
    assert_int_equal(system(command), 0);
    kit_restart(&d, NULL);
    snprintf(command, sizeof command, "test ! -e %s/cache/00/%064d", d.data, 0);
    assert_int_equal(system(command), 0);
    kit_submit(&d, "# cache\n", NULL, id);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(reused(job), 0);
    json_decref(job);
}

static int open_descriptors(void) {
    char command[100];
    int n = 0;
    snprintf(command, sizeof command, "ls /proc/%d/fd | wc -l", (int)d.pid);
    FILE *f = popen(command, "r");
    assert_non_null(f);
    assert_int_equal(fscanf(f, "%d", &n), 1);
    pclose(f);
    return n;
}

static void no_descriptor_is_leaked(void **state) {
    (void)state;
    int least = 1 << 20, now = 0;
    for (int round = 0; round < 6; round++) {
        char id[32], script[60];
        for (int i = 0; i < 5; i++) {
            snprintf(script, sizeof script, "%s\n# leak %d %d\n", i % 2 ? "trace fail inverted" : "", round, i);
            kit_submit(&d, script, NULL, id);
            json_decref(kit_wait(&d, id, 20));
            kit_reply r = kit_get(&d, "/v1/jobs/%s/results/data.bin", id);
            kit_free(&r);
            r = kit_get(&d, "/v1/jobs/%s/log", id);
            kit_free(&r);
        }
        kit_sleep_ms(50); /* connections close */
        now = open_descriptors();
        if (now < least) least = now;
    }
    assert_true(now <= least + 4);
}

static void a_second_daemon_on_the_same_folder_is_refused(void **state) {
    (void)state;
    char command[300];
    snprintf(command, sizeof command, "%s/blockwrightd --data %s --listen 127.0.0.1:0 --worker /bin/true 2>/dev/null",
             BW_BIN_DIR, d.data);
    assert_int_not_equal(system(command), 0);
    kit_reply r = kit_get(&d, "/livez");
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

static void the_command_line_is_checked(void **state) {
    (void)state;
    const char *bad[] = {"", "--data /tmp/x --listen 0.0.0.0:80", "--data /tmp/x --listen 192.168.1.1:1",
                         "--data /tmp/x --listen [::]:1", "--data /tmp/x --listen 127.0.0.1", "--data /tmp/x --workers 0",
                         "--data /tmp/x --max-upload 1Q", "--data /tmp/x --worker /no/such", "--colour", "--data /no/such/x"};
    char command[300];
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(command, sizeof command, "%s/blockwrightd %s 2>/dev/null", BW_BIN_DIR, bad[i]);
        assert_int_equal(system(command) >> 8, 2);
    }
    snprintf(command, sizeof command, "%s/blockwrightd --help | grep -q curl", BW_BIN_DIR);
    assert_int_equal(system(command), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_job_runs_all_stages_and_its_results_are_the_workers_bytes),
        cmocka_unit_test(a_file_of_parameters_reaches_the_first_stage_only),
        cmocka_unit_test(a_second_equal_job_reuses_every_stage),
        cmocka_unit_test(a_job_reuses_the_stages_before_the_first_one_its_options_change),
        cmocka_unit_test(a_job_tells_what_kind_its_input_was_found_to_be),
        cmocka_unit_test(equal_jobs_at_the_same_time_make_each_output_once),
        cmocka_unit_test(a_job_that_stops_early_has_no_results),
        cmocka_unit_test(the_log_has_what_the_workers_said_and_cannot_be_forged),
        cmocka_unit_test(a_running_job_tells_stage_and_progress),
        cmocka_unit_test(a_stopped_daemon_goes_on_where_it_was),
        cmocka_unit_test(a_damaged_cache_is_put_right_at_the_start),
        cmocka_unit_test(no_descriptor_is_leaked),
        cmocka_unit_test(a_second_daemon_on_the_same_folder_is_refused),
        cmocka_unit_test(the_command_line_is_checked),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
