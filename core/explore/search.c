#include "explore/search.h"

#include <string.h>

bw_status bw_search_init(bw_context *ctx, const bw_space *space, bw_pricer *pricer, const uint8_t *stays, uint64_t seed, bw_search *s) {
    *s = (bw_search){.ctx = ctx, .space = space, .pricer = pricer, .stays = stays, .best_cost = INT64_MAX, .work = UINT64_MAX, .since = bw_seconds_now()};
    s->random.state = seed * 0x9e3779b97f4a7c15u + 0x632be59bd9b4e019u;
    s->wall = bw_alloc(ctx, space->patch_count, 1);
    s->best = bw_alloc(ctx, space->patch_count, 1);
    s->region_hash = bw_alloc(ctx, space->block_count, sizeof *s->region_hash);
    s->region_block = bw_alloc(ctx, space->block_count, sizeof *s->region_block);
    bw_status status = ctx->error.status;
    return status == BW_OK ? bw_regions_init(ctx, space, &s->regions) : status;
}

void bw_search_clear(bw_search *s) {
    if (!s->ctx) return;
    bw_free(s->ctx, s->wall), bw_free(s->ctx, s->best), bw_free(s->ctx, s->region_hash), bw_free(s->ctx, s->region_block);
    bw_regions_clear(s->ctx, &s->regions);
}

uint64_t bw_search_random(bw_search *s) {
    uint64_t z = s->random.state += 0x9e3779b97f4a7c15u;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

bool bw_search_is_cut(bw_search *s) {
    const bw_memory *memory = &s->ctx->memory;
    if (s->ctx->finish && *s->ctx->finish) s->cut = BW_CUT_FINISH, s->ctx->finished = true;
    else if (memory->limit && memory->used > memory->limit - memory->limit / 8) s->cut = BW_CUT_MEMORY; /* the rest is for what comes after */
    else if (s->seconds > 0 && bw_seconds_now() - s->since > s->seconds) s->cut = BW_CUT_TIME;
    return s->cut != BW_CUT_NOT;
}

bool bw_search_spent(bw_search *s, uint64_t until) {
    s->evaluations++;
    if (s->evaluations % 64 == 0) {
        bw_search_is_cut(s);
        if (s->evaluations % 1024 == 0 && s->work != UINT64_MAX) bw_progress(s->ctx, (double)s->evaluations / (double)s->work);
    }
    return s->cut != BW_CUT_NOT || s->evaluations >= until || s->evaluations >= s->work;
}

void bw_search_offer(bw_search *s, const uint8_t *wall, int64_t cost, size_t blocks) {
    if (cost >= s->best_cost) return;
    memcpy(s->best, wall, s->space->patch_count);
    s->best_cost = cost, s->best_blocks = blocks, s->improved = s->evaluations;
    bw_note(s->ctx, "best %g, %zu block%s", bw_cost_value(cost), blocks, blocks == 1 ? "" : "s");
}

/* The total over the regions that are labelled. */
static bw_status price_regions(bw_search *s, int64_t *cost) {
    bw_status status = BW_OK;
    if (bw_pricer_bytes(s->pricer) > BW_PRICES_MOST) bw_pricer_forget(s->ctx, s->pricer);
    else bw_pricer_empty(s->pricer);
    if (bw_pricer_counts(s->pricer)) {
        bw_pricer_add(s->pricer, 0);
        *cost = bw_pricer_total(s->pricer) * (int64_t)s->regions.count;
        return BW_OK;
    }
    const bw_space *x = s->space;
    for (size_t r = 0; r < s->regions.count; r++) s->region_hash[r] = 0, s->region_block[r] = BW_NONE;
    for (size_t b = 0; b < x->block_count; b++) {
        int32_t r = s->regions.label[b];
        s->region_hash[r] ^= x->block_key[b];
        if (s->region_block[r] == BW_NONE) s->region_block[r] = (bw_block)b;
    }
    for (size_t r = 0; r < s->regions.count && status == BW_OK; r++) {
        int32_t price;
        status = bw_pricer_price(s->ctx, s->pricer, s->region_hash[r], s->wall, s->region_block[r], &price);
        if (status == BW_OK) bw_pricer_add(s->pricer, price);
    }
    *cost = bw_pricer_total(s->pricer);
    return status;
}

static bw_status price_wall(bw_search *s, int64_t *cost) {
    if (!bw_regions_close(&s->regions, s->wall))
        return bw_fail(s->ctx, BW_E_CHECK, "the walls that exploration chose make blocks that are neither cuboids nor close on themselves");
    bw_status status = price_regions(s, cost);
    if (status == BW_OK) bw_search_offer(s, s->wall, *cost, s->regions.count);
    return status;
}

bw_status bw_search_price(bw_search *s, const uint8_t *wall, int64_t *cost) {
    if (wall != s->wall) memcpy(s->wall, wall, s->space->patch_count);
    return price_wall(s, cost);
}

bw_status bw_search_price_serial(bw_search *s, const bw_serial *serial, int64_t *cost) {
    bw_serial_walls(serial, s->wall);
    return price_wall(s, cost);
}

int64_t bw_search_bound(bw_search *s, const uint8_t *wall) {
    bw_pricer_empty(s->pricer);
    bw_pricer_add(s->pricer, 0);
    return bw_pricer_total(s->pricer) * (int64_t)bw_regions_least(&s->regions, wall);
}
