/* DATA/control: its thread does not spin, and what it does ends with the daemon. */
#include "queue_kit.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "server/admin.h"

enum { BLOBS = 40 };

static bw_config config;
static bw_store *store;
static bw_retention *retention;
static bw_access *tokens;
static bw_admin *admin;

/* ---- the kernel's part ---- */

static atomic_bool starved; /* there are no descriptors */
static atomic_int refused;
int accept4(int fd, struct sockaddr *address, socklen_t *size, int flags) {
    if (!starved) return (int)syscall(SYS_accept4, fd, address, size, flags);
    refused++;
    errno = EMFILE;
    return -1;
}

static atomic_bool slow; /* the first link waits until the daemon is being stopped */
static atomic_bool stopping;
static atomic_int links;
int link(const char *from, const char *to) {
    links++;
    while (slow && !stopping) usleep(1000);
    return (int)syscall(SYS_linkat, AT_FDCWD, from, AT_FDCWD, to, 0);
}

int pthread_join(pthread_t thread, void **value) {
    int (*join)(pthread_t, void **) = (int (*)(pthread_t, void **))dlsym(RTLD_NEXT, "pthread_join");
    stopping = true;
    return join(thread, value);
}

/* ---- */

static int open_all(void **state) {
    starved = slow = stopping = false;
    refused = links = 0;
    if (open_queue(state) != 0 || bw_store_open(folder, &store) != BW_OK || bw_access_open(q, &tokens) != BW_OK) return -1;
    snprintf(config.data, sizeof config.data, "%s", folder);
    if (bw_retention_open(&config, store, q, &retention) != BW_OK) return -1;
    bw_admin_services services = {.config = &config, .store = store, .queue = q, .access = tokens, .retention = retention};
    return bw_admin_start(folder, &services, &admin) != BW_OK;
}

static int close_all(void **state) {
    bw_admin_stop(admin);
    bw_retention_close(retention);
    bw_access_close(tokens);
    bw_store_close(store);
    return close_queue(state);
}

typedef struct {
    json_t *request, *answer;
    char error[BW_ADMIN_ERROR];
    pthread_t thread;
} asking;

static void *ask(void *user) {
    asking *a = user;
    a->answer = bw_admin_ask(&config, a->request, a->error);
    return NULL;
}

static void begin_asking(asking *a, json_t *request) {
    *a = (asking){.request = request};
    assert_int_equal(pthread_create(&a->thread, NULL, ask, a), 0);
}

static void a_thread_without_descriptors_waits_for_them(void **state) {
    (void)state;
    asking a;
    starved = true;
    begin_asking(&a, json_pack("{s:s}", "command", "token list"));
    while (!refused) usleep(1000);
    usleep(300000);
    print_message("asked %d times\n", (int)refused);
    if (refused > 100) fail_msg("asked %d times", (int)refused);
    starved = false;
    assert_int_equal(pthread_join(a.thread, NULL), 0);
    assert_non_null(a.answer);
    json_decref(a.answer);
}

static void it_ends_also_without_descriptors(void **state) {
    (void)state;
    asking a;
    starved = true;
    begin_asking(&a, json_pack("{s:s}", "command", "token list"));
    while (!refused) usleep(1000);
    bw_admin_stop(admin);
    admin = NULL;
    assert_int_equal(pthread_join(a.thread, NULL), 0);
    json_decref(a.answer); /* of nobody, or its own: the folder's lock is free */
}

static void a_backup_ends_with_the_daemon(void **state) {
    (void)state;
    asking a;
    char name[200], sha256[BW_SHA256_TEXT];
    bw_upload *u;
    bool matches, added;
    for (int i = 0; i < BLOBS; i++) {
        char none[BW_SHA256_TEXT] = "";
        for (int again = 0; again < 2; again++) {
            assert_int_equal(bw_upload_begin(store, &u), BW_OK);
            assert_int_equal(bw_upload_write(u, &i, sizeof i), BW_OK);
            if (again) assert_int_equal(bw_upload_finish(u, sha256, &matches, none), BW_OK);
            else assert_int_equal(bw_upload_finish(u, none, &matches, sha256), BW_OK);
        }
        assert_int_equal(bw_queue_adopt_blob(q, sha256, sizeof i, 1000, &added), BW_OK);
    }
    links = 0;
    slow = true;
    snprintf(name, sizeof name, "%s.backup", folder);
    begin_asking(&a, json_pack("{s:s, s:s, s:b}", "command", "backup", "file", name, "with_files", 1));
    while (!links) usleep(1000);
    bw_admin_stop(admin);
    admin = NULL;
    assert_int_equal(pthread_join(a.thread, NULL), 0);
    assert_null(a.answer);
    if (!strstr(a.error, "the daemon is stopping")) fail_msg("%s", a.error);
    assert_int_equal(links, 1);
    assert_int_equal(access(name, F_OK), -1);
    snprintf(name, sizeof name, "%s.backup.files", folder);
    assert_int_equal(access(name, F_OK), -1);
    snprintf(name, sizeof name, "%s.backup.manifest", folder);
    assert_int_equal(access(name, F_OK), -1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_thread_without_descriptors_waits_for_them, open_all, close_all),
        cmocka_unit_test_setup_teardown(it_ends_also_without_descriptors, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_backup_ends_with_the_daemon, open_all, close_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
