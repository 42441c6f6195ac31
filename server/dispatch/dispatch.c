#include "server/dispatch/dispatch.h"

#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/dispatch/slot.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/worker/scratch.h"
#include "server/worker/spawner.h"

enum { MURMUR_MS = 250, POOL_THREADS = 4 };

static bool any_busy(const bw_dispatch *d) {
    for (int i = 0; i < d->config->workers; i++)
        if (d->slots[i].busy) return true;
    return false;
}

/* ---- the loop ---- */

static void measure(bw_slot *s, const bw_spawn_report *exit) {
    s->peak = exit->peak_bytes;
    s->spent = (bw_spent){bw_mono_ms() - s->started, exit->cpu_ms};
    bw_observe(BW_METRIC_STAGE_SECONDS, s->job.stage, s->spent.wall_ms);
    bw_observe(BW_METRIC_STAGE_PEAK, s->job.stage, s->peak);
    bw_count(BW_METRIC_STAGE_CPU, s->job.stage, 0, (uint64_t)s->spent.cpu_ms);
}

static bw_status read_spawner(bw_dispatch *d) {
    bw_spawn_report r;
    bw_status status = BW_OK;
    bool gone = false;
    while (status == BW_OK && bw_spawner_report(d->spawner, &r, &gone)) {
        if (r.kind != BW_WORKER_EXITED) continue;
        for (int i = 0; i < d->config->workers; i++) {
            bw_slot *s = &d->slots[i];
            if (!bw_slot_runs(s) || s->token != r.token) continue;
            measure(s, &r);
            status = bw_slot_judge(d, s, r.wait_status);
            break;
        }
    }
    if (gone) bw_event(BW_ERROR, "spawner.gone", "running=%d", any_busy(d));
    return gone ? BW_E_IO : status;
}

static bw_status book_filed(bw_dispatch *d) {
    bw_status status = BW_OK;
    for (int i = 0; status == BW_OK && i < d->config->workers; i++)
        if (d->slots[i].filing && atomic_load(&d->slots[i].output.done)) status = bw_slot_book(d, &d->slots[i]);
    return status;
}

/* Looks at the size of the attempt's folder from time to time: the sum of many files is nothing that the kernel limits. */
static void watch_scratch(bw_dispatch *d, bw_slot *s, int64_t now) {
    if (s->reason != BW_KEEP || now < s->look_at || s->folder < 0) return;
    s->look_at = now + BW_SCRATCH_LOOK_MS;
    if (bw_scratch_bytes(s->folder, s->limits.scratch) > s->limits.scratch) bw_slot_stop(d, s, BW_STOP_SCRATCH, SIGKILL);
}

/* Tells those who follow the job that its worker has said something. A slot is looked at every BW_SCRATCH_LOOK_MS at least, so the last of it is told, too. */
static void tell_listeners(bw_dispatch *d, bw_slot *s, int64_t now) {
    if (s->session.said == s->told || now < s->tell_at) return;
    s->told = s->session.said;
    s->tell_at = now + MURMUR_MS;
    bw_watch_murmur(d->watch, s->job.id);
}

/* Cancels, finishes, limits and the end of the daemon. */
static bw_status watch_running(bw_dispatch *d, bool woken) {
    int64_t now = bw_mono_ms();
    for (int i = 0; i < d->config->workers; i++) {
        bw_slot *s = &d->slots[i];
        if (!bw_slot_runs(s)) continue;
        if (s->reason == BW_KEEP && atomic_load(&d->stopping)) bw_slot_stop(d, s, BW_STOP_DAEMON, SIGTERM);
        if (s->reason == BW_KEEP && now >= s->deadline) bw_slot_stop(d, s, BW_STOP_TIME, SIGKILL);
        if (s->reason == BW_KEEP && woken) {
            bw_job job;
            bool found;
            bw_status status = bw_queue_get(d->queue, s->job.id, &job, &found);
            if (status != BW_OK) return status;
            s->job.finish = found && job.finish;
            if (found && job.cancel) bw_slot_stop(d, s, BW_STOP_CANCELLED, SIGTERM);
            else bw_slot_ask_to_finish(d, s);
            bw_job_clear(&job);
        }
        watch_scratch(d, s, now);
        tell_listeners(d, s, now);
        if (s->kill_at && now >= s->kill_at) {
            s->kill_at = 0;
            bw_spawner_kill(d->spawner, s->token, SIGKILL);
        }
    }
    return BW_OK;
}

static int sleep_ms(const bw_dispatch *d, int64_t next_due) {
    int64_t wait = 60000, now = bw_mono_ms();
    if (next_due && next_due - bw_now_ms() < wait) wait = next_due - bw_now_ms();
    for (int i = 0; i < d->config->workers; i++) {
        const bw_slot *s = &d->slots[i];
        if (!bw_slot_runs(s)) continue;
        if (s->reason == BW_KEEP && s->deadline - now < wait) wait = s->deadline - now;
        if (s->reason == BW_KEEP && s->look_at - now < wait) wait = s->look_at - now;
        if (s->kill_at && s->kill_at - now < wait) wait = s->kill_at - now;
    }
    return wait < 0 ? 0 : (int)wait + 1;
}

enum { POLLED_MOST = 2 + 2 * 256 };

static bw_status turn(bw_dispatch *d, struct pollfd *fds, int64_t *next_due) {
    nfds_t n = 0;
    uint64_t count;
    fds[n++] = (struct pollfd){d->wake, POLLIN, 0};
    fds[n++] = (struct pollfd){d->spawner, POLLIN, 0};
    for (int i = 0; i < d->config->workers; i++) {
        const bw_slot *s = &d->slots[i];
        if (bw_slot_runs(s) && s->session.channel >= 0) fds[n++] = (struct pollfd){s->session.channel, POLLIN, 0};
        if (bw_slot_runs(s) && s->session.errors >= 0) fds[n++] = (struct pollfd){s->session.errors, POLLIN, 0};
    }
    if (poll(fds, n, sleep_ms(d, *next_due)) < 0 && errno != EINTR) return BW_E_IO;
    bool woken = fds[0].revents && read(d->wake, &count, sizeof count) > 0;
    for (int i = 0; i < d->config->workers; i++)
        if (bw_slot_runs(&d->slots[i])) bw_slot_listen(d, &d->slots[i], false);
    bw_status status = read_spawner(d);
    if (status == BW_OK) status = book_filed(d);
    if (status == BW_OK) status = watch_running(d, woken);
    bool claims = bw_dispatch_claims(d);
    if (!claims) *next_due = 0;
    if (status == BW_OK && claims) status = bw_dispatch_choose(d, next_due);
    atomic_fetch_add(&d->turns, 1);
    return status;
}

static void *dispatch_main(void *user) {
    bw_dispatch *d = user;
    struct pollfd fds[POLLED_MOST];
    int64_t next_due = 0;
    bw_status status = bw_dispatch_choose(d, &next_due);
    while (status == BW_OK && !(atomic_load(&d->stopping) && !any_busy(d))) status = turn(d, fds, &next_due);
    atomic_store(&d->alive, false);
    if (status != BW_OK) {
        uint64_t one = 1;
        bw_event(BW_ERROR, "dispatch.failed", "status=%d", (int)status);
        if (write(d->fatal, &one, sizeof one) < 0) abort();
    }
    return NULL;
}

/* ---- start, stop, questions ---- */

bw_status bw_dispatch_start(const bw_config *config, bw_store *store, bw_queue *queue, bw_watch *watch, int spawner,
                            int fatal, bw_dispatch **out) {
    bw_dispatch *d = calloc(1, sizeof *d);
    if (!d) return BW_E_MEMORY;
    d->config = config;
    d->store = store;
    d->queue = queue;
    d->watch = watch;
    d->spawner = spawner;
    d->fatal = fatal;
    d->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    d->slots = calloc((size_t)config->workers, sizeof *d->slots);
    pthread_mutex_init(&d->lock, NULL);
    atomic_store(&d->alive, true);
    if (d->slots && config->workers > 0) bw_dispatch_try_sandbox(d);
    if (d->wake >= 0 && d->slots && bw_pool_open(POOL_THREADS, &d->pool) == BW_OK && pthread_create(&d->thread, NULL, dispatch_main, d) == 0) {
        *out = d;
        return BW_OK;
    }
    bw_pool_close(d->pool);
    if (d->wake >= 0) close(d->wake);
    free(d->slots);
    free(d);
    return BW_E_IO;
}

void bw_dispatch_wake(bw_dispatch *d) {
    uint64_t one = 1;
    while (write(d->wake, &one, sizeof one) < 0 && errno == EINTR) continue;
}

double bw_dispatch_progress(bw_dispatch *d, const char *job, char note[BW_NOTE_TEXT]) {
    double progress = 0;
    *note = '\0';
    pthread_mutex_lock(&d->lock);
    for (int i = 0; i < d->config->workers; i++) {
        const bw_slot *s = &d->slots[i];
        if (!s->busy || strcmp(s->job.id, job) != 0) continue;
        progress = s->session.progress;
        memcpy(note, s->session.note, sizeof s->session.note);
    }
    pthread_mutex_unlock(&d->lock);
    return progress;
}

bool bw_dispatch_waits_for_memory(bw_dispatch *d, const char *job) {
    pthread_mutex_lock(&d->lock);
    bool waits = bw_waiter_find(d, job) != NULL;
    pthread_mutex_unlock(&d->lock);
    return waits;
}

bw_sandbox bw_dispatch_sandbox(bw_dispatch *d) {
    pthread_mutex_lock(&d->lock);
    bw_sandbox sandbox = d->sandbox;
    pthread_mutex_unlock(&d->lock);
    return sandbox;
}

bool bw_dispatch_alive(bw_dispatch *d) { return atomic_load(&d->alive); }
uint64_t bw_dispatch_turns(bw_dispatch *d) { return atomic_load(&d->turns); }

void bw_dispatch_drain(bw_dispatch *d) {
    atomic_store(&d->draining, true);
    bw_dispatch_wake(d);
}

bool bw_dispatch_draining(bw_dispatch *d) { return atomic_load(&d->draining); }

int bw_dispatch_running(bw_dispatch *d) {
    int running = 0;
    pthread_mutex_lock(&d->lock);
    for (int i = 0; i < d->config->workers; i++) running += d->slots[i].busy;
    pthread_mutex_unlock(&d->lock);
    return running;
}

void bw_dispatch_stop(bw_dispatch *d) {
    if (!d) return;
    atomic_store(&d->stopping, true);
    bw_dispatch_wake(d);
    pthread_join(d->thread, NULL);
    bw_pool_close(d->pool); /* outputs that are being filed have their slots */
    d->pool = NULL;
    for (int i = 0; i < d->config->workers; i++) /* busy only after a fatal error: recovered at the next start */
        if (d->slots[i].busy) bw_slot_release(d, &d->slots[i]);
    close(d->wake);
    pthread_mutex_destroy(&d->lock);
    free(d->slots);
    free(d);
}
