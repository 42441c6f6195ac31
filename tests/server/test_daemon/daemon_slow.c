/* Clients that take their time, or too many connections: they are cut off, and the others do not notice. */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <unistd.h>

#include "daemon_kit.h"

enum { LORIS = 500, PATIENCE_MS = 30000 };

static kit_daemon d;

static int start(void **state) {
    (void)state;
    struct rlimit files;
    getrlimit(RLIMIT_NOFILE, &files);
    files.rlim_cur = files.rlim_max < 4096 ? files.rlim_max : 4096;
    setrlimit(RLIMIT_NOFILE, &files);
    kit_start(&d, NULL, (const char *const[]){"--header-timeout", "2s", "--body-timeout", "1s", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

/* Has the daemon hung up? What it had to say before that is read away. */
static bool is_cut(int fd) {
    char text[500];
    ssize_t n = recv(fd, text, sizeof text, MSG_DONTWAIT);
    return n == 0 || (n < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
}

static void expect_ready(int times) {
    for (int i = 0; i < times; i++) {
        kit_reply r = kit_get(&d, "/readyz");
        assert_int_equal(r.status, 200);
        kit_free(&r);
    }
}

static void slow_headers_are_cut_off_and_others_are_served(void **state) {
    (void)state;
    static int fds[LORIS];
    static const char request[] = "GET /livez HTTP/1.1\r\nHost: x\r\nX-Slow: ";
    int open = LORIS;
    for (int i = 0; i < LORIS; i++) {
        fds[i] = kit_connect(&d, request, sizeof request - 1);
    }
    expect_ready(50);
    for (int ms = 0; open && ms < PATIENCE_MS; ms += 100, kit_sleep_ms(100)) {
        open = 0;
        for (int i = 0; i < LORIS; i++) {
            if (fds[i] < 0) continue;
            if (send(fds[i], "a", 1, MSG_NOSIGNAL) < 0 || is_cut(fds[i])) {
                close(fds[i]);
                fds[i] = -1;
            } else {
                open++;
            }
        }
        expect_ready(1);
    }
    assert_int_equal(open, 0);
    expect_ready(5);
}

static void a_slow_body_is_cut_off_and_leaves_nothing(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], text[400];
    kit_hash("x", 1, hash);
    int n = snprintf(text, sizeof text, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: x\r\nContent-Length: 4000\r\n\r\n", hash);
    int fd = kit_connect(&d, text, (size_t)n);
    bool cut = false;
    for (int ms = 0; !cut && ms < PATIENCE_MS; ms += 100, kit_sleep_ms(100)) cut = send(fd, "a", 1, MSG_NOSIGNAL) < 0 || is_cut(fd);
    assert_true(cut);
    close(fd);
    assert_true(kit_no_uploads(&d, PATIENCE_MS));
}

/* Of a body in chunks nobody knows the length: it may take what its bytes take at the least rate, however many they are. */
static void a_body_in_chunks_may_take_its_time(void **state) {
    (void)state;
    static const char head[] = "POST /v1/uploads HTTP/1.1\r\nHost: x\r\nTus-Resumable: 1.0.0\r\nUpload-Length: 1000000\r\n"
                               "Content-Type: application/offset+octet-stream\r\nTransfer-Encoding: chunked\r\n\r\n";
    char chunk[2 + 3 + 0x800 + 3];
    int n = snprintf(chunk, sizeof chunk, "800\r\n"), fd = kit_connect(&d, head, sizeof head - 1);
    memset(chunk + n, 'a', 0x800);
    memcpy(chunk + n + 0x800, "\r\n", 2);
    for (int ms = 0; ms < 20000; ms += 200, kit_sleep_ms(200)) /* 10 KiB/s, beyond 1 s and 64 KiB at 4 KiB/s */
        if (send(fd, chunk, (size_t)n + 0x800 + 2, MSG_NOSIGNAL) < 0 || is_cut(fd)) fail_msg("cut off after %d ms", ms);
    close(fd);
}

/* The library alone would sometimes not notice before it has been idle for 30 s. */
static void a_client_that_goes_away_in_its_body_is_noticed(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], text[400];
    kit_hash("x", 1, hash);
    int n = snprintf(text, sizeof text, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: x\r\nContent-Length: 40000000\r\n\r\nbeginning", hash);
    for (int i = 0; i < 20; i++) kit_abandon(&d, text, (size_t)n);
    assert_true(kit_no_uploads(&d, PATIENCE_MS));
}

static void connections_from_one_address_are_limited(void **state) {
    (void)state;
    enum { MOST = 20 };
    static const char request[] = "GET /livez HTTP/1.1\r\nHost: x\r\n\r\n";
    kit_daemon few;
    int fds[MOST + 1];
    kit_start(&few, NULL, (const char *const[]){"--max-connections-per-address", "20", NULL});
    for (int i = 0; i < MOST; i++) {
        fds[i] = kit_connect(&few, request, sizeof request - 1);
        struct pollfd p = {fds[i], POLLIN, 0};
        assert_int_equal(poll(&p, 1, PATIENCE_MS), 1);
        assert_false(is_cut(fds[i]));
    }
    fds[MOST] = kit_connect(&few, request, sizeof request - 1);
    struct pollfd p = {fds[MOST], POLLIN, 0};
    assert_int_equal(poll(&p, 1, PATIENCE_MS), 1);
    assert_true(is_cut(fds[MOST])); /* not a byte */
    for (int i = 0; i <= MOST; i++) close(fds[i]);
    kit_reply r;
    bool served = false;
    for (int i = 0; !served && i < 300; i++, kit_sleep_ms(20))
        if ((served = kit_try(&few, "GET", "/livez", NULL, NULL, 0, &r))) kit_free(&r);
    assert_true(served);
    kit_remove(&few);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slow_headers_are_cut_off_and_others_are_served),
        cmocka_unit_test(a_slow_body_is_cut_off_and_leaves_nothing),
        cmocka_unit_test(a_body_in_chunks_may_take_its_time),
        cmocka_unit_test(a_client_that_goes_away_in_its_body_is_noticed),
        cmocka_unit_test(connections_from_one_address_are_limited),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
