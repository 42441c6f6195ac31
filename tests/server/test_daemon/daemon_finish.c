/* Settling for the best found: what a search has found so far is seen while it runs; a finish ends the search and not the job, is kept
 * through the daemon's death, and what was cut is served to nobody else. With a scripted worker, and with the real one. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon_kit.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, NULL);
    return 0;
}

static int start_real(void **state) {
    (void)state;
    kit_start(&d, BW_BIN_DIR "/blockwright-worker", NULL);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply post_finish(const char *id) {
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/finish", id);
    return kit_request(&d, "POST", path, NULL, NULL, 0);
}

static void finish(const char *id) {
    kit_reply r = post_finish(id);
    assert_int_equal(r.status, 200);
    json_t *job = kit_json(&r);
    assert_true(json_is_true(json_object_get(job, "finishing")));
    json_decref(job);
}

static void wait_for_note(const char *id, const char *start) {
    for (int i = 0; i < 6000; i++) {
        json_t *job = kit_job(&d, id);
        bool there = strncmp(kit_text(job, "note"), start, strlen(start)) == 0, ended = json_object_get(job, "finished") != NULL;
        if (ended) fail_msg("no note was seen: %s", json_dumps(job, 0));
        json_decref(job);
        if (there) return;
        kit_sleep_ms(10);
    }
    fail_msg("no note");
}

static void expect_success(const char *id) {
    json_t *job = kit_wait(&d, id, 120);
    if (strcmp(kit_text(job, "state"), "successful") != 0) fail_msg("%s", json_dumps(job, 0));
    assert_null(json_object_get(job, "finishing"));
    assert_null(json_object_get(job, "note"));
    json_decref(job);
    kit_expect_problem(post_finish(id), 409, "job-finished");
}

/* Whether the search of a scripted job was cut, by what its results say. */
static bool was_cut(const char *id) {
    expect_success(id);
    kit_reply r = kit_get(&d, "/v1/jobs/%s/results/script.txt", id);
    assert_int_equal(r.status, 200);
    bool cut = strstr(r.body, "# cut") != NULL;
    kit_free(&r);
    return cut;
}

static size_t reused(const char *id) {
    json_t *job = kit_job(&d, id), *attempt;
    size_t i, n = 0;
    json_array_foreach(json_object_get(job, "attempts"), i, attempt) n += json_is_true(json_object_get(attempt, "reused"));
    json_decref(job);
    return n;
}

static void a_search_ends_with_the_best_found_and_nobody_else_is_served_it(void **state) {
    (void)state;
    static const char script[] = "trace search 1400\n";
    char id[32], other[32], third[32];
    kit_submit(&d, script, NULL, id);
    wait_for_note(id, "best 9");
    json_t *job = kit_job(&d, id);
    const char *note = kit_text(job, "note");
    assert_true(!*note || !strcmp(note + strlen(note) - 2, "??")); /* what is no text does not get through */
    json_decref(job);
    finish(id);
    assert_true(was_cut(id));
    kit_submit(&d, script, NULL, other);
    assert_false(was_cut(other));
    assert_int_equal(reused(other), 1); /* what came before the cut */
    kit_submit(&d, script, NULL, third);
    assert_false(was_cut(third));
    assert_true(reused(third) > 1); /* what was not cut is for all */
    assert_true(was_cut(id));
}

/* The running stage does not search: it is left alone, and its output is for all. The next one searches and ends at once. */
static void a_finish_that_comes_early_cuts_the_search_that_follows(void **state) {
    (void)state;
    static const char script[] = "sanitize sleep 300\ntrace search 1450\n";
    char id[32], other[32];
    kit_submit(&d, script, NULL, id);
    kit_wait_state(&d, id, "running", 10);
    finish(id);
    finish(id);
    assert_true(was_cut(id));
    kit_submit(&d, script, NULL, other);
    assert_false(was_cut(other));
    assert_int_equal(reused(other), 1);
}

static void a_job_without_a_search_is_not_touched(void **state) {
    (void)state;
    static const char script[] = "build sleep 300\n# no search\n";
    char id[32], other[32];
    kit_submit(&d, script, NULL, id);
    finish(id);
    assert_false(was_cut(id));
    kit_submit(&d, script, NULL, other);
    assert_false(was_cut(other));
    json_t *job = kit_job(&d, other);
    assert_int_equal(reused(other), json_integer_value(json_object_get(job, "stage_count")));
    json_decref(job);
}

static void a_finish_outlives_the_daemon(void **state) {
    (void)state;
    static const char script[] = "sanitize sleep 500\nreduce search 1490\n";
    char id[32];
    kit_submit(&d, script, NULL, id);
    kit_wait_state(&d, id, "running", 10);
    finish(id);
    kit_kill(&d, SIGKILL);
    kit_restart(&d, NULL);
    assert_true(was_cut(id));
}

static char *sample_text(void) {
    char command[300], *text = NULL;
    size_t size = 0, n;
    static char buffer[1 << 16];
    snprintf(command, sizeof command, "%s/blockwright sample bearing --size 2 -o %s/bearing.hexex >/dev/null 2>&1 && cat %s/bearing.hexex",
             BW_BIN_DIR, d.data, d.data);
    FILE *pipe = popen(command, "r");
    assert_non_null(pipe);
    while ((n = fread(buffer, 1, sizeof buffer, pipe)) > 0) {
        text = realloc(text, size + n + 1);
        assert_non_null(text);
        memcpy(text + size, buffer, n);
        text[size += n] = '\0';
    }
    assert_int_equal(pclose(pipe), 0);
    assert_true(size > 0);
    return text;
}

/* Until the search has been cut; then what its job reports. */
static void finish_real(const char *id) {
    wait_for_note(id, "best ");
    finish(id);
    expect_success(id);
    kit_reply r = kit_get(&d, "/v1/jobs/%s/report", id);
    assert_int_equal(r.status, 200);
    json_t *report = kit_json(&r), *e = json_object_get(report, "exploration");
    assert_string_equal(kit_text(e, "cut"), "finish");
    assert_true(json_number_value(json_object_get(e, "best")) <= json_number_value(json_object_get(e, "start")));
    json_decref(report);
    r = kit_get(&d, "/v1/jobs/%s/log", id);
    assert_true(r.status == 200 && strstr(r.body, " best "));
    kit_free(&r);
}

static void a_real_exploration_is_finished_and_its_twin_searches_itself(void **state) {
    (void)state;
    static const char options[] = "{\"explore\":\"anneal\",\"explore_work\":1000000000,\"explore_time\":3000}";
    char *text = sample_text(), id[32], twin[32];
    kit_submit(&d, text, options, id);
    finish_real(id);
    kit_submit(&d, text, options, twin);
    finish_real(twin); /* had it been served the first one's, there would be no note */
    free(text);
}

int main(void) {
    const struct CMUnitTest scripted[] = {
        cmocka_unit_test(a_search_ends_with_the_best_found_and_nobody_else_is_served_it),
        cmocka_unit_test(a_finish_that_comes_early_cuts_the_search_that_follows),
        cmocka_unit_test(a_job_without_a_search_is_not_touched),
        cmocka_unit_test(a_finish_outlives_the_daemon),
    };
    const struct CMUnitTest real[] = {cmocka_unit_test(a_real_exploration_is_finished_and_its_twin_searches_itself)};
    int failed = cmocka_run_group_tests(scripted, start, stop);
    return failed + cmocka_run_group_tests(real, start_real, stop);
}
