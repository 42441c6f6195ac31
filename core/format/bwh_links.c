#include "format/bwh_links.h"

#include <string.h>

bw_status bw_bwh_links_init(bw_context *ctx, size_t vertices, bw_bwh_links *l) {
    *l = (bw_bwh_links){.row = bw_alloc(ctx, vertices, sizeof *l->row)};
    if (!l->row) return ctx->error.status;
    memset(l->row, 0xff, vertices * sizeof *l->row);
    return BW_OK;
}

void bw_bwh_links_clear(bw_context *ctx, bw_bwh_links *l) {
    bw_free(ctx, l->row), bw_free(ctx, l->to);
    *l = (bw_bwh_links){0};
}

const int32_t *bw_bwh_links_of(const bw_bwh_links *l, int32_t v) {
    static const int32_t none[BW_BWH_LINKS] = {-1, -1, -1, -1, -1, -1, -1, -1};
    return l->row[v] < 0 ? none : l->to[l->row[v]];
}

int bw_bwh_links_find(const bw_bwh_links *l, int32_t from, int32_t to) {
    const int32_t *list = bw_bwh_links_of(l, from);
    for (int i = 0; i < BW_BWH_LINKS && list[i] >= 0; i++)
        if (list[i] == to) return i;
    return -1;
}

static bw_status add_one(bw_context *ctx, bw_bwh_links *l, int32_t from, int32_t to) {
    if (l->row[from] < 0) {
        bw_status status = bw_reserve(ctx, &l->to, &l->room, l->row_count + 1);
        if (status != BW_OK) return status;
        l->row[from] = (int32_t)l->row_count++;
        memset(l->to[l->row[from]], 0xff, sizeof *l->to);
    }
    int32_t *list = l->to[l->row[from]];
    for (int i = 0; i < BW_BWH_LINKS && list[i] != to; i++)
        if (list[i] < 0) {
            list[i] = to;
            break;
        }
    return BW_OK;
}

bw_status bw_bwh_links_add(bw_context *ctx, bw_bwh_links *l, int32_t a, int32_t b) {
    bw_status status = add_one(ctx, l, a, b);
    return status == BW_OK ? add_one(ctx, l, b, a) : status;
}
