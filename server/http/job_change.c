/* What owners ask of their jobs: cancel, finish, retry, delete. Each is written by the queue's thread; nobody waits for it here. */
#include "server/http/operations.h"

#include <stdlib.h>

#include "server/clock.h"
#include "server/http/reply.h"
#include "server/log.h"

static void change(bw_request *r, bw_write_fn fn, void (*then)(bw_request *)) {
    bw_change *c = calloc(1, sizeof *c);
    if (!c) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    c->id = r->parameters[0];
    c->now = bw_now_ms();
    c->limits.queued = r->services->config->owner_jobs;
    r->state = c;
    r->state_free = free;
    bw_request_write(r, fn, then);
}

static const char ended[] = "has already ended";

/* What has become of it; a reply is made for all that is no success. `late`: what a job is for which that comes too late. */
static bw_change_result outcome(bw_request *r, const char *verb, const char *late) {
    bw_change_result result = ((bw_change *)r->state)->result;
    if (r->written != BW_OK) bw_reply_storage(r);
    else if (result == BW_CHANGE_UNKNOWN) bw_http_reply_no_job(r, r->parameters[0]);
    else if (result == BW_CHANGE_TOO_LATE) bw_reply_problem(r, BW_PROBLEM_JOB_FINISHED, "the job %s; there is nothing to %s", late, verb);
    else if (result == BW_CHANGE_TOO_EARLY) bw_reply_problem(r, BW_PROBLEM_JOB_NOT_ENDED, "the job has not ended; cancel it, then %s it", verb);
    else if (result == BW_CHANGE_TOO_MANY) bw_http_reply_too_many(r, ((bw_change *)r->state)->in_force.queued);
    return result;
}

/* The job as it is now, unless there is a reply; whoever watches it is told. */
static void reply_changed(bw_request *r) {
    bw_job job;
    if (r->reply) return;
    bw_watch_notify(r->services->watch, r->parameters[0]);
    if (!bw_http_load_job(r, &job)) return;
    bw_http_reply_job(r, &job);
    bw_job_clear(&job);
}

static void cancelled(bw_request *r) {
    if (outcome(r, "cancel", ended) == BW_CHANGE_NOTED) bw_dispatch_wake(r->services->dispatch);
    reply_changed(r);
}

static void finished(bw_request *r) {
    if (outcome(r, "finish", ended) == BW_CHANGE_NOTED) bw_dispatch_wake(r->services->dispatch);
    reply_changed(r);
}

static void restarted(bw_request *r) {
    if (outcome(r, "retry", "was successful") == BW_CHANGE_DONE && !r->reply) {
        bw_event(BW_INFO, "job.restarted", "job=%s", r->parameters[0]);
        bw_dispatch_wake(r->services->dispatch);
    }
    reply_changed(r);
}

static void pinned(bw_request *r) {
    outcome(r, "pin", ended);
    reply_changed(r);
}

/* The rows are gone for good; a log that stays behind after a crash right here belongs to nobody. */
static void deleted(bw_request *r) {
    outcome(r, "delete", ended);
    if (r->reply) return;
    bw_store_drop_log(r->services->store, r->parameters[0]);
    bw_event(BW_INFO, "job.deleted", "job=%s", r->parameters[0]);
    bw_watch_notify(r->services->watch, r->parameters[0]);
    bw_reply_nothing(r);
}

void bw_http_job_cancel(bw_request *r) { change(r, bw_write_cancel, cancelled); }
void bw_http_job_finish(bw_request *r) { change(r, bw_write_finish, finished); }
void bw_http_job_retry(bw_request *r) { change(r, bw_write_restart, restarted); }
void bw_http_job_pin(bw_request *r) { change(r, bw_write_pin, pinned); }
void bw_http_job_unpin(bw_request *r) { change(r, bw_write_unpin, pinned); }
void bw_http_job_delete(bw_request *r) { change(r, bw_write_delete, deleted); }
