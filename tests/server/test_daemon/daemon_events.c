/* Streams of events: what a client sees over any number of cuts is the journal, once and in order; they end with the job, with the daemon
 * and when the client has gone; slow clients hold up nobody. */
#include <signal.h>
#include <sqlite3.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "bw_api.h"
#include "stream_kit.h"

static kit_daemon d;
static CURLM *multi;
static const char *const arguments[] = {"--workers", "2", "--owner-streams", "250", "--stream-comment", "200ms", NULL};

static int start(void **state) {
    (void)state;
    unsigned seed = (unsigned)time(NULL);
    printf("seed %u\n", seed);
    srand(seed);
    curl_global_init(CURL_GLOBAL_DEFAULT);
    multi = curl_multi_init();
    kit_start(&d, NULL, arguments);
    return 0;
}

static int stop(void **state) {
    (void)state;
    curl_multi_cleanup(multi);
    kit_remove(&d);
    return 0;
}

static const char *path_of(const char *id, const char *rest) {
    static char path[120];
    snprintf(path, sizeof path, "/v1/jobs/%s/%s", id, rest);
    return path;
}

static void cancel(const char *id) {
    kit_reply r = kit_request(&d, "POST", path_of(id, "cancel"), NULL, NULL, 0);
    kit_free(&r);
}

/* ---- the journal, and what was seen of it ---- */

typedef struct {
    long long id;
    char job[32], change[16];
} seen;

typedef struct {
    seen list[2000];
    size_t count;
} record;

static void add(record *to, long long id, const char *job, const char *change) {
    assert_true(to->count < sizeof to->list / sizeof *to->list);
    seen *s = &to->list[to->count++];
    s->id = id;
    snprintf(s->job, sizeof s->job, "%s", job);
    snprintf(s->change, sizeof s->change, "%s", change);
}

/* As it is in the file. */
static void read_journal(record *to, const char *job) {
    char path[100];
    sqlite3 *db;
    sqlite3_stmt *stmt;
    snprintf(path, sizeof path, "%s/jobs.db", d.data);
    assert_int_equal(sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
    sqlite3_busy_timeout(db, 5000);
    assert_int_equal(sqlite3_prepare_v2(db, "SELECT seq, job, kind FROM events WHERE ?1 IS NULL OR job = ?1 ORDER BY seq", -1, &stmt, NULL), SQLITE_OK);
    sqlite3_bind_text(stmt, 1, job, -1, SQLITE_STATIC);
    to->count = 0;
    while (sqlite3_step(stmt) == SQLITE_ROW)
        add(to, sqlite3_column_int64(stmt, 0), (const char *)sqlite3_column_text(stmt, 1), (const char *)sqlite3_column_text(stmt, 2));
    sqlite3_finalize(stmt);
    sqlite3_close(db);
}

/* Adds what a stream has brought; true if it said that the job has ended. */
static bool add_stream(record *to, const kit_stream *s) {
    kit_sse e = {.next = s->text};
    bool end = false;
    while (kit_stream_next(&e)) {
        json_t *data = json_loads(e.data, 0, NULL);
        assert_non_null(data);
        assert_false(end); /* it is the last */
        if (e.id >= 0) {
            bool stage = strcmp(kit_text(data, "change"), "started") == 0 || strcmp(kit_text(data, "change"), "done") == 0 ||
                         strcmp(kit_text(data, "change"), "reused") == 0;
            assert_string_equal(e.event, stage ? "stage" : "state");
            add(to, e.id, kit_text(data, "job"), kit_text(data, "change"));
        }
        end = strcmp(e.event, "end") == 0;
        json_decref(data);
        free(e.data);
    }
    return end;
}

static void expect_equal(const record *a, const record *b) {
    assert_int_equal(a->count, b->count);
    for (size_t i = 0; i < a->count; i++) {
        assert_int_equal(a->list[i].id, b->list[i].id);
        assert_string_equal(a->list[i].job, b->list[i].job);
        assert_string_equal(a->list[i].change, b->list[i].change);
    }
}

/* One connection that is cut after a random number of bytes, or of ms, whatever is first. True at the end of the job. */
static bool look_in(record *sees, const char *path, size_t most, int ms) {
    kit_stream s;
    char last[60] = "";
    if (sees->count) snprintf(last, sizeof last, "Last-Event-ID: %lld", sees->list[sees->count - 1].id);
    kit_stream_open(&s, multi, &d, path, last, most);
    for (int i = 0; !s.over && i < ms; i += 10) kit_stream_run(multi, 10);
    assert_true(!s.over || s.status == 200 || s.status == 204);
    bool end = add_stream(sees, &s) || (s.over && s.status == 204);
    kit_stream_close(&s, multi);
    return end;
}

/* ---- tests ---- */

static void a_stream_tells_all_of_a_job_and_ends(void **state) {
    (void)state;
    static record told, journal;
    kit_stream s;
    char id[32];
    kit_submit(&d, "sanitize sleep 600\nreduce search 600\n# whole\n", NULL, id);
    kit_stream_whole(&s, multi, &d, path_of(id, "events"), NULL, 60);
    assert_int_equal(s.status, 200);
    told.count = 0;
    assert_true(add_stream(&told, &s));
    read_journal(&journal, id);
    assert_int_equal(journal.count, 1 + 2 * BW_API_STAGE_COUNT);
    expect_equal(&told, &journal);
    assert_true(kit_stream_count(&s, "progress") > 0);
    assert_true(kit_stream_count(&s, "note") > 0);
    assert_true(strncmp(s.text, "retry: ", 7) == 0);
    kit_stream_close(&s, multi);
    kit_reply r = kit_get(&d, "/v1/jobs/%s/events", id);
    assert_string_equal(r.type, "text/event-stream");
    assert_string_equal(kit_header(&r, "Cache-Control"), "no-store");
    assert_string_equal(kit_header(&r, "X-Accel-Buffering"), "no");
    kit_free(&r);
}

static void an_event_names_the_stage_that_it_is_about(void **state) {
    (void)state;
    kit_stream s;
    char id[32];
    int done = 0;
    kit_submit(&d, "# stages\n", NULL, id);
    kit_stream_whole(&s, multi, &d, path_of(id, "events"), NULL, 60);
    for (kit_sse e = {.next = s.text}; kit_stream_next(&e); free(e.data)) {
        json_t *data = json_loads(e.data, 0, NULL);
        if (strcmp(e.event, "stage") == 0) assert_string_equal(kit_text(data, "stage"), bw_api_stages[done].name);
        done += strcmp(kit_text(data, "change"), "done") == 0;
        json_decref(data);
    }
    assert_int_equal(done, BW_API_STAGE_COUNT - 1);
    kit_stream_close(&s, multi);
}

static void random_cuts_and_restarts_leave_no_gap_and_repeat_nothing(void **state) {
    (void)state;
    static record sees, journal;
    char id[32];
    int cuts = 0;
    kit_submit(&d, "* sleep 250\n# cuts\n", NULL, id);
    sees.count = 0;
    for (; !look_in(&sees, path_of(id, "events"), 40 + (size_t)rand() % 900, 20 + rand() % 300); cuts++) {
        assert_true(cuts < 2000);
        if (cuts != 5 && cuts != 12) continue;
        kit_kill(&d, cuts == 5 ? SIGKILL : SIGTERM);
        kit_restart(&d, arguments);
    }
    read_journal(&journal, id);
    expect_equal(&sees, &journal);
    assert_true(cuts >= 13);
}

/* With a failure, a retry by the daemon, a reuse of the cache and a cancel; other jobs' events come between. */
static void the_stream_of_all_jobs_is_the_journal(void **state) {
    (void)state;
    static record sees, journal;
    char id[4][32];
    kit_submit(&d, "trace flaky 3\n# flaky\n", NULL, id[0]);
    kit_submit(&d, "build fail algorithm\n# fails\n", NULL, id[1]);
    kit_submit(&d, "# stages\n", NULL, id[2]); /* reused */
    kit_submit(&d, "sanitize sleep 60000\n# cancelled\n", NULL, id[3]);
    sees.count = 0;
    for (int i = 0; i < 30; i++) look_in(&sees, "/v1/events?after=0", 500 + (size_t)rand() % 4000, 200);
    cancel(id[3]);
    for (int i = 0; i < 4; i++) json_decref(kit_wait(&d, id[i], 60));
    read_journal(&journal, NULL);
    for (int i = 0; sees.count < journal.count && i < 200; i++) look_in(&sees, "/v1/events?after=0", 0, 100);
    expect_equal(&sees, &journal);
}

static void whoever_has_seen_the_end_gets_204(void **state) {
    (void)state;
    static record journal;
    char id[32], headers[60];
    kit_submit(&d, "# seen\n", NULL, id);
    json_decref(kit_wait(&d, id, 30));
    read_journal(&journal, id);
    snprintf(headers, sizeof headers, "Last-Event-ID: %lld", journal.list[journal.count - 1].id);
    kit_reply r = kit_request(&d, "GET", path_of(id, "events"), headers, NULL, 0);
    assert_int_equal(r.status, 204);
    kit_free(&r);
    snprintf(headers, sizeof headers, "Last-Event-ID: %lld", journal.list[journal.count - 1].id + 1000000); /* of another daemon */
    r = kit_request(&d, "GET", path_of(id, "events"), headers, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_non_null(strstr(r.body, "event: end"));
    kit_free(&r);
    snprintf(headers, sizeof headers, "events?after=%lld", journal.list[journal.count - 1].id);
    r = kit_get(&d, "%s", path_of(id, headers));
    assert_int_equal(r.status, 204);
    kit_free(&r);
    kit_expect_problem(kit_request(&d, "GET", path_of(id, "events"), "Last-Event-ID: x", NULL, 0), 400, "bad-request");
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "events?after=-1")), 400, "invalid-parameter");
    kit_expect_problem(kit_get(&d, "/v1/jobs/000000000000000000000000/events"), 404, "no-such-job");
}

static void head_and_old_clients_are_answered(void **state) {
    (void)state;
    char id[32], text[160];
    kit_submit(&d, "sanitize sleep 700\n# head\n", NULL, id);
    kit_reply r = kit_request(&d, "HEAD", path_of(id, "events"), NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_int_equal(r.size, 0);
    kit_free(&r);
    int n = snprintf(text, sizeof text, "GET /v1/jobs/%s/events HTTP/1.0\r\nHost: localhost\r\n\r\n", id);
    char *all = kit_raw(&d, text, (size_t)n, false);
    assert_non_null(strstr(all, "event: end\n"));
    assert_null(strstr(all, "chunked"));
    free(all);
}

enum { MANY = 200 };

static long long metric_streams(void) {
    kit_reply r = kit_get(&d, "/metrics");
    const char *line = strstr(r.body, "\nblockwright_http_streams ");
    assert_non_null(line);
    long long n = atoll(line + sizeof "\nblockwright_http_streams " - 1);
    kit_free(&r);
    return n;
}

static void expect_streams(long long wanted) {
    for (int i = 0; i < 400 && metric_streams() != wanted; i++) kit_sleep_ms(25);
    assert_int_equal(metric_streams(), wanted);
}

static void many_streams_hold_up_nobody_and_all_end(void **state) {
    (void)state;
    static kit_stream streams[MANY];
    char id[32];
    kit_submit(&d, "sanitize sleep 60000\n# many\n", NULL, id);
    for (int i = 0; i < MANY; i++) kit_stream_open(&streams[i], multi, &d, path_of(id, "events"), NULL, 0);
    for (int i = 0, there = 0; i < 2000 && there < MANY; i++, there = 0) {
        kit_stream_run(multi, 10);
        for (int k = 0; k < MANY; k++) there += strstr(streams[k].text, "\"started\"") && strstr(streams[k].text, ":\n\n");
    }
    expect_streams(MANY);
    kit_reply r = kit_get(&d, "/livez");
    assert_int_equal(r.status, 200);
    kit_free(&r);
    cancel(id);
    for (int i = 0; i < 4000 && kit_stream_run(multi, 10) > 0; i++) continue;
    for (int i = 0; i < MANY; i++) {
        assert_true(streams[i].over);
        assert_int_equal(streams[i].code, CURLE_OK);
        assert_int_equal(kit_stream_count(&streams[i], "end"), 1);
        kit_stream_close(&streams[i], multi);
    }
    expect_streams(0);
}

static void an_owner_has_so_many_streams_and_vanished_clients_are_noticed(void **state) {
    (void)state;
    static int sockets[250];
    char id[32], text[160];
    kit_submit(&d, "sanitize sleep 60000\n# quota\n", NULL, id);
    int n = snprintf(text, sizeof text, "GET /v1/jobs/%s/events HTTP/1.1\r\nHost: localhost\r\n\r\n", id);
    for (int i = 0; i < 250; i++) sockets[i] = kit_connect(&d, text, (size_t)n);
    expect_streams(250);
    kit_reply r = kit_get(&d, "%s", path_of(id, "events"));
    assert_string_not_equal(kit_header(&r, "Retry-After"), "");
    kit_expect_problem(r, 429, "too-many-streams");
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "log?follow=true")), 429, "too-many-streams");
    kit_expect_problem(kit_get(&d, "/v1/events"), 429, "too-many-streams");
    for (int i = 0; i < 250; i++) close(sockets[i]);
    expect_streams(0);
    cancel(id);
}

static void a_log_is_followed_over_cuts(void **state) {
    (void)state;
    char id[32], headers[60], *all = calloc(1, 1 << 20);
    long long last = 0;
    size_t size = 0;
    int cuts = 0;
    kit_submit(&d, "* log one\n* sleep 120\n* log two\ntrace frames 60000\nbuild chatter 60000\n# log\n", NULL, id);
    for (bool end = false; !end; cuts++) {
        kit_stream s;
        assert_true(cuts < 2000);
        snprintf(headers, sizeof headers, "Last-Event-ID: %lld", last);
        kit_stream_open(&s, multi, &d, path_of(id, "log?follow=true"), headers, 100 + (size_t)rand() % 20000);
        for (int i = 0; !s.over && i < 200 + rand() % 300; i += 10) kit_stream_run(multi, 10);
        for (kit_sse e = {.next = s.text}; kit_stream_next(&e); free(e.data)) {
            end = end || strcmp(e.event, "end") == 0;
            if (strcmp(e.event, "log") != 0) continue;
            size += (size_t)snprintf(all + size, (1 << 20) - size, "%s\n", e.data);
            last = e.id;
            assert_int_equal(last, size);
        }
        end = end || (s.over && s.status == 204);
        kit_stream_close(&s, multi);
    }
    kit_reply r = kit_get(&d, "%s", path_of(id, "log"));
    assert_int_equal(r.size, size);
    assert_string_equal(r.body, all);
    assert_true(cuts > 3);
    kit_free(&r);
    free(all);
}

static void the_end_of_a_log_is_what_tail_says(void **state) {
    (void)state;
    char id[32], path[40];
    kit_submit(&d, "sanitize log first\nsanitize log second\ntrace frames 40000\ntrace log third\n# tail\n", NULL, id);
    json_decref(kit_wait(&d, id, 30));
    kit_reply whole = kit_get(&d, "%s", path_of(id, "log"));
    for (int lines = 1; lines < 100; lines = 3 * lines + 1) {
        const char *at = whole.body + whole.size - 1;
        for (int n = 0; at > whole.body && (n += at[-1] == '\n') < lines;) at--;
        snprintf(path, sizeof path, "log?tail=%d", lines);
        kit_reply r = kit_get(&d, "%s", path_of(id, path));
        assert_string_equal(r.body, at);
        kit_free(&r);
    }
    kit_reply r = kit_get(&d, "%s", path_of(id, "log?tail=10000"));
    assert_string_equal(r.body, whole.body);
    kit_free(&r);
    kit_stream s;
    kit_stream_whole(&s, multi, &d, path_of(id, "log?tail=1&follow=true"), NULL, 30);
    assert_int_equal(kit_stream_count(&s, "log"), 1);
    assert_non_null(strstr(s.text, "third"));
    assert_null(strstr(s.text, "second"));
    kit_stream_close(&s, multi);
    kit_free(&whole);
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "log?tail=0")), 400, "invalid-parameter");
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "log?follow=yes")), 400, "invalid-parameter");
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "log?after=3")), 400, "invalid-parameter");
}

/* Takes no byte while 3 MB are logged, and has all of them afterwards. */
static void a_slow_reader_loses_nothing_and_holds_up_nobody(void **state) {
    (void)state;
    char id[32], text[160], buffer[65536];
    size_t size = 0;
    kit_submit(&d, "sanitize frames 3000000\n# slow\n", NULL, id);
    int n = snprintf(text, sizeof text, "GET /v1/jobs/%s/log?follow=true HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n", id);
    int fd = kit_connect(&d, text, (size_t)n);
    json_decref(kit_wait(&d, id, 60));
    kit_reply r = kit_get(&d, "%s", path_of(id, "log"));
    assert_true(r.size > 2000000);
    char tail[8] = "";
    for (ssize_t got; (got = recv(fd, buffer, sizeof buffer, 0)) > 0; size += (size_t)got)
        if (got >= 7) memcpy(tail, buffer + got - 7, 7);
    assert_true(size > r.size);
    assert_string_equal(tail + 2, "0\r\n\r\n");
    close(fd);
    kit_free(&r);
}

static void a_deleted_job_ends_its_streams(void **state) {
    (void)state;
    kit_stream s;
    char id[32], path[60];
    kit_submit(&d, "# deleted\n", NULL, id);
    json_decref(kit_wait(&d, id, 30));
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    kit_reply r = kit_request(&d, "DELETE", path, NULL, NULL, 0);
    assert_int_equal(r.status, 204);
    kit_free(&r);
    kit_expect_problem(kit_get(&d, "%s", path_of(id, "events")), 410, "job-gone");
    kit_stream_open(&s, multi, &d, "/v1/events?after=0", NULL, 0);
    for (int i = 0; i < 200 && !strstr(s.text, ":\n\n"); i++) kit_stream_run(multi, 20);
    assert_null(strstr(s.text, id));
    kit_stream_close(&s, multi);
}

static void a_daemon_that_stops_ends_all_streams(void **state) {
    (void)state;
    kit_stream s[3];
    char id[32];
    kit_submit(&d, "sanitize sleep 60000\n# stops\n", NULL, id);
    kit_stream_open(&s[0], multi, &d, path_of(id, "events"), NULL, 0);
    kit_stream_open(&s[1], multi, &d, path_of(id, "log?follow=true"), NULL, 0);
    kit_stream_open(&s[2], multi, &d, "/v1/events", NULL, 0);
    for (int i = 0; i < 1000 && !(strstr(s[0].text, "started") && strstr(s[1].text, ":\n") && strstr(s[2].text, ":\n")); i++) kit_stream_run(multi, 10);
    assert_int_equal(kit_stop(&d), 0);
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 500 && !s[i].over; k++) kit_stream_run(multi, 10);
        assert_true(s[i].over);
        assert_int_equal(s[i].code, CURLE_OK); /* ended, not cut */
        assert_int_equal(kit_stream_count(&s[i], "end"), 0);
        kit_stream_close(&s[i], multi);
    }
    kit_restart(&d, arguments);
    cancel(id);
    json_decref(kit_wait(&d, id, 30));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_stream_tells_all_of_a_job_and_ends),
        cmocka_unit_test(an_event_names_the_stage_that_it_is_about),
        cmocka_unit_test(random_cuts_and_restarts_leave_no_gap_and_repeat_nothing),
        cmocka_unit_test(the_stream_of_all_jobs_is_the_journal),
        cmocka_unit_test(whoever_has_seen_the_end_gets_204),
        cmocka_unit_test(head_and_old_clients_are_answered),
        cmocka_unit_test(many_streams_hold_up_nobody_and_all_end),
        cmocka_unit_test(an_owner_has_so_many_streams_and_vanished_clients_are_noticed),
        cmocka_unit_test(a_log_is_followed_over_cuts),
        cmocka_unit_test(the_end_of_a_log_is_what_tail_says),
        cmocka_unit_test(a_slow_reader_loses_nothing_and_holds_up_nobody),
        cmocka_unit_test(a_deleted_job_ends_its_streams),
        cmocka_unit_test(a_daemon_that_stops_ends_all_streams),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
