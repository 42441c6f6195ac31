#include "server/health.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/queue/retention.h"

enum { PROBE_BYTES = 4096, SAMPLES = 32, WINDOW_MS = 300000, SPAN_MS = 10000, /* 32 spans are more than the window */ DETAIL = 200, PATIENCE_MS = 1000 /* with a probe, at the end */ };

/* The worst of a span of time, so that the ring has the whole window however often the disk is probed. */
typedef struct {
    int64_t at, us; /* of its first probe, monotonic ms; how long the worst took */
} sample;

struct bw_health {
    const bw_config *config; /* borrowed, like the next three: the thread looks at them under lock and while not stopping only */
    bw_store *store;
    bw_queue *queue;
    bw_dispatch *dispatch;
    char path[PATH_MAX];
    pthread_t thread;
    pthread_mutex_t lock; /* all below */
    pthread_cond_t wanted;
    bool stopping;
    bool ended, left; /* the thread has ended; it was left alone, so it frees all of this */
    uint64_t turns;   /* of the dispatcher at the last probe */
    sample samples[SAMPLES]; /* a ring; the last at (count - 1) % SAMPLES */
    size_t count;
    int64_t last;     /* us, of the last probe that worked */
    int64_t since;    /* when the probe under way began, 0: none */
    int error;        /* errno of the last probe, 0: it worked */
    const char *step; /* and at what */
    bool stuck;       /* the dispatcher did not go round its loop since the probe before */
};

/* ---- the probe ---- */

static int probe_disk(const char *path, const char **step) {
    char block[PROBE_BYTES];
    memset(block, 'p', sizeof block);
    *step = "open";
    int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600), error = errno;
    if (fd < 0) return error;
    ssize_t n = write(fd, block, sizeof block);
    error = n == PROBE_BYTES ? 0 : n < 0 ? errno : ENOSPC;
    *step = "write";
    if (!error) {
        *step = "sync";
        if (fdatasync(fd) != 0) error = errno;
    }
    close(fd);
    return error;
}

static void take_sample(bw_health *h, int64_t now, int64_t us) {
    sample *s = &h->samples[(h->count + SAMPLES - 1) % SAMPLES];
    h->last = us;
    if (!h->count || now - s->at >= SPAN_MS) h->samples[h->count++ % SAMPLES] = (sample){now, us};
    else if (us > s->us) s->us = us;
}

/* Under lock, which it gives up while it waits for the disk. */
static void probe(bw_health *h) {
    const char *step;
    uint64_t now = bw_dispatch_turns(h->dispatch);
    h->since = bw_mono_ms();
    h->stuck = now == h->turns;
    h->turns = now;
    bw_dispatch_wake(h->dispatch);
    pthread_mutex_unlock(&h->lock);
    int64_t from = bw_mono_us();
    int error = probe_disk(h->path, &step);
    int64_t us = bw_mono_us() - from;
    pthread_mutex_lock(&h->lock);
    if (h->left) return;
    if (!error) bw_observe(BW_METRIC_FSYNC_SECONDS, 0, us);
    if (error && error != h->error) bw_event(BW_ERROR, "disk.probe_failed", "step=%s errno=%d", step, error);
    if (!error && h->error) bw_event(BW_INFO, "disk.probe_works", "ms=%" PRId64, us / 1000);
    h->error = error;
    h->step = step;
    h->since = 0;
    if (!error) take_sample(h, bw_mono_ms(), us);
}

static void health_free(bw_health *h) {
    pthread_cond_destroy(&h->wanted);
    pthread_mutex_destroy(&h->lock);
    free(h);
}

static void wait_until(bw_health *h, int64_t until) {
    struct timespec t = {until / 1000, until % 1000 * 1000000};
    pthread_cond_timedwait(&h->wanted, &h->lock, &t);
}

static void *probe_main(void *user) {
    bw_health *h = user;
    pthread_mutex_lock(&h->lock);
    while (!h->stopping) {
        probe(h);
        if (!h->stopping) wait_until(h, bw_mono_ms() + h->config->probe_interval_ms);
    }
    bool left = h->left;
    h->ended = true;
    pthread_cond_signal(&h->wanted);
    pthread_mutex_unlock(&h->lock);
    if (left) health_free(h);
    return NULL;
}

bw_status bw_health_start(const bw_config *config, bw_store *store, bw_queue *queue, bw_dispatch *dispatch, bw_health **out) {
    bw_health *h = calloc(1, sizeof *h);
    if (!h) return BW_E_MEMORY;
    pthread_condattr_t monotonic;
    h->config = config;
    h->store = store;
    h->queue = queue;
    h->dispatch = dispatch;
    h->turns = UINT64_MAX;
    snprintf(h->path, sizeof h->path, "%s/tmp/probe", config->data);
    pthread_mutex_init(&h->lock, NULL);
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&h->wanted, &monotonic);
    pthread_condattr_destroy(&monotonic);
    if (pthread_create(&h->thread, NULL, probe_main, h) == 0) {
        *out = h;
        return BW_OK;
    }
    health_free(h);
    return BW_E_IO;
}

void bw_health_stop(bw_health *h) {
    if (!h) return;
    pthread_mutex_lock(&h->lock);
    h->stopping = true;
    pthread_cond_signal(&h->wanted);
    for (int64_t until = bw_mono_ms() + PATIENCE_MS; !h->ended && bw_mono_ms() < until;) wait_until(h, until);
    bool left = h->left = !h->ended;
    pthread_t thread = h->thread;
    pthread_mutex_unlock(&h->lock);
    if (left) { /* its file goes with all of DATA/tmp at the next start: to unlink it now might hang as well */
        bw_event(BW_WARN, "disk.probe_left", "ms=%d", PATIENCE_MS);
        pthread_detach(thread);
        return;
    }
    pthread_join(thread, NULL);
    unlink(h->path);
    health_free(h);
}

/* ---- the checks ---- */

static bw_verdict say(bw_verdict verdict, char detail[DETAIL], const char *format, ...) __attribute__((format(printf, 3, 4)));
static bw_verdict say(bw_verdict verdict, char detail[DETAIL], const char *format, ...) {
    va_list args;
    va_start(args, format);
    vsnprintf(detail, DETAIL, format, args);
    va_end(args);
    return verdict;
}

static bw_verdict check_queue(bw_health *h, char detail[DETAIL]) {
    if (bw_queue_healthy(h->queue)) return say(BW_VERDICT_OK, detail, "the database reads and writes");
    return say(BW_VERDICT_FAIL, detail, "the database does not read or write");
}

static bw_verdict check_queue_age(bw_health *h, char detail[DETAIL]) {
    bw_load load;
    int warn = h->config->ready_queue_warn_seconds, fail = h->config->ready_queue_fail_seconds;
    if (bw_queue_load(h->queue, &load) != BW_OK) return say(BW_VERDICT_FAIL, detail, "the database does not read");
    if (!load.oldest) return say(BW_VERDICT_OK, detail, "no job waits for its first stage");
    int64_t age = bw_age_ms(load.oldest) / 1000;
    bw_verdict verdict = fail && age >= fail ? BW_VERDICT_FAIL : warn && age >= warn ? BW_VERDICT_WARN : BW_VERDICT_OK;
    return say(verdict, detail, "%" PRId64 " job(s) wait, the oldest of those that no stage has begun of for %" PRId64 " s", load.waiting, age);
}

static bw_verdict check_dispatcher(bw_health *h, char detail[DETAIL]) {
    pthread_mutex_lock(&h->lock);
    bool stuck = h->stuck;
    pthread_mutex_unlock(&h->lock);
    if (!bw_dispatch_alive(h->dispatch)) return say(BW_VERDICT_FAIL, detail, "it has stopped");
    if (bw_dispatch_draining(h->dispatch)) return say(BW_VERDICT_FAIL, detail, "it is draining, the daemon is about to stop");
    return say(stuck ? BW_VERDICT_WARN : BW_VERDICT_OK, detail, "%d of %d workers are running%s", bw_dispatch_running(h->dispatch),
               (int)h->config->workers, stuck ? "; it has been busy with one thing for long" : "");
}

static bw_verdict check_worker(bw_health *h, char detail[DETAIL]) {
    if (access(h->config->worker, X_OK) == 0) return say(BW_VERDICT_OK, detail, "the program can be run");
    return say(BW_VERDICT_FAIL, detail, "the program cannot be run: %s", strerrordesc_np(errno));
}

static bw_verdict check_sandbox(bw_health *h, char detail[DETAIL]) {
    bw_sandbox sandbox = bw_dispatch_sandbox(h->dispatch);
    bool complete = bw_sandbox_complete(&sandbox), required = h->config->require_sandbox;
    return say(complete ? BW_VERDICT_OK : required ? BW_VERDICT_FAIL : BW_VERDICT_WARN, detail, "%s%s%s",
               complete ? "complete" : "not complete: ", sandbox.missing, complete || !required ? "" : "; it is required, so no job is started");
}

static bw_verdict check_disk(bw_health *h, char detail[DETAIL]) {
    uint64_t room = bw_store_room(h->store), warn = h->config->ready_disk_warn, fail = h->config->ready_disk_fail;
    return say(room < fail ? BW_VERDICT_FAIL : room < warn ? BW_VERDICT_WARN : BW_VERDICT_OK, detail,
               "%" PRIu64 " MiB are free; warns below %" PRIu64 ", fails below %" PRIu64, room >> 20, warn >> 20, fail >> 20);
}

static int64_t worst_of(const bw_health *h, int64_t now) {
    int64_t worst = 0;
    for (size_t i = 0; i < SAMPLES && i < h->count; i++)
        if (now - h->samples[i].at <= WINDOW_MS + SPAN_MS && h->samples[i].us > worst) worst = h->samples[i].us;
    return worst;
}

static bw_verdict check_fsync(bw_health *h, char detail[DETAIL]) {
    int64_t now = bw_mono_ms();
    int warn = h->config->ready_fsync_warn_ms, fail = h->config->ready_fsync_fail_ms;
    pthread_mutex_lock(&h->lock);
    int error = h->error;
    const char *step = h->step;
    int64_t since = h->since ? now - h->since : 0, worst = worst_of(h, now), last = h->last;
    pthread_mutex_unlock(&h->lock);
    if (since >= fail) return say(BW_VERDICT_FAIL, detail, "the disk has not answered for %" PRId64 " ms", since);
    if (error) return say(BW_VERDICT_FAIL, detail, "cannot %s a file in the data folder: %s", step, strerrordesc_np(error));
    return say(last >= (int64_t)fail * 1000 ? BW_VERDICT_FAIL : worst >= (int64_t)warn * 1000 ? BW_VERDICT_WARN : BW_VERDICT_OK, detail,
               "the last took %.1f ms, the worst of 5 minutes %.1f ms; warns at %d ms, fails at %d ms", (double)last / 1000,
               (double)worst / 1000, warn, fail);
}

static const struct {
    const char *name;
    bw_verdict (*check)(bw_health *h, char detail[DETAIL]);
} checks[] = {
    {"queue", check_queue}, {"queue_age", check_queue_age}, {"dispatcher", check_dispatcher},
    {"worker", check_worker}, {"sandbox", check_sandbox}, {"disk", check_disk}, {"fsync", check_fsync},
};

json_t *bw_health_checks(bw_health *h, bw_verdict *worst) {
    static const char *const words[] = {"ok", "warn", "fail"};
    json_t *all = json_object();
    *worst = BW_VERDICT_OK;
    for (size_t i = 0; all && i < sizeof checks / sizeof *checks; i++) {
        char detail[DETAIL];
        bw_verdict verdict = checks[i].check(h, detail);
        if (verdict > *worst) *worst = verdict;
        if (json_object_set_new(all, checks[i].name, json_pack("{s:s, s:s}", "status", words[verdict], "detail", detail)) == 0) continue;
        json_decref(all);
        all = NULL;
    }
    return all;
}

void bw_health_measure(bw_health *h) {
    bw_load load;
    bw_queue_stats stats;
    bw_verdict worst;
    int64_t cache;
    json_decref(bw_health_checks(h, &worst));
    bw_gauge(BW_METRIC_READY, 0, worst != BW_VERDICT_FAIL);
    if (bw_queue_load(h->queue, &load) == BW_OK) {
        bw_gauge(BW_METRIC_JOBS, 0, load.waiting);
        bw_gauge(BW_METRIC_JOBS, 1, load.running);
        bw_gauge(BW_METRIC_JOBS, 2, load.ended);
        bw_gauge(BW_METRIC_QUEUE_AGE, 0, load.oldest ? bw_age_ms(load.oldest) : 0);
    }
    bw_queue_statistics(h->queue, &stats);
    bw_gauge(BW_METRIC_WAL_BYTES, 0, (int64_t)stats.wal_bytes);
    bw_gauge(BW_METRIC_WRITES_WAITING, 0, (int64_t)stats.waiting);
    if (bw_queue_cache_bytes(h->queue, &cache) == BW_OK) bw_gauge(BW_METRIC_CACHE_SIZE, 0, cache);
    bw_gauge(BW_METRIC_DISK_FREE, 0, (int64_t)bw_store_room(h->store));
    bw_gauge(BW_METRIC_WORKERS, 0, h->config->workers);
    bw_metrics_read_process();
}
