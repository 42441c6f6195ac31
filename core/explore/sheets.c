/* Singular lines and the sheets that emanate from them (X 3.1). */
#include "explore/sheets.h"

#include <stdlib.h>
#include <string.h>

/* ---- lines --------------------------------------------------------------------------------------------------------- */

static bool is_source(const bw_complex *x, size_t arc) { return (x->arc_flags[arc] & (BW_ARC_SINGULAR | BW_ARC_FEATURE)) != 0; }

static bool continues(const bw_complex *x, bw_arc a, bw_arc b) {
    uint8_t same = BW_ARC_SINGULAR | BW_ARC_FEATURE | BW_ARC_BOUNDARY;
    return x->arc_quarters[a] == x->arc_quarters[b] && !((x->arc_flags[a] ^ x->arc_flags[b]) & same);
}

/* A line goes on through nodes at which exactly two arcs that are sources meet, if they are alike. line[arc]: BW_NONE for others. */
static bw_status find_lines(bw_context *ctx, const bw_complex *x, bw_space *s, int32_t *line) {
    int32_t *first = bw_alloc(ctx, x->node_count, sizeof *first), *second = bw_alloc(ctx, x->node_count, sizeof *second);
    uint8_t *sources = bw_alloc(ctx, x->node_count, 1);
    for (size_t a = 0; a < x->arc_count && ctx->error.status == BW_OK; a++) {
        line[a] = is_source(x, a) ? (int32_t)a : BW_NONE;
        for (int end = 0; end < 2 && line[a] != BW_NONE; end++) {
            bw_node n = x->arc_node[a][end];
            if (sources[n] == 0) first[n] = (int32_t)a;
            else second[n] = (int32_t)a;
            if (sources[n] < 3) sources[n]++;
        }
    }
    for (size_t n = 0; n < x->node_count && ctx->error.status == BW_OK; n++)
        if (sources[n] == 2 && continues(x, first[n], second[n])) bw_set_join(line, first[n], second[n]);
    for (size_t a = 0; a < x->arc_count && ctx->error.status == BW_OK; a++) {
        if (line[a] == BW_NONE) continue;
        line[a] = bw_set_root(line, (int32_t)a);
        s->line_count += line[a] == (int32_t)a;
    }
    bw_free(ctx, first), bw_free(ctx, second), bw_free(ctx, sources);
    return ctx->error.status;
}

/* ---- seeds --------------------------------------------------------------------------------------------------------- */

typedef struct {
    int32_t line;
    bw_patch patch;
    int32_t sheet; /* first the lowest seed of the same sheet, then its number */
} seed;

typedef struct {
    seed *item;
    size_t count, room;
} seeds;

static int by_patch(const void *a, const void *b) {
    const seed *x = a, *y = b;
    if (x->patch != y->patch) return x->patch < y->patch ? -1 : 1;
    return (x->line > y->line) - (x->line < y->line);
}

static bw_status add_seed(bw_context *ctx, seeds *list, int32_t line, bw_patch patch) {
    bw_status status = bw_reserve(ctx, &list->item, &list->room, list->count + 1);
    if (status == BW_OK) list->item[list->count++] = (seed){line, patch, 0};
    return status;
}

static bw_status list_seeds(bw_context *ctx, const bw_complex *x, const bw_space *s, const int32_t *line, seeds *list) {
    bw_status status = BW_OK;
    for (bw_patch p = 0; p < (bw_patch)s->patch_count && status == BW_OK; p++) {
        if (x->patch_flags[p] & BW_PATCH_BOUNDARY) continue;
        size_t before = list->count;
        for (size_t i = s->rim_begin[p]; i < s->rim_begin[p + 1] && status == BW_OK; i++)
            if (line[s->rim[i].arc] != BW_NONE) status = add_seed(ctx, list, line[s->rim[i].arc], p);
        if (list->count == before && x->patch_flags[p] & BW_PATCH_FEATURE && status == BW_OK) status = add_seed(ctx, list, BW_NONE, p);
    }
    if (status != BW_OK) return status;
    if (list->count) qsort(list->item, list->count, sizeof *list->item, by_patch);
    size_t kept = 0;
    for (size_t i = 0; i < list->count; i++)
        if (!kept || by_patch(&list->item[i], &list->item[kept - 1])) list->item[kept++] = list->item[i];
    list->count = kept;
    return BW_OK;
}

/* Seeds of one line that lie straight beside each other are of one sheet. */
static bw_status group_seeds(bw_context *ctx, bw_space *s, seeds *list) {
    int32_t *parent = bw_alloc(ctx, list->count, sizeof *parent);
    if (!parent) return ctx->error.status;
    for (size_t i = 0; i < list->count; i++) parent[i] = (int32_t)i;
    for (size_t i = 0; i < list->count; i++)
        for (size_t r = s->rim_begin[list->item[i].patch]; r < s->rim_begin[list->item[i].patch + 1]; r++) {
            if (s->rim[r].straight == BW_NONE) continue;
            seed wanted = {list->item[i].line, s->rim[r].straight, 0};
            const seed *found = bsearch(&wanted, list->item, list->count, sizeof wanted, by_patch);
            if (found) bw_set_join(parent, (int32_t)i, (int32_t)(found - list->item));
        }
    for (size_t i = 0; i < list->count; i++) { /* the lowest of a set is its root */
        int32_t root = bw_set_root(parent, (int32_t)i);
        list->item[i].sheet = root == (int32_t)i ? (int32_t)s->sheet_count++ : list->item[root].sheet;
    }
    bw_free(ctx, parent);
    return BW_OK;
}

/* ---- floods -------------------------------------------------------------------------------------------------------- */

static bool both_given(const bw_space *s, const bw_rim *r) {
    return r->beside[0] != BW_NONE && r->beside[1] != BW_NONE && s->given[r->beside[0]] && s->given[r->beside[1]];
}

typedef struct {
    bw_patch *item;
    size_t count, room;
} patch_list;

/* All that the sheet of the seeds at the end of a list reaches. mark[patch] is the last sheet that came there. */
static bw_status flood(bw_context *ctx, const bw_space *s, bw_sheet sheet, size_t at, bw_sheet *mark, patch_list *list) {
    for (; at < list->count; at++) {
        bw_patch p = list->item[at];
        for (size_t i = s->rim_begin[p]; i < s->rim_begin[p + 1]; i++) {
            const bw_rim *r = &s->rim[i];
            if (r->straight == BW_NONE || mark[r->straight] == sheet || both_given(s, r)) continue;
            bw_status status = bw_reserve(ctx, &list->item, &list->room, list->count + 1);
            if (status != BW_OK) return status;
            mark[r->straight] = sheet;
            list->item[list->count++] = r->straight;
        }
    }
    return bw_poll(ctx);
}

static int by_sheet(const void *a, const void *b) {
    const seed *x = a, *y = b;
    if (x->sheet != y->sheet) return x->sheet < y->sheet ? -1 : 1;
    return by_patch(a, b);
}

static bw_status flood_sheets(bw_context *ctx, bw_space *s, seeds *from) {
    patch_list list = {0};
    s->sheet_begin = bw_alloc(ctx, s->sheet_count + 1, sizeof *s->sheet_begin);
    s->sheet_seeds = bw_alloc(ctx, s->sheet_count, sizeof *s->sheet_seeds);
    s->sheet_line = bw_alloc(ctx, s->sheet_count, sizeof *s->sheet_line);
    bw_sheet *mark = bw_alloc(ctx, s->patch_count, sizeof *mark);
    bw_status status = ctx->error.status;
    for (size_t p = 0; p < s->patch_count && status == BW_OK; p++) mark[p] = BW_NONE;
    if (from->count) qsort(from->item, from->count, sizeof *from->item, by_sheet);
    for (size_t i = 0, j; i < from->count && status == BW_OK; i = j) {
        bw_sheet sheet = from->item[i].sheet;
        size_t begin = list.count;
        for (j = i; j < from->count && from->item[j].sheet == sheet && status == BW_OK; j++) {
            status = bw_reserve(ctx, &list.item, &list.room, list.count + 1);
            if (status == BW_OK) mark[from->item[j].patch] = sheet, list.item[list.count++] = from->item[j].patch;
        }
        s->sheet_seeds[sheet] = (int32_t)(list.count - begin), s->sheet_line[sheet] = from->item[i].line;
        if (status == BW_OK) status = flood(ctx, s, sheet, begin, mark, &list);
        s->sheet_begin[sheet + 1] = list.count;
    }
    bw_free(ctx, mark);
    s->sheet_patch = list.item;
    return status;
}

static bw_status list_by_patch(bw_context *ctx, bw_space *s) {
    size_t all = s->sheet_begin[s->sheet_count];
    if (all >= INT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "the sheets of the base complex have %zu patches together, too many to search it", all);
    s->of_patch_begin = bw_alloc(ctx, s->patch_count + 2, sizeof *s->of_patch_begin);
    s->of_patch = bw_alloc(ctx, all, sizeof *s->of_patch);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    for (size_t i = 0; i < all; i++) s->of_patch_begin[s->sheet_patch[i] + 2]++;
    for (size_t p = 2; p < s->patch_count + 2; p++) s->of_patch_begin[p] += s->of_patch_begin[p - 1];
    for (bw_sheet sheet = 0; sheet < (bw_sheet)s->sheet_count; sheet++)
        for (size_t i = s->sheet_begin[sheet]; i < s->sheet_begin[sheet + 1]; i++)
            s->of_patch[s->of_patch_begin[s->sheet_patch[i] + 1]++] = sheet;
    return BW_OK;
}

void bw_sheets_pair(const bw_space *s, int32_t *place, int32_t *member) {
    for (size_t p = 0; p < s->patch_count; p++) place[p] = (int32_t)s->of_patch_begin[p];
    for (size_t i = 0; i < s->sheet_begin[s->sheet_count]; i++) member[place[s->sheet_patch[i]]++] = (int32_t)i; /* both lists go by sheet */
}

bw_status bw_sheets_find(bw_context *ctx, const bw_complex *x, bw_space *s) {
    seeds list = {0};
    int32_t *line = bw_alloc(ctx, x->arc_count, sizeof *line);
    bw_status status = line ? find_lines(ctx, x, s, line) : ctx->error.status;
    if (status == BW_OK) status = list_seeds(ctx, x, s, line, &list);
    if (status == BW_OK) status = group_seeds(ctx, s, &list);
    if (status == BW_OK) status = flood_sheets(ctx, s, &list);
    if (status == BW_OK) status = list_by_patch(ctx, s);
    bw_free(ctx, line), bw_free(ctx, list.item);
    return status;
}
