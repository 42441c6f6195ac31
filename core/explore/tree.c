#include "explore/tree.h"

#include <string.h>

void bw_tree_clear(bw_context *ctx, bw_tree *t) {
    void *blocks[] = {t->sheet, t->step_begin, t->step, t->first_step, t->place_begin, t->reach, t->least, t->after, t->choices, t->now, t->queue};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(t, 0, sizeof *t);
}

/* ---- setting up ---------------------------------------------------------------------------------------------------- */

static bw_patch possible(const bw_space *s, bw_patch p) {
    return p != BW_NONE && (s->given[p] || s->of_patch_begin[p] < s->of_patch_begin[p + 1]) ? p : BW_NONE;
}

/* The ways from patch to patch in one sheet of the component. */
static bw_status list_steps(bw_context *ctx, bw_tree *t, size_t local, int32_t *place, size_t *room) {
    const bw_space *s = t->space;
    size_t begin = s->sheet_begin[t->sheet[local]], end = s->sheet_begin[t->sheet[local] + 1];
    size_t at = t->step_begin[local];
    bw_status status = BW_OK;
    for (size_t i = begin; i < end; i++) place[s->sheet_patch[i]] = (int32_t)(i - begin);
    for (size_t i = begin; i < end && status == BW_OK; i++) {
        bw_patch p = s->sheet_patch[i];
        t->first_step[t->place_begin[local] + i - begin] = at;
        for (size_t k = s->rim_begin[p]; k < s->rim_begin[p + 1] && status == BW_OK; k++) {
            const bw_rim *r = &s->rim[k];
            if (r->straight == BW_NONE || place[r->straight] == BW_NONE) continue;
            status = bw_reserve(ctx, &t->step, room, at + 1);
            if (status == BW_OK)
                t->step[at++] = (bw_tree_step){(int32_t)(i - begin), place[r->straight], {possible(s, r->beside[0]), possible(s, r->beside[1])}};
        }
    }
    t->step_begin[local + 1] = at;
    for (size_t i = begin; i < end; i++) place[s->sheet_patch[i]] = BW_NONE;
    return status;
}

static bw_status allocate(bw_context *ctx, bw_tree *t) {
    const bw_space *s = t->space;
    size_t n = t->count, longest = 1;
    t->place_begin = bw_alloc(ctx, n + 1, sizeof *t->place_begin);
    for (size_t i = 0; i < n && ctx->error.status == BW_OK; i++) {
        size_t length = s->sheet_begin[t->sheet[i] + 1] - s->sheet_begin[t->sheet[i]];
        t->place_begin[i + 1] = t->place_begin[i] + length;
        if (length > longest) longest = length;
    }
    if (ctx->error.status != BW_OK) return ctx->error.status;
    t->step_begin = bw_alloc(ctx, n + 1, sizeof *t->step_begin);
    t->first_step = bw_alloc(ctx, t->place_begin[n] + 1, sizeof *t->first_step);
    t->reach = bw_alloc(ctx, n * t->wall_words, sizeof *t->reach);
    t->least = bw_alloc(ctx, n * t->wall_words, sizeof *t->least);
    t->after = bw_alloc(ctx, (n + 2) * t->wall_words, sizeof *t->after);
    t->choices = bw_alloc(ctx, t->words - t->wall_words, sizeof *t->choices);
    t->now = bw_alloc(ctx, longest, 1);
    t->queue = bw_alloc(ctx, longest, sizeof *t->queue);
    return ctx->error.status;
}

bw_status bw_tree_init(bw_context *ctx, const bw_space *s, int32_t component, bw_tree *t) {
    *t = (bw_tree){.space = s, .wall_words = (s->patch_count + 63) / 64};
    t->sheet = bw_alloc(ctx, s->sheet_count, sizeof *t->sheet);
    int32_t *place = bw_alloc(ctx, s->patch_count, sizeof *place);
    bw_status status = ctx->error.status;
    for (bw_sheet i = 0; i < (bw_sheet)s->sheet_count && status == BW_OK; i++)
        if (s->sheet_component[i] == component) t->sheet[t->count++] = i;
    for (size_t p = 0; p < s->patch_count && status == BW_OK; p++) place[p] = BW_NONE;
    t->words = t->wall_words + (t->count + 63) / 64;
    if (status == BW_OK) status = allocate(ctx, t);
    size_t room = 0;
    for (size_t i = 0; i < t->count && status == BW_OK; i++) status = list_steps(ctx, t, i, place, &room);
    if (status == BW_OK) t->first_step[t->place_begin[t->count]] = t->step_begin[t->count];
    bw_free(ctx, place);
    return status;
}

void bw_tree_root(const bw_tree *t, uint64_t *state) {
    memset(state, 0, t->words * sizeof *state);
    for (size_t p = 0; p < t->space->patch_count; p++)
        if (t->space->given[p]) bw_tree_set_bit(state, p);
    for (size_t i = 0; i < t->count; i++) bw_tree_set_bit(state + t->wall_words, i);
}

/* ---- floods -------------------------------------------------------------------------------------------------------- */

/* What a sheet reaches between walls, as bits. It also stops where it has crossed itself, as serial insertion does. */
static void flood(bw_tree *t, size_t local, const uint64_t *walls, uint64_t *out) {
    const bw_space *s = t->space;
    size_t begin = s->sheet_begin[t->sheet[local]], end = s->sheet_begin[t->sheet[local] + 1];
    size_t count = (size_t)s->sheet_seeds[t->sheet[local]], base = t->place_begin[local];
    memset(t->now, 0, end - begin);
    memset(out, 0, t->wall_words * sizeof *out);
    for (size_t i = 0; i < count; i++) {
        t->now[i] = 1, t->queue[i] = (int32_t)i;
        bw_tree_set_bit(out, (size_t)s->sheet_patch[begin + i]);
    }
    for (size_t at = 0; at < count; at++) {
        size_t place = base + (size_t)t->queue[at];
        size_t last = t->queue[at] + 1 < (int32_t)(end - begin) ? t->first_step[place + 1] : t->step_begin[local + 1];
        for (size_t k = t->first_step[place]; k < last; k++) {
            const bw_tree_step *step = &t->step[k];
            if (t->now[step->to]) continue;
            bool blocked = true;
            for (int i = 0; i < 2 && blocked; i++) {
                bw_patch b = step->beside[i];
                blocked = b != BW_NONE && (bw_tree_bit(walls, (size_t)b) || bw_tree_bit(out, (size_t)b));
            }
            if (blocked) continue;
            t->now[step->to] = 1, t->queue[count++] = step->to;
            bw_tree_set_bit(out, (size_t)s->sheet_patch[begin + (size_t)step->to]);
        }
    }
    t->floods++;
}

static void unite(const bw_tree *t, uint64_t *into, const uint64_t *from) {
    for (size_t i = 0; i < t->wall_words; i++) into[i] |= from[i];
}

/* ---- expansion ----------------------------------------------------------------------------------------------------- */

/* What each sheet that is left reaches now, and what it would if all others that are left went before. */
static void flood_rest(bw_tree *t, const uint64_t *state) {
    const uint64_t *rest = state + t->wall_words;
    size_t w = t->wall_words, n = t->count;
    uint64_t *before = t->after + (n + 1) * w; /* walls, and what sheets before the present one reach */
    for (size_t i = 0; i < n; i++)
        if (bw_tree_bit(rest, i)) flood(t, i, state, t->reach + i * w);
    memset(t->after + n * w, 0, w * sizeof *t->after);
    for (size_t i = n; i-- > 0;) {
        memcpy(t->after + i * w, t->after + (i + 1) * w, w * sizeof *t->after);
        if (bw_tree_bit(rest, i)) unite(t, t->after + i * w, t->reach + i * w);
    }
    memcpy(before, state, w * sizeof *before);
    for (size_t i = 0; i < n; i++) {
        if (!bw_tree_bit(rest, i)) continue;
        uint64_t *others = t->after + (i + 1) * w; /* not needed afterwards */
        unite(t, others, before);
        flood(t, i, others, t->least + i * w);
        unite(t, before, t->reach + i * w);
    }
}

static bool can_be_stopped(const bw_tree *t, size_t i) {
    return memcmp(t->reach + i * t->wall_words, t->least + i * t->wall_words, t->wall_words * sizeof *t->reach) != 0;
}

/* Whether sheet i, as it reaches now, takes part in stopping sheet j somewhere. */
static bool stops(const bw_tree *t, const uint64_t *state, size_t i, size_t j) {
    const bw_space *s = t->space;
    const uint64_t *mine = t->reach + i * t->wall_words, *other = t->reach + j * t->wall_words;
    const bw_patch *patch = s->sheet_patch + s->sheet_begin[t->sheet[j]];
    for (size_t k = t->step_begin[j]; k < t->step_begin[j + 1]; k++) {
        const bw_tree_step *step = &t->step[k];
        const bw_patch *b = step->beside;
        if (b[0] == BW_NONE || b[1] == BW_NONE) continue;
        if (!bw_tree_bit(mine, (size_t)b[0]) && !bw_tree_bit(mine, (size_t)b[1])) continue;
        if (!bw_tree_bit(other, (size_t)patch[step->from]) || !bw_tree_bit(other, (size_t)patch[step->to])) continue;
        if (!bw_tree_bit(state, (size_t)b[0]) || !bw_tree_bit(state, (size_t)b[1])) return true;
    }
    return false;
}

static size_t find_choices(bw_tree *t, const uint64_t *state) {
    const bw_space *s = t->space;
    const uint64_t *rest = state + t->wall_words;
    size_t found = 0;
    memset(t->choices, 0, (t->words - t->wall_words) * sizeof *t->choices);
    for (size_t j = 0; j < t->count; j++) {
        if (!bw_tree_bit(rest, j) || !can_be_stopped(t, j)) continue;
        for (size_t i = 0, k = s->link_begin[t->sheet[j]]; i < t->count && k < s->link_begin[t->sheet[j] + 1]; i++) {
            if (t->sheet[i] != s->link[k]) continue;
            k++;
            if (!bw_tree_bit(rest, i) || (bw_tree_bit(t->choices, i) && bw_tree_bit(t->choices, j)) || !stops(t, state, i, j)) continue;
            bw_tree_set_bit(t->choices, i), bw_tree_set_bit(t->choices, j);
        }
    }
    for (size_t i = 0; i < t->words - t->wall_words; i++) found += (size_t)__builtin_popcountll(t->choices[i]);
    return found;
}

size_t bw_tree_settle(bw_tree *t, uint64_t *state, bw_sheet *order, size_t *inserted) {
    uint64_t *rest = state + t->wall_words;
    flood_rest(t, state);
    size_t found = find_choices(t, state);
    for (size_t i = 0; i < t->count; i++) {
        if (!bw_tree_bit(rest, i) || bw_tree_bit(t->choices, i)) continue;
        unite(t, state, t->reach + i * t->wall_words);
        if (order) order[(*inserted)++] = t->sheet[i];
    }
    memcpy(rest, t->choices, (t->words - t->wall_words) * sizeof *rest);
    return found;
}

void bw_tree_sure_walls(const bw_tree *t, const uint64_t *state, uint64_t *walls) {
    memcpy(walls, state, t->wall_words * sizeof *walls);
    for (size_t i = 0; i < t->count; i++)
        if (bw_tree_bit(state + t->wall_words, i)) unite(t, walls, t->least + i * t->wall_words);
}

void bw_tree_choose(bw_tree *t, uint64_t *state, size_t sheet) {
    uint64_t *reach = t->after; /* free between two settlements */
    flood(t, sheet, state, reach);
    unite(t, state, reach);
    state[t->wall_words + (sheet >> 6)] &= ~((uint64_t)1 << (sheet & 63));
}

void bw_tree_finish(bw_tree *t, uint64_t *state) {
    for (size_t i = 0; i < t->count; i++)
        if (bw_tree_bit(state + t->wall_words, i)) bw_tree_choose(t, state, i);
}

/* ---- hashes -------------------------------------------------------------------------------------------------------- */

static uint64_t mix(uint64_t hash, const uint64_t *words, size_t count) {
    for (size_t i = 0; i < count; i++) {
        hash = (hash ^ words[i]) * 0x9e3779b97f4a7c15u;
        hash ^= hash >> 32;
    }
    return hash;
}

uint64_t bw_tree_hash_walls(const bw_tree *t, const uint64_t *state) { return mix(0x51ed270b, state, t->wall_words); }
uint64_t bw_tree_hash(const bw_tree *t, const uint64_t *state) { return mix(0x2545f491, state, t->words); }
