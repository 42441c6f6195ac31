/* Who may do what: every endpoint of api/openapi.yaml is walked with no token, with bad ones, with one of another owner, and with one that has
 * not the scope. An endpoint that is added is walked too. */
#include <ftw.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "access_kit.h"
#include "stream_kit.h"

static kit_daemon d;
static const char marker[] = "OF-ALICE", script[] = "* log LOG-OF-ALICE\n# TEXT-OF-ALICE\n";
static kit_token alice, bob, reader, submitter, watcher, admin, expired, revoked;
static char input[BW_SHA256_TEXT], done[32], running[32], waiting[32], upload[80]; /* all alice's */

static void create(const char *content, char hash[BW_SHA256_TEXT], char id[32]) {
    char path[120], body[300];
    char headers[200];
    kit_hash(content, strlen(content), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    snprintf(headers, sizeof headers, "Authorization: Bearer %s", alice.secret);
    kit_reply r = kit_request(&d, "PUT", path, headers, content, strlen(content));
    assert_int_equal(r.status, 201);
    kit_free(&r);
    snprintf(body, sizeof body, "{\"input\": \"%s\", \"name\": \"NAME-OF-ALICE\", \"tags\": [\"TAG-OF-ALICE\"]}", hash);
    r = kit_ask(&d, alice.secret, "POST", "/v1/jobs", body);
    assert_int_equal(r.status, 201);
    json_t *job = kit_json(&r);
    assert_string_equal(kit_text(job, "owner"), "alice");
    snprintf(id, 32, "%s", kit_text(job, "id"));
    json_decref(job);
}

static void state_of(const char *secret, const char *id, char state[16]) {
    char path[60];
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    kit_reply r = kit_ask(&d, secret, "GET", path, NULL);
    assert_int_equal(r.status, 200);
    json_t *job = kit_json(&r);
    snprintf(state, 16, "%s", kit_text(job, "state"));
    json_decref(job);
}

static void wait_for(const char *id, const char *wanted) {
    char state[16] = "";
    for (int i = 0; i < 2000 && strcmp(state, wanted) != 0; i++, kit_sleep_ms(10)) state_of(alice.secret, id, state);
    assert_string_equal(state, wanted);
}

static int start(void **state) {
    char hash[BW_SHA256_TEXT];
    (void)state;
    kit_start(&d, NULL, (const char *const[]){"--workers", "1", "--stream-comment", "200ms", NULL});
    alice = kit_new_token(&d, "alice", "--scopes submit,read --note 'of a test'");
    bob = kit_new_token(&d, "bob", "--scopes read,submit");
    reader = kit_new_token(&d, "alice", "--scopes read");
    submitter = kit_new_token(&d, "alice", "--scopes submit");
    watcher = kit_new_token(&d, "watcher", "--scopes read-all,submit");
    admin = kit_new_token(&d, "root", "--scopes admin --expires 1d");
    expired = kit_new_token(&d, "alice", "--scopes admin --expires 1s");
    revoked = kit_new_token(&d, "alice", "--scopes admin");
    assert_int_equal(kit_revoke(&d, revoked.id), 0);
    create(script, input, done);
    wait_for(done, "successful");
    create("sanitize sleep 600000\n# TEXT-OF-ALICE\n", hash, running);
    wait_for(running, "running");
    create("sanitize sleep 600001\n", hash, waiting);
    char headers[200];
    snprintf(headers, sizeof headers, "Authorization: Bearer %s\nTus-Resumable: 1.0.0\nUpload-Length: 100", alice.secret);
    kit_reply r = kit_request(&d, "POST", "/v1/uploads", headers, NULL, 0);
    assert_int_equal(r.status, 201);
    snprintf(upload, sizeof upload, "%s", strrchr(r.location, '/') + 1);
    kit_free(&r);
    kit_sleep_ms(1100); /* `expired` is */
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

/* ---- the walk ---- */

/* The address of an endpoint, with what is alice's in the place of its variable segments. */
static void address_of(const bw_endpoint *e, const char *job, char path[400]) {
    size_t n = 0;
    const char *name = strncmp(e->path, "/page/", 6) == 0 ? "viewer.mjs" : "script.txt";
    for (const char *at = e->path; *at;) {
        if (*at != '{') {
            path[n++] = *at++;
            continue;
        }
        const char *value = strncmp(at, "{id}", 4) == 0 ? job : strncmp(at, "{sha256}", 8) == 0 ? input : strncmp(at, "{name}", 6) == 0 ? name
                            : strncmp(at, "{upload}", 8) == 0 ? upload : NULL;
        if (!value) fail_msg("%s: what is to stand for %s?", e->id, at);
        n += (size_t)sprintf(path + n, "%s", value);
        at += strcspn(at, "}") + 1;
    }
    path[n] = '\0';
}

static kit_reply ask(const bw_endpoint *e, const char *secret, const char *job) {
    char path[400], body[200], headers[300] = "";
    address_of(e, job, path);
    if (strcmp(e->id, "job_create") == 0 || strcmp(e->id, "batch_create") == 0) {
        snprintf(body, sizeof body, strcmp(e->id, "job_create") == 0 ? "{\"input\": \"%s\"}" : "{\"jobs\": [{\"input\": \"%s\"}]}", input);
        return kit_ask(&d, secret, e->method, path, body);
    }
    int n = snprintf(headers, sizeof headers, "Tus-Resumable: 1.0.0\nUpload-Offset: 0\nUpload-Length: 5%s",
                     strcmp(e->method, "PATCH") == 0 ? "\nContent-Type: application/offset+octet-stream" : "");
    if (secret) snprintf(headers + n, sizeof headers - (size_t)n, "\nAuthorization: Bearer %s", secret);
    bool brings = strcmp(e->method, "PUT") == 0 || strcmp(e->method, "PATCH") == 0;
    return kit_request(&d, e->method, path, headers, brings ? "other bytes" : NULL, brings ? 11 : 0);
}

static void expect_nothing_of_alice(const bw_endpoint *e, const kit_reply *r) {
    if (strstr(r->body, marker) || strstr(r->headers, marker)) fail_msg("%s tells: %s%s", e->id, r->headers, r->body);
}

/* HEAD has no document, all else must have the right one, and what is said of uploads the header that tus wants. */
static void expect_refusal(const bw_endpoint *e, kit_reply r, long status, const char *code) {
    expect_nothing_of_alice(e, &r);
    assert_string_equal(kit_header(&r, "Tus-Resumable"), strncmp(e->path, "/v1/uploads", 11) == 0 ? "1.0.0" : "");
    if (r.status != status) fail_msg("%s: expected %ld, got %ld: %s", e->id, status, r.status, r.body);
    if (strcmp(e->method, "HEAD") == 0) kit_free(&r);
    else kit_expect_problem(r, status, code);
}

static void expect_unchanged(void) {
    char state[16];
    state_of(alice.secret, done, state);
    assert_string_equal(state, "successful");
    state_of(alice.secret, running, state);
    assert_string_equal(state, "running");
    state_of(alice.secret, waiting, state);
    assert_string_equal(state, "queued");
    kit_reply r = kit_ask(&d, alice.secret, "GET", "/v1/jobs?limit=200", NULL);
    json_t *page = kit_json(&r);
    assert_int_equal(json_array_size(json_object_get(page, "jobs")), 3);
    json_decref(page);
    char headers[200], path[120];
    snprintf(headers, sizeof headers, "Authorization: Bearer %s\nTus-Resumable: 1.0.0", alice.secret);
    snprintf(path, sizeof path, "/v1/uploads/%s", upload);
    r = kit_request(&d, "HEAD", path, headers, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_string_equal(kit_header(&r, "Upload-Offset"), "0");
    kit_free(&r);
}

static void without_a_token_that_holds_every_endpoint_says_401_or_is_public(void **state) {
    static const char *const public[] = {"capabilities", "live", "ready", "openapi", "page", "page_file", "upload_options"};
    char unknown[BW_TOKEN_TEXT], cut[BW_TOKEN_TEXT];
    (void)state;
    snprintf(unknown, sizeof unknown, "%s", alice.secret);
    unknown[20] = unknown[20] == '0' ? '1' : '0';
    snprintf(cut, sizeof cut, "%.60s", alice.secret);
    const char *const bad[] = {NULL, unknown, cut, "", "bwt_", expired.secret, revoked.secret, alice.id};
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        bool is_public = false;
        for (size_t k = 0; k < sizeof public / sizeof *public; k++) is_public = is_public || strcmp(public[k], e->id) == 0;
        if (is_public != (e->scope == 0)) fail_msg("%s is %spublic by the document", e->id, e->scope ? "not " : "");
        for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
            kit_reply r = ask(e, bad[k], done);
            if (is_public) {
                expect_nothing_of_alice(e, &r);
                assert_true(r.status < 300);
                kit_free(&r);
                continue;
            }
            const char *challenge = kit_header(&r, "WWW-Authenticate");
            assert_true(strncmp(challenge, "Bearer ", 7) == 0);
            if (bad[k] && *bad[k]) assert_non_null(strstr(challenge, "invalid_token"));
            expect_refusal(e, r, 401, "unauthorized");
        }
    }
    expect_unchanged();
}

static void without_the_scope_every_endpoint_says_403_and_names_it(void **state) {
    (void)state;
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        if (!e->scope) continue;
        kit_reply r = ask(e, e->scope == BW_SCOPE_READ ? submitter.secret : reader.secret, done);
        const char *wanted = e->scope == BW_SCOPE_READ ? "read" : e->scope == BW_SCOPE_SUBMIT ? "submit" : e->scope == BW_SCOPE_READ_ALL ? "read-all" : "admin";
        char scope[40];
        snprintf(scope, sizeof scope, "scope=\"%s\"", wanted);
        assert_non_null(strstr(kit_header(&r, "WWW-Authenticate"), scope));
        if (strcmp(e->method, "HEAD") != 0) {
            json_t *problem = json_loads(r.body, 0, NULL);
            assert_string_equal(kit_text(problem, "scope"), wanted);
            json_decref(problem);
        }
        expect_refusal(e, r, 403, "insufficient-scope");
    }
    expect_unchanged();
}

static void a_foreign_token_finds_nothing_and_changes_nothing(void **state) {
    const char *const jobs[] = {done, running, waiting, "0123456789abcdef01234567"}; /* the last one is nobody's: no difference */
    (void)state;
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        if (strcmp(e->id, "event_list") == 0) continue; /* has no end; a_stream_of_all_jobs_shows_what_the_caller_may_see */
        for (size_t k = 0; k < (e->of_job ? sizeof jobs / sizeof *jobs : 1); k++) {
            kit_reply r = ask(e, bob.secret, jobs[k]);
            if (e->of_job) expect_refusal(e, r, 404, "no-such-job");
            else if (strcmp(e->id, "blob_head") == 0) expect_refusal(e, r, 404, "no-such-blob");
            else if (strcmp(e->id, "blob_put") == 0) expect_refusal(e, r, 422, "hash-mismatch");
            else if (strcmp(e->id, "job_create") == 0 || strcmp(e->id, "batch_create") == 0) expect_refusal(e, r, 422, "unknown-input");
            else if (strstr(e->path, "{upload}") && e->scope) expect_refusal(e, r, 404, "no-such-upload");
            else if (e->scope & (BW_SCOPE_READ_ALL | BW_SCOPE_ADMIN)) expect_refusal(e, r, 403, "insufficient-scope");
            else expect_nothing_of_alice(e, &r), kit_free(&r);
        }
    }
    static const char *const lists[] = {"/v1/jobs", "/v1/jobs?owner=bob", "/v1/jobs?state=running", "/v1/jobs?tag=TAG-OF-ALICE"};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        kit_reply r = kit_ask(&d, bob.secret, "GET", lists[i], NULL);
        assert_int_equal(r.status, 200);
        json_t *page = kit_json(&r);
        assert_int_equal(json_array_size(json_object_get(page, "jobs")), 0);
        json_decref(page);
    }
    kit_expect_problem(kit_ask(&d, bob.secret, "GET", "/v1/jobs?owner=alice", NULL), 403, "insufficient-scope");
    kit_expect_problem(kit_ask(&d, bob.secret, "GET", "/v1/jobs?owner=nobody", NULL), 403, "insufficient-scope");
    expect_unchanged();
}

static void the_walk_goes_where_there_is_something(void **state) {
    (void)state;
    for (int i = 0; i < BW_OP_COUNT; i++) { /* else 404 would prove nothing */
        const bw_endpoint *e = &bw_endpoints[i];
        if (strcmp(e->method, "GET") != 0 || strstr(e->path, "{upload")) continue;
        if (strstr(e->path, "/events")) continue; /* a stream has no end */
        kit_reply r = ask(e, e->scope & BW_SCOPE_READ_ALL ? watcher.secret : alice.secret, done);
        if (r.status != 200) fail_msg("%s: %ld %s", e->id, r.status, r.body);
        kit_free(&r);
    }
}

/* ---- those who see more ---- */

static void open_stream(kit_stream *s, CURLM *multi, const char *secret, const char *path) {
    char headers[200];
    snprintf(headers, sizeof headers, "Authorization: Bearer %s", secret);
    kit_stream_open(s, multi, &d, path, headers, 0);
}

static bool run_until(CURLM *multi, kit_stream *s, const char *text) {
    for (int i = 0; i < 1500 && !s->over && !strstr(s->text, text); i++) kit_stream_run(multi, 20);
    return strstr(s->text, text) != NULL;
}

static void a_stream_of_all_jobs_shows_what_the_caller_may_see(void **state) {
    (void)state;
    CURLM *multi = curl_multi_init();
    const struct {
        const kit_token *token;
        const char *path;
        bool shows;
    } cases[] = {{&alice, "/v1/events?after=0", true}, {&reader, "/v1/events?after=0", true}, {&watcher, "/v1/events?after=0", true},
                 {&watcher, "/v1/events?after=0&owner=alice", true}, {&watcher, "/v1/events?after=0&owner=bob", false},
                 {&bob, "/v1/events?after=0", false}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        kit_stream s;
        open_stream(&s, multi, cases[i].token->secret, cases[i].path);
        assert_true(run_until(multi, &s, ":\n\n")); /* all that has happened has come */
        assert_int_equal(strstr(s.text, done) != NULL && strstr(s.text, running) != NULL, cases[i].shows);
        if (!cases[i].shows) assert_int_equal(kit_stream_count(&s, "state") + kit_stream_count(&s, "stage"), 0);
        kit_stream_close(&s, multi);
    }
    kit_expect_problem(kit_ask(&d, bob.secret, "GET", "/v1/events?owner=alice", NULL), 403, "insufficient-scope");
    curl_multi_cleanup(multi);
}

static void a_stream_ends_with_its_token(void **state) {
    (void)state;
    char path[80];
    kit_stream s, other;
    CURLM *multi = curl_multi_init();
    kit_token token = kit_new_token(&d, "alice", "--scopes read");
    snprintf(path, sizeof path, "/v1/jobs/%s/events", running);
    open_stream(&s, multi, token.secret, path);
    open_stream(&other, multi, reader.secret, path);
    assert_true(run_until(multi, &s, ":\n\n"));
    assert_int_equal(kit_revoke(&d, token.id), 0);
    run_until(multi, &s, "never");
    assert_true(s.over);
    assert_int_equal(s.code, CURLE_OK);
    assert_false(other.over);
    kit_stream_close(&s, multi);
    kit_stream_close(&other, multi);
    curl_multi_cleanup(multi);
}

static void read_all_sees_everything_and_changes_nothing_of_others(void **state) {
    (void)state;
    char path[80];
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        if (!e->of_job || e->scope != BW_SCOPE_SUBMIT) continue;
        kit_reply r = ask(e, watcher.secret, running);
        assert_non_null(strstr(kit_header(&r, "WWW-Authenticate"), "scope=\"admin\""));
        kit_expect_problem(r, 403, "insufficient-scope");
    }
    snprintf(path, sizeof path, "/v1/jobs/%s/results/script.txt", done);
    kit_reply r = kit_ask(&d, watcher.secret, "GET", path, NULL);
    assert_int_equal(r.status, 200);
    assert_non_null(strstr(r.body, marker));
    kit_free(&r);
    static const struct {
        const char *path;
        size_t jobs;
    } lists[] = {{"/v1/jobs", 3}, {"/v1/jobs?owner=alice", 3}, {"/v1/jobs?owner=bob", 0}};
    for (size_t i = 0; i < sizeof lists / sizeof *lists; i++) {
        r = kit_ask(&d, watcher.secret, "GET", lists[i].path, NULL);
        json_t *page = kit_json(&r);
        assert_int_equal(json_array_size(json_object_get(page, "jobs")), lists[i].jobs);
        json_decref(page);
    }
    expect_unchanged();
}

static void an_admin_may_stop_the_jobs_of_others(void **state) {
    char path[80], hash[BW_SHA256_TEXT], id[32];
    (void)state;
    create("sanitize sleep 600002\n", hash, id);
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_ask(&d, admin.secret, "POST", path, NULL);
    assert_int_equal(r.status, 200);
    json_t *job = kit_json(&r);
    assert_string_equal(kit_text(job, "state"), "dismissed");
    assert_string_equal(kit_text(job, "owner"), "alice");
    json_decref(job);
    *strrchr(path, '/') = '\0';
    r = kit_ask(&d, admin.secret, "DELETE", path, NULL);
    assert_true(r.status == 200 || r.status == 204);
    kit_free(&r);
    kit_expect_problem(kit_ask(&d, bob.secret, "GET", path, NULL), 404, "no-such-job"); /* what is gone is gone for its owner only */
    expect_unchanged();
}

/* ---- blobs ---- */

static void a_hash_alone_gives_nothing_the_bytes_do(void **state) {
    char path[120], headers[200];
    (void)state;
    snprintf(path, sizeof path, "/v1/blobs/%s", input);
    snprintf(headers, sizeof headers, "Authorization: Bearer %s", bob.secret);
    for (int i = 0; i < 2; i++) { /* the first time the bytes have to come, although alice has uploaded them */
        kit_reply r = kit_ask(&d, bob.secret, "HEAD", path, NULL);
        assert_int_equal(r.status, i ? 200 : 404);
        kit_free(&r);
        r = kit_request(&d, "PUT", path, headers, script, strlen(script));
        assert_int_equal(r.status, i ? 200 : 201);
        kit_free(&r);
    }
    char body[200], id[32];
    snprintf(body, sizeof body, "{\"input\": \"%s\"}", input);
    kit_reply r = kit_ask(&d, bob.secret, "POST", "/v1/jobs", body);
    assert_int_equal(r.status, 201);
    json_t *job = kit_json(&r);
    snprintf(id, sizeof id, "%s", kit_text(job, "id"));
    json_decref(job);
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    kit_expect_problem(kit_ask(&d, alice.secret, "GET", path, NULL), 404, "no-such-job");
    expect_unchanged();
}

/* ---- secrets ---- */

static const char *sought;

static int look_into(const char *path, const struct stat *info, int type, struct FTW *at) {
    (void)at;
    if (type != FTW_F || !S_ISREG(info->st_mode)) return 0;
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    char *text = calloc((size_t)info->st_size + 1, 1);
    size_t n = fread(text, 1, (size_t)info->st_size, f);
    fclose(f);
    if (memmem(text, n, sought, strlen(sought))) fail_msg("%s has the token in it", path);
    free(text);
    return 0;
}

static void no_token_is_in_a_log_a_file_or_the_words_of_a_process(void **state) {
    char log[96], command[200];
    struct stat info;
    pid_t worker;
    (void)state;
    const kit_token *const all[] = {&alice, &bob, &reader, &submitter, &watcher, &admin, &expired, &revoked};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
        sought = all[i]->secret + 4; /* with or without its prefix */
        assert_int_equal(nftw(d.data, look_into, 20, FTW_PHYS), 0);
        snprintf(log, sizeof log, "%s.log", d.data);
        assert_int_equal(stat(log, &info), 0);
        assert_true(info.st_size > 0);
        look_into(log, &info, FTW_F, NULL);
    }
    assert_int_equal(kit_workers(&d, &worker, 1), 1);
    snprintf(command, sizeof command, "cat /proc/%d/cmdline /proc/%d/environ /proc/%d/cmdline | grep -aq bwt_", (int)worker, (int)worker, (int)d.pid);
    assert_int_not_equal(system(command), 0);
    sought = alice.id; /* but its id is, so that the search was one */
    FILE *f = fopen(log, "r");
    char *text = calloc((size_t)info.st_size + 1, 1);
    size_t n = fread(text, 1, (size_t)info.st_size, f);
    assert_non_null(memmem(text, n, sought, strlen(sought)));
    free(text);
    fclose(f);
}

static void the_page_asks_for_a_token_and_shows_it(void **state) {
    char folder[] = "/tmp/bw-page-XXXXXX", command[500];
    (void)state;
    if (system("command -v node >/dev/null && command -v chromium >/dev/null") != 0) {
        print_message("             node or chromium is not here: not tested\n");
        skip();
    }
    assert_non_null(mkdtemp(folder));
    snprintf(command, sizeof command, "node %s/tests/clients/page/access_test.mjs chromium %s http://%s/ %s %s", BW_SOURCE_DIR, folder, d.address, alice.secret, done);
    int status = system(command);
    snprintf(command, sizeof command, "rm -rf %s", folder);
    assert_int_equal(system(command), 0);
    assert_int_equal(status, 0);
}

static void the_control_socket_is_the_daemons_users_alone(void **state) {
    char path[100];
    struct stat info;
    (void)state;
    snprintf(path, sizeof path, "%s/control", d.data);
    assert_int_equal(stat(path, &info), 0);
    assert_true(S_ISSOCK(info.st_mode));
    assert_int_equal(info.st_mode & 0777, 0600);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_walk_goes_where_there_is_something),
        cmocka_unit_test(without_a_token_that_holds_every_endpoint_says_401_or_is_public),
        cmocka_unit_test(without_the_scope_every_endpoint_says_403_and_names_it),
        cmocka_unit_test(a_foreign_token_finds_nothing_and_changes_nothing),
        cmocka_unit_test(a_stream_of_all_jobs_shows_what_the_caller_may_see),
        cmocka_unit_test(a_stream_ends_with_its_token),
        cmocka_unit_test(read_all_sees_everything_and_changes_nothing_of_others),
        cmocka_unit_test(an_admin_may_stop_the_jobs_of_others),
        cmocka_unit_test(a_hash_alone_gives_nothing_the_bytes_do),
        cmocka_unit_test(no_token_is_in_a_log_a_file_or_the_words_of_a_process),
        cmocka_unit_test(the_page_asks_for_a_token_and_shows_it),
        cmocka_unit_test(the_control_socket_is_the_daemons_users_alone),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
