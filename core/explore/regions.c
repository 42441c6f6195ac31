#include "explore/regions.h"

#include <string.h>

bw_status bw_regions_init(bw_context *ctx, const bw_space *x, bw_regions *r) {
    *r = (bw_regions){.space = x};
    r->label = bw_alloc(ctx, x->block_count, sizeof *r->label);
    r->corners = bw_alloc(ctx, x->block_count, 1);
    r->queue = bw_alloc(ctx, x->block_count, sizeof *r->queue);
    r->list = bw_alloc(ctx, x->patch_count, sizeof *r->list);
    return ctx->error.status;
}

void bw_regions_clear(bw_context *ctx, bw_regions *r) {
    bw_free(ctx, r->label), bw_free(ctx, r->corners), bw_free(ctx, r->queue), bw_free(ctx, r->list);
    memset(r, 0, sizeof *r);
}

static unsigned corners_of(const bw_space *x, const uint8_t *wall, bw_block b) {
    unsigned corners = 0;
    for (int c = 0; c < 8; c++) {
        const bw_patch *at = x->block_corner[b][c];
        corners += wall[at[0]] & wall[at[1]] & wall[at[2]];
    }
    return corners;
}

/* Labels the region of a block that has none; returns its corners, at most 255. */
static unsigned label_region(bw_regions *r, const uint8_t *wall, bw_block from, int32_t label) {
    const bw_space *x = r->space;
    unsigned corners = 0;
    size_t count = 1;
    r->queue[0] = from, r->label[from] = label;
    for (size_t at = 0; at < count; at++) {
        bw_block b = r->queue[at];
        corners += corners_of(x, wall, b);
        for (size_t i = x->side_begin[b]; i < x->side_begin[b + 1]; i++) {
            bw_patch p = x->side[i] >> 1;
            if (wall[p]) continue;
            bw_block next = x->patch_block[p][!(x->side[i] & 1)];
            if (r->label[next] != BW_NONE) continue;
            r->label[next] = label;
            r->queue[count++] = next;
        }
    }
    return corners < 255 ? corners : 255;
}

static void label_all(bw_regions *r, const uint8_t *wall) {
    const bw_space *x = r->space;
    r->count = 0;
    memset(r->label, 0xff, x->block_count * sizeof *r->label);
    for (bw_block b = 0; b < (bw_block)x->block_count; b++) {
        if (r->label[b] != BW_NONE) continue;
        r->corners[r->count] = (uint8_t)label_region(r, wall, b, (int32_t)r->count);
        r->count++;
    }
}

/* An open patch across the direction of an edge of the region, at which two walls meet at a right angle; any open one if it has no edge. */
static bw_patch across_region(const bw_regions *r, const uint8_t *wall, int32_t region) {
    const bw_space *x = r->space;
    bw_patch any = BW_NONE;
    for (size_t b = 0; b < x->block_count; b++)
        for (int c = 0; c < 8 && r->label[b] == region; c++) {
            const bw_patch *at = x->block_corner[b][c];
            for (int k = 0; k < 3; k++) {
                if (wall[at[k]]) continue;
                if (wall[at[(k + 1) % 3]] && wall[at[(k + 2) % 3]]) return at[k];
                if (any == BW_NONE) any = at[k];
            }
        }
    return any;
}

static void add(bw_regions *r, uint8_t *wall, bw_patch p) {
    if (wall[p]) return;
    wall[p] = 1;
    r->list[r->added++] = p;
}

/* Goes straight from a patch until walls stand in the way; where the complex has nothing straight behind an arc, walls beside it take its place. */
static void cut(bw_regions *r, uint8_t *wall, bw_patch from) {
    const bw_space *x = r->space;
    size_t at = r->added;
    for (add(r, wall, from); at < r->added; at++) {
        bw_patch p = r->list[at];
        for (size_t i = x->rim_begin[p]; i < x->rim_begin[p + 1]; i++) {
            const bw_rim *m = &x->rim[i];
            if (!m->inside || (m->straight != BW_NONE && wall[m->straight])) continue;
            if (m->beside[0] != BW_NONE && m->beside[1] != BW_NONE && wall[m->beside[0]] && wall[m->beside[1]]) continue;
            if (m->straight != BW_NONE) add(r, wall, m->straight);
            else add(r, wall, m->beside[0]), add(r, wall, m->beside[1]);
        }
    }
}

bool bw_regions_close(bw_regions *r, uint8_t *wall) {
    r->added = 0;
    for (bool again = true; again;) {
        again = false;
        label_all(r, wall);
        for (size_t i = 0; i < r->count; i++) {
            if (r->corners[i] == 8) continue;
            bw_patch p = r->corners[i] ? BW_NONE : across_region(r, wall, (int32_t)i);
            if (p == BW_NONE) return false;
            cut(r, wall, p);
            again = true;
        }
    }
    return true;
}

size_t bw_regions_least(bw_regions *r, const uint8_t *wall) {
    size_t corners = 0;
    label_all(r, wall);
    for (size_t b = 0; b < r->space->block_count; b++) corners += corners_of(r->space, wall, (bw_block)b);
    return (corners + 7) / 8 > r->count ? (corners + 7) / 8 : r->count;
}
