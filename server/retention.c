#include "server/retention.h"

#include <inttypes.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <time.h>

#include "server/clock.h"
#include "server/log.h"
#include "server/metrics.h"

enum { LOOK_MS = 2000, REST_MOST_US = 200000 };

const char *const bw_keep_names[BW_KEEP_COUNT] = {"jobs", "outputs", "blobs", "keys", "gone"};

struct bw_retention {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    pthread_t thread;
    bool has_thread;
    pthread_mutex_t lock; /* `stopping` under a wait */
    pthread_cond_t changed;
    atomic_bool stopping;
    pthread_mutex_t pass; /* held by a pass or a backup */
};

bw_policy bw_retention_policy(const bw_config *c, int64_t now) {
    const int keep[] = {c->keep_finished_seconds, c->keep_failed_seconds, c->keep_gone_seconds, c->keep_keys_seconds, c->keep_blobs_seconds};
    int64_t before[5];
    for (int i = 0; i < 5; i++) before[i] = keep[i] ? now - (int64_t)keep[i] * 1000 : 0;
    return (bw_policy){.now = now, .finished_before = before[0], .failed_before = before[1], .gone_before = before[2],
                       .keys_before = before[3], .blobs_before = before[4], .cache_most = (int64_t)c->cache_size};
}

/* ---- a pass ---- */

static void rest(int64_t us) {
    if (us > REST_MOST_US) us = REST_MOST_US;
    nanosleep(&(struct timespec){us / 1000000, us % 1000000 * 1000}, NULL);
}

/* In the writer thread: a rename at most. Files are deleted later. */
static void take(void *user, bw_keep_kind kind, const char *name) {
    bw_retention *r = user;
    if (kind == BW_KEEP_OUTPUTS) bw_store_discard_cached(r->store, name);
    else if (kind == BW_KEEP_BLOBS) bw_store_discard_blob(r->store, name);
    else if (kind == BW_KEEP_JOBS) bw_store_discard_log(r->store, name);
}

static bw_status pass_kind(bw_retention *r, const bw_policy *policy, bw_keep_kind kind, bool dry, bw_retention_report *report) {
    bw_collect c = {.kind = kind, .dry = dry, .policy = policy, .take = take, .user = r};
    bw_status status = BW_OK;
    do {
        int64_t start = bw_mono_us(), count = c.count, bytes = c.bytes;
        status = bw_queue_collect(r->queue, &c);
        if (status == BW_OK && !dry) {
            bw_count(BW_METRIC_COLLECTED, (int)kind, 0, (uint64_t)(c.count - count));
            bw_count(BW_METRIC_COLLECTED_BYTES, (int)kind, 0, (uint64_t)(c.bytes - bytes));
            bw_store_empty_discarded(r->store);
        }
        if (c.more) rest(bw_mono_us() - start);
    } while (status == BW_OK && c.more && !atomic_load(&r->stopping));
    report->kinds[kind].count = c.count;
    report->kinds[kind].bytes = c.bytes;
    report->held += c.kind == BW_KEEP_OUTPUTS ? c.held : 0;
    report->held_bytes += c.kind == BW_KEEP_OUTPUTS ? c.held_bytes : 0;
    return status;
}

bw_status bw_retention_pass(bw_retention *r, const bw_policy *policy, bool dry, bw_retention_report *report) {
    bw_status status = BW_OK;
    *report = (bw_retention_report){0};
    pthread_mutex_lock(&r->pass);
    for (int kind = 0; status == BW_OK && kind < BW_KEEP_COUNT; kind++) status = pass_kind(r, policy, (bw_keep_kind)kind, dry, report);
    if (status == BW_OK) status = bw_queue_cache_bytes(r->queue, &report->cache_bytes);
    if (dry) report->cache_bytes -= report->kinds[BW_KEEP_OUTPUTS].bytes;
    pthread_mutex_unlock(&r->pass);
    return status;
}

void bw_retention_hold(bw_retention *r) { pthread_mutex_lock(&r->pass); }
void bw_retention_release(bw_retention *r) { pthread_mutex_unlock(&r->pass); }

/* ---- the thread ---- */

static void tell(bw_status status, const bw_retention_report *x, const bw_policy *policy) {
    int64_t sum = 0;
    for (int i = 0; i < BW_KEEP_COUNT; i++) sum += x->kinds[i].count;
    if (status != BW_OK) bw_event(BW_WARN, "retention.failed", "status=%d", (int)status);
    if (sum)
        bw_event(BW_INFO, "retention.pass", "jobs=%" PRId64 " outputs=%" PRId64 " outputs_bytes=%" PRId64 " blobs=%" PRId64 " blobs_bytes=%" PRId64
                 " keys=%" PRId64 " gone=%" PRId64 " cache_bytes=%" PRId64, x->kinds[BW_KEEP_JOBS].count, x->kinds[BW_KEEP_OUTPUTS].count,
                 x->kinds[BW_KEEP_OUTPUTS].bytes, x->kinds[BW_KEEP_BLOBS].count, x->kinds[BW_KEEP_BLOBS].bytes, x->kinds[BW_KEEP_KEYS].count,
                 x->kinds[BW_KEEP_GONE].count, x->cache_bytes);
    if (policy->cache_most && x->cache_bytes > policy->cache_most)
        bw_event(BW_WARN, "retention.cache_full", "cache_bytes=%" PRId64 " held_bytes=%" PRId64 " most=%" PRId64, x->cache_bytes, x->held_bytes,
                 policy->cache_most);
}

/* Sleeps for a while; false when it is time to stop. */
static bool pause_ms(bw_retention *r, int ms) {
    struct timespec until;
    clock_gettime(CLOCK_MONOTONIC, &until);
    until.tv_sec += ms / 1000;
    pthread_mutex_lock(&r->lock);
    if (!atomic_load(&r->stopping)) pthread_cond_timedwait(&r->changed, &r->lock, &until);
    pthread_mutex_unlock(&r->lock);
    return !atomic_load(&r->stopping);
}

static void *retention_main(void *user) {
    bw_retention *r = user;
    int64_t last = 0, bytes;
    bool full = false; /* more than cache-size is in use */
    do {
        int64_t now = bw_mono_ms();
        bool due = !last || now - last >= (int64_t)r->config->retention_interval_seconds * 1000;
        uint64_t most = r->config->cache_size;
        bool over = most && !full && bw_queue_cache_bytes(r->queue, &bytes) == BW_OK && bytes > (int64_t)most;
        if (!due && !over) continue;
        bw_policy policy = bw_retention_policy(r->config, bw_now_ms());
        bw_retention_report report;
        bw_status status = bw_retention_pass(r, &policy, false, &report);
        full = policy.cache_most && report.cache_bytes > policy.cache_most;
        if (due) last = now;
        tell(status, &report, &policy);
    } while (pause_ms(r, LOOK_MS));
    return NULL;
}

bw_status bw_retention_open(const bw_config *config, bw_store *store, bw_queue *queue, bw_retention **out) {
    pthread_condattr_t monotonic;
    bw_retention *r = calloc(1, sizeof *r);
    if (!r) return BW_E_MEMORY;
    r->config = config;
    r->store = store;
    r->queue = queue;
    pthread_condattr_init(&monotonic);
    pthread_condattr_setclock(&monotonic, CLOCK_MONOTONIC);
    pthread_cond_init(&r->changed, &monotonic);
    pthread_condattr_destroy(&monotonic);
    pthread_mutex_init(&r->lock, NULL);
    pthread_mutex_init(&r->pass, NULL);
    *out = r;
    return BW_OK;
}

bw_status bw_retention_begin(bw_retention *r) {
    r->has_thread = pthread_create(&r->thread, NULL, retention_main, r) == 0;
    return r->has_thread ? BW_OK : BW_E_IO;
}

void bw_retention_stop(bw_retention *r) {
    if (!r) return;
    pthread_mutex_lock(&r->lock);
    atomic_store(&r->stopping, true);
    pthread_cond_signal(&r->changed);
    pthread_mutex_unlock(&r->lock);
    if (r->has_thread) pthread_join(r->thread, NULL);
    r->has_thread = false;
}

void bw_retention_close(bw_retention *r) {
    if (!r) return;
    bw_retention_stop(r);
    pthread_cond_destroy(&r->changed);
    pthread_mutex_destroy(&r->lock);
    pthread_mutex_destroy(&r->pass);
    free(r);
}

/* ---- at start ---- */

typedef struct {
    bw_queue *queue;
    int64_t now;
    bw_mended mended;
    bw_status status;
} reconciling;

static bool has_row(void *user, const char *key) {
    bool found = true;
    return bw_queue_output(user, key, &found, NULL) != BW_OK || found; /* in doubt it stays */
}

static bool has_job(void *user, const char *id) {
    bool found = true;
    return bw_queue_has_job(user, id, &found) != BW_OK || found;
}

static bool has_file(void *user, const char *key) { return bw_store_has_cached(user, key); }
static bool has_blob(void *user, const char *sha256) { return bw_store_has_blob(user, sha256); }

static void adopt(void *user, const char *sha256, uint64_t bytes) {
    reconciling *x = user;
    bool added = false;
    if (x->status == BW_OK) x->status = bw_queue_adopt_blob(x->queue, sha256, (int64_t)bytes, x->now, &added);
    x->mended.blobs_adopted += added;
}

bw_status bw_reconcile(bw_store *store, bw_queue *queue, int64_t now) {
    int dropped = 0, forgotten = 0, recovered = 0, logs = 0;
    reconciling x = {.queue = queue, .now = now};
    bw_status status = bw_store_sweep_cache(store, has_row, queue, &dropped);
    if (status == BW_OK) status = bw_queue_sweep_outputs(queue, has_file, store, &forgotten);
    if (status == BW_OK) status = bw_store_each_blob(store, adopt, &x);
    if (status == BW_OK) status = x.status;
    if (status == BW_OK) status = bw_store_sweep_logs(store, has_job, queue, &logs);
    if (status == BW_OK) status = bw_queue_recover(queue, now, &recovered);
    if (status == BW_OK) status = bw_queue_mend(queue, has_blob, store, now, &x.mended);
    bw_event(BW_INFO, "daemon.recovered", "interrupted=%d cache_dropped=%d cache_forgotten=%d blobs_adopted=%" PRId64 " blobs_forgotten=%" PRId64
             " logs_dropped=%d jobs_failed=%" PRId64, recovered, dropped, forgotten, x.mended.blobs_adopted, x.mended.blobs_forgotten, logs,
             x.mended.jobs_failed);
    return status;
}
