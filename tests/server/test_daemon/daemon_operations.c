/* What whoever runs the daemon sees of it: configuration, signals, systemd, the log. */
#include "daemon_kit.h"

#include <errno.h>
#include <ftw.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

static kit_daemon d;

static char *log_text(void) {
    char path[96];
    snprintf(path, sizeof path, "%s.log", d.data);
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    char *text = calloc(1, 1 << 20);
    fread(text, 1, (1 << 20) - 1, f);
    fclose(f);
    return text;
}

static bool logged(const char *part) {
    char *text = log_text();
    bool there = strstr(text, part) != NULL;
    free(text);
    return there;
}

static void wait_logged(const char *part) {
    for (int i = 0; i < 1000; i++, kit_sleep_ms(10))
        if (logged(part)) return;
    fail_msg("'%s' is not in %s.log", part, d.data);
}

static void write_config(const char *text) {
    char path[96];
    snprintf(path, sizeof path, "%s.conf", d.data);
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fputs(text, f);
    fclose(f);
}

/* Starts with a configuration file of this text. */
static void start_with(const char *text) {
    char path[96];
    memset(&d, 0, sizeof d);
    snprintf(d.data, sizeof d.data, "/tmp/bw-test-XXXXXX");
    assert_non_null(mkdtemp(d.data));
    write_config(text);
    snprintf(path, sizeof path, "%s.conf", d.data);
    kit_restart(&d, (const char *const[]){"--config", path, NULL});
}

static int remove_daemon(void **state) {
    char path[96];
    (void)state;
    snprintf(path, sizeof path, "%s.conf", d.data);
    unlink(path);
    if (*d.data) kit_remove(&d);
    memset(&d, 0, sizeof d);
    return 0;
}

static long upload_status(size_t size) {
    char *content = calloc(1, size + 1), hash[BW_SHA256_TEXT], path[120];
    memset(content, 'x', size);
    kit_hash(content, size, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(&d, "PUT", path, NULL, content, size);
    kit_free(&r);
    free(content);
    return r.status;
}

/* ---- SIGHUP ---- */

static void sighup_takes_over_what_can_be_and_says_what_cannot(void **state) {
    (void)state;
    start_with("max-upload = 1K\n");
    assert_int_equal(upload_status(3000), 413);
    write_config("max-upload = 4K # more\nlisten = 127.0.0.1:9\nworkers = 17\n");
    kill(d.pid, SIGHUP);
    wait_logged("event=config.reloaded");
    assert_int_equal(upload_status(3000), 201);
    assert_true(logged("event=config.changed name=max-upload value=\"4K\""));
    assert_true(logged("event=config.needs_restart name=workers value=\"17\""));
    assert_false(logged("name=listen")); /* the command line gives it, and still does */
}

static void a_mistake_in_the_file_at_sighup_changes_nothing(void **state) {
    (void)state;
    start_with("max-upload = 1K\n");
    write_config("max-upload = 4K\nmax-uplod = 5K\n");
    kill(d.pid, SIGHUP);
    wait_logged("event=config.rejected");
    assert_true(logged(".conf:2: there is no setting 'max-uplod'; did you mean max-upload?"));
    assert_int_equal(upload_status(3000), 413);
}

/* ---- SIGTERM ---- */

static bool attempt_has(const char *id, const char *outcome) {
    json_t *job = kit_job(&d, id), *attempts = json_object_get(job, "attempts"), *attempt;
    bool has = false;
    size_t i;
    json_array_foreach(attempts, i, attempt) has = has || strcmp(kit_text(attempt, "outcome"), outcome) == 0;
    json_decref(job);
    return has;
}

static bool says_draining(void) {
    kit_reply r = kit_get(&d, "/readyz");
    bool says = r.status == 503 && strstr(r.body, "draining");
    kit_free(&r);
    return says;
}

static void a_draining_daemon_ends_what_runs_begins_nothing_and_is_not_ready(void **state) {
    char first[32], second[32];
    (void)state;
    start_with("stop-grace = 60s\nworkers = 1\n");
    kit_submit(&d, "sanitize sleep 1500\n", NULL, first);
    kit_wait_state(&d, first, "running", 10);
    kit_submit(&d, "# waits\n", NULL, second);
    kill(d.pid, SIGTERM);
    wait_logged("event=daemon.draining");
    assert_true(says_draining());
    int status;
    assert_int_equal(waitpid(d.pid, &status, 0), d.pid);
    d.pid = 0;
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    assert_true(logged("stage=sanitize attempt=1 outcome=ok"));
    assert_false(logged("stage=trace"));
    kit_restart(&d, NULL);
    json_decref(kit_wait(&d, first, 20));
    json_decref(kit_wait(&d, second, 20));
    assert_false(attempt_has(first, "interrupted"));
}

static void a_second_sigterm_ends_the_grace(void **state) {
    char id[32];
    (void)state;
    start_with("stop-grace = 1h\n");
    kit_submit(&d, "sanitize sleep 60000\n", NULL, id);
    kit_wait_state(&d, id, "running", 10);
    kill(d.pid, SIGTERM);
    wait_logged("event=daemon.draining");
    assert_int_equal(kit_stop(&d), 0);
    assert_true(logged("outcome=interrupted"));
}

static void without_a_grace_a_running_stage_is_given_back_at_once(void **state) {
    char id[32];
    (void)state;
    start_with("");
    kit_submit(&d, "sanitize sleep 60000\n", NULL, id);
    kit_wait_state(&d, id, "running", 10);
    assert_int_equal(kit_stop(&d), 0);
    assert_true(logged("outcome=interrupted"));
}

/* ---- systemd ---- */

static int open_notify_socket(struct sockaddr_un *address, socklen_t size) {
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    struct timeval patience = {20, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    assert_int_equal(bind(fd, (struct sockaddr *)address, size), 0);
    return fd;
}

/* The next datagram; WATCHDOG=1 is counted and passed over, if `watchdogs` is given. */
static const char *next_notice(int fd, int *watchdogs) {
    static char text[300];
    for (;;) {
        ssize_t n = recv(fd, text, sizeof text - 1, 0);
        if (n < 0) fail_msg("nothing was sent to NOTIFY_SOCKET: errno %d", errno);
        text[n] = '\0';
        if (!watchdogs || strcmp(text, "WATCHDOG=1") != 0) return text;
        ++*watchdogs;
    }
}

static void systemd_is_told_of_start_reload_and_end(void **state) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)state;
    snprintf(address.sun_path, sizeof address.sun_path, "/tmp/bw-notify-%d", (int)getpid());
    int fd = open_notify_socket(&address, sizeof address);
    setenv("NOTIFY_SOCKET", address.sun_path, 1);
    start_with("");
    unsetenv("NOTIFY_SOCKET");
    assert_string_equal(next_notice(fd, NULL), "READY=1");
    kill(d.pid, SIGHUP);
    assert_true(strncmp(next_notice(fd, NULL), "RELOADING=1\nMONOTONIC_USEC=", 27) == 0);
    assert_string_equal(next_notice(fd, NULL), "READY=1");
    assert_int_equal(kit_stop(&d), 0);
    assert_string_equal(next_notice(fd, NULL), "STOPPING=1");
    close(fd);
    unlink(address.sun_path);
}

static void the_watchdog_is_patted_while_the_dispatcher_turns(void **state) {
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int watchdogs = 0;
    (void)state;
    int n = snprintf(address.sun_path + 1, sizeof address.sun_path - 1, "bw-notify-%d", (int)getpid()); /* abstract */
    int fd = open_notify_socket(&address, (socklen_t)(sizeof address.sun_family + 1 + (size_t)n));
    char name[sizeof address.sun_path + 1];
    snprintf(name, sizeof name, "@%s", address.sun_path + 1);
    setenv("NOTIFY_SOCKET", name, 1);
    setenv("WATCHDOG_USEC", "100000", 1);
    start_with("");
    unsetenv("NOTIFY_SOCKET");
    unsetenv("WATCHDOG_USEC");
    assert_string_equal(next_notice(fd, NULL), "READY=1");
    for (int i = 0; i < 5; i++) assert_string_equal(next_notice(fd, NULL), "WATCHDOG=1");
    kill(d.pid, SIGTERM);
    assert_string_equal(next_notice(fd, &watchdogs), "STOPPING=1");
    assert_int_equal(kit_stop(&d), 0);
    close(fd);
}

/* ---- command line and log ---- */

static int run_daemon(const char *arguments, char *output, size_t size) {
    char command[500];
    snprintf(command, sizeof command, "BLOCKWRIGHT_WORKERS=3 %s/blockwrightd %s 2>&1", BW_BIN_DIR, arguments);
    FILE *p = popen(command, "r");
    assert_non_null(p);
    output[fread(output, 1, size - 1, p)] = '\0';
    return WEXITSTATUS(pclose(p));
}

static void check_config_tells_values_and_sources_and_makes_nothing(void **state) {
    char output[8000];
    struct stat info;
    (void)state;
    unsetenv("BLOCKWRIGHT_CONFIG");
    assert_int_equal(run_daemon("--data /tmp/bw-test-never-made --max-upload 3072M --check-config", output, sizeof output), 0);
    assert_non_null(strstr(output, "data = /tmp/bw-test-never-made  # --data\n"));
    assert_non_null(strstr(output, "workers = 3  # BLOCKWRIGHT_WORKERS\n"));
    assert_non_null(strstr(output, "max-upload = 3G  # --max-upload\n"));
    assert_non_null(strstr(output, "stage-memory = 4G  # default\n"));
    assert_int_not_equal(stat("/tmp/bw-test-never-made", &info), 0);
    assert_int_equal(run_daemon("--data /tmp/bw-test-never-made --check-config --max-uplod 3G", output, sizeof output), 2);
    assert_non_null(strstr(output, "did you mean --max-upload?"));
    assert_int_equal(run_daemon("serve --data /tmp/bw-test-never-made --check-config", output, sizeof output), 0);
    assert_int_equal(run_daemon("sserve --data /tmp/bw-test-never-made", output, sizeof output), 2);
    assert_int_not_equal(stat("/tmp/bw-test-never-made", &info), 0);
}

static void every_line_of_a_json_log_is_an_object(void **state) {
    char id[32], *text, *rest;
    int lines = 0;
    (void)state;
    start_with("log-format = json\nlog-level = debug\n");
    kit_submit(&d, "trace fail inverted\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kit_submit(&d, "\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    kill(d.pid, SIGHUP);
    wait_logged("config.reloaded");
    assert_int_equal(kit_stop(&d), 0);
    rest = text = log_text();
    for (char *line; (line = strsep(&rest, "\n")) && *line; lines++) {
        json_error_t error;
        json_t *event = json_loads(line, JSON_REJECT_DUPLICATES, &error);
        if (!event) fail_msg("%s: %s", error.text, line);
        assert_true(*kit_text(event, "time") && *kit_text(event, "level") && *kit_text(event, "event"));
        if (strcmp(kit_text(event, "event"), "stage.end") == 0) assert_true(json_is_integer(json_object_get(event, "ms")));
        json_decref(event);
    }
    assert_true(lines > 10);
    free(text);
}

static int modes_seen;

static int no_mode_for_others(const char *path, const struct stat *st, int kind, struct FTW *at) {
    (void)kind;
    if (at->level && !S_ISSOCK(st->st_mode)) modes_seen++;
    if (at->level && st->st_mode & 077) fail_msg("%s has mode %o", path, (unsigned)(st->st_mode & 0777));
    return 0;
}

static void what_is_in_an_open_folder_is_not_open(void **state) {
    (void)state;
    char id[32];
    mode_t before = umask(022);
    start_with("");
    umask(before);
    kit_submit(&d, "# private\n", NULL, id);
    json_decref(kit_wait(&d, id, 30));
    assert_int_equal(chmod(d.data, 0755), 0);
    assert_int_equal(nftw(d.data, no_mode_for_others, 16, FTW_PHYS), 0);
    assert_true(modes_seen > 10);
}

static void a_folder_that_is_open_is_told_and_left_as_it_is(void **state) {
    (void)state;
    struct stat info;
    start_with("");
    assert_false(logged("event=data.open"));
    assert_int_equal(kit_stop(&d), 0);
    assert_int_equal(chmod(d.data, 0750), 0);
    kit_restart(&d, NULL);
    assert_true(logged("level=warn event=data.open mode=0750 advice=\"others may enter, list or change it; chmod 0700 keeps them out\" path=\"/tmp/"));
    assert_int_equal(stat(d.data, &info), 0);
    assert_int_equal(info.st_mode & 07777, 0750);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(sighup_takes_over_what_can_be_and_says_what_cannot, remove_daemon),
        cmocka_unit_test_teardown(a_mistake_in_the_file_at_sighup_changes_nothing, remove_daemon),
        cmocka_unit_test_teardown(a_draining_daemon_ends_what_runs_begins_nothing_and_is_not_ready, remove_daemon),
        cmocka_unit_test_teardown(what_is_in_an_open_folder_is_not_open, remove_daemon),
        cmocka_unit_test_teardown(a_folder_that_is_open_is_told_and_left_as_it_is, remove_daemon),
        cmocka_unit_test_teardown(a_second_sigterm_ends_the_grace, remove_daemon),
        cmocka_unit_test_teardown(without_a_grace_a_running_stage_is_given_back_at_once, remove_daemon),
        cmocka_unit_test_teardown(systemd_is_told_of_start_reload_and_end, remove_daemon),
        cmocka_unit_test_teardown(the_watchdog_is_patted_while_the_dispatcher_turns, remove_daemon),
        cmocka_unit_test_teardown(check_config_tells_values_and_sources_and_makes_nothing, remove_daemon),
        cmocka_unit_test_teardown(every_line_of_a_json_log_is_an_object, remove_daemon),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
