#include "solve/untangle.h"

#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "solve/distortion.h"
#include "solve/sparse.h"

enum { LEAST_RANGE = 512 }; /* tets that are worth a thread */

#define SHIFT 1e-9       /* on the diagonal: vertices that nothing holds stay where they are */
#define LEAST_EPSILON 1e-8
#define FLOOR 0.02       /* eps is at least this part of the most negative determinant */
#define ENOUGH 1e-4      /* part of the predicted gain that a step has to bring */
enum { HALVINGS = 40, FAILURES = 6 };

struct bw_untangler {
    const bw_untangle_tet *tet;
    size_t tet_count, variable_count;
    bw_sparse *laplace, *newton;
    size_t *begin;      /* [tet + 1] its terms of the Hessian */
    double *term;       /* [term] values of the running matrix */
    size_t term_count;
    double *value;      /* [tet] energies */
    double *volume;     /* [tet] determinants */
    double (*slope)[12]; /* [tet] gradients */
    double *gradient, *step, *trial; /* [variable] */
    double epsilon;
};

/* ---- one tet ---- */

void bw_untangle_jacobian(const bw_untangle_tet *t, const double *x, double out[3][3]) {
    double p[4][3], e[3][3];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            int32_t v = t->variable[i][k];
            p[i][k] = v < 0 ? t->at[i][k] : t->at[i][k] + t->sign[i][k] * x[v];
        }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[k][i] = p[i + 1][k] - p[0][k];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) out[a][b] = e[a][0] * t->rest[0][b] + e[a][1] * t->rest[1][b] + e[a][2] * t->rest[2][b];
}

double bw_untangle_volume(const bw_untangle_tet *tet, const double *x) {
    double j[3][3];
    bw_untangle_jacobian(tet, x, j);
    return bw_det3((const double(*)[3])j);
}

/* dJ[a][b] by coordinate a of corner i. */
static void slopes(const bw_untangle_tet *t, double out[4][3]) {
    for (int b = 0; b < 3; b++) {
        out[0][b] = 0;
        for (int i = 0; i < 3; i++) out[i + 1][b] = t->rest[i][b], out[0][b] -= t->rest[i][b];
    }
}

/* ---- matrices ---- */

void bw_untangler_free(bw_context *ctx, bw_untangler *u) {
    if (!u) return;
    bw_sparse_free(ctx, u->laplace);
    bw_sparse_free(ctx, u->newton);
    void *blocks[] = {u->begin, u->term, u->value, u->volume, u->slope, u->gradient, u->step, u->trial};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    bw_free(ctx, u);
}

bw_status bw_untangler_new(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count, bw_untangler **out) {
    bw_untangler *u = bw_alloc(ctx, 1, sizeof *u);
    *out = u;
    if (!u) return ctx->error.status;
    u->tet = tet, u->tet_count = tet_count, u->variable_count = variable_count;
    u->value = bw_alloc(ctx, tet_count, sizeof *u->value);
    u->volume = bw_alloc(ctx, tet_count, sizeof *u->volume);
    u->gradient = bw_alloc(ctx, variable_count, sizeof *u->gradient);
    u->step = bw_alloc(ctx, variable_count, sizeof *u->step);
    u->trial = bw_alloc(ctx, variable_count, sizeof *u->trial);
    if (ctx->error.status == BW_OK) return BW_OK;
    bw_untangler_free(ctx, u);
    *out = NULL;
    return ctx->error.status;
}

/* Pairs of a tet's coordinates that have a term, in a fixed order; all of them, or only those along the same axis. */
static size_t list_terms(const bw_untangle_tet *t, bool coupled, int32_t *row, int32_t *column) {
    size_t n = 0;
    for (int i = 0; i < 12; i++)
        for (int k = 0; k <= i; k++) {
            int32_t a = t->variable[i / 3][i % 3], b = t->variable[k / 3][k % 3];
            if (a < 0 || b < 0 || (!coupled && i % 3 != k % 3)) continue;
            if (row) row[n] = a, column[n] = b;
            n++;
        }
    return n;
}

static bw_status make_matrix(bw_context *ctx, bw_untangler *u, bool coupled, bw_sparse **out) {
    size_t count = 0;
    for (size_t t = 0; t < u->tet_count; t++) count += list_terms(&u->tet[t], coupled, NULL, NULL);
    int32_t *row = bw_alloc(ctx, count, sizeof *row), *column = bw_alloc(ctx, count, sizeof *column);
    if (count > u->term_count) {
        double *term = bw_resize(ctx, u->term, count, sizeof *term);
        if (term) u->term = term, u->term_count = count;
    }
    bw_status status = ctx->error.status;
    count = 0;
    for (size_t t = 0; t < u->tet_count && status == BW_OK; t++) count += list_terms(&u->tet[t], coupled, row + count, column + count);
    if (status == BW_OK) status = bw_sparse_new(ctx, u->variable_count, count, row, column, out);
    bw_free(ctx, row);
    bw_free(ctx, column);
    return status;
}

/* ---- fit ---- */

static void add_fit(const bw_untangler *u, size_t tet, double weight, const double (*target)[3], double *right, size_t *n) {
    const bw_untangle_tet *t = &u->tet[tet];
    double g[4][3], rest[3][3];
    slopes(t, g);
    for (int a = 0; a < 3; a++) /* what is left of the target after the constants */
        for (int b = 0; b < 3; b++) {
            rest[a][b] = target ? target[a][b] : 0;
            for (int i = 0; i < 4; i++) rest[a][b] -= t->at[i][a] * g[i][b];
        }
    for (int i = 0; i < 12; i++) {
        int32_t v = t->variable[i / 3][i % 3];
        const double *gi = g[i / 3], *ri = rest[i % 3];
        if (v < 0) continue;
        right[v] += weight * t->sign[i / 3][i % 3] * (gi[0] * ri[0] + gi[1] * ri[1] + gi[2] * ri[2]);
        for (int k = i % 3; k <= i; k += 3) {
            const double *gk = g[k / 3];
            if (t->variable[k / 3][k % 3] < 0) continue;
            u->term[(*n)++] = weight * t->sign[i / 3][i % 3] * t->sign[k / 3][k % 3] * (gi[0] * gk[0] + gi[1] * gk[1] + gi[2] * gk[2]);
        }
    }
}

bw_status bw_untangler_fit(bw_context *ctx, bw_untangler *u, const double *weight, const double (*target)[3][3], double *x) {
    bool definite;
    size_t n = 0;
    double most = 0;
    bw_status status = u->laplace ? BW_OK : make_matrix(ctx, u, false, &u->laplace);
    if (status != BW_OK) return status;
    memset(u->gradient, 0, u->variable_count * sizeof *u->gradient);
    for (size_t t = 0; t < u->tet_count; t++) add_fit(u, t, weight[t], target ? target[t] : NULL, u->gradient, &n);
    for (size_t i = 0; i < n; i++) most = fmax(most, u->term[i]);
    status = bw_sparse_factor(ctx, u->laplace, u->term, 1e-15 * most, &definite);
    if (status == BW_OK && !definite) status = bw_sparse_factor(ctx, u->laplace, u->term, 1e-9 * most, &definite);
    if (status == BW_OK && !definite) return bw_fail(ctx, BW_E_ALGORITHM, "the least squares system is not definite");
    return status == BW_OK ? bw_sparse_solve(ctx, u->laplace, u->gradient, x) : status;
}

/* ---- Newton ---- */

typedef struct {
    bw_untangler *u;
    const double *x;
    bool expand;
} sweep;

static bw_status evaluate_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const sweep *w = user;
    bw_untangler *u = w->u;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        const bw_untangle_tet *t = &u->tet[i];
        double j[3][3], g[4][3], hessian[12][12];
        bw_untangle_jacobian(t, w->x, j);
        u->volume[i] = bw_det3((const double(*)[3])j);
        if (!w->expand) {
            u->value[i] = bw_distortion((const double(*)[3])j, u->epsilon);
            continue;
        }
        slopes(t, g);
        u->value[i] = bw_distortion_expand((const double(*)[3])j, (const double(*)[3])g, u->epsilon, u->slope[i], hessian);
        double *term = u->term ? u->term + u->begin[i] : NULL; /* NULL: nothing is free */
        for (int p = 0; p < 12; p++)
            for (int q = 0; q <= p && t->variable[p / 3][p % 3] >= 0; q++)
                if (t->variable[q / 3][q % 3] >= 0) *term++ = t->sign[p / 3][p % 3] * t->sign[q / 3][q % 3] * hessian[p][q];
    }
    return BW_OK;
}

/* The energy at x; with `expand` also gradient and Hessian. */
static bw_status evaluate(bw_context *ctx, bw_untangler *u, const double *x, bool expand, double *energy) {
    sweep w = {u, x, expand};
    int ranges = bw_parallel_ranges(ctx, u->tet_count, LEAST_RANGE);
    bw_status status = bw_parallel(ctx, u->tet_count, ranges, evaluate_range, &w);
    *energy = 0;
    for (size_t t = 0; t < u->tet_count; t++) *energy += u->value[t];
    if (!expand) return status;
    memset(u->gradient, 0, u->variable_count * sizeof *u->gradient);
    for (size_t t = 0; t < u->tet_count; t++)
        for (int i = 0; i < 12; i++)
            if (u->tet[t].variable[i / 3][i % 3] >= 0)
                u->gradient[u->tet[t].variable[i / 3][i % 3]] += u->tet[t].sign[i / 3][i % 3] * u->slope[t][i];
    return status;
}

/* Of the last evaluation. */
static size_t count_inverted(const bw_untangler *u, double *smallest) {
    size_t count = 0;
    *smallest = INFINITY;
    for (size_t t = 0; t < u->tet_count; t++) {
        count += !(u->volume[t] > 0);
        *smallest = fmin(*smallest, u->volume[t]);
    }
    return count;
}

static bw_status prepare_newton(bw_context *ctx, bw_untangler *u) {
    if (u->newton) return BW_OK;
    if (!(u->begin = bw_alloc(ctx, u->tet_count + 1, sizeof *u->begin))) return ctx->error.status;
    if (!(u->slope = bw_alloc(ctx, u->tet_count, sizeof *u->slope))) return ctx->error.status;
    for (size_t t = 0; t < u->tet_count; t++) u->begin[t + 1] = u->begin[t] + list_terms(&u->tet[t], true, NULL, NULL);
    return make_matrix(ctx, u, true, &u->newton);
}

/* step = the Newton step downwards; *slope is its product with the gradient. */
static bw_status find_step(bw_context *ctx, bw_untangler *u, double *slope) {
    bool definite = false;
    bw_status status = BW_OK;
    for (double shift = SHIFT; !definite && status == BW_OK; shift *= 1e3) status = bw_sparse_factor(ctx, u->newton, u->term, shift, &definite);
    if (status == BW_OK) status = bw_sparse_solve(ctx, u->newton, u->gradient, u->step);
    *slope = 0;
    for (size_t i = 0; i < u->variable_count; i++) *slope += u->gradient[i] * u->step[i];
    return status;
}

/* Halves the step until it gains enough; at eps 0 the energy is infinite where a tet is not positive. *after is *before if no step does. */
static bw_status search_line(bw_context *ctx, bw_untangler *u, double *x, double before, double slope, double *after) {
    double length = 1;
    for (int i = 0; i < HALVINGS; i++, length *= 0.5) {
        double energy;
        for (size_t k = 0; k < u->variable_count; k++) u->trial[k] = x[k] - length * u->step[k];
        if (evaluate(ctx, u, u->trial, false, &energy)) return ctx->error.status;
        if (!(energy <= before - ENOUGH * length * slope)) continue;
        memcpy(x, u->trial, u->variable_count * sizeof *x);
        *after = energy;
        return BW_OK;
    }
    *after = before;
    return evaluate(ctx, u, x, false, &before);
}

static bw_status take_step(bw_context *ctx, bw_untangler *u, double *x, double *before, double *after) {
    double slope;
    if (bw_poll(ctx)) return ctx->error.status;
    if (evaluate(ctx, u, x, true, before)) return ctx->error.status;
    if (find_step(ctx, u, &slope)) return ctx->error.status;
    return search_line(ctx, u, x, *before, slope, after);
}

/* The next epsilon after a step that brought the energy from `before` to `after`. */
static double lower(double epsilon, double least, double before, double after) {
    double gain = fmax(0.1, 1 - after / before);
    double root = sqrt(least * least + epsilon * epsilon);
    double next = least >= 0 ? (1 - gain) * epsilon : (1 - gain * root / (fabs(least) + root)) * epsilon;
    return fmax(next, -FLOOR * least);
}

static bw_status descend(bw_context *ctx, bw_untangler *u, const bw_untangle_options *options, double *x, bw_untangle_report *report) {
    size_t fewest = report->inverted;
    int waited = 0, failures = 0;
    u->epsilon = options->from > 0 ? fmax(-options->from * report->smallest, LEAST_EPSILON) : fmax(1, -FLOOR * report->smallest);
    while (report->inverted && report->rounds < options->rounds && waited < options->patience && failures < FAILURES) {
        double before, after;
        if (take_step(ctx, u, x, &before, &after)) return ctx->error.status;
        report->rounds++, report->iterations++;
        if (options->share > 0) bw_progress(ctx, options->shown + options->share * report->rounds / options->rounds);
        report->inverted = count_inverted(u, &report->smallest);
        waited = report->inverted < fewest ? 0 : waited + 1;
        failures = after < before ? 0 : failures + 1;
        if (report->inverted < fewest) fewest = report->inverted;
        u->epsilon = lower(u->epsilon, report->smallest, before, after);
    }
    return BW_OK;
}

static bw_status polish(bw_context *ctx, bw_untangler *u, const bw_untangle_options *options, double *x, bw_untangle_report *report) {
    u->epsilon = 0;
    for (int i = 0; i < options->polish; i++) {
        double before, after;
        if (take_step(ctx, u, x, &before, &after)) return ctx->error.status;
        report->iterations++;
        if (before - after <= options->settled * before) break;
    }
    report->inverted = count_inverted(u, &report->smallest);
    return BW_OK;
}

bw_status bw_untangler_run(bw_context *ctx, bw_untangler *u, const bw_untangle_options *options, double *x, bw_untangle_report *report) {
    double energy;
    *report = (bw_untangle_report){.energy = INFINITY};
    if (!u->tet_count) return BW_OK;
    bw_status status = prepare_newton(ctx, u);
    u->epsilon = 1;
    if (status == BW_OK) status = evaluate(ctx, u, x, false, &energy);
    if (status != BW_OK) return status;
    report->inverted = report->inverted_before = count_inverted(u, &report->smallest);
    if (report->inverted) status = descend(ctx, u, options, x, report);
    if (status == BW_OK && !report->inverted) status = polish(ctx, u, options, x, report);
    u->epsilon = 0;
    if (status == BW_OK) status = evaluate(ctx, u, x, false, &energy);
    report->energy = energy / (double)u->tet_count;
    return status;
}

bw_status bw_untangle(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count, double *x, bw_untangle_report *report) {
    const bw_untangle_options options = {.rounds = 100, .patience = 40, .polish = 30, .settled = 1e-5};
    bw_untangler *u = NULL;
    size_t inverted = 0;
    bw_status status = bw_untangler_new(ctx, tet, tet_count, variable_count, &u);
    for (size_t t = 0; t < tet_count && status == BW_OK; t++) {
        inverted += !(bw_untangle_volume(&tet[t], x) > 0);
        u->value[t] = 1 / bw_det3(tet[t].rest);
    }
    if (status == BW_OK && inverted) {
        double *weight = bw_alloc(ctx, tet_count, sizeof *weight);
        status = ctx->error.status;
        if (status == BW_OK) memcpy(weight, u->value, tet_count * sizeof *weight);
        if (status == BW_OK) status = bw_untangler_fit(ctx, u, weight, NULL, x);
        bw_free(ctx, weight);
    }
    if (status == BW_OK) status = bw_untangler_run(ctx, u, &options, x, report);
    bw_untangler_free(ctx, u);
    return status;
}
