#include "explore/tiling.h"

#include <string.h>

#include "explore/regions.h"

enum { WALL, LABEL, BOX, COUNT, PRICE_ADDED, PRICE_REMOVED };

/* ---- changes and the way back -------------------------------------------------------------------------------------- */

/* Room for all that one cut or join changes, so that noting it cannot fail half-way. */
static bw_status make_room(bw_context *ctx, bw_tiling *t) {
    bw_status status = bw_reserve(ctx, &t->log, &t->room, t->logged + t->space->patch_count + t->space->block_count + 16);
    if (status == BW_OK) status = bw_reserve(ctx, &t->old_box, &t->old_room, t->old_count + 4);
    return status;
}

static void note(bw_tiling *t, int kind, int32_t at, int64_t old) { t->log[t->logged++] = (bw_tiling_change){kind, at, old}; }

static void set_wall(bw_tiling *t, bw_patch p, uint8_t on) {
    note(t, WALL, p, t->wall[p]);
    t->wall[p] = on;
    t->hash ^= t->space->patch_key[p];
}

static void set_box(bw_tiling *t, bw_block name, bw_tiling_box to) {
    t->old_box[t->old_count] = t->of[name];
    note(t, BOX, name, (int64_t)t->old_count++);
    t->of[name] = to;
}

static void add_price(bw_tiling *t, int32_t price) {
    note(t, PRICE_ADDED, price, 0);
    bw_pricer_add(t->pricer, price);
}

static void remove_price(bw_tiling *t, int32_t price) {
    note(t, PRICE_REMOVED, price, 0);
    bw_pricer_remove(t->pricer, price);
}

void bw_tiling_keep(bw_tiling *t) { t->logged = t->old_count = 0; }

void bw_tiling_undo(bw_tiling *t, size_t mark) {
    while (t->logged > mark) {
        bw_tiling_change c = t->log[--t->logged];
        switch (c.kind) {
        case WALL: t->wall[c.at] = (uint8_t)c.old, t->hash ^= t->space->patch_key[c.at]; break;
        case LABEL: t->box[c.at] = (bw_block)c.old; break;
        case BOX: t->of[c.at] = t->old_box[c.old]; break;
        case COUNT: t->count = (size_t)c.old; break;
        case PRICE_ADDED: bw_pricer_remove(t->pricer, c.at); break;
        default: bw_pricer_add(t->pricer, c.at); break;
        }
    }
    if (!mark) t->old_count = 0;
}

/* ---- setting up ---------------------------------------------------------------------------------------------------- */

void bw_tiling_clear(bw_context *ctx, bw_tiling *t) {
    void *blocks[] = {t->wall, t->box, t->of, t->log, t->old_box, t->face, t->mark, t->seen, t->queue};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(t, 0, sizeof *t);
}

/* Gives the blocks reached from one without crossing a wall, none of which has it, to the box of a name. Returns how many they are. */
static int32_t spread(bw_tiling *t, bw_block from, bw_block name, bool noted, uint64_t *hash) {
    const bw_space *s = t->space;
    size_t count = 1;
    t->queue[0] = from;
    *hash = 0;
    if (noted) note(t, LABEL, from, t->box[from]);
    t->box[from] = name;
    for (size_t at = 0; at < count; at++) {
        bw_block b = t->queue[at];
        *hash ^= s->block_key[b];
        for (size_t i = s->side_begin[b]; i < s->side_begin[b + 1]; i++) {
            bw_patch p = s->side[i] >> 1;
            if (t->wall[p]) continue;
            bw_block next = s->patch_block[p][!(s->side[i] & 1)];
            if (t->box[next] == name) continue;
            if (noted) note(t, LABEL, next, t->box[next]);
            t->box[next] = name;
            t->queue[count++] = next;
        }
    }
    return (int32_t)count;
}

bw_status bw_tiling_set(bw_context *ctx, bw_tiling *t, const uint8_t *wall) {
    const bw_space *s = t->space;
    bw_status status = BW_OK;
    if (wall != t->wall) memcpy(t->wall, wall, s->patch_count);
    bw_tiling_keep(t);
    bw_pricer_empty(t->pricer);
    t->count = 0, t->hash = 0;
    for (size_t p = 0; p < s->patch_count; p++)
        if (wall[p] && !s->given[p]) t->hash ^= s->patch_key[p];
    for (size_t b = 0; b < s->block_count; b++) t->box[b] = BW_NONE;
    for (bw_block b = 0; b < (bw_block)s->block_count && status == BW_OK; b++) {
        if (t->box[b] != BW_NONE) continue;
        t->of[b].size = spread(t, b, b, false, &t->of[b].hash);
        status = bw_pricer_price(ctx, t->pricer, t->of[b].hash, t->wall, b, &t->of[b].price);
        if (status == BW_OK) bw_pricer_add(t->pricer, t->of[b].price);
        t->count++;
    }
    return status;
}

bw_status bw_tiling_init(bw_context *ctx, const bw_space *s, bw_pricer *pricer, const uint8_t *stays, const uint8_t *wall, bw_tiling *t) {
    *t = (bw_tiling){.space = s, .pricer = pricer, .stays = stays};
    t->wall = bw_alloc(ctx, s->patch_count, 1);
    t->box = bw_alloc(ctx, s->block_count, sizeof *t->box);
    t->of = bw_alloc(ctx, s->block_count, sizeof *t->of);
    t->face = bw_alloc(ctx, s->patch_count, sizeof *t->face);
    t->mark = bw_alloc(ctx, s->patch_count, sizeof *t->mark);
    t->seen = bw_alloc(ctx, s->block_count, sizeof *t->seen);
    t->queue = bw_alloc(ctx, s->block_count, sizeof *t->queue);
    return ctx->error.status == BW_OK ? bw_tiling_set(ctx, t, wall) : ctx->error.status;
}

/* ---- cuts ---------------------------------------------------------------------------------------------------------- */

/* Marks of earlier rounds no longer count. */
static void next_round(bw_tiling *t) {
    if (++t->round) return;
    memset(t->mark, 0, t->space->patch_count * sizeof *t->mark);
    memset(t->seen, 0, t->space->block_count * sizeof *t->seen);
    t->round = 1;
}

static bool add_to_face(bw_tiling *t, bw_patch p) {
    if (t->mark[p] == t->round) return false;
    t->mark[p] = t->round;
    t->face[t->face_count++] = p;
    return true;
}

static bool is_wall(const bw_tiling *t, bw_patch p) { return p != BW_NONE && t->wall[p]; }

/* The plane of an open patch across its box. False if the base complex does not have all of it. */
static bool plane_across(bw_tiling *t, bw_patch p) {
    const bw_space *s = t->space;
    next_round(t);
    t->face_count = 0;
    add_to_face(t, p);
    for (size_t at = 0; at < t->face_count; at++)
        for (size_t i = s->rim_begin[t->face[at]]; i < s->rim_begin[t->face[at] + 1]; i++) {
            const bw_rim *r = &s->rim[i];
            if (is_wall(t, r->beside[0]) && is_wall(t, r->beside[1])) continue;
            if (r->straight == BW_NONE || t->wall[r->straight]) return false;
            add_to_face(t, r->straight);
        }
    return true;
}

/* Names the two boxes of which `name` was one, makes and adds their prices. */
static bw_status part(bw_context *ctx, bw_tiling *t, bw_block name, bw_block other) {
    bw_tiling_box whole = t->of[name], a = whole, b = {0};
    remove_price(t, whole.price);
    b.size = spread(t, other, other, true, &b.hash);
    a.size -= b.size, a.hash ^= b.hash;
    bw_status status = bw_pricer_price(ctx, t->pricer, a.hash, t->wall, name, &a.price);
    if (status == BW_OK) status = bw_pricer_price(ctx, t->pricer, b.hash, t->wall, other, &b.price);
    if (status != BW_OK) return status;
    set_box(t, name, a), set_box(t, other, b);
    add_price(t, a.price), add_price(t, b.price);
    note(t, COUNT, 0, (int64_t)t->count++);
    return BW_OK;
}

bw_status bw_tiling_cut(bw_context *ctx, bw_tiling *t, bw_patch p, bool *done) {
    const bw_space *s = t->space;
    *done = false;
    if (t->wall[p] || !plane_across(t, p)) return BW_OK;
    bw_status status = make_room(ctx, t);
    if (status != BW_OK) return status;
    for (size_t i = 0; i < t->face_count; i++) set_wall(t, t->face[i], 1);
    bw_block name = t->box[s->patch_block[p][0]];
    /* The half that holds the block the box is named by keeps the name; the other one is found first and named by its block at the patch. */
    uint64_t hash;
    size_t before = t->logged;
    bw_block first = s->patch_block[p][0], second = s->patch_block[p][1];
    if (first != name) {
        spread(t, first, first, true, &hash);
        bool holds = t->box[name] == first;
        while (t->logged > before) { /* only looked */
            bw_tiling_change c = t->log[--t->logged];
            t->box[c.at] = (bw_block)c.old;
        }
        if (!holds) second = first;
    }
    status = part(ctx, t, name, second);
    *done = status == BW_OK;
    return status;
}

/* ---- joins --------------------------------------------------------------------------------------------------------- */

/* The side of both boxes that a wall is, if it is one of both; false otherwise, or if some of it stays. */
static bool common_side(bw_tiling *t, bw_patch p) {
    const bw_space *s = t->space;
    next_round(t);
    t->face_count = 0;
    add_to_face(t, p);
    for (size_t at = 0; at < t->face_count; at++) {
        if (t->stays[t->face[at]]) return false;
        for (size_t i = s->rim_begin[t->face[at]]; i < s->rim_begin[t->face[at] + 1]; i++) {
            const bw_rim *r = &s->rim[i];
            bool beside[2] = {is_wall(t, r->beside[0]), is_wall(t, r->beside[1])};
            if (beside[0] && beside[1]) continue;
            if (beside[0] || beside[1] || !r->inside || r->straight == BW_NONE) return false;
            add_to_face(t, r->straight);
        }
    }
    return true;
}

bw_status bw_tiling_join(bw_context *ctx, bw_tiling *t, bw_patch p, bool *done) {
    const bw_space *s = t->space;
    *done = false;
    if (!t->wall[p] || t->stays[p]) return BW_OK;
    bw_block name[2] = {t->box[s->patch_block[p][0]], t->box[s->patch_block[p][1]]};
    if (name[0] == name[1] || !common_side(t, p)) return BW_OK;
    bw_status status = make_room(ctx, t);
    if (status != BW_OK) return status;
    bw_tiling_box both[2] = {t->of[name[0]], t->of[name[1]]}, whole;
    int large = both[0].size >= both[1].size ? 0 : 1;
    uint64_t hash;
    for (int i = 0; i < 2; i++) remove_price(t, both[i].price);
    bw_block named = name[large]; /* the smaller one is named so before the wall between them goes */
    spread(t, name[!large], named, true, &hash);
    for (size_t i = 0; i < t->face_count; i++) set_wall(t, t->face[i], 0);
    whole = (bw_tiling_box){both[0].size + both[1].size, 0, both[0].hash ^ both[1].hash};
    status = bw_pricer_price(ctx, t->pricer, whole.hash, t->wall, named, &whole.price);
    if (status != BW_OK) return status;
    set_box(t, named, whole);
    add_price(t, whole.price);
    note(t, COUNT, 0, (int64_t)t->count--);
    *done = true;
    return BW_OK;
}

size_t bw_tiling_sides(bw_tiling *t, bw_block name, bw_patch *out) {
    const bw_space *s = t->space;
    size_t count = 1, sides = 0;
    t->queue[0] = name;
    next_round(t);
    for (size_t at = 0; at < count; at++) {
        bw_block b = t->queue[at];
        for (size_t i = s->side_begin[b]; i < s->side_begin[b + 1]; i++) {
            bw_patch p = s->side[i] >> 1;
            if (t->wall[p]) {
                if (!t->stays[p]) out[sides++] = p;
                continue;
            }
            bw_block next = s->patch_block[p][!(s->side[i] & 1)];
            if (t->seen[next] == t->round || next == name) continue;
            t->seen[next] = t->round;
            t->queue[count++] = next;
        }
    }
    return sides;
}

/* ---- check --------------------------------------------------------------------------------------------------------- */

bw_status bw_tiling_check(bw_context *ctx, const bw_tiling *t) {
    const bw_space *s = t->space;
    bw_regions regions;
    uint8_t *wall = bw_alloc(ctx, s->patch_count, 1);
    int32_t *size = bw_alloc(ctx, s->block_count, sizeof *size);
    bw_status status = bw_regions_init(ctx, s, &regions);
    if (status == BW_OK) {
        memcpy(wall, t->wall, s->patch_count);
        if (!bw_regions_close(&regions, wall) || regions.added) status = bw_fail(ctx, BW_E_CHECK, "the walls do not make cuboids");
        else if (regions.count != t->count) status = bw_fail(ctx, BW_E_CHECK, "%zu boxes are counted where there are %zu", t->count, regions.count);
    }
    for (size_t b = 0; b < s->block_count && status == BW_OK; b++) size[t->box[b]]++;
    for (size_t p = 0; p < s->patch_count && status == BW_OK; p++) {
        const bw_block *b = s->patch_block[p];
        if (s->must[p] && s->given[p] && !t->wall[p]) status = bw_fail(ctx, BW_E_CHECK, "patch %zu is no wall, though it was given as one", p);
        else if (!t->wall[p] && t->box[b[0]] != t->box[b[1]]) status = bw_fail(ctx, BW_E_CHECK, "no wall is between boxes %d and %d", t->box[b[0]], t->box[b[1]]);
    }
    for (size_t b = 0; b < s->block_count && status == BW_OK; b++)
        if (t->box[b] == (bw_block)b && t->of[b].size != size[b])
            status = bw_fail(ctx, BW_E_CHECK, "box %zu has %d blocks, not %d", b, size[b], t->of[b].size);
    bw_regions_clear(ctx, &regions);
    bw_free(ctx, wall), bw_free(ctx, size);
    return status;
}
