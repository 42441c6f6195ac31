#include "explore/box.h"

#include <string.h>

bw_status bw_box_layout_init(bw_context *ctx, const bw_space *space, bw_box_layout *l) {
    memset(l, 0, sizeof *l);
    l->box.block = bw_alloc(ctx, space->block_count, sizeof *l->box.block);
    l->box.chart = bw_alloc(ctx, space->block_count, sizeof *l->box.chart);
    l->place = bw_alloc(ctx, space->block_count, sizeof *l->place);
    for (size_t b = 0; b < space->block_count && ctx->error.status == BW_OK; b++) l->place[b] = BW_NONE;
    return ctx->error.status;
}

void bw_box_layout_clear(bw_context *ctx, bw_box_layout *l) {
    bw_free(ctx, l->box.block), bw_free(ctx, l->box.chart), bw_free(ctx, l->place);
    memset(l, 0, sizeof *l);
}

static void widen(const bw_space *s, bw_block b, const bw_transition *chart, int64_t low[3], int64_t high[3]) {
    int64_t ends[2][3] = {{0, 0, 0}, {0, 0, 0}}, at[3];
    memcpy(ends[1], s->block_extent[b], sizeof ends[1]);
    for (int e = 0; e < 2; e++) {
        bw_transition_apply(chart, ends[e], at);
        for (int k = 0; k < 3; k++) {
            if (at[k] < low[k]) low[k] = at[k];
            if (at[k] > high[k]) high[k] = at[k];
        }
    }
}

const bw_block_box *bw_box_lay_out(const bw_space *s, const uint8_t *wall, bw_block from, bw_box_layout *l) {
    bw_block_box *box = &l->box;
    int64_t low[3] = {0, 0, 0}, high[3] = {0, 0, 0};
    box->count = 1;
    box->block[0] = from, l->place[from] = 0;
    box->chart[0] = (bw_transition){{0, 0, 0}, 0};
    for (size_t at = 0; at < box->count; at++) {
        bw_block b = box->block[at];
        bw_transition chart = box->chart[at];
        widen(s, b, &chart, low, high);
        for (size_t i = s->side_begin[b]; i < s->side_begin[b + 1]; i++) {
            bw_patch p = s->side[i] >> 1;
            if (wall[p]) continue;
            int slot = s->side[i] & 1;
            bw_block next = s->patch_block[p][!slot];
            if (l->place[next] != BW_NONE) continue;
            bw_transition in = slot ? bw_transition_inverse(&s->across[p]) : s->across[p];
            l->place[next] = (int32_t)box->count;
            box->block[box->count] = next;
            box->chart[box->count++] = bw_transition_compose(&chart, &in);
        }
    }
    for (size_t i = 0; i < box->count; i++) {
        l->place[box->block[i]] = BW_NONE;
        for (int k = 0; k < 3; k++) box->chart[i].shift[k] -= low[k];
    }
    for (int k = 0; k < 3; k++) box->extent[k] = high[k] - low[k];
    return box;
}
