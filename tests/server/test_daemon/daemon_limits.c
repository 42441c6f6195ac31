/* Workers that take more than they may or do what they must not: each is stopped and told why, and neither the daemon nor a job beside
 * it notices. Prints a line of figures for each (tests/server/limits.sh). */
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "bw_api.h"
#include "daemon_kit.h"

static kit_daemon d;
static const char *const settings[] = {"--stage-memory", "128M", "--stage-cpu-seconds", "2", "--stage-wall-seconds", "12", "--stage-output", "2M",
                                       "--stage-scratch", "8M", "--workers", "2", "--cancel-grace", "1", NULL};
static bool seccomp, landlock, address_space;

static json_t *limits_of(const kit_daemon *daemon) {
    kit_reply r = kit_get(daemon, "/readyz");
    json_t *ready = kit_json(&r), *limits = json_incref(json_object_get(ready, "limits"));
    json_decref(ready);
    return limits;
}

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, settings);
    json_t *limits = limits_of(&d);
    seccomp = json_is_true(json_object_get(limits, "seccomp"));
    landlock = json_integer_value(json_object_get(limits, "landlock")) > 0;
    address_space = json_is_true(json_object_get(limits, "address_space"));
    if (*kit_text(limits, "missing")) print_message("not in force here: %s\n", kit_text(limits, "missing"));
    print_message("%-34s %-18s %-9s %-24s %7s  %s\n", "the worker's stage", "problem", "class", "limit", "ms", "job beside it");
    json_decref(limits);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static long now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

static bool log_has(const char *id, const char *text) {
    kit_reply log = kit_get(&d, "/v1/jobs/%s/log", id);
    bool has = strstr(log.body, text) != NULL;
    kit_free(&log);
    return has;
}

/* The job's trace does `act` while another job works; it ends with this failure in its first attempt, for `what` ("": no limit). */
static void expect_stopped(const char *act, const char *code, const char *class_, const char *what, json_int_t allowed, const char *said) {
    static int number;
    char script[300], beside[100], id[32], other[32], type[80], limit[60] = "-";
    snprintf(beside, sizeof beside, "sanitize sleep 300\n# beside %d\n", ++number);
    snprintf(script, sizeof script, "trace %s\n", act);
    kit_submit(&d, beside, NULL, other);
    long since = now_ms();
    kit_submit(&d, script, NULL, id);
    json_t *job = kit_wait(&d, id, 60), *failure = json_object_get(job, "failure"), *exceeded = json_object_get(failure, "limit");
    long ms = now_ms() - since;
    snprintf(type, sizeof type, "/problems/%s", code);
    assert_string_equal(kit_text(job, "state"), "failed");
    assert_string_equal(kit_text(failure, "type"), type);
    assert_string_equal(kit_text(failure, "class"), class_);
    assert_string_equal(kit_text(failure, "stage"), "trace");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 2); /* sanitize, and trace once */
    assert_string_equal(kit_text(exceeded, "what"), what);
    if (*what) assert_int_equal(json_integer_value(json_object_get(exceeded, "allowed")), allowed);
    if (*what) snprintf(limit, sizeof limit, "%s %lld", what, (long long)allowed);
    assert_true(!said || log_has(id, said));
    json_t *neighbour = kit_wait(&d, other, 60);
    assert_string_equal(kit_text(neighbour, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(neighbour, "attempts")), BW_API_STAGE_COUNT);
    print_message("%-34s %-18s %-9s %-24s %7ld  %s\n", act, code, class_, limit, ms, kit_text(neighbour, "state"));
    json_decref(neighbour);
    json_decref(job);
}

static void a_worker_that_takes_too_much_is_stopped_as_a_limit(void **state) {
    (void)state;
    expect_stopped("spin", "time-limit", "limit", "cpu_seconds", 2, NULL);
    expect_stopped("sleep 60000", "time-limit", "limit", "wall_seconds", 12, NULL);
    expect_stopped("fill 3000000", "output-limit", "limit", "file", 2 << 20, NULL);
    expect_stopped("many 60000000", "output-limit", "limit", "scratch", 8 << 20, NULL);
    expect_stopped("chatter 200000000", "output-limit", "limit", "messages", 64 << 20, "the log ends here");
    expect_stopped("frames 200000000", "output-limit", "limit", "messages", 64 << 20, "the log ends here");
    expect_stopped("fail memory-limit", "memory-limit", "limit", "memory", 128 << 20, NULL);
}

static void a_worker_that_takes_too_much_memory_is_refused_it(void **state) {
    (void)state;
    if (!address_space) skip();
    expect_stopped("touch 4000000000", "memory-limit", "limit", "memory", 128 << 20, NULL);
}

/* Submits with limits of its own; returns the reply. */
static kit_reply submit_with(const char *script, const char *limits) {
    char hash[BW_SHA256_TEXT], body[300];
    kit_upload(&d, script, hash);
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\",\"limits\":%s}", hash, limits);
    return kit_request(&d, "POST", "/v1/jobs", "Content-Type: application/json", body, (size_t)n);
}

static void a_job_may_ask_for_less_and_not_for_more(void **state) {
    (void)state;
    static const struct {
        const char *script, *limits, *what;
        json_int_t allowed;
    } cases[] = {{"trace sleep 60000\n", "{\"wall_seconds\":1}", "wall_seconds", 1},
                 {"trace spin\n# less\n", "{\"cpu_seconds\":1}", "cpu_seconds", 1},
                 {"trace many 20000000\n# less\n", "{\"scratch\":3000000}", "scratch", 3000000},
                 {"trace fill 3000000\n# more\n", "{\"scratch\":900000000000}", "file", 2 << 20},
                 {"trace fail memory-limit\n# less\n", "{\"memory\":100000000}", "memory", 100000000}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        kit_reply r = submit_with(cases[i].script, cases[i].limits);
        assert_int_equal(r.status, 201);
        json_t *made = kit_json(&r), *job = kit_wait(&d, kit_text(made, "id"), 60);
        json_t *exceeded = json_object_get(json_object_get(job, "failure"), "limit");
        assert_true(json_object_size(json_object_get(job, "limits")) == 1);
        assert_string_equal(kit_text(exceeded, "what"), cases[i].what);
        assert_int_equal(json_integer_value(json_object_get(exceeded, "allowed")), cases[i].allowed);
        json_decref(job);
        json_decref(made);
    }
    kit_expect_problem(submit_with("# no\n", "{\"memory\":0}"), 400, "invalid-option");
    kit_expect_problem(submit_with("# no\n", "{\"memory\":\"1G\"}"), 400, "invalid-option");
    kit_expect_problem(submit_with("# no\n", "{\"money\":1}"), 400, "invalid-option");
    kit_expect_problem(submit_with("# no\n", "[]"), 400, "invalid-option");
}

/* ---- of all stages together ---- */

static void submit_until_trace(const kit_daemon *daemon, const char *script, const char *limits, char id[32]) {
    char hash[BW_SHA256_TEXT], body[300];
    kit_upload(daemon, script, hash);
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\",\"options\":{\"until\":\"trace\"},\"limits\":%s}", hash, limits);
    kit_reply r = kit_request(daemon, "POST", "/v1/jobs", "Content-Type: application/json", body, (size_t)n);
    assert_int_equal(r.status, 201);
    json_t *job = kit_json(&r);
    snprintf(id, 32, "%s", kit_text(job, "id"));
    json_decref(job);
}

/* The job fails in trace because all of it took more than `allowed` seconds. Returns it. */
static json_t *expect_total(const kit_daemon *daemon, const char *id, const char *what, json_int_t allowed) {
    json_t *job = kit_wait(daemon, id, 60), *failure = json_object_get(job, "failure"), *exceeded = json_object_get(failure, "limit");
    assert_string_equal(kit_text(failure, "type"), "/problems/time-limit");
    assert_string_equal(kit_text(failure, "class"), "limit");
    assert_string_equal(kit_text(failure, "stage"), "trace");
    assert_string_equal(kit_text(exceeded, "what"), what);
    assert_int_equal(json_integer_value(json_object_get(exceeded, "allowed")), allowed);
    assert_non_null(strstr(kit_text(failure, "detail"), "together"));
    return job;
}

static double spent(const json_t *job, const char *what) { return json_number_value(json_object_get(json_object_get(job, "spent"), what)); }

static void stages_that_take_too_much_together_are_stopped(void **state) {
    (void)state;
    char id[32], path[80];
    submit_until_trace(&d, "sanitize burn 1300\ntrace burn 1300\n", "{\"job_cpu_seconds\":2}", id);
    json_t *job = expect_total(&d, id, "job_cpu_seconds", 2);
    assert_true(spent(job, "cpu_seconds") >= 2); /* the kernel counts whole seconds, so it had 1.3 and 1 */
    json_decref(job);
    submit_until_trace(&d, "sanitize sleep 2000\ntrace sleep 2000\n", "{\"job_wall_seconds\":3}", id);
    job = expect_total(&d, id, "job_wall_seconds", 3);
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 2);
    json_decref(job);
    snprintf(path, sizeof path, "/v1/jobs/%s/retry", id); /* has all of it again, and its first stage is done */
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    job = kit_json(&r);
    assert_true(spent(job, "wall_seconds") == 0);
    json_decref(job);
    job = kit_wait(&d, id, 60);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
    submit_until_trace(&d, "sanitize sleep 2000\ntrace sleep 2000\n", "{\"job_wall_seconds\":1}", id); /* all in the cache */
    job = kit_wait(&d, id, 60);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_true(spent(job, "wall_seconds") == 0);
    json_decref(job);
}

static void tries_that_failed_count_for_the_whole_job(void **state) {
    (void)state;
    char id[32];
    submit_until_trace(&d, "trace sleep 1500\ntrace raise 9\n", "{\"job_wall_seconds\":4}", id);
    json_t *job = expect_total(&d, id, "job_wall_seconds", 4), *attempts = json_object_get(job, "attempts");
    size_t n = json_array_size(attempts);
    assert_true(n > 2 && n <= 4);
    assert_string_equal(kit_text(json_array_get(attempts, 1), "outcome"), "worker-died");
    assert_string_equal(kit_text(json_array_get(attempts, n - 1), "outcome"), "time-limit");
    json_decref(job);
}

static void write_settings(const char *path, const char *text) {
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

/* The daemon's own limit is lowered below what the job has taken already while its first stage runs. */
static void a_job_that_has_nothing_left_starts_no_stage(void **state) {
    (void)state;
    kit_daemon other;
    char id[32], path[] = "/tmp/bw-test-settings-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    write_settings(path, "job-wall-seconds = 1h\n");
    kit_start(&other, NULL, (const char *const[]){"--config", path, NULL});
    submit_until_trace(&other, "sanitize sleep 2500\ntrace log it was started\n", "{}", id);
    kit_wait_state(&other, id, "running", 10);
    write_settings(path, "job-wall-seconds = 1\n");
    kill(other.pid, SIGHUP);
    json_t *job = expect_total(&other, id, "job_wall_seconds", 1), *attempts = json_object_get(job, "attempts");
    assert_int_equal(json_array_size(attempts), 2);
    assert_true(spent(job, "wall_seconds") >= 2.5);
    kit_reply log = kit_get(&other, "/v1/jobs/%s/log", id);
    assert_null(strstr(log.body, "it was started"));
    assert_non_null(strstr(log.body, "time-limit"));
    kit_free(&log);
    json_t *limits = limits_of(&other);
    assert_int_equal(json_integer_value(json_object_get(limits, "job_wall_seconds")), 1);
    assert_true(json_is_null(json_object_get(limits, "job_cpu_seconds")));
    json_decref(limits);
    json_decref(job);
    kit_remove(&other);
    unlink(path);
}

static void a_log_is_cut_before_it_fills_the_disk(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "trace chatter 20000000\n", NULL, id);
    json_t *job = kit_wait(&d, id, 30);
    assert_string_equal(kit_text(job, "state"), "successful");
    kit_reply log = kit_get(&d, "/v1/jobs/%s/log", id);
    assert_true(log.size > 3000000 && log.size < 5000000);
    kit_free(&log);
    json_decref(job);
}

static void a_worker_that_makes_a_forbidden_call_is_ended(void **state) {
    (void)state;
    static const char *const acts[] = {"fork", "exec", "socket", "ptrace", "mount"};
    if (!seccomp) skip();
    for (size_t i = 0; i < sizeof acts / sizeof *acts; i++) {
        expect_stopped(acts[i], "sandbox-violation", "algorithm", "", 0, NULL);
        char script[40], id[32];
        snprintf(script, sizeof script, "trace %s\n", acts[i]); /* the same input: what it said until then */
        kit_submit(&d, script, NULL, id);
        json_decref(kit_wait(&d, id, 30));
        assert_false(log_has(id, "was not stopped"));
    }
    expect_stopped("signal", "sandbox-violation", "algorithm", "", 0, "ENOSYS");
    expect_stopped("owner", "sandbox-violation", "algorithm", "", 0, "ENOSYS");
}

static void a_worker_reaches_no_file_but_its_own(void **state) {
    (void)state;
    char act[200], path[120];
    if (!landlock) skip();
    expect_stopped("read /etc/passwd", "sandbox-violation", "algorithm", "", 0, "EACCES");
    snprintf(act, sizeof act, "read %s/jobs.db", d.data);
    expect_stopped(act, "sandbox-violation", "algorithm", "", 0, "EACCES");
    snprintf(path, sizeof path, "%s/not-the-workers", d.data);
    snprintf(act, sizeof act, "write %s", path);
    expect_stopped(act, "sandbox-violation", "algorithm", "", 0, "EACCES");
    assert_int_equal(access(path, F_OK), -1);
    snprintf(act, sizeof act, "remove %s/address", d.data);
    expect_stopped(act, "sandbox-violation", "algorithm", "", 0, "EACCES");
    snprintf(path, sizeof path, "%s/address", d.data);
    assert_int_equal(access(path, F_OK), 0);
    expect_stopped("handles", "sandbox-violation", "algorithm", "", 0, "EMFILE");
}

static void a_worker_may_start_threads(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "trace thread\n", NULL, id);
    json_t *job = kit_wait(&d, id, 30);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_true(log_has(id, "a thread ran"));
    json_decref(job);
}

static void cancelling_takes_less_than_a_second_unless_the_worker_is_deaf(void **state) {
    (void)state;
    static const char *const scripts[] = {"trace sleep 2900\n# cancelled\n", "* deaf\ntrace sleep 2900\n# cancelled\n"};
    for (size_t i = 0; i < 2; i++) {
        char id[32], path[80];
        kit_submit(&d, scripts[i], NULL, id);
        kit_wait_state(&d, id, "running", 10);
        kit_sleep_ms(300);
        snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
        long since = now_ms();
        kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
        assert_int_equal(r.status, 200);
        kit_free(&r);
        json_t *job = kit_wait(&d, id, 30);
        assert_string_equal(kit_text(job, "state"), "dismissed");
        print_message("%-34s %-18s %-9s %-24s %7ld\n", i ? "ignores SIGTERM, and is cancelled" : "is cancelled", "-", "-",
                      i ? "cancel-grace 1 s" : "-", now_ms() - since);
        json_decref(job);
    }
}

static void a_daemon_that_requires_a_sandbox_starts_nothing_without_it(void **state) {
    (void)state;
    kit_daemon other;
    char id[32];
    if (seccomp && landlock && address_space) {
        kit_start(&other, NULL, (const char *const[]){"--require-sandbox", "yes", NULL});
        kit_submit(&other, "# all is there\n", NULL, id);
        json_t *job = kit_wait(&other, id, 30);
        assert_string_equal(kit_text(job, "state"), "successful");
        json_decref(job);
        kit_remove(&other);
    }
    kit_start(&other, BW_BIN_DIR "/blockwright-test-worker-open", (const char *const[]){"--require-sandbox", "yes", NULL});
    kit_expect_problem(kit_get(&other, "/readyz"), 503, "not-ready");
    kit_submit(&other, "# must not start\n", NULL, id);
    kit_sleep_ms(300);
    json_t *job = kit_job(&other, id);
    assert_string_equal(kit_text(job, "state"), "queued");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 0);
    json_decref(job);
    kit_remove(&other);
}

static size_t running_at_once(const kit_daemon *daemon, char ids[2][32], bool *waited) {
    size_t most = 0;
    *waited = false;
    for (;;) {
        size_t running = 0, ended = 0;
        for (int i = 0; i < 2; i++) {
            json_t *job = kit_job(daemon, ids[i]), *attempts = json_object_get(job, "attempts");
            json_t *last = json_array_get(attempts, json_array_size(attempts) - 1);
            running += last && strcmp(kit_text(last, "stage"), "trace") == 0 && !json_object_get(last, "finished");
            *waited |= strcmp(kit_text(job, "waits_for"), "memory") == 0;
            ended += strcmp(kit_text(job, "state"), "successful") == 0;
            assert_string_not_equal(kit_text(job, "state"), "failed");
            json_decref(job);
        }
        if (running > most) most = running;
        if (ended == 2) return most;
        kit_sleep_ms(5);
    }
}

static void big_jobs_wait_for_memory_and_small_ones_do_not(void **state) {
    (void)state;
    static const struct {
        const char *need;
        size_t at_once;
    } cases[] = {{"600000000", 1}, {"400000000", 2}, {"3000000000", 1}}; /* of 1 GB; the last ones run alone */
    kit_daemon other;
    kit_start(&other, NULL, (const char *const[]){"--memory", "1000000000", "--workers", "2", NULL});
    for (size_t c = 0; c < sizeof cases / sizeof *cases; c++) {
        char ids[2][32], script[120];
        for (int i = 0; i < 2; i++) {
            snprintf(script, sizeof script, "sanitize need %s\ntrace sleep 400\n# %d\n", cases[c].need, i);
            kit_submit(&other, script, NULL, ids[i]);
        }
        bool waited;
        size_t most = running_at_once(&other, ids, &waited);
        print_message("two jobs that need %s bytes each of 1000000000: %zu at once\n", cases[c].need, most);
        assert_int_equal(most, cases[c].at_once);
        assert_int_equal(waited, most == 1); /* and said so */
    }
    kit_remove(&other);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_worker_that_takes_too_much_is_stopped_as_a_limit),
        cmocka_unit_test(a_worker_that_takes_too_much_memory_is_refused_it),
        cmocka_unit_test(a_job_may_ask_for_less_and_not_for_more),
        cmocka_unit_test(stages_that_take_too_much_together_are_stopped),
        cmocka_unit_test(tries_that_failed_count_for_the_whole_job),
        cmocka_unit_test(a_job_that_has_nothing_left_starts_no_stage),
        cmocka_unit_test(a_log_is_cut_before_it_fills_the_disk),
        cmocka_unit_test(a_worker_that_makes_a_forbidden_call_is_ended),
        cmocka_unit_test(a_worker_reaches_no_file_but_its_own),
        cmocka_unit_test(a_worker_may_start_threads),
        cmocka_unit_test(cancelling_takes_less_than_a_second_unless_the_worker_is_deaf),
        cmocka_unit_test(a_daemon_that_requires_a_sandbox_starts_nothing_without_it),
        cmocka_unit_test(big_jobs_wait_for_memory_and_small_ones_do_not),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
