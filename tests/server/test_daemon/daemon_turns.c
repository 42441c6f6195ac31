/* Owners take turns: with a thousand jobs of one and one of another, the other's starts next; one that has reached its limits is in
 * nobody's way. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon_kit.h"

enum { MANY = 1000 };

static kit_daemon d;
static char ada[200], bob[200]; /* headers of the two */

/* What `blockwrightd token create` prints, as headers of a request for a job. */
static void make_token(const char *owner, char headers[200]) {
    char command[400], secret[120] = "";
    snprintf(command, sizeof command, "%s/blockwrightd token create --owner %s --data %s 2>>%s.log", BW_BIN_DIR, owner, d.data, d.data);
    FILE *f = popen(command, "r");
    assert_non_null(f);
    assert_non_null(fgets(secret, sizeof secret, f));
    assert_int_equal(pclose(f), 0);
    secret[strcspn(secret, "\n")] = '\0';
    snprintf(headers, 200, "Authorization: Bearer %s\nContent-Type: application/json", secret);
}

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "1", "--owner-jobs", "1000", NULL});
    make_token("ada", ada);
    make_token("bob", bob);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static void upload(const char *headers, const char *content, char hash[BW_SHA256_TEXT]) {
    char path[100];
    kit_hash(content, strlen(content), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(&d, "PUT", path, headers, content, strlen(content));
    assert_int_equal(r.status, 201);
    kit_free(&r);
}

static json_t *get(const char *headers, const char *path) {
    kit_reply r = kit_request(&d, "GET", path, headers, NULL, 0);
    assert_int_equal(r.status, 200);
    return kit_json(&r);
}

static json_t *list(const char *headers, const char *query) {
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs?%s", query);
    json_t *page = get(headers, path), *jobs = json_incref(json_object_get(page, "jobs"));
    json_decref(page);
    return jobs;
}

/* Every job makes something else of the same input, so that none can use what another has made. */
static void queue_many(const char *headers, const char *hash, int jobs) {
    char *body = malloc(200 * (size_t)jobs + 100);
    size_t n = (size_t)sprintf(body, "{\"jobs\": [");
    for (int i = 0; i < jobs; i++)
        n += (size_t)sprintf(body + n, "%s{\"input\": \"%s\", \"options\": {\"until\": \"sanitize\", \"tolerance\": %g}}", i ? "," : "", hash,
                             1e-6 * (i + 1));
    n += (size_t)sprintf(body + n, "]}");
    kit_reply r = kit_request(&d, "POST", "/v1/batches", headers, body, n);
    assert_int_equal(r.status, 201);
    kit_free(&r);
    free(body);
}

static void queue_same(const char *headers, const char *hash, int jobs) {
    char *body = malloc(200 * (size_t)jobs + 100);
    size_t n = (size_t)sprintf(body, "{\"jobs\": [");
    for (int i = 0; i < jobs; i++)
        n += (size_t)sprintf(body + n, "%s{\"input\": \"%s\", \"options\": {\"until\": \"sanitize\"}}", i ? "," : "", hash);
    n += (size_t)sprintf(body + n, "]}");
    kit_reply r = kit_request(&d, "POST", "/v1/batches", headers, body, n);
    assert_int_equal(r.status, 201);
    kit_free(&r);
    free(body);
}

static void wait_for_one(const char *headers, const char *query) {
    for (int i = 0; i < 400; i++, kit_sleep_ms(25)) {
        json_t *jobs = list(headers, query);
        size_t n = json_array_size(jobs);
        json_decref(jobs);
        if (n) return;
    }
    fail_msg("no job of %s", query);
}

static void the_one_job_of_another_starts_next(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], body[200];
    upload(ada, "sanitize sleep 800\n", hash);
    queue_many(ada, hash, MANY);
    wait_for_one(ada, "state=running");
    int n = snprintf(body, sizeof body, "{\"input\": \"%s\"}", hash);
    kit_expect_problem(kit_request(&d, "POST", "/v1/jobs", ada, body, (size_t)n), 429, "too-many-jobs");
    upload(bob, "sanitize sleep 10\n# bob's\n", hash);
    n = snprintf(body, sizeof body, "{\"input\": \"%s\", \"priority\": -100, \"options\": {\"until\": \"sanitize\"}}", hash);
    kit_reply r = kit_request(&d, "POST", "/v1/jobs", bob, body, (size_t)n);
    assert_int_equal(r.status, 201);
    kit_free(&r);
    wait_for_one(bob, "state=successful");
    json_t *of_bob = list(bob, "limit=9"), *job = json_array_get(of_bob, 0), *other;
    const char *created = kit_text(job, "created"), *started = kit_text(job, "started");
    size_t i, before = 0;
    for (int running = 0; running < 2; running++) {
        json_t *of_ada = list(ada, running ? "state=running" : "state=successful");
        json_array_foreach(of_ada, i, other) {
            before += strcmp(kit_text(other, "started"), created) < 0;
            if (strcmp(kit_text(other, "started"), created) > 0 && strcmp(kit_text(other, "started"), started) < 0)
                fail_msg("ada's %s started at %s, between %s and %s", kit_text(other, "id"), kit_text(other, "started"), created, started);
        }
        json_decref(of_ada);
    }
    assert_true(before >= 1);
    assert_int_equal(json_array_size(of_bob), 1);
    json_decref(of_bob);
}

static int ended_since_the_drain(void) {
    char path[300], line[4096];
    int n = -1;
    snprintf(path, sizeof path, "%s.log", d.data);
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    while (fgets(line, sizeof line, f)) {
        if (strstr(line, "daemon.draining")) n = 0;
        else if (n >= 0) n += strstr(line, "event=job.successful") != NULL;
    }
    fclose(f);
    return n;
}

/* Jobs that need no worker keep the dispatcher from nothing else. */
static void a_stop_does_not_wait_for_all_that_is_in_the_cache(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT];
    upload(ada, "sanitize sleep 10\n", hash);
    queue_same(ada, hash, 1);
    wait_for_one(ada, "state=successful");
    queue_same(ada, hash, MANY);
    wait_for_one(ada, "state=successful");
    assert_int_equal(kit_stop(&d), 0);
    int n = ended_since_the_drain();
    assert_in_range(n, 0, 2); /* the one that was on its way */
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(the_one_job_of_another_starts_next, start, stop),
        cmocka_unit_test_setup_teardown(a_stop_does_not_wait_for_all_that_is_in_the_cache, start, stop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
