/* Load for a daemon on this machine, cheap enough to share two cores with it: one thread, epoll, connections that are kept.
 *
 *     torture_load MODE ADDRESS:PORT [NAME=VALUE ...]
 *
 *     accept   POST /v1/jobs for the blob `input`                       connections seconds rate input
 *     status   GET /v1/jobs/{id}, ids drawn from a file                 connections seconds rate ids seed
 *     upload   PUT of `bytes` bytes over one connection, hashed before the clock starts                bytes seed
 *     events   that many event streams of jobs of the file, idle        connections seconds ids
 *     loris    that many requests that never end, a byte a second; GET /readyz on a new connection every 50 ms   connections seconds
 *
 * With rate=R requests are due R times a second and a latency counts from when the request was due, whether or not a
 * connection was free (no coordinated omission); with rate=0 every connection asks again as soon as it has its answer. Prints
 * one line of JSON. Loopback only, like the daemon. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/epoll.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "server/digest.h"

enum { HEAD_MOST = 8192, REQUEST_MOST = 1024, STATUSES = 600, ID_TEXT = 25, BLOCK = 1 << 20, PROBE_MS = 50, DRIP_MS = 1000 };

typedef enum { IDLE, CONNECTING, SENDING, RECEIVING, STREAMING, DRIPPING } phase;

typedef struct {
    int fd; /* -1: none */
    phase now;
    bool probe, close_after;
    char request[REQUEST_MOST], head[HEAD_MOST + 1];
    size_t size, sent, head_size;
    int64_t left;     /* of the body; -1: the head is not complete */
    int64_t due_us;   /* when the request should have begun */
    int64_t drip_us;  /* loris: when the next byte is due */
} connection;

static struct sockaddr_in address;
static char mode[16], input[BW_SHA256_TEXT], (*ids)[ID_TEXT];
static long connections = 16, seconds = 5, rate, bytes = 1 << 26;
static size_t id_count;
static uint64_t random_state = 88172645463325252u;
static int epoll;
static connection *all;
static uint32_t *latencies; /* us */
static size_t latency_count, latency_room;
static long by_status[STATUSES], broken, refused, closed, received;

static void stop(const char *what) {
    fprintf(stderr, "torture_load: %s (errno %d)\n", what, errno);
    exit(1);
}

static int64_t now_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

static uint64_t draw(void) {
    random_state ^= random_state << 13, random_state ^= random_state >> 7, random_state ^= random_state << 17;
    return random_state;
}

static void note_latency(int64_t us) {
    if (latency_count == latency_room) {
        latency_room = latency_room ? 2 * latency_room : 65536;
        if (!(latencies = realloc(latencies, latency_room * sizeof *latencies))) stop("out of memory");
    }
    latencies[latency_count++] = us > UINT32_MAX ? UINT32_MAX : (uint32_t)us;
}

/* ---- one connection ---- */

static void watch(connection *c, uint32_t events) {
    struct epoll_event e = {.events = events, .data.ptr = c};
    if (epoll_ctl(epoll, EPOLL_CTL_MOD, c->fd, &e) != 0 && epoll_ctl(epoll, EPOLL_CTL_ADD, c->fd, &e) != 0) stop("epoll");
}

static bool connect_to(connection *c) {
    int one = 1;
    c->fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (c->fd < 0) stop("socket");
    setsockopt(c->fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
    c->now = CONNECTING;
    if (connect(c->fd, (struct sockaddr *)&address, sizeof address) != 0 && errno != EINPROGRESS) {
        close(c->fd);
        c->fd = -1;
        refused++;
        return false;
    }
    return true;
}

static void hang_up(connection *c) {
    if (c->fd >= 0) close(c->fd);
    c->fd = -1;
    c->now = IDLE;
}

static void make_request(connection *c) {
    const char *host = "Host: 127.0.0.1\r\n";
    char body[200];
    int n = 0;
    if (c->probe) {
        n = snprintf(c->request, sizeof c->request, "GET /readyz HTTP/1.1\r\n%sConnection: close\r\n\r\n", host);
    } else if (strcmp(mode, "accept") == 0) {
        int size = snprintf(body, sizeof body, "{\"input\":\"%s\"}", input);
        n = snprintf(c->request, sizeof c->request, "POST /v1/jobs HTTP/1.1\r\n%sContent-Type: application/json\r\nContent-Length: %d\r\n\r\n%s",
                     host, size, body);
    } else if (strcmp(mode, "loris") == 0) {
        n = snprintf(c->request, sizeof c->request, "GET /livez HTTP/1.1\r\n%sX-Long: %0900d", host, 0);
    } else {
        n = snprintf(c->request, sizeof c->request, "GET /v1/jobs/%s%s HTTP/1.1\r\n%s\r\n", ids[draw() % id_count],
                     strcmp(mode, "events") == 0 ? "/events" : "", host);
    }
    c->size = (size_t)n;
    c->sent = c->head_size = 0;
    c->left = -1;
}

static void push(connection *c) {
    size_t most = c->now == DRIPPING ? c->sent + 1 : c->size;
    while (c->sent < most) {
        ssize_t n = send(c->fd, c->request + c->sent, most - c->sent, MSG_NOSIGNAL);
        if (n < 0 && errno == EAGAIN) return watch(c, EPOLLOUT | EPOLLIN);
        if (n < 0) {
            broken += c->now != DRIPPING;
            closed += c->now == DRIPPING;
            return hang_up(c);
        }
        c->sent += (size_t)n;
    }
    if (c->now != DRIPPING) c->now = RECEIVING;
    watch(c, EPOLLIN);
}

/* Begins a request that was due at `due`. */
static void begin(connection *c, int64_t due) {
    make_request(c);
    c->due_us = due;
    if (c->fd < 0) {
        if (connect_to(c)) watch(c, EPOLLOUT);
        return;
    }
    c->now = SENDING;
    push(c);
}

/* The answer's head is complete: its status and how long its body is. */
static void read_head(connection *c, size_t head) {
    int status = atoi(c->head + 9);
    const char *length = strcasestr(c->head, "\r\nContent-Length:");
    by_status[status > 0 && status < STATUSES ? status : 0]++;
    c->close_after = strcasestr(c->head, "\r\nConnection: close") != NULL;
    if (strcmp(mode, "events") == 0 && status == 200) {
        c->now = STREAMING;
        return;
    }
    c->left = (length && length < c->head + head ? atoll(length + 17) : 0) - (int64_t)(c->head_size - head);
}

static void finished(connection *c) {
    note_latency(now_us() - c->due_us);
    c->now = IDLE;
    if (c->close_after) hang_up(c);
}

static void pull(connection *c) {
    static char rest[65536];
    for (;;) {
        bool in_head = c->left < 0 && c->now == RECEIVING;
        ssize_t n = in_head ? recv(c->fd, c->head + c->head_size, HEAD_MOST - c->head_size, 0) : recv(c->fd, rest, sizeof rest, 0);
        if (n < 0 && errno == EAGAIN) return;
        if (n <= 0) {
            closed += c->now == DRIPPING || c->now == STREAMING;
            broken += c->now == RECEIVING || c->now == SENDING;
            return hang_up(c);
        }
        received += n;
        if (in_head) {
            c->head_size += (size_t)n;
            c->head[c->head_size] = '\0';
            char *end = strstr(c->head, "\r\n\r\n");
            if (end) read_head(c, (size_t)(end + 4 - c->head));
            else if (c->head_size == HEAD_MOST) stop("an endless head");
        } else if (c->now == RECEIVING) {
            c->left -= n;
        }
        if (c->now == RECEIVING && c->left == 0) return finished(c);
    }
}

static void on_event(connection *c, uint32_t events) {
    if (c->fd < 0) return;
    if (c->now == CONNECTING && events & (EPOLLERR | EPOLLHUP)) {
        refused++;
        return hang_up(c);
    }
    if (c->now == CONNECTING) {
        bool drips = strcmp(mode, "loris") == 0 && !c->probe;
        c->now = drips ? DRIPPING : SENDING;
        c->drip_us = now_us() + (int64_t)(draw() % (DRIP_MS * 1000));
        c->sent = 0;
        if (drips) return watch(c, EPOLLIN);
        return push(c);
    }
    if (events & EPOLLOUT) push(c);
    if (c->fd >= 0 && events & (EPOLLIN | EPOLLERR | EPOLLHUP)) pull(c);
}

/* ---- the loop ---- */

static connection *idle_one(long *hint) {
    for (long i = 0; i < connections; i++) {
        connection *c = &all[(*hint + i) % connections];
        if (c->now != IDLE) continue;
        *hint = (*hint + i + 1) % connections;
        return c;
    }
    return NULL;
}

/* Starts what is due; returns when to look again at the latest. */
static int64_t start_due(int64_t now, int64_t begun, int64_t *next) {
    static long hint;
    bool loris = strcmp(mode, "loris") == 0;
    if (loris || strcmp(mode, "events") == 0) {
        for (long i = 0; i < connections; i++) {
            connection *c = &all[i];
            if (c->now == IDLE && c->fd < 0 && (loris || now < begun + 2000000)) begin(c, now);
            if (c->now == DRIPPING && now >= c->drip_us && c->sent + 1 < c->size) {
                push(c);
                c->drip_us = now + DRIP_MS * 1000;
            }
        }
        if (loris && now >= *next && all[connections].now == IDLE) {
            begin(&all[connections], now);
            *next = now + PROBE_MS * 1000;
        }
        return now + 10000;
    }
    if (!rate) {
        for (connection *c; (c = idle_one(&hint));) begin(c, now);
        return now + 100000;
    }
    for (connection *c; now >= *next && (c = idle_one(&hint)); *next += 1000000 / rate) begin(c, *next);
    return *next > now ? *next : now + 1000;
}

static double run(void) {
    struct epoll_event events[256];
    int64_t begun = now_us(), end = begun + seconds * 1000000, next = begun, now = begun;
    while ((now = now_us()) < end) {
        int64_t until = start_due(now, begun, &next);
        if (until > end) until = end;
        int64_t wait = until - now_us();
        struct timespec patience = {0, wait > 0 ? (long)(wait % 1000000) * 1000 : 0};
        int n = epoll_pwait2(epoll, events, 256, &patience, NULL);
        for (int i = 0; i < n; i++) on_event(events[i].data.ptr, events[i].events);
    }
    return (double)(now - begun) / 1e6;
}

/* ---- upload ---- */

static double upload(double *hashing) {
    char *block = malloc(BLOCK), hash[BW_SHA256_TEXT], head[300], answer[1024] = "";
    int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    bw_digest *digest = bw_digest_new();
    if (!block || !digest || fd < 0) stop("cannot begin");
    for (size_t i = 0; i + 8 <= BLOCK; i += 8) {
        uint64_t x = draw();
        memcpy(block + i, &x, 8);
    }
    int64_t before = now_us();
    for (long at = 0; at < bytes; at += BLOCK)
        if (!bw_digest_add(digest, block, bytes - at < BLOCK ? (size_t)(bytes - at) : BLOCK)) stop("digest");
    if (!bw_digest_end(digest, hash)) stop("digest");
    bw_digest_free(digest);
    *hashing = (double)(now_us() - before) / 1e6;
    if (connect(fd, (struct sockaddr *)&address, sizeof address) != 0) stop("connect");
    int n = snprintf(head, sizeof head, "PUT /v1/blobs/%s HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: %ld\r\nConnection: close\r\n\r\n", hash, bytes);
    before = now_us();
    if (send(fd, head, (size_t)n, MSG_NOSIGNAL) != n) stop("send");
    for (long at = 0; at < bytes;) {
        size_t in_block = (size_t)(at % BLOCK), most = BLOCK - in_block;
        ssize_t sent = send(fd, block + in_block, bytes - at < (long)most ? (size_t)(bytes - at) : most, MSG_NOSIGNAL);
        if (sent < 0) break; /* the answer tells why */
        at += sent;
    }
    for (size_t got = 0; got < sizeof answer - 1;) {
        ssize_t more = recv(fd, answer + got, sizeof answer - 1 - got, 0);
        if (more <= 0) break;
        got += (size_t)more;
        answer[got] = '\0';
    }
    double took = (double)(now_us() - before) / 1e6;
    int status = strlen(answer) > 12 ? atoi(answer + 9) : 0;
    by_status[status > 0 && status < STATUSES ? status : 0]++;
    close(fd);
    free(block);
    return took;
}

/* ---- the command line, the report ---- */

static void read_ids(const char *path) {
    FILE *f = fopen(path, "r");
    char line[64];
    size_t room = 0;
    while (f && fgets(line, sizeof line, f)) {
        if (id_count == room) ids = realloc(ids, (room = room ? 2 * room : 1024) * sizeof *ids);
        if (!ids) stop("out of memory");
        snprintf(ids[id_count++], ID_TEXT, "%.24s", line);
    }
    if (!f || !id_count) stop("no ids");
    fclose(f);
}

static void read_arguments(int argc, char **argv) {
    const char *colon = argc > 2 ? strrchr(argv[2], ':') : NULL;
    if (!colon) stop("MODE ADDRESS:PORT [NAME=VALUE ...]");
    snprintf(mode, sizeof mode, "%s", argv[1]);
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons((uint16_t)atoi(colon + 1));
    for (int i = 3; i < argc; i++) {
        char *value = strchr(argv[i], '=');
        if (!value) stop(argv[i]);
        *value++ = '\0';
        if (strcmp(argv[i], "connections") == 0) connections = atol(value);
        else if (strcmp(argv[i], "seconds") == 0) seconds = atol(value);
        else if (strcmp(argv[i], "rate") == 0) rate = atol(value);
        else if (strcmp(argv[i], "bytes") == 0) bytes = atol(value);
        else if (strcmp(argv[i], "seed") == 0) random_state ^= strtoull(value, NULL, 10) * 0x9E3779B97F4A7C15u;
        else if (strcmp(argv[i], "input") == 0) snprintf(input, sizeof input, "%s", value);
        else if (strcmp(argv[i], "ids") == 0) read_ids(value);
        else stop(argv[i]);
    }
}

static int by_value(const void *a, const void *b) {
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static double quantile(double q) {
    return latency_count ? latencies[(size_t)(q * (double)(latency_count - 1))] / 1e3 : 0;
}

static void report(double took) {
    long open = 0;
    for (long i = 0; i < connections; i++) open += all[i].now == STREAMING || all[i].now == DRIPPING;
    if (latency_count) qsort(latencies, latency_count, sizeof *latencies, by_value);
    printf("{\"mode\":\"%s\",\"seconds\":%.3f,\"answers\":%zu,\"per_second\":%.1f,\"p50_ms\":%.3f,\"p99_ms\":%.3f,\"max_ms\":%.3f,"
           "\"broken\":%ld,\"refused\":%ld,\"closed\":%ld,\"open\":%ld,\"received\":%ld,\"status\":{", mode, took, latency_count,
           (double)latency_count / took, quantile(0.5), quantile(0.99), quantile(1), broken, refused, closed, open, received);
    bool first = true;
    for (int i = 0; i < STATUSES; i++) {
        if (!by_status[i]) continue;
        printf("%s\"%d\":%ld", first ? "" : ",", i, by_status[i]);
        first = false;
    }
    printf("}}\n");
}

int main(int argc, char **argv) {
    struct rlimit files;
    read_arguments(argc, argv);
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) {
        files.rlim_cur = files.rlim_max;
        setrlimit(RLIMIT_NOFILE, &files);
    }
    if (strcmp(mode, "upload") == 0) {
        double hashing, took = upload(&hashing);
        printf("{\"mode\":\"upload\",\"bytes\":%ld,\"seconds\":%.3f,\"mb_per_second\":%.1f,\"hashing_seconds\":%.3f,\"good\":%s}\n", bytes,
               took, (double)bytes / 1e6 / took, hashing, by_status[201] == 1 ? "true" : "false");
        return by_status[201] != 1;
    }
    epoll = epoll_create1(EPOLL_CLOEXEC);
    all = calloc((size_t)connections + 1, sizeof *all); /* the last one probes */
    if (epoll < 0 || !all) stop("out of memory");
    for (long i = 0; i <= connections; i++) all[i].fd = -1;
    all[connections].probe = true;
    report(run());
    free(all);
    free(latencies);
    free(ids);
    return 0;
}
