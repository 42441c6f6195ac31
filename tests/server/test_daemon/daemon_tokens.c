/* The life of tokens, and a daemon without any. */
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "access_kit.h"
#include "server/admin.h"

static int fresh(void **state) {
    kit_daemon *d = calloc(1, sizeof *d);
    kit_start(d, NULL, (const char *const[]){"--host-names", "mesh.example,other", NULL});
    *state = d;
    return 0;
}

static int gone(void **state) {
    kit_remove(*state);
    free(*state);
    return 0;
}

static long status_of(const kit_daemon *d, const char *secret) {
    kit_reply r = kit_ask(d, secret, "GET", "/v1/jobs", NULL);
    kit_free(&r);
    return r.status;
}

static void the_first_token_closes_a_running_daemon_for_good(void **state) {
    kit_daemon *d = *state;
    char id[32], path[60];
    kit_submit(d, "# from before\n", NULL, id);
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    assert_int_equal(status_of(d, NULL), 200);
    kit_token user = kit_new_token(d, "user", ""), admin = kit_new_token(d, "root", "--scopes admin");
    assert_int_equal(status_of(d, NULL), 401);
    assert_int_equal(status_of(d, user.secret), 200);
    kit_expect_problem(kit_ask(d, user.secret, "GET", path, NULL), 404, "no-such-job"); /* it is the local owner's */
    kit_reply r = kit_ask(d, admin.secret, "GET", path, NULL);
    assert_int_equal(r.status, 200);
    kit_free(&r);
    assert_int_equal(kit_revoke(d, user.id), 0);
    assert_int_equal(kit_revoke(d, admin.id), 0);
    assert_int_equal(status_of(d, user.secret), 401);
    assert_int_equal(status_of(d, NULL), 401);
    kit_kill(d, SIGKILL);
    kit_restart(d, NULL);
    assert_int_equal(status_of(d, NULL), 401);
    assert_int_equal(status_of(d, admin.secret), 401);
}

static void tokens_are_made_and_revoked_without_the_daemon_too(void **state) {
    kit_daemon *d = *state;
    assert_int_equal(kit_stop(d), 0);
    kit_token a = kit_new_token(d, "a", ""), b = kit_new_token(d, "b", "");
    assert_int_equal(kit_revoke(d, b.id), 0);
    kit_restart(d, NULL);
    assert_int_equal(status_of(d, a.secret), 200);
    assert_int_equal(status_of(d, b.secret), 401);
    kit_kill(d, SIGKILL); /* its socket stays behind, and is no daemon */
    kit_token c = kit_new_token(d, "c", "");
    assert_int_equal(kit_revoke(d, a.id), 0);
    kit_restart(d, NULL);
    assert_int_equal(status_of(d, a.secret), 401);
    assert_int_equal(status_of(d, c.secret), 200);
}

typedef struct {
    const kit_daemon *daemon;
    char path[60], headers[240];
    kit_reply reply;
    bool answered;
} waiting_request;

static void *wait_for_job(void *user) {
    waiting_request *w = user;
    w->answered = kit_try(w->daemon, "GET", w->path, w->headers, NULL, 0, &w->reply);
    return NULL;
}

static void who_waits_with_a_token_that_is_revoked_learns_nothing(void **state) {
    kit_daemon *d = *state;
    kit_token user = kit_new_token(d, "user", ""), again = kit_new_token(d, "user", "");
    char hash[BW_SHA256_TEXT], path[120], body[120], headers[200], cancel[80];
    static const char script[] = "sanitize sleep 600000\n";
    pthread_t thread;
    kit_hash(script, strlen(script), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    snprintf(headers, sizeof headers, "Authorization: Bearer %s", user.secret);
    kit_reply r = kit_request(d, "PUT", path, headers, script, strlen(script));
    kit_free(&r);
    snprintf(body, sizeof body, "{\"input\": \"%s\"}", hash);
    r = kit_ask(d, user.secret, "POST", "/v1/jobs", body);
    assert_int_equal(r.status, 201);
    json_t *job = kit_json(&r);
    waiting_request w = {.daemon = d};
    snprintf(w.path, sizeof w.path, "/v1/jobs/%s", kit_text(job, "id"));
    snprintf(w.headers, sizeof w.headers, "%s\nPrefer: wait=50", headers);
    snprintf(cancel, sizeof cancel, "/v1/jobs/%s/cancel", kit_text(job, "id"));
    json_decref(job);
    assert_int_equal(pthread_create(&thread, NULL, wait_for_job, &w), 0);
    kit_sleep_ms(300); /* it waits */
    assert_int_equal(kit_revoke(d, user.id), 0);
    r = kit_ask(d, again.secret, "POST", cancel, NULL);
    kit_free(&r);
    pthread_join(thread, NULL);
    assert_true(w.answered);
    kit_expect_problem(w.reply, 401, "unauthorized");
}

static void a_token_ends_when_it_says(void **state) {
    kit_daemon *d = *state;
    kit_token brief = kit_new_token(d, "brief", "--expires 2s");
    assert_int_equal(status_of(d, brief.secret), 200);
    kit_sleep_ms(2100);
    assert_int_equal(status_of(d, brief.secret), 401);
}

static void the_words_of_token_commands_are_checked(void **state) {
    kit_daemon *d = *state;
    static const struct {
        const char *words;
        int code;
    } cases[] = {{"token create", 2}, {"token create --owner", 2}, {"token create --owner ''", 2}, {"token create --owner 'a b'", 2},
                 {"token create --owner -x", 2}, {"token create --owner a --scopes ''", 2}, {"token create --owner a --scopes write", 2},
                 {"token create --owner a --scopes read,read", 2}, {"token create --owner a --expires 0d", 2},
                 {"token create --owner a --expires 30", 2}, {"token create --owner a --expires 100001w", 2},
                 {"token create --owner a --expires 99999999999999999999w", 2}, {"token create --owner a --expires 9223372036854775807s", 2}, {"token create --owner a more", 2}, {"token create --owner a --nothing", 2},
                 {"token", 2}, {"token delete", 2}, {"token revoke", 2}, {"token revoke 000000000000", 5}, {"token list more", 2}};
    char line[200];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        int code = kit_blockwrightd(d, cases[i].words, line, sizeof line);
        if (code != cases[i].code || *line) fail_msg("%s: %d %s", cases[i].words, code, line);
    }
    assert_int_equal(status_of(d, NULL), 200); /* none was made */
}

/* Of another program than the commands of this version. */
static void a_life_that_is_no_life_of_a_token_is_refused(void **state) {
    static const char *const lives[] = {"9223372036854775807", "60480000000001", "-1", "\"30d\"", "1.5"};
    kit_daemon *d = *state;
    bw_config config = {0};
    char error[BW_ADMIN_ERROR], text[200];
    snprintf(config.data, sizeof config.data, "%s", d->data);
    for (size_t i = 0; i < sizeof lives / sizeof *lives; i++) {
        snprintf(text, sizeof text, "{\"command\": \"token create\", \"owner\": \"a\", \"scopes\": \"read\", \"expires_ms\": %s}", lives[i]);
        json_t *answer = bw_admin_ask(&config, json_loads(text, 0, NULL), error);
        if (answer) fail_msg("%s is taken", lives[i]);
    }
    assert_int_equal(status_of(d, NULL), 200); /* none was made */
    assert_int_equal(status_of(d, kit_new_token(d, "long", "--expires 100000w").secret), 200);
}

static void a_daemon_without_tokens_answers_to_its_own_names_only(void **state) {
    kit_daemon *d = *state;
    static const char *const good[] = {"localhost", "localhost:9999", "LOCALHOST", "127.0.0.1:1", "127.1.2.3", "[::1]:8080", "[::1]", "a.localhost",
                                       "mesh.example", "OTHER:443"};
    static const char *const bad[] = {"evil.example", "127.0.0.1.evil.example", "localhost.evil.example", "10.0.0.1", "[2001:db8::1]", "example",
                                      "mesh.example.evil", "xlocalhost"};
    char header[200];
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        snprintf(header, sizeof header, "Host: %s", good[i]);
        kit_reply r = kit_request(d, "GET", "/v1/jobs", header, NULL, 0);
        if (r.status != 200) fail_msg("%s: %ld", header, r.status);
        kit_free(&r);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(header, sizeof header, "Host: %s", bad[i]);
        kit_expect_problem(kit_request(d, "GET", "/v1/jobs", header, NULL, 0), 421, "wrong-host");
        kit_expect_problem(kit_request(d, "GET", "/", header, NULL, 0), 421, "wrong-host");
    }
    kit_token token = kit_new_token(d, "a", ""); /* which no page of another site has: then any name will do */
    snprintf(header, sizeof header, "Host: evil.example\nAuthorization: Bearer %s", token.secret);
    kit_reply r = kit_request(d, "GET", "/v1/jobs", header, NULL, 0);
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

static void pages_of_other_sites_change_nothing(void **state) {
    kit_daemon *d = *state;
    char id[32], path[60], header[120];
    kit_submit(d, "sanitize sleep 600000\n", NULL, id);
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    static const char *const bad[] = {"Origin: http://evil.example", "Origin: null", "Origin: http://localhost:1"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++)
        kit_expect_problem(kit_request(d, "POST", path, bad[i], NULL, 0), 403, "cross-origin");
    json_t *job = kit_job(d, id);
    assert_string_not_equal(kit_text(job, "state"), "dismissed");
    json_decref(job);
    snprintf(header, sizeof header, "Origin: http://%s", d->address);
    kit_reply r = kit_request(d, "POST", path, header, NULL, 0);
    assert_int_equal(r.status, 200);
    kit_free(&r);
}

/* ---- limits of owners ---- */

static void run(const kit_daemon *d, const char *words) {
    char line[200];
    assert_int_equal(kit_blockwrightd(d, words, line, sizeof line), 0);
}

static long put(const kit_daemon *d, const char *secret, const char *content, char hash[BW_SHA256_TEXT]) {
    char path[120], headers[200];
    kit_hash(content, strlen(content), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    snprintf(headers, sizeof headers, "Authorization: Bearer %s", secret);
    kit_reply r = kit_request(d, "PUT", path, headers, content, strlen(content));
    if (r.status == 429) assert_true(atoi(kit_header(&r, "Retry-After")) > 0);
    kit_free(&r);
    return r.status;
}

static long submit(const kit_daemon *d, const char *secret, const char *hash) {
    char body[120];
    snprintf(body, sizeof body, "{\"input\": \"%s\"}", hash);
    kit_reply r = kit_ask(d, secret, "POST", "/v1/jobs", body);
    kit_free(&r);
    return r.status;
}

static size_t count_in(const kit_daemon *d, const char *secret, const char *state) {
    char path[60];
    snprintf(path, sizeof path, "/v1/jobs?state=%s", state);
    kit_reply r = kit_ask(d, secret, "GET", path, NULL);
    json_t *page = kit_json(&r);
    size_t count = json_array_size(json_object_get(page, "jobs"));
    json_decref(page);
    return count;
}

static void an_owner_has_limits_of_its_own(void **state) {
    kit_daemon *d = *state;
    char hash[BW_SHA256_TEXT], other[BW_SHA256_TEXT];
    assert_int_equal(kit_stop(d), 0);
    run(d, "owner set ann --queued 1"); /* also before the daemon and the token */
    kit_restart(d, (const char *const[]){"--workers", "4", "--owner-jobs", "2", NULL});
    kit_token ann = kit_new_token(d, "ann", ""), ben = kit_new_token(d, "ben", "");
    assert_int_equal(put(d, ann.secret, "sanitize sleep 600000\n", hash), 201);
    assert_int_equal(put(d, ben.secret, "sanitize sleep 600000\n", hash), 201);
    assert_int_equal(submit(d, ann.secret, hash), 201);
    assert_int_equal(submit(d, ann.secret, hash), 429);
    for (int i = 0; i < 2; i++) assert_int_equal(submit(d, ben.secret, hash), 201); /* what the configuration says */
    assert_int_equal(submit(d, ben.secret, hash), 429);
    run(d, "owner set ann --queued standard");
    assert_int_equal(submit(d, ann.secret, hash), 201);
    assert_int_equal(submit(d, ann.secret, hash), 429);
    run(d, "owner set ann --queued none --bytes 30");
    for (int i = 0; i < 3; i++) assert_int_equal(submit(d, ann.secret, hash), 201);
    assert_int_equal(put(d, ann.secret, "# 9 bytes", other), 429); /* 22 and 9 are more than 30 */
    assert_int_equal(put(d, ann.secret, "# 8 byte", other), 201);
    assert_int_equal(put(d, ben.secret, "# 9 bytes", other), 201);
    kit_kill(d, SIGKILL);
    kit_restart(d, NULL);
    assert_int_equal(put(d, ann.secret, "# 9 bytes", other), 429);
}

static void an_owner_runs_as_much_at_a_time_as_it_may(void **state) {
    kit_daemon *d = *state;
    char hash[BW_SHA256_TEXT], content[60];
    assert_int_equal(kit_stop(d), 0);
    kit_restart(d, (const char *const[]){"--workers", "4", "--owner-running", "1", NULL});
    kit_token ann = kit_new_token(d, "ann", ""), ben = kit_new_token(d, "ben", "");
    run(d, "owner set ann --running 2");
    for (int i = 0; i < 3; i++) {
        snprintf(content, sizeof content, "sanitize sleep 60000%d\n", i);
        assert_int_equal(put(d, ann.secret, content, hash), 201);
        assert_int_equal(submit(d, ann.secret, hash), 201);
        snprintf(content, sizeof content, "sanitize sleep 70000%d\n", i);
        assert_int_equal(put(d, ben.secret, content, hash), 201);
        assert_int_equal(submit(d, ben.secret, hash), 201);
    }
    for (int i = 0; i < 1000 && count_in(d, ann.secret, "running") + count_in(d, ben.secret, "running") < 3; i++) kit_sleep_ms(10);
    kit_sleep_ms(300); /* there is a fourth worker, and nobody may have it */
    assert_int_equal(count_in(d, ann.secret, "running"), 2);
    assert_int_equal(count_in(d, ben.secret, "running"), 1);
    run(d, "owner set ben --running none"); /* nothing else wakes the dispatcher */
    for (int i = 0; i < 1000 && count_in(d, ben.secret, "running") < 2; i++) kit_sleep_ms(10);
    assert_int_equal(count_in(d, ben.secret, "running"), 2);
}

static void the_words_of_owner_commands_are_checked(void **state) {
    kit_daemon *d = *state;
    static const char *const bad[] = {"owner", "owner set", "owner set a", "owner set --queued 1", "owner set a --queued", "owner set a --queued 0",
                                      "owner set a --queued -1", "owner set a --queued many", "owner set a --queued 1K", "owner set a --bytes 1X",
                                      "owner set 'a b' --queued 1", "owner set a b --queued 1", "owner list more", "owner unset a"};
    char line[200];
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        int code = kit_blockwrightd(d, bad[i], line, sizeof line);
        if (code != 2) fail_msg("%s: %d %s", bad[i], code, line);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(the_first_token_closes_a_running_daemon_for_good, fresh, gone),
        cmocka_unit_test_setup_teardown(tokens_are_made_and_revoked_without_the_daemon_too, fresh, gone),
        cmocka_unit_test_setup_teardown(who_waits_with_a_token_that_is_revoked_learns_nothing, fresh, gone),
        cmocka_unit_test_setup_teardown(a_token_ends_when_it_says, fresh, gone),
        cmocka_unit_test_setup_teardown(the_words_of_token_commands_are_checked, fresh, gone),
        cmocka_unit_test_setup_teardown(a_life_that_is_no_life_of_a_token_is_refused, fresh, gone),
        cmocka_unit_test_setup_teardown(a_daemon_without_tokens_answers_to_its_own_names_only, fresh, gone),
        cmocka_unit_test_setup_teardown(an_owner_has_limits_of_its_own, fresh, gone),
        cmocka_unit_test_setup_teardown(an_owner_runs_as_much_at_a_time_as_it_may, fresh, gone),
        cmocka_unit_test_setup_teardown(the_words_of_owner_commands_are_checked, fresh, gone),
        cmocka_unit_test_setup_teardown(pages_of_other_sites_change_nothing, fresh, gone),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
