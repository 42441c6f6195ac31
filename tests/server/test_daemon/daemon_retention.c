/* Retention, backup and restore of the running daemon, through its commands and its interface. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "access_kit.h"
#include "daemon_kit.h"
#include "server/files.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "2", "--keep-finished", "1s", "--keep-failed", "1s", "--keep-uploads", "1s",
                                              "--retention-interval", "1h", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static json_t *run_json(const char *words) {
    char command[400];
    snprintf(command, sizeof command, "%s/blockwrightd %s --json --data %s 2>>%s.log", BW_BIN_DIR, words, d.data, d.data);
    FILE *f = popen(command, "r");
    json_t *answer = json_loadf(f, 0, NULL);
    assert_int_equal(pclose(f), 0);
    assert_non_null(answer);
    return answer;
}

static json_int_t collected(const char *words, const char *kind) {
    json_t *answer = run_json(words);
    json_int_t n = json_integer_value(json_object_get(json_object_get(json_object_get(answer, "collected"), kind), "count"));
    json_decref(answer);
    return n;
}

static void expect(const char *method, const char *format, const char *id, long status) {
    char path[120];
    snprintf(path, sizeof path, format, id);
    kit_reply r = kit_request(&d, method, path, NULL, NULL, 0);
    if (r.status != status) fail_msg("%s %s: expected %ld, got %ld: %s", method, path, status, r.status, r.body);
    kit_free(&r);
}

static bool is_pinned(const char *id) {
    json_t *job = kit_job(&d, id);
    bool pinned = json_is_true(json_object_get(job, "pinned"));
    json_decref(job);
    return pinned;
}

static void an_old_job_is_gone_by_every_verb_and_a_pinned_one_stays(void **state) {
    static const char *const all[][2] = {{"GET", "/v1/jobs/%s"}, {"GET", "/v1/jobs/%s/results"}, {"GET", "/v1/jobs/%s/results/script.txt"},
                                         {"GET", "/v1/jobs/%s/report"}, {"GET", "/v1/jobs/%s/log"}, {"GET", "/v1/jobs/%s/events"},
                                         {"POST", "/v1/jobs/%s/cancel"}, {"POST", "/v1/jobs/%s/finish"}, {"POST", "/v1/jobs/%s/retry"},
                                         {"PUT", "/v1/jobs/%s/pin"}, {"DELETE", "/v1/jobs/%s/pin"}, {"DELETE", "/v1/jobs/%s"}};
    char old[32], kept[32], hash[BW_SHA256_TEXT], path[120];
    (void)state;
    kit_submit(&d, "# goes\n", NULL, old);
    kit_submit(&d, "# stays\n", NULL, kept);
    expect("PUT", "/v1/jobs/%s/pin", kept, 200);
    expect("PUT", "/v1/jobs/%s/pin", kept, 200);
    assert_true(is_pinned(kept));
    assert_false(is_pinned(old));
    json_decref(kit_wait(&d, old, 60));
    json_decref(kit_wait(&d, kept, 60));
    kit_sleep_ms(1500); /* what is asked for is an age of 1 s */
    assert_int_equal(collected("gc --dry-run", "jobs"), 1);
    expect("GET", "/v1/jobs/%s", old, 200);
    assert_int_equal(collected("gc", "jobs"), 1);
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) expect(all[i][0], all[i][1], old, 410);
    kit_hash("# goes\n", 7, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    expect("HEAD", path, "", 404);
    expect("GET", "/v1/jobs/%s/results", kept, 200);
    kit_hash("# stays\n", 8, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    expect("HEAD", path, "", 200);
    expect("DELETE", "/v1/jobs/%s/pin", kept, 200);
    assert_int_equal(collected("gc", "jobs"), 1);
    expect("GET", "/v1/jobs/%s", kept, 410);
}

static void what_was_evicted_is_made_again(void **state) {
    char first[32], second[32];
    (void)state;
    kit_submit(&d, "# evicted\n", NULL, first);
    json_decref(kit_wait(&d, first, 60));
    kit_stop(&d);
    kit_restart(&d, (const char *const[]){"--workers", "2", "--cache-size", "1", "--keep-finished", "1s", NULL});
    kit_sleep_ms(1500);
    collected("gc", "jobs");
    json_t *state_now = run_json("gc --dry-run");
    assert_int_equal(json_integer_value(json_object_get(state_now, "cache_bytes")), 0);
    json_decref(state_now);
    kit_submit(&d, "# evicted\n", NULL, second);
    json_t *job = kit_wait(&d, second, 60);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_false(json_is_true(json_object_get(json_array_get(json_object_get(job, "attempts"), 0), "reused")));
    expect("GET", "/v1/jobs/%s/results", second, 200); /* a kept job's, beyond the limit */
    json_decref(job);
}

static void a_restored_daemon_goes_on_where_the_copy_was_made(void **state) {
    char ended[32], waits[32], words[200], line[300], file[100];
    kit_daemon restored = {.worker = d.worker};
    (void)state;
    snprintf(file, sizeof file, "%s.backup", d.data);
    kit_submit(&d, "# kept\n", NULL, ended);
    json_decref(kit_wait(&d, ended, 60));
    kit_submit(&d, "sanitize sleep 1000\n", NULL, waits);
    snprintf(words, sizeof words, "backup %s --with-files", file);
    assert_int_equal(kit_blockwrightd(&d, words, line, sizeof line), 0);
    assert_int_equal(kit_blockwrightd(&d, words, line, sizeof line), 5); /* it is there already */
    kit_stop(&d);
    snprintf(restored.data, sizeof restored.data, "%.40s.new", d.data);
    snprintf(words, sizeof words, "restore %s", file);
    assert_int_equal(kit_blockwrightd(&restored, words, line, sizeof line), 0);
    assert_int_equal(kit_blockwrightd(&restored, words, line, sizeof line), 5); /* not empty */
    kit_restart(&restored, (const char *const[]){"--workers", "2", NULL});
    kit_daemon before = d;
    d = restored;
    expect("GET", "/v1/jobs/%s/results/script.txt", ended, 200);
    json_t *job = kit_wait(&d, waits, 60);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
    kit_remove(&d);
    d = before;
    unlink(file);
    snprintf(line, sizeof line, "%s.manifest", file);
    unlink(line);
    snprintf(line, sizeof line, "%s.files", file);
    bw_remove_tree(line);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(an_old_job_is_gone_by_every_verb_and_a_pinned_one_stays, start, stop),
        cmocka_unit_test_setup_teardown(what_was_evicted_is_made_again, start, stop),
        cmocka_unit_test_setup_teardown(a_restored_daemon_goes_on_where_the_copy_was_made, start, stop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
