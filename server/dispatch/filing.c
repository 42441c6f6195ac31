/* What takes long when an attempt has ended: the dispatcher goes on with its other jobs meanwhile. */
#include <stdlib.h>
#include <string.h>

#include "server/dispatch/slot.h"
#include "server/worker/scratch.h"

static void file_output(void *user) {
    bw_slot *s = user;
    bw_filing *o = &s->output;
    bw_dispatch *d = s->dispatch;
    o->fits = bw_scratch_bytes(s->folder, s->limits.scratch) <= s->limits.scratch; /* it may have grown since the last look */
    if (o->fits) o->status = bw_attempt_publish(d->store, s->job.id, s->job.attempt, s->key, &o->made.bytes, &o->manifest);
    atomic_store(&o->done, true); /* the slot is the dispatcher's again */
    bw_dispatch_wake(d);
}

void bw_slot_file(bw_dispatch *d, bw_slot *s) {
    s->dispatch = d;
    s->filing = true;
    atomic_store(&s->output.done, false);
    bw_pool_post(d->pool, &s->output.work, file_output, s);
}

typedef struct {
    bw_pool_work work;
    bw_store *store;
    char job[BW_JOB_ID_TEXT];
    int attempt;
} removal;

static void remove_folder(void *user) {
    removal *r = user;
    bw_attempt_end(r->store, r->job, r->attempt);
    free(r);
}

void bw_dispatch_remove(bw_dispatch *d, const char *job, int attempt) {
    removal *r = d->pool ? malloc(sizeof *r) : NULL;
    if (!r) {
        bw_attempt_end(d->store, job, attempt);
        return;
    }
    r->store = d->store;
    memcpy(r->job, job, sizeof r->job);
    r->attempt = attempt;
    bw_pool_post(d->pool, &r->work, remove_folder, r);
}
