#include "daemon_kit.h"

#include <arpa/inet.h>
#include <curl/curl.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "server/files.h"

enum { ARGUMENTS_MOST = 32 };

void kit_sleep_ms(int ms) { nanosleep(&(struct timespec){ms / 1000, ms % 1000 * 1000000L}, NULL); }

static void exec_daemon(const kit_daemon *d, const char *const *arguments) {
    char log[96];
    char *argv[ARGUMENTS_MOST] = {BW_BIN_DIR "/blockwrightd", "--data", (char *)d->data, "--listen", "127.0.0.1:0",
                                     "--host-names", "x"}; /* raw requests say "Host: x" */
    int n = 7;
    argv[n++] = "--worker";
    argv[n++] = (char *)(d->worker ? d->worker : BW_BIN_DIR "/blockwright-test-worker");
    while (arguments && *arguments && n + 1 < ARGUMENTS_MOST) argv[n++] = (char *)*arguments++;
    snprintf(log, sizeof log, "%s.log", d->data);
    int fd = open(log, O_WRONLY | O_CREAT | O_APPEND, 0600);
    dup2(fd, 2);
    prctl(PR_SET_PDEATHSIG, SIGKILL); /* a failed test leaves no daemon behind */
    execv(argv[0], argv);
    _exit(126);
}

void kit_restart(kit_daemon *d, const char *const *arguments) {
    char path[96], line[80] = "";
    assert_int_equal(d->pid, 0);
    snprintf(path, sizeof path, "%s/address", d->data);
    unlink(path);
    d->pid = fork();
    if (d->pid == 0) exec_daemon(d, arguments);
    for (int i = 0; i < 6000; i++, kit_sleep_ms(5)) {
        FILE *f = fopen(path, "r");
        bool there = f && fgets(line, sizeof line, f);
        if (f) fclose(f);
        if (there) break;
        if (waitpid(d->pid, NULL, WNOHANG) != 0) fail_msg("the daemon ended at once; see %s.log", d->data);
    }
    if (!*line) fail_msg("the daemon does not listen; see %s.log", d->data);
    snprintf(d->address, sizeof d->address, "%.*s", (int)strcspn(line, "\n"), line);
}

void kit_start(kit_daemon *d, const char *worker, const char *const *arguments) {
    memset(d, 0, sizeof *d);
    snprintf(d->data, sizeof d->data, "/tmp/bw-test-XXXXXX");
    assert_non_null(mkdtemp(d->data));
    d->worker = worker;
    kit_restart(d, arguments);
}

void kit_shim(const char *rules) {
    char sanitizer[400];
    const char *asan = getenv("ASAN_OPTIONS");
    if (!rules) {
        unsetenv("BW_SHIM");
        unsetenv("LD_PRELOAD");
        return;
    }
    snprintf(sanitizer, sizeof sanitizer, "%s:verify_asan_link_order=0", asan ? asan : ""); /* the shim comes before its library */
    setenv("BW_SHIM", rules, 1);
    setenv("LD_PRELOAD", BW_BIN_DIR "/torture_shim.so", 1);
    setenv("ASAN_OPTIONS", sanitizer, 1);
}

void kit_kill(kit_daemon *d, int signal) {
    assert_int_not_equal(d->pid, 0);
    kill(d->pid, signal);
    assert_int_equal(waitpid(d->pid, NULL, 0), d->pid);
    d->pid = 0;
}

int kit_stop(kit_daemon *d) {
    int status;
    kill(d->pid, SIGTERM);
    assert_int_equal(waitpid(d->pid, &status, 0), d->pid);
    d->pid = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : 256 + WTERMSIG(status);
}

void kit_remove(kit_daemon *d) {
    char log[96];
    if (d->pid) assert_int_equal(kit_stop(d), 0); /* a sanitizer that found something makes it another */
    bw_remove_tree(d->data);
    snprintf(log, sizeof log, "%s.log", d->data);
    unlink(log);
}

/* ---- requests ---- */

static size_t take_body(char *data, size_t one, size_t size, void *user) {
    kit_reply *r = user;
    r->body = realloc(r->body, r->size + one * size + 1);
    memcpy(r->body + r->size, data, one * size);
    r->size += one * size;
    r->body[r->size] = '\0';
    return one * size;
}

static size_t take_header(char *data, size_t one, size_t size, void *user) {
    kit_reply *r = user;
    struct {
        const char *name;
        char *to;
    } wanted[] = {{"Content-Type: ", r->type}, {"ETag: ", r->etag}, {"Location: ", r->location}, {"Allow: ", r->allow},
                {"Content-Security-Policy: ", r->policy}, {"Preference-Applied: ", r->applied}};
    for (size_t i = 0; i < sizeof wanted / sizeof *wanted; i++) {
        size_t n = strlen(wanted[i].name);
        if (size > n && strncasecmp(data, wanted[i].name, n) == 0)
            snprintf(wanted[i].to, 80, "%.*s", (int)(strcspn(data + n, "\r\n")), data + n);
    }
    size_t n = strlen(r->headers);
    if (strncmp(data, "HTTP/", 5) == 0) n = 0;
    if (n + size < sizeof r->headers) snprintf(r->headers + n, sizeof r->headers - n, "%.*s", (int)size, data);
    return one * size;
}

const char *kit_header(const kit_reply *r, const char *name) {
    static char value[400];
    size_t n = strlen(name);
    *value = '\0';
    for (const char *at = r->headers; (at = strstr(at, "\r\n")) && at[2]; at += 2)
        if (strncasecmp(at + 2, name, n) == 0 && at[2 + n] == ':') {
            const char *from = at + 3 + n + strspn(at + 3 + n, " ");
            snprintf(value, sizeof value, "%.*s", (int)strcspn(from, "\r"), from);
        }
    return value;
}

typedef struct {
    const char *data;
    size_t left;
} source;

static size_t give_body(char *to, size_t one, size_t size, void *user) {
    source *s = user;
    size_t n = one * size < s->left ? one * size : s->left;
    memcpy(to, s->data, n);
    s->data += n;
    s->left -= n;
    return n;
}

static struct curl_slist *split_headers(const char *headers) {
    struct curl_slist *list = NULL;
    char *copy = strdup(headers ? headers : ""), *rest = copy;
    for (char *line; (line = strsep(&rest, "\n"));)
        if (*line) list = curl_slist_append(list, line);
    free(copy);
    return list;
}

bool kit_try(const kit_daemon *d, const char *method, const char *path, const char *headers, const void *body,
             size_t size, kit_reply *r) {
    char url[400];
    source s = {body, size};
    CURL *curl = curl_easy_init();
    struct curl_slist *list = split_headers(headers);
    memset(r, 0, sizeof *r);
    snprintf(url, sizeof url, "http://%s%s", d->address, path);
    curl_easy_setopt(curl, CURLOPT_URL, url);
    curl_easy_setopt(curl, CURLOPT_PATH_AS_IS, 1L);
    curl_easy_setopt(curl, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(curl, CURLOPT_TIMEOUT, 60L);
    curl_easy_setopt(curl, CURLOPT_HTTPHEADER, list);
    curl_easy_setopt(curl, CURLOPT_WRITEFUNCTION, take_body);
    curl_easy_setopt(curl, CURLOPT_WRITEDATA, r);
    curl_easy_setopt(curl, CURLOPT_HEADERFUNCTION, take_header);
    curl_easy_setopt(curl, CURLOPT_HEADERDATA, r);
    if (strcmp(method, "HEAD") == 0) {
        curl_easy_setopt(curl, CURLOPT_NOBODY, 1L);
    } else if (body) {
        curl_easy_setopt(curl, CURLOPT_UPLOAD, 1L);
        curl_easy_setopt(curl, CURLOPT_READFUNCTION, give_body);
        curl_easy_setopt(curl, CURLOPT_READDATA, &s);
        curl_easy_setopt(curl, CURLOPT_INFILESIZE_LARGE, (curl_off_t)size);
        curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method);
    } else {
        curl_easy_setopt(curl, CURLOPT_CUSTOMREQUEST, method);
    }
    CURLcode code = curl_easy_perform(curl);
    curl_easy_getinfo(curl, CURLINFO_RESPONSE_CODE, &r->status);
    curl_slist_free_all(list);
    curl_easy_cleanup(curl);
    if (!r->body) r->body = calloc(1, 1);
    if (code == CURLE_OK || (code == CURLE_SEND_ERROR && r->status)) return true;
    kit_free(r);
    return false;
}

kit_reply kit_request(const kit_daemon *d, const char *method, const char *path, const char *headers, const void *body,
                      size_t size) {
    kit_reply r;
    if (!kit_try(d, method, path, headers, body, size, &r)) fail_msg("no answer to %s %s; see %s.log", method, path, d->data);
    return r;
}

kit_reply kit_get(const kit_daemon *d, const char *format, ...) {
    char path[300];
    va_list args;
    va_start(args, format);
    vsnprintf(path, sizeof path, format, args);
    va_end(args);
    return kit_request(d, "GET", path, NULL, NULL, 0);
}

void kit_free(kit_reply *r) {
    free(r->body);
    r->body = NULL;
}

json_t *kit_json(kit_reply *r) {
    json_t *value = json_loads(r->body, 0, NULL);
    if (!value) fail_msg("not JSON (status %ld): %s", r->status, r->body);
    kit_free(r);
    return value;
}

/* ---- jobs ---- */

void kit_hash(const void *data, size_t size, char hash[BW_SHA256_TEXT]) {
    bw_digest *digest = bw_digest_new();
    assert_true(bw_digest_add(digest, data, size) && bw_digest_end(digest, hash));
    bw_digest_free(digest);
}

void kit_upload(const kit_daemon *d, const char *content, char hash[BW_SHA256_TEXT]) {
    char path[120];
    kit_hash(content, strlen(content), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    kit_reply r = kit_request(d, "PUT", path, NULL, content, strlen(content));
    assert_true(r.status == 200 || r.status == 201);
    kit_free(&r);
}

void kit_submit(const kit_daemon *d, const char *content, const char *options, char id[32]) {
    kit_submit_both(d, content, NULL, options, id);
}

void kit_submit_both(const kit_daemon *d, const char *content, const char *parameters, const char *options, char id[32]) {
    char hash[BW_SHA256_TEXT], side[BW_SHA256_TEXT], member[100] = "", body[700];
    kit_upload(d, content, hash);
    if (parameters) {
        kit_upload(d, parameters, side);
        snprintf(member, sizeof member, "\"parameters\":\"%s\",", side);
    }
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\",%s\"options\":%s}", hash, member, options ? options : "{}");
    kit_reply r = kit_request(d, "POST", "/v1/jobs", "Content-Type: application/json", body, (size_t)n);
    kit_take_id(r, id);
}

void kit_take_id(kit_reply r, char id[32]) {
    if (r.status != 201) fail_msg("%ld instead of 201: %s", r.status, r.body);
    json_t *job = kit_json(&r);
    snprintf(id, 32, "%s", kit_text(job, "id"));
    json_decref(job);
}

size_t kit_listed(const kit_daemon *d, const char *query) {
    kit_reply r = kit_get(d, "/v1/jobs?%s", query);
    assert_int_equal(r.status, 200);
    json_t *page = kit_json(&r);
    size_t n = json_array_size(json_object_get(page, "jobs"));
    json_decref(page);
    return n;
}

json_t *kit_job(const kit_daemon *d, const char *id) {
    kit_reply r = kit_get(d, "/v1/jobs/%s", id);
    assert_int_equal(r.status, 200);
    return kit_json(&r);
}

const char *kit_text(const json_t *object, const char *name) {
    const char *text = json_string_value(json_object_get(object, name));
    return text ? text : "";
}

json_t *kit_wait(const kit_daemon *d, const char *id, int seconds) {
    for (int i = 0; i < seconds * 50; i++, kit_sleep_ms(20)) {
        json_t *job = kit_job(d, id);
        const char *state = kit_text(job, "state");
        if (strcmp(state, "queued") != 0 && strcmp(state, "running") != 0) return job;
        json_decref(job);
    }
    fail_msg("job %s does not end; see %s.log", id, d->data);
    return NULL;
}

void kit_wait_state(const kit_daemon *d, const char *id, const char *state, int seconds) {
    for (int i = 0; i < seconds * 100; i++, kit_sleep_ms(10)) {
        json_t *job = kit_job(d, id);
        bool there = strcmp(kit_text(job, "state"), state) == 0;
        json_decref(job);
        if (there) return;
    }
    fail_msg("job %s does not become %s; see %s.log", id, state, d->data);
}

void kit_expect_problem(kit_reply r, long status, const char *code) {
    char type[80];
    snprintf(type, sizeof type, "/problems/%s", code);
    if (r.status != status) fail_msg("expected %ld %s, got %ld: %s", status, code, r.status, r.body);
    assert_string_equal(r.type, "application/problem+json");
    if (status == 503 || status == 429) assert_true(atoi(kit_header(&r, "Retry-After")) > 0);
    json_t *problem = kit_json(&r);
    assert_string_equal(kit_text(problem, "type"), type);
    assert_int_equal(json_integer_value(json_object_get(problem, "status")), status);
    assert_true(strlen(kit_text(problem, "title")) > 0);
    json_decref(problem);
}

int kit_connect(const kit_daemon *d, const char *data, size_t size) {
    struct sockaddr_in to = {.sin_family = AF_INET};
    to.sin_port = htons((uint16_t)atoi(strchr(d->address, ':') + 1));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    struct timeval patience = {2, 0};
    setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    assert_int_equal(connect(fd, (struct sockaddr *)&to, sizeof to), 0);
    for (size_t sent = 0; sent < size;) {
        ssize_t w = send(fd, data + sent, size - sent, MSG_NOSIGNAL);
        if (w <= 0) break;
        sent += (size_t)w;
    }
    return fd;
}

char *kit_raw(const kit_daemon *d, const char *data, size_t size, bool half_close) {
    size_t n = 0, room = 65536;
    char *answer = calloc(room + 1, 1);
    int fd = kit_connect(d, data, size);
    if (half_close) shutdown(fd, SHUT_WR);
    for (ssize_t got; n < room && (got = recv(fd, answer + n, room - n, 0)) > 0;) n += (size_t)got;
    close(fd);
    return answer;
}

void kit_abandon(const kit_daemon *d, const char *data, size_t size) { close(kit_connect(d, data, size)); }

bool kit_no_uploads(const kit_daemon *d, int ms) {
    char path[100];
    snprintf(path, sizeof path, "%s/tmp", d->data);
    for (int waited = 0; waited <= ms; waited += 10, kit_sleep_ms(10)) {
        int found = 0;
        DIR *folder = opendir(path);
        for (struct dirent *e; folder && (e = readdir(folder));) found += strncmp(e->d_name, "upload.", 7) == 0;
        if (folder) closedir(folder);
        if (!found) return true;
    }
    return false;
}

/* ---- processes ---- */

static pid_t parent_of(pid_t pid) {
    char path[64], line[400] = "";
    int parent = 0;
    snprintf(path, sizeof path, "/proc/%d/stat", (int)pid);
    FILE *f = fopen(path, "r");
    if (!f) return 0;
    if (fgets(line, sizeof line, f) && strrchr(line, ')')) sscanf(strrchr(line, ')') + 2, "%*c %d", &parent);
    fclose(f);
    return parent;
}

size_t kit_workers(const kit_daemon *d, pid_t *pids, size_t most) {
    size_t n = 0;
    DIR *proc = opendir("/proc");
    for (struct dirent *e; proc && n < most && (e = readdir(proc));) {
        pid_t pid = atoi(e->d_name), parent = pid > 0 ? parent_of(pid) : 0;
        if (parent > 1 && parent != d->pid && parent_of(parent) == d->pid) pids[n++] = pid;
    }
    closedir(proc);
    return n;
}
