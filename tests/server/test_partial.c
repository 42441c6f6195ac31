/* Uploads in parts, where the disk does not do what it should: nothing is told to be there that may not be, and another try goes on. */
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "server/files.h"
#include "server/partial.h"

static const char abcd[] = "88d4266fd4e6338d13b845fcf289579d209c897823b9217da3e161936f031589";
static char folder[64];
static bw_store *store;
static bw_partials *partials;
static bool sync_fails; /* once, for lack of room */

int fdatasync(int fd) {
    if (!sync_fails) return (int)syscall(SYS_fdatasync, fd);
    sync_fails = false;
    errno = ENOSPC;
    return -1;
}

static int make_folder(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/bw-partial-XXXXXX");
    return mkdtemp(folder) ? 0 : -1;
}

static bool open_all(void) { return bw_store_open(folder, &store) == BW_OK && bw_partials_open(folder, store, &partials) == BW_OK; }

static void close_all(void) {
    bw_partials_close(partials);
    bw_store_close(store);
}

static int remove_folder(void **state) {
    (void)state;
    return bw_remove_tree(folder) == BW_OK ? 0 : -1;
}

static bw_partial *begin(uint64_t length, int64_t expires) {
    bw_partial *p;
    return bw_partial_create(partials, &(bw_partial_new){.owner = "", .length = length, .expires = expires}, &p) == BW_OK ? p : NULL;
}

static bw_status put(bw_partial *p, const char *text, int64_t expires) {
    char actual[BW_SHA256_TEXT];
    bw_status status = bw_partial_write(p, text, strlen(text));
    return status == BW_OK ? bw_partial_commit(p, expires, actual) : status;
}

static void bytes_that_could_not_be_synced_are_not_there(void **state) {
    (void)state;
    assert_true(open_all());
    bw_partial *p = begin(4, 1000);
    assert_non_null(p);
    assert_int_equal(put(p, "ab", 1000), BW_OK);
    sync_fails = true;
    assert_int_equal(put(p, "cd", 1000), BW_E_IO);
    assert_int_equal(bw_partial_offset(p), 2);
    assert_true(bw_partial_durable(p));
    assert_int_equal(put(p, "cd", 1000), BW_OK);
    assert_string_equal(bw_partial_blob(p), abcd);
    bw_partial_release(p);
    close_all();
}

static void of_the_complete_ones_the_longest_complete_is_forgotten(void **state) {
    (void)state;
    char ids[2][BW_JOB_ID_TEXT];
    bw_partial *p[2];
    assert_true(open_all());
    for (int i = 0; i < 2; i++) {
        assert_non_null(p[i] = begin(1, 1000));
        snprintf(ids[i], sizeof ids[i], "%s", bw_partial_id(p[i]));
    }
    for (int i = 1; i >= 0; i--) { /* the second one first */
        assert_int_equal(put(p[i], i ? "x" : "y", 2000 - i), BW_OK);
        bw_partial_release(p[i]);
    }
    assert_int_equal(bw_partials_expire(partials, 0, 1), 1);
    assert_int_equal(bw_partial_take(partials, ids[1], "", 0, &p[1]), BW_PARTIAL_UNKNOWN);
    assert_int_equal(bw_partial_take(partials, ids[0], "", 0, &p[0]), BW_PARTIAL_TAKEN);
    bw_partial_release(p[0]);
    close_all();
}

/* A file is in the place of the folder for the blob; then it is not. */
static bool another_try_files_it(void) {
    char path[200], id[BW_JOB_ID_TEXT], actual[BW_SHA256_TEXT];
    struct stat st;
    bw_partial *p = open_all() ? begin(4, 1000) : NULL;
    snprintf(path, sizeof path, "%s/blobs/%.2s", folder, abcd);
    if (!p || put(p, "ab", 1000) != BW_OK || rmdir(path) != 0 || bw_write_file(path, "", 0) != BW_OK || put(p, "cd", 1000) == BW_OK) return false;
    snprintf(id, sizeof id, "%s", bw_partial_id(p));
    bw_partial_release(p);
    if (unlink(path) != 0 || mkdir(path, 0700) != 0 || bw_partial_take(partials, id, "", 0, &p) != BW_PARTIAL_TAKEN) return false;
    bool good = bw_partial_commit(p, 1000, actual) == BW_OK && strcmp(actual, abcd) == 0;
    bw_partial_release(p);
    close_all();
    snprintf(path, sizeof path, "%s/blobs/%.2s/%s", folder, abcd, abcd);
    return good && stat(path, &st) == 0 && (st.st_mode & 0777) == 0400;
}

static void a_complete_one_that_could_not_be_filed_is_filed_by_another_try(void **state) {
    (void)state;
    int status = -1;
    pid_t pid = fork(); /* as a user whom rights stop */
    if (pid == 0) {
        bool user = getuid() != 0 || (chown(folder, 65534, 65534) == 0 && setgid(65534) == 0 && setuid(65534) == 0);
        _exit(user && another_try_files_it() ? 0 : 1);
    }
    assert_int_equal(waitpid(pid, &status, 0), pid);
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(bytes_that_could_not_be_synced_are_not_there, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(of_the_complete_ones_the_longest_complete_is_forgotten, make_folder, remove_folder),
        cmocka_unit_test_setup_teardown(a_complete_one_that_could_not_be_filed_is_filed_by_another_try, make_folder, remove_folder),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
