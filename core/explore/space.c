/* The rims of patches: what is straight behind each arc, and what stands beside it. The rest of the space is in sheets.c. */
#include "explore/space.h"

#include <stdlib.h>
#include <string.h>

#include "explore/sheets.h"

/* ---- rims ---------------------------------------------------------------------------------------------------------- */

/* A patch seen from the block on one of its sides, at one arc of its rim: the two of the same block and place face each other there. */
typedef struct {
    bw_block block;
    int8_t axis;        /* along which the arc runs in the block's chart */
    uint8_t side;       /* of the block's box, in which the patch lies */
    int64_t at[3];      /* low end of the arc */
    int32_t rim;        /* 2 * index + slot */
} sight;

static int compare_sights(const void *a, const void *b) {
    const sight *x = a, *y = b;
    if (x->block != y->block) return x->block < y->block ? -1 : 1;
    if (x->axis != y->axis) return x->axis - y->axis;
    for (int k = 0; k < 3; k++)
        if (x->at[k] != y->at[k]) return x->at[k] < y->at[k] ? -1 : 1;
    return (x->rim > y->rim) - (x->rim < y->rim);
}

/* Where the arcs of one side of a patch lie, in the chart of its first block, and then from both sides. */
static size_t look(const bw_complex *x, bw_patch p, int side, const bw_transition *back, sight *out) {
    int normal = x->patch_side[p][0] >> 1, u = (normal + 1) % 3, v = (normal + 2) % 3;
    int along = side & 1 ? v : u, across = side & 1 ? u : v;
    bool high = side == 1 || side == 2, forward = side < 2;
    int64_t at[3];
    memcpy(at, x->patch_low[p], sizeof at);
    if (high) at[across] += x->patch_extent[p][!(side & 1)];
    if (!forward) at[along] += x->patch_extent[p][side & 1];
    size_t count = 0;
    for (size_t i = x->patch_chain_begin[4 * p + side]; i < x->patch_chain_begin[4 * p + side + 1]; i++) {
        int64_t length = x->arc_length[x->patch_chain[i] >> 1], low[3], high_end[3];
        memcpy(low, at, sizeof low);
        at[along] += forward ? length : -length;
        memcpy(high_end, at, sizeof high_end);
        for (int slot = 0; slot < 2 && x->patch_block[p][slot] != BW_NONE; slot++) {
            int64_t a[3], b[3];
            int axis = along;
            memcpy(a, low, sizeof a), memcpy(b, high_end, sizeof b);
            if (slot) {
                bw_transition_apply(back, low, a), bw_transition_apply(back, high_end, b);
                axis = bw_rotation_image[back->rotation][along];
            }
            sight *s = &out[count++];
            *s = (sight){x->patch_block[p][slot], (int8_t)axis, x->patch_side[p][slot], {0, 0, 0}, (int32_t)(2 * i) + slot};
            for (int k = 0; k < 3; k++) s->at[k] = a[k] < b[k] ? a[k] : b[k];
        }
    }
    return count;
}

/* From the chart of the first block of a patch to that of the second. */
static bw_transition back_across(const bw_space *s, bw_patch p) { return bw_transition_inverse(&s->across[p]); }

typedef struct {
    int32_t *mate;     /* [2 * rim + slot]: the other patch of the sector there */
    uint8_t *quarters; /* of the sector: 1 or 2 */
    bw_patch *patch;   /* [rim] */
} sectors;

static bw_status find_sectors(bw_context *ctx, const bw_complex *x, const bw_space *space, sectors *s) {
    size_t uses = x->patch_chain_begin[4 * x->patch_count], count = 0;
    sight *all = bw_alloc(ctx, 2 * uses, sizeof *all);
    bw_status status = ctx->error.status;
    for (bw_patch p = 0; p < (bw_patch)x->patch_count && status == BW_OK; p++) {
        bw_transition back = back_across(space, p);
        for (int side = 0; side < 4; side++) count += look(x, p, side, &back, &all[count]);
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) s->patch[i] = p;
    }
    if (status == BW_OK) qsort(all, count, sizeof *all, compare_sights);
    for (size_t i = 0; i < count && status == BW_OK; i += 2) {
        const sight *a = &all[i], *b = &all[i + 1];
        bool same = i + 1 < count && a->block == b->block && a->axis == b->axis && !memcmp(a->at, b->at, sizeof a->at);
        if (!same) {
            status = bw_fail(ctx, BW_E_CHECK, "block %d has a patch that ends where no other begins", a->block);
            break;
        }
        s->mate[a->rim] = b->rim, s->mate[b->rim] = a->rim;
        s->quarters[a->rim] = s->quarters[b->rim] = a->side == b->side ? 2 : 1;
    }
    bw_free(ctx, all);
    return status;
}

/* The patch two quarter turns away from a rim; BW_NONE: none is. */
static bw_patch straight_of(const bw_space *space, const sectors *s, int32_t rim) {
    int turned = 0;
    while (turned < 2) {
        if (space->patch_block[s->patch[rim >> 1]][rim & 1] == BW_NONE) return BW_NONE;
        turned += s->quarters[rim];
        rim = s->mate[rim] ^ 1;
    }
    return turned == 2 ? s->patch[rim >> 1] : BW_NONE;
}

static bw_status make_rims(bw_context *ctx, const bw_complex *x, bw_space *space) {
    size_t uses = x->patch_chain_begin[4 * x->patch_count];
    sectors s = {bw_alloc(ctx, 2 * uses, sizeof *s.mate), bw_alloc(ctx, 2 * uses, 1), bw_alloc(ctx, uses, sizeof *s.patch)};
    space->rim = bw_alloc(ctx, uses, sizeof *space->rim);
    space->rim_begin = bw_alloc(ctx, x->patch_count + 1, sizeof *space->rim_begin);
    bw_status status = ctx->error.status == BW_OK ? find_sectors(ctx, x, space, &s) : ctx->error.status;
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++) space->rim_begin[p + 1] = x->patch_chain_begin[4 * p + 4];
    for (size_t i = 0; i < uses && status == BW_OK; i++) {
        bw_rim *r = &space->rim[i];
        bw_patch p = s.patch[i];
        r->arc = x->patch_chain[i] >> 1;
        r->inside = !(x->arc_flags[r->arc] & (BW_ARC_SINGULAR | BW_ARC_FEATURE | BW_ARC_BOUNDARY));
        r->straight = r->inside ? straight_of(space, &s, (int32_t)(2 * i)) : BW_NONE;
        for (int slot = 0; slot < 2; slot++) {
            bool flat = x->patch_block[p][slot] == BW_NONE || s.quarters[2 * i + (size_t)slot] == 2;
            r->beside[slot] = flat ? BW_NONE : s.patch[s.mate[2 * i + (size_t)slot] >> 1];
        }
    }
    bw_free(ctx, s.mate), bw_free(ctx, s.quarters), bw_free(ctx, s.patch);
    return status;
}

/* ---- blocks -------------------------------------------------------------------------------------------------------- */

static bw_status list_sides(bw_context *ctx, bw_space *s) {
    s->side_begin = bw_alloc(ctx, s->block_count + 2, sizeof *s->side_begin);
    s->side = bw_alloc(ctx, 2 * s->patch_count, sizeof *s->side);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    for (size_t i = 0; i < 2 * s->patch_count; i++)
        if (s->patch_block[i / 2][i % 2] != BW_NONE) s->side_begin[s->patch_block[i / 2][i % 2] + 2]++;
    for (size_t b = 2; b < s->block_count + 2; b++) s->side_begin[b] += s->side_begin[b - 1];
    for (size_t i = 0; i < 2 * s->patch_count; i++)
        if (s->patch_block[i / 2][i % 2] != BW_NONE) s->side[s->side_begin[s->patch_block[i / 2][i % 2] + 1]++] = (int32_t)i;
    return BW_OK;
}

/* Notes a patch at the corners of the block on one of its sides at which it lies. */
static void note_corners(const bw_complex *x, bw_space *s, bw_patch p, int slot, const bw_transition *back) {
    int64_t low[3], high[3], a[3], b[3];
    int normal = x->patch_side[p][0] >> 1;
    memcpy(low, x->patch_low[p], sizeof low), memcpy(high, low, sizeof high);
    for (int i = 0; i < 2; i++) high[(normal + 1 + i) % 3] += x->patch_extent[p][i];
    memcpy(a, low, sizeof a), memcpy(b, high, sizeof b);
    if (slot) bw_transition_apply(back, low, a), bw_transition_apply(back, high, b);
    bw_block block = x->patch_block[p][slot];
    for (int c = 0; c < 8; c++) {
        bool in = true;
        for (int k = 0; k < 3; k++) {
            int64_t at = c >> k & 1 ? x->block_extent[block][k] : 0;
            in = in && at >= (a[k] < b[k] ? a[k] : b[k]) && at <= (a[k] < b[k] ? b[k] : a[k]);
        }
        if (in) s->block_corner[block][c][x->patch_side[p][slot] >> 1] = p;
    }
}

static bw_status find_corners(bw_context *ctx, const bw_complex *x, bw_space *s) {
    s->block_corner = bw_alloc(ctx, x->block_count, sizeof *s->block_corner);
    if (!s->block_corner) return ctx->error.status;
    for (size_t b = 0; b < x->block_count; b++)
        for (int c = 0; c < 24; c++) s->block_corner[b][c / 3][c % 3] = BW_NONE;
    for (bw_patch p = 0; p < (bw_patch)x->patch_count; p++) {
        note_corners(x, s, p, 0, NULL);
        if (x->patch_block[p][1] == BW_NONE) continue;
        bw_transition back = back_across(s, p);
        note_corners(x, s, p, 1, &back);
    }
    for (size_t b = 0; b < x->block_count; b++)
        for (int c = 0; c < 24; c++)
            if (s->block_corner[b][c / 3][c % 3] == BW_NONE) return bw_fail(ctx, BW_E_CHECK, "no patch is at corner %d of block %zu", c / 3, b);
    return BW_OK;
}

static uint64_t mix(uint64_t z) { /* splitmix64 */
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

static bw_status describe(bw_context *ctx, const bw_cells *cells, const bw_complex *x, bw_space *s) {
    s->patch_block = bw_alloc(ctx, s->patch_count, sizeof *s->patch_block);
    s->across = bw_alloc(ctx, s->patch_count, sizeof *s->across);
    s->block_extent = bw_alloc(ctx, s->block_count, sizeof *s->block_extent);
    s->given = bw_alloc(ctx, s->patch_count, 1);
    s->must = bw_alloc(ctx, s->patch_count, 1);
    s->patch_key = bw_alloc(ctx, s->patch_count, sizeof *s->patch_key);
    s->block_key = bw_alloc(ctx, s->block_count, sizeof *s->block_key);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    memcpy(s->patch_block, x->patch_block, s->patch_count * sizeof *s->patch_block);
    memcpy(s->block_extent, x->block_extent, s->block_count * sizeof *s->block_extent);
    for (size_t p = 0; p < s->patch_count; p++) {
        if (x->patch_block[p][1] != BW_NONE) s->across[p] = bw_complex_across(cells, x, (bw_patch)p);
        s->given[p] = (x->patch_flags[p] & (BW_PATCH_BOUNDARY | BW_PATCH_FEATURE)) != 0;
        s->must[p] = s->given[p] || x->patch_flags[p] & BW_PATCH_SINGULAR;
        s->patch_key[p] = mix((p + 1) * 0x9e3779b97f4a7c15u);
    }
    for (size_t b = 0; b < s->block_count; b++) s->block_key[b] = mix((b + 1) * 0xd1342543de82ef95u);
    return BW_OK;
}

bw_status bw_space_init(bw_context *ctx, const bw_cells *cells, const bw_complex *x, bw_space *s) {
    *s = (bw_space){.patch_count = x->patch_count, .block_count = x->block_count, .arc_count = x->arc_count};
    bw_status status = describe(ctx, cells, x, s);
    if (status == BW_OK) status = make_rims(ctx, x, s);
    if (status == BW_OK) status = list_sides(ctx, s);
    if (status == BW_OK) status = find_corners(ctx, x, s);
    if (status == BW_OK) status = bw_sheets_find(ctx, x, s);
    if (status == BW_OK) status = bw_sheets_link(ctx, s);
    return status;
}

void bw_space_clear(bw_context *ctx, bw_space *s) {
    void *blocks[] = {s->block_corner, s->patch_block, s->across, s->block_extent, s->given, s->must, s->rim_begin, s->rim, s->side_begin, s->side, s->patch_key, s->block_key,
                      s->sheet_begin, s->sheet_patch, s->sheet_seeds, s->sheet_line, s->sheet_component, s->of_patch_begin, s->of_patch,
                      s->watcher_begin, s->watcher, s->link_begin, s->link};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(s, 0, sizeof *s);
}
