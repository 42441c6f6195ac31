/* What an attempt's folder holds: nothing that a worker can make there counts as less than it is. */
#include <fcntl.h>
#include <grp.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "server/files.h"
#include "server/worker/scratch.h"

enum { USER = 65534 };
static const uint64_t most = UINT64_C(1) << 40;
static char folder[64];
static int at;

static int make(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/bw-scratch-XXXXXX");
    if (!mkdtemp(folder) || (getuid() == 0 && chown(folder, USER, USER) != 0)) return -1;
    return (at = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC)) < 0;
}

static int clean(void **state) {
    (void)state;
    close(at);
    return bw_remove_tree(folder) == BW_OK ? 0 : -1;
}

static void file(const char *name, off_t bytes) {
    int fd = openat(at, name, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
    assert_true(fd >= 0 && ftruncate(fd, bytes) == 0);
    close(fd);
}

static void files_count_by_their_length_and_entries_as_a_page(void **state) {
    (void)state;
    assert_int_equal(bw_scratch_bytes(at, most), 0);
    file("empty", 0);
    file("sparse", 1000000);
    assert_int_equal(mkdirat(at, "inner", 0700), 0);
    file("inner/more", 1);
    assert_int_equal(symlinkat("/proc/kcore", at, "link"), 0);
    assert_int_equal(bw_scratch_bytes(at, most), 5 * 4096 + 1000000 + 1 + 11);
    assert_true(bw_scratch_bytes(at, 1000) > 1000);
}

static void folders_deeper_than_any_stage_makes_them_are_too_much(void **state) {
    (void)state;
    char path[40] = "d";
    for (int i = 1; i <= 9; i++) {
        assert_true(bw_scratch_bytes(at, most) < most);
        assert_int_equal(mkdirat(at, path, 0700), 0);
        snprintf(path + 2 * i - 1, sizeof path - 2 * (size_t)i, "/d");
    }
    assert_true(bw_scratch_bytes(at, most) > most);
}

/* In a process whom rights stop, like a daemon that is not root. */
static bool is_too_much(mode_t mode) {
    int status = -1;
    pid_t pid = fork();
    if (pid == 0) {
        bool user = getuid() != 0 || (setgroups(0, NULL) == 0 && setgid(USER) == 0 && setuid(USER) == 0);
        if (!user || mkdirat(at, "f", 0700) != 0) _exit(2);
        file("f/big", (off_t)1 << 30);
        if (fchmodat(at, "f", mode, 0) != 0) _exit(3);
        _exit(bw_scratch_bytes(at, most) > most);
    }
    assert_true(pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status) && WEXITSTATUS(status) < 2);
    return WEXITSTATUS(status) == 1;
}

static void a_readable_folder_is_looked_into(void **state) {
    (void)state;
    assert_false(is_too_much(0500));
}

static void a_folder_that_cannot_be_listed_is_too_much(void **state) {
    (void)state;
    assert_true(is_too_much(0300));
}

static void a_folder_whose_entries_cannot_be_reached_is_too_much(void **state) {
    (void)state;
    assert_true(is_too_much(0600));
}

static void twenty_thousand_entries_are_the_most(void **state) {
    (void)state;
    char name[16];
    for (int i = 0; i < 20000; i++) {
        snprintf(name, sizeof name, "%d", i);
        int fd = openat(at, name, O_WRONLY | O_CREAT | O_CLOEXEC, 0600);
        assert_true(fd >= 0);
        close(fd);
    }
    assert_int_equal(bw_scratch_bytes(at, most), UINT64_C(20000) * 4096);
    file("one more", 0);
    assert_true(bw_scratch_bytes(at, most) > most);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(files_count_by_their_length_and_entries_as_a_page, make, clean),
        cmocka_unit_test_setup_teardown(folders_deeper_than_any_stage_makes_them_are_too_much, make, clean),
        cmocka_unit_test_setup_teardown(a_readable_folder_is_looked_into, make, clean),
        cmocka_unit_test_setup_teardown(a_folder_that_cannot_be_listed_is_too_much, make, clean),
        cmocka_unit_test_setup_teardown(a_folder_whose_entries_cannot_be_reached_is_too_much, make, clean),
        cmocka_unit_test_setup_teardown(twenty_thousand_entries_are_the_most, make, clean),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
