/* Requests, good and bad, over real sockets: every error is a problem document, and the daemon lives on. */
#include <arpa/inet.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bw_api.h"
#include "bw_page.h"
#include "daemon_kit.h"

static kit_daemon d;
static const char json_body[] = "Content-Type: application/json";
static const char nowhere[] = "000000000000000000000000";

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--max-upload", "1M", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply post_job(const char *body) {
    return kit_request(&d, "POST", "/v1/jobs", json_body, body, strlen(body));
}

static void a_blob_is_stored_once_and_found_by_head(void **state) {
    (void)state;
    const char *text = "some content";
    char hash[BW_SHA256_TEXT], path[120];
    kit_hash(text, strlen(text), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    for (long status = 201; status >= 200; status--) {
        r = kit_request(&d, "PUT", path, NULL, text, strlen(text));
        assert_int_equal(r.status, status);
        json_t *blob = kit_json(&r);
        assert_string_equal(kit_text(blob, "sha256"), hash);
        assert_int_equal(json_integer_value(json_object_get(blob, "bytes")), strlen(text));
        json_decref(blob);
    }
    r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

static void a_blob_under_a_wrong_hash_is_refused_and_not_kept(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], path[120];
    kit_hash("right", 5, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_expect_problem(kit_request(&d, "PUT", path, NULL, "wrong", 5), 422, "hash-mismatch");
    kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    kit_expect_problem(kit_request(&d, "PUT", "/v1/blobs/abc", NULL, "x", 1), 400, "bad-request");
}

static void an_upload_over_the_limit_is_refused_by_its_length_alone(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], text[400];
    kit_hash("", 0, hash);
    int n = snprintf(text, sizeof text, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n", hash);
    char *answer = kit_raw(&d, text, (size_t)n, false);
    assert_non_null(strstr(answer, "413"));
    assert_non_null(strstr(answer, "/problems/body-too-large"));
    free(answer);
    size_t size = (1 << 20) + 1;
    char *big = calloc(size, 1), path[120];
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_expect_problem(kit_request(&d, "PUT", path, "Expect:", big, size), 413, "body-too-large");
    kit_expect_problem(kit_request(&d, "PUT", path, "Expect: 100-continue", big, size), 413, "body-too-large");
    free(big);
}

static void an_upload_without_length_is_refused(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], path[120];
    kit_hash("x", 1, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_expect_problem(kit_request(&d, "PUT", path, "Transfer-Encoding: chunked\nContent-Length:", "x", 1), 411,
                       "length-required");
}

static void a_truncated_upload_leaves_nothing(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], text[400], path[120];
    kit_hash("truncated", 9, hash);
    int n = snprintf(text, sizeof text, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: x\r\nContent-Length: 5000\r\n\r\ntruncated", hash);
    free(kit_raw(&d, text, (size_t)n, true));
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    assert_true(kit_no_uploads(&d, 50000));
}

static void what_is_not_there_is_404_and_the_wrong_method_405(void **state) {
    (void)state;
    char path[120];
    kit_expect_problem(kit_get(&d, "/page"), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/page/nothing.mjs"), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/v1/jobs/"), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/v1/blobs/x/y"), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/results/..%%2f..%%2fjobs.db", nowhere), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s", nowhere), 404, "no-such-job");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/log", nowhere), 404, "no-such-job");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/report", nowhere), 404, "no-such-job");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/results", nowhere), 404, "no-such-job");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/results/x", nowhere), 404, "no-such-job");
    kit_expect_problem(kit_get(&d, "/v1/jobs/';DROP%%20TABLE%%20jobs"), 404, "no-such-job");
    for (int i = 0; i < 2; i++) {
        snprintf(path, sizeof path, "/v1/jobs/%s/%s", nowhere, i ? "finish" : "cancel");
        kit_expect_problem(kit_request(&d, "POST", path, NULL, NULL, 0), 404, "no-such-job");
    }
    for (const char *const *m = (const char *const[]){"DELETE", "PATCH", "OPTIONS", "BREW", NULL}; *m; m++) {
        kit_reply r = kit_request(&d, *m, "/v1/jobs", NULL, NULL, 0);
        assert_string_equal(r.allow, "GET, HEAD, POST");
        kit_expect_problem(r, 405, "method-not-allowed");
    }
}

static void a_bad_job_is_refused_with_the_reason(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], body[400];
    const char *not_json[] = {"", "{", "[]", "7", "null", "{\"input\": 1}", "{\"input\": \"abc\"}", "{}",
                              "{\"input\":\"\",\"input\":\"\"}", "\xff\xfe"};
    for (size_t i = 0; i < sizeof not_json / sizeof *not_json; i++)
        kit_expect_problem(post_job(not_json[i]), 400, "bad-json");
    kit_hash("never uploaded", 14, hash);
    snprintf(body, sizeof body, "{\"input\":\"%s\"}", hash);
    kit_expect_problem(post_job(body), 422, "unknown-input");
    kit_upload(&d, "uploaded", hash);
    snprintf(body, sizeof body, "{\"input\":\"%s\",\"colour\":1}", hash);
    kit_expect_problem(post_job(body), 400, "bad-json");
    for (const char *const *side = (const char *const[]){"\"\"", "\"abc\"", "null", "7", "[]", NULL}; *side; side++) {
        snprintf(body, sizeof body, "{\"input\":\"%s\",\"parameters\":%s}", hash, *side);
        kit_expect_problem(post_job(body), 400, "bad-json");
    }
    snprintf(body, sizeof body, "{\"input\":\"%s\",\"parameters\":\"%064d\"}", hash, 0);
    kit_expect_problem(post_job(body), 422, "unknown-input");
    snprintf(body, sizeof body, "{\"input\":\"%s\",\"name\":{}}", hash);
    kit_expect_problem(post_job(body), 400, "bad-json");
    const char *bad_options[] = {"[]", "{\"colour\":1}", "{\"complex\":\"xy\"}", "{\"complex\":1}", "{\"until\":\"tomorrow\"}",
                                 "{\"tolerance\":-1}", "{\"tolerance\":0.1}", "{\"tolerance\":\"1\"}", "{\"max_cells\":0}", "{\"max_cells\":1.5}",
                                 "{\"max_cells\":9000000000000000000}", "null"};
    for (size_t i = 0; i < sizeof bad_options / sizeof *bad_options; i++) {
        snprintf(body, sizeof body, "{\"input\":\"%s\",\"options\":%s}", hash, bad_options[i]);
        kit_expect_problem(post_job(body), 400, "invalid-option");
    }
    kit_expect_problem(kit_request(&d, "POST", "/v1/jobs", "Content-Type: text/plain", "{}", 2), 415,
                       "unsupported-media-type");
    char *big = malloc(70000);
    memset(big, ' ', 70000);
    kit_expect_problem(kit_request(&d, "POST", "/v1/jobs", json_body, big, 70000), 413, "body-too-large");
    kit_expect_problem(kit_request(&d, "POST", "/v1/jobs",
                                   "Content-Type: application/json\nTransfer-Encoding: chunked\nContent-Length:", big, 70000),
                       413, "body-too-large");
    memset(big, '[', 60000);
    big[60000] = '\0';
    kit_expect_problem(post_job(big), 400, "bad-json");
    free(big);
}

static void bad_query_parameters_are_refused(void **state) {
    (void)state;
    const char *bad[] = {"limit=0", "limit=201", "limit=x", "limit=", "cursor=-1", "cursor=abc", "state=happy", "colour=red"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        kit_expect_problem(kit_get(&d, "/v1/jobs?%s", bad[i]), 400, "invalid-parameter");
}

static void two_ways_to_end_a_body_are_refused(void **state) {
    (void)state;
    const char *smuggled[] = {
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\nContent-Length: 4\r\n\r\n0\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\nContent-Length: 5\r\n\r\nabcde",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 4\r\nContent-Length: 4\r\n\r\nabcd",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: gzip, chunked\r\n\r\n0\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: xchunked\r\n\r\n0\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: identity\r\nContent-Length: 4\r\n\r\nabcd",
        "POST /v1/jobs HTTP/1.0\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length : 4\r\n\r\nGET /livez HTTP/1.1\r\nHost: x\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: +4\r\n\r\nabcd",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 4, 4\r\n\r\nabcd",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length:\r\n 4\r\n\r\nGET /livez HTTP/1.1\r\nHost: x\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent: 4\r\n -Length\r\n\r\nabcdGET /livez HTTP/1.1\r\nHost: x\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding:\r\n chunked\r\n\r\nGET /livez HTTP/1.1\r\nHost: x\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nX: y\rContent-Length: 0\r\nContent-Length: 4\r\n\r\nabcdGET /livez HTTP/1.1\r\nHost: x\r\n\r\n",
        "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nTransfer-Encoding : chunked\r\nContent-Length: 5\r\n\r\n0\r\n\r\n",
        "GET /livez HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n"};
    for (size_t i = 0; i < sizeof smuggled / sizeof *smuggled; i++) {
        char *answer = kit_raw(&d, smuggled[i], strlen(smuggled[i]), true);
        if (!strstr(answer, " 400 ") || strstr(answer, " 200 ")) fail_msg("%s\n-> %s", smuggled[i], answer);
        free(answer);
    }
}

static void a_request_without_host_is_refused(void **state) {
    (void)state;
    char *answer = kit_raw(&d, "GET /livez HTTP/1.1\r\n\r\n", 23, true);
    assert_non_null(strstr(answer, " 400 "));
    assert_non_null(strstr(answer, "/problems/bad-request"));
    free(answer);
    answer = kit_raw(&d, "GET /livez HTTP/1.0\r\n\r\n", 23, true);
    assert_non_null(strstr(answer, " 200 "));
    free(answer);
}

static void garbage_in_place_of_http_is_survived(void **state) {
    (void)state;
    srand(7);
    char noise[3000];
    for (int round = 0; round < 20; round++) {
        for (size_t i = 0; i < sizeof noise; i++) noise[i] = (char)rand();
        free(kit_raw(&d, noise, sizeof noise, true));
    }
    memset(noise, 'a', sizeof noise);
    free(kit_raw(&d, noise, sizeof noise, true));
    free(kit_raw(&d, "GET / HTTP/1.1\r\n", 16, true));
    free(kit_raw(&d, "\r\n\r\n\r\n", 6, true));
    free(kit_raw(&d, "GET /livez HTTP/9.9\r\n\r\n", 23, true));
    kit_reply r = kit_get(&d, "/livez");
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

static void results_answer_if_none_match(void **state) {
    (void)state;
    char id[32], path[120], header[120];
    kit_submit(&d, "# etag\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    snprintf(path, sizeof path, "/v1/jobs/%s/results/data.bin", id);
    kit_reply r = kit_request(&d, "GET", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_int_equal(strlen(r.etag), 66);
    snprintf(header, sizeof header, "If-None-Match: %s", r.etag);
    kit_free(&r);
    r = kit_request(&d, "GET", path, header, NULL, 0);
    assert_int_equal(r.status, 304);
    assert_int_equal(r.size, 0);
    kit_free(&r);
    r = kit_request(&d, "GET", path, "If-None-Match: \"other\"", NULL, 0);
    assert_int_equal(r.status, 200);
    kit_free(&r);
    r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_true(r.status == 200 && r.size == 0);
    kit_free(&r);
    kit_expect_problem(kit_get(&d, "/v1/jobs/%s/results/nothing.bin", id), 404, "no-such-result");
}

static void the_daemon_tells_about_itself(void **state) {
    (void)state;
    kit_reply r = kit_get(&d, "/livez");
    json_t *live = kit_json(&r);
    assert_string_equal(kit_text(live, "version"), BW_VERSION);
    json_decref(live);
    r = kit_get(&d, "/readyz");
    assert_int_equal(r.status, 200);
    json_t *ready = kit_json(&r);
    assert_true(json_is_true(json_object_get(ready, "ready")));
    assert_string_equal(kit_text(json_object_get(json_object_get(ready, "checks"), "queue"), "status"), "ok");
    json_decref(ready);
    r = kit_get(&d, "/openapi.json");
    json_t *document = kit_json(&r);
    assert_string_equal(kit_text(document, "openapi"), "3.1.0");
    for (int i = 0; i < BW_OP_COUNT; i++)
        assert_non_null(json_object_get(json_object_get(document, "paths"), bw_endpoints[i].path));
    json_decref(document);
}

/* Each file of the page that the page or a script of it names is there. */
static void the_page_is_served_whole_and_may_load_nothing_else(void **state) {
    (void)state;
    kit_reply r = kit_get(&d, "/");
    int scripts = 0;
    assert_int_equal(r.status, 200);
    assert_non_null(strstr(r.body, "page/main.mjs"));
    assert_string_equal(r.type, "text/html; charset=utf-8");
    assert_non_null(strstr(r.policy, "default-src 'none'; script-src 'self';"));
    kit_free(&r);
    for (const bw_page_file *file = bw_page_files; file->name; file++) {
        bool style = strstr(file->name, ".css"), script = strstr(file->name, ".mjs");
        if (!style && !script) continue;
        r = kit_get(&d, "/page/%s", file->name);
        assert_int_equal(r.status, 200);
        assert_string_equal(r.type, style ? "text/css; charset=utf-8" : "text/javascript; charset=utf-8");
        assert_non_null(strstr(r.policy, "default-src 'none';"));
        assert_true(r.size == file->size && memcmp(r.body, file->bytes, r.size) == 0);
        scripts += script;
        kit_free(&r);
    }
    assert_true(scripts >= 5);
}

static void pages_hold_every_job_once_newest_first(void **state) {
    (void)state;
    char ids[12][32], script[40], next[40] = "";
    int at = 12;
    for (int i = 0; i < 12; i++) {
        snprintf(script, sizeof script, "# page %d\n", i);
        kit_submit(&d, script, "{\"until\":\"sanitize\"}", ids[i]);
    }
    while (at > 0) {
        kit_reply r = kit_get(&d, "/v1/jobs?limit=5%s%s", *next ? "&cursor=" : "", next);
        json_t *page = kit_json(&r), *list = json_object_get(page, "jobs"), *item;
        size_t i;
        json_array_foreach(list, i, item) if (at > 0) assert_string_equal(kit_text(item, "id"), ids[--at]);
        snprintf(next, sizeof next, "%s", kit_text(page, "next"));
        assert_true(*next || at == 0);
        json_decref(page);
    }
    for (int i = 0; i < 12; i++) json_decref(kit_wait(&d, ids[i], 20));
}

/* An upload under way holds up the stop for two seconds, in which others are told. */
static void who_asks_a_daemon_that_stops_is_told_to_come_again(void **state) {
    (void)state;
    static const char begun[] = "PUT /v1/blobs/0000000000000000000000000000000000000000000000000000000000000000 HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100\r\n\r\nhalf";
    int fd = kit_connect(&d, begun, sizeof begun - 1);
    for (int i = 0; i < 2000 && kit_no_uploads(&d, 0); i++) kit_sleep_ms(5);
    assert_false(kit_no_uploads(&d, 0));
    kill(d.pid, SIGTERM);
    kit_reply r = {.status = 200};
    for (int i = 0; i < 10000 && r.status == 200; i++) {
        kit_free(&r);
        r = kit_get(&d, "/livez");
    }
    assert_string_equal(kit_header(&r, "Retry-After"), "5");
    kit_expect_problem(r, 503, "not-ready");
    close(fd);
    int status;
    assert_int_equal(waitpid(d.pid, &status, 0), d.pid);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    d.pid = 0;
    kit_restart(&d, NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_blob_is_stored_once_and_found_by_head),
        cmocka_unit_test(a_blob_under_a_wrong_hash_is_refused_and_not_kept),
        cmocka_unit_test(an_upload_over_the_limit_is_refused_by_its_length_alone),
        cmocka_unit_test(an_upload_without_length_is_refused),
        cmocka_unit_test(a_truncated_upload_leaves_nothing),
        cmocka_unit_test(what_is_not_there_is_404_and_the_wrong_method_405),
        cmocka_unit_test(a_bad_job_is_refused_with_the_reason),
        cmocka_unit_test(bad_query_parameters_are_refused),
        cmocka_unit_test(two_ways_to_end_a_body_are_refused),
        cmocka_unit_test(a_request_without_host_is_refused),
        cmocka_unit_test(garbage_in_place_of_http_is_survived),
        cmocka_unit_test(results_answer_if_none_match),
        cmocka_unit_test(the_daemon_tells_about_itself),
        cmocka_unit_test(the_page_is_served_whole_and_may_load_nothing_else),
        cmocka_unit_test(pages_hold_every_job_once_newest_first),
        cmocka_unit_test(who_asks_a_daemon_that_stops_is_told_to_come_again),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
