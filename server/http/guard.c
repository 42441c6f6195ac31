#include "server/http/guard.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <sys/queue.h>
#include <sys/socket.h>
#include <time.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"

enum { LOOK_MS = 500 };

struct bw_guarded {
    bw_guard *guard;
    int fd;
    _Atomic int64_t deadline; /* monotonic; 0: none */
    atomic_bool sends;        /* a body is to come */
    bool gone;                /* seen at the last look; under lock */
    TAILQ_ENTRY(bw_guarded) link;
};

struct bw_guard {
    const bw_config *config;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    pthread_t thread;
    bool stopping;
    TAILQ_HEAD(, bw_guarded) list;
};

/* Nothing more can come, and nothing that has come is left to be read. */
static bool has_gone(int fd) {
    char byte;
    return recv(fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
}

/* Cuts off who is late or gone; returns how many. */
static int look(bw_guard *g) {
    int64_t now = bw_mono_ms();
    int cut = 0;
    bw_guarded *c;
    TAILQ_FOREACH(c, &g->list, link) {
        int64_t deadline = c->deadline;
        bool late = deadline && now >= deadline, gone = c->sends && has_gone(c->fd), still = gone && c->gone;
        c->gone = gone; /* the body's end may be on its way to the request: twice is sure */
        if (!late && !still) continue;
        shutdown(c->fd, SHUT_RDWR);
        c->deadline = 0;
        c->sends = false;
        cut += late;
    }
    return cut;
}

static void *guard_main(void *user) {
    bw_guard *g = user;
    pthread_mutex_lock(&g->lock);
    while (!g->stopping) {
        if (TAILQ_EMPTY(&g->list)) {
            pthread_cond_wait(&g->changed, &g->lock);
            continue;
        }
        int64_t next = bw_mono_ms() + LOOK_MS;
        struct timespec until = {next / 1000, next % 1000 * 1000000};
        pthread_cond_timedwait(&g->changed, &g->lock, &until);
        int cut = look(g);
        if (cut) bw_event(BW_INFO, "http.slow", "connections=%d", cut);
    }
    pthread_mutex_unlock(&g->lock);
    return NULL;
}

bw_status bw_guard_open(const bw_config *config, bw_guard **out) {
    pthread_condattr_t monotonic;
    bw_guard *g = calloc(1, sizeof *g);
    if (!g) return BW_E_MEMORY;
    g->config = config;
    TAILQ_INIT(&g->list);
    pthread_mutex_init(&g->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&g->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (pthread_create(&g->thread, NULL, guard_main, g) != 0) {
        free(g);
        return BW_E_IO;
    }
    *out = g;
    return BW_OK;
}

void bw_guard_close(bw_guard *g) {
    if (!g) return;
    pthread_mutex_lock(&g->lock);
    g->stopping = true;
    pthread_cond_signal(&g->changed);
    pthread_mutex_unlock(&g->lock);
    pthread_join(g->thread, NULL);
    pthread_cond_destroy(&g->changed);
    pthread_mutex_destroy(&g->lock);
    free(g);
}

/* ---- connections ---- */

static void begin(bw_guard *g, struct MHD_Connection *connection, void **context) {
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD);
    bw_guarded *c = info ? calloc(1, sizeof *c) : NULL;
    if (!c) return;
    c->guard = g;
    c->fd = info->connect_fd;
    c->deadline = bw_mono_ms() + g->config->header_timeout_ms;
    pthread_mutex_lock(&g->lock);
    if (TAILQ_EMPTY(&g->list)) pthread_cond_signal(&g->changed);
    TAILQ_INSERT_TAIL(&g->list, c, link);
    pthread_mutex_unlock(&g->lock);
    *context = c;
}

void bw_guard_on_connection(void *user, struct MHD_Connection *connection, void **context, enum MHD_ConnectionNotificationCode code) {
    bw_guard *g = user;
    bw_guarded *c = *context;
    bw_gauge_add(BW_METRIC_CONNECTIONS, 0, code == MHD_CONNECTION_NOTIFY_STARTED ? 1 : -1);
    if (code == MHD_CONNECTION_NOTIFY_STARTED) {
        begin(g, connection, context);
    } else if (c) {
        pthread_mutex_lock(&g->lock);
        TAILQ_REMOVE(&g->list, c, link);
        pthread_mutex_unlock(&g->lock);
        free(c);
        *context = NULL;
    }
}

bw_guarded *bw_guard_find(struct MHD_Connection *connection) {
    const union MHD_ConnectionInfo *info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
    return info ? info->socket_context : NULL;
}

static int64_t in_ms(const bw_guarded *c, uint64_t bytes) {
    uint64_t seconds = bytes / BW_RATE_LEAST;
    if (seconds > INT32_MAX) seconds = INT32_MAX;
    return bw_mono_ms() + c->guard->config->body_timeout_ms + (int64_t)seconds * 1000;
}

void bw_guard_body(bw_guarded *c, uint64_t bytes) {
    if (!c) return;
    c->deadline = in_ms(c, bytes);
    c->sends = true;
}

void bw_guard_work(bw_guarded *c) {
    if (!c) return;
    c->sends = false;
    c->deadline = 0;
}

void bw_guard_answer(bw_guarded *c, uint64_t bytes) {
    if (!c) return;
    c->sends = false;
    c->deadline = in_ms(c, bytes);
}

bool bw_guard_has_gone(const bw_guarded *c) { return c && has_gone(c->fd); }

void bw_guard_next(bw_guarded *c) {
    if (!c) return;
    c->sends = false;
    c->deadline = bw_mono_ms() + c->guard->config->header_timeout_ms + BW_IDLE_SECONDS * 1000;
}
