#include "solve/lbfgs.h"

#include <math.h>
#include <string.h>

enum { PAIRS = 8, TRIALS = 50 };

typedef struct {
    size_t n;
    double *x, *gradient, *direction, *trial, *trial_gradient;
    double *s[PAIRS], *y[PAIRS], rho[PAIRS];
    int pairs, newest; /* how many are kept, and where the next one goes */
    double value;
    bw_lbfgs_energy *energy;
    void *user;
} search;

static double dot(size_t n, const double *a, const double *b) {
    double sum = 0;
    for (size_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* direction = -(inverse Hessian estimate) gradient: the two-loop recursion. */
static void choose_direction(search *w, double step) {
    double alpha[PAIRS], *d = w->direction, largest = 0;
    for (size_t i = 0; i < w->n; i++) d[i] = -w->gradient[i];
    for (int k = 0; k < w->pairs; k++) {
        int at = (w->newest + PAIRS - 1 - k) % PAIRS;
        alpha[at] = w->rho[at] * dot(w->n, w->s[at], d);
        for (size_t i = 0; i < w->n; i++) d[i] -= alpha[at] * w->y[at][i];
    }
    for (size_t i = 0; i < w->n; i++) largest = fmax(largest, fabs(d[i]));
    int last = (w->newest + PAIRS - 1) % PAIRS;
    double scale = w->pairs ? 1 / (w->rho[last] * dot(w->n, w->y[last], w->y[last])) : step / largest;
    for (size_t i = 0; i < w->n; i++) d[i] *= scale;
    for (int k = w->pairs; k-- > 0;) {
        int at = (w->newest + PAIRS - 1 - k) % PAIRS;
        double beta = w->rho[at] * dot(w->n, w->y[at], d);
        for (size_t i = 0; i < w->n; i++) d[i] += (alpha[at] - beta) * w->s[at][i];
    }
}

/* Finds a step that fulfils the weak Wolfe conditions, or the last one that gains anything; false if none
 * does. */
static bool search_line(search *w) {
    double slope = dot(w->n, w->direction, w->gradient), low = 0, high = INFINITY, t = 1;
    if (!(slope < 0)) return false;
    for (int i = 0; i < TRIALS; i++) {
        for (size_t k = 0; k < w->n; k++) w->trial[k] = w->x[k] + t * w->direction[k];
        double value = w->energy(w->user, w->trial, w->trial_gradient);
        bool enough = value <= w->value + 1e-4 * t * slope; /* false for NaN */
        if (enough && (dot(w->n, w->trial_gradient, w->direction) >= 0.9 * slope || i == TRIALS - 1)) {
            w->value = value;
            return true;
        }
        if (enough)
            low = t;
        else
            high = t;
        t = isinf(high) ? 2 * low : 0.5 * (low + high);
    }
    return false;
}

/* Takes the step; its pair is kept if it has positive curvature. */
static void accept(search *w) {
    double *s = w->s[w->newest], *y = w->y[w->newest], *swap;
    for (size_t i = 0; i < w->n; i++)
        s[i] = w->trial[i] - w->x[i], y[i] = w->trial_gradient[i] - w->gradient[i];
    double sy = dot(w->n, s, y);
    swap = w->x, w->x = w->trial, w->trial = swap;
    swap = w->gradient, w->gradient = w->trial_gradient, w->trial_gradient = swap;
    if (!(sy > 0) || isinf(1 / sy)) return;
    w->rho[w->newest] = 1 / sy;
    w->newest = (w->newest + 1) % PAIRS;
    w->pairs += w->pairs < PAIRS;
}

static bw_status iterate(bw_context *ctx, search *w, const bw_lbfgs_options *options,
                         bw_lbfgs_report *report) {
    for (int i = 0; i < options->iterations; i++) {
        double before = w->value;
        if (bw_poll(ctx)) return ctx->error.status;
        if (!(dot(w->n, w->gradient, w->gradient) > 0)) break;
        choose_direction(w, options->step);
        if (!search_line(w)) {
            if (!w->pairs) break;
            w->pairs = 0; /* once more along the gradient */
            continue;
        }
        accept(w);
        report->iterations++;
        if (before - w->value <= options->settled * fabs(w->value)) break;
    }
    return BW_OK;
}

bw_status bw_lbfgs(bw_context *ctx, size_t n, double *x, bw_lbfgs_energy *energy, void *user,
                   const bw_lbfgs_options *options, bw_lbfgs_report *report) {
    search w = {.n = n, .energy = energy, .user = user};
    double *all = bw_alloc(ctx, (5 + 2 * PAIRS) * n, sizeof *all);
    *report = (bw_lbfgs_report){0};
    if (!all) return ctx->error.status;
    w.x = all, w.gradient = all + n, w.direction = all + 2 * n, w.trial = all + 3 * n,
    w.trial_gradient = all + 4 * n;
    for (size_t k = 0; k < PAIRS; k++) w.s[k] = all + (5 + 2 * k) * n, w.y[k] = w.s[k] + n;
    memcpy(w.x, x, n * sizeof *x);
    w.value = report->before = energy(user, w.x, w.gradient);
    bw_status status = iterate(ctx, &w, options, report);
    memcpy(x, w.x, n * sizeof *x);
    report->after = w.value;
    bw_free(ctx, all);
    return status;
}
