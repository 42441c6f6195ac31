#include "server/http.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/failure.h"
#include "server/log.h"
#include "server/routes.h"

enum { THREADS = 4, CONNECTIONS = 512, CONNECTION_MEMORY = 128 << 10, IDLE_SECONDS = 30 };
enum { DRAIN_MOST = 16 << 20, RATE_FREE_MS = 30000, RATE_LEAST = 4096 /* bytes per second */ };

struct bw_http {
    struct MHD_Daemon *daemon;
    bw_services services;
};

/* ---- replies ---- */

static void reply(bw_request *r, unsigned status, struct MHD_Response *response, const char *media_type) {
    if (r->reply || !response) {
        if (response) MHD_destroy_response(response);
        return;
    }
    MHD_add_response_header(response, "Content-Type", media_type);
    MHD_add_response_header(response, "X-Content-Type-Options", "nosniff");
    r->reply = response;
    r->reply_status = status;
}

static void reply_document(bw_request *r, unsigned status, json_t *body, const char *media_type) {
    static char lost[] = "{\"type\":\"/problems/internal\",\"title\":\"internal error\",\"status\":500}\n";
    char *text = body ? json_dumps(body, JSON_INDENT(1)) : NULL;
    json_decref(body);
    if (!text) {
        reply(r, 500, MHD_create_response_from_buffer(sizeof lost - 1, lost, MHD_RESPMEM_PERSISTENT),
              "application/problem+json");
        return;
    }
    reply(r, status, MHD_create_response_from_buffer(strlen(text), text, MHD_RESPMEM_MUST_FREE), media_type);
}

void bw_reply_json(bw_request *r, unsigned status, json_t *body) { reply_document(r, status, body, "application/json"); }

void bw_reply_problem_json(bw_request *r, bw_problem problem, json_t *document) {
    reply_document(r, (unsigned)bw_problem_types[problem].http, document, "application/problem+json");
}

void bw_reply_problem(bw_request *r, bw_problem problem, const char *format, ...) {
    char detail[400];
    va_list args;
    va_start(args, format);
    vsnprintf(detail, sizeof detail, format, args);
    va_end(args);
    bw_reply_problem_json(r, problem, bw_problem_document(problem, detail));
}

void bw_reply_text(bw_request *r, const char *media_type, const char *text, size_t size) {
    reply(r, 200, MHD_create_response_from_buffer(size, (void *)text, MHD_RESPMEM_PERSISTENT), media_type);
}

void bw_reply_file(bw_request *r, int fd, uint64_t bytes, const char *media_type, const char *etag) {
    char quoted[BW_PARAMETER_MOST];
    const char *known = etag ? bw_request_header(r, "If-None-Match") : NULL;
    snprintf(quoted, sizeof quoted, "\"%s\"", etag ? etag : "");
    if (known && (strcmp(known, "*") == 0 || strstr(known, quoted))) {
        close(fd);
        reply(r, 304, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT), media_type);
    } else {
        struct MHD_Response *response = MHD_create_response_from_fd64(bytes, fd);
        if (!response) close(fd);
        reply(r, 200, response, media_type);
    }
    if (etag) bw_reply_header(r, "ETag", quoted);
}

void bw_reply_header(bw_request *r, const char *name, const char *value) {
    if (r->reply) MHD_add_response_header(r->reply, name, value);
}

const char *bw_request_header(const bw_request *r, const char *name) {
    return MHD_lookup_connection_value(r->connection, MHD_HEADER_KIND, name);
}

const char *bw_request_query(const bw_request *r, const char *name) {
    return MHD_lookup_connection_value(r->connection, MHD_GET_ARGUMENT_KIND, name);
}

static enum MHD_Result send_reply(bw_request *r) {
    if (!r->reply) bw_reply_problem(r, BW_PROBLEM_INTERNAL, "the request was not answered");
    return r->reply ? MHD_queue_response(r->connection, r->reply_status, r->reply) : MHD_NO;
}

/* ---- routing ---- */

/* Does `path` fit `pattern`, whose {segments} stand for any non-empty segment? Fills the parameters. */
static bool match(const char *pattern, const char *path, char parameters[2][BW_PARAMETER_MOST]) {
    int n = 0;
    while (*pattern) {
        if (*pattern == '{') {
            size_t size = strcspn(path, "/");
            if (size == 0 || size >= BW_PARAMETER_MOST || n == 2) return false;
            memcpy(parameters[n], path, size);
            parameters[n++][size] = '\0';
            path += size;
            pattern += strcspn(pattern, "}") + 1;
        } else if (*pattern++ != *path++) {
            return false;
        }
    }
    return *path == '\0';
}

static bool method_fits(const char *wanted, const char *method) {
    return strcmp(wanted, method) == 0 || (strcmp(method, "HEAD") == 0 && strcmp(wanted, "GET") == 0);
}

/* Finds the operation, or replies 404 or 405. */
static bool route(bw_request *r, const char *method, const char *path) {
    char allow[80] = "";
    for (int i = 0; i < BW_OP_COUNT; i++) {
        const bw_endpoint *e = &bw_endpoints[i];
        if (!match(e->path, path, r->parameters)) continue;
        if (method_fits(e->method, method)) {
            r->op = (bw_op)i;
            return true;
        }
        size_t n = strlen(allow);
        snprintf(allow + n, sizeof allow - n, "%s%s%s", n ? ", " : "", e->method,
                 strcmp(e->method, "GET") == 0 ? ", HEAD" : "");
    }
    if (*allow) {
        bw_reply_problem(r, BW_PROBLEM_METHOD_NOT_ALLOWED, "%.20s is not allowed here; allowed: %s", method, allow);
        bw_reply_header(r, "Allow", allow);
    } else {
        bw_reply_problem(r, BW_PROBLEM_NOT_FOUND, "there is nothing at %.200s; /openapi.json tells what there is", path);
    }
    return false;
}

static enum MHD_Result check_query(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    bw_request *r = user;
    (void)kind, (void)value;
    for (const char *const *name = bw_endpoints[r->op].query; *name; name++)
        if (strcmp(*name, key) == 0) return MHD_YES;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "there is no parameter '%.60s' here", key);
    return MHD_NO;
}

/* ---- requests ---- */

typedef struct {
    int lengths, encodings;
} framing;

static enum MHD_Result count_framing(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    framing *f = user;
    (void)kind, (void)value;
    f->lengths += strcasecmp(key, "Content-Length") == 0;
    f->encodings += strcasecmp(key, "Transfer-Encoding") == 0;
    return MHD_YES;
}

/* Where two readers could see two different bodies, nobody reads any. */
static void check_framing(bw_request *r) {
    framing f = {0, 0};
    MHD_get_connection_values(r->connection, MHD_HEADER_KIND, count_framing, &f);
    if (f.lengths + f.encodings > 1) {
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "the request says more than once where its body ends");
        bw_reply_header(r, "Connection", "close");
        return;
    }
    const char *length = bw_request_header(r, "Content-Length");
    if (!length) return;
    char *end;
    errno = 0;
    r->length = strtoull(length, &end, 10);
    r->has_length = true;
    if (errno || *length < '0' || *length > '9' || *end)
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Content-Length is not a number");
}

static void begin(bw_request *r, const char *method, const char *version, const char *path) {
    check_framing(r);
    if (!bw_request_header(r, "Host") && strcmp(version, "HTTP/1.0") != 0)
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "a request says with Host whom it is for");
    if (r->reply || !route(r, method, path)) return;
    MHD_get_connection_values(r->connection, MHD_GET_ARGUMENT_KIND, check_query, r);
    if (r->reply) return;
    if (bw_routes[r->op].begin) bw_routes[r->op].begin(r);
    else if (r->has_length && r->length > BW_BODY_MOST)
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %d bytes", BW_BODY_MOST);
}

static bool collect(bw_request *r, const char *data, size_t size) {
    if (r->body_size + size > BW_BODY_MOST) {
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %d bytes", BW_BODY_MOST);
        return true;
    }
    if (r->body_size + size + 1 > r->body_room) {
        size_t room = r->body_size + size + 1 < 4096 ? 4096 : 2 * (r->body_size + size + 1);
        char *more = realloc(r->body, room);
        if (!more) return false;
        r->body = more;
        r->body_room = room;
    }
    memcpy(r->body + r->body_size, data, size);
    r->body_size += size;
    r->body[r->body_size] = '\0';
    return true;
}

/* Takes a piece of the body. False: hang up. */
static bool take_body(bw_request *r, const char *data, size_t size) {
    int64_t ms = bw_mono_ms() - r->started;
    r->received += size;
    if (ms > RATE_FREE_MS && (int64_t)r->received < ms / 1000 * RATE_LEAST) return false;
    if (r->reply) return r->received <= DRAIN_MOST || r->has_length;
    if (!r->upload) return collect(r, data, size);
    bw_status status = bw_upload_write(r->upload, data, size);
    if (status == BW_OK) return true;
    bw_reply_problem(r, errno == ENOSPC ? BW_PROBLEM_STORAGE_FULL : BW_PROBLEM_IO, "the upload could not be written");
    return true;
}

static enum MHD_Result on_request(void *user, struct MHD_Connection *connection, const char *url, const char *method,
                                  const char *version, const char *data, size_t *size, void **state) {
    bw_http *http = user;
    bw_request *r = *state;
    if (!r) {
        if (!(r = *state = calloc(1, sizeof *r))) return MHD_NO;
        r->services = &http->services;
        r->connection = connection;
        r->started = bw_mono_ms();
        begin(r, method, version, url);
        bool waits = bw_request_header(r, "Expect") != NULL;
        bool whole = !bw_request_header(r, "Transfer-Encoding") && r->length == 0;
        return r->reply && (waits || whole || r->length > DRAIN_MOST) ? send_reply(r) : MHD_YES;
    }
    if (*size) {
        bool good = take_body(r, data, *size);
        *size = 0;
        return good ? MHD_YES : MHD_NO;
    }
    if (!r->reply) bw_routes[r->op].handle(r);
    return send_reply(r);
}

static void on_completed(void *user, struct MHD_Connection *connection, void **state,
                         enum MHD_RequestTerminationCode code) {
    bw_request *r = *state;
    (void)user, (void)connection, (void)code;
    if (!r) return;
    bw_upload_abort(r->upload);
    if (r->reply) MHD_destroy_response(r->reply);
    free(r->body);
    free(r);
    *state = NULL;
}

static void on_library_log(void *user, const char *format, va_list args) {
    char text[300], quoted[400];
    (void)user;
    vsnprintf(text, sizeof text, format, args);
    bw_event(BW_WARN, "http.library", "message=%s", bw_quoted(text, quoted, sizeof quoted));
}

/* ---- start and stop ---- */

static void name_address(const bw_config *config, unsigned port, char *address, size_t size) {
    char host[INET6_ADDRSTRLEN];
    bool six = config->listen.ss_family == AF_INET6;
    const void *raw = six ? (const void *)&((const struct sockaddr_in6 *)&config->listen)->sin6_addr
                          : (const void *)&((const struct sockaddr_in *)&config->listen)->sin_addr;
    inet_ntop(config->listen.ss_family, raw, host, sizeof host);
    snprintf(address, size, six ? "[%s]:%u" : "%s:%u", host, port);
}

bw_status bw_http_start(const bw_services *services, bw_http **out, char *address, size_t size) {
    for (int i = 0; i < BW_OP_COUNT; i++)
        if (!bw_routes[i].handle) return BW_E_INTERNAL; /* an operation of the document that nobody has written */
    bw_http *http = calloc(1, sizeof *http);
    if (!http) return BW_E_MEMORY;
    http->services = *services;
    unsigned flags = MHD_USE_EPOLL_INTERNAL_THREAD | MHD_USE_ERROR_LOG;
    if (services->config->listen.ss_family == AF_INET6) flags |= MHD_USE_IPv6;
    http->daemon = MHD_start_daemon(
        flags, 0, NULL, NULL, on_request, http, MHD_OPTION_EXTERNAL_LOGGER, on_library_log, NULL,
        MHD_OPTION_SOCK_ADDR, &services->config->listen, MHD_OPTION_THREAD_POOL_SIZE, (unsigned)THREADS,
        MHD_OPTION_CONNECTION_LIMIT, (unsigned)CONNECTIONS, MHD_OPTION_CONNECTION_MEMORY_LIMIT,
        (size_t)CONNECTION_MEMORY, MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)IDLE_SECONDS, MHD_OPTION_NOTIFY_COMPLETED,
        on_completed, NULL, MHD_OPTION_END);
    const union MHD_DaemonInfo *info = http->daemon ? MHD_get_daemon_info(http->daemon, MHD_DAEMON_INFO_BIND_PORT) : NULL;
    if (!info) {
        bw_http_stop(http);
        return BW_E_IO;
    }
    name_address(services->config, info->port, address, size);
    *out = http;
    return BW_OK;
}

void bw_http_stop(bw_http *http) {
    if (!http) return;
    if (http->daemon) MHD_stop_daemon(http->daemon);
    free(http);
}
