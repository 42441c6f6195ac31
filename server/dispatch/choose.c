/* Which job is next: turns by owner (queue.h), as far as the cache reaches, and only what there is memory for. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/dispatch/slot.h"
#include "server/files.h"
#include "server/joboptions.h"
#include "server/log.h"
#include "server/metrics.h"

enum { PAGE = 8, TAKEN_MOST = 32 }; /* jobs taken in one pass: what else the thread has to do does not wait for a cache that has thousands */

/* Is the state there that the stage reads? Retention keeps it, but it may have been lost in other ways, or never have come back from a backup. */
static bool has_input(bw_dispatch *d, const bw_job *job, const json_t *options) {
    char key[BW_SHA256_TEXT];
    return job->stage == 0 || !bw_stage_key(job, options, job->stage - 1, key) || bw_store_has_cached(d->store, key);
}

static bool key_is_busy(const bw_dispatch *d, const char *key) {
    for (int i = 0; i < d->config->workers; i++)
        if (d->slots[i].busy && strcmp(d->slots[i].key, key) == 0) return true;
    return false;
}

static bw_slot *free_slot(bw_dispatch *d) {
    for (int i = 0; i < d->config->workers; i++)
        if (!d->slots[i].busy) return &d->slots[i];
    return NULL;
}

/* Is the stage's output in the cache? A row whose file has vanished is forgotten. */
static bw_status is_cached(bw_dispatch *d, const char *key, bool *cached) {
    bw_status status = bw_queue_output(d->queue, key, cached, NULL);
    if (status != BW_OK || !*cached || bw_store_has_cached(d->store, key)) return status;
    *cached = false;
    return bw_queue_forget_output(d->queue, key);
}

/* About how many bytes the job's next stage will take: as told by the stage before, or by the size of what it reads. No more than it may. */
static bw_status need_of(bw_dispatch *d, const bw_job *job, const json_t *options, uint64_t *need) {
    char key[BW_SHA256_TEXT];
    uint64_t bytes = 0, more = 0, most = bw_stage_limits_of(d->config, job->limits, &job->spent).memory;
    bw_status status = BW_OK;
    *need = 0;
    if (job->stage > 0 && bw_stage_key(job, options, job->stage - 1, key)) status = bw_queue_output_need(d->queue, key, need);
    if (!*need) {
        int input = bw_stage_input(d, job, options, &bytes), parameters = -1;
        if (job->stage == 0 && *job->parameters) parameters = bw_store_open_blob(d->store, job->parameters, &more);
        char start[BW_START_BYTES];
        ssize_t n = input < 0 ? 0 : pread(input, start, sizeof start, 0);
        bw_close_all((const int[]){input, parameters}, 2);
        *need = job->stage == 0 ? bw_need_of_input(start, n > 0 ? (size_t)n : 0, bytes + more) : bw_need_of_state(bytes);
    }
    if (*need > most) *need = most;
    return status;
}

bw_waiter *bw_waiter_find(bw_dispatch *d, const char *job) {
    for (size_t i = 0; i < d->waiter_count; i++)
        if (strcmp(d->waiters[i].job, job) == 0) return &d->waiters[i];
    return NULL;
}

static void note_waiter(bw_dispatch *d, const bw_job *job, uint64_t need) {
    pthread_mutex_lock(&d->lock);
    bw_waiter *w = bw_waiter_find(d, job->id);
    bool known = w != NULL;
    if (!known && d->waiter_count < BW_WAITERS_MOST) {
        w = &d->waiters[d->waiter_count++];
        snprintf(w->job, sizeof w->job, "%s", job->id);
    }
    if (w) w->seen = true;
    pthread_mutex_unlock(&d->lock);
    if (w && !known)
        bw_event(BW_INFO, "job.waits", "job=%s for=memory need=%" PRIu64 " taken=%" PRIu64 " memory=%" PRIu64, job->id, need,
                 d->admission.taken, d->admission.memory);
}

static void forget_waiter(bw_dispatch *d, const char *job) {
    pthread_mutex_lock(&d->lock);
    bw_waiter *w = bw_waiter_find(d, job);
    if (w) *w = d->waiters[--d->waiter_count];
    pthread_mutex_unlock(&d->lock);
}

/* A pass over what waits. */
static void begin_pass(bw_dispatch *d) {
    d->admission.memory = d->config->memory;
    bw_admission_begin(&d->admission);
    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < d->waiter_count; i++) d->waiters[i].seen = false;
    pthread_mutex_unlock(&d->lock);
}

/* `complete`: it was not ended by a lack of workers, so who was not seen waiting for memory does not. */
static void end_pass(bw_dispatch *d, bool complete) {
    bw_admission_end(&d->admission, complete);
    pthread_mutex_lock(&d->lock);
    for (size_t i = d->waiter_count; complete && i-- > 0;)
        if (!d->waiters[i].seen) d->waiters[i] = d->waiters[--d->waiter_count];
    pthread_mutex_unlock(&d->lock);
}

/* Claims the job's next stage and starts it, if there is memory enough. */
static bw_status claim_job(bw_dispatch *d, bw_slot *s, bw_job *job, const char *key, const json_t *options, bool *taken) {
    uint64_t need;
    bw_status status = need_of(d, job, options, &need);
    if (status != BW_OK) return status;
    if (!bw_admission_ask(&d->admission, job->id, need, bw_mono_ms())) {
        note_waiter(d, job, need);
        return BW_OK;
    }
    forget_waiter(d, job->id);
    status = bw_queue_claim(d->queue, job, bw_now_ms(), taken);
    if (status == BW_OK && *taken) status = bw_slot_occupy(d, s, job, key, options, need);
    if (s->busy) bw_watch_notify(d->watch, s->job.id);
    return status;
}

/* Brings a waiting job as far as the cache reaches, then claims its next stage if a worker is free. *taken: at least one of
 * the two was done. */
static bw_status advance_job(bw_dispatch *d, bw_job *job, bool *taken) {
    bw_status status = BW_OK;
    bool done = true;
    *taken = false;
    json_t *options = json_loads(job->options, 0, NULL);
    while (options && done && status == BW_OK && job->state != BW_JOB_SUCCESSFUL) {
        char key[BW_SHA256_TEXT];
        bool cached;
        bw_slot *s = free_slot(d);
        if (!bw_stage_key(job, options, job->stage, key) || key_is_busy(d, key)) break;
        status = is_cached(d, key, &cached);
        if (status != BW_OK || (!cached && !s)) break;
        if (!cached && !has_input(d, job, options)) {
            status = bw_queue_rewind(d->queue, job, bw_now_ms(), &done);
            if (status != BW_OK || !done) continue;
            bw_event(BW_WARN, "job.rewound", "job=%s", job->id);
            bw_watch_notify(d->watch, job->id);
            continue;
        }
        if (!cached) {
            status = claim_job(d, s, job, key, options, taken);
            break;
        }
        int stage = job->stage;
        bool results = stage == BW_API_STAGE_COUNT - 1;
        status = bw_queue_reuse(d->queue, job, key, results, bw_now_ms(), &done);
        *taken = *taken || done;
        if (status != BW_OK || !done) continue;
        bw_count(BW_METRIC_CACHE_HITS, stage, 0, 1);
        bw_event(BW_INFO, job->state == BW_JOB_SUCCESSFUL ? "job.successful" : "stage.reused", "job=%s attempt=%d",
                 job->id, job->attempt);
        bw_watch_notify(d->watch, job->id);
    }
    json_decref(options);
    return status;
}

/* One owner's turn: the first of its candidates that can be taken. One whose key is being made waits for that. */
static bw_status serve(bw_dispatch *d, const char *owner, bool *found) {
    bw_status status = BW_OK;
    bool taken = false;
    size_t count = PAGE;
    for (int skip = 0; status == BW_OK && !taken && count == PAGE && skip < BW_LOOK_MOST; skip += PAGE) {
        bw_job *jobs;
        status = bw_queue_candidates(d->queue, owner, bw_now_ms(), skip, PAGE, &jobs, &count);
        if (status != BW_OK) return status;
        for (size_t i = 0; status == BW_OK && !taken && i < count; i++) {
            bw_cancel ignored;
            if (!jobs[i].cancel) {
                status = advance_job(d, &jobs[i], &taken);
                continue;
            }
            status = bw_queue_cancel(d->queue, jobs[i].id, bw_now_ms(), &ignored);
            bw_watch_notify(d->watch, jobs[i].id);
        }
        bw_jobs_free(jobs, count);
    }
    *found = taken;
    return status;
}

bw_status bw_dispatch_choose(bw_dispatch *d, int64_t *next_due) {
    bw_turn turn = {.served = -1};
    bw_status status = BW_OK;
    int taken = 0;
    bool found, one;
    *next_due = 0;
    if (d->config->require_sandbox && !bw_sandbox_complete(&d->sandbox)) return BW_OK; /* fails closed; /readyz tells */
    begin_pass(d);
    while (free_slot(d) && taken < TAKEN_MOST && bw_dispatch_claims(d)) {
        status = bw_queue_turn(d->queue, d->config->owner_running, &turn, &found);
        if (status != BW_OK || !found) break;
        status = serve(d, turn.owner, &one);
        if (status != BW_OK) break;
        taken += one;
    }
    end_pass(d, status == BW_OK && taken < TAKEN_MOST && free_slot(d));
    *next_due = bw_now_ms();
    if (status != BW_OK || taken == TAKEN_MOST) return status; /* there may be more: once round the loop, then at once */
    return bw_queue_next_due(d->queue, *next_due, next_due);
}
