#include "quantize/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "quantize/eliminate.h"

enum { FACTOR_MAX = 1 << 20 };

/* ---- the equalities of the patches ---- */

typedef struct {
    size_t rows;
    size_t *begin;
    bw_eliminate_term *term;
} equalities;

static int by_unknown(const void *a, const void *b) {
    const bw_eliminate_term *x = a, *y = b;
    return (x->unknown > y->unknown) - (x->unknown < y->unknown);
}

static size_t add_side(const bw_complex *x, size_t patch, int side, int64_t sign, bw_eliminate_term *out) {
    size_t n = 0;
    for (size_t i = x->patch_chain_begin[4 * patch + (size_t)side]; i < x->patch_chain_begin[4 * patch + (size_t)side + 1]; i++)
        out[n++] = (bw_eliminate_term){x->patch_chain[i] >> 1, sign};
    return n;
}

static size_t tidy(bw_eliminate_term *t, size_t n) {
    size_t out = 0;
    qsort(t, n, sizeof *t, by_unknown);
    for (size_t i = 0; i < n;) {
        bw_eliminate_term sum = t[i++];
        while (i < n && t[i].unknown == sum.unknown) sum.factor += t[i++].factor;
        if (sum.factor) t[out++] = sum;
    }
    return out;
}

static bw_status read_equalities(bw_context *ctx, const bw_complex *x, equalities *e) {
    e->begin = bw_alloc(ctx, 2 * x->patch_count + 1, sizeof *e->begin);
    e->term = bw_alloc(ctx, x->patch_chain_begin[4 * x->patch_count], sizeof *e->term);
    if (!e->begin || !e->term) return ctx->error.status;
    for (size_t p = 0; p < x->patch_count; p++)
        for (int side = 0; side < 2; side++) { /* opposite sides of a patch */
            bw_eliminate_term *t = e->term + e->begin[e->rows];
            size_t n = add_side(x, p, side, 1, t);
            n += add_side(x, p, side + 2, -1, t + n);
            n = tidy(t, n);
            if (!n) continue;
            e->begin[e->rows + 1] = e->begin[e->rows] + n;
            e->rows++;
        }
    return BW_OK;
}

/* ---- forms: every unknown by the free ones ---- */

typedef struct {
    bw_context *ctx;
    const bw_complex *complex;
    bw_quant_model *model;
    equalities equal;
    bw_elimination gone;
    int32_t *step_of;   /* [unknown] step that implies it; BW_NONE if free */
    int32_t *free_of;   /* [unknown] number among the free ones */
    size_t *form_at;    /* [unknown] where its form is in form[] */
    int32_t *form_size;
    bw_quant_term *form;
    size_t form_room;
    int64_t *value;     /* [unknown] of the input */
    int32_t *class_of;  /* [unknown] */
    int32_t *chief;     /* [class] the unknown whose step is the row of the class */
} build;

static bw_status number_free(build *b) {
    size_t n = b->gone.count;
    b->step_of = bw_alloc(b->ctx, n, sizeof *b->step_of);
    b->free_of = bw_alloc(b->ctx, n, sizeof *b->free_of);
    b->form_at = bw_alloc(b->ctx, n, sizeof *b->form_at);
    b->form_size = bw_alloc(b->ctx, n, sizeof *b->form_size);
    if (!b->step_of || !b->free_of || !b->form_at || !b->form_size) return b->ctx->error.status;
    for (size_t u = 0; u < n; u++) b->step_of[u] = b->free_of[u] = BW_NONE;
    for (size_t k = 0; k < b->gone.step_count; k++) b->step_of[b->gone.step[k].unknown] = (int32_t)k;
    for (size_t u = 0; u < n; u++)
        if (b->step_of[u] == BW_NONE) b->free_of[u] = (int32_t)b->model->free_count++;
    return BW_OK;
}

static int by_index(const void *a, const void *b) {
    const bw_quant_term *x = a, *y = b;
    return (x->index > y->index) - (x->index < y->index);
}

/* Appends what was summed up in sum[touched[..]] as a form, sorted, and clears it. */
static bw_status store_form(build *b, int32_t unknown, int64_t *sum, int32_t *touched, size_t touched_count, size_t *used) {
    size_t n = 0;
    if (bw_reserve(b->ctx, &b->form, &b->form_room, *used + touched_count)) return b->ctx->error.status;
    for (size_t i = 0; i < touched_count; i++) {
        int64_t f = sum[touched[i]];
        sum[touched[i]] = 0;
        if (!f) continue;
        if (f > FACTOR_MAX || f < -FACTOR_MAX) return bw_fail(b->ctx, BW_E_RANGE, "factors of the quantization exceed the range");
        b->form[*used + n++] = (bw_quant_term){touched[i], (int32_t)f};
    }
    qsort(b->form + *used, n, sizeof *b->form, by_index);
    b->form_at[unknown] = *used, b->form_size[unknown] = (int32_t)n;
    *used += n;
    return BW_OK;
}

static bw_status make_forms(build *b) {
    size_t used = 0, free_count = b->model->free_count;
    int64_t *sum = bw_alloc(b->ctx, free_count, sizeof *sum);
    int32_t *touched = bw_alloc(b->ctx, free_count, sizeof *touched);
    uint8_t *is_touched = bw_alloc(b->ctx, free_count, 1);
    bw_status status = sum && touched && is_touched ? BW_OK : b->ctx->error.status;
    for (size_t u = 0; u < b->gone.count && status == BW_OK; u++)
        if (b->free_of[u] != BW_NONE) {
            sum[touched[0] = b->free_of[u]] = 1;
            status = store_form(b, (int32_t)u, sum, touched, 1, &used);
        }
    for (size_t k = b->gone.step_count; k-- > 0 && status == BW_OK;) {
        const bw_eliminate_step *s = &b->gone.step[k];
        size_t n = 0;
        for (size_t i = s->begin; i < s->end; i++) {
            bw_eliminate_term t = b->gone.term[i];
            for (int32_t j = 0; j < b->form_size[t.unknown]; j++) {
                bw_quant_term f = b->form[b->form_at[t.unknown] + (size_t)j];
                if (!is_touched[f.index]) is_touched[f.index] = 1, touched[n++] = f.index;
                int64_t add;
                if (__builtin_mul_overflow(t.factor, (int64_t)f.factor, &add) || __builtin_add_overflow(sum[f.index], add, &sum[f.index]))
                    status = bw_fail(b->ctx, BW_E_RANGE, "factors of the quantization exceed the range");
            }
        }
        for (size_t i = 0; i < n; i++) is_touched[touched[i]] = 0;
        if (status == BW_OK) status = store_form(b, s->unknown, sum, touched, n, &used);
    }
    bw_free(b->ctx, sum);
    bw_free(b->ctx, touched);
    bw_free(b->ctx, is_touched);
    return status;
}

/* ---- classes ---- */

typedef struct {
    const build *b;
    int32_t unknown;
} keyed;

static int by_form(const void *x, const void *y) {
    const keyed *p = x, *q = y;
    const build *b = p->b;
    int32_t n = b->form_size[p->unknown], m = b->form_size[q->unknown];
    if (n != m) return n < m ? -1 : 1;
    const bw_quant_term *f = b->form + b->form_at[p->unknown], *g = b->form + b->form_at[q->unknown];
    for (int32_t i = 0; i < n; i++) {
        if (f[i].index != g[i].index) return f[i].index < g[i].index ? -1 : 1;
        if (f[i].factor != g[i].factor) return f[i].factor < g[i].factor ? -1 : 1;
    }
    return 0;
}

static int by_form_then_unknown(const void *x, const void *y) {
    int order = by_form(x, y);
    const keyed *p = x, *q = y;
    return order ? order : (p->unknown > q->unknown) - (p->unknown < q->unknown);
}

/* The first unknown of each class stands for it, then classes are numbered in the order of those. */
static bw_status find_classes(build *b) {
    size_t n = b->gone.count;
    keyed *list = bw_alloc(b->ctx, n, sizeof *list);
    b->class_of = bw_alloc(b->ctx, n, sizeof *b->class_of);
    if (!list || !b->class_of) {
        bw_free(b->ctx, list);
        return b->ctx->error.status;
    }
    for (size_t u = 0; u < n; u++) list[u] = (keyed){b, (int32_t)u};
    qsort(list, n, sizeof *list, by_form_then_unknown);
    for (size_t i = 0, first = 0; i < n; i++) {
        if (by_form(&list[first], &list[i])) first = i;
        b->class_of[list[i].unknown] = list[first].unknown;
    }
    bw_free(b->ctx, list);
    for (size_t u = 0; u < n; u++)
        b->class_of[u] = (size_t)b->class_of[u] == u ? (int32_t)b->model->class_count++ : b->class_of[b->class_of[u]];
    return BW_OK;
}

/* Input values of the extra unknowns: each came in as the last term of a step whose other terms are known then. */
static bw_status find_values(build *b) {
    size_t n = b->gone.count, arcs = b->complex->arc_count;
    b->value = bw_alloc(b->ctx, n, sizeof *b->value);
    if (!b->value) return b->ctx->error.status;
    for (size_t a = 0; a < arcs; a++) b->value[a] = b->complex->arc_length[a];
    size_t known = arcs;
    for (size_t k = 0; k < b->gone.step_count; k++) {
        const bw_eliminate_step *s = &b->gone.step[k];
        if (s->begin == s->end || (size_t)b->gone.term[s->end - 1].unknown != known || known == n) continue;
        __int128 rest = b->value[s->unknown];
        for (size_t i = s->begin; i + 1 < s->end; i++)
            rest -= (__int128)b->gone.term[i].factor * b->value[b->gone.term[i].unknown];
        b->value[known++] = (int64_t)rest;
    }
    return BW_OK;
}

static bw_status fill_classes(build *b) {
    bw_quant_model *m = b->model;
    size_t n = b->gone.count, classes = m->class_count;
    m->arc_class = bw_alloc(b->ctx, m->arc_count, sizeof *m->arc_class);
    m->class_weight = bw_alloc(b->ctx, classes, sizeof *m->class_weight);
    m->class_length = bw_alloc(b->ctx, classes, sizeof *m->class_length);
    m->class_free = bw_alloc(b->ctx, classes, sizeof *m->class_free);
    m->free_class = bw_alloc(b->ctx, m->free_count, sizeof *m->free_class);
    b->chief = bw_alloc(b->ctx, classes, sizeof *b->chief);
    if (!m->arc_class || !m->class_weight || !m->class_length || !m->class_free || !m->free_class || !b->chief)
        return b->ctx->error.status;
    for (size_t c = 0; c < classes; c++) m->class_free[c] = b->chief[c] = BW_NONE;
    for (size_t u = 0; u < n; u++) {
        int32_t c = b->class_of[u], *chief = &b->chief[c];
        m->class_length[c] = b->value[u];
        if (u < m->arc_count) m->arc_class[u] = c, m->class_weight[c]++;
        if (b->free_of[u] != BW_NONE) m->class_free[c] = b->free_of[u], m->free_class[b->free_of[u]] = c;
        if (*chief == BW_NONE || (b->step_of[*chief] != BW_NONE && (b->step_of[u] == BW_NONE || b->step_of[u] > b->step_of[*chief])))
            *chief = (int32_t)u; /* implied last, so by classes that are implied later still */
    }
    return BW_OK;
}

static size_t tidy_terms(bw_quant_term *t, size_t n) {
    size_t out = 0;
    qsort(t, n, sizeof *t, by_index);
    for (size_t i = 0; i < n;) {
        bw_quant_term sum = t[i++];
        while (i < n && t[i].index == sum.index) sum.factor += t[i++].factor;
        if (sum.factor) t[out++] = sum;
    }
    return out;
}

static bw_status fill_rows(build *b) {
    bw_quant_model *m = b->model;
    size_t rows = 0, forms = 0, k = 0, f = 0;
    for (size_t c = 0; c < m->class_count; c++) {
        int32_t step = b->step_of[b->chief[c]];
        if (step != BW_NONE) rows += b->gone.step[step].end - b->gone.step[step].begin;
        forms += (size_t)b->form_size[b->chief[c]];
    }
    m->row_begin = bw_alloc(b->ctx, m->class_count + 1, sizeof *m->row_begin);
    m->row = bw_alloc(b->ctx, rows, sizeof *m->row);
    m->form_begin = bw_alloc(b->ctx, m->class_count + 1, sizeof *m->form_begin);
    m->form = bw_alloc(b->ctx, forms, sizeof *m->form);
    if (!m->row_begin || !m->row || !m->form_begin || !m->form) return b->ctx->error.status;
    for (size_t c = 0; c < m->class_count; c++) {
        int32_t chief = b->chief[c], step = b->step_of[chief];
        size_t n = 0;
        for (size_t i = 0; step != BW_NONE && i < b->gone.step[step].end - b->gone.step[step].begin; i++) {
            bw_eliminate_term t = b->gone.term[b->gone.step[step].begin + i];
            if (t.factor > FACTOR_MAX || t.factor < -FACTOR_MAX)
                return bw_fail(b->ctx, BW_E_RANGE, "factors of the quantization exceed the range");
            m->row[k + n++] = (bw_quant_term){b->class_of[t.unknown], (int32_t)t.factor};
        }
        k += tidy_terms(m->row + k, n);
        m->row_begin[c + 1] = k;
        memcpy(m->form + f, b->form + b->form_at[chief], (size_t)b->form_size[chief] * sizeof *m->form);
        f += (size_t)b->form_size[chief];
        m->form_begin[c + 1] = f;
    }
    return BW_OK;
}

static bw_status fill_extents(build *b) {
    const bw_complex *x = b->complex;
    bw_quant_model *m = b->model;
    size_t k = 0;
    m->extent_begin = bw_alloc(b->ctx, 3 * m->block_count + 1, sizeof *m->extent_begin);
    m->extent = bw_alloc(b->ctx, x->block_edge_begin[12 * m->block_count], sizeof *m->extent);
    if (!m->extent_begin || !m->extent) return b->ctx->error.status;
    for (size_t e = 0; e < 3 * m->block_count; e++) { /* edge 4 * axis of the block: its low one */
        size_t edge = 12 * (e / 3) + 4 * (e % 3), n = 0;
        for (size_t i = x->block_edge_begin[edge]; i < x->block_edge_begin[edge + 1]; i++)
            m->extent[k + n++] = (bw_quant_term){m->arc_class[x->block_edge[i] >> 1], 1};
        k += tidy_terms(m->extent + k, n);
        m->extent_begin[e + 1] = k;
    }
    return BW_OK;
}

static bw_status run(build *b) {
    bw_status status = read_equalities(b->ctx, b->complex, &b->equal);
    bw_eliminate_input in = {b->equal.rows, b->complex->arc_count, b->equal.begin, b->equal.term, b->complex->arc_length};
    if (status == BW_OK) status = bw_eliminate(b->ctx, &in, &b->gone);
    if (status == BW_OK) status = number_free(b);
    if (status == BW_OK) status = make_forms(b);
    if (status == BW_OK) status = find_classes(b);
    if (status == BW_OK) status = find_values(b);
    if (status == BW_OK) status = fill_classes(b);
    if (status == BW_OK) status = fill_rows(b);
    if (status == BW_OK) status = fill_extents(b);
    return status;
}

bw_status bw_quant_model_init(bw_context *ctx, const bw_complex *complex, int32_t grid_exponent, bw_quant_model *model) {
    build b = {.ctx = ctx, .complex = complex, .model = model};
    *model = (bw_quant_model){.arc_count = complex->arc_count, .block_count = complex->block_count, .unit = ldexp(1, grid_exponent)};
    bw_status status = run(&b);
    bw_elimination_clear(ctx, &b.gone);
    bw_free(ctx, b.equal.begin);
    bw_free(ctx, b.equal.term);
    bw_free(ctx, b.step_of);
    bw_free(ctx, b.free_of);
    bw_free(ctx, b.form_at);
    bw_free(ctx, b.form_size);
    bw_free(ctx, b.form);
    bw_free(ctx, b.value);
    bw_free(ctx, b.class_of);
    bw_free(ctx, b.chief);
    if (status != BW_OK) bw_quant_model_clear(ctx, model);
    return status;
}

void bw_quant_model_clear(bw_context *ctx, bw_quant_model *m) {
    bw_free(ctx, m->arc_class);
    bw_free(ctx, m->class_weight);
    bw_free(ctx, m->class_length);
    bw_free(ctx, m->free_class);
    bw_free(ctx, m->class_free);
    bw_free(ctx, m->row_begin);
    bw_free(ctx, m->row);
    bw_free(ctx, m->form_begin);
    bw_free(ctx, m->form);
    bw_free(ctx, m->extent_begin);
    bw_free(ctx, m->extent);
    *m = (bw_quant_model){0};
}

/* ---- use ---- */

static int64_t evaluate(const bw_quant_term *term, size_t begin, size_t end, const int64_t *value) {
    __int128 sum = 0; /* of terms that may be larger than what they add up to */
    for (size_t i = begin; i < end; i++) sum += (__int128)term[i].factor * value[term[i].index];
    return (int64_t)sum;
}

void bw_quant_model_expand(const bw_quant_model *m, const int64_t *unknown, int64_t *class_value) {
    for (size_t c = 0; c < m->class_count; c++)
        class_value[c] = evaluate(m->form, m->form_begin[c], m->form_begin[c + 1], unknown);
}

void bw_quant_model_lengths(const bw_quant_model *m, const int64_t *class_value, int64_t *length) {
    for (size_t a = 0; a < m->arc_count; a++) length[a] = class_value[m->arc_class[a]];
}

int64_t bw_quant_model_extent(const bw_quant_model *m, size_t block, int axis, const int64_t *class_value) {
    size_t e = 3 * block + (size_t)axis;
    return evaluate(m->extent, m->extent_begin[e], m->extent_begin[e + 1], class_value);
}

static int64_t saturate(__int128 x) { return x > INT64_MAX ? INT64_MAX : x < INT64_MIN ? INT64_MIN : (int64_t)x; }

int64_t bw_quant_model_hexes(const bw_quant_model *m, const int64_t *class_value) {
    __int128 sum = 0;
    for (size_t b = 0; b < m->block_count; b++) {
        int64_t volume = 1;
        for (int axis = 0; axis < 3; axis++) volume = saturate((__int128)volume * bw_quant_model_extent(m, b, axis, class_value));
        sum += volume;
    }
    return saturate(sum);
}

bw_status bw_quant_model_constraint(bw_context *ctx, const bw_quant_model *m, const bw_constraint_list *list, size_t c,
                              bw_constraint_list *out) {
    size_t begin = list->begin[c], n = list->begin[c + 1] - begin;
    bw_term *term = bw_alloc(ctx, n, sizeof *term);
    if (!term) return ctx->error.status;
    for (size_t i = 0; i < n; i++) term[i] = (bw_term){m->arc_class[list->term[begin + i].arc], list->term[begin + i].factor};
    bw_status status = bw_constraint_add(ctx, out, list->rule[c], list->relation[c], term, n, list->bound[c]);
    bw_free(ctx, term);
    return status;
}

typedef struct {
    const bw_quant_model *m;
    size_t extent;
} extent_key;

static int by_extent(const void *x, const void *y) {
    const extent_key *p = x, *q = y;
    const bw_quant_model *m = p->m;
    size_t a = m->extent_begin[p->extent], b = m->extent_begin[q->extent];
    size_t n = m->extent_begin[p->extent + 1] - a, k = m->extent_begin[q->extent + 1] - b;
    if (n != k) return n < k ? -1 : 1;
    for (size_t i = 0; i < n; i++) {
        bw_quant_term s = m->extent[a + i], t = m->extent[b + i];
        if (s.index != t.index) return s.index < t.index ? -1 : 1;
        if (s.factor != t.factor) return s.factor < t.factor ? -1 : 1;
    }
    return 0;
}

static bw_status add_extent(bw_context *ctx, const bw_quant_model *m, size_t e, bw_constraint_list *out) {
    size_t begin = m->extent_begin[e], n = m->extent_begin[e + 1] - begin;
    bw_term *term = bw_alloc(ctx, n, sizeof *term);
    if (!term) return ctx->error.status;
    for (size_t i = 0; i < n; i++) term[i] = (bw_term){m->extent[begin + i].index, m->extent[begin + i].factor};
    bw_status status = bw_constraint_add(ctx, out, BW_RULE_EXTENT, BW_AT_LEAST, term, n, 0);
    bw_free(ctx, term);
    return status;
}

bw_status bw_quant_model_number_extents(bw_context *ctx, const bw_quant_model *m, int32_t *number, size_t *count) {
    size_t n = 3 * m->block_count;
    extent_key *list = bw_alloc(ctx, n, sizeof *list);
    if (!list) return ctx->error.status;
    for (size_t e = 0; e < n; e++) list[e] = (extent_key){m, e};
    qsort(list, n, sizeof *list, by_extent);
    *count = 0;
    for (size_t i = 0; i < n; i++) {
        *count += !i || by_extent(&list[i - 1], &list[i]);
        number[list[i].extent] = (int32_t)*count - 1;
    }
    bw_free(ctx, list);
    return BW_OK;
}

bw_status bw_quant_model_extents(bw_context *ctx, const bw_quant_model *m, bw_constraint_list *out) {
    size_t n = 3 * m->block_count, count = 0;
    int32_t *number = bw_alloc(ctx, n, sizeof *number);
    size_t *first = bw_alloc(ctx, n, sizeof *first);
    bw_status status = number && first ? bw_quant_model_number_extents(ctx, m, number, &count) : ctx->error.status;
    for (size_t e = n; e-- > 0 && status == BW_OK;) first[number[e]] = e;
    for (size_t i = 0; i < count && status == BW_OK; i++) status = add_extent(ctx, m, first[i], out);
    bw_free(ctx, number);
    bw_free(ctx, first);
    return status;
}

/* ---- check ---- */

static bw_status check_rows(bw_context *ctx, const bw_quant_model *m, const int64_t *value, const char *of) {
    for (size_t c = 0; c < m->class_count; c++) {
        if (m->class_free[c] != BW_NONE) continue;
        if (evaluate(m->row, m->row_begin[c], m->row_begin[c + 1], value) != value[c])
            return bw_fail(ctx, BW_E_CHECK, "row %zu of the quantization model does not hold for %s", c, of);
    }
    return BW_OK;
}

static bw_status check_patches(bw_context *ctx, const bw_complex *x, const bw_quant_model *m, const int64_t *value) {
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t side = 0; side < 2; side++) {
            int64_t sum[2] = {0, 0};
            for (size_t k = 0; k < 2; k++)
                for (size_t i = x->patch_chain_begin[4 * p + side + 2 * k]; i < x->patch_chain_begin[4 * p + side + 2 * k + 1]; i++)
                    sum[k] += value[m->arc_class[x->patch_chain[i] >> 1]];
            if (sum[0] != sum[1]) {
                bw_fail_element(ctx, "patch", (int64_t)p, NULL);
                return bw_fail(ctx, BW_E_CHECK, "a patch is no rectangle in some solution of the quantization model");
            }
        }
    return BW_OK;
}

bw_status bw_quant_model_check(bw_context *ctx, const bw_complex *complex, const bw_quant_model *m) {
    int64_t *unknown = bw_alloc(ctx, m->free_count, sizeof *unknown), *value = bw_alloc(ctx, m->class_count, sizeof *value);
    bw_status status = unknown && value ? check_rows(ctx, m, m->class_length, "the input") : ctx->error.status;
    for (size_t c = 0; c < m->class_count && status == BW_OK; c++)
        if (m->class_weight[c] && m->class_length[c] <= 0) status = bw_fail(ctx, BW_E_CHECK, "a class of arcs without length");
    for (size_t f = 0; f < m->free_count && status == BW_OK; f++) {
        unknown[f] = 1;
        bw_quant_model_expand(m, unknown, value);
        unknown[f] = 0;
        for (size_t g = 0; g < m->free_count && status == BW_OK; g++)
            if (value[m->free_class[g]] != (g == f)) status = bw_fail(ctx, BW_E_CHECK, "a free unknown of the quantization model is not free");
        if (status == BW_OK) status = check_rows(ctx, m, value, "a free unknown");
        if (status == BW_OK) status = check_patches(ctx, complex, m, value);
    }
    bw_free(ctx, unknown);
    bw_free(ctx, value);
    return status;
}
