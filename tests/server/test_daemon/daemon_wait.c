/* Prefer: wait=N (RFC 7240): the answer comes when the job has ended or the time is over; nothing blocks meanwhile, and a daemon that
 * stops lets nobody wait. */
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon_kit.h"

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "2", NULL});
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply get_waiting(const char *id, const char *prefer) {
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    return kit_request(&d, "GET", path, prefer, NULL, 0);
}

static void expect_state(kit_reply r, long status, const char *applied, const char *state) {
    assert_int_equal(r.status, status);
    assert_string_equal(r.applied, applied);
    json_t *job = kit_json(&r);
    assert_string_equal(kit_text(job, "state"), state);
    json_decref(job);
}

static void an_answer_waits_for_the_end_of_the_job(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "sanitize sleep 700\n# waits\n", NULL, id);
    expect_state(get_waiting(id, "Prefer: wait=50"), 200, "wait=50", "successful");
    expect_state(get_waiting(id, "Prefer: wait=50"), 200, "wait=50", "successful"); /* ended already */
}

static void an_answer_comes_when_the_time_is_over(void **state) {
    (void)state;
    char id[32];
    kit_submit(&d, "sanitize sleep 30000\n# too slow\n", NULL, id);
    expect_state(get_waiting(id, "Prefer: respond-async, wait = 1"), 200, "wait=1", "running");
    expect_state(get_waiting(id, "Prefer: respond-async, wait\nPrefer: wait=1\nPrefer: wait=50"), 200, "wait=1", "running");
    for (const char *const *p = (const char *const[]){"Prefer: wait=x", "Prefer: wait=", "Prefer: wait", "Prefer: waiting=9", "Prefer: wait=0",
                                                      "Prefer: wait=9s", "Prefer: return=minimal", NULL}; *p; p++)
        expect_state(get_waiting(id, *p), 200, "", "running");
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    kit_free(&r);
    expect_state(get_waiting(id, "Prefer: wait=9999"), 200, "wait=60", "dismissed");
}

static void a_new_job_is_answered_with_its_end(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], body[200];
    kit_upload(&d, "sanitize sleep 300\n# submitted\n", hash);
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\"}", hash);
    kit_reply r = kit_request(&d, "POST", "/v1/jobs", "Content-Type: application/json\nPrefer: wait=50", body, (size_t)n);
    assert_true(strncmp(r.location, "/v1/jobs/", 9) == 0);
    expect_state(r, 201, "wait=50", "successful");
}

static void waiting_for_what_is_not_there_is_404_at_once(void **state) {
    (void)state;
    kit_expect_problem(get_waiting("000000000000000000000000", "Prefer: wait=50"), 404, "no-such-job");
    char id[64];
    kit_submit(&d, "# ended\n", NULL, id);
    json_decref(kit_wait(&d, id, 20));
    strcat(id, "0");
    kit_expect_problem(get_waiting(id, "Prefer: wait=50"), 404, "no-such-job");
}

typedef struct {
    char id[32];
    kit_reply reply;
    bool answered;
} waiter;

static void *wait_long(void *user) {
    waiter *w = user;
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s", w->id);
    w->answered = kit_try(&d, "GET", path, "Prefer: wait=60", NULL, 0, &w->reply);
    return NULL;
}

enum { WAITERS = 40 }; /* ten times the HTTP threads */

static void many_wait_and_others_are_served(void **state) {
    (void)state;
    static waiter waiters[WAITERS];
    pthread_t threads[WAITERS];
    char id[32];
    kit_submit(&d, "sanitize sleep 30000\n# many\n", NULL, id);
    for (int i = 0; i < WAITERS; i++) {
        strcpy(waiters[i].id, id);
        assert_int_equal(pthread_create(&threads[i], NULL, wait_long, &waiters[i]), 0);
    }
    for (int i = 0; i < 50; i++) {
        kit_reply r = kit_get(&d, "/livez");
        assert_int_equal(r.status, 200);
        kit_free(&r);
        kit_sleep_ms(5);
    }
    char path[80];
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    kit_free(&r);
    for (int i = 0; i < WAITERS; i++) {
        pthread_join(threads[i], NULL);
        assert_true(waiters[i].answered);
        expect_state(waiters[i].reply, 200, "wait=60", "dismissed");
    }
}

/* Their clients are gone before the answer; the daemon answers into the void and lives on. */
static void waiters_that_hang_up_do_no_harm(void **state) {
    (void)state;
    char id[32], text[200], path[80];
    kit_submit(&d, "sanitize sleep 30000\n# gone\n", NULL, id);
    int n = snprintf(text, sizeof text, "GET /v1/jobs/%s HTTP/1.1\r\nHost: x\r\nPrefer: wait=30\r\n\r\n", id);
    for (int i = 0; i < 20; i++) kit_abandon(&d, text, (size_t)n);
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    kit_free(&r);
    json_decref(kit_wait(&d, id, 20));
    r = kit_get(&d, "/livez");
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

static void a_daemon_that_stops_answers_those_who_wait(void **state) {
    (void)state;
    static waiter w;
    pthread_t thread;
    kit_submit(&d, "sanitize sleep 30000\n# stopped\n", NULL, w.id);
    kit_wait_state(&d, w.id, "running", 20);
    assert_int_equal(pthread_create(&thread, NULL, wait_long, &w), 0);
    kit_sleep_ms(300);
    assert_int_equal(kit_stop(&d), 0);
    pthread_join(thread, NULL);
    assert_true(w.answered);
    expect_state(w.reply, 200, "wait=60", "running");
    kit_restart(&d, NULL);
    snprintf(w.reply.location, sizeof w.reply.location, "/v1/jobs/%s/cancel", w.id);
    kit_reply r = kit_request(&d, "POST", w.reply.location, NULL, NULL, 0);
    kit_free(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_answer_waits_for_the_end_of_the_job),
        cmocka_unit_test(an_answer_comes_when_the_time_is_over),
        cmocka_unit_test(a_new_job_is_answered_with_its_end),
        cmocka_unit_test(waiting_for_what_is_not_there_is_404_at_once),
        cmocka_unit_test(many_wait_and_others_are_served),
        cmocka_unit_test(waiters_that_hang_up_do_no_harm),
        cmocka_unit_test(a_daemon_that_stops_answers_those_who_wait),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
