/* /readyz and /metrics of a running daemon, and the log lines of requests. */
#include "daemon_kit.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "prometheus.h"

static kit_daemon d;
static bool mounted;

static void start(const char *const *arguments) { kit_start(&d, NULL, arguments); }

static int remove_daemon(void **state) {
    (void)state;
    if (d.pid) kit_kill(&d, SIGKILL);
    if (mounted) umount2(d.data, MNT_DETACH);
    mounted = false;
    if (*d.data) kit_remove(&d);
    memset(&d, 0, sizeof d);
    return 0;
}

/* The status of a check, and of the whole in *http. */
static void check_of(const char *name, long *http, char status[16], char detail[300]) {
    kit_reply r = kit_get(&d, "/readyz");
    *http = r.status;
    json_t *body = kit_json(&r), *check = json_object_get(json_object_get(body, "checks"), name);
    snprintf(status, 16, "%s", kit_text(check, "status"));
    snprintf(detail, 300, "%s", kit_text(check, "detail"));
    json_decref(body);
}

static void expect_verdict(const char *name, const char *status, long http) {
    char got[16], detail[300];
    long code;
    for (int i = 0; i < 500; i++, kit_sleep_ms(20)) {
        check_of(name, &code, got, detail);
        if (strcmp(got, status) == 0 && code == http) return;
    }
    fail_msg("%s is %s and the answer %ld, not %s and %ld: %s", name, got, code, status, http, detail);
}

static char *metrics(void) {
    kit_reply r = kit_get(&d, "/metrics");
    assert_int_equal(r.status, 200);
    assert_non_null(strstr(r.type, "text/plain; version=0.0.4"));
    prometheus_check(r.body);
    return r.body;
}

static double metric(const char *series) {
    char *text = metrics();
    double value = prometheus_value(text, series);
    free(text);
    return value;
}

/* ---- /readyz ---- */

static void a_healthy_daemon_says_ok_to_everything_and_has_measured_the_disk(void **state) {
    (void)state;
    start((const char *const[]){"--probe-interval", "100ms", NULL});
    static const char *const names[] = {"queue", "queue_age", "dispatcher", "worker", "disk", "fsync"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char status[16], detail[300];
        long http;
        check_of(names[i], &http, status, detail);
        assert_int_equal(http, 200);
        if (strcmp(status, "ok") != 0 && strcmp(names[i], "fsync") != 0) fail_msg("%s: %s", names[i], detail); /* the disk may be slow today */
        assert_true(*detail);
    }
    double before = metric("blockwright_fsync_seconds_count");
    for (int i = 0; i < 500 && metric("blockwright_fsync_seconds_count") < before + 3; i++) kit_sleep_ms(20);
    assert_true(metric("blockwright_fsync_seconds_count") >= before + 3);
    assert_true(metric("blockwright_ready") == 1);
}

static void limits_of_the_disk_are_settings(void **state) {
    (void)state;
    start((const char *const[]){"--ready-disk-warn", "1000T", NULL});
    expect_verdict("disk", "warn", 200);
    kit_remove(&d);
    start((const char *const[]){"--ready-disk-fail", "1000T", "--ready-fsync-warn", "1ms", NULL});
    expect_verdict("disk", "fail", 503);
    assert_true(metric("blockwright_ready") == 0);
    kit_expect_problem(kit_get(&d, "/readyz"), 503, "not-ready");
}

static void a_queue_that_does_not_move_is_told(void **state) {
    char id[32];
    (void)state;
    start((const char *const[]){"--workers", "1", "--ready-queue-warn", "1s", "--ready-queue-fail", "2s", NULL});
    kit_submit(&d, "sanitize sleep 60000\n", NULL, id);
    kit_wait_state(&d, id, "running", 10);
    expect_verdict("queue_age", "ok", 200);
    kit_submit(&d, "# waits\n", NULL, id);
    expect_verdict("queue_age", "warn", 200);
    expect_verdict("queue_age", "fail", 503);
    assert_true(metric("blockwright_queue_oldest_seconds") >= 2);
    assert_true(metric("blockwright_jobs{state=\"waiting\"}") == 1);
    assert_true(metric("blockwright_jobs{state=\"running\"}") == 1);
}

static void a_worker_that_is_gone_is_told(void **state) {
    char copy[200], command[500];
    (void)state;
    snprintf(copy, sizeof copy, "/tmp/bw-test-worker-%d", (int)getpid());
    snprintf(command, sizeof command, "cp %s/blockwright-test-worker %s", BW_BIN_DIR, copy);
    assert_int_equal(system(command), 0);
    kit_start(&d, copy, NULL);
    expect_verdict("worker", "ok", 200);
    unlink(copy);
    expect_verdict("worker", "fail", 503);
}

/* A data folder of its own file system. Skips, visibly, where that cannot be had. */
static void start_on_small_disk(const char *const *arguments) {
    memset(&d, 0, sizeof d);
    snprintf(d.data, sizeof d.data, "/tmp/bw-test-XXXXXX");
    assert_non_null(mkdtemp(d.data));
    mounted = mount("none", d.data, "tmpfs", 0, "size=16m") == 0;
    if (!mounted) {
        print_message("SKIP: cannot mount a tmpfs: %s\n", strerror(errno));
        skip();
    }
    kit_restart(&d, arguments);
}

static const char *const small_disk[] = {"--probe-interval", "100ms", "--ready-disk-fail", "1K", "--ready-disk-warn", "1K", NULL};

static void a_full_disk_is_told_and_forgotten_when_there_is_room_again(void **state) {
    char path[120], block[65536] = {0};
    (void)state;
    start_on_small_disk(small_disk);
    expect_verdict("disk", "ok", 200);
    snprintf(path, sizeof path, "%s/filler", d.data);
    int fd = open(path, O_WRONLY | O_CREAT, 0600);
    while (write(fd, block, sizeof block) > 0) continue;
    close(fd);
    expect_verdict("disk", "fail", 503);
    unlink(path);
    expect_verdict("disk", "ok", 200);
}

static void a_data_folder_that_cannot_be_written_is_told(void **state) {
    char path[120];
    (void)state;
    start_on_small_disk(small_disk);
    expect_verdict("fsync", "ok", 200);
    snprintf(path, sizeof path, "%s/tmp", d.data);
    char moved[130];
    snprintf(moved, sizeof moved, "%s.away", path);
    assert_int_equal(rename(path, moved), 0); /* root may write where it says read-only, but not where nothing is */
    expect_verdict("fsync", "fail", 503);
    assert_int_equal(rename(moved, path), 0);
    expect_verdict("fsync", "ok", 200);
}

/* Starts with a disk that goes wrong for the probe's file. */
static void start_with_shim(const char *what, const char *const *arguments) {
    char rules[120];
    snprintf(rules, sizeof rules, "call=fdatasync,path=*/tmp/probe,times=0,do=%s", what);
    kit_shim(rules);
    start(arguments);
    kit_shim(NULL);
}

static void a_slow_disk_is_warned_of_and_one_that_does_not_answer_is_not_ready(void **state) {
    (void)state;
    start_with_shim("delay:60", (const char *const[]){"--probe-interval", "50ms", "--ready-fsync-warn", "50ms", NULL});
    expect_verdict("fsync", "warn", 200);
    kit_remove(&d);
    start_with_shim("delay:3000", (const char *const[]){"--ready-fsync-fail", "300ms", NULL});
    expect_verdict("fsync", "fail", 503);
    char status[16], detail[300];
    long http;
    check_of("fsync", &http, status, detail);
    assert_non_null(strstr(detail, "has not answered"));
}

/* Only the first sync is slow; some 60 follow. */
static void a_slow_sync_is_warned_of_however_many_were_fast_since(void **state) {
    (void)state;
    start_with_shim("delay:3000,times=1", (const char *const[]){"--probe-interval", "50ms", "--ready-fsync-warn", "2900ms", NULL});
    expect_verdict("fsync", "warn", 200);
    double before = metric("blockwright_fsync_seconds_count");
    for (int i = 0; i < 1000 && metric("blockwright_fsync_seconds_count") < before + 60; i++) kit_sleep_ms(20);
    assert_true(metric("blockwright_fsync_seconds_count") >= before + 60);
    char status[16], detail[300];
    long http;
    check_of("fsync", &http, status, detail);
    assert_string_equal(status, "warn");
}

/* A sync that takes ten minutes; the daemon has one to stop in. */
static void a_disk_that_does_not_answer_holds_up_no_stop(void **state) {
    (void)state;
    int status = -1;
    start_with_shim("delay:600000", (const char *const[]){"--ready-fsync-fail", "100ms", NULL});
    expect_verdict("fsync", "fail", 503);
    kill(d.pid, SIGTERM);
    for (int i = 0; i < 600 && waitpid(d.pid, &status, WNOHANG) == 0; i++) kit_sleep_ms(100);
    if (status == -1) kit_kill(&d, SIGKILL);
    d.pid = 0;
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    char command[200];
    snprintf(command, sizeof command, "grep -q disk.probe_left %s.log && grep -q daemon.stopped %s.log", d.data, d.data);
    assert_int_equal(system(command), 0);
    kit_restart(&d, NULL);
    expect_verdict("fsync", "ok", 200);
}

static void a_sync_that_fails_for_the_probe_is_told_and_ends_nothing(void **state) {
    char id[32];
    (void)state;
    start_with_shim("EIO", (const char *const[]){"--probe-interval", "50ms", NULL});
    expect_verdict("fsync", "fail", 503);
    kit_submit(&d, "# good\n", NULL, id);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
}

/* ---- /metrics ---- */

static void jobs_and_stages_are_counted(void **state) {
    char id[32];
    (void)state;
    start((const char *const[]){"--workers", "2", NULL});
    kit_submit(&d, "# good\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_submit(&d, "# good\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_submit(&d, "trace fail inverted\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_submit(&d, "sanitize sleep 60000\n", NULL, id);
    kit_wait_state(&d, id, "running", 10);
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    kit_free(&r);
    json_decref(kit_wait(&d, id, 20));
    char *text = metrics();
    static const struct {
        const char *series;
        double value;
    } expected[] = {
        {"blockwright_jobs_accepted_total", 4},
        {"blockwright_jobs_ended_total{state=\"successful\"}", 2},
        {"blockwright_jobs_ended_total{state=\"failed\"}", 1},
        {"blockwright_jobs_ended_total{state=\"dismissed\"}", 1},
        {"blockwright_jobs{state=\"ended\"}", 4},
        {"blockwright_jobs{state=\"waiting\"}", 0},
        {"blockwright_stage_claims_total{stage=\"sanitize\"}", 3},
        {"blockwright_stage_claims_total{stage=\"encode\"}", 1},
        {"blockwright_cache_hits_total{stage=\"sanitize\"}", 1},
        {"blockwright_cache_hits_total{stage=\"encode\"}", 1},
        {"blockwright_cache_misses_total{stage=\"sanitize\"}", 3},
        {"blockwright_stage_seconds_count{stage=\"trace\"}", 2},
        {"blockwright_failures_total{problem=\"inverted\"}", 1},
        {"blockwright_http_requests_total{operation=\"job_cancel\",class=\"2xx\"}", 1},
        {"blockwright_http_requests_total{operation=\"job_create\",class=\"2xx\"}", 4},
        {"blockwright_queue_wait_seconds_count", 3},
        {"blockwright_workers", 2},
    };
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++)
        if (prometheus_value(text, expected[i].series) != expected[i].value)
            fail_msg("%s is %g, not %g", expected[i].series, prometheus_value(text, expected[i].series), expected[i].value);
    assert_true(prometheus_value(text, "blockwright_stage_peak_bytes_sum{stage=\"sanitize\"}") > 100000);
    assert_true(prometheus_value(text, "blockwright_cache_written_bytes_total") > 1000);
    assert_true(prometheus_value(text, "blockwright_upload_bytes_total") > 20);
    assert_true(prometheus_value(text, "blockwright_commit_seconds_count") > 4);
    free(text);
}

static void requests_that_go_wrong_are_counted_too(void **state) {
    (void)state;
    start(NULL);
    kit_expect_problem(kit_get(&d, "/no/such/address"), 404, "not-found");
    kit_expect_problem(kit_get(&d, "/v1/jobs/%024d", 0), 404, "no-such-job");
    static const char cut_off[] = "PUT /v1/blobs/0000000000000000000000000000000000000000000000000000000000000000 HTTP/1.1\r\nHost: x\r\n"
                                  "Content-Length: 1000\r\n\r\nabc";
    free(kit_raw(&d, cut_off, sizeof cut_off - 1, true));
    char *text = metrics();
    assert_true(prometheus_value(text, "blockwright_http_requests_total{operation=\"none\",class=\"4xx\"}") == 1);
    assert_true(prometheus_value(text, "blockwright_http_requests_total{operation=\"job_get\",class=\"4xx\"}") == 1);
    assert_true(prometheus_value(text, "blockwright_http_requests_active") >= 1); /* this one */
    free(text);
}

/* ---- the log ---- */

static void every_request_has_a_line_and_no_line_has_a_secret(void **state) {
    static const char secrets[] = "Authorization: Bearer hush-token\nCookie: hush-cookie\nContent-Type: application/json";
    char path[96];
    (void)state;
    start((const char *const[]){"--log-level", "debug", NULL});
    kit_reply r = kit_request(&d, "GET", "/v1/jobs?limit=7&cursor=424242", secrets, NULL, 0);
    kit_free(&r);
    r = kit_request(&d, "POST", "/v1/jobs", secrets, "{\"name\":\"hush-name\"}", 20);
    kit_free(&r);
    r = kit_request(&d, "GET", "/v1/hush-path", secrets, NULL, 0);
    kit_free(&r);
    assert_int_equal(kit_stop(&d), 0);
    snprintf(path, sizeof path, "%s.log", d.data);
    FILE *f = fopen(path, "r");
    char *text = calloc(1, 1 << 20);
    assert_true(fread(text, 1, (1 << 20) - 1, f) > 0);
    fclose(f);
    assert_non_null(strstr(text, "event=http.request method=GET path=/v1/jobs status=200 owner=\"\" received=0 sent="));
    assert_non_null(strstr(text, "event=http.request method=POST path=/v1/jobs status=400"));
    assert_non_null(strstr(text, "event=http.request method=- path=- status=404"));
    assert_null(strstr(text, "hush"));
    assert_null(strstr(text, "424242"));
    free(text);
}

static void which_requests_are_logged_is_a_setting(void **state) {
    (void)state;
    start((const char *const[]){"--log-requests", "failed", NULL});
    kit_reply r = kit_get(&d, "/livez");
    kit_free(&r);
    assert_int_equal(kit_stop(&d), 0);
    char command[200];
    snprintf(command, sizeof command, "grep -q http.request %s.log", d.data);
    assert_int_not_equal(system(command), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(a_healthy_daemon_says_ok_to_everything_and_has_measured_the_disk, remove_daemon),
        cmocka_unit_test_teardown(limits_of_the_disk_are_settings, remove_daemon),
        cmocka_unit_test_teardown(a_queue_that_does_not_move_is_told, remove_daemon),
        cmocka_unit_test_teardown(a_worker_that_is_gone_is_told, remove_daemon),
        cmocka_unit_test_teardown(a_full_disk_is_told_and_forgotten_when_there_is_room_again, remove_daemon),
        cmocka_unit_test_teardown(a_data_folder_that_cannot_be_written_is_told, remove_daemon),
        cmocka_unit_test_teardown(a_slow_disk_is_warned_of_and_one_that_does_not_answer_is_not_ready, remove_daemon),
        cmocka_unit_test_teardown(a_slow_sync_is_warned_of_however_many_were_fast_since, remove_daemon),
        cmocka_unit_test_teardown(a_disk_that_does_not_answer_holds_up_no_stop, remove_daemon),
        cmocka_unit_test_teardown(a_sync_that_fails_for_the_probe_is_told_and_ends_nothing, remove_daemon),
        cmocka_unit_test_teardown(jobs_and_stages_are_counted, remove_daemon),
        cmocka_unit_test_teardown(requests_that_go_wrong_are_counted_too, remove_daemon),
        cmocka_unit_test_teardown(every_request_has_a_line_and_no_line_has_a_secret, remove_daemon),
        cmocka_unit_test_teardown(which_requests_are_logged_is_a_setting, remove_daemon),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
