/* Which sheets can stop each other (X 3.3, conflict graph; X Fig. 3), and the components that follow. */
#include <stdlib.h>
#include <string.h>

#include "explore/sheets.h"

typedef struct {
    uint64_t *item; /* pairs as one number */
    size_t count, room;
} pairs;

/* always[i]: sheet_patch[i] is reached by its sheet in any order of insertion. */
typedef struct {
    bw_context *ctx;
    bw_space *space;
    uint8_t *always;
    int32_t *place;   /* [patch] index in sheet_patch of the sheet that is looked at, plus one; 0: not of it */
    int32_t *list;    /* [patch] scratch: places in sheet_patch */
    bw_sheet *watched, *met; /* [patch], [sheet] the last sheet that has noted it */
    uint8_t *settled; /* [patch] a wall in any order */
    int32_t *member;  /* [place in of_patch] the same pair's place in sheet_patch */
    uint8_t *matters; /* [sheet] */
    bw_sheet *queue;  /* of sheets that matter */
    size_t queued;
    bool counting;
    pairs watchers, linked;
} links;

/* Whether walls can stand on both sides of a rim. */
static bool is_crossed(const bw_space *s, const bw_rim *r) {
    for (int k = 0; k < 2; k++) {
        bw_patch b = r->beside[k];
        if (b == BW_NONE || (!s->given[b] && s->of_patch_begin[b] == s->of_patch_begin[b + 1])) return false;
    }
    return true;
}

static void place_sheet(links *l, bw_sheet sheet, bool on) {
    const bw_space *s = l->space;
    for (size_t i = s->sheet_begin[sheet]; i < s->sheet_begin[sheet + 1]; i++) l->place[s->sheet_patch[i]] = on ? (int32_t)i + 1 : 0;
}

/* From the seeds over all rims at which nothing can stand in the way. */
static void spread(links *l, bw_sheet sheet) {
    const bw_space *s = l->space;
    size_t begin = s->sheet_begin[sheet], count = (size_t)s->sheet_seeds[sheet];
    for (size_t i = 0; i < count; i++) l->always[begin + i] = 1, l->list[i] = (int32_t)(begin + i);
    for (size_t at = 0; at < count; at++) {
        bw_patch p = s->sheet_patch[l->list[at]];
        l->settled[p] = 1;
        for (size_t k = s->rim_begin[p]; k < s->rim_begin[p + 1]; k++) {
            const bw_rim *r = &s->rim[k];
            if (r->straight == BW_NONE || is_crossed(s, r)) continue;
            int32_t next = l->place[r->straight] - 1;
            if (l->always[next]) continue;
            l->always[next] = 1;
            l->list[count++] = next;
        }
    }
}

static bw_status add_pair(bw_context *ctx, pairs *list, uint64_t a, uint64_t b) {
    bw_status status = bw_reserve(ctx, &list->item, &list->room, list->count + 1);
    if (status == BW_OK) list->item[list->count++] = a << 32 | b;
    return status;
}

static int compare(const void *a, const void *b) {
    const uint64_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

/* Sorts, drops what is there twice and lists the seconds of each first. */
static bw_status list_pairs(bw_context *ctx, pairs *list, size_t firsts, size_t **begin, int32_t **out) {
    size_t kept = 0;
    if (list->count) qsort(list->item, list->count, sizeof *list->item, compare);
    for (size_t i = 0; i < list->count; i++)
        if (!i || list->item[i] != list->item[i - 1]) list->item[kept++] = list->item[i];
    list->count = kept;
    *begin = bw_alloc(ctx, firsts + 1, sizeof **begin);
    *out = bw_alloc(ctx, kept, sizeof **out);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    for (size_t i = 0; i < kept; i++) {
        (*begin)[(list->item[i] >> 32) + 1]++;
        (*out)[i] = (int32_t)(list->item[i] & UINT32_MAX);
    }
    for (size_t i = 0; i < firsts; i++) (*begin)[i + 1] += (*begin)[i];
    return BW_OK;
}

/* Whether sheet `of_patch[k]` is at its patch whatever comes before it. */
static bool is_always(const links *l, size_t k) { return l->always[l->member[k]] != 0; }

/* Calls for each rim over which a sheet would go and may be stopped; open crossings are only counted. */
static bw_status each_crossing(links *l, bw_sheet sheet, bw_status (*visit)(links *l, bw_sheet sheet, const bw_rim *r)) {
    bw_space *s = l->space;
    bw_status status = BW_OK;
    place_sheet(l, sheet, true);
    for (size_t i = s->sheet_begin[sheet]; i < s->sheet_begin[sheet + 1]; i++)
        for (size_t k = s->rim_begin[s->sheet_patch[i]]; k < s->rim_begin[s->sheet_patch[i] + 1] && status == BW_OK; k++) {
            const bw_rim *r = &s->rim[k];
            if (r->straight == BW_NONE || !l->place[r->straight] || !is_crossed(s, r)) continue;
            bool open = l->always[i] && l->always[l->place[r->straight] - 1];
            if (l->counting && s->sheet_patch[i] < r->straight) s->crossings += !open, s->crossings_open += open;
            if (!open) status = visit(l, sheet, r);
        }
    place_sheet(l, sheet, false);
    return status == BW_OK ? bw_poll(l->ctx) : status;
}

/* What a sheet does matters if it is at patches that some orders leave open, or if it may or may not come to where it stops one that matters. */
static bw_status pass_on(links *l, bw_sheet sheet, const bw_rim *r) {
    const bw_space *s = l->space;
    for (int side = 0; side < 2; side++)
        for (size_t k = s->of_patch_begin[r->beside[side]]; k < s->of_patch_begin[r->beside[side] + 1]; k++) {
            bw_sheet other = s->of_patch[k];
            if (other == sheet || is_always(l, k) || l->matters[other]) continue;
            l->matters[other] = 1;
            l->queue[l->queued++] = other;
        }
    return BW_OK;
}

static bw_status find_what_matters(links *l) {
    const bw_space *s = l->space;
    bw_status status = BW_OK;
    for (bw_sheet sheet = 0; sheet < (bw_sheet)s->sheet_count; sheet++) {
        for (size_t i = s->sheet_begin[sheet]; i < s->sheet_begin[sheet + 1] && !l->matters[sheet]; i++) l->matters[sheet] = !l->settled[s->sheet_patch[i]];
        if (l->matters[sheet]) l->queue[l->queued++] = sheet;
    }
    for (size_t at = 0; at < l->queued && status == BW_OK; at++) status = each_crossing(l, l->queue[at], pass_on);
    return status;
}

static bw_status link_here(links *l, bw_sheet sheet, const bw_rim *r) {
    const bw_space *s = l->space;
    bw_status status = BW_OK;
    for (int side = 0; side < 2 && status == BW_OK; side++) {
        bw_patch b = r->beside[side];
        if (l->watched[b] == sheet) continue;
        l->watched[b] = sheet;
        status = add_pair(l->ctx, &l->watchers, (uint64_t)b, (uint64_t)sheet);
        for (size_t k = s->of_patch_begin[b]; k < s->of_patch_begin[b + 1] && status == BW_OK && l->matters[sheet]; k++) {
            if (s->of_patch[k] == sheet || l->met[s->of_patch[k]] == sheet) continue;
            l->met[s->of_patch[k]] = sheet;
            status = add_pair(l->ctx, &l->linked, (uint64_t)sheet, (uint64_t)s->of_patch[k]);
            if (status == BW_OK) status = add_pair(l->ctx, &l->linked, (uint64_t)s->of_patch[k], (uint64_t)sheet);
        }
    }
    return status;
}

static bw_status find_crossings(links *l) {
    const bw_space *s = l->space;
    bw_status status = BW_OK;
    for (bw_sheet sheet = 0; sheet < (bw_sheet)s->sheet_count; sheet++) {
        place_sheet(l, sheet, true);
        spread(l, sheet);
        place_sheet(l, sheet, false);
        if ((status = bw_poll(l->ctx)) != BW_OK) return status;
    }
    status = find_what_matters(l);
    l->counting = true;
    for (bw_sheet sheet = 0; sheet < (bw_sheet)s->sheet_count && status == BW_OK; sheet++) status = each_crossing(l, sheet, link_here);
    return status;
}

static bw_status find_components(links *l) {
    bw_space *s = l->space;
    int32_t *parent = bw_alloc(l->ctx, s->sheet_count, sizeof *parent);
    uint8_t *linked = bw_alloc(l->ctx, s->sheet_count, 1);
    s->sheet_component = bw_alloc(l->ctx, s->sheet_count, sizeof *s->sheet_component);
    bw_status status = l->ctx->error.status;
    for (size_t i = 0; i < s->sheet_count && status == BW_OK; i++) parent[i] = (int32_t)i;
    for (size_t i = 0; i < s->sheet_count && status == BW_OK; i++)
        for (size_t k = s->link_begin[i]; k < s->link_begin[i + 1]; k++) bw_set_join(parent, (int32_t)i, s->link[k]);
    for (size_t p = 0; p < s->patch_count && status == BW_OK; p++) {
        if (l->settled[p] || s->given[p] || s->of_patch_begin[p] == s->of_patch_begin[p + 1]) continue;
        s->variable_patches++;
        for (size_t k = s->of_patch_begin[p] + 1; k < s->of_patch_begin[p + 1]; k++) bw_set_join(parent, s->of_patch[k - 1], s->of_patch[k]);
    }
    for (size_t i = 0; i < s->sheet_count && status == BW_OK; i++)
        if (s->link_begin[i + 1] > s->link_begin[i]) linked[bw_set_root(parent, (int32_t)i)] = 1;
    int32_t number = 0;
    for (int pass = 0; pass < 2 && status == BW_OK; pass++)
        for (size_t i = 0; i < s->sheet_count; i++) {
            int32_t root = bw_set_root(parent, (int32_t)i);
            if (linked[root] == pass) continue;
            s->sheet_component[i] = root == (int32_t)i ? number++ : s->sheet_component[root];
            if (!pass) s->component_count = (size_t)number;
        }
    bw_free(l->ctx, parent), bw_free(l->ctx, linked);
    return status;
}

bw_status bw_sheets_link(bw_context *ctx, bw_space *s) {
    size_t all = s->sheet_begin[s->sheet_count];
    links l = {.ctx = ctx, .space = s, .always = bw_alloc(ctx, all, 1), .place = bw_alloc(ctx, s->patch_count, sizeof *l.place),
               .settled = bw_alloc(ctx, s->patch_count, 1), .member = bw_alloc(ctx, all, sizeof *l.member), .matters = bw_alloc(ctx, s->sheet_count, 1),
               .queue = bw_alloc(ctx, s->sheet_count, sizeof *l.queue), .list = bw_alloc(ctx, s->patch_count, sizeof *l.list),
               .watched = bw_alloc(ctx, s->patch_count, sizeof *l.watched), .met = bw_alloc(ctx, s->sheet_count, sizeof *l.met)};
    bw_status status = ctx->error.status;
    if (status == BW_OK) {
        bw_sheets_pair(s, l.place, l.member);
        memset(l.place, 0, s->patch_count * sizeof *l.place);
        memset(l.watched, 0xff, s->patch_count * sizeof *l.watched);
        memset(l.met, 0xff, s->sheet_count * sizeof *l.met);
        status = find_crossings(&l);
    }
    if (status == BW_OK) status = list_pairs(ctx, &l.watchers, s->patch_count, &s->watcher_begin, &s->watcher);
    if (status == BW_OK) status = list_pairs(ctx, &l.linked, s->sheet_count, &s->link_begin, &s->link);
    if (status == BW_OK) status = find_components(&l);
    bw_free(ctx, l.always), bw_free(ctx, l.place), bw_free(ctx, l.settled), bw_free(ctx, l.member), bw_free(ctx, l.matters), bw_free(ctx, l.queue);
    bw_free(ctx, l.list), bw_free(ctx, l.watched), bw_free(ctx, l.met);
    bw_free(ctx, l.watchers.item), bw_free(ctx, l.linked.item);
    return status;
}
