#include "solve/frontier.h"

#include <stdbool.h>

static bool before(bw_waiting a, bw_waiting b) { return a.bound < b.bound || (a.bound == b.bound && a.node > b.node); }

bw_status bw_frontier_push(bw_context *ctx, bw_frontier *f, int32_t node, double bound) {
    if (bw_reserve(ctx, &f->item, &f->room, f->count + 1)) return ctx->error.status;
    bw_waiting x = {bound, node};
    size_t i = f->count++;
    for (; i && before(x, f->item[(i - 1) / 2]); i = (i - 1) / 2) f->item[i] = f->item[(i - 1) / 2];
    f->item[i] = x;
    return BW_OK;
}

int32_t bw_frontier_pop(bw_frontier *f) {
    bw_waiting top = f->item[0], last = f->item[--f->count];
    size_t i = 0;
    for (size_t child; (child = 2 * i + 1) < f->count; i = child) {
        if (child + 1 < f->count && before(f->item[child + 1], f->item[child])) child++;
        if (!before(f->item[child], last)) break;
        f->item[i] = f->item[child];
    }
    f->item[i] = last;
    return top.node;
}

void bw_frontier_clear(bw_context *ctx, bw_frontier *f) {
    bw_free(ctx, f->item);
    *f = (bw_frontier){0};
}
