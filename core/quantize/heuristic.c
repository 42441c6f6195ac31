#include "quantize/heuristic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PAIRS_MAX = 20000, SWEEPS_MAX = 1000, RETRIES_MAX = 200 };

/* ---- moves ---- */

/* Appends sum of sign[i] * unknown[i] as a move. `sum` is all zero before and after. */
static bw_status add_move(bw_context *ctx, const size_t *column_begin, const bw_quant_term *column,
                          const int32_t *unknown, const int32_t *sign, int n, int64_t *sum, bw_quant_moves *moves) {
    size_t k = moves->begin[moves->count], need = 0;
    for (int i = 0; i < n; i++) need += column_begin[unknown[i] + 1] - column_begin[unknown[i]];
    if (bw_reserve(ctx, &moves->term, &moves->term_room, k + need)) return ctx->error.status;
    if (bw_reserve(ctx, &moves->begin, &moves->begin_room, moves->count + 2)) return ctx->error.status;
    for (int i = 0; i < n; i++)
        for (size_t j = column_begin[unknown[i]]; j < column_begin[unknown[i] + 1]; j++)
            sum[column[j].index] += (int64_t)sign[i] * column[j].factor;
    for (int i = 0; i < n; i++)
        for (size_t j = column_begin[unknown[i]]; j < column_begin[unknown[i] + 1]; j++) {
            int32_t c = column[j].index;
            if (sum[c]) moves->term[k++] = (bw_quant_term){c, (int32_t)sum[c]};
            sum[c] = 0;
        }
    if (k > moves->begin[moves->count]) moves->begin[++moves->count] = k;
    return BW_OK;
}

/* Forms by unknown instead of by class. */
static bw_status make_columns(bw_context *ctx, const bw_quant_model *m, size_t **begin, bw_quant_term **column) {
    *begin = bw_alloc(ctx, m->free_count + 2, sizeof **begin);
    *column = bw_alloc(ctx, m->form_begin[m->class_count], sizeof **column);
    if (!*begin || !*column) return ctx->error.status;
    for (size_t i = 0; i < m->form_begin[m->class_count]; i++) (*begin)[m->form[i].index + 2]++;
    for (size_t f = 0; f < m->free_count; f++) (*begin)[f + 2] += (*begin)[f + 1];
    for (size_t c = 0; c < m->class_count; c++)
        for (size_t i = m->form_begin[c]; i < m->form_begin[c + 1]; i++)
            (*column)[(*begin)[m->form[i].index + 1]++] = (bw_quant_term){(int32_t)c, m->form[i].factor};
    return BW_OK;
}

/* Whether two unknowns have a class in common: otherwise moving both is no more than moving each. Constraints couple them too, so where there are
 * few unknowns all pairs are taken. */
static bool meet(const size_t *begin, const bw_quant_term *column, size_t f, size_t g) {
    for (size_t i = begin[f], j = begin[g]; i < begin[f + 1] && j < begin[g + 1];) {
        if (column[i].index == column[j].index) return true;
        if (column[i].index < column[j].index) i++;
        else j++;
    }
    return false;
}

bw_status bw_quant_moves_init(bw_context *ctx, const bw_quant_model *m, bw_quant_moves *moves) {
    static const int32_t one[2] = {1, 1}, against[2] = {1, -1};
    size_t *begin = NULL, pairs = m->free_count * (m->free_count + 1);
    bw_quant_term *column = NULL;
    int64_t *sum = bw_alloc(ctx, m->class_count, sizeof *sum);
    *moves = (bw_quant_moves){0};
    bw_status status = sum ? make_columns(ctx, m, &begin, &column) : ctx->error.status;
    if (status == BW_OK) status = bw_reserve(ctx, &moves->begin, &moves->begin_room, 1);
    for (size_t f = 0; f < m->free_count && status == BW_OK; f++) {
        int32_t u[1] = {(int32_t)f};
        status = add_move(ctx, begin, column, u, one, 1, sum, moves);
    }
    for (size_t f = 0; f < m->free_count && status == BW_OK && moves->count < PAIRS_MAX; f++)
        for (size_t g = f + 1; g < m->free_count && status == BW_OK; g++) {
            int32_t u[2] = {(int32_t)f, (int32_t)g};
            if (pairs > PAIRS_MAX && !meet(begin, column, f, g)) continue;
            status = add_move(ctx, begin, column, u, against, 2, sum, moves);
            if (status == BW_OK) status = add_move(ctx, begin, column, u, one, 2, sum, moves);
        }
    bw_free(ctx, sum);
    bw_free(ctx, begin);
    bw_free(ctx, column);
    if (status != BW_OK) bw_quant_moves_clear(ctx, moves);
    return status;
}

void bw_quant_moves_clear(bw_context *ctx, bw_quant_moves *moves) {
    bw_free(ctx, moves->begin);
    bw_free(ctx, moves->term);
    *moves = (bw_quant_moves){0};
}

/* ---- descent ---- */

typedef struct {
    const bw_quant_problem *p;
    int64_t *value, *activity; /* [class], [row] */
    size_t *use_begin;         /* [class + 1]: rows that have it */
    bw_quant_term *use;        /* row, factor */
    int64_t *gain;             /* [row] of the move at hand; zero between moves */
    int32_t *touched;
    size_t touched_count;
} descent;

static bw_status descent_open(bw_context *ctx, const bw_quant_problem *p, int64_t *value, descent *d) {
    const bw_constraint_list *l = &p->rows;
    size_t classes = p->model->class_count, terms = l->count ? l->begin[l->count] : 0;
    *d = (descent){.p = p, .value = value};
    d->activity = bw_alloc(ctx, l->count, sizeof *d->activity);
    d->use_begin = bw_alloc(ctx, classes + 2, sizeof *d->use_begin);
    d->use = bw_alloc(ctx, terms, sizeof *d->use);
    d->gain = bw_alloc(ctx, l->count, sizeof *d->gain);
    d->touched = bw_alloc(ctx, terms, sizeof *d->touched);
    if (!d->activity || !d->use_begin || !d->use || !d->gain || !d->touched) return ctx->error.status;
    for (size_t r = 0; r < l->count; r++) d->activity[r] = bw_constraint_value(l, r, value);
    for (size_t i = 0; i < terms; i++) d->use_begin[l->term[i].arc + 2]++;
    for (size_t c = 0; c < classes; c++) d->use_begin[c + 2] += d->use_begin[c + 1];
    for (size_t r = 0; r < l->count; r++)
        for (size_t i = l->begin[r]; i < l->begin[r + 1]; i++)
            d->use[d->use_begin[l->term[i].arc + 1]++] = (bw_quant_term){(int32_t)r, l->term[i].factor};
    return BW_OK;
}

static void descent_close(bw_context *ctx, descent *d) {
    bw_free(ctx, d->activity);
    bw_free(ctx, d->use_begin);
    bw_free(ctx, d->use);
    bw_free(ctx, d->gain);
    bw_free(ctx, d->touched);
}

/* room / slope, rounded towards zero, as a limit on the number of steps. */
static void restrict_steps(int64_t room, int64_t slope, int64_t *low, int64_t *high) {
    if (slope < 0 && room / -slope < *high) *high = room / -slope;
    if (slope > 0 && -(room / slope) > *low) *low = -(room / slope);
}

/* How often a move may be made, backwards and forwards. Leaves its effect on rows in gain[]. */
static void find_limits(descent *d, const bw_quant_term *move, size_t n, int64_t *low, int64_t *high) {
    const bw_quant_problem *p = d->p;
    *low = -((int64_t)1 << 40), *high = (int64_t)1 << 40;
    d->touched_count = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        int64_t least = bw_quant_problem_least(p, c);
        if (least != INT64_MIN) restrict_steps(d->value[c] - least, move[i].factor, low, high);
        for (size_t u = d->use_begin[c]; u < d->use_begin[c + 1]; u++) {
            int32_t r = d->use[u].index;
            int64_t add = (int64_t)d->use[u].factor * move[i].factor;
            if (!d->gain[r] && add) d->touched[d->touched_count++] = r; /* may come twice if it was zero between */
            d->gain[r] += add;
        }
    }
    for (size_t i = 0; i < d->touched_count; i++) {
        int32_t r = d->touched[i];
        int64_t room = d->activity[r] - p->rows.bound[r];
        restrict_steps(room, d->gain[r], low, high);
        if (p->rows.relation[r] == BW_EQUAL && d->gain[r]) *low = *high = 0;
    }
}

static void forget_gains(descent *d) {
    for (size_t i = 0; i < d->touched_count; i++) d->gain[d->touched[i]] = 0;
}

static void take_steps(descent *d, const bw_quant_term *move, size_t n, int64_t steps) {
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        d->value[c] += steps * move[i].factor;
        for (size_t u = d->use_begin[c]; u < d->use_begin[c + 1]; u++)
            d->activity[d->use[u].index] += steps * d->use[u].factor * move[i].factor;
    }
}

/* Makes a move as often as it pays; whether it did. */
static bool try_move(descent *d, const bw_quant_term *move, size_t n) {
    double curve = 0, slope = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        double w = d->p->model->class_weight[c], f = move[i].factor;
        curve += w * f * f;
        slope += w * f * ((double)d->value[c] - d->p->target[c]);
    }
    if (curve <= 0) return false;
    int64_t steps = llround(-slope / curve), low, high;
    if (!steps) return false;
    find_limits(d, move, n, &low, &high);
    forget_gains(d);
    if (steps < low) steps = low;
    if (steps > high) steps = high;
    double k = (double)steps;
    if (!(k * (k * curve + 2 * slope) < -1e-9 * (1 + curve))) return false;
    take_steps(d, move, n, steps);
    return true;
}

bw_status bw_quant_descend(bw_context *ctx, const bw_quant_problem *p, const bw_quant_moves *moves, int64_t *value) {
    descent d;
    bw_status status = descent_open(ctx, p, value, &d);
    size_t quiet = 0; /* moves tried in a row that did not pay */
    for (int sweep = 0; sweep < SWEEPS_MAX && quiet < moves->count && status == BW_OK; sweep++) {
        status = bw_poll(ctx);
        for (size_t k = 0; k < moves->count && quiet < moves->count; k++) {
            size_t n = moves->begin[k + 1] - moves->begin[k];
            quiet = try_move(&d, moves->term + moves->begin[k], n) ? 0 : quiet + 1;
        }
    }
    descent_close(ctx, &d);
    return status;
}

/* ---- start ---- */

/* Values that follow from free unknowns rounded at some enlargement. */
static void enlarge(const bw_quant_problem *p, double factor, int64_t *unknown, int64_t *value) {
    const bw_quant_model *m = p->model;
    for (size_t f = 0; f < m->free_count; f++) unknown[f] = llround(factor * ((double)m->class_length[m->free_class[f]] / m->unit));
    bw_quant_model_expand(m, unknown, value);
}

static double first_enlargement(const bw_quant_problem *p) {
    const bw_quant_model *m = p->model;
    double shortest = INFINITY;
    for (size_t c = 0; c < m->class_count; c++)
        if (m->class_weight[c]) shortest = fmin(shortest, (double)m->class_length[c] / m->unit);
    return p->scale > 0 ? p->scale : 0.25 / shortest;
}

/* The smallest of a row of enlargements that is valid. The last one is the input on its grid: all its lengths are positive and every
 * valid constraint holds for it. */
static bw_status find_start(bw_context *ctx, bw_quant_problem *p, bw_quant_oracle *oracle, int64_t *unknown, int64_t *value) {
    bool valid = false;
    for (double factor = first_enlargement(p); !valid; factor *= 1.5) {
        if (bw_poll(ctx)) return ctx->error.status;
        bool last = factor >= p->model->unit;
        enlarge(p, last ? p->model->unit : factor, unknown, value);
        if (bw_quant_problem_allows(p, value) && bw_quant_problem_separate(ctx, p, oracle, value, &valid)) return ctx->error.status;
        if (last && !valid) return bw_fail(ctx, BW_E_ALGORITHM, "the lengths of the input themselves are no valid quantization");
    }
    return BW_OK;
}

bw_status bw_quant_heuristic(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                             const int64_t *start, int64_t *value) {
    size_t n = p->model->class_count;
    int64_t *next = bw_alloc(ctx, n, sizeof *next), *unknown = bw_alloc(ctx, p->model->free_count, sizeof *unknown);
    bw_status status = next && unknown ? BW_OK : ctx->error.status;
    if (status == BW_OK && start) memmove(value, start, n * sizeof *value);
    else if (status == BW_OK) status = find_start(ctx, p, oracle, unknown, value);
    for (int retry = 0; retry < RETRIES_MAX && status == BW_OK; retry++) {
        bool valid = true;
        memcpy(next, value, n * sizeof *value);
        if (!bw_quant_problem_allows(p, value)) break; /* a constraint learnt since excludes it: descent has nowhere to start from */
        status = bw_quant_descend(ctx, p, moves, next);
        if (status == BW_OK) status = bw_quant_problem_separate(ctx, p, oracle, next, &valid);
        if (status != BW_OK || !valid) continue;
        memcpy(value, next, n * sizeof *value);
        break;
    }
    bw_free(ctx, next);
    bw_free(ctx, unknown);
    return status;
}
