/* DATA/control: its thread does not spin. */
#include "queue_kit.h"

#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "server/admin.h"

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

/* ---- */

static int open_all(void **state) {
    starved = false;
    refused = 0;
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

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_thread_without_descriptors_waits_for_them, open_all, close_all),
        cmocka_unit_test_setup_teardown(it_ends_also_without_descriptors, open_all, close_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
