#include "base/parallel.h"

#include <pthread.h>
#include <stdatomic.h>

/* Pieces are dealt in ascending order, so when one fails all lower ones have been taken, and are finished. */
typedef struct {
    size_t count, size;
    atomic_size_t next;
    atomic_bool failed;
} deal;

typedef struct {
    bw_context ctx;
    size_t begin, end; /* the range; or the piece that was worked on last */
    deal *deal;        /* NULL: one range */
    int range;
    bw_parallel_work *work;
    void *user;
    bw_status status;
    pthread_t thread;
    bool started;
} share;

static bool take_piece(share *s) {
    deal *d = s->deal;
    if (atomic_load(&d->failed)) return false;
    s->begin = atomic_fetch_add(&d->next, d->size);
    if (s->begin >= d->count) return false;
    s->end = d->count - s->begin < d->size ? d->count : s->begin + d->size;
    return true;
}

static void *run(void *user) {
    share *s = user;
    bool more = !s->deal || take_piece(s);
    while (more) {
        s->status = s->work(&s->ctx, s->begin, s->end, s->range, s->user);
        if (s->deal && s->status != BW_OK) atomic_store(&s->deal->failed, true);
        more = s->deal && s->status == BW_OK && take_piece(s);
    }
    return NULL;
}

int bw_parallel_ranges(const bw_context *ctx, size_t count, size_t least) {
    size_t most = least ? count / least : count;
    int ranges = ctx->threads < BW_PARALLEL_MOST ? ctx->threads : BW_PARALLEL_MOST;
    if (most < (size_t)ranges) ranges = (int)most;
    return ranges < 1 ? 1 : ranges;
}

static void set_up(share *all, bw_context *ctx, size_t count, int ranges, deal *d, bw_parallel_work *work, void *user) {
    for (int i = 0; i < ranges; i++) {
        share *s = &all[i];
        s->ctx = *ctx;
        s->ctx.progress = NULL, s->ctx.note = NULL, s->ctx.log = NULL;
        s->begin = count / (size_t)ranges * (size_t)i;
        s->end = i + 1 < ranges ? count / (size_t)ranges * (size_t)(i + 1) : count;
        s->deal = d, s->range = i, s->work = work, s->user = user;
    }
}

static bw_status run_all(bw_context *ctx, size_t count, int ranges, deal *d, bw_parallel_work *work, void *user) {
    if (ctx->error.status != BW_OK) return ctx->error.status;
    share *all = bw_alloc(ctx, (size_t)ranges, sizeof *all), *lowest = NULL;
    if (!all) return ctx->error.status;
    set_up(all, ctx, count, ranges, d, work, user);
    for (share *s = all + 1; s < all + ranges; s++) s->started = pthread_create(&s->thread, NULL, run, s) == 0;
    for (share *s = all; s < all + ranges; s++) /* the first range, and any for which there was no thread, run here */
        if (!s->started) run(s);
    for (share *s = all; s < all + ranges; s++) {
        if (s->started) pthread_join(s->thread, NULL);
        if (s->status != BW_OK && (!lowest || s->begin < lowest->begin)) lowest = s;
    }
    if (lowest) ctx->error = lowest->ctx.error;
    bw_free(ctx, all);
    return ctx->error.status;
}

bw_status bw_parallel(bw_context *ctx, size_t count, int ranges, bw_parallel_work *work, void *user) {
    return run_all(ctx, count, ranges, NULL, work, user);
}

bw_status bw_parallel_pieces(bw_context *ctx, size_t count, size_t piece, int ranges, bw_parallel_work *work, void *user) {
    deal d = {.count = count, .size = piece};
    return run_all(ctx, count, ranges, &d, work, user);
}
