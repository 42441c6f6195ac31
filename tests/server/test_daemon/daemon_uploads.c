/* Resumable uploads (tus 1.0.0): in parts, over broken connections and a killed daemon; and everything that is refused. */
#include <dirent.h>
#include <openssl/evp.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "access_kit.h"

#define TUS "Tus-Resumable: 1.0.0\n"
#define BYTES TUS "Content-Type: application/offset+octet-stream\n"
static const char *const arguments[] = {"--max-upload", "8M", "--body-timeout", "2s", "--max-uploads", "30", NULL};

static kit_daemon d;

static int start(void **state) {
    (void)state;
    kit_start(&d, NULL, arguments);
    return 0;
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

static kit_reply post(const char *headers, const void *body, size_t size) {
    kit_reply r = kit_request(&d, "POST", "/v1/uploads", headers, body, size);
    assert_string_equal(kit_header(&r, "Tus-Resumable"), "1.0.0");
    return r;
}

/* Begins an upload of `length` bytes; writes its address. */
static void begin(size_t length, const char *more, char path[80]) {
    char headers[600];
    snprintf(headers, sizeof headers, TUS "Upload-Length: %zu\n%s", length, more);
    kit_reply r = post(headers, NULL, 0);
    assert_int_equal(r.status, 201);
    assert_string_equal(kit_header(&r, "Upload-Offset"), "0");
    assert_string_not_equal(kit_header(&r, "Upload-Expires"), "");
    snprintf(path, 80, "%s", r.location);
    assert_int_equal(strlen(path), strlen("/v1/uploads/") + 24);
    kit_free(&r);
}

static kit_reply patch(const char *path, size_t offset, const char *more, const void *body, size_t size) {
    char headers[400];
    snprintf(headers, sizeof headers, BYTES "Upload-Offset: %zu\n%s", offset, more);
    kit_reply r = kit_request(&d, "PATCH", path, headers, body, size);
    assert_string_equal(kit_header(&r, "Tus-Resumable"), "1.0.0");
    return r;
}

static void expect_patched(kit_reply r, size_t offset) {
    if (r.status != 204) fail_msg("%ld %s", r.status, r.body);
    assert_int_equal(strtoull(kit_header(&r, "Upload-Offset"), NULL, 10), offset);
    kit_free(&r);
}

static kit_reply head(const char *path) {
    for (int i = 0;; i++, kit_sleep_ms(20)) { /* a connection that broke is noticed after a moment */
        kit_reply r = kit_request(&d, "HEAD", path, TUS, NULL, 0);
        if (r.status != 423) return r;
        kit_free(&r);
        assert_true(i < 1500);
    }
}

static size_t offset_of(const char *path) {
    kit_reply r = head(path);
    assert_int_equal(r.status, 200);
    assert_string_equal(kit_header(&r, "Cache-Control"), "no-store");
    size_t offset = strtoull(kit_header(&r, "Upload-Offset"), NULL, 10);
    kit_free(&r);
    return offset;
}

static char *bytes(size_t size, unsigned seed) {
    char *data = malloc(size);
    srand(seed);
    for (size_t i = 0; i < size; i++) data[i] = (char)(rand() >> 7);
    return data;
}

static void expect_blob(const char *data, size_t size) {
    char hash[BW_SHA256_TEXT], path[120];
    kit_hash(data, size, hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(&d, "HEAD", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    assert_int_equal(strtoull(kit_header(&r, "Content-Length"), NULL, 10), size);
    kit_free(&r);
}

static void it_is_told_what_is_spoken(void **state) {
    (void)state;
    kit_reply r = kit_request(&d, "OPTIONS", "/v1/uploads", NULL, NULL, 0);
    assert_int_equal(r.status, 204);
    assert_string_equal(kit_header(&r, "Tus-Version"), "1.0.0");
    assert_string_equal(kit_header(&r, "Tus-Max-Size"), "8388608");
    assert_string_equal(kit_header(&r, "Tus-Extension"), "creation,creation-with-upload,checksum,expiration,termination");
    assert_string_equal(kit_header(&r, "Tus-Checksum-Algorithm"), "sha256,sha1");
    kit_free(&r);
}

static void an_upload_in_parts_becomes_a_blob(void **state) {
    (void)state;
    enum { SIZE = 300000, PART = 70001 };
    char path[80], hash[BW_SHA256_TEXT], *data = bytes(SIZE, 1);
    kit_hash(data, SIZE, hash);
    begin(SIZE, "", path);
    for (size_t at = 0; at < SIZE; at += PART) {
        size_t size = SIZE - at < PART ? SIZE - at : PART;
        assert_int_equal(offset_of(path), at);
        kit_reply r = patch(path, at, "", data + at, size);
        assert_string_equal(kit_header(&r, "Blockwright-Blob"), at + size == SIZE ? hash : "");
        expect_patched(r, at + size);
    }
    kit_reply r = head(path);
    assert_string_equal(kit_header(&r, "Blockwright-Blob"), hash);
    assert_string_equal(kit_header(&r, "Upload-Length"), "300000");
    kit_free(&r);
    expect_blob(data, SIZE);
    free(data);
}

static void the_first_bytes_may_come_with_the_creation(void **state) {
    (void)state;
    char hash[BW_SHA256_TEXT], path[80];
    kit_reply r = post(BYTES "Upload-Length: 5", "whole", 5);
    assert_int_equal(r.status, 201);
    assert_string_equal(kit_header(&r, "Upload-Offset"), "5");
    kit_hash("whole", 5, hash);
    assert_string_equal(kit_header(&r, "Blockwright-Blob"), hash);
    kit_free(&r);
    expect_blob("whole", 5);
    r = post(BYTES "Upload-Length: 8", "begin", 5);
    assert_int_equal(r.status, 201);
    assert_string_equal(kit_header(&r, "Upload-Offset"), "5");
    snprintf(path, sizeof path, "%s", r.location);
    kit_free(&r);
    expect_patched(patch(path, 5, "", "ing", 3), 8);
    expect_blob("begining", 8);
    r = post(TUS "Upload-Length: 0", NULL, 0);
    assert_int_equal(r.status, 201);
    kit_free(&r);
    expect_blob("", 0);
}

static void a_job_takes_what_was_uploaded_in_parts(void **state) {
    (void)state;
    static const char script[] = "# in parts\n";
    char path[80], hash[BW_SHA256_TEXT], body[200];
    begin(sizeof script - 1, "", path);
    expect_patched(patch(path, 0, "", script, 4), 4);
    expect_patched(patch(path, 4, "", script + 4, sizeof script - 5), sizeof script - 1);
    kit_hash(script, sizeof script - 1, hash);
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\"}", hash);
    kit_reply r = kit_request(&d, "POST", "/v1/jobs", "Content-Type: application/json\nPrefer: wait=30", body, (size_t)n);
    assert_int_equal(r.status, 201);
    json_t *job = kit_json(&r);
    assert_string_equal(kit_text(job, "state"), "successful");
    json_decref(job);
}

static void what_does_not_fit_is_refused_and_changes_nothing(void **state) {
    (void)state;
    char path[80];
    begin(10, "", path);
    expect_patched(patch(path, 0, "", "abc", 3), 3);
    kit_reply r = patch(path, 2, "", "abc", 3);
    assert_string_equal(kit_header(&r, "Upload-Offset"), "3");
    kit_expect_problem(r, 409, "offset-mismatch");
    kit_expect_problem(patch(path, 4, "", "abc", 3), 409, "offset-mismatch");
    kit_expect_problem(patch(path, 3, "", "12345678", 8), 413, "body-too-large");
    kit_expect_problem(patch(path, 3, "Content-Encoding: gzip", "1234", 4), 415, "unsupported-coding");
    kit_expect_problem(kit_request(&d, "PATCH", path, TUS "Upload-Offset: 3\nContent-Type: text/plain", "a", 1), 415, "unsupported-media-type");
    kit_expect_problem(kit_request(&d, "PATCH", path, BYTES "Upload-Offset: three", "a", 1), 400, "bad-request");
    kit_expect_problem(kit_request(&d, "PATCH", path, BYTES, "a", 1), 400, "bad-request");
    r = kit_request(&d, "PATCH", path, "Content-Type: application/offset+octet-stream\nUpload-Offset: 3", "a", 1);
    assert_string_equal(kit_header(&r, "Tus-Version"), "1.0.0");
    kit_expect_problem(r, 412, "tus-version");
    kit_expect_problem(kit_request(&d, "PATCH", path, "Tus-Resumable: 0.2.2\nUpload-Offset: 3", "a", 1), 412, "tus-version");
    assert_int_equal(offset_of(path), 3);
    /* Without Content-Length it shows only when it is too late: what fitted stays. */
    kit_expect_problem(patch(path, 3, "Transfer-Encoding: chunked\nContent-Length:", "12345678", 8), 413, "body-too-large");
    assert_int_equal(offset_of(path), 3);
    expect_patched(patch(path, 3, "", "", 0), 3);
    expect_patched(patch(path, 3, "Transfer-Encoding: chunked\nContent-Length:", "4567890", 7), 10);
}

static void an_upload_that_cannot_be_is_not_begun(void **state) {
    (void)state;
    static const struct {
        const char *headers;
        long status;
        const char *code;
    } bad[] = {{"Upload-Length: 8388609", 413, "body-too-large"}, {"Upload-Length: -1", 400, "bad-request"}, {"Upload-Length: x", 400, "bad-request"},
               {"Upload-Length: 99999999999999999999", 400, "bad-request"}, {"X-None: 1", 400, "bad-request"}, {"Upload-Defer-Length: 1", 400, "bad-request"},
               {"Upload-Length: 1\nUpload-Metadata: name x!", 400, "bad-request"}, {"Upload-Length: 1\nUpload-Metadata: ,", 400, "bad-request"},
               {"Upload-Length: 1\nUpload-Metadata: sha256 YWJj", 400, "bad-request"}, {"Upload-Length: 1\nUpload-Checksum: crc32 YWJj", 400, "bad-request"}};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char headers[200];
        snprintf(headers, sizeof headers, TUS "%s", bad[i].headers);
        kit_expect_problem(post(headers, NULL, 0), bad[i].status, bad[i].code);
    }
    kit_expect_problem(post(BYTES "Upload-Length: 3", "four", 4), 413, "body-too-large");
    kit_expect_problem(post(TUS "Content-Type: text/plain\nUpload-Length: 4", "four", 4), 415, "unsupported-media-type");
    for (const char *const *m = (const char *const[]){"PATCH", "DELETE", NULL}; *m; m++)
        kit_expect_problem(kit_request(&d, *m, "/v1/uploads/000000000000000000000000", BYTES "Upload-Offset: 0", NULL, 0), 404, "no-such-upload");
    kit_reply r = head("/v1/uploads/000000000000000000000000");
    assert_int_equal(r.status, 404);
    kit_free(&r);
    r = head("/v1/uploads/..%2f..%2fjobs");
    assert_int_equal(r.status, 404);
    kit_free(&r);
}

static void checksum_header(const EVP_MD *md, const char *name, const char *data, size_t size, char header[200]) {
    unsigned char raw[EVP_MAX_MD_SIZE], text[100];
    unsigned n;
    EVP_Digest(data, size, raw, &n, md, NULL);
    EVP_EncodeBlock(text, raw, (int)n);
    snprintf(header, 200, "Upload-Checksum: %s %s", name, (const char *)text);
}

static void a_part_with_another_checksum_is_as_if_it_had_not_come(void **state) {
    (void)state;
    char path[80], header[200], *data = bytes(200000, 3);
    begin(200000, "", path);
    checksum_header(EVP_sha256(), "sha256", data, 100000, header);
    expect_patched(patch(path, 0, header, data, 100000), 100000);
    kit_expect_problem(patch(path, 100000, header, data + 100000, 100000), 460, "checksum-mismatch");
    assert_int_equal(offset_of(path), 100000);
    kit_expect_problem(patch(path, 100000, "Upload-Checksum: md5 1B2M2Y8AsgTpgAmY7PhCfg==", data, 1), 400, "bad-request");
    kit_expect_problem(patch(path, 100000, "Upload-Checksum: sha1 AAAA", data, 1), 400, "bad-request");
    checksum_header(EVP_sha1(), "sha1", data + 100000, 100000, header);
    expect_patched(patch(path, 100000, header, data + 100000, 100000), 200000);
    expect_blob(data, 200000); /* the hash of the whole has not suffered either */
    char other[400];
    checksum_header(EVP_sha1(), "sha1", "other", 5, header);
    snprintf(other, sizeof other, BYTES "Upload-Length: 5\n%s", header);
    kit_expect_problem(post(other, "again", 5), 460, "checksum-mismatch");
    free(data);
}

static void an_upload_with_another_hash_than_announced_is_gone(void **state) {
    (void)state;
    char path[80], hash[BW_SHA256_TEXT], header[200];
    unsigned char text[100];
    kit_hash("right!", 6, hash);
    EVP_EncodeBlock(text, (unsigned char *)hash, 64);
    snprintf(header, sizeof header, "Upload-Metadata: filename cGFydA==,sha256 %s,empty", (const char *)text);
    begin(6, header, path);
    kit_reply r = head(path);
    assert_string_equal(kit_header(&r, "Upload-Metadata"), strchr(header, ' ') + 1);
    kit_free(&r);
    kit_expect_problem(patch(path, 0, "", "wrong!", 6), 422, "hash-mismatch");
    r = head(path);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    begin(6, header, path);
    expect_patched(patch(path, 0, "", "right!", 6), 6);
    expect_blob("right!", 6);
}

/* Sends a PATCH that announces more than it brings, and hangs up. */
static void break_off(const char *path, size_t offset, size_t announced, const char *more, const char *data, size_t size) {
    char *text = malloc(size + 600);
    int n = snprintf(text, 600, "PATCH %s HTTP/1.1\r\nHost: x\r\nTus-Resumable: 1.0.0\r\nContent-Type: application/offset+octet-stream\r\n"
                     "Upload-Offset: %zu\r\nContent-Length: %zu\r\n%s\r\n", path, offset, announced, more);
    memcpy(text + n, data, size);
    kit_abandon(&d, text, (size_t)n + size);
    free(text);
}

static void of_a_broken_connection_what_came_stays(void **state) {
    (void)state;
    char path[80], *data = bytes(500000, 4);
    begin(500000, "", path);
    break_off(path, 0, 500000, "", data, 200000);
    size_t has = 0;
    for (int i = 0; i < 3000 && has < 200000; i++, kit_sleep_ms(10)) has = offset_of(path);
    assert_int_equal(has, 200000);
    break_off(path, has, 300000, "Upload-Checksum: sha1 qZk+NkcGgWq6PiVxeFDCbJzQ2J0=\r\n", data + has, 100000);
    kit_sleep_ms(300);
    assert_int_equal(offset_of(path), has); /* what cannot be checked does not stay */
    expect_patched(patch(path, has, "", data + has, 500000 - has), 500000);
    expect_blob(data, 500000);
    free(data);
}

static void a_killed_daemon_goes_on_where_it_was(void **state) {
    (void)state;
    char path[80], done[80], *data = bytes(400000, 5);
    begin(400000, "Upload-Metadata: name eA==", path);
    begin(3, "", done);
    expect_patched(patch(done, 0, "", "end", 3), 3);
    for (size_t at = 0; at < 400000; at += 100000) {
        expect_patched(patch(path, at, "", data + at, 100000), at + 100000);
        kit_kill(&d, SIGKILL);
        kit_restart(&d, arguments);
        assert_int_equal(offset_of(path), at + 100000);
    }
    expect_blob(data, 400000);
    kit_reply r = head(path);
    assert_int_equal(strlen(kit_header(&r, "Blockwright-Blob")), 64);
    kit_free(&r);
    assert_int_equal(offset_of(done), 3);
    free(data);
}

/* Between the last synced part and the kill anything may have come. */
static void bytes_that_were_not_told_to_be_durable_are_sent_again(void **state) {
    (void)state;
    char path[80], file[200], *data = bytes(100, 6);
    begin(100, "", path);
    expect_patched(patch(path, 0, "", data, 40), 40);
    kit_kill(&d, SIGKILL);
    snprintf(file, sizeof file, "%s/uploads/%s.part", d.data, strrchr(path, '/') + 1);
    FILE *f = fopen(file, "ab");
    assert_non_null(f);
    fputs("what nobody has vouched for", f);
    fclose(f);
    kit_restart(&d, arguments);
    assert_int_equal(offset_of(path), 40);
    expect_patched(patch(path, 40, "", data + 40, 60), 100);
    expect_blob(data, 100);
    free(data);
}

static void two_do_not_write_at_the_same_time(void **state) {
    (void)state;
    char path[80], text[400];
    begin(5000, "", path);
    int n = snprintf(text, sizeof text, "PATCH %s HTTP/1.1\r\nHost: x\r\nTus-Resumable: 1.0.0\r\nContent-Type: application/offset+octet-stream\r\n"
                     "Upload-Offset: 0\r\nContent-Length: 5000\r\n\r\nsome", path);
    int fd = kit_connect(&d, text, (size_t)n);
    bool busy = false;
    for (int i = 0; !busy && i < 500; i++, kit_sleep_ms(10)) {
        kit_reply r = kit_request(&d, "HEAD", path, TUS, NULL, 0);
        busy = r.status == 423;
        kit_free(&r);
    }
    assert_true(busy);
    kit_reply r = patch(path, 0, "", "other", 5);
    assert_string_equal(kit_header(&r, "Retry-After"), "1");
    kit_expect_problem(r, 423, "upload-busy");
    kit_expect_problem(kit_request(&d, "DELETE", path, TUS, NULL, 0), 423, "upload-busy");
    close(fd);
    assert_int_equal(offset_of(path), 4);
}

static void an_upload_that_is_given_up_is_gone_but_not_its_blob(void **state) {
    (void)state;
    char path[80];
    begin(4, "", path);
    expect_patched(patch(path, 0, "", "ab", 2), 2);
    kit_reply r = kit_request(&d, "DELETE", path, TUS, NULL, 0);
    assert_int_equal(r.status, 204);
    kit_free(&r);
    kit_expect_problem(kit_request(&d, "DELETE", path, TUS, NULL, 0), 404, "no-such-upload");
    kit_expect_problem(patch(path, 2, "", "cd", 2), 404, "no-such-upload");
    begin(4, "", path);
    expect_patched(patch(path, 0, "", "abcd", 4), 4);
    r = kit_request(&d, "POST", path, TUS "X-HTTP-Method-Override: DELETE", NULL, 0); /* for clients that cannot say DELETE */
    assert_int_equal(r.status, 204);
    kit_free(&r);
    r = head(path);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    expect_blob("abcd", 4);
}

static void there_is_a_limit_to_their_number(void **state) {
    (void)state;
    kit_reply r;
    int begun = 0;
    for (long status = 201; status == 201; begun++) {
        assert_true(begun <= 30);
        r = post(TUS "Upload-Length: 1", NULL, 0);
        if ((status = r.status) == 201) kit_free(&r);
    }
    assert_string_equal(kit_header(&r, "Retry-After"), "60");
    kit_expect_problem(r, 429, "too-many-uploads");
}

static void metadata_that_is_none_is_refused(void **state) {
    (void)state;
    char headers[1400], letters[1201] = "";
    const char *const wrong[] = {"\xff YQ==", "name \xff\xff\xff\xff", letters};
    for (int i = 0; i < 1200; i++) letters[i] = i == 4 ? ' ' : i < 4 ? 'k' : '!';
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        snprintf(headers, sizeof headers, TUS "Upload-Length: 1\nUpload-Metadata: %s", wrong[i]);
        kit_expect_problem(post(headers, NULL, 0), 400, "bad-request");
    }
}

static int sidecars(void) {
    char folder[200];
    int n = 0;
    snprintf(folder, sizeof folder, "%s/uploads", d.data);
    DIR *open = opendir(folder);
    assert_non_null(open);
    for (struct dirent *e; (e = readdir(open));) n += strstr(e->d_name, ".json") != NULL;
    closedir(open);
    return n;
}

static void those_that_are_complete_are_not_under_way(void **state) {
    (void)state;
    char text[8];
    kit_remove(&d);
    kit_start(&d, NULL, arguments);
    for (int i = 0; i < 40; i++) {
        snprintf(text, sizeof text, "%04d", i);
        kit_reply r = post(BYTES "Upload-Length: 4", text, 4);
        assert_int_equal(r.status, 201);
        kit_free(&r);
    }
    assert_true(sidecars() > 30); /* 40, if the oldest were not collected yet */
    for (int i = 0; i < 3000 && sidecars() > 30; i++) kit_sleep_ms(10);
    assert_int_equal(sidecars(), 30);
}

static void an_owner_has_only_so_many_and_so_large(void **state) {
    (void)state;
    kit_daemon few;
    kit_start(&few, NULL, (const char *const[]){"--owner-uploads", "3", "--owner-bytes", "1000", NULL});
    kit_token ada = kit_new_token(&few, "ada", "--scopes submit,read"), bob = kit_new_token(&few, "bob", "--scopes submit,read");
    static const struct {
        bool bobs;
        int length;
        const char *problem;
    } steps[] = {{false, 300, NULL}, {false, 300, NULL}, {false, 401, "too-many-bytes"}, {false, 400, NULL},
                 {false, 0, "too-many-uploads"}, {true, 1000, NULL}, {true, 1, "too-many-bytes"}};
    for (size_t i = 0; i < sizeof steps / sizeof *steps; i++) {
        char headers[300];
        snprintf(headers, sizeof headers, TUS "Upload-Length: %d\nAuthorization: Bearer %s", steps[i].length, steps[i].bobs ? bob.secret : ada.secret);
        kit_reply r = kit_request(&few, "POST", "/v1/uploads", headers, NULL, 0);
        if (steps[i].problem) assert_true(atoi(kit_header(&r, "Retry-After")) > 0);
        if (steps[i].problem) kit_expect_problem(r, 429, steps[i].problem);
        else assert_int_equal(r.status, 201);
        if (!steps[i].problem) kit_free(&r);
    }
    kit_remove(&few);
}

static void what_nobody_goes_on_with_expires(void **state) {
    (void)state;
    char path[80], file[200];
    assert_int_equal(kit_stop(&d), 0);
    kit_restart(&d, (const char *const[]){"--upload-keep", "1s", NULL});
    begin(4, "", path);
    snprintf(file, sizeof file, "%s/uploads/%s.part", d.data, strrchr(path, '/') + 1);
    assert_int_equal(access(file, F_OK), 0);
    kit_reply r = head(path);
    for (int i = 0; i < 1000 && r.status == 200; i++, kit_sleep_ms(10)) kit_free(&r), r = kit_request(&d, "HEAD", path, TUS, NULL, 0);
    assert_int_equal(r.status, 404);
    kit_free(&r);
    for (int i = 0; i < 3000 && access(file, F_OK) == 0; i++) kit_sleep_ms(10);
    assert_int_not_equal(access(file, F_OK), 0);
}

/* Neither while nothing happens nor while its owner sends. */
static void an_upload_of_another_owner_is_as_if_it_were_not_there(void **state) {
    (void)state;
    kit_daemon few;
    char headers[400], path[80], text[600];
    kit_start(&few, NULL, NULL);
    kit_token alice = kit_new_token(&few, "alice", "--scopes submit,read"), bob = kit_new_token(&few, "bob", "--scopes submit,read");
    snprintf(headers, sizeof headers, BYTES "Upload-Length: 6\nAuthorization: Bearer %s", alice.secret);
    kit_reply r = kit_request(&few, "POST", "/v1/uploads", headers, "ali", 3);
    assert_int_equal(r.status, 201);
    snprintf(path, sizeof path, "%s", r.location);
    kit_free(&r);
    int n = snprintf(text, sizeof text, "PATCH %s HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nAuthorization: Bearer %s\r\n"
                     "Content-Type: application/offset+octet-stream\r\nUpload-Offset: 3\r\nContent-Length: 3\r\n\r\nc", path, alice.secret);
    for (int round = 0; round < 2; round++) {
        int fd = round ? kit_connect(&few, text, (size_t)n) : -1;
        if (round) kit_sleep_ms(200);
        snprintf(headers, sizeof headers, BYTES "Upload-Offset: 3\nAuthorization: Bearer %s", bob.secret);
        kit_expect_problem(kit_request(&few, "PATCH", path, headers, "bob", 3), 404, "no-such-upload");
        kit_expect_problem(kit_request(&few, "DELETE", path, headers, NULL, 0), 404, "no-such-upload");
        r = kit_request(&few, "HEAD", path, headers, NULL, 0);
        assert_int_equal(r.status, 404);
        kit_free(&r);
        if (fd >= 0) assert_int_equal(send(fd, "e!", 2, MSG_NOSIGNAL), 2);
        for (int i = 0; fd >= 0 && i < 1000; i++, kit_sleep_ms(10)) {
            snprintf(headers, sizeof headers, TUS "Authorization: Bearer %s", alice.secret);
            r = kit_request(&few, "HEAD", path, headers, NULL, 0);
            bool whole = strcmp(kit_header(&r, "Upload-Offset"), "6") == 0;
            kit_free(&r);
            if (whole) break;
            assert_true(i < 999);
        }
        if (fd >= 0) close(fd);
    }
    kit_hash("alice!", 6, text);
    for (int own = 0; own < 2; own++) { /* the blob is alice's only, too */
        char address[100];
        snprintf(address, sizeof address, "/v1/blobs/%.64s", text);
        r = kit_ask(&few, own ? alice.secret : bob.secret, "HEAD", address, NULL);
        assert_int_equal(r.status, own ? 200 : 404);
        kit_free(&r);
    }
    kit_remove(&few);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(it_is_told_what_is_spoken),
        cmocka_unit_test(an_upload_in_parts_becomes_a_blob),
        cmocka_unit_test(the_first_bytes_may_come_with_the_creation),
        cmocka_unit_test(a_job_takes_what_was_uploaded_in_parts),
        cmocka_unit_test(what_does_not_fit_is_refused_and_changes_nothing),
        cmocka_unit_test(an_upload_that_cannot_be_is_not_begun),
        cmocka_unit_test(a_part_with_another_checksum_is_as_if_it_had_not_come),
        cmocka_unit_test(an_upload_with_another_hash_than_announced_is_gone),
        cmocka_unit_test(of_a_broken_connection_what_came_stays),
        cmocka_unit_test(a_killed_daemon_goes_on_where_it_was),
        cmocka_unit_test(bytes_that_were_not_told_to_be_durable_are_sent_again),
        cmocka_unit_test(two_do_not_write_at_the_same_time),
        cmocka_unit_test(an_upload_that_is_given_up_is_gone_but_not_its_blob),
        cmocka_unit_test(metadata_that_is_none_is_refused),
        cmocka_unit_test(there_is_a_limit_to_their_number),
        cmocka_unit_test(what_nobody_goes_on_with_expires),
        cmocka_unit_test(those_that_are_complete_are_not_under_way),
        cmocka_unit_test(an_owner_has_only_so_many_and_so_large),
        cmocka_unit_test(an_upload_of_another_owner_is_as_if_it_were_not_there),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
