/* A real blockwrightd on a free loopback port for the client tests. One per test program; stopped by its
 * teardown. */
#ifndef BW_TESTS_CLIENTS_DAEMON_H
#define BW_TESTS_CLIENTS_DAEMON_H

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "kit/kit.h"

typedef struct {
    pid_t process;
    const char *data;
    char url[128];
} daemon_here;

static inline void daemon_nap(void) {
    nanosleep(&(struct timespec){0, 20 * 1000 * 1000}, NULL);
}

/* The daemon writes its address once it listens; a stale one is removed first. */
static inline void daemon_read_address(daemon_here *d) {
    const char *file = kit_temp_path("data/address");
    for (int i = 0; i < 1500 && !kit_exists(file); i++) {
        int status;
        if (waitpid(d->process, &status, WNOHANG) == d->process)
            fail_msg("blockwrightd ended at its start: %d", status);
        daemon_nap();
    }
    char *text = kit_read_file(file, NULL);
    text[strcspn(text, "\r\n")] = 0;
    snprintf(d->url, sizeof d->url, "%s%s", strncmp(text, "http", 4) ? "http://" : "", text);
    free(text);
}

static inline void daemon_start(daemon_here *d) {
    const char *program = kit_program("blockwrightd"), *log = kit_temp_path("daemon.log");
    d->data = kit_temp_path("data");
    unlink(kit_temp_path("data/address"));
    fflush(NULL);
    d->process = fork();
    if (d->process < 0) fail_msg("fork failed: %s", strerror(errno));
    if (d->process == 0) {
        int fd = open(log, O_WRONLY | O_CREAT | O_APPEND, 0600);
        dup2(fd, 1);
        dup2(fd, 2);
        execl(program, program, "--data", d->data, "--listen", "127.0.0.1:0", (char *)NULL);
        _exit(127);
    }
    daemon_read_address(d);
}

/* Stops it in order and returns its exit code. */
static inline int daemon_stop(daemon_here *d) {
    int status = 0;
    kill(d->process, SIGTERM);
    while (waitpid(d->process, &status, 0) < 0 && errno == EINTR) continue;
    d->process = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

static inline void daemon_kill(daemon_here *d) {
    int status;
    kill(d->process, SIGKILL);
    while (waitpid(d->process, &status, 0) < 0 && errno == EINTR) continue;
    d->process = 0;
}

/* The daemon of a test program, for the setup and teardown of its tests; a setup that has more to do ends with daemon_begin. */
static daemon_here here;

static inline int daemon_begin(void **state) {
    (void)state;
    daemon_start(&here);
    return 0;
}

static inline int daemon_end(void **state) {
    (void)state;
    return daemon_stop(&here);
}

/* main() of a test program whose tests all have the daemon: KIT_MAIN with a setup, daemon_begin or one that ends with it. */
#define DAEMON_MAIN(tests, setup)                                                                                     \
    int main(void) {                                                                                                  \
        return kit_exit(cmocka_run_group_tests(tests, setup, daemon_end), sizeof(tests) / sizeof *(tests));           \
    }

static inline bool daemon_lives(const daemon_here *d) {
    return waitpid(d->process, NULL, WNOHANG) == 0;
}

#endif
