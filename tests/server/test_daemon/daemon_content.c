/* Content over HTTP: parts, conditions, codings out and in. */
#include <stdio.h>
#include <sqlite3.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "daemon_kit.h"
#include "server/http/coding.h"

enum { UPLOAD_MOST = 1 << 20, DATA = 100000 };

static kit_daemon d;
static char data_path[100], text_path[100], *data, *text; /* a binary result and a text, whole */
static size_t data_size, text_size;
static char data_tag[100], text_tag[100], modified[60];

static char *keep(const char *path, size_t *size, char tag[100]) {
    kit_reply r = kit_request(&d, "GET", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_string_equal(kit_header(&r, "Content-Encoding"), "");
    snprintf(tag, 100, "%s", kit_header(&r, "ETag"));
    snprintf(modified, sizeof modified, "%s", kit_header(&r, "Last-Modified"));
    *size = r.size;
    return r.body;
}

static int start(void **state) {
    (void)state;
    char id[32], script[4000] = "encode bytes 100000\n";
    kit_start(&d, NULL, (const char *const[]){"--max-upload", "1M", NULL});
    for (int i = 0; i < 60; i++) strcat(script, "# a text that can be made shorter, for it says always the same\n");
    kit_submit(&d, script, NULL, id);
    json_decref(kit_wait(&d, id, 30));
    snprintf(data_path, sizeof data_path, "/v1/jobs/%s/results/data.bin", id);
    snprintf(text_path, sizeof text_path, "/v1/jobs/%s/results/script.txt", id);
    data = keep(data_path, &data_size, data_tag);
    text = keep(text_path, &text_size, text_tag);
    return data_size == DATA && text_size > 3000 ? 0 : -1;
}

static int stop(void **state) {
    (void)state;
    free(data);
    free(text);
    kit_remove(&d);
    return 0;
}

/* A condition is judged before anything is done, or not at all. */
static void conditions_do_not_meet_what_changes_something(void **state) {
    (void)state;
    char job[40], pin[60];
    snprintf(job, sizeof job, "%.*s", (int)strlen("/v1/jobs/") + 24, data_path);
    snprintf(pin, sizeof pin, "%s/pin", job);
    for (int done = 0; done < 2; done++) {
        if (!done) kit_expect_problem(kit_request(&d, "PUT", pin, "If-Match: \"x\"", NULL, 0), 412, "precondition-failed");
        kit_reply r = kit_get(&d, "%s", job);
        json_t *now = kit_json(&r);
        assert_true(done == json_is_true(json_object_get(now, "pinned")));
        json_decref(now);
        r = kit_request(&d, done ? "DELETE" : "PUT", pin, done ? "If-None-Match: *" : "If-Match: *", NULL, 0);
        assert_true(r.status == 200 || r.status == 204);
        kit_free(&r);
    }
}

/* Nothing that a token opened is to stay where another may find it; a result has no say on the daemon's page. */
static void answers_are_not_kept_by_others(void **state) {
    (void)state;
    kit_reply r = kit_get(&d, "/v1/jobs");
    assert_string_equal(kit_header(&r, "Cache-Control"), "no-store");
    kit_free(&r);
    r = kit_get(&d, "/v1/jobs/x");
    assert_string_equal(kit_header(&r, "Cache-Control"), "no-store");
    kit_free(&r);
    r = kit_get(&d, "%s", text_path);
    assert_string_equal(kit_header(&r, "Cache-Control"), "private, no-cache");
    assert_int_equal(strncmp(kit_header(&r, "Content-Security-Policy"), "sandbox;", 8), 0);
    kit_free(&r);
}

static kit_reply get(const char *path, const char *headers) { return kit_request(&d, "GET", path, headers, NULL, 0); }

static void expect_part(const char *path, const char *headers, const char *whole, size_t first, size_t size, const char *range) {
    kit_reply r = get(path, headers);
    assert_int_equal(r.status, 206);
    assert_string_equal(kit_header(&r, "Content-Range"), range);
    assert_int_equal(r.size, size);
    assert_memory_equal(r.body, whole + first, size);
    kit_free(&r);
}

static void expect_whole(const char *path, const char *headers) {
    kit_reply r = get(path, headers);
    assert_int_equal(r.status, 200);
    assert_int_equal(r.size, path == data_path ? data_size : text_size);
    assert_memory_equal(r.body, path == data_path ? data : text, r.size);
    assert_string_equal(kit_header(&r, "Content-Range"), "");
    kit_free(&r);
}

static void a_range_is_answered_with_just_that_part(void **state) {
    (void)state;
    expect_part(data_path, "Range: bytes=0-0", data, 0, 1, "bytes 0-0/100000");
    expect_part(data_path, "Range: BYTES=1-2", data, 1, 2, "bytes 1-2/100000");
    expect_part(data_path, "Range: bytes=10-70009", data, 10, 70000, "bytes 10-70009/100000");
    expect_part(data_path, "Range: bytes=99990-", data, 99990, 10, "bytes 99990-99999/100000");
    expect_part(data_path, "Range: bytes=50-999999", data, 50, 99950, "bytes 50-99999/100000");
    expect_part(data_path, "Range: bytes=-5", data, 99995, 5, "bytes 99995-99999/100000");
    expect_part(data_path, "Range: bytes=-500000", data, 0, 100000, "bytes 0-99999/100000");
    char range[60];
    snprintf(range, sizeof range, "bytes 3-9/%zu", text_size);
    expect_part(text_path, "Range: bytes=3-9\nAccept-Encoding: gzip", text, 3, 7, range); /* of the text itself */
}

static void what_is_no_single_range_is_answered_with_the_whole(void **state) {
    (void)state;
    for (const char *const *h = (const char *const[]){"Range: bytes=0-1,5-6", "Range: bytes=5-1", "Range: bytes=", "Range: bytes=-", "Range: bytes=x-1",
                                                      "Range: items=0-1", "Range: bytes=0-1x", "Range: bytes=99999999999999999999999-", NULL}; *h; h++)
        expect_whole(data_path, *h);
    kit_reply r = kit_request(&d, "HEAD", data_path, "Range: bytes=0-1", NULL, 0);
    assert_int_equal(r.status, 200);
    assert_string_equal(kit_header(&r, "Content-Length"), "100000");
    assert_string_equal(kit_header(&r, "Accept-Ranges"), "bytes");
    kit_free(&r);
}

static void a_range_behind_the_end_is_416(void **state) {
    (void)state;
    for (const char *const *h = (const char *const[]){"Range: bytes=100000-", "Range: bytes=100000-100001", "Range: bytes=-0", NULL}; *h; h++) {
        kit_reply r = get(data_path, *h);
        assert_string_equal(kit_header(&r, "Content-Range"), "bytes */100000");
        kit_expect_problem(r, 416, "range-not-satisfiable");
    }
}

static void if_range_gives_the_part_only_of_the_same_content(void **state) {
    (void)state;
    char headers[300];
    snprintf(headers, sizeof headers, "Range: bytes=1-2\nIf-Range: %s", data_tag);
    expect_part(data_path, headers, data, 1, 2, "bytes 1-2/100000");
    snprintf(headers, sizeof headers, "Range: bytes=1-2\nIf-Range: %s", modified);
    expect_part(data_path, headers, data, 1, 2, "bytes 1-2/100000");
    snprintf(headers, sizeof headers, "Range: bytes=1-2\nIf-Range: W/%s", data_tag);
    expect_whole(data_path, headers);
    expect_whole(data_path, "Range: bytes=1-2\nIf-Range: \"other\"");
    expect_whole(data_path, "Range: bytes=1-2\nIf-Range: Thu, 01 Jan 1970 00:00:01 GMT");
    expect_whole(data_path, "Range: bytes=100000-\nIf-Range: \"other\"");
}

static void expect_status(const char *path, const char *format, const char *value, long status) {
    char headers[400];
    snprintf(headers, sizeof headers, format, value);
    kit_reply r = get(path, headers);
    if (r.status != status) fail_msg("%s: %ld", headers, r.status);
    if (status == 304) assert_int_equal(r.size, 0);
    if (status == 412) kit_expect_problem(r, 412, "precondition-failed");
    else kit_free(&r);
}

static void conditions_are_weighed_in_their_order(void **state) {
    (void)state;
    static const char old[] = "Thu, 01 Jan 1970 00:00:01 GMT", future[] = "Fri, 01 Jan 2100 00:00:00 GMT";
    expect_status(data_path, "If-None-Match: %s", data_tag, 304);
    expect_status(data_path, "If-None-Match: W/%s", data_tag, 304);
    expect_status(data_path, "If-None-Match: \"a,b\", %s", data_tag, 304);
    expect_status(data_path, "If-None-Match: %s", "*", 304);
    expect_status(data_path, "If-None-Match: %s", "\"other\"", 200);
    expect_status(data_path, "If-None-Match: %s", "\"other", 200);
    expect_status(data_path, "If-Match: %s", data_tag, 200);
    expect_status(data_path, "If-Match: %s", "*", 200);
    expect_status(data_path, "If-Match: %s", "\"other\"", 412);
    expect_status(data_path, "If-Match: W/%s", data_tag, 412);
    expect_status(data_path, "If-Modified-Since: %s", modified, 304);
    expect_status(data_path, "If-Modified-Since: %s", future, 304);
    expect_status(data_path, "If-Modified-Since: %s", old, 200);
    expect_status(data_path, "If-Modified-Since: %s", "Friday, 01-Jan-38 00:00:00 GMT", 304);
    expect_status(data_path, "If-Modified-Since: %s", "Fri Jan  1 00:00:00 2038", 304);
    expect_status(data_path, "If-Modified-Since: %s", "yesterday", 200);
    expect_status(data_path, "If-Unmodified-Since: %s", old, 412);
    expect_status(data_path, "If-Unmodified-Since: %s", modified, 200);
    expect_status(data_path, "If-None-Match: \"other\"\nIf-Modified-Since: %s", future, 200);        /* the tag counts */
    expect_status(data_path, "If-Match: \"other\"\nIf-None-Match: %s", data_tag, 412);
    expect_status(data_path, "If-Unmodified-Since: Thu, 01 Jan 1970 00:00:01 GMT\nIf-Match: %s", data_tag, 200);
}

static void several_lines_are_one_list(void **state) {
    (void)state;
    char pin[60];
    expect_status(data_path, "If-None-Match: \"other\"\nif-none-match: %s", data_tag, 304);
    expect_status(data_path, "If-None-Match: \"other\"\nIf-None-Match: \"more\", W/%s\nIf-None-Match: \"last\"", data_tag, 304);
    expect_status(data_path, "If-None-Match: \"other\"\nIf-None-Match: %s", "\"more\"", 200);
    expect_status(data_path, "If-Match: \"other\"\nIf-Match: %s", data_tag, 200);
    expect_status(data_path, "If-Match: \"other\"\nIf-Match: %s", "\"more\"", 412);
    expect_status(data_path, "If-Match: \"other\"\nIf-None-Match: \"more\"\nIf-Match: %s", data_tag, 200);
    snprintf(pin, sizeof pin, "%.*s/pin", (int)strlen("/v1/jobs/") + 24, data_path);
    kit_expect_problem(kit_request(&d, "PUT", pin, "If-Match: *\nIf-Match: \"x\"", NULL, 0), 412, "precondition-failed");
    kit_reply r = get(text_path, "Accept-Encoding: br\nAccept-Encoding: gzip");
    assert_string_equal(kit_header(&r, "Content-Encoding"), "gzip");
    kit_free(&r);
    r = get(text_path, "Accept-Encoding: gzip;q=0.5\nAccept-Encoding: zstd;q=0\nAccept-Encoding: identity");
    assert_string_equal(kit_header(&r, "Content-Encoding"), "");
    kit_free(&r);
}

typedef struct {
    char *bytes;
    size_t size;
} buffer;

static bool take(void *user, const char *bytes, size_t size) {
    buffer *b = user;
    b->bytes = realloc(b->bytes, b->size + size);
    memcpy(b->bytes + b->size, bytes, size);
    b->size += size;
    return true;
}

static void expect_unpacked(bw_coding coding, const kit_reply *r, const char *whole, size_t size) {
    buffer b = {NULL, 0};
    bw_unpacker *u = bw_unpacker_new(coding);
    assert_int_equal(bw_unpack(u, r->body, r->size, take, &b), BW_OK);
    assert_true(bw_unpacker_complete(u));
    assert_int_equal(b.size, size);
    if (whole) assert_memory_equal(b.bytes, whole, size);
    bw_unpacker_free(u);
    free(b.bytes);
}

static void a_text_is_coded_as_the_client_likes_it(void **state) {
    (void)state;
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        char header[80], tag[100], expected[110];
        snprintf(header, sizeof header, "Accept-Encoding: br, %s;q=0.5", bw_coding_names[c]);
        kit_reply r = get(text_path, header);
        assert_int_equal(r.status, 200);
        assert_string_equal(kit_header(&r, "Content-Encoding"), bw_coding_names[c]);
        assert_string_equal(kit_header(&r, "Vary"), "Accept-Encoding");
        assert_true(r.size < text_size / 2);
        expect_unpacked((bw_coding)c, &r, text, text_size);
        snprintf(tag, sizeof tag, "%s", kit_header(&r, "ETag"));
        snprintf(expected, sizeof expected, "\"%.64s-%s\"", text_tag + 1, bw_coding_names[c]);
        assert_string_equal(tag, expected);
        kit_free(&r);
        char both[300];
        snprintf(both, sizeof both, "%s\nIf-None-Match: %s", header, tag);
        expect_status(text_path, both, "", 304);
        snprintf(both, sizeof both, "%s\nIf-None-Match: %s", header, text_tag);
        expect_status(text_path, both, "", 200);
        r = kit_request(&d, "HEAD", text_path, header, NULL, 0);
        assert_int_equal(r.status, 200);
        assert_string_equal(kit_header(&r, "Content-Encoding"), bw_coding_names[c]);
        kit_free(&r);
    }
    expect_whole(text_path, "Accept-Encoding: br, gzip;q=0");
    expect_whole(data_path, "Accept-Encoding: gzip, zstd");
}

static void documents_and_pages_are_coded_too(void **state) {
    (void)state;
    for (const char *const *path = (const char *const[]){"/openapi.json", "/", "/v1/jobs", NULL}; *path; path++) {
        kit_reply plain = get(*path, NULL), coded = get(*path, "Accept-Encoding: gzip");
        assert_string_equal(kit_header(&coded, "Content-Encoding"), "gzip");
        assert_string_equal(kit_header(&plain, "Vary"), "Accept-Encoding");
        assert_true(coded.size < plain.size);
        expect_unpacked(BW_CODING_GZIP, &coded, plain.body, plain.size);
        kit_free(&plain), kit_free(&coded);
    }
    kit_reply r = get("/livez", "Accept-Encoding: gzip"); /* too short to be worth it */
    assert_string_equal(kit_header(&r, "Content-Encoding"), "");
    kit_free(&r);
}

static void the_digest_is_that_of_the_content(void **state) {
    (void)state;
    char hex[BW_SHA256_TEXT];
    kit_hash("abc", 3, hex);
    kit_upload(&d, "abc", hex);
    char path[100];
    snprintf(path, sizeof path, "/v1/blobs/%s", hex);
    kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_string_equal(kit_header(&r, "Repr-Digest"), "sha-256=:ungWv48Bz+pBQUDeXa4iI7ADYaOWF3qctBD/YfIAFa0=:");
    assert_string_equal(kit_header(&r, "Content-Length"), "3");
    kit_free(&r);
    r = get(text_path, "Accept-Encoding: gzip");
    assert_string_equal(kit_header(&r, "Repr-Digest"), "");
    kit_free(&r);
}

static buffer packed(bw_coding coding, const char *bytes, size_t size) {
    buffer b = {NULL, 0};
    char space[4096];
    bool done = false;
    bw_packer *p = bw_packer_new(coding, size);
    for (size_t n; !done;) {
        assert_int_equal(bw_pack(p, &bytes, &size, true, space, sizeof space, &n, &done), BW_OK);
        take(&b, space, n);
    }
    bw_packer_free(p);
    return b;
}

static kit_reply put(const char *content, size_t size, const char *coding, buffer body, char path[100]) {
    char hash[BW_SHA256_TEXT], header[80];
    kit_hash(content, size, hash);
    snprintf(path, 100, "/v1/blobs/%s", hash);
    snprintf(header, sizeof header, "Content-Encoding: %s", coding);
    return kit_request(&d, "PUT", path, header, body.bytes, body.size);
}

static void an_upload_may_be_coded_and_is_known_by_its_content(void **state) {
    (void)state;
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        char content[200], path[100];
        int n = snprintf(content, sizeof content, "the content that is sent as %s", bw_coding_names[c]);
        buffer body = packed((bw_coding)c, content, (size_t)n);
        kit_reply r = put(content, (size_t)n, bw_coding_names[c], body, path);
        assert_int_equal(r.status, 201);
        json_t *blob = kit_json(&r);
        assert_int_equal(json_integer_value(json_object_get(blob, "bytes")), n);
        json_decref(blob);
        r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
        assert_int_equal(r.status, 200);
        kit_free(&r);
        free(body.bytes);
    }
}

/* How large a coded body is is known when it is there. */
static void a_coded_upload_counts_by_its_content(void **state) {
    (void)state;
    kit_daemon other = d;
    static char content[5000];
    char path[100], file[300];
    kit_start(&d, NULL, (const char *const[]){"--owner-bytes", "1000", NULL});
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer body = packed((bw_coding)c, content, sizeof content);
        assert_true(body.size < 1000);
        kit_expect_problem(put(content, sizeof content, bw_coding_names[c], body, path), 429, "too-many-bytes");
        snprintf(file, sizeof file, "%s/blobs/%.2s%s", d.data, strrchr(path, '/') + 1, strrchr(path, '/'));
        assert_int_not_equal(access(file, F_OK), 0);
        free(body.bytes);
        body = packed((bw_coding)c, content, 900); /* the second time it is there already */
        kit_reply r = put(content, 900, bw_coding_names[c], body, path);
        assert_true(r.status == 200 || r.status == 201);
        kit_free(&r);
        free(body.bytes);
    }
    kit_remove(&d);
    d = other;
}

static void a_coded_upload_that_is_damaged_or_ends_early_is_refused(void **state) {
    (void)state;
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        char content[5000], path[100];
        memset(content, 'a' + c, sizeof content);
        buffer body = packed((bw_coding)c, content, sizeof content);
        body.size -= 3;
        kit_expect_problem(put(content, sizeof content, bw_coding_names[c], body, path), 400, "bad-coding");
        body.size += 3;
        body.bytes[body.size - 2] ^= 1;
        kit_expect_problem(put(content, sizeof content, bw_coding_names[c], body, path), 400, "bad-coding");
        kit_expect_problem(put(content, sizeof content, bw_coding_names[c], (buffer){content, 2000}, path), 400, "bad-coding");
        kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
        assert_int_equal(r.status, 404);
        kit_free(&r);
        free(body.bytes);
    }
}

static void a_coding_that_is_not_known_is_415(void **state) {
    (void)state;
    for (const char *const *coding = (const char *const[]){"br", "deflate", "gzip, gzip", "gzip\nContent-Encoding: gzip", NULL}; *coding; coding++) {
        char path[100];
        kit_reply r = put("x", 1, *coding, (buffer){"x", 1}, path);
        assert_string_equal(kit_header(&r, "Accept-Encoding"), "gzip, zstd");
        kit_expect_problem(r, 415, "unsupported-coding");
    }
}

static void a_bomb_is_refused_by_what_it_would_be(void **state) {
    (void)state;
    enum { MUCH = 256 << 20 };
    char *zeros = calloc(MUCH, 1), path[100];
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer body = packed((bw_coding)c, zeros, MUCH);
        assert_true(body.size < UPLOAD_MOST);
        kit_expect_problem(put(zeros, 1, bw_coding_names[c], body, path), 413, "body-too-large");
        free(body.bytes);
        body = packed((bw_coding)c, zeros, UPLOAD_MOST + 1);
        kit_expect_problem(put(zeros, UPLOAD_MOST + 1, bw_coding_names[c], body, path), 413, "body-too-large");
        free(body.bytes);
        body = packed((bw_coding)c, zeros, UPLOAD_MOST);
        kit_reply r = put(zeros, UPLOAD_MOST, bw_coding_names[c], body, path);
        assert_int_equal(r.status, c == BW_CODING_GZIP ? 201 : 200);
        kit_free(&r);
        free(body.bytes);
    }
    free(zeros);
}

static void a_job_may_be_described_in_coded_json(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], json[200], header[100];
    kit_upload(&d, "# coded json\n", hash);
    int n = snprintf(json, sizeof json, "{\"input\":\"%s\",\"name\":\"coded\"}", hash);
    for (int c = BW_CODING_GZIP; c < BW_CODING_COUNT; c++) {
        buffer body = packed((bw_coding)c, json, (size_t)n);
        snprintf(header, sizeof header, "Content-Type: application/json\nContent-Encoding: %s", bw_coding_names[c]);
        kit_reply r = kit_request(&d, "POST", "/v1/jobs", header, body.bytes, body.size);
        assert_int_equal(r.status, 201);
        json_t *job = kit_json(&r);
        assert_string_equal(kit_text(job, "name"), "coded");
        json_decref(job);
        free(body.bytes);
        char *spaces = malloc(100000);
        memset(spaces, ' ', 100000);
        body = packed((bw_coding)c, spaces, 100000);
        kit_expect_problem(kit_request(&d, "POST", "/v1/jobs", header, body.bytes, body.size), 413, "body-too-large");
        free(body.bytes), free(spaces);
    }
}

/* "Wed" and "W/" begin with the same letter. */
static void if_range_with_the_date_of_a_wednesday_gives_the_part(void **state) {
    (void)state;
    char path[300], sql[100], date[60], headers[120];
    struct tm tm;
    time_t day = time(NULL);
    sqlite3 *db;
    while (gmtime_r(&day, &tm)->tm_wday != 3) day -= 86400;
    assert_int_equal(kit_stop(&d), 0);
    snprintf(path, sizeof path, "%s/jobs.db", d.data);
    snprintf(sql, sizeof sql, "UPDATE jobs SET finished = %lld", (long long)day * 1000);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, sql, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    kit_restart(&d, NULL);
    strftime(date, sizeof date, "Wed, %d %b %Y %H:%M:%S GMT", &tm);
    snprintf(headers, sizeof headers, "Range: bytes=1-2\nIf-Range: %s", date);
    expect_part(data_path, headers, data, 1, 2, "bytes 1-2/100000");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_range_is_answered_with_just_that_part),
        cmocka_unit_test(what_is_no_single_range_is_answered_with_the_whole),
        cmocka_unit_test(a_range_behind_the_end_is_416),
        cmocka_unit_test(if_range_gives_the_part_only_of_the_same_content),
        cmocka_unit_test(conditions_are_weighed_in_their_order),
        cmocka_unit_test(several_lines_are_one_list),
        cmocka_unit_test(a_text_is_coded_as_the_client_likes_it),
        cmocka_unit_test(documents_and_pages_are_coded_too),
        cmocka_unit_test(the_digest_is_that_of_the_content),
        cmocka_unit_test(an_upload_may_be_coded_and_is_known_by_its_content),
        cmocka_unit_test(conditions_do_not_meet_what_changes_something),
        cmocka_unit_test(answers_are_not_kept_by_others),
        cmocka_unit_test(a_coded_upload_counts_by_its_content),
        cmocka_unit_test(a_coded_upload_that_is_damaged_or_ends_early_is_refused),
        cmocka_unit_test(a_coding_that_is_not_known_is_415),
        cmocka_unit_test(a_bomb_is_refused_by_what_it_would_be),
        cmocka_unit_test(a_job_may_be_described_in_coded_json),
        cmocka_unit_test(if_range_with_the_date_of_a_wednesday_gives_the_part),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
