#include "quantize/fewest.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "solve/frontier.h"
#include "solve/program.h"

/* A changed bound of a column, and the node it was changed from. */
typedef struct {
    int32_t parent, column;
    double lower, upper, bound;
} node;

/* Columns: classes, then distinct extents. */
typedef struct {
    bw_context *ctx;
    bw_quant_problem *p;
    bw_quant_oracle *oracle;
    bw_program *program;
    int32_t *extent_of;  /* [3 * block + axis] number of the distinct extent */
    size_t extent_count;
    size_t rows;         /* of p->rows that the program has */
    double *lower, *upper; /* [column] at the root */
    double *cost;        /* [extent] */
    int64_t *value, *unknown, *best;
    double fewest;       /* hexes of best */
    node *nodes;
    size_t node_count, node_room;
    bw_frontier waiting;
    int *column;         /* scratch */
    double *factor;
    double deadline;
    uint64_t looked, relaxations;
} search;

static const bw_quant_model *model_of(const search *s) { return s->p->model; }
static size_t extent_column(const search *s, size_t extent) { return model_of(s)->class_count + extent; }

/* ---- building the program ---- */

static bw_status add_extent_row(search *s, size_t at) {
    const bw_quant_model *m = model_of(s);
    size_t n = 0;
    s->column[n] = (int)extent_column(s, (size_t)s->extent_of[at]), s->factor[n++] = -1;
    for (size_t i = m->extent_begin[at]; i < m->extent_begin[at + 1]; i++)
        s->column[n] = m->extent[i].index, s->factor[n++] = m->extent[i].factor;
    return bw_program_add_row(s->ctx, s->program, n, s->column, s->factor, 0, 0);
}

/* A column for each distinct extent, then the rows that tie them to the classes. */
static bw_status add_extents(search *s) {
    const bw_quant_model *m = model_of(s);
    size_t n = 3 * m->block_count, tied = 0;
    if (bw_quant_model_number_extents(s->ctx, m, s->extent_of, &s->extent_count)) return s->ctx->error.status;
    for (size_t e = 0; e < s->extent_count; e++)
        if (bw_program_add_column(s->ctx, s->program, 0, s->fewest, 0, true)) return s->ctx->error.status;
    uint8_t *done = bw_alloc(s->ctx, s->extent_count, 1);
    for (size_t at = 0; at < n && done && tied < s->extent_count; at++) {
        if (done[s->extent_of[at]]) continue;
        done[s->extent_of[at]] = 1, tied++;
        if (add_extent_row(s, at)) break;
    }
    bw_free(s->ctx, done);
    return s->ctx->error.status;
}

static bw_status add_equalities(search *s) {
    const bw_quant_model *m = model_of(s);
    for (size_t c = 0; c < m->class_count; c++) {
        size_t n = 0;
        if (m->class_free[c] != BW_NONE) continue;
        s->column[n] = (int)c, s->factor[n++] = -1;
        for (size_t i = m->row_begin[c]; i < m->row_begin[c + 1]; i++) s->column[n] = m->row[i].index, s->factor[n++] = m->row[i].factor;
        if (bw_program_add_row(s->ctx, s->program, n, s->column, s->factor, 0, 0)) return s->ctx->error.status;
    }
    return BW_OK;
}

static bw_status add_constraints(search *s) {
    const bw_constraint_list *l = &s->p->rows;
    for (; s->rows < l->count; s->rows++) {
        size_t n = 0;
        for (size_t i = l->begin[s->rows]; i < l->begin[s->rows + 1]; i++) s->column[n] = l->term[i].arc, s->factor[n++] = l->term[i].factor;
        double bound = (double)l->bound[s->rows];
        if (bw_program_add_row(s->ctx, s->program, n, s->column, s->factor, bound, l->relation[s->rows] == BW_EQUAL ? bound : BW_PROGRAM_INFINITY))
            return s->ctx->error.status;
    }
    return BW_OK;
}

static bw_status open_program(search *s) {
    const bw_quant_model *m = model_of(s);
    bw_status status = bw_program_new(s->ctx, &s->program);
    for (size_t c = 0; c < m->class_count && status == BW_OK; c++) {
        int64_t least = bw_quant_problem_least(s->p, c);
        status = bw_program_add_column(s->ctx, s->program, least == INT64_MIN ? -BW_PROGRAM_INFINITY : (double)least, BW_PROGRAM_INFINITY, 0, true);
    }
    if (status == BW_OK) status = add_extents(s);
    if (status == BW_OK) status = add_equalities(s);
    if (status == BW_OK) status = add_constraints(s);
    return status;
}

/* ---- offering values ---- */

static bw_status offer(search *s, const int64_t *value) {
    double hexes = (double)bw_quant_model_hexes(model_of(s), value);
    bool valid;
    if (hexes >= s->fewest || !bw_quant_problem_allows(s->p, value)) return BW_OK;
    if (bw_quant_problem_separate(s->ctx, s->p, s->oracle, value, &valid)) return s->ctx->error.status;
    if (!valid) return BW_OK;
    memmove(s->best, value, model_of(s)->class_count * sizeof *value);
    s->fewest = hexes;
    return BW_OK;
}

/* Moves that take hexes away, as long as there are any. */
static bw_status descend(search *s, const bw_quant_moves *moves, bool limited) {
    size_t n = model_of(s)->class_count;
    for (size_t k = 0, quiet = 0; quiet < 2 * moves->count; k++, quiet++) {
        if (bw_poll(s->ctx)) return s->ctx->error.status;
        if (limited && bw_seconds_now() > s->deadline) break;
        size_t move = k / 2 % moves->count;
        int sign = k & 1 ? 1 : -1;
        double before = s->fewest;
        memcpy(s->value, s->best, n * sizeof *s->value);
        for (size_t i = moves->begin[move]; i < moves->begin[move + 1]; i++)
            s->value[moves->term[i].index] += sign * moves->term[i].factor;
        if (offer(s, s->value)) return s->ctx->error.status;
        if (s->fewest < before) quiet = 0;
    }
    return BW_OK;
}

/* ---- nodes ---- */

static void set_bounds(search *s, int32_t n) {
    for (size_t c = 0; c < bw_program_columns(s->program); c++) bw_program_set_bounds(s->program, c, s->lower[c], s->upper[c]);
    for (; n >= 0; n = s->nodes[n].parent) {
        double lower, upper;
        if (s->nodes[n].column < 0) continue;
        bw_program_get_bounds(s->program, (size_t)s->nodes[n].column, &lower, &upper);
        bw_program_set_bounds(s->program, (size_t)s->nodes[n].column, fmax(lower, s->nodes[n].lower), fmin(upper, s->nodes[n].upper));
    }
}

/* The linear objective that the bounds of the extents allow. Returns its constant. */
static double set_costs(search *s) {
    double constant = 0;
    memset(s->cost, 0, s->extent_count * sizeof *s->cost);
    for (size_t b = 0; b < model_of(s)->block_count; b++) {
        double low[3], upper;
        for (int k = 0; k < 3; k++) bw_program_get_bounds(s->program, extent_column(s, (size_t)s->extent_of[3 * b + (size_t)k]), &low[k], &upper);
        for (int k = 0; k < 3; k++) s->cost[s->extent_of[3 * b + (size_t)k]] += low[(k + 1) % 3] * low[(k + 2) % 3];
        constant -= 2 * low[0] * low[1] * low[2];
    }
    for (size_t e = 0; e < s->extent_count; e++) bw_program_set_cost(s->program, extent_column(s, e), s->cost[e]);
    return constant;
}

/* The extent to branch on: of the block whose hexes are most underestimated, the one farthest above its bound; else a column that is no integer. */
static bool choose(const search *s, const double *x, size_t *column, double *at) {
    double worst = 1e-6;
    bool found = false;
    for (size_t b = 0; b < model_of(s)->block_count; b++) {
        double low[3], upper, e[3];
        size_t c[3];
        for (int k = 0; k < 3; k++) {
            c[k] = extent_column(s, (size_t)s->extent_of[3 * b + (size_t)k]);
            bw_program_get_bounds(s->program, c[k], &low[k], &upper);
            e[k] = x[c[k]];
        }
        double under = e[0] * e[1] * e[2] + 2 * low[0] * low[1] * low[2];
        for (int k = 0; k < 3; k++) under -= low[(k + 1) % 3] * low[(k + 2) % 3] * e[k];
        if (under <= worst) continue;
        int best = 0;
        for (int k = 1; k < 3; k++)
            if (e[k] - low[k] > e[best] - low[best]) best = k;
        if (e[best] - low[best] < 1e-6) continue;
        worst = under, found = true, *column = c[best], *at = fmax(ceil(e[best] - 1e-6) - 1, low[best]);
    }
    for (size_t c = 0; c < bw_program_columns(s->program) && !found; c++)
        if (fabs(x[c] - round(x[c])) > BW_PROGRAM_EPSILON) found = true, *column = c, *at = floor(x[c]);
    return found;
}

static bw_status push(search *s, int32_t parent, size_t column, double lower, double upper, double bound) {
    if (bw_reserve(s->ctx, &s->nodes, &s->node_room, s->node_count + 1)) return s->ctx->error.status;
    s->nodes[s->node_count] = (node){parent, (int32_t)column, lower, upper, bound};
    return bw_frontier_push(s->ctx, &s->waiting, (int32_t)s->node_count++, bound);
}

static bw_status branch(search *s, int32_t n, const double *x, double bound) {
    size_t column;
    double at, lower, upper;
    if (!choose(s, x, &column, &at)) return BW_OK; /* settled: what it stands for has been offered */
    bw_program_get_bounds(s->program, column, &lower, &upper);
    bool below_first = x[column] - at >= 0.5; /* of equal bounds the youngest is looked at next */
    for (int k = 0; k < 2; k++) {
        bool below = (k == 1) == below_first;
        if (push(s, n, column, below ? lower : at + 1, below ? at : upper, bound)) return s->ctx->error.status;
    }
    return BW_OK;
}

static bw_status look(search *s, int32_t n) {
    const bw_quant_model *m = model_of(s);
    double bound = s->nodes[n].bound;
    set_bounds(s, n);
    double constant = set_costs(s);
    for (;;) {
        bw_program_status status;
        double value;
        size_t rows = s->rows;
        if (bw_poll(s->ctx)) return s->ctx->error.status;
        if (bw_program_relax(s->ctx, s->program, BW_PROGRAM_INFINITY, &status, &value)) return s->ctx->error.status;
        s->relaxations++;
        if (status == BW_PROGRAM_INFEASIBLE) return BW_OK;
        if (status != BW_PROGRAM_OPTIMAL) return bw_fail(s->ctx, BW_E_ALGORITHM, "a linear program was given up for numerical trouble");
        bound = fmax(bound, ceil(value + constant - 1e-6));
        if (bound >= s->fewest) return BW_OK;
        const double *x = bw_program_solution(s->program);
        for (size_t f = 0; f < m->free_count; f++) s->unknown[f] = llround(x[m->free_class[f]]);
        bw_quant_model_expand(m, s->unknown, s->value);
        if (offer(s, s->value)) return s->ctx->error.status;
        if (bound >= s->fewest) return BW_OK;
        if (add_constraints(s)) return s->ctx->error.status;
        if (s->rows == rows) return branch(s, n, x, bound);
        if (bw_seconds_now() > s->deadline) return push(s, n, 0, -BW_PROGRAM_INFINITY, BW_PROGRAM_INFINITY, bound); /* left over */
    }
}

static bw_status search_open(search *s) {
    const bw_quant_model *m = model_of(s);
    size_t most = m->class_count + 3 * m->block_count;
    s->extent_of = bw_alloc(s->ctx, 3 * m->block_count, sizeof *s->extent_of);
    s->lower = bw_alloc(s->ctx, most, sizeof *s->lower);
    s->upper = bw_alloc(s->ctx, most, sizeof *s->upper);
    s->cost = bw_alloc(s->ctx, 3 * m->block_count, sizeof *s->cost);
    s->value = bw_alloc(s->ctx, m->class_count, sizeof *s->value);
    s->unknown = bw_alloc(s->ctx, m->free_count, sizeof *s->unknown);
    s->column = bw_alloc(s->ctx, m->class_count + 1, sizeof *s->column);
    s->factor = bw_alloc(s->ctx, m->class_count + 1, sizeof *s->factor);
    if (!s->extent_of || !s->lower || !s->upper || !s->cost || !s->value || !s->unknown || !s->column || !s->factor)
        return s->ctx->error.status;
    return BW_OK;
}

static void search_close(search *s) {
    bw_program_free(s->ctx, s->program);
    bw_free(s->ctx, s->extent_of);
    bw_free(s->ctx, s->lower);
    bw_free(s->ctx, s->upper);
    bw_free(s->ctx, s->cost);
    bw_free(s->ctx, s->value);
    bw_free(s->ctx, s->unknown);
    bw_free(s->ctx, s->nodes);
    bw_frontier_clear(s->ctx, &s->waiting);
    bw_free(s->ctx, s->column);
    bw_free(s->ctx, s->factor);
}

/* The least that each extent can be alone, as its bound: the objective of the root is as good as these are. */
static bw_status raise_bounds(search *s) {
    for (size_t c = 0; c < bw_program_columns(s->program); c++) bw_program_set_cost(s->program, c, 0);
    for (size_t e = 0; e < s->extent_count && bw_seconds_now() <= s->deadline; e++) {
        size_t c = extent_column(s, e);
        bw_program_status status;
        double value;
        bw_program_set_cost(s->program, c, 1);
        if (bw_program_relax(s->ctx, s->program, BW_PROGRAM_INFINITY, &status, &value)) return s->ctx->error.status;
        bw_program_set_cost(s->program, c, 0);
        s->relaxations++;
        if (status == BW_PROGRAM_OPTIMAL && value > 0) bw_program_set_bounds(s->program, c, ceil(value - 1e-6), s->fewest);
        if (bw_poll(s->ctx)) return s->ctx->error.status;
    }
    return BW_OK;
}

static bw_status run(search *s, double *bound) {
    bw_status status = open_program(s);
    if (status == BW_OK) status = raise_bounds(s);
    for (size_t c = 0; status == BW_OK && c < bw_program_columns(s->program); c++) bw_program_get_bounds(s->program, c, &s->lower[c], &s->upper[c]);
    if (status == BW_OK) status = push(s, -1, 0, -BW_PROGRAM_INFINITY, BW_PROGRAM_INFINITY, 0);
    while (status == BW_OK && s->waiting.count && bw_seconds_now() <= s->deadline) {
        int32_t n = bw_frontier_pop(&s->waiting);
        if (s->nodes[n].bound >= s->fewest) continue;
        s->looked++;
        status = look(s, n);
    }
    *bound = s->fewest;
    if (s->waiting.count) *bound = fmin(*bound, s->waiting.item[0].bound);
    return status;
}

bw_status bw_quant_fewest(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                          double seconds, int64_t *value, bw_quant_result *result) {
    double since = bw_seconds_now(), separation = oracle->seconds;
    uint64_t rounds = oracle->rounds;
    size_t rows = p->rows.count;
    search s = {.ctx = ctx, .p = p, .oracle = oracle, .best = value, .deadline = since + seconds};
    s.fewest = (double)bw_quant_model_hexes(p->model, value);
    *result = (bw_quant_result){.status = BW_QUANT_HEURISTIC};
    bw_status status = search_open(&s);
    if (status == BW_OK && moves->count) status = descend(&s, moves, seconds > 0);
    result->heuristic = s.fewest;
    if (status == BW_OK && seconds > 0) status = run(&s, &result->bound);
    result->objective = s.fewest;
    if (seconds > 0) result->status = result->bound >= s.fewest ? BW_QUANT_OPTIMAL : BW_QUANT_GAP;
    result->nodes = s.looked, result->relaxations = s.relaxations;
    result->rounds = oracle->rounds - rounds, result->rows = p->rows.count - rows;
    result->seconds = bw_seconds_now() - since;
    result->seconds_separation = oracle->seconds - separation;
    search_close(&s);
    return status;
}
