/* How jobs end when they do not end well: each kind of end has its class, and only the system's own failures are retried. */
#include <dirent.h>
#include <signal.h>
#include <sqlite3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bw_api.h"
#include "daemon_kit.h"

static kit_daemon d;
/* Sanitizers need room of their own, so the address space test is for plain builds (readyz tells which this is). */
static const char *const limits[] = {"--stage-memory", "256M", "--stage-cpu-seconds", "1", "--stage-wall-seconds", "2",
                                     "--stage-output", "1M", "--workers", "4", NULL};

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, limits);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

/* Runs the script; expects the failure and how many attempts its last stage took. */
static void expect_failure(const char *script, const char *stage, const char *code, const char *class_, size_t attempts) {
    char id[32], type[80];
    size_t i, tried = 0;
    json_t *attempt;
    kit_submit(&d, script, NULL, id);
    json_t *job = kit_wait(&d, id, 40), *failure = json_object_get(job, "failure");
    assert_string_equal(kit_text(job, "state"), "failed");
    snprintf(type, sizeof type, "/problems/%s", code);
    assert_string_equal(kit_text(failure, "type"), type);
    assert_string_equal(kit_text(failure, "class"), class_);
    assert_string_equal(kit_text(failure, "stage"), stage);
    json_array_foreach(json_object_get(job, "attempts"), i, attempt) {
        if (strcmp(kit_text(attempt, "stage"), stage) != 0) continue;
        assert_string_equal(kit_text(attempt, "outcome"), code);
        tried++;
    }
    assert_int_equal(tried, attempts);
    json_decref(job);
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/results", id), 409, "not-successful");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/report", id), 409, "not-successful");
    kit_reply log = kit_get(&d, "/v1/jobs/%s/log", id);
    assert_true(log.status == 200 && strstr(log.body, code));
    kit_free(&log);
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_expect_problem(kit_request(&d, "POST", path, NULL, NULL, 0), 409, "job-finished");
}

static void an_input_failure_names_the_elements_at_fault(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "sanitize fail not-seamless\n", NULL, id);
    json_t *job = kit_wait(&d, id, 20), *failure = json_object_get(job, "failure");
    json_t *elements = json_object_get(failure, "elements");
    assert_int_equal(json_integer_value(json_object_get(failure, "element_count")), 40);
    assert_int_equal(json_array_size(elements), 2);
    assert_string_equal(kit_text(json_array_get(elements, 0), "kind"), "tet");
    assert_int_equal(json_integer_value(json_object_get(json_array_get(elements, 0), "id")), 7);
    assert_int_equal(json_array_size(json_object_get(json_array_get(elements, 0), "position")), 3);
    assert_int_equal(json_integer_value(json_object_get(failure, "status")), 422);
    assert_true(strlen(kit_text(failure, "detail")) > 0);
    json_t *regions = json_object_get(failure, "regions"), *region = json_array_get(regions, 0);
    assert_int_equal(json_integer_value(json_object_get(failure, "region_count")), 5);
    assert_int_equal(json_array_size(regions), 1); /* the other one has no position */
    assert_int_equal(json_object_size(region), 4);
    assert_int_equal(json_integer_value(json_object_get(region, "tets")), 3);
    assert_int_equal(json_array_size(json_object_get(region, "ids")), 2);
    assert_int_equal(json_array_size(json_object_get(region, "box")), 2);
    json_decref(job);
}

static void failures_of_input_algorithm_and_limit_are_final(void **state) {
    (void)state;
    expect_failure("sanitize fail inverted\n", "sanitize", "inverted", "input", 1);
    expect_failure("build fail check-failed\n", "build", "check-failed", "algorithm", 1);
    expect_failure("trace fail work-limit\n", "trace", "work-limit", "limit", 1);
}

static void failures_of_the_system_are_tried_three_times(void **state) {
    (void)state;
    expect_failure("trace fail io\n", "trace", "io", "system", 3);
    expect_failure("build exit 3\n", "build", "worker-died", "system", 3);
    expect_failure("encode raise 11\n", "encode", "worker-died", "system", 3);
    expect_failure("trace raise 9\n", "trace", "worker-died", "system", 3);
    expect_failure("trace garbage\n", "trace", "worker-protocol", "system", 3);
    expect_failure("trace nothing\n", "trace", "worker-protocol", "system", 3);
    expect_failure("* unconfined\ntrace link\n", "trace", "worker-protocol", "system", 3);
    expect_failure("trace fail no-such-code\n", "trace", "internal", "system", 3);
}

static void a_job_whose_worker_dies_twice_still_succeeds(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "trace flaky 4\n", NULL, id); /* attempts 2 and 3 die, 4 lives */
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), BW_API_STAGE_COUNT + 2);
    json_decref(job);
}

static void limits_end_a_stage_as_limit_failures(void **state) {
    (void)state;
    expect_failure("trace spin\n", "trace", "time-limit", "limit", 1);
    expect_failure("* deaf\ntrace sleep 60000\n", "trace", "time-limit", "limit", 1);
    expect_failure("trace fill 3000000\n", "trace", "output-limit", "limit", 1);
    kit_reply r = kit_get(&d, "/readyz");
    json_t *ready = kit_json(&r);
    if (json_is_true(json_object_get(json_object_get(ready, "limits"), "address_space")))
        expect_failure("trace allocate 2000000000\n", "trace", "memory-limit", "limit", 1);
    json_decref(ready);
}

static json_t *cancel(const char *id) {
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    return kit_json(&r);
}

static void a_running_job_is_cancelled_and_may_be_cancelled_again(void **state) {
    (void)state;
    const char *scripts[] = {"trace sleep 1500\n", "* deaf\n# killed by the wall clock or the grace period\ntrace sleep 1400\n"};
    for (size_t i = 0; i < 2; i++) {
        char id[32];
        kit_submit(&d, scripts[i], NULL, id);
        kit_wait_state(&d, id, "running", 10);
        json_decref(cancel(id));
        json_t *job = kit_wait(&d, id, 20);
        assert_string_equal(kit_text(job, "state"), "dismissed");
        json_decref(job);
        job = cancel(id);
        assert_string_equal(kit_text(job, "state"), "dismissed");
        json_decref(job);
    }
}

static void a_queued_job_is_dismissed_at_once_and_never_runs(void **state) {
    (void)state;
    char busy[4][32], id[32], script[64];
    for (int i = 0; i < 4; i++) {
        snprintf(script, sizeof script, "sanitize sleep 700\n# %d\n", i);
        kit_submit(&d, script, NULL, busy[i]);
    }
    for (int i = 0; i < 4; i++) kit_wait_state(&d, busy[i], "running", 10);
    kit_submit(&d, "# waits\n", NULL, id);
    json_t *job = cancel(id);
    assert_string_equal(kit_text(job, "state"), "dismissed");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 0);
    json_decref(job);
    for (int i = 0; i < 4; i++) json_decref(kit_wait(&d, busy[i], 20));
    job = kit_job(&d, id);
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 0);
    json_decref(job);
}

/* Entries of DATA/cache/xx/. */
static size_t cached(void) {
    size_t count = 0;
    for (int i = 0; i < 256; i++) {
        char path[100];
        snprintf(path, sizeof path, "%s/cache/%02x", d.data, i);
        DIR *folder = opendir(path);
        for (struct dirent *e; folder && (e = readdir(folder));) count += *e->d_name != '.';
        if (folder) closedir(folder);
    }
    return count;
}

static sqlite3 *lock_database(void) {
    char path[100];
    sqlite3 *db = NULL;
    snprintf(path, sizeof path, "%s/jobs.db", d.data);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    sqlite3_busy_timeout(db, 5000);
    assert_int_equal(sqlite3_exec(db, "BEGIN IMMEDIATE", NULL, NULL, NULL), SQLITE_OK);
    return db;
}

/* The database is held while the cancel is asked for, until the output has been filed: the cancel is written first, then the end of the
 * stage is refused. */
static void an_output_that_is_filed_and_then_not_booked_goes_again(void **state) {
    (void)state;
    char id[32], ask[200];
    size_t before = cached();
    kit_submit(&d, "sanitize sleep 800\n# filed, not booked\n", NULL, id);
    kit_wait_state(&d, id, "running", 10);
    kit_sleep_ms(200);
    sqlite3 *db = lock_database();
    int n = snprintf(ask, sizeof ask, "POST /v1/jobs/%s/cancel HTTP/1.1\r\nHost: %s\r\nContent-Length: 0\r\n\r\n", id, d.address);
    int connection = kit_connect(&d, ask, (size_t)n);
    for (int i = 0; i < 1000 && cached() == before; i++) kit_sleep_ms(5);
    assert_int_equal(cached(), before + 1);
    kit_sleep_ms(100);
    assert_int_equal(sqlite3_exec(db, "COMMIT", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "dismissed");
    assert_int_equal(cached(), before);
    json_decref(job);
    close(connection);
}

/* What is filed before it is found to be of the wrong kind. */
static void an_output_of_the_wrong_kind_goes_again(void **state) {
    (void)state;
    size_t before = cached();
    expect_failure("sanitize folder\n", "sanitize", "worker-protocol", "system", 3);
    assert_int_equal(cached(), before);
}

static void no_worker_or_folder_of_an_attempt_stays_behind(void **state) {
    (void)state;
    pid_t pids[8];
    char path[100];
    assert_int_equal(kit_workers(&d, pids, 8), 0);
    snprintf(path, sizeof path, "%s/work", d.data);
    assert_int_equal(rmdir(path), 0); /* works on an empty folder only */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_input_failure_names_the_elements_at_fault),
        cmocka_unit_test(failures_of_input_algorithm_and_limit_are_final),
        cmocka_unit_test(failures_of_the_system_are_tried_three_times),
        cmocka_unit_test(a_job_whose_worker_dies_twice_still_succeeds),
        cmocka_unit_test(limits_end_a_stage_as_limit_failures),
        cmocka_unit_test(a_running_job_is_cancelled_and_may_be_cancelled_again),
        cmocka_unit_test(a_queued_job_is_dismissed_at_once_and_never_runs),
        cmocka_unit_test(an_output_that_is_filed_and_then_not_booked_goes_again),
        cmocka_unit_test(an_output_of_the_wrong_kind_goes_again),
        cmocka_unit_test(no_worker_or_folder_of_an_attempt_stays_behind),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
