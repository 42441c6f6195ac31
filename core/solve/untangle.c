#include "solve/untangle.h"

#include <math.h>
#include <string.h>

#include "solve/lbfgs.h"

enum { ROUNDS = 30, ITERATIONS = 60, POLISH = 300 };

typedef struct {
    const bw_untangle_tet *tet;
    size_t tet_count, variable_count;
    double epsilon;
} tangle;

/* J = (edges from corner 0) rest, and its cofactors, the derivatives of its determinant. */
static double jacobian(const bw_untangle_tet *t, const double *x, double j[3][3], double cofactor[3][3]) {
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
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            int a1 = (a + 1) % 3, a2 = (a + 2) % 3, b1 = (b + 1) % 3, b2 = (b + 2) % 3;
            cofactor[a][b] = j[a1][b1] * j[a2][b2] - j[a1][b2] * j[a2][b1];
        }
    return j[0][0] * cofactor[0][0] + j[0][1] * cofactor[0][1] + j[0][2] * cofactor[0][2];
}

double bw_untangle_volume(const bw_untangle_tet *tet, const double *x) {
    double j[3][3], cofactor[3][3];
    return jacobian(tet, x, j, cofactor);
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
        double j[3][3], c[3][3], norm = 0;
        double d = jacobian(&w->tet[t], x, j, c), root = sqrt(w->epsilon * w->epsilon + d * d);
        /* (d + root) / 2, without cancellation where d is negative */
        double chi = d >= 0 ? 0.5 * (d + root) : 0.5 * w->epsilon * w->epsilon / (root - d);
        if (!(chi > 0)) return INFINITY;
        double slope = root > 0 ? 0.5 * (1 + d / root) : 1;
        for (int i = 0; i < 9; i++) norm += j[i / 3][i % 3] * j[i / 3][i % 3];
        double third = cbrt(chi), by_norm = 1 / (third * third);
        sum += norm * by_norm + (d * d + 1) / chi;
        double by_d = (-2.0 / 3.0 * norm * by_norm * slope + 2 * d - (d * d + 1) * slope / chi) / chi;
        for (int i = 0; i < 9; i++) j[i / 3][i % 3] = 2 * by_norm * j[i / 3][i % 3] + by_d * c[i / 3][i % 3];
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
        double j[3][3], c[3][3], norm = 0, volume = 0;
        jacobian(&w->tet[t], x, j, c);
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
