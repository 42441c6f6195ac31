#include "server/http/request.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "server/clock.h"
#include "server/http/access.h"
#include "server/http/account.h"
#include "server/http/reply.h"
#include "server/http/routes.h"
#include "server/metrics.h"

enum { DRAIN_MOST = 16 << 20, ROOM_CHECK = 16 << 20 };

const char *bw_request_header(const bw_request *r, const char *name) {
    return MHD_lookup_connection_value(r->connection, MHD_HEADER_KIND, name);
}

struct bw_header_list {
    struct bw_header_list *next;
    char text[];
};

typedef struct {
    const char *name, *only; /* only: the last line's */
    char *to;                /* NULL: they are counted */
    size_t lines, size;      /* size: with a byte behind each */
} gathering;

static enum MHD_Result gather(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    gathering *g = user;
    (void)kind;
    if (strcasecmp(key, g->name) != 0 || !value) return MHD_YES;
    size_t n = strlen(value);
    if (g->to) memcpy(g->to + g->size, value, n), g->to[g->size + n] = ',';
    g->only = value;
    g->size += n + 1;
    g->lines++;
    return MHD_YES;
}

const char *bw_request_list(bw_request *r, const char *name) {
    gathering g = {.name = name};
    MHD_get_connection_values(r->connection, MHD_HEADER_KIND, gather, &g);
    if (g.lines < 2) return g.only;
    struct bw_header_list *list = malloc(sizeof *list + g.size);
    if (!list) {
        bw_reply_json(r, 500, NULL);
        return NULL;
    }
    list->next = r->lists;
    r->lists = list;
    g = (gathering){.name = name, .to = list->text};
    MHD_get_connection_values(r->connection, MHD_HEADER_KIND, gather, &g);
    list->text[g.size - 1] = '\0';
    return list->text;
}

static void free_lists(struct bw_header_list *list) {
    for (struct bw_header_list *next; list; list = next) {
        next = list->next;
        free(list);
    }
}

const char *bw_request_query(const bw_request *r, const char *name) {
    return MHD_lookup_connection_value(r->connection, MHD_GET_ARGUMENT_KIND, name);
}

bool bw_request_number(bw_request *r, const char *name, int64_t low, int64_t high, int64_t otherwise, int64_t *value) {
    const char *text = bw_request_query(r, name);
    char *end;
    *value = otherwise;
    if (!text) return true;
    errno = 0;
    *value = strtoll(text, &end, 10);
    if (!errno && *text >= '0' && *text <= '9' && !*end && *value >= low && *value <= high) return true;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "%s has a bad value '%.40s'", name, text);
    return false;
}

int bw_request_wait_preferred(bw_request *r) {
    const char *at = bw_request_list(r, "Prefer");
    for (; at && *at; at += strcspn(at, ","), at += *at == ',') {
        char *end;
        at += strspn(at, " \t");
        if (strncasecmp(at, "wait", 4) != 0) continue;
        const char *is = at + 4 + strspn(at + 4, " \t");
        if (*is != '=') continue;
        const char *number = is + 1 + strspn(is + 1, " \t");
        unsigned long n = *number >= '0' && *number <= '9' ? strtoul(number, &end, 10) : 0;
        if (n && (*(end += strspn(end, " \t")) == ',' || *end == ';' || !*end))
            return n > BW_WAIT_MOST ? BW_WAIT_MOST : (int)n; /* the first one counts (RFC 7240, 2) */
    }
    return 0;
}

/* ---- before the body ---- */

typedef struct {
    int lengths, encodings, codings, hosts;
    bool strange;
} framing;

/* A name is a token (RFC 9110, 5.6.2). Others read "Content-Length : 5", and what not, in their own ways. */
static bool is_token(const char *name) {
    static const char good[] = "!#$%&'*+-.^_`|~0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ";
    size_t n = strspn(name, good);
    return n && !name[n];
}

/* libmicrohttpd 0.9.75 appends the text of a folded line (RFC 9112, 5.2) to the header's name: "Content-Length:", CR LF, " 13" becomes an empty
 * Content-Length13, and "Content: 13", CR LF, " -Length" a Content-Length. A name that was moved for that has its value no longer behind it,
 * which is where it stands as it was received: a NUL in the colon's place, blanks, the value. */
static bool is_folded(const char *name, const char *value) {
    const char *behind = name + strlen(name) + 1;
    return value && (uintptr_t)value - (uintptr_t)behind != strspn(behind, " \t");
}

/* A bare CR ends a line for some readers (RFC 9112, 2.2). */
static bool has_controls(const char *value) {
    for (; value && *value; value++)
        if (((unsigned char)*value < 0x20 && *value != '\t') || *value == 0x7f) return true;
    return false;
}

static enum MHD_Result count_framing(void *user, enum MHD_ValueKind kind, const char *key, const char *value) {
    framing *f = user;
    bool encoding = strcasecmp(key, "Transfer-Encoding") == 0;
    (void)kind;
    f->lengths += strcasecmp(key, "Content-Length") == 0;
    f->encodings += encoding;
    f->codings += strcasecmp(key, "Content-Encoding") == 0;
    f->hosts += strcasecmp(key, "Host") == 0;
    f->strange |= !is_token(key) || is_folded(key, value) || has_controls(value) || (encoding && (!value || strcasecmp(value, "chunked") != 0));
    return MHD_YES;
}

static void read_length(bw_request *r, const char *length) {
    char *end;
    errno = 0;
    r->length = strtoull(length, &end, 10);
    r->has_length = true;
    if (!errno && *length >= '0' && *length <= '9' && !*end) return;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Content-Length is not a number");
    r->unclear = true;
}

static void check_coding(bw_request *r, int codings) {
    bw_coding coding;
    if (codings > 1 || !bw_coding_find(bw_request_header(r, "Content-Encoding"), &coding)) {
        bw_reply_problem(r, BW_PROBLEM_UNSUPPORTED_CODING, "a body may be coded as gzip or as zstd, once");
        bw_reply_header(r, "Accept-Encoding", "gzip, zstd");
    } else if (coding && !(r->unpacker = bw_unpacker_new(coding))) {
        bw_reply_json(r, 500, NULL);
    }
}

static bool check_hosts(bw_request *r, int hosts, bool old) {
    if (hosts == 1 || (hosts == 0 && old)) return true;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "a request says with Host whom it is for, once");
    return false;
}

/* Where two readers could see two different bodies, nobody reads any (RFC 9112, 6.1 and 11.2). */
static void check_framing(bw_request *r, bool old) {
    framing f = {0, 0, 0, 0, false};
    MHD_get_connection_values(r->connection, MHD_HEADER_KIND, count_framing, &f);
    const char *length = bw_request_header(r, "Content-Length");
    if (length) read_length(r, length);
    if (f.lengths + f.encodings > 1 || f.strange || (old && f.encodings)) {
        bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "it is not certain where the request's body ends");
        bw_reply_header(r, "Connection", "close");
        r->length = 0; /* the answer goes at once, and no byte of the body is looked at */
        r->unclear = true;
    } else if (check_hosts(r, f.hosts, old) && f.codings) {
        check_coding(r, f.codings);
    }
}

/* What changes something would have to compare tags with those of an answer that it has not made: it is done only if any tag will do
 * (RFC 9110, 13.1.1). If-None-Match is for reading. */
static bool check_match(bw_request *r) {
    const char *match = r->reads ? NULL : bw_request_list(r, "If-Match");
    if (r->reply) return false;
    if (!match || strcmp(match, "*") == 0) return true;
    bw_reply_problem(r, BW_PROBLEM_PRECONDITION_FAILED, "If-Match can be asked of GET and HEAD only; nothing was done");
    return false;
}

static void refuse_at_end(bw_request *r) {
    bw_reply_problem(r, BW_PROBLEM_NOT_READY, "the daemon is stopping");
    bw_reply_header(r, "Connection", "close");
}

static void begin(bw_request *r, const char *method, const char *version, const char *path) {
    r->head = strcmp(method, "HEAD") == 0;
    r->reads = r->head || strcmp(method, "GET") == 0;
    check_framing(r, strcmp(version, "HTTP/1.0") == 0);
    if (!r->reply && atomic_load(&r->traffic->ending)) refuse_at_end(r);
    if (r->reply || !bw_route_find(r, method, path) || !bw_http_check_access(r) || !check_match(r)) return;
    if (bw_routes[r->op].begin) bw_routes[r->op].begin(r);
    else if (r->has_length && r->length > BW_BODY_MOST)
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %d bytes", BW_BODY_MOST);
}

/* ---- the body ---- */

/* Gets the content of the body, piece by piece. False: no more of it; out of memory without a reply. */
static bool collect(bw_request *r, const char *data, size_t size) {
    if (r->body_size + size > r->body_most) {
        bw_reply_problem(r, BW_PROBLEM_BODY_TOO_LARGE, "a body here has at most %zu bytes", r->body_most);
        return false;
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

bool bw_request_room_left(const bw_request *r, uint64_t written, size_t size) {
    bool check = (written - size) / ROOM_CHECK != written / ROOM_CHECK;
    return !check || bw_store_room(r->services->store) >= BW_ROOM_KEPT;
}

static bool deliver(void *user, const char *data, size_t size) {
    bw_request *r = user;
    return r->take ? r->take(r, data, size) : collect(r, data, size);
}

/* Takes a piece of the body. False: hang up. */
static bool take_body(bw_request *r, const char *data, size_t size) {
    int64_t ms = bw_mono_ms() - r->started;
    r->received += size;
    if (ms > r->services->config->body_timeout_ms && (int64_t)r->received < ms / 1000 * BW_RATE_LEAST) return false;
    if (r->reply) return r->received <= DRAIN_MOST || r->has_length;
    if (!r->unpacker) return deliver(r, data, size) || r->reply;
    bw_status status = bw_unpack(r->unpacker, data, size, deliver, r);
    if (status == BW_E_SYNTAX) bw_reply_problem(r, BW_PROBLEM_BAD_CODING, "the body is not what its Content-Encoding says");
    return status == BW_OK || r->reply;
}

/* The whole body has come. */
static void handle(bw_request *r) {
    if (r->unpacker && r->received && !bw_unpacker_complete(r->unpacker))
        bw_reply_problem(r, BW_PROBLEM_BAD_CODING, "the coded body ends too early");
    else bw_routes[r->op].handle(r);
}

/* ---- the course ---- */

static bw_request *new_request(bw_traffic *traffic, struct MHD_Connection *connection) {
    bw_request *r = calloc(1, sizeof *r);
    if (!r) return NULL;
    r->traffic = traffic;
    r->services = traffic->services;
    r->connection = connection;
    r->guarded = bw_guard_find(connection);
    bw_guard_work(r->guarded);
    r->op = BW_OP_COUNT; /* until it is found */
    r->started = bw_mono_ms();
    r->started_us = bw_mono_us();
    bw_gauge_add(BW_METRIC_REQUESTS_ACTIVE, 0, 1);
    r->body_most = BW_BODY_MOST;
    pthread_mutex_lock(&traffic->lock);
    traffic->active++;
    pthread_mutex_unlock(&traffic->lock);
    return r;
}

/* May the operation's function run? Not when the library is being stopped, for then nothing may be suspended. */
static bool enter(bw_request *r) {
    pthread_mutex_lock(&r->traffic->lock);
    bool open = !r->traffic->closed;
    r->traffic->suspended += open;
    pthread_mutex_unlock(&r->traffic->lock);
    if (!open) refuse_at_end(r);
    return open;
}

static void leave(bw_traffic *traffic) {
    pthread_mutex_lock(&traffic->lock);
    if (--traffic->suspended == 0) pthread_cond_signal(&traffic->changed);
    pthread_mutex_unlock(&traffic->lock);
}

enum MHD_Result bw_request_on_call(void *user, struct MHD_Connection *connection, const char *url, const char *method,
                                   const char *version, const char *data, size_t *size, void **state) {
    bw_request *r = *state;
    if (!r) {
        if (!(r = *state = new_request(user, connection))) return MHD_NO;
        begin(r, method, version, url);
        bool chunked = bw_request_header(r, "Transfer-Encoding") != NULL;
        bool waits = bw_request_header(r, "Expect") != NULL, whole = !chunked && r->length == 0;
        if (r->reply && (waits || whole || r->unclear || r->length > DRAIN_MOST)) return bw_reply_send(r);
        if (!whole) bw_guard_body(r->guarded, chunked ? BW_BODY_MOST : r->length);
        return MHD_YES;
    }
    if (*size) {
        if (!r->has_length) bw_guard_body(r->guarded, BW_BODY_MOST); /* of unknown length: anew with each piece; take_body asks for a least rate */
        bool good = take_body(r, data, *size);
        *size = 0;
        return good ? MHD_YES : MHD_NO;
    }
    r->held = false;
    bw_guard_work(r->guarded);
    if (!r->reply && enter(r)) {
        (r->resume ? r->resume : handle)(r);
        leave(user);
    }
    return r->held ? MHD_YES : bw_reply_send(r);
}

void bw_request_on_end(void *user, struct MHD_Connection *connection, void **state, enum MHD_RequestTerminationCode code) {
    bw_traffic *traffic = user;
    bw_request *r = *state;
    (void)connection;
    if (!r) return;
    bw_guard_next(r->guarded);
    bw_request_account(r, code != MHD_REQUEST_TERMINATED_COMPLETED_OK);
    bw_upload_abort(r->upload);
    bw_unpacker_free(r->unpacker);
    if (r->reply) MHD_destroy_response(r->reply);
    if (r->state_free) r->state_free(r->state);
    free_lists(r->lists);
    free(r->body);
    free(r);
    *state = NULL;
    pthread_mutex_lock(&traffic->lock);
    if (--traffic->active == 0) pthread_cond_signal(&traffic->changed);
    pthread_mutex_unlock(&traffic->lock);
}

/* ---- waiting ---- */

void bw_request_suspend(bw_request *r) {
    pthread_mutex_lock(&r->traffic->lock);
    r->traffic->suspended++;
    pthread_mutex_unlock(&r->traffic->lock);
    r->held = true;
    MHD_suspend_connection(r->connection);
}

void bw_request_resume(bw_request *r) {
    bw_traffic *traffic = r->traffic; /* the request may be gone before the count is down */
    MHD_resume_connection(r->connection);
    leave(traffic);
}

static bw_status run_write(bw_writer *w, void *user) {
    bw_request *r = user;
    return r->write(w, r->state);
}

static void write_done(void *user, bw_status status) {
    bw_request *r = user;
    r->written = status;
    bw_request_resume(r);
}

void bw_request_write(bw_request *r, bw_write_fn fn, void (*then)(bw_request *)) {
    r->write = fn;
    r->resume = then;
    bw_request_suspend(r);
    bw_status status = bw_queue_post(r->services->queue, run_write, r, write_done);
    if (status != BW_OK) write_done(r, status);
}

static void run_offloaded(void *user) {
    bw_request *r = user;
    r->offloaded(r);
    bw_request_resume(r);
}

void bw_request_offload(bw_request *r, void (*work)(bw_request *), void (*then)(bw_request *)) {
    r->offloaded = work;
    r->resume = then;
    bw_request_suspend(r);
    bw_pool_post(r->traffic->pool, &r->work, run_offloaded, r);
}
