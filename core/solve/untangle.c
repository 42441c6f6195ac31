#include "solve/untangle.h"

#include <math.h>
#include <string.h>

#include "solve/foldover.h"
#include "solve/lbfgs.h"

enum { ROUNDS = 30, ITERATIONS = 60, POLISH = 300 };

typedef struct {
    const bw_untangle_tet *tet;
    size_t tet_count, variable_count;
    double epsilon;
} tangle;

/* J = (edges from corner 0) rest. */
static void jacobian(const bw_untangle_tet *t, const double *x, double j[3][3]) {
    double p[4][3], e[3][3];
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            int32_t v = t->variable[i][k];
            p[i][k] = v < 0 ? t->at[i][k] : t->at[i][k] + t->sign[i][k] * x[v];
        }
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[k][i] = p[i + 1][k] - p[0][k];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            j[a][b] = e[a][0] * t->rest[0][b] + e[a][1] * t->rest[1][b] + e[a][2] * t->rest[2][b];
}

double bw_untangle_volume(const bw_untangle_tet *tet, const double *x) {
    double j[3][3], cofactor[3][3];
    jacobian(tet, x, j);
    return bw_cofactors(j, cofactor);
}

/* Adds the gradient with respect to J to the variables. */
static void scatter(const bw_untangle_tet *t, double g[3][3], double *gradient) {
    for (int k = 0; k < 3; k++) {
        double edge[3], sum = 0;
        for (int i = 0; i < 3; i++) {
            edge[i] = g[k][0] * t->rest[i][0] + g[k][1] * t->rest[i][1] + g[k][2] * t->rest[i][2];
            sum += edge[i];
        }
        if (t->variable[0][k] >= 0) gradient[t->variable[0][k]] -= t->sign[0][k] * sum;
        for (int i = 0; i < 3; i++)
            if (t->variable[i + 1][k] >= 0) gradient[t->variable[i + 1][k]] += t->sign[i + 1][k] * edge[i];
    }
}

static double energy(void *user, const double *x, double *gradient) {
    const tangle *w = user;
    double sum = 0;
    memset(gradient, 0, w->variable_count * sizeof *gradient);
    for (size_t t = 0; t < w->tet_count; t++) {
        double j[3][3];
        jacobian(&w->tet[t], x, j);
        sum += bw_foldover(j, w->epsilon, 1);
        if (isinf(sum)) return sum;
        scatter(&w->tet[t], j, gradient);
    }
    return sum;
}

/* Sum of volume * tr(J^T J): convex; its minimum is the harmonic map, which ignores what is inverted now. */
static double harmonic(void *user, const double *x, double *gradient) {
    const tangle *w = user;
    double sum = 0;
    memset(gradient, 0, w->variable_count * sizeof *gradient);
    for (size_t t = 0; t < w->tet_count; t++) {
        const double(*r)[3] = w->tet[t].rest;
        double j[3][3], norm = 0, volume = 0;
        jacobian(&w->tet[t], x, j);
        for (int k = 0; k < 3; k++)
            volume +=
                r[0][k] * (r[1][(k + 1) % 3] * r[2][(k + 2) % 3] - r[1][(k + 2) % 3] * r[2][(k + 1) % 3]);
        for (int i = 0; i < 9; i++) norm += j[i / 3][i % 3] * j[i / 3][i % 3], j[i / 3][i % 3] *= 2 / volume;
        sum += norm / volume;
        scatter(&w->tet[t], j, gradient);
    }
    return sum;
}

static double smallest(const tangle *w, const double *x) {
    double least = INFINITY;
    for (size_t t = 0; t < w->tet_count; t++) least = fmin(least, bw_untangle_volume(&w->tet[t], x));
    return least;
}

/* The next epsilon after a round that brought the energy from `before` to `after`. */
static double lower(double epsilon, double least, double before, double after) {
    double gain = fmax(0.1, 1 - after / before);
    double root = sqrt(least * least + epsilon * epsilon);
    return least >= 0 ? (1 - gain) * epsilon : (1 - gain * root / (fabs(least) + root)) * epsilon;
}

/* Rounds of falling epsilon until all tets are positive, or no more are allowed. */
static bw_status descend(bw_context *ctx, tangle *w, double *x, bw_untangle_report *report) {
    const bw_lbfgs_options options = {.iterations = ITERATIONS, .step = 0.05, .settled = 1e-6};
    bw_lbfgs_report round;
    w->epsilon = 1;
    report->smallest = smallest(w, x);
    for (int i = 0; i < ROUNDS && report->smallest <= 0; i++, report->rounds++) {
        if (bw_lbfgs(ctx, w->variable_count, x, energy, w, &options, &round)) break;
        report->iterations += round.iterations;
        report->smallest = smallest(w, x);
        w->epsilon = lower(w->epsilon, report->smallest, round.before, round.after);
    }
    return ctx->error.status;
}

static bw_status minimize(bw_context *ctx, tangle *w, double *x, bw_lbfgs_energy *what,
                          bw_untangle_report *report) {
    const bw_lbfgs_options options = {.iterations = POLISH, .step = 0.05, .settled = 1e-7};
    bw_lbfgs_report found;
    bw_status status = bw_lbfgs(ctx, w->variable_count, x, what, w, &options, &found);
    report->iterations += found.iterations;
    return status;
}

bw_status bw_untangle(bw_context *ctx, const bw_untangle_tet *tet, size_t tet_count, size_t variable_count,
                      double *x, bw_untangle_report *report) {
    tangle w = {tet, tet_count, variable_count, 0};
    *report = (bw_untangle_report){.smallest = smallest(&w, x)};
    if (report->smallest <= 0 && (minimize(ctx, &w, x, harmonic, report) || descend(ctx, &w, x, report)))
        return ctx->error.status;
    w.epsilon = 0;
    if (report->smallest > 0 && !minimize(ctx, &w, x, energy, report)) report->smallest = smallest(&w, x);
    return ctx->error.status;
}
