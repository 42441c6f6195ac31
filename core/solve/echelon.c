#include "solve/echelon.h"

#include <gmp.h>
#include <stdlib.h>
#include <string.h>

_Static_assert(sizeof(long) == sizeof(int64_t), "GMP's long is taken for 64 bits");

typedef struct {
    mpz_t factor;
    int32_t column;
} entry;

/* Ascending columns, no zeros, primitive. entry[0 .. room - 1] are all initialised. */
typedef struct {
    entry *entry;
    size_t count, room;
    int32_t pivot;         /* column; -1 while active */
    int32_t before, after; /* active rows of one bucket */
    int32_t bucket;        /* -1: in none */
} row;

/* Rows that once had a column: stale ones are sorted out on use. */
typedef struct {
    int32_t *row;
    size_t count, room;
    size_t alive; /* active rows that have the column */
} column;

enum { BUCKETS = 64 }; /* by length; the last one for rows without a factor of 1 */

typedef struct {
    bw_context *ctx;
    row *rows, spare;
    column *columns;
    size_t row_count, column_count;
    int32_t bucket[BUCKETS];
    int32_t *order;     /* rows in the order they were made pivots */
    int32_t *pivot_row; /* [column] row that implies it, or -1 */
    size_t rank;
    mpz_t p, q, g;
} solver;

/* ---- rows ---- */

static bw_status row_room(bw_context *ctx, row *r, size_t need) {
    size_t before = r->room;
    if (bw_reserve(ctx, &r->entry, &r->room, need)) return ctx->error.status;
    for (size_t i = before; i < r->room; i++) mpz_init(r->entry[i].factor);
    return BW_OK;
}

static void row_clear(bw_context *ctx, row *r) {
    for (size_t i = 0; i < r->room; i++) mpz_clear(r->entry[i].factor);
    bw_free(ctx, r->entry);
}

static entry *row_find(const row *r, int32_t c) {
    size_t low = 0, high = r->count;
    while (low < high) {
        size_t mid = (low + high) / 2;
        if (r->entry[mid].column < c)
            low = mid + 1;
        else
            high = mid;
    }
    return low < r->count && r->entry[low].column == c ? &r->entry[low] : NULL;
}

static void make_primitive(solver *s, row *r) {
    mpz_set_ui(s->g, 0);
    for (size_t i = 0; i < r->count; i++) {
        mpz_gcd(s->g, s->g, r->entry[i].factor);
        if (!mpz_cmp_ui(s->g, 1)) return;
    }
    for (size_t i = 0; i < r->count; i++) mpz_divexact(r->entry[i].factor, r->entry[i].factor, s->g);
}

static bw_status note_column(solver *s, int32_t c, int32_t r) {
    column *k = &s->columns[c];
    if (bw_reserve(s->ctx, &k->row, &k->room, k->count + 1)) return s->ctx->error.status;
    k->row[k->count++] = r;
    return BW_OK;
}

/* target := p target - q source, with p, q such that column c vanishes. `active`: keep the columns' lists up
 * to date. */
static bw_status subtract(solver *s, int32_t target, const row *source, int32_t c, bool active) {
    row *t = &s->rows[target], *out = &s->spare;
    entry *tc = row_find(t, c), *sc = row_find(source, c);
    mpz_gcd(s->g, tc->factor, sc->factor);
    mpz_divexact(s->p, sc->factor, s->g);
    mpz_divexact(s->q, tc->factor, s->g);
    if (row_room(s->ctx, out, t->count + source->count)) return s->ctx->error.status;
    size_t i = 0, j = 0, n = 0;
    while (i < t->count || j < source->count) {
        bool has_t = i < t->count && (j == source->count || t->entry[i].column <= source->entry[j].column);
        bool has_s = j < source->count && (i == t->count || source->entry[j].column <= t->entry[i].column);
        entry *e = &out->entry[n];
        e->column = has_t ? t->entry[i].column : source->entry[j].column;
        if (has_t)
            mpz_mul(e->factor, s->p, t->entry[i].factor);
        else
            mpz_set_ui(e->factor, 0);
        if (has_s) mpz_submul(e->factor, s->q, source->entry[j].factor);
        bool zero = !mpz_sgn(e->factor);
        if (active && has_t && zero) s->columns[e->column].alive--;
        if (active && !has_t) {
            s->columns[e->column].alive++;
            if (note_column(s, e->column, target)) return s->ctx->error.status;
        }
        n += !zero;
        i += has_t, j += has_s;
    }
    out->count = n;
    entry *swap = t->entry;
    size_t room = t->room;
    t->entry = out->entry, t->room = out->room, t->count = n;
    out->entry = swap, out->room = room;
    make_primitive(s, t);
    return BW_OK;
}

/* ---- choice of pivots ---- */

static void bucket_take(solver *s, int32_t r) {
    row *x = &s->rows[r];
    if (x->bucket < 0) return;
    if (x->before >= 0)
        s->rows[x->before].after = x->after;
    else
        s->bucket[x->bucket] = x->after;
    if (x->after >= 0) s->rows[x->after].before = x->before;
    x->bucket = -1;
}

static void bucket_put(solver *s, int32_t r) {
    row *x = &s->rows[r];
    bool unit = false;
    if (!x->count) return;
    for (size_t i = 0; i < x->count && !unit; i++) unit = !mpz_cmpabs_ui(x->entry[i].factor, 1);
    x->bucket = !unit ? BUCKETS - 1 : x->count < BUCKETS - 1 ? (int32_t)x->count : BUCKETS - 2;
    x->before = -1;
    x->after = s->bucket[x->bucket];
    if (x->after >= 0) s->rows[x->after].before = r;
    s->bucket[x->bucket] = r;
}

/* The smallest factor, then the column that fewest rows have, then the lowest column. */
static int32_t choose_column(const solver *s, const row *r) {
    const entry *best = &r->entry[0];
    for (size_t i = 1; i < r->count; i++) {
        const entry *e = &r->entry[i];
        int order = mpz_cmpabs(e->factor, best->factor);
        if (order < 0 || (order == 0 && s->columns[e->column].alive < s->columns[best->column].alive))
            best = e;
    }
    return best->column;
}

/* Makes a row a pivot row and clears its column from all active rows. */
static bw_status eliminate(solver *s, int32_t r) {
    row *pivot = &s->rows[r];
    int32_t c = choose_column(s, pivot);
    bucket_take(s, r);
    pivot->pivot = c;
    s->pivot_row[c] = r;
    s->order[s->rank++] = r;
    for (size_t i = 0; i < pivot->count; i++) s->columns[pivot->entry[i].column].alive--;
    for (size_t i = 0; i < s->columns[c].count; i++) {
        int32_t other = s->columns[c].row[i];
        if (s->rows[other].pivot >= 0 || !row_find(&s->rows[other], c)) continue;
        bucket_take(s, other);
        if (subtract(s, other, pivot, c, true)) return s->ctx->error.status;
        bucket_put(s, other);
    }
    s->columns[c].count = 0;
    return BW_OK;
}

static bw_status forward(solver *s) {
    for (;;) {
        int32_t b = 0;
        while (b < BUCKETS && s->bucket[b] < 0) b++;
        if (b == BUCKETS) return BW_OK;
        if (bw_poll(s->ctx) || eliminate(s, s->bucket[b])) return s->ctx->error.status;
    }
}

/* From the last pivot to the first: a row's other pivots belong to later rows, which are reduced already and
 * bring in free columns only. */
static bw_status backward(solver *s) {
    for (size_t i = s->rank; i-- > 0;) {
        int32_t r = s->order[i];
        if (bw_poll(s->ctx)) return s->ctx->error.status;
        for (size_t k = 0; k < s->rows[r].count;) {
            int32_t c = s->rows[r].entry[k].column, other = s->pivot_row[c];
            if (other < 0 || other == r) {
                k++;
                continue;
            }
            /* Columns before k are no pivots but the row's own, and stay, or vanish, or are joined by free
             * ones. */
            if (subtract(s, r, &s->rows[other], c, false)) return s->ctx->error.status;
            for (k = 0; k < s->rows[r].count && s->rows[r].entry[k].column < c; k++) {
            }
        }
    }
    return BW_OK;
}

/* ---- values ---- */

static bw_status too_fine(bw_context *ctx) {
    return bw_fail(ctx, BW_E_RANGE, "the core system divides by more than the exact grid has room for");
}

/* divisor[c] := lcm over the rows of p / gcd(p, a_c). */
static bw_status find_divisors(solver *s, int64_t max_divisor, int64_t *divisor) {
    for (size_t c = 0; c < s->column_count; c++) divisor[c] = 0;
    for (size_t i = 0; i < s->rank; i++) {
        row *r = &s->rows[s->order[i]];
        mpz_srcptr p = row_find(r, r->pivot)->factor;
        for (size_t k = 0; k < r->count; k++) {
            int32_t c = r->entry[k].column;
            if (c == r->pivot) continue;
            mpz_gcd(s->g, p, r->entry[k].factor);
            mpz_divexact(s->q, p, s->g);
            mpz_lcm_ui(s->q, s->q, (unsigned long)(divisor[c] ? divisor[c] : 1));
            if (mpz_cmpabs_ui(s->q, (unsigned long)max_divisor) > 0) return too_fine(s->ctx);
            divisor[c] = mpz_get_si(s->q);
        }
    }
    return BW_OK;
}

/* The multiple of d nearest to x; halves go away from zero. */
static int64_t round_to(int64_t x, int64_t d) {
    int64_t rest = x % d, down = x - rest;
    if (2 * llabs(rest) < d) return down;
    return rest > 0 ? down + d : down - d;
}

static bw_status assign(solver *s, const int64_t *estimate, const int64_t *divisor, int64_t max_value,
                        int64_t *x) {
    for (size_t c = 0; c < s->column_count; c++)
        x[c] = divisor[c] ? round_to(estimate[c], divisor[c]) : estimate[c];
    for (size_t i = 0; i < s->rank; i++) {
        row *r = &s->rows[s->order[i]];
        mpz_set_ui(s->p, 0);
        for (size_t k = 0; k < r->count; k++) {
            if (r->entry[k].column == r->pivot) continue;
            mpz_set_si(s->q, x[r->entry[k].column]);
            mpz_submul(s->p, s->q, r->entry[k].factor);
        }
        mpz_srcptr p = row_find(r, r->pivot)->factor;
        if (!mpz_divisible_p(s->p, p))
            return bw_fail(s->ctx, BW_E_INTERNAL, "an implied unknown is no integer");
        mpz_divexact(s->p, s->p, p);
        if (mpz_cmpabs_ui(s->p, (unsigned long)max_value) > 0)
            return bw_fail(s->ctx, BW_E_RANGE, "an unknown of the core system leaves the exact grid");
        x[r->pivot] = mpz_get_si(s->p);
    }
    return BW_OK;
}

/* ---- set-up ---- */

static bw_status load(solver *s, const bw_equations *in) {
    for (size_t r = 0; r < in->rows; r++) {
        row *x = &s->rows[r];
        x->pivot = x->bucket = -1;
        if (row_room(s->ctx, x, in->start[r + 1] - in->start[r])) return s->ctx->error.status;
        for (size_t i = in->start[r]; i < in->start[r + 1]; i++) {
            if (!in->coefficient[i]) continue;
            mpz_set_si(x->entry[x->count].factor, in->coefficient[i]);
            x->entry[x->count++].column = in->column[i];
            s->columns[in->column[i]].alive++;
            if (note_column(s, in->column[i], (int32_t)r)) return s->ctx->error.status;
        }
        make_primitive(s, x);
    }
    for (int b = 0; b < BUCKETS; b++) s->bucket[b] = -1;
    for (size_t r = in->rows; r-- > 0;) bucket_put(s, (int32_t)r);
    for (size_t c = 0; c < in->columns; c++) s->pivot_row[c] = -1;
    return BW_OK;
}

static void solver_clear(solver *s) {
    for (size_t r = 0; s->rows && r < s->row_count; r++) row_clear(s->ctx, &s->rows[r]);
    for (size_t c = 0; s->columns && c < s->column_count; c++) bw_free(s->ctx, s->columns[c].row);
    row_clear(s->ctx, &s->spare);
    bw_free(s->ctx, s->rows);
    bw_free(s->ctx, s->columns);
    bw_free(s->ctx, s->order);
    bw_free(s->ctx, s->pivot_row);
    mpz_clears(s->p, s->q, s->g, NULL);
}

bw_status bw_echelon_solve(bw_context *ctx, const bw_equations *equations, const int64_t *estimate,
                           int64_t max_divisor, int64_t max_value, int64_t *x, bw_echelon_report *report) {
    solver s = {.ctx = ctx, .row_count = equations->rows, .column_count = equations->columns};
    int64_t *divisor = bw_alloc(ctx, equations->columns, sizeof *divisor);
    mpz_inits(s.p, s.q, s.g, NULL);
    s.rows = bw_alloc(ctx, s.row_count, sizeof *s.rows);
    s.columns = bw_alloc(ctx, s.column_count, sizeof *s.columns);
    s.order = bw_alloc(ctx, s.row_count, sizeof *s.order);
    s.pivot_row = bw_alloc(ctx, s.column_count, sizeof *s.pivot_row);
    if (ctx->error.status || load(&s, equations) || forward(&s) || backward(&s)) goto out;
    if (find_divisors(&s, max_divisor, divisor) || assign(&s, estimate, divisor, max_value, x)) goto out;
    *report = (bw_echelon_report){.rank = s.rank, .divisor = 1};
    for (size_t c = 0; c < s.column_count; c++) {
        report->free += divisor[c] != 0;
        if (divisor[c] > report->divisor) report->divisor = divisor[c];
    }
out:
    solver_clear(&s);
    bw_free(ctx, divisor);
    return ctx->error.status;
}
