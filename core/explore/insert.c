#include "explore/insert.h"

#include <string.h>

#include "explore/sheets.h"

enum { GAP_BITS = 24 }; /* keys are that far apart when they are dealt out */

void bw_serial_clear(bw_context *ctx, bw_serial *s) {
    void *blocks[] = {s->key, s->order, s->first, s->reached, s->member, s->now, s->place, s->queue, s->heap, s->queued};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(s, 0, sizeof *s);
}

static void forget(bw_serial *s) {
    const bw_space *x = s->space;
    memset(s->reached, 0, x->sheet_begin[x->sheet_count]);
    for (size_t p = 0; p < x->patch_count; p++) s->first[p] = x->given[p] ? BW_GIVEN : BW_OPEN;
    s->hash = 0;
}

bw_status bw_serial_init(bw_context *ctx, const bw_space *x, bw_serial *s) {
    size_t all = x->sheet_begin[x->sheet_count];
    *s = (bw_serial){.space = x};
    s->key = bw_alloc(ctx, x->sheet_count, sizeof *s->key);
    s->order = bw_alloc(ctx, x->sheet_count, sizeof *s->order);
    s->first = bw_alloc(ctx, x->patch_count, sizeof *s->first);
    s->reached = bw_alloc(ctx, all, 1);
    s->member = bw_alloc(ctx, all, sizeof *s->member);
    s->now = bw_alloc(ctx, all, 1);
    s->place = bw_alloc(ctx, x->patch_count, sizeof *s->place);
    s->queue = bw_alloc(ctx, x->patch_count, sizeof *s->queue);
    s->heap = bw_alloc(ctx, x->sheet_count, sizeof *s->heap);
    s->queued = bw_alloc(ctx, x->sheet_count, 1);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    bw_sheets_pair(x, s->place, s->member);
    for (size_t p = 0; p < x->patch_count; p++) s->place[p] = BW_NONE;
    forget(s);
    return BW_OK;
}

bw_status bw_serial_copy(bw_context *ctx, const bw_serial *from, bw_serial *to) {
    const bw_space *x = from->space;
    bw_status status = bw_serial_init(ctx, x, to);
    if (status != BW_OK) return status;
    memcpy(to->key, from->key, x->sheet_count * sizeof *to->key);
    memcpy(to->order, from->order, x->sheet_count * sizeof *to->order);
    memcpy(to->first, from->first, x->patch_count * sizeof *to->first);
    memcpy(to->reached, from->reached, x->sheet_begin[x->sheet_count]);
    to->hash = from->hash;
    return BW_OK;
}

/* ---- one sheet ----------------------------------------------------------------------------------------------------- */

static bool is_blocked(const bw_serial *s, const bw_rim *r, int64_t key) {
    for (int k = 0; k < 2; k++) {
        bw_patch b = r->beside[k];
        if (b == BW_NONE || (s->first[b] >= key && !(s->place[b] != BW_NONE && s->now[s->place[b]]))) return false;
    }
    return true;
}

/* What a sheet reaches now, into `now`. */
static void flood(bw_serial *s, bw_sheet sheet) {
    const bw_space *x = s->space;
    size_t begin = x->sheet_begin[sheet], end = x->sheet_begin[sheet + 1], count = 0;
    int64_t key = s->key[sheet];
    for (size_t i = begin; i < end; i++) s->place[x->sheet_patch[i]] = (int32_t)i, s->now[i] = 0;
    for (size_t i = begin; i < begin + (size_t)x->sheet_seeds[sheet]; i++) s->now[i] = 1, s->queue[count++] = (int32_t)i;
    for (size_t at = 0; at < count; at++) {
        bw_patch p = x->sheet_patch[s->queue[at]];
        for (size_t k = x->rim_begin[p]; k < x->rim_begin[p + 1]; k++) {
            const bw_rim *r = &x->rim[k];
            if (r->straight == BW_NONE) continue;
            int32_t next = s->place[r->straight];
            if (next == BW_NONE || s->now[next] || is_blocked(s, r, key)) continue;
            s->now[next] = 1;
            s->queue[count++] = next;
        }
    }
    for (size_t i = begin; i < end; i++) s->place[x->sheet_patch[i]] = BW_NONE;
    s->floods++;
}

/* ---- what depends on what ------------------------------------------------------------------------------------------ */

static void enqueue(bw_serial *s, bw_sheet sheet) {
    if (s->queued[sheet]) return;
    s->queued[sheet] = 1;
    size_t i = s->heap_count++;
    for (; i && s->key[s->heap[(i - 1) / 2]] > s->key[sheet]; i = (i - 1) / 2) s->heap[i] = s->heap[(i - 1) / 2];
    s->heap[i] = sheet;
}

static bw_sheet dequeue(bw_serial *s) {
    bw_sheet top = s->heap[0], last = s->heap[--s->heap_count];
    size_t i = 0;
    for (size_t c; (c = 2 * i + 1) < s->heap_count; i = c) {
        c += c + 1 < s->heap_count && s->key[s->heap[c + 1]] < s->key[s->heap[c]];
        if (s->key[s->heap[c]] >= s->key[last]) break;
        s->heap[i] = s->heap[c];
    }
    s->heap[i] = last;
    s->queued[top] = 0;
    return top;
}

/* Finds the first sheet at a patch anew; sheets that look at it and come after `from` are to be flooded again where that makes a difference. */
static void renew(bw_serial *s, bw_patch p, int64_t from) {
    const bw_space *x = s->space;
    if (x->given[p]) return;
    int64_t first = BW_OPEN, old = s->first[p];
    for (size_t k = x->of_patch_begin[p]; k < x->of_patch_begin[p + 1]; k++)
        if (s->reached[s->member[k]] && s->key[x->of_patch[k]] < first) first = s->key[x->of_patch[k]];
    if (first == old) return;
    if ((first == BW_OPEN) != (old == BW_OPEN)) s->hash ^= x->patch_key[p];
    s->first[p] = first;
    int64_t low = first < old ? first : old, high = first < old ? old : first;
    for (size_t k = x->watcher_begin[p]; k < x->watcher_begin[p + 1]; k++) {
        int64_t key = s->key[x->watcher[k]];
        if (key > from && key > low && key <= high) enqueue(s, x->watcher[k]);
    }
}

static void settle(bw_serial *s) {
    const bw_space *x = s->space;
    while (s->heap_count) {
        bw_sheet sheet = dequeue(s);
        flood(s, sheet);
        for (size_t i = x->sheet_begin[sheet]; i < x->sheet_begin[sheet + 1]; i++) {
            if (s->now[i] == s->reached[i]) continue;
            s->reached[i] = s->now[i];
            renew(s, x->sheet_patch[i], s->key[sheet]);
        }
    }
}

/* ---- orders -------------------------------------------------------------------------------------------------------- */

void bw_serial_insert(bw_serial *s, const bw_sheet *order) {
    const bw_space *x = s->space;
    forget(s);
    for (size_t i = 0; i < x->sheet_count; i++) s->key[order[i]] = (int64_t)(i + 1) << GAP_BITS;
    if (order != s->order) memcpy(s->order, order, x->sheet_count * sizeof *order);
    for (size_t i = 0; i < x->sheet_count; i++) {
        bw_sheet sheet = s->order[i];
        flood(s, sheet);
        for (size_t k = x->sheet_begin[sheet]; k < x->sheet_begin[sheet + 1]; k++) {
            if (!s->now[k]) continue;
            bw_patch p = x->sheet_patch[k];
            s->reached[k] = 1;
            if (s->first[p] == BW_OPEN) s->first[p] = s->key[sheet], s->hash ^= x->patch_key[p];
        }
    }
}

size_t bw_serial_place(const bw_serial *s, bw_sheet sheet) {
    size_t low = 0, high = s->space->sheet_count;
    while (high - low > 1) {
        size_t middle = low + (high - low) / 2;
        if (s->key[s->order[middle]] <= s->key[sheet]) low = middle;
        else high = middle;
    }
    return low;
}

/* New keys with room between them; nothing else depends on their values. */
static void deal_keys(bw_serial *s) {
    const bw_space *x = s->space;
    for (size_t i = 0; i < x->sheet_count; i++) s->key[s->order[i]] = (int64_t)(i + 1) << GAP_BITS;
    for (size_t p = 0; p < x->patch_count; p++) {
        if (s->first[p] < 0 || s->first[p] == BW_OPEN) continue;
        s->first[p] = BW_OPEN;
        for (size_t k = x->of_patch_begin[p]; k < x->of_patch_begin[p + 1]; k++)
            if (s->reached[s->member[k]] && s->key[x->of_patch[k]] < s->first[p]) s->first[p] = s->key[x->of_patch[k]];
    }
}

void bw_serial_move_to(bw_serial *s, bw_sheet sheet, size_t place) {
    const bw_space *x = s->space;
    size_t from = bw_serial_place(s, sheet);
    if (from == place) return;
    for (int dealt = 0;; dealt = 1) {
        size_t after = place < from ? place : place + 1; /* the sheet that will follow, in the present order */
        int64_t low = after ? s->key[s->order[after - 1]] : 0;
        int64_t high = after < x->sheet_count ? s->key[s->order[after]] : low + ((int64_t)2 << GAP_BITS);
        if (high - low < 2 && !dealt) {
            deal_keys(s);
            continue;
        }
        int64_t old = s->key[sheet], new = low + (high - low) / 2;
        memmove(&s->order[place < from ? place + 1 : from], &s->order[place < from ? place : from + 1],
                (place < from ? from - place : place - from) * sizeof *s->order);
        s->order[place] = sheet;
        s->key[sheet] = new;
        for (size_t i = x->sheet_begin[sheet]; i < x->sheet_begin[sheet + 1]; i++)
            if (s->reached[i]) renew(s, x->sheet_patch[i], old < new ? old : new);
        break;
    }
    enqueue(s, sheet);
    settle(s);
}

void bw_serial_move_before(bw_serial *s, bw_sheet sheet, bw_sheet other) {
    size_t from = bw_serial_place(s, sheet), to = bw_serial_place(s, other);
    bw_serial_move_to(s, sheet, from < to ? to - 1 : to);
}

void bw_serial_walls(const bw_serial *s, uint8_t *wall) {
    for (size_t p = 0; p < s->space->patch_count; p++) wall[p] = s->first[p] != BW_OPEN;
}
