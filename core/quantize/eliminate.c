#include "quantize/eliminate.h"

#include <stdlib.h>
#include <string.h>

#include "base/index.h"

#define FACTOR_MAX ((int64_t)1 << 40)

typedef struct {
    bw_eliminate_term *term; /* ascending */
    size_t count, room;
    int32_t next; /* in its bucket */
    int32_t bucket;
} row;

typedef struct {
    int32_t *row; /* rows that have or had the unknown */
    size_t count, room;
    int32_t alive;
} column;

enum { BUCKETS = 32 };

typedef struct {
    bw_context *ctx;
    const bw_eliminate_input *input;
    bw_elimination *out;
    row *rows;
    bw_eliminate_term *spare;
    size_t spare_room;
    column *columns;
    size_t column_count, column_room;
    int32_t bucket[BUCKETS]; /* rows by length; a row may be in buckets it does not belong to any more */
} solver;

/* ---- rows and columns ---- */

static void put(solver *s, int32_t r) { /* into the bucket of its length, at the front */
    row *x = &s->rows[r];
    int32_t b = (int32_t)(x->count < BUCKETS ? x->count : BUCKETS - 1);
    if (!x->count || x->bucket == b) return;
    if (x->bucket >= 0) { /* take it out: lists are short where it matters */
        int32_t *at = &s->bucket[x->bucket];
        while (*at != r) at = &s->rows[*at].next;
        *at = x->next;
    }
    x->bucket = b;
    x->next = s->bucket[b];
    s->bucket[b] = r;
}

static void take(solver *s, int32_t r) {
    row *x = &s->rows[r];
    if (x->bucket < 0) return;
    int32_t *at = &s->bucket[x->bucket];
    while (*at != r) at = &s->rows[*at].next;
    *at = x->next;
    x->bucket = -1;
}

static bw_status enlist(solver *s, int32_t unknown, int32_t r) {
    column *c = &s->columns[unknown];
    if (bw_reserve(s->ctx, &c->row, &c->room, c->count + 1)) return s->ctx->error.status;
    c->row[c->count++] = r;
    c->alive++;
    return BW_OK;
}

static bw_status add_column(solver *s) {
    if (bw_reserve(s->ctx, &s->columns, &s->column_room, s->column_count + 1)) return s->ctx->error.status;
    memset(&s->columns[s->column_count++], 0, sizeof *s->columns);
    return BW_OK;
}

static bw_eliminate_term *find(row *x, int32_t unknown) {
    size_t low = 0, high = x->count;
    while (low < high) {
        size_t mid = (low + high) / 2;
        if (x->term[mid].unknown < unknown) low = mid + 1;
        else high = mid;
    }
    return low < x->count && x->term[low].unknown == unknown ? &x->term[low] : NULL;
}

static int64_t gcd(int64_t a, int64_t b) {
    while (b) {
        int64_t r = a % b;
        a = b, b = r;
    }
    return a < 0 ? -a : a;
}

static void make_primitive(row *x) {
    int64_t g = 0;
    for (size_t i = 0; i < x->count && g != 1; i++) g = gcd(g, x->term[i].factor);
    for (size_t i = 0; i < x->count && g > 1; i++) x->term[i].factor /= g;
}

/* row r += times * (source without the unknown `skip`); the term of `skip` in r goes. */
static bw_status add_multiple(solver *s, int32_t r, int64_t times, const bw_eliminate_term *source, size_t count, int32_t skip) {
    row *x = &s->rows[r];
    size_t i = 0, j = 0, n = 0;
    if (bw_reserve(s->ctx, &s->spare, &s->spare_room, x->count + count)) return s->ctx->error.status;
    while (i < x->count || j < count) {
        if (i < x->count && x->term[i].unknown == skip) { i++; continue; }
        if (j < count && source[j].unknown == skip) { j++; continue; }
        bool left = i < x->count && (j == count || x->term[i].unknown <= source[j].unknown);
        bool right = j < count && (i == x->count || source[j].unknown <= x->term[i].unknown);
        bw_eliminate_term t = {left ? x->term[i].unknown : source[j].unknown, left ? x->term[i].factor : 0};
        int64_t add = 0;
        bool large = right && __builtin_mul_overflow(times, source[j].factor, &add);
        large = large || __builtin_add_overflow(t.factor, add, &t.factor);
        if (large || t.factor > FACTOR_MAX || t.factor < -FACTOR_MAX) return bw_fail(s->ctx, BW_E_RANGE, "factors of the quantization exceed the range");
        if (left && !t.factor) s->columns[t.unknown].alive--;
        if (!left && t.factor && enlist(s, t.unknown, r)) return s->ctx->error.status;
        if (t.factor) s->spare[n++] = t;
        i += left, j += right;
    }
    if (bw_reserve(s->ctx, &x->term, &x->room, n)) return s->ctx->error.status;
    memcpy(x->term, s->spare, n * sizeof *x->term);
    x->count = n;
    make_primitive(x);
    if (n) put(s, r);
    else take(s, r);
    return BW_OK;
}

/* ---- steps ---- */

/* Records unknown = sum of terms, and puts that into all rows. */
static bw_status substitute(solver *s, int32_t unknown, const bw_eliminate_term *terms, size_t count) {
    bw_elimination *out = s->out;
    if (bw_reserve(s->ctx, &out->step, &out->step_room, out->step_count + 1)) return s->ctx->error.status;
    if (bw_reserve(s->ctx, &out->term, &out->term_room, out->term_count + count)) return s->ctx->error.status;
    size_t begin = out->term_count;
    if (count) memcpy(out->term + begin, terms, count * sizeof *terms);
    out->term_count += count;
    out->step[out->step_count++] = (bw_eliminate_step){unknown, begin, out->term_count};
    for (size_t i = 0; i < s->columns[unknown].count; i++) {
        int32_t r = s->columns[unknown].row[i];
        bw_eliminate_term *t = find(&s->rows[r], unknown);
        if (t && add_multiple(s, r, t->factor, out->term + begin, count, unknown)) return s->ctx->error.status;
    }
    s->columns[unknown].alive = 0;
    return BW_OK;
}

/* The unit factor whose unknown fewest rows have, then the largest one, then the first; -1 if there is none. */
static ptrdiff_t choose(const solver *s, const row *x) {
    ptrdiff_t best = -1;
    for (size_t i = 0; i < x->count; i++) {
        int32_t u = x->term[i].unknown;
        if (x->term[i].factor != 1 && x->term[i].factor != -1) continue;
        if (best < 0) {
            best = (ptrdiff_t)i;
            continue;
        }
        int32_t b = x->term[best].unknown;
        int64_t size_u = (size_t)u < s->input->unknowns ? s->input->size[u] : 0;
        int64_t size_b = (size_t)b < s->input->unknowns ? s->input->size[b] : 0;
        if (s->columns[u].alive < s->columns[b].alive || (s->columns[u].alive == s->columns[b].alive && size_u > size_b))
            best = (ptrdiff_t)i;
    }
    return best;
}

/* An equation without unit factor: the unknown of the smallest factor becomes t - sum q_i x_i, which shrinks all other factors below half of it. */
static bw_status change_unknown(solver *s, const row *x) {
    size_t p = 0, n = 0;
    for (size_t i = 1; i < x->count; i++)
        if (llabs(x->term[i].factor) < llabs(x->term[p].factor)) p = i;
    bw_eliminate_term *terms = bw_alloc(s->ctx, x->count, sizeof *terms);
    if (!terms) return s->ctx->error.status;
    int64_t f = x->term[p].factor;
    int32_t given = x->term[p].unknown;
    for (size_t i = 0; i < x->count; i++) {
        int64_t g = x->term[i].factor, q = g / f, rest = g % f;
        if (2 * llabs(rest) > llabs(f)) q += (rest < 0) == (f < 0) ? 1 : -1;
        if (i != p && q) terms[n++] = (bw_eliminate_term){x->term[i].unknown, -q};
    }
    terms[n++] = (bw_eliminate_term){(int32_t)s->column_count, 1}; /* the largest index: stays sorted */
    bw_status status = add_column(s);
    if (status == BW_OK) status = substitute(s, given, terms, n);
    bw_free(s->ctx, terms);
    s->out->count = s->column_count;
    return status;
}

static bw_status eliminate_row(solver *s, int32_t r) {
    row *x = &s->rows[r];
    ptrdiff_t p = choose(s, x);
    if (p < 0 && x->count > 1) return change_unknown(s, x);
    if (p < 0) p = 0; /* f x = 0: primitive, so never here; x = 0 all the same */
    bw_eliminate_term pivot = x->term[p];
    size_t n = 0, count = x->count;
    bw_eliminate_term *terms = bw_alloc(s->ctx, count, sizeof *terms);
    if (!terms) return s->ctx->error.status;
    for (size_t i = 0; i < count; i++)
        if ((ptrdiff_t)i != p) terms[n++] = (bw_eliminate_term){x->term[i].unknown, pivot.factor > 0 ? -x->term[i].factor : x->term[i].factor};
    for (size_t i = 0; i < count; i++) s->columns[x->term[i].unknown].alive--;
    take(s, r);
    x->count = 0;
    bw_status status = substitute(s, pivot.unknown, terms, n);
    bw_free(s->ctx, terms);
    return status;
}

static bw_status load(solver *s) {
    const bw_eliminate_input *in = s->input;
    s->rows = bw_alloc(s->ctx, in->rows, sizeof *s->rows);
    if (!s->rows) return s->ctx->error.status;
    for (size_t u = 0; u < in->unknowns; u++)
        if (add_column(s)) return s->ctx->error.status;
    for (size_t r = in->rows; r-- > 0;) {
        row *x = &s->rows[r];
        x->bucket = -1;
        size_t n = in->begin[r + 1] - in->begin[r];
        if (bw_reserve(s->ctx, &x->term, &x->room, n)) return s->ctx->error.status;
        if (n) memcpy(x->term, in->term + in->begin[r], n * sizeof *x->term);
        x->count = n;
        make_primitive(x);
        for (size_t i = 0; i < n; i++)
            if (enlist(s, x->term[i].unknown, (int32_t)r)) return s->ctx->error.status;
        put(s, (int32_t)r);
    }
    return BW_OK;
}

static bw_status run(solver *s) {
    bw_status status = load(s);
    for (int b = 0; b < BUCKETS && status == BW_OK;) {
        if (s->bucket[b] < 0) {
            b++;
            continue;
        }
        status = bw_poll(s->ctx);
        if (status == BW_OK) status = eliminate_row(s, s->bucket[b]);
        b = 0;
    }
    return status;
}

bw_status bw_eliminate(bw_context *ctx, const bw_eliminate_input *input, bw_elimination *out) {
    solver s = {.ctx = ctx, .input = input, .out = out};
    *out = (bw_elimination){.count = input->unknowns};
    for (int b = 0; b < BUCKETS; b++) s.bucket[b] = -1;
    bw_status status = run(&s);
    for (size_t r = 0; s.rows && r < input->rows; r++) bw_free(ctx, s.rows[r].term);
    for (size_t c = 0; c < s.column_count; c++) bw_free(ctx, s.columns[c].row);
    bw_free(ctx, s.rows);
    bw_free(ctx, s.columns);
    bw_free(ctx, s.spare);
    if (status != BW_OK) bw_elimination_clear(ctx, out);
    return status;
}

void bw_elimination_clear(bw_context *ctx, bw_elimination *out) {
    bw_free(ctx, out->step);
    bw_free(ctx, out->term);
    *out = (bw_elimination){0};
}
