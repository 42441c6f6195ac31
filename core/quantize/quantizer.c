#include "quantize/quantizer.h"

#include <math.h>
#include <string.h>

#include "quantize/fewest.h"

enum { BISECTIONS = 40 };
#define LENGTH_MAX ldexp(1, 40)

bw_status bw_quantizer_open(bw_context *ctx, const bw_complex *complex, int32_t grid_exponent, bw_quantize_range range,
                            const bw_quant_oracle *oracle, bw_quantizer *q) {
    *q = (bw_quantizer){.oracle = *oracle};
    bw_status status = bw_quant_model_init(ctx, complex, grid_exponent, &q->model);
    if (status == BW_OK) status = bw_quant_moves_init(ctx, &q->model, &q->moves);
    for (int r = BW_QUANTIZE_POSITIVE; r <= (int)range && status == BW_OK; r++)
        status = bw_quant_problem_init(ctx, &q->model, (bw_quantize_range)r, &q->level[q->levels++]);
    if (status == BW_OK && !(q->value = bw_alloc(ctx, q->model.class_count, sizeof *q->value))) status = ctx->error.status;
    if (status == BW_OK && !(q->best = bw_alloc(ctx, q->model.class_count, sizeof *q->best))) status = ctx->error.status;
    bw_quantizer_use(q, range);
    if (status != BW_OK) bw_quantizer_close(ctx, q);
    return status;
}

void bw_quantizer_use(bw_quantizer *q, bw_quantize_range range) { q->used = (size_t)(range - BW_QUANTIZE_POSITIVE) + 1; }

void bw_quantizer_close(bw_context *ctx, bw_quantizer *q) {
    bw_free(ctx, q->value);
    bw_free(ctx, q->best);
    bw_quant_moves_clear(ctx, &q->moves);
    for (size_t k = 0; k < q->levels; k++) bw_quant_problem_clear(ctx, &q->level[k]);
    bw_quant_model_clear(ctx, &q->model);
    *q = (bw_quantizer){0};
}

/* Positive lengths are valid whatever the complex: nobody need be asked. */
static bw_quant_oracle *oracle_of(bw_quantizer *q, size_t level, bw_quant_oracle *none) { return level ? &q->oracle : none; }

static void add_work(bw_quant_result *to, const bw_quant_result *from) {
    to->nodes += from->nodes, to->relaxations += from->relaxations;
    to->rounds += from->rounds, to->rows += from->rows;
    to->seconds += from->seconds, to->seconds_separation += from->seconds_separation;
}

/* Of the time left: ranges on the way may take half of it each. */
static double share_of(const bw_quantizer *q, size_t level, double left) { return left <= 0 ? 0 : level + 1 < q->used ? left / 2 : left; }

/* The scale at which the longest class is LENGTH_MAX. */
static double scale_limit(const bw_quantizer *q) {
    double longest = 0;
    for (size_t c = 0; c < q->model.class_count; c++) longest = fmax(longest, fabs((double)q->model.class_length[c]) / q->model.unit);
    return LENGTH_MAX / longest;
}

bw_status bw_quantizer_solve(bw_context *ctx, bw_quantizer *q, double scale, double seconds, bw_quant_result *result) {
    bw_quant_result before = {0};
    bw_quant_oracle none = {0};
    if (scale > scale_limit(q)) return bw_fail(ctx, BW_E_RANGE, "at scale %g arcs would be longer than 2^40", scale);
    for (size_t k = 0; k < q->used; k++) {
        double left = share_of(q, k, seconds - before.seconds);
        bw_quant_problem_set_scale(&q->level[k], scale);
        if (bw_quant_solve(ctx, &q->level[k], &q->moves, oracle_of(q, k, &none), left, k ? q->value : NULL, q->value, result))
            return ctx->error.status;
        add_work(result, &before);
        before = *result;
    }
    return BW_OK;
}

/* In each range the coarsest first, as bw_quantizer_solve finds it, and then from there, or from the fewest of the range before, to the fewest: so they are never more than the
 * coarsest has. coarsest: [class] scratch. */
static bw_status find_fewest(bw_context *ctx, bw_quantizer *q, double seconds, int64_t *coarsest, bw_quant_result *result) {
    size_t bytes = q->model.class_count * sizeof *coarsest;
    bw_quant_result before = {0}, first;
    bw_quant_oracle none = {0};
    for (size_t k = 0; k < q->used; k++) {
        double left = share_of(q, k, seconds - before.seconds);
        bw_quant_problem_set_scale(&q->level[k], 0);
        if (bw_quant_solve(ctx, &q->level[k], &q->moves, oracle_of(q, k, &none), left, k ? coarsest : NULL, coarsest, &first)) return ctx->error.status;
        if (!k || bw_quant_model_hexes(&q->model, coarsest) <= bw_quant_model_hexes(&q->model, q->value)) memcpy(q->value, coarsest, bytes);
        left = fmax(left - first.seconds, 0);
        if (bw_quant_fewest(ctx, &q->level[k], &q->moves, oracle_of(q, k, &none), left, q->value, result)) return ctx->error.status;
        add_work(result, &first);
        add_work(result, &before);
        before = *result;
    }
    return BW_OK;
}

bw_status bw_quantizer_fewest(bw_context *ctx, bw_quantizer *q, double seconds, bw_quant_result *result) {
    int64_t *coarsest = bw_alloc(ctx, q->model.class_count, sizeof *coarsest);
    bw_status status = coarsest ? find_fewest(ctx, q, seconds, coarsest, result) : ctx->error.status;
    bw_free(ctx, coarsest);
    return status;
}

/* ---- a number of hexes ---- */

typedef struct {
    bw_context *ctx;
    bw_quantizer *q;
    double target, deadline;
    double scale, nearest; /* of q->best */
    bw_quant_result result;
} aim;

static double volume_of_input(const bw_quantizer *q) {
    double sum = 0;
    for (size_t b = 0; b < q->model.block_count; b++) {
        double volume = 1;
        for (int axis = 0; axis < 3; axis++) volume *= (double)bw_quant_model_extent(&q->model, b, axis, q->model.class_length) / q->model.unit;
        sum += volume;
    }
    return sum;
}

static bw_status try_scale(aim *a, double scale, double *hexes) {
    bw_quant_result result;
    double left = fmax(a->deadline - bw_seconds_now(), 0);
    if (bw_quantizer_solve(a->ctx, a->q, scale, left, &result)) return a->ctx->error.status;
    *hexes = (double)bw_quant_model_hexes(&a->q->model, a->q->value);
    if (fabs(*hexes - a->target) < fabs(a->nearest - a->target)) {
        a->nearest = *hexes, a->scale = scale, a->result = result;
        memcpy(a->q->best, a->q->value, a->q->model.class_count * sizeof *a->q->best);
    }
    return BW_OK;
}

static bool is_near(const aim *a) { return fabs(a->nearest - a->target) <= 0.01 * a->target; }

/* low has too few hexes, high enough. */
static bw_status bisect(aim *a, double low, double high) {
    double hexes;
    for (int i = 0; i < BISECTIONS && !is_near(a) && bw_seconds_now() < a->deadline && high - low > 1e-9 * high; i++) {
        double middle = low > 0 ? sqrt(low * high) : high / 2;
        if (try_scale(a, middle, &hexes)) return a->ctx->error.status;
        if (hexes < a->target) low = middle;
        else high = middle;
    }
    return BW_OK;
}

static bw_status find_scale(aim *a) {
    double hexes, most = scale_limit(a->q), guess = fmin(cbrt(a->target / volume_of_input(a->q)), most), low = 0;
    if (try_scale(a, 0, &hexes)) return a->ctx->error.status;
    if (hexes >= a->target) return BW_OK; /* even the coarsest has as many */
    for (double high = guess; high <= most && !is_near(a) && bw_seconds_now() < a->deadline; high *= 1.5) {
        if (try_scale(a, high, &hexes)) return a->ctx->error.status;
        if (hexes >= a->target) return bisect(a, low, high);
        low = high;
    }
    return BW_OK;
}

/* From the nearest values found, moves that come nearer, cheapest in the objective first among those that help. */
static bw_status step_nearer(aim *a, bool *stepped) {
    bw_quantizer *q = a->q;
    bw_quant_problem *p = bw_quantizer_problem(q);
    bw_quant_oracle none = {0};
    const bw_quant_moves *m = &q->moves;
    size_t n = q->model.class_count, best_move = 0;
    double best_miss = fabs(a->nearest - a->target);
    int best_sign = 0;
    *stepped = false;
    for (size_t k = 0; k < m->count; k++)
        for (int sign = -1; sign <= 1; sign += 2) {
            memcpy(q->value, q->best, n * sizeof *q->value);
            for (size_t i = m->begin[k]; i < m->begin[k + 1]; i++) q->value[m->term[i].index] += sign * m->term[i].factor;
            double miss = fabs((double)bw_quant_model_hexes(&q->model, q->value) - a->target);
            if (miss < best_miss && bw_quant_problem_allows(p, q->value)) best_miss = miss, best_move = k, best_sign = sign;
        }
    if (!best_sign) return BW_OK;
    bool valid;
    memcpy(q->value, q->best, n * sizeof *q->value);
    for (size_t i = m->begin[best_move]; i < m->begin[best_move + 1]; i++) q->value[m->term[i].index] += best_sign * m->term[i].factor;
    if (bw_quant_problem_separate(a->ctx, p, oracle_of(q, q->used - 1, &none), q->value, &valid)) return a->ctx->error.status;
    *stepped = true; /* where it was invalid, what was learnt excludes it next time */
    if (!valid) return BW_OK;
    memcpy(q->best, q->value, n * sizeof *q->best);
    a->nearest = (double)bw_quant_model_hexes(&q->model, q->best);
    bw_quant_problem_set_scale(p, a->scale);
    a->result.objective = bw_quant_problem_objective(p, q->best);
    a->result.status = BW_QUANT_GAP;
    return BW_OK;
}

bw_status bw_quantizer_aim(bw_context *ctx, bw_quantizer *q, uint64_t hexes, double seconds, double *scale, bw_quant_result *result) {
    double since = bw_seconds_now();
    aim a = {.ctx = ctx, .q = q, .target = (double)hexes, .deadline = since + seconds, .nearest = INFINITY};
    bw_status status = find_scale(&a);
    bool stepped = true;
    while (status == BW_OK && stepped && fabs(a.nearest - a.target) > 0.05 * a.target && bw_seconds_now() < a.deadline)
        status = step_nearer(&a, &stepped);
    if (status != BW_OK) return status;
    memcpy(q->value, q->best, q->model.class_count * sizeof *q->value);
    bw_quant_problem_set_scale(bw_quantizer_problem(q), a.scale);
    *scale = a.scale, *result = a.result;
    result->seconds = bw_seconds_now() - since;
    return BW_OK;
}

bw_quant_figures bw_quantizer_figures(bw_quantizer *q) {
    const bw_quant_problem *p = bw_quantizer_problem(q);
    bw_quant_figures f = {.hexes = (uint64_t)bw_quant_model_hexes(&q->model, q->value)};
    double size = 0;
    for (size_t c = 0; c < q->model.class_count; c++) {
        uint64_t arcs = (uint64_t)q->model.class_weight[c];
        f.zero_arcs += q->value[c] == 0 ? arcs : 0;
        f.negative_arcs += q->value[c] < 0 ? arcs : 0;
        size += (double)arcs * p->target[c] * p->target[c];
    }
    f.distortion = size > 0 ? sqrt(bw_quant_problem_objective(p, q->value) / size) : 0;
    return f;
}
