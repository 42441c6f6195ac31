/* A watcher is told exactly once: of news, of its deadline, or of the end; and not at all if it was removed in time. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>
#include <pthread.h>
#include <stdatomic.h>
#include <time.h>

#include "server/clock.h"
#include "server/watch.h"

typedef struct {
    bw_watcher watcher;
    atomic_int told, reason, after; /* after: how many were told before this one */
} listener;

static bw_watch *watch;
static atomic_int order;
static const int64_t far_away = 3600 * 1000;

static void on_told(void *user, bw_watch_reason reason) {
    listener *l = user;
    l->reason = (int)reason;
    l->after = order++;
    l->told++;
}

static void listen_to(listener *l, const char *job, int64_t in_ms) {
    memset(l, 0, sizeof *l);
    bw_watch_add(watch, &l->watcher, job, bw_mono_ms() + in_ms, on_told, l);
}

static int open_watch(void **state) {
    (void)state;
    return bw_watch_open(&watch) == BW_OK ? 0 : -1;
}

static int close_watch(void **state) {
    (void)state;
    bw_watch_close(watch);
    return 0;
}

static void news_go_to_the_watchers_of_that_job_once(void **state) {
    (void)state;
    listener a, b, other, all;
    listen_to(&a, "job1", far_away);
    listen_to(&b, "job1", far_away);
    listen_to(&other, "job2", far_away);
    listen_to(&all, "", far_away);
    bw_watch_notify(watch, "job1");
    bw_watch_notify(watch, "job1");
    assert_int_equal(a.told, 1);
    assert_int_equal(b.told, 1);
    assert_int_equal(all.told, 1);
    assert_int_equal(other.told, 0);
    assert_int_equal(a.reason, BW_WATCH_NEWS);
    assert_true(bw_watch_remove(watch, &other.watcher));
}

static void talk_is_told_to_those_who_listen(void **state) {
    (void)state;
    listener plain, listens, other;
    listen_to(&plain, "job1", far_away);
    memset(&listens, 0, sizeof listens);
    memset(&other, 0, sizeof other);
    bw_watch_listen(watch, &listens.watcher, "job1", bw_mono_ms() + far_away, on_told, &listens);
    bw_watch_listen(watch, &other.watcher, "job2", bw_mono_ms() + far_away, on_told, &other);
    bw_watch_murmur(watch, "job1");
    assert_int_equal(listens.told, 1);
    assert_int_equal(plain.told + other.told, 0);
    bw_watch_listen(watch, &listens.watcher, "job1", bw_mono_ms() + far_away, on_told, &listens);
    bw_watch_notify(watch, "job1");
    assert_int_equal(listens.told, 2);
    assert_int_equal(plain.told, 1);
    bw_watch_stop(watch);
    assert_int_equal(other.told, 1);
    assert_true(bw_watch_stopped(watch));
}

static void a_removed_watcher_is_not_told(void **state) {
    (void)state;
    listener a;
    listen_to(&a, "job1", far_away);
    assert_true(bw_watch_remove(watch, &a.watcher));
    bw_watch_notify(watch, "job1");
    assert_int_equal(a.told, 0);
    assert_false(bw_watch_remove(watch, &a.watcher));
    listen_to(&a, "job1", far_away);
    bw_watch_notify(watch, "job1");
    assert_false(bw_watch_remove(watch, &a.watcher)); /* it has been told */
    assert_int_equal(a.told, 1);
}

static void deadlines_come_in_their_order(void **state) {
    (void)state;
    enum { MANY = 50 };
    listener l[MANY];
    for (int i = 0; i < MANY; i++) listen_to(&l[i], "job", 20 + (i * 37) % MANY * 2);
    for (int i = 0; i < MANY; i++)
        while (!l[i].told) nanosleep(&(struct timespec){0, 1000000}, NULL);
    for (int i = 0; i < MANY; i++) {
        assert_int_equal(l[i].reason, BW_WATCH_TIME);
        assert_int_equal(l[i].told, 1);
        for (int k = 0; k < MANY; k++)
            if (l[i].watcher.deadline < l[k].watcher.deadline) assert_true(l[i].after < l[k].after);
    }
}

static void the_end_is_told_to_all_and_to_those_who_come_later(void **state) {
    (void)state;
    listener before, late;
    listen_to(&before, "job", far_away);
    bw_watch_stop(watch);
    assert_true(before.told == 1 && before.reason == BW_WATCH_STOP);
    listen_to(&late, "job", far_away);
    assert_true(late.told == 1 && late.reason == BW_WATCH_STOP);
}

enum { ROUNDS = 3000 };

static void *notify_often(void *user) {
    for (int i = 0; i < ROUNDS; i++) bw_watch_notify(watch, user);
    return NULL;
}

static void told_or_removed_but_never_both_nor_neither(void **state) {
    (void)state;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, notify_often, "job"), 0);
    for (int i = 0; i < ROUNDS; i++) {
        listener l;
        listen_to(&l, "job", i % 2 ? far_away : 0);
        bool removed = bw_watch_remove(watch, &l.watcher);
        assert_int_equal(l.told, removed ? 0 : 1);
    }
    pthread_join(thread, NULL);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(news_go_to_the_watchers_of_that_job_once, open_watch, close_watch),
        cmocka_unit_test_setup_teardown(talk_is_told_to_those_who_listen, open_watch, close_watch),
        cmocka_unit_test_setup_teardown(a_removed_watcher_is_not_told, open_watch, close_watch),
        cmocka_unit_test_setup_teardown(deadlines_come_in_their_order, open_watch, close_watch),
        cmocka_unit_test_setup_teardown(the_end_is_told_to_all_and_to_those_who_come_later, open_watch, close_watch),
        cmocka_unit_test_setup_teardown(told_or_removed_but_never_both_nor_neither, open_watch, close_watch),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
