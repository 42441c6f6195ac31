/* What the queue offers over HTTP: priorities, tags, keys, batches, limits, retry and removal. */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "access_kit.h"

static kit_daemon d;
static const char json[] = "Content-Type: application/json";

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "1", NULL});
    return 0;
}

static int start_with_limits(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "1", "--owner-jobs", "3", "--owner-bytes", "60", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply post(const char *path, const char *headers, const char *format, ...) __attribute__((format(printf, 3, 4)));

static kit_reply post(const char *path, const char *headers, const char *format, ...) {
    char body[2000];
    va_list args;
    va_start(args, format);
    vsnprintf(body, sizeof body, format, args);
    va_end(args);
    return kit_request(&d, "POST", path, headers, body, strlen(body));
}

static kit_reply on_job(const char *method, const char *id, const char *rest) {
    char path[100];
    snprintf(path, sizeof path, "/v1/jobs/%s%s", id, rest);
    return kit_request(&d, method, path, NULL, NULL, 0);
}

static void jobs_of_higher_priority_start_first(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], busy[32], ids[4][32], last[40] = "";
    const int priority[4] = {0, -5, 100, 7}, order[4] = {2, 3, 0, 1};
    kit_submit(&d, "sanitize sleep 700\n# busy\n", "{\"until\": \"sanitize\"}", busy);
    for (int i = 0; i < 4; i++) {
        char script[40];
        snprintf(script, sizeof script, "# priority %d\n", i);
        kit_upload(&d, script, hash);
        kit_take_id(post("/v1/jobs", json, "{\"input\": \"%s\", \"priority\": %d, \"options\": {\"until\": \"sanitize\"}}", hash, priority[i]), ids[i]);
    }
    for (int i = 0; i < 4; i++) {
        json_t *job = kit_wait(&d, ids[order[i]], 20);
        assert_int_equal(json_integer_value(json_object_get(job, "priority")), priority[order[i]]);
        assert_true(strcmp(last, kit_text(job, "started")) < 0);
        snprintf(last, sizeof last, "%s", kit_text(job, "started"));
        json_decref(job);
    }
}

static void jobs_are_found_by_their_tags(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], id[32];
    kit_upload(&d, "# tagged\n", hash);
    kit_take_id(post("/v1/jobs", json, "{\"input\": \"%s\", \"tags\": [\"z\", \"caf\xc3\xa9 1\", \"z\"]}", hash), id);
    json_t *job = kit_wait(&d, id, 20), *tags = json_object_get(job, "tags");
    assert_int_equal(json_array_size(tags), 2);
    assert_string_equal(json_string_value(json_array_get(tags, 1)), "z");
    json_decref(job);
    assert_int_equal(kit_listed(&d, "tag=z"), 1);
    assert_int_equal(kit_listed(&d, "tag=caf%C3%A9%201&state=successful"), 1);
    assert_int_equal(kit_listed(&d, "tag=z&state=failed"), 0);
    assert_int_equal(kit_listed(&d, "tag=y"), 0);
    kit_expect_problem(kit_get(&d, "/v1/jobs?tag="), 400, "invalid-parameter");
    const char *const bad[] = {"\"z\"", "[\"\"]", "[1]", "[\"a\\nb\"]", "[\"0123456789012345678901234567890123456789012345678901234567890123x\"]",
                               "[\"1\",\"2\",\"3\",\"4\",\"5\",\"6\",\"7\",\"8\",\"9\",\"a\",\"b\",\"c\",\"d\",\"e\",\"f\",\"g\",\"h\"]"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        kit_expect_problem(post("/v1/jobs", json, "{\"input\": \"%s\", \"tags\": %s}", hash, bad[i]), 400, "bad-json");
    const char *const priorities[] = {"101", "-101", "1.5", "\"1\"", "null"};
    for (size_t i = 0; i < sizeof priorities / sizeof *priorities; i++)
        kit_expect_problem(post("/v1/jobs", json, "{\"input\": \"%s\", \"priority\": %s}", hash, priorities[i]), 400, "bad-json");
}

/* ---- keys ---- */

static char keyed_hash[BW_SHA256_TEXT];

static void *post_keyed(void *user) {
    kit_take_id(post("/v1/jobs", "Content-Type: application/json\nIdempotency-Key: race", "{\"input\": \"%s\"}", keyed_hash), user);
    return NULL;
}

static void a_request_sent_again_with_its_key_creates_nothing(void **state) {
    (void)state;
    static const char keyed[] = "Content-Type: application/json\nIdempotency-Key: \"one\"";
    char first[32], again[32], ids[8][32];
    pthread_t threads[8];
    kit_upload(&d, "# keyed\n", keyed_hash);
    kit_take_id(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), first);
    kit_take_id(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), again);
    assert_string_equal(first, again);
    kit_expect_problem(post("/v1/jobs", keyed, "{\"input\": \"%s\" }", keyed_hash), 422, "key-reused");
    kit_expect_problem(post("/v1/batches", keyed, "{\"jobs\": [{\"input\": \"%s\"}]}", keyed_hash), 422, "key-reused");
    kit_expect_problem(post("/v1/jobs", "Content-Type: application/json\nIdempotency-Key: a b", "{\"input\": \"%s\"}", keyed_hash), 400, "bad-request");
    for (int i = 0; i < 8; i++) pthread_create(&threads[i], NULL, post_keyed, ids[i]);
    for (int i = 0; i < 8; i++) pthread_join(threads[i], NULL);
    for (int i = 1; i < 8; i++) assert_string_equal(ids[0], ids[i]);
    kit_kill(&d, SIGKILL);
    kit_restart(&d, NULL);
    kit_take_id(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), again);
    assert_string_equal(first, again);
    assert_int_equal(kit_listed(&d, "limit=200"), 2);
}

/* It was asked for once, and had. */
static void a_key_makes_no_second_job_when_the_first_one_is_gone(void **state) {
    (void)state;
    static const char keyed[] = "Content-Type: application/json\nIdempotency-Key: gone";
    char id[32], address[60], line[200];
    kit_upload(&d, "# keyed\n", keyed_hash);
    kit_take_id(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), id);
    json_decref(kit_wait(&d, id, 20));
    snprintf(address, sizeof address, "/v1/jobs/%s", id);
    kit_reply r = kit_request(&d, "DELETE", address, NULL, NULL, 0);
    assert_int_equal(r.status, 204);
    kit_free(&r);
    kit_expect_problem(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), 410, "job-gone");
    kit_stop(&d);
    kit_restart(&d, (const char *const[]){"--keep-gone", "1s", NULL});
    kit_sleep_ms(1100);
    assert_int_equal(kit_blockwrightd(&d, "gc", line, sizeof line), 0);
    kit_expect_problem(post("/v1/jobs", keyed, "{\"input\": \"%s\"}", keyed_hash), 404, "no-such-job");
    assert_int_equal(kit_listed(&d, "limit=200"), 0);
}

/* ---- batches ---- */

static void a_batch_is_accepted_whole_or_not_at_all(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT];
    kit_upload(&d, "# batch\n", hash);
    static const char missing[] = "0000000000000000000000000000000000000000000000000000000000000000";
    kit_reply r = post("/v1/batches", json, "{\"jobs\": [{\"input\": \"%s\", \"tags\": [\"b\"]}, {\"input\": \"%s\", \"tags\": [\"b\"]}]}", hash, missing);
    assert_non_null(strstr(r.body, "jobs[1]: "));
    kit_expect_problem(r, 422, "unknown-input");
    kit_expect_problem(post("/v1/batches", json, "{\"jobs\": [{\"input\": \"%s\"}, 7]}", hash), 400, "bad-json");
    kit_expect_problem(post("/v1/batches", json, "{\"jobs\": [{\"input\": \"%s\", \"options\": {\"effort\": 9}}]}", hash), 400, "invalid-option");
    kit_expect_problem(post("/v1/batches", json, "{\"jobs\": []}"), 400, "bad-json");
    kit_expect_problem(post("/v1/batches", json, "{\"jobs\": [{\"input\": \"%s\"}], \"x\": 1}", hash), 400, "bad-json");
    kit_expect_problem(post("/v1/batches", json, "[]"), 400, "bad-json");
    assert_int_equal(kit_listed(&d, "limit=200"), 0);
    static const char keyed[] = "Content-Type: application/json\nIdempotency-Key: batch";
    char ids[2][32];
    for (int again = 0; again < 2; again++) {
        r = post("/v1/batches", keyed, "{\"jobs\": [{\"input\": \"%s\", \"tags\": [\"b\"]}, {\"input\": \"%s\", \"name\": \"two\", \"options\": {\"complex\": \"bc\"}}]}", hash, hash);
        assert_int_equal(r.status, 201);
        json_t *batch = kit_json(&r), *jobs = json_object_get(batch, "jobs");
        assert_int_equal(json_array_size(jobs), 2);
        for (size_t i = 0; i < 2; i++) {
            if (again) assert_string_equal(ids[i], kit_text(json_array_get(jobs, i), "id"));
            snprintf(ids[i], sizeof ids[i], "%s", kit_text(json_array_get(jobs, i), "id"));
        }
        json_decref(batch);
    }
    assert_int_equal(kit_listed(&d, "limit=200"), 2);
    json_t *job = kit_wait(&d, ids[1], 20);
    assert_string_equal(kit_text(job, "name"), "two");
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
}

static void a_batch_may_have_a_thousand_jobs_and_a_megabyte(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT];
    enum { ROOM = 1 << 21 };
    char *body = malloc(ROOM);
    kit_upload(&d, "sanitize sleep 20000\n# thousand\n", hash);
    for (int jobs = 1000; jobs <= 1001; jobs++) {
        size_t n = (size_t)sprintf(body, "{\"jobs\": [");
        for (int i = 0; i < jobs; i++) n += (size_t)sprintf(body + n, "%s{\"input\": \"%s\", \"tags\": [\"many\"]}", i ? "," : "", hash);
        n += (size_t)sprintf(body + n, "]}");
        kit_reply r = kit_request(&d, "POST", "/v1/batches", json, body, n);
        if (jobs == 1001) {
            kit_expect_problem(r, 400, "bad-json");
            break;
        }
        assert_int_equal(r.status, 201);
        kit_free(&r);
    }
    assert_int_equal(kit_listed(&d, "tag=many&limit=200"), 200);
    memset(body, ' ', ROOM);
    kit_expect_problem(kit_request(&d, "POST", "/v1/batches", json, body, (1 << 20) + 1), 413, "body-too-large");
    free(body);
}

/* ---- limits ---- */

static void more_than_an_owner_may_have_is_429_with_retry_after(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], ids[4][32];
    static const char sleeper[] = "sanitize sleep 20000\n";
    kit_upload(&d, sleeper, hash);
    kit_expect_problem(post("/v1/batches", json, "{\"jobs\": [{\"input\": \"%s\"}, {\"input\": \"%s\"}, {\"input\": \"%s\"}, {\"input\": \"%s\"}]}",
                            hash, hash, hash, hash), 429, "too-many-jobs");
    assert_int_equal(kit_listed(&d, "limit=200"), 0);
    for (int i = 0; i < 3; i++) kit_take_id(post("/v1/jobs", json, "{\"input\": \"%s\"}", hash), ids[i]);
    kit_reply r = post("/v1/jobs", json, "{\"input\": \"%s\"}", hash);
    assert_true(atoi(kit_header(&r, "Retry-After")) > 0);
    kit_expect_problem(r, 429, "too-many-jobs");
    r = on_job("POST", ids[2], "/cancel");
    assert_int_equal(r.status, 200);
    kit_free(&r);
    kit_take_id(post("/v1/jobs", json, "{\"input\": \"%s\"}", hash), ids[3]);
    kit_expect_problem(on_job("POST", ids[2], "/retry"), 429, "too-many-jobs");
    r = on_job("POST", ids[3], "/cancel");
    kit_free(&r);
    static const char more[] = "# twenty-one bytes..\n# and twenty of others\n"; /* 43 + 21 > 60 */
    char path[120];
    kit_hash(more, sizeof more - 1, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    r = kit_request(&d, "PUT", path, NULL, more, sizeof more - 1);
    assert_true(atoi(kit_header(&r, "Retry-After")) > 0);
    kit_expect_problem(r, 429, "too-many-bytes");
}

/* Two that fit when they begin, and not both when they end. */
static void what_turned_out_too_large_does_not_stay_on_the_disk(void **state) {
    (void)state;
    static const char slow[] = "# fifty bytes, which come slowly and do not fit..\n", fast[] = "# twenty-one bytes..\n";
    char hash[BW_SHA256_TEXT], file[400], text[600];
    kit_hash(slow, 50, hash);
    snprintf(file, sizeof file, "%s/blobs/%.2s/%s", d.data, hash, hash);
    int n = snprintf(text, sizeof text, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: localhost\r\nContent-Length: 50\r\nConnection: close\r\n\r\n%.10s", hash, slow);
    int fd = kit_connect(&d, text, (size_t)n);
    snprintf(text, sizeof text, "%s/tmp/upload.0", d.data);
    for (int i = 0; i < 1000 && access(text, F_OK) != 0; i++) kit_sleep_ms(10); /* it has begun */
    kit_upload(&d, fast, hash);
    assert_int_equal(send(fd, slow + 10, 40, 0), 40);
    ssize_t got = recv(fd, text, sizeof text - 1, 0);
    assert_true(got > 12);
    assert_memory_equal(text, "HTTP/1.1 429", 12);
    close(fd);
    assert_int_not_equal(access(file, F_OK), 0);
}

/* ---- retry and removal ---- */

static void a_failed_job_is_tried_again_and_its_attempts_go_on(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "trace fail syntax\n", NULL, id);
    for (int attempts = 2; attempts <= 3; attempts++) { /* sanitize is not done again */
        json_t *job = kit_wait(&d, id, 20), *list = json_object_get(job, "attempts");
        assert_string_equal(kit_text(job, "state"), "failed");
        assert_int_equal(json_array_size(list), attempts);
        assert_int_equal(json_integer_value(json_object_get(json_array_get(list, (size_t)attempts - 1), "attempt")), attempts);
        assert_string_equal(kit_text(json_array_get(list, (size_t)attempts - 1), "stage"), "trace");
        json_decref(job);
        kit_reply r = on_job("POST", id, "/retry");
        assert_int_equal(r.status, 200);
        job = kit_json(&r);
        assert_string_equal(kit_text(job, "id"), id);
        assert_null(json_object_get(job, "failure"));
        json_decref(job);
    }
    kit_wait_state(&d, id, "failed", 20);
}

static void a_cancelled_job_is_tried_again_to_its_end(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "sanitize sleep 400\n# dismissed at first\n", NULL, id);
    kit_expect_problem(on_job("POST", id, "/retry"), 409, "job-not-ended");
    kit_wait_state(&d, id, "running", 20);
    kit_reply r = on_job("POST", id, "/cancel");
    assert_int_equal(r.status, 200);
    kit_free(&r);
    kit_wait_state(&d, id, "dismissed", 20);
    r = on_job("POST", id, "/retry");
    assert_int_equal(r.status, 200);
    kit_free(&r);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
    kit_reply late = on_job("POST", id, "/retry"); /* that it has ended would be no reason */
    assert_non_null(strstr(late.body, "the job was successful; there is nothing to retry"));
    kit_expect_problem(late, 409, "job-finished");
    kit_expect_problem(on_job("POST", "000000000000000000000000", "/retry"), 404, "no-such-job");
}

static void a_deleted_job_is_410_by_every_verb(void **state) {
    (void)state;
    char id[32], file[200];
    kit_submit(&d, "* log one line\nsanitize sleep 300\n# to go\n", NULL, id);
    kit_expect_problem(on_job("DELETE", id, ""), 409, "job-not-ended");
    json_decref(kit_wait(&d, id, 20));
    snprintf(file, sizeof file, "%s/logs/%s.log", d.data, id);
    assert_int_equal(access(file, F_OK), 0);
    kit_reply r = on_job("DELETE", id, "");
    assert_int_equal(r.status, 204);
    assert_int_equal(r.size, 0);
    kit_free(&r);
    assert_int_equal(access(file, F_OK), -1);
    assert_int_equal(kit_listed(&d, "limit=200"), 0);
    static const char *const verbs[][2] = {{"GET", ""}, {"DELETE", ""}, {"POST", "/cancel"}, {"POST", "/finish"}, {"POST", "/retry"},
                                           {"GET", "/log"}, {"GET", "/results"}, {"GET", "/results/report.json"}, {"GET", "/report"}};
    for (int restarted = 0; restarted < 2; restarted++) {
        for (size_t i = 0; i < sizeof verbs / sizeof *verbs; i++) kit_expect_problem(on_job(verbs[i][0], id, verbs[i][1]), 410, "job-gone");
        kit_kill(&d, SIGKILL);
        kit_restart(&d, NULL);
    }
    kit_expect_problem(on_job("DELETE", "000000000000000000000000", ""), 404, "no-such-job");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(jobs_of_higher_priority_start_first, start, stop),
        cmocka_unit_test_setup_teardown(jobs_are_found_by_their_tags, start, stop),
        cmocka_unit_test_setup_teardown(a_request_sent_again_with_its_key_creates_nothing, start, stop),
        cmocka_unit_test_setup_teardown(a_key_makes_no_second_job_when_the_first_one_is_gone, start, stop),
        cmocka_unit_test_setup_teardown(a_batch_is_accepted_whole_or_not_at_all, start, stop),
        cmocka_unit_test_setup_teardown(a_batch_may_have_a_thousand_jobs_and_a_megabyte, start, stop),
        cmocka_unit_test_setup_teardown(more_than_an_owner_may_have_is_429_with_retry_after, start_with_limits, stop),
        cmocka_unit_test_setup_teardown(what_turned_out_too_large_does_not_stay_on_the_disk, start_with_limits, stop),
        cmocka_unit_test_setup_teardown(a_failed_job_is_tried_again_and_its_attempts_go_on, start, stop),
        cmocka_unit_test_setup_teardown(a_cancelled_job_is_tried_again_to_its_end, start, stop),
        cmocka_unit_test_setup_teardown(a_deleted_job_is_410_by_every_verb, start, stop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
