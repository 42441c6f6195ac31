#include "base/parallel.h"

#include <pthread.h>

typedef struct {
    bw_context ctx;
    size_t begin, end;
    int range;
    bw_parallel_work *work;
    void *user;
    bw_status status;
    pthread_t thread;
    bool started;
} share;

static void *run(void *user) {
    share *s = user;
    s->status = s->work(&s->ctx, s->begin, s->end, s->range, s->user);
    return NULL;
}

int bw_parallel_ranges(const bw_context *ctx, size_t count, size_t least) {
    size_t most = least ? count / least : count;
    int ranges = ctx->threads < BW_PARALLEL_MOST ? ctx->threads : BW_PARALLEL_MOST;
    if (most < (size_t)ranges) ranges = (int)most;
    return ranges < 1 ? 1 : ranges;
}

bw_status bw_parallel(bw_context *ctx, size_t count, int ranges, bw_parallel_work *work, void *user) {
    if (ctx->error.status != BW_OK) return ctx->error.status;
    share *all = bw_alloc(ctx, (size_t)ranges, sizeof *all);
    if (!all) return ctx->error.status;
    for (int i = 0; i < ranges; i++) {
        share *s = &all[i];
        s->ctx = *ctx;
        s->ctx.progress = NULL, s->ctx.log = NULL;
        s->begin = count / (size_t)ranges * (size_t)i;
        s->end = i + 1 < ranges ? count / (size_t)ranges * (size_t)(i + 1) : count;
        s->range = i, s->work = work, s->user = user;
        s->started = i > 0 && pthread_create(&s->thread, NULL, run, s) == 0;
    }
    for (int i = 0; i < ranges; i++) /* the first range, and any for which there was no thread, run here */
        if (!all[i].started) run(&all[i]);
    for (int i = 0; i < ranges; i++)
        if (all[i].started) pthread_join(all[i].thread, NULL);
    for (int i = ranges - 1; i >= 0; i--)
        if (all[i].status != BW_OK) ctx->error = all[i].ctx.error;
    bw_free(ctx, all);
    return ctx->error.status;
}
