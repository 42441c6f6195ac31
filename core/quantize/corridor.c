#include "quantize/corridor.h"

#include <string.h>

/* A stop is a point in one of the corridor's blocks; stops of the i-th block start at offset[i]. */
struct bw_corridor_entry {
    int64_t distance;
    int32_t stop;
};

void bw_corridor_init(bw_context *ctx, const bw_surface *surface, bw_corridor *k) { *k = (bw_corridor){.ctx = ctx, .surface = surface}; }

void bw_corridor_clear(bw_corridor *k) {
    void *blocks[] = {k->slot, k->path, k->blocks, k->rotation, k->offset, k->distance, k->from, k->before, k->done, k->heap, k->term};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(k->ctx, blocks[i]);
    *k = (bw_corridor){0};
}

void bw_corridor_start(bw_corridor *k, bw_block block) { k->block = block, k->count = 0; }

bw_status bw_corridor_cross(bw_corridor *k, int32_t slot) {
    if (bw_reserve(k->ctx, &k->slot, &k->slot_room, k->count + 1)) return k->ctx->error.status;
    k->slot[k->count++] = slot;
    return BW_OK;
}

/* ---- the search ---- */

static bool before(const struct bw_corridor_entry *a, const struct bw_corridor_entry *b) {
    return a->distance != b->distance ? a->distance < b->distance : a->stop < b->stop;
}

static bw_status push(bw_corridor *k, int32_t stop, int64_t distance, int32_t from, int32_t stop_before) {
    if (k->done[stop] || (k->distance[stop] >= 0 && k->distance[stop] <= distance)) return BW_OK;
    if (bw_reserve(k->ctx, &k->heap, &k->heap_room, k->heap_count + 1)) return k->ctx->error.status;
    k->distance[stop] = distance, k->from[stop] = from, k->before[stop] = stop_before;
    struct bw_corridor_entry entry = {distance, stop};
    size_t i = k->heap_count++;
    for (; i > 0 && before(&entry, &k->heap[(i - 1) / 2]); i = (i - 1) / 2) k->heap[i] = k->heap[(i - 1) / 2];
    k->heap[i] = entry;
    return BW_OK;
}

static int32_t pop(bw_corridor *k) {
    struct bw_corridor_entry top = k->heap[0], last = k->heap[--k->heap_count];
    size_t i = 0;
    for (size_t child; (child = 2 * i + 1) < k->heap_count; i = child) {
        if (child + 1 < k->heap_count && before(&k->heap[child + 1], &k->heap[child])) child++;
        if (!before(&k->heap[child], &last)) break;
        k->heap[i] = k->heap[child];
    }
    k->heap[i] = last;
    return top.stop;
}

/* Blocks, rotations and offsets; no stop is reached yet. */
static bw_status prepare(bw_corridor *k) {
    const bw_surface *s = k->surface;
    size_t n = k->count + 1, stops = 0;
    if (bw_reserve(k->ctx, &k->blocks, &k->blocks_room, n) || bw_reserve(k->ctx, &k->rotation, &k->rotation_room, n) ||
        bw_reserve(k->ctx, &k->offset, &k->offset_room, n + 1))
        return k->ctx->error.status;
    k->blocks[0] = k->block, k->rotation[0] = 0;
    for (size_t i = 0; i < n; i++) {
        if (i) {
            bw_transition across = bw_surface_cross(s, k->slot[i - 1]);
            k->blocks[i] = bw_surface_slot_block(s, k->slot[i - 1] ^ 1);
            k->rotation[i] = bw_rotation_compose(across.rotation, k->rotation[i - 1]);
        }
        k->offset[i] = stops;
        stops += s->point_begin[k->blocks[i] + 1] - s->point_begin[k->blocks[i]];
    }
    k->offset[n] = stops;
    if (bw_reserve(k->ctx, &k->distance, &k->distance_room, stops) || bw_reserve(k->ctx, &k->from, &k->from_room, stops) ||
        bw_reserve(k->ctx, &k->before, &k->before_room, stops) || bw_reserve(k->ctx, &k->done, &k->done_room, stops))
        return k->ctx->error.status;
    memset(k->distance, 0xff, stops * sizeof *k->distance);
    memset(k->done, 0, stops);
    k->heap_count = 0;
    return BW_OK;
}

static int32_t stop_of(const bw_corridor *k, size_t i, int32_t point) {
    return (int32_t)(k->offset[i] + (size_t)point - k->surface->point_begin[k->blocks[i]]);
}

/* The block of a stop in the corridor. */
static size_t place_of(const bw_corridor *k, int32_t stop) {
    size_t low = 0, high = k->count + 1;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (k->offset[middle] <= (size_t)stop) low = middle;
        else high = middle;
    }
    return low;
}

/* From a stop along all edges at it and across the slots of the corridor. */
static bw_status spread(bw_corridor *k, int32_t stop) {
    const bw_surface *s = k->surface;
    size_t i = place_of(k, stop);
    int32_t point = (int32_t)(s->point_begin[k->blocks[i]] + (size_t)stop - k->offset[i]);
    int64_t distance = k->distance[stop];
    for (size_t r = s->point_rim_begin[point]; r < s->point_rim_begin[point + 1]; r++) {
        int32_t rim = s->point_rim[r], slot = bw_surface_rim_slot(s, rim), back = bw_surface_rim_turn(s, rim, false);
        int32_t edge[2] = {s->rim_edge[rim], s->rim_edge[back]}, end[2] = {bw_surface_rim_end(s, rim), s->rim_point[back]};
        for (int j = 0; j < 2; j++) {
            int64_t length = s->complex->arc_length[s->edge[edge[j]].use >> 1];
            if (push(k, stop_of(k, i, end[j]), distance + length, edge[j], stop)) return k->ctx->error.status;
        }
        bool on = i < k->count && slot == k->slot[i], off = i > 0 && slot == (k->slot[i - 1] ^ 1);
        if (on && push(k, stop_of(k, i + 1, s->rim_point[rim ^ 1]), distance, BW_NONE, stop)) return k->ctx->error.status;
        if (off && push(k, stop_of(k, i - 1, s->rim_point[rim ^ 1]), distance, BW_NONE, stop)) return k->ctx->error.status;
    }
    return BW_OK;
}

static bw_status read_path(bw_corridor *k, int32_t stop) {
    const bw_surface *s = k->surface;
    k->path_count = 0;
    for (; k->before[stop] != BW_NONE; stop = k->before[stop]) {
        if (k->from[stop] == BW_NONE) continue;
        size_t i = place_of(k, stop);
        const bw_surface_edge *e = &s->edge[k->from[stop]];
        bool up = stop == stop_of(k, i, e->point[1]);
        bw_rotation back = bw_rotation_inverse(k->rotation[i]);
        int8_t axis = bw_rotation_image[back][e->axis];
        if (bw_reserve(k->ctx, &k->path, &k->path_room, k->path_count + 1)) return k->ctx->error.status;
        k->path[k->path_count++] = (bw_corridor_step){up ? e->use : e->use ^ 1, axis, (int8_t)(bw_rotation_sign[back][axis] * (up ? 1 : -1))};
    }
    return BW_OK;
}

bw_status bw_corridor_find(bw_corridor *k, const int32_t *from, size_t from_count, const int32_t *to, size_t to_count) {
    if (prepare(k)) return k->ctx->error.status;
    for (size_t i = 0; i < from_count; i++)
        if (push(k, stop_of(k, 0, from[i]), 0, BW_NONE, BW_NONE)) return k->ctx->error.status;
    while (k->heap_count) {
        int32_t stop = pop(k);
        if (k->done[stop]) continue;
        k->done[stop] = 1;
        for (size_t i = 0; i < to_count; i++)
            if (stop == stop_of(k, k->count, to[i])) return read_path(k, stop);
        if (spread(k, stop)) return k->ctx->error.status;
    }
    return bw_fail(k->ctx, BW_E_CHECK, "block surfaces: the blocks of a corridor are not joined");
}

/* ---- what a path says ---- */

void bw_corridor_displacement(const bw_corridor *k, const int64_t *length, int64_t out[3]) {
    out[0] = out[1] = out[2] = 0;
    for (size_t i = 0; i < k->path_count; i++) out[k->path[i].axis] += k->path[i].sign * length[k->path[i].use >> 1];
}

bw_status bw_corridor_constrain(bw_corridor *k, const int sign[3], int64_t bound, bw_rule rule, bw_constraint_list *list) {
    size_t n = 0;
    if (bw_reserve(k->ctx, &k->term, &k->term_room, k->path_count)) return k->ctx->error.status;
    for (size_t i = 0; i < k->path_count; i++)
        if (sign[k->path[i].axis]) k->term[n++] = (bw_term){k->path[i].use >> 1, sign[k->path[i].axis] * k->path[i].sign};
    return bw_constraint_add(k->ctx, list, rule, BW_AT_LEAST, k->term, n, bound);
}
