/* Jobs created by one request that has the input as its body and the description in its query. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bw_api.h"
#include "daemon_kit.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *[]){"--owner-bytes", "4000", "--max-upload", "10000", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply send(const char *query, const char *headers, const char *content) {
    char path[600];
    snprintf(path, sizeof path, "/v1/jobs%s", query);
    return kit_request(&d, "POST", path, headers, content, strlen(content));
}

static void the_body_is_the_input_and_the_query_its_description(void **state) {
    (void)state;
    static const char script[] = "encode bytes 300\n# alone\n";
    char id[32], hash[BW_SHA256_TEXT];
    kit_reply r = send("?until=reduce&tag=a&tag=b%20c&name=n%C3%BC&priority=-7&pinned=true&wall_seconds=50&effort=2&repair=true&tolerance=0.0625"
                       "&scales=1,2.5&hex_formats=vtu,mesh&quantize=any", "Content-Type: application/octet-stream; x=y\nPrefer: wait=20", script);
    if (r.status != 201) fail_msg("%ld %s", r.status, r.body);
    assert_string_equal(r.applied, "wait=20");
    assert_memory_equal(r.location, "/v1/jobs/", 9);
    json_t *job = kit_json(&r), *options = json_object_get(job, "options"), *tags = json_object_get(job, "tags");
    kit_hash(script, strlen(script), hash);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_string_equal(kit_text(job, "input"), hash);
    assert_string_equal(kit_text(job, "name"), "n\xc3\xbc");
    assert_int_equal(json_integer_value(json_object_get(job, "priority")), -7);
    assert_true(json_is_true(json_object_get(job, "pinned")));
    assert_int_equal(json_array_size(tags), 2);
    assert_string_equal(json_string_value(json_array_get(tags, 1)), "b c");
    assert_int_equal(json_integer_value(json_object_get(json_object_get(job, "limits"), "wall_seconds")), 50);
    assert_string_equal(kit_text(options, "until"), "reduce");
    assert_string_equal(kit_text(options, "quantize"), "any");
    assert_int_equal(json_integer_value(json_object_get(options, "effort")), 2);
    assert_true(json_is_true(json_object_get(options, "repair")));
    assert_true(json_number_value(json_object_get(options, "tolerance")) == 0.0625);
    assert_true(json_number_value(json_array_get(json_object_get(options, "scales"), 1)) == 2.5);
    assert_int_equal(json_array_size(json_object_get(options, "hex_formats")), 2);
    json_decref(job);

    kit_take_id(send("", "", script), id); /* without Content-Type, and as curl -T would */
    job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
    r = kit_get(&d, "/v1/jobs/%s/results/data.bin", id);
    assert_int_equal(r.size, 300);
    kit_free(&r);
    char body[200]; /* it is a blob like others */
    int n = snprintf(body, sizeof body, "{\"input\": \"%s\"}", hash);
    kit_take_id(kit_request(&d, "POST", "/v1/jobs", "Content-Type: application/json", body, (size_t)n), id);
}

/* The problem, and that nothing was accepted or kept: the daemon says so before it has read a byte. */
static void refused(const char *query, const char *headers, const char *content, long status, const char *code) {
    size_t before = kit_listed(&d, "limit=200");
    kit_expect_problem(send(query, headers, content), status, code);
    assert_int_equal(kit_listed(&d, "limit=200"), before);
    assert_true(kit_no_uploads(&d, 2000));
}

static void mistakes_of_the_query_are_told_with_their_names(void **state) {
    (void)state;
    static const struct {
        const char *query, *code, *word;
    } cases[] = {{"?quantize=all", "invalid-option", "quantize"}, {"?effort=2.5", "invalid-option", "effort"}, {"?effort=", "invalid-option", "effort"},
                 {"?effort", "invalid-option", "effort"}, {"?repair=yes", "invalid-option", "repair"}, {"?scales=1,x", "invalid-option", "scales"},
                 {"?scales=1,,2", "invalid-option", "scales"}, {"?hex_formats=stl", "invalid-option", "hex_formats"}, {"?tolerance=\"1\"", "invalid-option", "tolerance"},
                 {"?wall_seconds=0", "invalid-option", "wall_seconds"}, {"?memory=1.5", "invalid-option", "memory"}, {"?memory=much", "invalid-option", "memory"},
                 {"?priority=101", "invalid-parameter", "priority"}, {"?priority=high", "invalid-parameter", "priority"}, {"?pinned=1", "invalid-parameter", "pinned"},
                 {"?tag=", "invalid-parameter", "tags"}, {"?name=%ff", "invalid-parameter", "name"}, {"?complex=mc&complex=mc", "invalid-parameter", "complex"},
                 {"?parameters=1", "invalid-parameter", "parameters"}, {"?input=1", "invalid-parameter", "input"}, {"?options=1", "invalid-parameter", "options"},
                 {"?tags=a", "invalid-parameter", "tags"},
                 {"?parameters=0000000000000000000000000000000000000000000000000000000000000000", "unknown-input", "parameters"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        kit_reply r = send(cases[i].query, "", "# never read\n");
        if (!r.body || !strstr(r.body, cases[i].word)) fail_msg("%s: %s", cases[i].query, r.body);
        kit_expect_problem(r, strcmp(cases[i].code, "unknown-input") == 0 ? 422 : 400, cases[i].code);
    }
    refused("?complex=bc", "Content-Type: application/json", "{}", 400, "invalid-parameter");
    refused("?complex=bc", "Content-Type: text/plain", "# text\n", 415, "unsupported-media-type");
    refused("", "Transfer-Encoding: chunked\nContent-Length:", "# chunks\n", 411, "length-required");
    refused("", "", "", 422, "empty-input");
}

static void limits_of_uploads_hold(void **state) {
    (void)state;
    static char large[12000];
    memset(large, '#', sizeof large - 1);
    refused("", "", large, 413, "body-too-large");
    refused("", "", large + 7000, 429, "too-many-bytes");
    refused("", "Content-Encoding: gzip", "# not packed\n", 400, "bad-coding");
}

/* The headers alone, as of clients that wait for leave to go on. */
static void expect_before_the_body(const char *more, const char *word) {
    char text[300];
    int n = snprintf(text, sizeof text, "POST /v1/jobs?complex=bc HTTP/1.1\r\nHost: %s\r\nContent-Length: 3000\r\nExpect: 100-continue\r\nConnection: close\r\n%s\r\n",
                     d.address, more);
    char *answer = kit_raw(&d, text, (size_t)n, true);
    if (!strstr(answer, word)) fail_msg("%s", answer);
    free(answer);
}

static void one_job_too_many_is_told_before_the_body(void **state) {
    (void)state;
    kit_daemon first = d;
    char id[32];
    kit_start(&d, NULL, (const char *[]){"--owner-jobs", "1", NULL});
    kit_submit(&d, "sanitize sleep 30000\n", NULL, id);
    expect_before_the_body("", "too-many-jobs");
    expect_before_the_body("Idempotency-Key: k\r\n", "100 Continue"); /* it may have been accepted before */
    kit_remove(&d);
    d = first;
}

static void with_a_key_it_is_done_once(void **state) {
    (void)state;
    static const char keyed[] = "Idempotency-Key: k";
    char first[32], again[32];
    kit_take_id(send("?complex=bc&scale=2", keyed, "# once\n"), first);
    kit_take_id(send("?scale=2&complex=bc", keyed, "# once\n"), again); /* the order says nothing */
    assert_string_equal(first, again);
    refused("?complex=mc&scale=2", keyed, "# once\n", 422, "key-reused");
    refused("?complex=bc&scale=2", keyed, "# twice\n", 422, "key-reused");
}

/* As often as the connection breaks, at any byte: there is no job, and nothing stays. */
static void a_connection_that_breaks_leaves_nothing(void **state) {
    (void)state;
    static const char text[] = "POST /v1/jobs?complex=bc HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 30\r\n\r\n# thirty bytes if it is whole\n";
    size_t before = kit_listed(&d, "limit=200");
    for (size_t n = 1; n < sizeof text - 1; n++) kit_abandon(&d, text, n);
    assert_true(kit_no_uploads(&d, 5000));
    assert_int_equal(kit_listed(&d, "limit=200"), before);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_body_is_the_input_and_the_query_its_description),
        cmocka_unit_test(mistakes_of_the_query_are_told_with_their_names),
        cmocka_unit_test(limits_of_uploads_hold),
        cmocka_unit_test(one_job_too_many_is_told_before_the_body),
        cmocka_unit_test(with_a_key_it_is_done_once),
        cmocka_unit_test(a_connection_that_breaks_leaves_nothing),
    };
    return cmocka_run_group_tests_name("streamed jobs", tests, start, stop);
}
