/* The processes around the daemon: what a worker is given, and that none outlives those it belongs to. */
#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "daemon_kit.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--stage-memory", "64M", "--stage-cpu-seconds", "77", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static pid_t running_worker(const char *script, const char *parameters, char id[32]) {
    pid_t pid;
    kit_submit_both(&d, script, parameters, NULL, id);
    kit_wait_state(&d, id, "running", 10);
    for (int i = 0; i < 500; i++, kit_sleep_ms(10))
        if (kit_workers(&d, &pid, 1) == 1) return pid;
    fail_msg("no worker");
    return 0;
}

static pid_t parent_of(pid_t pid) {
    char path[64], line[400] = "";
    int parent = 0;
    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *f = fopen(path, "r");
    if (f && fgets(line, sizeof line, f)) sscanf(strrchr(line, ')') + 2, "%*c %d", &parent);
    if (f) fclose(f);
    return parent;
}

static bool lives(pid_t pid) {
    char path[64];
    snprintf(path, sizeof path, "/proc/%d/cmdline", (int)pid);
    FILE *f = fopen(path, "r");
    bool there = f && fgetc(f) != EOF; /* a zombie has no command line */
    if (f) fclose(f);
    return there;
}

static void expect_gone(pid_t pid) {
    for (int i = 0; i < 1000 && lives(pid); i++) kit_sleep_ms(10);
    assert_false(lives(pid));
}

/* A line of /proc/PID/<file> that begins with `start`. */
static bool has_line(pid_t pid, const char *file, const char *start, const char *rest) {
    char path[64], line[300];
    bool found = false;
    snprintf(path, sizeof path, "/proc/%d/%s", (int)pid, file);
    FILE *f = fopen(path, "r");
    while (f && fgets(line, sizeof line, f))
        if (strncmp(line, start, strlen(start)) == 0) found = strncmp(line + strlen(start) + strspn(line + strlen(start), " \t"), rest, strlen(rest)) == 0;
    if (f) fclose(f);
    return found;
}

/* `last`: the highest descriptor; it has that one, all below and no other. */
static void expect_descriptors(pid_t pid, int last) {
    char path[64];
    int highest = 0, count = 0;
    snprintf(path, sizeof path, "/proc/%d/fd", (int)pid);
    DIR *fds = opendir(path);
    assert_non_null(fds);
    for (struct dirent *e; (e = readdir(fds));) {
        if (*e->d_name == '.') continue;
        count++;
        if (atoi(e->d_name) > highest) highest = atoi(e->d_name);
    }
    closedir(fds);
    assert_int_equal(count, last + 1);
    assert_int_equal(highest, last);
}

static void a_worker_is_confined(void **state) {
    (void)state;
    char id[32];
    pid_t pid = running_worker("sanitize sleep 1500\n", NULL, id);
    kit_sleep_ms(200); /* past its exec */
    assert_true(has_line(pid, "status", "NoNewPrivs:", "1"));
    assert_true(has_line(pid, "limits", "Max core file size", "0"));
    assert_true(has_line(pid, "limits", "Max cpu time", "77"));
    assert_true(has_line(pid, "limits", "Max open files", "64"));
    kit_reply r = kit_get(&d, "/readyz");
    json_t *ready = kit_json(&r);
    if (json_is_true(json_object_get(json_object_get(ready, "limits"), "address_space")))
        assert_true(has_line(pid, "limits", "Max address space", "603979776")); /* 64 MiB + 512 MiB */
    json_decref(ready);
    assert_int_equal(getsid(pid), pid);
    expect_descriptors(pid, 4);
    json_decref(kit_wait(&d, id, 20));
}

static void a_worker_has_one_descriptor_more_for_parameters(void **state) {
    (void)state;
    char id[32];
    pid_t pid = running_worker("sanitize sleep 1500\n", "# parameters\n", id);
    kit_sleep_ms(200); /* past its exec */
    expect_descriptors(pid, 5);
    json_decref(kit_wait(&d, id, 20));
}

static void workers_die_with_the_daemon_and_the_job_goes_on_with_the_next(void **state) {
    (void)state;
    char id[32];
    pid_t pid = running_worker("* deaf\nsanitize sleep 2000\n# with the daemon\n", NULL, id), spawner = parent_of(pid);
    kit_kill(&d, SIGKILL);
    expect_gone(pid);
    expect_gone(spawner);
    kit_restart(&d, NULL);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_string_equal(kit_text(json_array_get(json_object_get(job, "attempts"), 0), "outcome"), "interrupted");
    json_decref(job);
}

static void a_daemon_without_its_spawner_ends_and_the_next_goes_on(void **state) {
    (void)state;
    char id[32];
    int status;
    pid_t pid = running_worker("* deaf\nsanitize sleep 2000\n# with the spawner\n", NULL, id);
    kill(parent_of(pid), SIGKILL);
    assert_int_equal(waitpid(d.pid, &status, 0), d.pid);
    d.pid = 0;
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 5);
    expect_gone(pid);
    kit_restart(&d, NULL);
    json_t *job = kit_wait(&d, id, 20);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
}

static void a_daemon_that_cannot_run_its_worker_says_so(void **state) {
    (void)state;
    char command[300], worker[100];
    kit_daemon other;
    snprintf(worker, sizeof worker, "%s.worker", d.data);
    snprintf(command, sizeof command, "cp %s/blockwright-test-worker %s", BW_BIN_DIR, worker);
    assert_int_equal(system(command), 0);
    kit_start(&other, worker, NULL);
    assert_int_equal(chmod(worker, 0), 0);
    kit_expect_problem(kit_get(&other, "/readyz"), 503, "not-ready");
    kit_reply r = kit_get(&other, "/livez");
    assert_int_equal(r.status, 200);
    kit_free(&r);
    kit_remove(&other);
    unlink(worker);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_worker_is_confined),
        cmocka_unit_test(a_worker_has_one_descriptor_more_for_parameters),
        cmocka_unit_test(workers_die_with_the_daemon_and_the_job_goes_on_with_the_next),
        cmocka_unit_test(a_daemon_without_its_spawner_ends_and_the_next_goes_on),
        cmocka_unit_test(a_daemon_that_cannot_run_its_worker_says_so),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
