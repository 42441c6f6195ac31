#include "explore/hashset.h"

#include <string.h>

void bw_hashset_clear(bw_context *ctx, bw_hashset *set) {
    bw_free(ctx, set->slot);
    memset(set, 0, sizeof *set);
}

void bw_hashset_empty(bw_hashset *set) {
    if (set->count) memset(set->slot, 0, set->size * sizeof *set->slot);
    set->count = 0;
}

static bool put(uint64_t *slot, size_t size, uint64_t hash) {
    size_t at = (size_t)(hash * 0x9e3779b97f4a7c15u) & (size - 1);
    for (; slot[at]; at = (at + 1) & (size - 1))
        if (slot[at] == hash) return false;
    slot[at] = hash;
    return true;
}

bw_status bw_hashset_add(bw_context *ctx, bw_hashset *set, uint64_t hash, bool *added) {
    if (!hash) hash = 1;
    if (2 * (set->count + 1) > set->size) {
        size_t size = set->size ? 2 * set->size : 1024;
        uint64_t *slot = bw_alloc(ctx, size, sizeof *slot);
        if (!slot) return ctx->error.status;
        for (size_t i = 0; i < set->size; i++)
            if (set->slot[i]) put(slot, size, set->slot[i]);
        bw_free(ctx, set->slot);
        set->slot = slot, set->size = size;
    }
    *added = put(set->slot, set->size, hash);
    set->count += *added;
    return BW_OK;
}
