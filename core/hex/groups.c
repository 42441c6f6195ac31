#include "hex/groups.h"

static int32_t block_of(const void *mesh, size_t hex) {
    return ((const bw_hex_mesh *)mesh)->block[hex];
}

static int32_t surface_of(const void *skin, size_t quad) {
    return ((const bw_hex_skin *)skin)->quad[quad].surface;
}

/* Counting sort; the place of a key is key, that of BW_NONE is `keys`. */
static bw_status group(bw_context *ctx, int32_t (*key_of)(const void *, size_t), const void *user, size_t count, bw_hex_groups *g) {
    *g = (bw_hex_groups){0};
    size_t keys = 0;
    for (size_t i = 0; i < count; i++)
        if (key_of(user, i) >= (int64_t)keys) keys = (size_t)key_of(user, i) + 1;
    g->key = bw_alloc(ctx, keys + 1, sizeof *g->key);
    g->begin = g->key ? bw_alloc(ctx, keys + 2, sizeof *g->begin) : NULL;
    g->item = g->begin ? bw_alloc(ctx, count, sizeof *g->item) : NULL;
    if (!g->item) return ctx->error.status;
    for (size_t i = 0; i < count; i++) {
        int32_t key = key_of(user, i);
        g->begin[key < 0 ? keys : (size_t)key]++;
    }
    size_t sum = 0;
    for (size_t k = 0; k <= keys; k++) g->begin[k] = sum += g->begin[k];
    g->begin[keys + 1] = sum;
    for (size_t i = count; i-- > 0;) {
        int32_t key = key_of(user, i);
        g->item[--g->begin[key < 0 ? keys : (size_t)key]] = i;
    }
    for (size_t k = 0; k <= keys; k++) {
        if (g->begin[k] == g->begin[k + 1]) continue;
        g->key[g->count] = k < keys ? (int32_t)k : BW_NONE;
        g->begin[g->count++] = g->begin[k];
    }
    g->begin[g->count] = sum;
    return BW_OK;
}

bw_status bw_hex_groups_of_blocks(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_groups *groups) {
    return group(ctx, block_of, mesh, mesh->hex_count, groups);
}

bw_status bw_hex_groups_of_surfaces(bw_context *ctx, const bw_hex_skin *skin, bw_hex_groups *groups) {
    return group(ctx, surface_of, skin, skin->quad_count, groups);
}

void bw_hex_groups_clear(bw_context *ctx, bw_hex_groups *groups) {
    bw_free(ctx, groups->key);
    bw_free(ctx, groups->begin);
    bw_free(ctx, groups->item);
    *groups = (bw_hex_groups){0};
}
