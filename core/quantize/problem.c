#include "quantize/problem.h"

#include <math.h>
#include <string.h>

bw_status bw_quant_problem_init(bw_context *ctx, const bw_quant_model *model, bw_quantize_range range, bw_quant_problem *p) {
    *p = (bw_quant_problem){.model = model, .range = range};
    p->target = bw_alloc(ctx, model->class_count, sizeof *p->target);
    p->length = bw_alloc(ctx, model->arc_count, sizeof *p->length);
    bw_status status = p->target && p->length ? BW_OK : ctx->error.status;
    if (status == BW_OK && range == BW_QUANTIZE_ANY) status = bw_quant_model_extents(ctx, model, &p->rows); /* else implied */
    if (status == BW_OK) bw_quant_problem_set_scale(p, 0);
    else bw_quant_problem_clear(ctx, p);
    return status;
}

void bw_quant_problem_clear(bw_context *ctx, bw_quant_problem *p) {
    bw_free(ctx, p->target);
    bw_free(ctx, p->length);
    bw_constraint_clear(ctx, &p->rows);
    *p = (bw_quant_problem){0};
}

void bw_quant_problem_set_scale(bw_quant_problem *p, double scale) {
    p->scale = scale;
    for (size_t c = 0; c < p->model->class_count; c++)
        p->target[c] = scale * ((double)p->model->class_length[c] / p->model->unit);
}

static bool has_row(const bw_constraint_list *list, size_t c) {
    size_t n = list->begin[c + 1] - list->begin[c];
    for (size_t d = 0; d < c; d++)
        if (list->begin[d + 1] - list->begin[d] == n && list->relation[d] == list->relation[c] && list->bound[d] == list->bound[c] &&
            !memcmp(list->term + list->begin[d], list->term + list->begin[c], n * sizeof *list->term))
            return true;
    return false;
}

bw_status bw_quant_problem_add(bw_context *ctx, bw_quant_problem *p, const bw_constraint_list *list, size_t *added) {
    *added = 0;
    for (size_t c = 0; c < list->count; c++) {
        if (bw_quant_model_constraint(ctx, p->model, list, c, &p->rows)) return ctx->error.status;
        if (has_row(&p->rows, p->rows.count - 1)) p->rows.count--; /* begin[] of the one before still ends it */
        else ++*added;
    }
    return BW_OK;
}

int64_t bw_quant_problem_least(const bw_quant_problem *p, size_t class) {
    if (p->range == BW_QUANTIZE_ANY || !p->model->class_weight[class]) return INT64_MIN;
    return p->range == BW_QUANTIZE_POSITIVE;
}

double bw_quant_problem_objective(const bw_quant_problem *p, const int64_t *value) {
    double sum = 0;
    for (size_t c = 0; c < p->model->class_count; c++) {
        double away = (double)value[c] - p->target[c];
        sum += p->model->class_weight[c] * away * away;
    }
    return sum;
}

bool bw_quant_problem_allows(const bw_quant_problem *p, const int64_t *value) {
    for (size_t c = 0; c < p->model->class_count; c++)
        if (value[c] < bw_quant_problem_least(p, c)) return false;
    return bw_constraint_first_broken(&p->rows, value) == p->rows.count;
}

bw_status bw_quant_problem_separate(bw_context *ctx, bw_quant_problem *p, bw_quant_oracle *oracle, const int64_t *value, bool *valid) {
    *valid = true;
    if (!oracle->separate) return BW_OK;
    double since = bw_seconds_now();
    bw_constraint_list violated = {0};
    size_t added = 0;
    bw_quant_model_lengths(p->model, value, p->length);
    bw_status status = oracle->separate(oracle->user, p->length, &violated);
    *valid = !violated.count;
    if (status == BW_OK) status = bw_quant_problem_add(ctx, p, &violated, &added);
    if (status == BW_OK && !*valid && !added) {
        size_t held = 0;
        for (size_t c = 0; c < violated.count; c++) held += bw_constraint_holds(&violated, c, p->length);
        if (held == violated.count) status = bw_fail(ctx, BW_E_ALGORITHM, "the validity test names constraints that hold");
    }
    bw_constraint_clear(ctx, &violated);
    oracle->calls++, oracle->rounds += !*valid;
    oracle->seconds += bw_seconds_now() - since;
    return status;
}

/* ---- bound ---- */

/* What one more (sign 1) or one less (-1) of a class adds to the objective. */
static double step_cost(const bw_quant_problem *p, size_t c, int64_t value, int sign) {
    double away = (double)value - p->target[c];
    return p->model->class_weight[c] * (1 + 2 * sign * away);
}

static bool is_usable(const bw_quant_problem *p, size_t row, const uint8_t *used) {
    const bw_constraint_list *l = &p->rows;
    if (l->relation[row] != BW_AT_LEAST) return false;
    for (size_t i = l->begin[row]; i < l->begin[row + 1]; i++)
        if (used[l->term[i].arc] || (l->term[i].factor != 1 && l->term[i].factor != -1)) return false;
    return true;
}

/* Raises a row to its bound by the cheapest steps of its classes: exact, for costs are convex and steps are units. */
static double raise_row(const bw_quant_problem *p, size_t row, int64_t *value) {
    const bw_constraint_list *l = &p->rows;
    double cost = 0;
    for (int64_t lacks = l->bound[row] - bw_constraint_value(l, row, value); lacks > 0; lacks--) {
        double least = INFINITY;
        bw_term best = {0, 0};
        for (size_t i = l->begin[row]; i < l->begin[row + 1]; i++) {
            bw_term t = l->term[i];
            if (t.factor < 0 && value[t.arc] <= bw_quant_problem_least(p, (size_t)t.arc)) continue;
            double c = step_cost(p, (size_t)t.arc, value[t.arc], t.factor);
            if (c < least) least = c, best = t;
        }
        if (!best.factor) break; /* infeasible; the bound stays valid */
        value[best.arc] += best.factor, cost += least;
    }
    return fmax(cost, 0);
}

bw_status bw_quant_problem_bound(bw_context *ctx, const bw_quant_problem *p, double *bound) {
    size_t n = p->model->class_count;
    int64_t *value = bw_alloc(ctx, n, sizeof *value);
    uint8_t *used = bw_alloc(ctx, n, 1);
    *bound = 0;
    for (size_t c = 0; value && used && c < n; c++) {
        int64_t least = bw_quant_problem_least(p, c);
        value[c] = llround(p->target[c]);
        if (value[c] < least) value[c] = least;
        double away = (double)value[c] - p->target[c];
        *bound += p->model->class_weight[c] * away * away;
    }
    for (size_t r = 0; value && used && r < p->rows.count; r++) {
        if (!is_usable(p, r, used)) continue;
        double cost = raise_row(p, r, value);
        if (cost <= 0) continue; /* costs nothing: leave its classes to others */
        *bound += cost;
        for (size_t i = p->rows.begin[r]; i < p->rows.begin[r + 1]; i++) used[p->rows.term[i].arc] = 1;
    }
    bw_free(ctx, value);
    bw_free(ctx, used);
    return ctx->error.status;
}
