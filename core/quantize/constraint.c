#include "quantize/constraint.h"

#include <stdlib.h>
#include <string.h>

const char *bw_rule_name(bw_rule rule) {
    static const char *const names[] = {"rectangle", "extent", "link", "separation", "region", "volume"};
    return (unsigned)rule < BW_RULE_COUNT ? names[rule] : "?";
}

void bw_constraint_clear(bw_context *ctx, bw_constraint_list *list) {
    bw_free(ctx, list->begin);
    bw_free(ctx, list->term);
    bw_free(ctx, list->bound);
    bw_free(ctx, list->relation);
    bw_free(ctx, list->rule);
    memset(list, 0, sizeof *list);
}

static int by_arc(const void *a, const void *b) {
    const bw_term *x = a, *y = b;
    return (x->arc > y->arc) - (x->arc < y->arc);
}

/* Sorts, sums up terms of one arc and drops zeros; returns how many are left. */
static size_t tidy(bw_term *terms, size_t n) {
    size_t out = 0;
    if (n > 1) qsort(terms, n, sizeof *terms, by_arc);
    for (size_t i = 0; i < n;) {
        bw_term sum = terms[i++];
        while (i < n && terms[i].arc == sum.arc) sum.factor += terms[i++].factor;
        if (sum.factor) terms[out++] = sum;
    }
    return out;
}

static bw_status make_room(bw_context *ctx, bw_constraint_list *list, size_t terms) {
    size_t n = list->count, used = n ? list->begin[n] : 0;
    if (bw_reserve(ctx, &list->begin, &list->begin_room, n + 2)) return ctx->error.status;
    if (bw_reserve(ctx, &list->term, &list->term_room, used + terms)) return ctx->error.status;
    if (bw_reserve(ctx, &list->bound, &list->bound_room, n + 1)) return ctx->error.status;
    if (bw_reserve(ctx, &list->relation, &list->relation_room, n + 1)) return ctx->error.status;
    return bw_reserve(ctx, &list->rule, &list->rule_room, n + 1);
}

bw_status bw_constraint_add(bw_context *ctx, bw_constraint_list *list, bw_rule rule, bw_relation relation, bw_term *terms,
                            size_t n, int64_t bound) {
    n = tidy(terms, n);
    if (make_room(ctx, list, n)) return ctx->error.status;
    size_t c = list->count++;
    if (!c) list->begin[0] = 0;
    if (n) memcpy(list->term + list->begin[c], terms, n * sizeof *terms);
    list->begin[c + 1] = list->begin[c] + n;
    list->bound[c] = bound;
    list->relation[c] = (uint8_t)relation;
    list->rule[c] = (uint8_t)rule;
    return BW_OK;
}

bw_status bw_constraint_copy(bw_context *ctx, bw_constraint_list *list, const bw_constraint_list *from, size_t c) {
    size_t n = from->begin[c + 1] - from->begin[c];
    if (make_room(ctx, list, n)) return ctx->error.status;
    return bw_constraint_add(ctx, list, from->rule[c], from->relation[c], from->term + from->begin[c], n, from->bound[c]);
}

int64_t bw_constraint_value(const bw_constraint_list *list, size_t c, const int64_t *length) {
    int64_t sum = 0;
    for (size_t i = list->begin[c]; i < list->begin[c + 1]; i++)
        sum += list->term[i].factor * length[list->term[i].arc];
    return sum;
}

bool bw_constraint_holds(const bw_constraint_list *list, size_t c, const int64_t *length) {
    int64_t value = bw_constraint_value(list, c, length);
    return list->relation[c] == BW_EQUAL ? value == list->bound[c] : value >= list->bound[c];
}

size_t bw_constraint_first_broken(const bw_constraint_list *list, const int64_t *length) {
    size_t c = 0;
    while (c < list->count && bw_constraint_holds(list, c, length)) c++;
    return c;
}
