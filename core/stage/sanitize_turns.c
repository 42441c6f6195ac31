/* The turns around edges after a repair: see sanitize_repair.h. */
#include <string.h>

#include "stage/sanitize_repair.h"

typedef struct {
    const bw_star_input *before;
    const bw_seams *after;
    uint8_t *doubtful;
    uint32_t *degree, *sum; /* [vertex] number of singular hinges at it, and the sum of their numbers, meant
                               where it is 2 */
} turns;

static bool has_unsure(const turns *w, bw_hinge h) {
    const bw_ring *ring = &w->before->hinges->ring[h];
    for (int32_t i = ring->begin; i < ring->end; i++)
        if (w->before->unsure[w->before->hinges->tet[i]]) return true;
    return false;
}

static bool is_doubtful(const turns *w, bw_hinge h) {
    int regular = w->before->hinges->ring[h].open ? 2 : 4, quarters = w->after->quarters[h];
    if (w->before->seams->quarters[h] == quarters) return false;
    return !has_unsure(w, h) || quarters > regular + 1 || quarters < regular - 1;
}

/* Whether the singular edge goes on in one that is certain and has the same turns. */
static bool goes_on(const turns *w, bw_hinge h) {
    const bw_hinges *hinges = w->before->hinges;
    for (int i = 0; i < 2; i++) {
        bw_vertex v = w->before->mesh->edge[hinges->ring[h].edge][i];
        bw_hinge other = w->degree[v] == 2 ? (bw_hinge)(w->sum[v] - (uint32_t)h) : h;
        if (other != h && !w->doubtful[other] && w->after->quarters[other] == w->after->quarters[h] &&
            hinges->ring[other].open == hinges->ring[h].open)
            return true;
    }
    return false;
}

static void count_singular(turns *w) {
    const bw_hinges *hinges = w->before->hinges;
    for (size_t h = 0; h < hinges->count; h++)
        for (int i = 0; i < 2 && !bw_seams_regular(w->after, hinges, (bw_hinge)h); i++) {
            bw_vertex v = w->before->mesh->edge[hinges->ring[h].edge][i];
            w->degree[v]++;
            w->sum[v] += (uint32_t)h;
        }
}

bw_status bw_repair_check_turns(bw_context *ctx, const bw_star_input *before, const bw_seams *after,
                                uint8_t *doubtful, size_t *count) {
    turns w = {before, after, doubtful, NULL, NULL};
    size_t hinges = before->hinges->count;
    *count = 0;
    for (size_t h = 0; h < hinges; h++) *count += doubtful[h] = is_doubtful(&w, (bw_hinge)h);
    if (!*count) return BW_OK;
    w.degree = bw_alloc(ctx, before->mesh->vertex_count, sizeof *w.degree);
    w.sum = bw_alloc(ctx, before->mesh->vertex_count, sizeof *w.sum);
    if (w.degree && w.sum) count_singular(&w);
    for (bool any = w.degree && w.sum; any;) {
        any = false;
        for (size_t h = 0; h < hinges; h++) {
            if (!doubtful[h] || !has_unsure(&w, (bw_hinge)h) || !goes_on(&w, (bw_hinge)h)) continue;
            doubtful[h] = 0;
            --*count;
            any = true;
        }
    }
    bw_free(ctx, w.degree);
    bw_free(ctx, w.sum);
    return ctx->error.status;
}
