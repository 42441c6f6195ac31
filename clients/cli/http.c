#include "http.h"

#include <curl/curl.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "command.h"
#include "failure.h"

enum { URL_MAX = 2048, CONNECT_SECONDS = 10, STALL_SECONDS = 120, RATE_TRIES = 20, RATE_SECONDS_MOST = 60 };
static const size_t reply_max = (size_t)256 << 20; /* report.json and manifests stay far below */

struct cli_http {
    CURL *curl;
    char server[1024];
    char token[200]; /* "": none */
    char ca_file[1024];
    CURLcode code; /* of the last call */
    bool answers;  /* it has, at least once */
    char error[CURL_ERROR_SIZE];
    char text[CURL_ERROR_SIZE + 64];
    struct curl_slist *headers; /* of the next call */
};

/* Where the body of an answer goes. */
typedef struct {
    cli_http *http;
    cli_reply *reply;
    FILE *file; /* for the body of a 200; NULL: everything goes to reply */
    int64_t room;
    bool (*take)(void *user, const char *bytes, size_t size); /* likewise */
    void *user;
} sink;

static void read_token_file(const char *path, char token[200]) {
    FILE *f = fopen(path, "re");
    if (!f || !fgets(token, 200, f)) {
        cli_error("the token cannot be read from %s", path);
        exit(CLI_USAGE);
    }
    fclose(f);
}

/* True if what goes there cannot be read on the way. */
static bool is_private(const char *server) {
    static const char *const good[] = {"https://", "http://127.", "http://localhost", "http://[::1]"};
    for (size_t i = 0; i < sizeof good / sizeof *good; i++)
        if (!strncasecmp(server, good[i], strlen(good[i]))) return true;
    return false;
}

static void find_token(cli_http *http, const cli_remote *remote) {
    const char *token = getenv("BLOCKWRIGHT_TOKEN");
    if (remote->token_file) read_token_file(remote->token_file, http->token);
    else snprintf(http->token, sizeof http->token, "%s", token ? token : "");
    http->token[strcspn(http->token, " \t\r\n")] = 0;
    for (const char *c = http->token; *c; c++) {
        if (*c > 0x20 && *c < 0x7f) continue;
        cli_error("the access token has a character that no token has");
        exit(CLI_USAGE);
    }
    if (*http->token && !is_private(http->server)) cli_error("warning: the access token goes to %s unencrypted", http->server);
}

cli_http *cli_http_open(const cli_remote *remote) {
    const char *server = remote->server, *ca = remote->ca_file ? remote->ca_file : getenv("BLOCKWRIGHT_CA_FILE");
    cli_http *http = calloc(1, sizeof *http);
    if (!http || curl_global_init(CURL_GLOBAL_DEFAULT) != CURLE_OK) {
        cli_error("out of memory");
        exit(CLI_INTERNAL);
    }
    if (!server) server = getenv("BLOCKWRIGHT_SERVER");
    if (!server || !*server) server = "http://127.0.0.1:8080";
    snprintf(http->server, sizeof http->server, "%s", server);
    for (size_t n = strlen(http->server); n > 0 && http->server[n - 1] == '/'; n--) http->server[n - 1] = 0;
    snprintf(http->ca_file, sizeof http->ca_file, "%s", ca ? ca : "");
    find_token(http, remote);
    return http;
}

void cli_http_close(cli_http *http) {
    if (!http) return;
    curl_easy_cleanup(http->curl);
    curl_slist_free_all(http->headers);
    curl_global_cleanup();
    free(http);
}

const char *cli_http_server(const cli_http *http) {
    return http->server;
}
const char *cli_http_error(const cli_http *http) {
    return http->text;
}

bool cli_http_lost(const cli_http *http) {
    switch (http->code) {
    case CURLE_GOT_NOTHING:
    case CURLE_SEND_ERROR:
    case CURLE_RECV_ERROR:
    case CURLE_PARTIAL_FILE: return true;
    case CURLE_COULDNT_CONNECT:
    case CURLE_SSL_CONNECT_ERROR:
    case CURLE_OPERATION_TIMEDOUT: return http->answers;
    default: return false;
    }
}

bool cli_reply_passes(const cli_reply *reply) {
    return reply->status == 502 || reply->status == 503 || reply->status == 504;
}

void cli_reply_clear(cli_reply *reply) {
    free(reply->body);
    memset(reply, 0, sizeof *reply);
}

static size_t to_memory(sink *s, const char *data, size_t size) {
    cli_reply *r = s->reply;
    if (size > reply_max - r->size) return 0;
    char *body = realloc(r->body, r->size + size + 1);
    if (!body) return 0;
    memcpy(body + r->size, data, size);
    body[r->size += size] = 0;
    r->body = body;
    return size;
}

static size_t on_body(char *data, size_t one, size_t size, void *user) {
    sink *s = user;
    long status = 0;
    (void)one;
    curl_easy_getinfo(s->http->curl, CURLINFO_RESPONSE_CODE, &status);
    if (s->take && status == 200) return s->take(s->user, data, size) ? size : 0;
    if (!s->file || status != 200) return to_memory(s, data, size);
    if ((int64_t)size > s->room) return 0;
    s->room -= (int64_t)size;
    return fwrite(data, 1, size, s->file);
}

/* What a progress line tells of a body that is sent: bytes `from` to `size` of a file. */
typedef struct {
    cli_progress *progress;
    int64_t from, size;
} outgoing;

static int on_transfer(void *user, curl_off_t down_all, curl_off_t down, curl_off_t up_all, curl_off_t up) {
    const outgoing *o = user;
    (void)down_all;
    (void)down;
    if (up_all > 0) cli_progress_show(o->progress, "upload", (double)(o->from + up) / (double)o->size);
    return 0;
}

/* A handle of its own for every request: in libcurl 7.88 one that is used again, reset or not, keeps a pointer to the last header of the
 * answer before, and follows it when the next answer begins with a folded line. */
static void renew(cli_http *http) {
    curl_easy_cleanup(http->curl);
    http->curl = curl_easy_init();
    if (http->curl) return;
    cli_error("out of memory");
    exit(CLI_INTERNAL);
}

static void prepare(cli_http *http, const char *method, const char *path, sink *s) {
    char url[URL_MAX];
    renew(http);
    CURL *c = http->curl;
    snprintf(url, sizeof url, "%s%s", http->server, path);
    http->error[0] = 0;
    curl_easy_setopt(c, CURLOPT_URL, url);
    curl_easy_setopt(c, CURLOPT_PROTOCOLS_STR, "http,https");
    curl_easy_setopt(c, CURLOPT_USERAGENT, "blockwright/" BW_VERSION);
    curl_easy_setopt(c, CURLOPT_ERRORBUFFER, http->error);
    curl_easy_setopt(c, CURLOPT_NOSIGNAL, 1L);
    curl_easy_setopt(c, CURLOPT_CONNECTTIMEOUT, (long)CONNECT_SECONDS);
    curl_easy_setopt(c, CURLOPT_LOW_SPEED_LIMIT, 1L);
    curl_easy_setopt(c, CURLOPT_LOW_SPEED_TIME, (long)STALL_SECONDS);
    curl_easy_setopt(c, CURLOPT_WRITEFUNCTION, on_body);
    curl_easy_setopt(c, CURLOPT_WRITEDATA, s);
    if (*http->ca_file) curl_easy_setopt(c, CURLOPT_CAINFO, http->ca_file);
    if (*http->token) {
        curl_easy_setopt(c, CURLOPT_HTTPAUTH, CURLAUTH_BEARER);
        curl_easy_setopt(c, CURLOPT_XOAUTH2_BEARER, http->token);
    }
    if (!strcmp(method, "HEAD"))
        curl_easy_setopt(c, CURLOPT_NOBODY, 1L);
    else if (strcmp(method, "GET") != 0)
        curl_easy_setopt(c, CURLOPT_CUSTOMREQUEST, method);
}

/* A daemon that refuses an upload early may close before it has read everything: an answer that came is what
 * counts. */
static bool perform_once(cli_http *http, cli_reply *reply) {
    CURLcode code = curl_easy_perform(http->curl);
    curl_easy_getinfo(http->curl, CURLINFO_RESPONSE_CODE, &reply->status);
    http->code = code;
    if (reply->status) http->answers = true;
    if (code == CURLE_OK || (code == CURLE_SEND_ERROR && reply->status >= 400)) return true;
    snprintf(http->text, sizeof http->text, "%s", http->error[0] ? http->error : curl_easy_strerror(code));
    long status = reply->status;
    cli_reply_clear(reply);
    reply->status = status;
    return false;
}

/* Has the daemon only been asked too often? Then it has done nothing, and says when it may be asked again. An answer to HEAD has no problem in it;
 * there is no other reason for a 429 of that. */
static bool asked_too_often(const cli_http *http, const cli_reply *reply, double *seconds) {
    const char *after = reply->status == 429 ? cli_http_answered(http, "Retry-After") : NULL;
    if (!after || strspn(after, "0123456789") != strlen(after)) return false;
    json_t *problem = reply->body ? json_loads(reply->body, 0, NULL) : NULL;
    const char *type = json_string_value(json_object_get(problem, "type"));
    bool so = !reply->body || (type && strcmp(type, "/problems/too-many-requests") == 0);
    json_decref(problem);
    *seconds = strtod(after, NULL);
    return so && *seconds <= RATE_SECONDS_MOST;
}

/* The same request again. */
static void renew_as_it_is(cli_http *http) {
    CURL *next = curl_easy_duphandle(http->curl);
    renew(http);
    if (!next) return;
    curl_easy_cleanup(http->curl);
    http->curl = next;
}

/* `sent`: the file whose bytes from `from` on are the body; NULL: another, or none. */
static bool perform(cli_http *http, FILE *sent, int64_t from, cli_reply *reply) {
    double pause;
    for (int tries = 0;; tries++) {
        if (sent && fseeko(sent, (off_t)from, SEEK_SET) != 0) { /* it could be rewound when it was hashed */
            cli_error("a file cannot be read from byte %lld on", (long long)from);
            exit(CLI_INTERNAL);
        }
        if (!perform_once(http, reply)) return false;
        if (tries == RATE_TRIES || !asked_too_often(http, reply, &pause)) return true;
        cli_reply_clear(reply);
        cli_pause(pause);
        renew_as_it_is(http);
    }
}

void cli_http_header(cli_http *http, const char *name, const char *value) {
    char line[512];
    snprintf(line, sizeof line, "%s: %s", name, value);
    struct curl_slist *headers = curl_slist_append(http->headers, line);
    if (headers) http->headers = headers;
}

static bool send_headers(cli_http *http, FILE *sent, int64_t from, cli_reply *reply) {
    curl_easy_setopt(http->curl, CURLOPT_HTTPHEADER, http->headers);
    bool good = perform(http, sent, from, reply);
    curl_slist_free_all(http->headers);
    http->headers = NULL;
    return good;
}

bool cli_http_call(cli_http *http, const char *method, const char *path, const char *json, cli_reply *reply) {
    sink s = {.http = http, .reply = reply};
    memset(reply, 0, sizeof *reply);
    prepare(http, method, path, &s);
    if (json) cli_http_header(http, "Content-Type", "application/json");
    if (json || !strcmp(method, "POST")) curl_easy_setopt(http->curl, CURLOPT_POSTFIELDS, json ? json : "");
    return send_headers(http, NULL, 0, reply);
}

bool cli_http_stream(cli_http *http, const char *path, bool (*take)(void *user, const char *bytes, size_t size), void *user,
                     cli_reply *reply) {
    sink s = {.http = http, .reply = reply, .take = take, .user = user};
    memset(reply, 0, sizeof *reply);
    prepare(http, "GET", path, &s);
    return send_headers(http, NULL, 0, reply);
}

bool cli_http_upload(cli_http *http, const char *method, const char *path, FILE *file, int64_t from, int64_t size,
                     cli_progress *progress, cli_reply *reply) {
    sink s = {.http = http, .reply = reply};
    outgoing o = {progress, from, size};
    memset(reply, 0, sizeof *reply);
    prepare(http, method, path, &s);
    curl_easy_setopt(http->curl, CURLOPT_UPLOAD, 1L);
    curl_easy_setopt(http->curl, CURLOPT_READDATA, file);
    curl_easy_setopt(http->curl, CURLOPT_INFILESIZE_LARGE, (curl_off_t)(size - from));
    if (progress) {
        curl_easy_setopt(http->curl, CURLOPT_NOPROGRESS, 0L);
        curl_easy_setopt(http->curl, CURLOPT_XFERINFOFUNCTION, on_transfer);
        curl_easy_setopt(http->curl, CURLOPT_XFERINFODATA, &o);
    }
    bool good = send_headers(http, file, from, reply);
    curl_easy_setopt(http->curl, CURLOPT_XFERINFOFUNCTION, NULL);
    return good;
}

const char *cli_http_answered(const cli_http *http, const char *name) {
    struct curl_header *header;
    return curl_easy_header(http->curl, name, 0, CURLH_HEADER, -1, &header) == CURLHE_OK ? header->value : NULL;
}

bool cli_http_download(cli_http *http, const char *path, FILE *file, int64_t limit, cli_reply *reply) {
    sink s = {.http = http, .reply = reply, .file = file, .room = limit};
    memset(reply, 0, sizeof *reply);
    prepare(http, "GET", path, &s);
    return perform(http, NULL, 0, reply);
}

int cli_http_failed(const cli_http *http) {
    cli_error("%s does not answer: %s; is blockwrightd running there?", http->server, http->text);
    return CLI_INTERNAL;
}

int cli_http_refused(const cli_http *http, const cli_reply *reply) {
    json_t *problem = reply->body ? json_loads(reply->body, 0, NULL) : NULL;
    int code = CLI_INTERNAL;
    if (json_is_string(json_object_get(problem, "type")))
        code = cli_failure_problem(NULL, problem, reply->status);
    else
        cli_error("%s answered with HTTP status %ld, not as a Blockwright daemon does", http->server,
                  reply->status);
    json_decref(problem);
    return code;
}

json_t *cli_http_parsed(const cli_http *http, cli_reply *reply, int *exit_code) {
    json_t *answer = NULL;
    if (reply->status / 100 == 2) answer = reply->body ? json_loads(reply->body, 0, NULL) : NULL;
    if (!answer) *exit_code = cli_http_refused(http, reply);
    cli_reply_clear(reply);
    return answer;
}

json_t *cli_http_json(cli_http *http, const char *method, const char *path, const char *json,
                      int *exit_code) {
    cli_reply reply;
    if (cli_http_call(http, method, path, json, &reply)) return cli_http_parsed(http, &reply, exit_code);
    *exit_code = cli_http_failed(http);
    return NULL;
}

bool cli_job_id_valid(const char *id) {
    static const char allowed[] = "0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ-_";
    size_t n = strlen(id);
    return n > 0 && n <= 64 && strspn(id, allowed) == n;
}
