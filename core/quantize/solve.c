#include "quantize/solve.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "solve/program.h"

const char *bw_quant_status_name(bw_quant_status status) {
    static const char *const names[] = {"optimal", "gap", "heuristic"};
    return (unsigned)status < sizeof names / sizeof *names ? names[status] : "?";
}

double bw_quant_gap(const bw_quant_result *r) {
    double gap = r->objective - r->bound;
    return gap > 0 ? gap / r->objective : 0;
}

/* Column y of a class is its value less `origin`, so that numbers stay small; column z, if it has arcs, is the square of value - target. */
typedef struct {
    bw_context *ctx;
    bw_quant_problem *p;
    bw_quant_oracle *oracle;
    bw_program *program;
    int *y, *z;          /* [class] column; z is -1 without arcs */
    int64_t *origin;
    int64_t *value, *unknown;
    int64_t *best;       /* [class] the caller's */
    double objective;    /* of best */
    size_t rows;         /* of p->rows that the program has */
    int *column;         /* scratch */
    double *factor;
} search;

/* ---- building the program ---- */

/* Values of a class outside of these cannot be in anything better than `objective`: its own term alone would exceed what the others
 * leave at their best. */
static void limits_of(const search *s, size_t c, double rest, double *lower, double *upper) {
    int64_t least = bw_quant_problem_least(s->p, c);
    double w = s->p->model->class_weight[c], t = s->p->target[c], o = (double)s->origin[c];
    *lower = -BW_PROGRAM_INFINITY, *upper = BW_PROGRAM_INFINITY;
    if (w > 0) {
        double reach = sqrt(fmax(s->objective - rest, 0) / w) * (1 + 1e-9) + 1e-9;
        *lower = ceil(t - reach) - o, *upper = floor(t + reach) - o;
    }
    if (least != INT64_MIN) *lower = fmax(*lower, (double)least - o);
}

/* The least that each class costs on its own, and their sum. */
static double own_cost(const bw_quant_problem *p, size_t c) {
    int64_t least = bw_quant_problem_least(p, c), value = llround(p->target[c]);
    double away = (double)(value < least ? least : value) - p->target[c];
    return p->model->class_weight[c] * away * away;
}

static bw_status add_columns(search *s) {
    const bw_quant_model *m = s->p->model;
    double all = 0;
    int count = 0;
    for (size_t c = 0; c < m->class_count; c++) all += own_cost(s->p, c);
    for (size_t c = 0; c < m->class_count; c++) {
        double lower, upper;
        s->origin[c] = llround(s->p->target[c]);
        limits_of(s, c, all - own_cost(s->p, c), &lower, &upper);
        s->y[c] = count++;
        if (bw_program_add_column(s->ctx, s->program, lower, fmax(lower, upper), 0, true)) return s->ctx->error.status;
    }
    for (size_t c = 0; c < m->class_count; c++) {
        s->z[c] = m->class_weight[c] ? count++ : -1;
        if (m->class_weight[c] && bw_program_add_column(s->ctx, s->program, 0, BW_PROGRAM_INFINITY, m->class_weight[c], false))
            return s->ctx->error.status;
    }
    return BW_OK;
}

/* A row on classes, shifted to the origins. */
static bw_status add_shifted(search *s, size_t n, int64_t shift, double lower, double upper) {
    double o = (double)shift;
    return bw_program_add_row(s->ctx, s->program, n, s->column, s->factor, lower > -BW_PROGRAM_INFINITY ? lower - o : lower,
                              upper < BW_PROGRAM_INFINITY ? upper - o : upper);
}

static bw_status add_equalities(search *s) {
    const bw_quant_model *m = s->p->model;
    for (size_t c = 0; c < m->class_count; c++) {
        if (m->class_free[c] != BW_NONE) continue;
        size_t n = 0;
        int64_t shift = -s->origin[c];
        s->column[n] = s->y[c], s->factor[n++] = -1;
        for (size_t i = m->row_begin[c]; i < m->row_begin[c + 1]; i++) {
            s->column[n] = s->y[m->row[i].index], s->factor[n++] = m->row[i].factor;
            shift += m->row[i].factor * s->origin[m->row[i].index];
        }
        if (add_shifted(s, n, shift, 0, 0)) return s->ctx->error.status;
    }
    return BW_OK;
}

/* Those constraints of the problem that the program does not have yet. */
static bw_status add_constraints(search *s) {
    const bw_constraint_list *l = &s->p->rows;
    for (; s->rows < l->count; s->rows++) {
        size_t n = 0;
        int64_t shift = 0;
        for (size_t i = l->begin[s->rows]; i < l->begin[s->rows + 1]; i++) {
            s->column[n] = s->y[l->term[i].arc], s->factor[n++] = l->term[i].factor;
            shift += l->term[i].factor * s->origin[l->term[i].arc];
        }
        double bound = (double)l->bound[s->rows];
        if (add_shifted(s, n, shift, bound, l->relation[s->rows] == BW_EQUAL ? bound : BW_PROGRAM_INFINITY))
            return s->ctx->error.status;
    }
    return BW_OK;
}

/* The line through the parabola's points at k and k + 1 (both relative to the origin). */
static bw_status add_line(search *s, size_t c, int64_t k) {
    double t = s->p->target[c] - (double)s->origin[c], away = (double)k - t;
    int column[2] = {s->z[c], s->y[c]};
    double slope = 2 * away + 1, factor[2] = {1, -slope};
    return bw_program_add_row(s->ctx, s->program, 2, column, factor, away * away - slope * (double)k, BW_PROGRAM_INFINITY);
}

/* Lines around the target, and around the values that are known. */
static bw_status add_first_lines(search *s) {
    const bw_quant_model *m = s->p->model;
    for (size_t c = 0; c < m->class_count; c++) {
        int64_t known = s->best[c] - s->origin[c];
        if (s->z[c] < 0) continue;
        for (int64_t k = -2; k < 2; k++)
            if (add_line(s, c, k)) return s->ctx->error.status;
        for (int64_t k = known - 1; k <= known; k++)
            if ((k < -2 || k >= 2) && add_line(s, c, k)) return s->ctx->error.status;
    }
    return BW_OK;
}

/* ---- looking at solutions ---- */

/* Lines that the solution is below of. */
static bw_status cut_parabolas(search *s, const double *x) {
    const bw_quant_model *m = s->p->model;
    for (size_t c = 0; c < m->class_count; c++) {
        if (s->z[c] < 0) continue;
        double y = x[s->y[c]], z = x[s->z[c]], t = s->p->target[c] - (double)s->origin[c];
        double k = floor(y + 1e-9), away = k - t, line = away * away + (2 * away + 1) * (y - k);
        if (z > line - 1e-7 * (1 + fabs(line))) continue;
        if (add_line(s, c, (int64_t)k)) return s->ctx->error.status;
        if (y - k < BW_PROGRAM_EPSILON && add_line(s, c, (int64_t)k - 1)) return s->ctx->error.status;
    }
    return BW_OK;
}

/* Integer values near a solution of the relaxation, exact on the equalities. */
static void round_to_values(search *s, const double *x) {
    const bw_quant_model *m = s->p->model;
    for (size_t f = 0; f < m->free_count; f++) {
        size_t c = (size_t)m->free_class[f];
        s->unknown[f] = llround(x[s->y[c]]) + s->origin[c];
    }
    bw_quant_model_expand(m, s->unknown, s->value);
}

/* Keeps the rounded values if they are better and valid; otherwise learns why not. */
static bw_status offer(search *s, double *cutoff) {
    bool valid;
    double objective = bw_quant_problem_objective(s->p, s->value);
    if (!bw_quant_problem_allows(s->p, s->value) || objective >= s->objective - 1e-9 * (1 + s->objective)) return BW_OK;
    if (bw_quant_problem_separate(s->ctx, s->p, s->oracle, s->value, &valid)) return s->ctx->error.status;
    if (!valid) return BW_OK;
    memcpy(s->best, s->value, s->p->model->class_count * sizeof *s->best);
    s->objective = objective;
    *cutoff = objective;
    return BW_OK;
}

static bw_status look(void *user, bw_program *program, const double *x, double value, bool integral, double *cutoff) {
    search *s = user;
    (void)program, (void)value, (void)integral;
    round_to_values(s, x);
    bw_status status = offer(s, cutoff);
    if (status == BW_OK) status = cut_parabolas(s, x);
    if (status == BW_OK) status = add_constraints(s);
    return status;
}

/* ---- the search ---- */

static bw_status search_open(search *s) {
    const bw_quant_model *m = s->p->model;
    size_t n = m->class_count;
    s->y = bw_alloc(s->ctx, n, sizeof *s->y);
    s->z = bw_alloc(s->ctx, n, sizeof *s->z);
    s->origin = bw_alloc(s->ctx, n, sizeof *s->origin);
    s->value = bw_alloc(s->ctx, n, sizeof *s->value);
    s->unknown = bw_alloc(s->ctx, m->free_count, sizeof *s->unknown);
    s->column = bw_alloc(s->ctx, n + 1, sizeof *s->column);
    s->factor = bw_alloc(s->ctx, n + 1, sizeof *s->factor);
    if (!s->y || !s->z || !s->origin || !s->value || !s->unknown || !s->column || !s->factor) return s->ctx->error.status;
    bw_status status = bw_program_new(s->ctx, &s->program);
    if (status == BW_OK) status = add_columns(s);
    if (status == BW_OK) status = add_equalities(s);
    if (status == BW_OK) status = add_constraints(s);
    if (status == BW_OK) status = add_first_lines(s);
    return status;
}

static void search_close(search *s) {
    bw_program_free(s->ctx, s->program);
    bw_free(s->ctx, s->y);
    bw_free(s->ctx, s->z);
    bw_free(s->ctx, s->origin);
    bw_free(s->ctx, s->value);
    bw_free(s->ctx, s->unknown);
    bw_free(s->ctx, s->column);
    bw_free(s->ctx, s->factor);
}

/* Objectives of integer targets are integers. */
static double objective_step(const bw_quant_problem *p) {
    for (size_t c = 0; c < p->model->class_count; c++)
        if (p->target[c] != floor(p->target[c])) return 0;
    return 1;
}

static bw_status branch(bw_context *ctx, bw_quant_problem *p, bw_quant_oracle *oracle, double seconds, int64_t *value,
                        bw_quant_result *result) {
    search s = {.ctx = ctx, .p = p, .oracle = oracle, .best = value, .objective = result->objective};
    bw_branch_options how = {look, &s, result->objective, objective_step(p), seconds, UINT64_MAX};
    bw_branch_result found = {0};
    bw_status status = search_open(&s);
    if (status == BW_OK) status = bw_program_branch(ctx, s.program, &how, &found);
    search_close(&s);
    if (status != BW_OK) return status;
    result->objective = s.objective;
    result->nodes = found.nodes, result->relaxations = found.relaxations;
    if (found.bound > result->bound) result->bound = found.bound;
    result->status = found.exhausted ? BW_QUANT_OPTIMAL : BW_QUANT_GAP;
    return BW_OK;
}

bw_status bw_quant_solve(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                         double seconds, const int64_t *start, int64_t *value, bw_quant_result *result) {
    double since = bw_seconds_now();
    size_t rows = p->rows.count;
    uint64_t rounds = oracle->rounds;
    double separation = oracle->seconds;
    *result = (bw_quant_result){.status = BW_QUANT_HEURISTIC};
    bw_status status = bw_quant_heuristic(ctx, p, moves, oracle, seconds <= 0, start, value);
    if (status == BW_OK) status = bw_quant_problem_bound(ctx, p, &result->simple_bound);
    if (status != BW_OK) return status;
    result->heuristic = result->objective = bw_quant_problem_objective(p, value);
    result->bound = result->simple_bound;
    double slack = BW_PROGRAM_EPSILON * (1 + result->objective);
    if (result->objective - result->bound <= slack) result->status = BW_QUANT_OPTIMAL;
    else if (seconds > 0) status = branch(ctx, p, oracle, seconds, value, result);
    if (status == BW_OK && result->status == BW_QUANT_GAP) { /* out of time: what can be done without linear programs */
        status = bw_quant_heuristic(ctx, p, moves, oracle, true, value, value);
        result->objective = bw_quant_problem_objective(p, value);
    }
    if (result->status == BW_QUANT_OPTIMAL || result->bound > result->objective) result->bound = result->objective;
    result->rounds = oracle->rounds - rounds;
    result->rows = p->rows.count - rows;
    result->seconds = bw_seconds_now() - since;
    result->seconds_separation = oracle->seconds - separation;
    return status;
}
