/* The store: blobs appear whole or not at all, attempts are taken over only when they are what they should be. */
#include <fcntl.h>
#include <grp.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "server/files.h"
#include "server/store.h"

static char folder[64], command[400];
static bw_store *store;
static const char key[] = "00000000000000000000000000000000000000000000000000000000000000aa";
static const char empty_hash[] = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

static int open_store(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/bw-store-XXXXXX");
    assert_non_null(mkdtemp(folder));
    return bw_store_open(folder, &store) == BW_OK ? 0 : -1;
}

static int close_store(void **state) {
    (void)state;
    bw_store_close(store);
    bw_remove_tree(folder);
    return 0;
}

static void shell(const char *format) {
    snprintf(command, sizeof command, "cd %s && %s", folder, format);
    assert_int_equal(system(command), 0);
}

static bool upload(const char *text, const char *hash, char actual[BW_SHA256_TEXT]) {
    bw_upload *u;
    bool matches;
    assert_int_equal(bw_upload_begin(store, &u), BW_OK);
    for (size_t i = 0; text[i]; i++) assert_int_equal(bw_upload_write(u, text + i, 1), BW_OK);
    assert_int_equal(bw_upload_finish(u, hash, &matches, actual), BW_OK);
    return matches;
}

static void a_blob_is_there_after_its_upload_and_says_its_hash(void **state) {
    (void)state;
    char actual[BW_SHA256_TEXT], again[BW_SHA256_TEXT];
    uint64_t bytes;
    assert_true(upload("", empty_hash, actual));
    assert_false(upload("abc", empty_hash, actual));
    assert_string_equal(actual, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    assert_int_equal(bw_store_open_blob(store, actual, &bytes), -1);
    assert_true(upload("abc", actual, again));
    assert_true(upload("abc", actual, again)); /* twice is fine */
    int fd = bw_store_open_blob(store, actual, &bytes);
    assert_true(fd >= 0 && bytes == 3);
    assert_int_equal(bw_digest_file(fd, again, &bytes), BW_OK);
    assert_string_equal(again, actual);
    close(fd);
    shell("test -z \"$(ls tmp)\"");
}

static void names_that_are_no_hashes_open_nothing(void **state) {
    (void)state;
    uint64_t bytes;
    const char *bad[] = {"", "..", "../../../etc/passwd", "E3B0C44298FC1C149AFBF4C8996FB92427AE41E4649B934CA495991B7852B855"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(bw_store_open_blob(store, bad[i], &bytes), -1);
        assert_int_equal(bw_store_open_cached(store, bad[i], NULL, &bytes), -1);
        assert_int_equal(bw_store_open_cached(store, key, bad[i], &bytes), -1);
    }
}

/* Runs an attempt whose output `make` writes; returns how its publication ended. */
static bw_status attempt(const char *make, json_t **manifest) {
    int fd;
    uint64_t bytes;
    char line[300];
    *manifest = NULL;
    assert_int_equal(bw_attempt_begin(store, "job", 1, &fd), BW_OK);
    close(fd);
    snprintf(line, sizeof line, "cd work/job.1 && %s", make);
    shell(line);
    bw_status status = bw_attempt_publish(store, "job", 1, key, &bytes, manifest);
    bw_attempt_end(store, "job", 1);
    shell("test ! -e work/job.1");
    return status;
}

static void outputs_are_taken_over_as_files_or_folders(void **state) {
    (void)state;
    json_t *manifest;
    uint64_t bytes;
    assert_int_equal(attempt("printf state > out", &manifest), BW_OK);
    assert_null(manifest);
    int fd = bw_store_open_cached(store, key, NULL, &bytes);
    assert_true(fd >= 0 && bytes == 5);
    close(fd);
    assert_int_equal(attempt("mkdir out && printf '' > out/b.json && printf abc > out/a", &manifest), BW_OK);
    assert_int_equal(json_array_size(manifest), 2);
    assert_string_equal(json_string_value(json_object_get(json_array_get(manifest, 0), "name")), "a");
    assert_string_equal(json_string_value(json_object_get(json_array_get(manifest, 1), "sha256")), empty_hash);
    assert_string_equal(json_string_value(json_object_get(json_array_get(manifest, 1), "media_type")), "application/json");
    json_decref(manifest);
    fd = bw_store_open_cached(store, key, "a", &bytes);
    assert_true(fd >= 0 && bytes == 3);
    close(fd);
}

static void outputs_that_are_something_else_are_refused(void **state) {
    (void)state;
    json_t *manifest;
    const char *bad[] = {":", "ln -s /etc/passwd out", "mkfifo out", "mkdir out && ln -s /etc/passwd out/a",
                         "mkdir -p out/a", "mkdir out && mkfifo out/a", "mkdir out && touch 'out/a b'", "mkdir out && touch out/.a"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) assert_int_equal(attempt(bad[i], &manifest), BW_E_CHECK);
    assert_false(bw_store_has_cached(store, key));
}

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
enum { SANITIZER = 1 }; /* its allocator takes memory as it likes */
#else
enum { SANITIZER = 0 };
#endif

static size_t data_bytes(void) {
    unsigned long pages = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f && fscanf(f, "%*u %*u %*u %*u %*u %lu", &pages) != 1) pages = 0;
    if (f) fclose(f);
    return pages * (size_t)sysconf(_SC_PAGESIZE);
}

/* In a process of its own that gets 1 MB more than it has: the names alone are 3 MB. */
static bw_status publish_with_little_memory(void) {
    int status = -1;
    pid_t pid = fork();
    if (pid == 0) {
        uint64_t bytes;
        json_t *manifest;
        struct rlimit most = {data_bytes() + (1 << 20), RLIM_INFINITY};
        if (!SANITIZER && setrlimit(RLIMIT_DATA, &most) != 0) _exit(99);
        _exit((int)bw_attempt_publish(store, "job", 1, key, &bytes, &manifest));
    }
    assert_true(pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status));
    return (bw_status)WEXITSTATUS(status);
}

static void more_results_than_any_stage_writes_are_refused_without_reading_all(void **state) {
    (void)state;
    json_t *manifest;
    assert_int_equal(attempt("mkdir out && seq -f out/%04g 1000 | xargs touch", &manifest), BW_OK);
    assert_int_equal(json_array_size(manifest), 1000);
    json_decref(manifest);
    assert_int_equal(attempt("mkdir out && seq -f out/%04g 1001 | xargs touch", &manifest), BW_E_CHECK);
    shell("mkdir -p work/job.1/out && seq -f work/job.1/out/%0100.0f 20000 | xargs touch");
    assert_int_equal(publish_with_little_memory(), BW_E_CHECK);
}

/* Whoever files something finds its folder there, durably: it was synced when the store was opened, not by another who makes it just now. */
static void folders_of_blobs_and_outputs_are_there_from_the_start(void **state) {
    (void)state;
    shell("test $(ls blobs | wc -l) = 256 && test $(ls cache | wc -l) = 256 && test -d blobs/00 && test -d cache/ff");
    bw_store_close(store);
    shell("rmdir blobs/e3 cache/00"); /* what a loss of power has taken */
    assert_int_equal(bw_store_open(folder, &store), BW_OK);
    shell("test -d blobs/e3 && test -d cache/00");
    char actual[BW_SHA256_TEXT];
    assert_true(upload("", empty_hash, actual));
}

static bool nothing(void *user, const char *name) {
    (void)user, (void)name;
    return false;
}

static void a_start_deletes_temporaries_and_a_sweep_what_has_no_row(void **state) {
    (void)state;
    json_t *manifest;
    int dropped;
    assert_int_equal(attempt("mkdir out && touch out/a", &manifest), BW_OK);
    json_decref(manifest);
    shell("touch tmp/upload.1 && mkdir -p work/x.1/out && touch work/x.1/out/f");
    bw_store_close(store);
    assert_int_equal(bw_store_open(folder, &store), BW_OK);
    shell("test -z \"$(ls tmp work | grep -v : )\"");
    assert_true(bw_store_has_cached(store, key));
    assert_int_equal(bw_store_sweep_cache(store, nothing, NULL, &dropped), BW_OK);
    assert_int_equal(dropped, 1);
    assert_false(bw_store_has_cached(store, key));
}

/* As an unprivileged user, whom rights stop. True if `test` says so in a process of its own. */
static bool holds_for_a_user(bool (*test)(void)) {
    int status = -1;
    pid_t pid = fork();
    if (pid == 0) {
        bool user = getuid() != 0 || (chown(folder, 65534, 65534) == 0 && setgroups(0, NULL) == 0 && setgid(65534) == 0 && setuid(65534) == 0);
        _exit(user && chdir(folder) == 0 && test() ? 0 : 1);
    }
    return pid > 0 && waitpid(pid, &status, 0) == pid && WIFEXITED(status) && WEXITSTATUS(status) == 0;
}

/* A worker's chain of folders, deeper than any path is long; all folders may be searched and written, not listed. */
static bool make_deep(const char *name, int depth) {
    int at = open(".", O_RDONLY | O_DIRECTORY), fd = -1;
    for (int i = 0; i < depth && at >= 0; i++) {
        const char *here = i ? "deeper" : name;
        int next = mkdirat(at, here, 0700) == 0 ? openat(at, here, O_RDONLY | O_DIRECTORY) : -1;
        if (next >= 0 && (fd = openat(next, "file", O_WRONLY | O_CREAT, 0)) >= 0) close(fd);
        if (fd < 0 || fchmod(next, 0300) != 0) return false;
        close(at);
        at = next;
    }
    close(at);
    return at >= 0;
}

static bool a_deep_tree_goes(void) {
    bool made = make_deep("deep", 1500) && mkdir("deep/up.0", 0700) == 0 && mkdir("deep/up.0/up.1", 0500) == 0 && mkdir("deep/up.0/up.2", 0) == 0;
    return made && bw_remove_tree("deep") == BW_OK && access("deep", F_OK) != 0;
}

static void a_tree_goes_however_deep_it_is_and_whatever_its_rights(void **state) {
    (void)state;
    assert_true(holds_for_a_user(a_deep_tree_goes));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_blob_is_there_after_its_upload_and_says_its_hash, open_store, close_store),
        cmocka_unit_test_setup_teardown(names_that_are_no_hashes_open_nothing, open_store, close_store),
        cmocka_unit_test_setup_teardown(outputs_are_taken_over_as_files_or_folders, open_store, close_store),
        cmocka_unit_test_setup_teardown(outputs_that_are_something_else_are_refused, open_store, close_store),
        cmocka_unit_test_setup_teardown(more_results_than_any_stage_writes_are_refused_without_reading_all, open_store, close_store),
        cmocka_unit_test_setup_teardown(folders_of_blobs_and_outputs_are_there_from_the_start, open_store, close_store),
        cmocka_unit_test_setup_teardown(a_tree_goes_however_deep_it_is_and_whatever_its_rights, open_store, close_store),
        cmocka_unit_test_setup_teardown(a_start_deletes_temporaries_and_a_sweep_what_has_no_row, open_store, close_store),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
