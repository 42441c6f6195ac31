#include "hex/smooth.h"

#include <math.h>
#include <string.h>

#include "hex/smooth_energy.h"
#include "solve/lbfgs.h"

static const double enough = 0.2; /* a least scaled Jacobian beyond which the mean counts */

typedef struct {
    bw_smoother s;
    const bw_smooth_options *options;
    bw_smooth_report *report;
    double (*start)[3], (*best)[3], (*before)[3]; /* positions: as they came in, of the best state, of the round before */
    double *x;                                    /* variables; room for 3 per vertex */
    bw_smooth_state now, least;                   /* of the mesh, of `best` */
} smoothing;

void bw_smooth_options_defaults(bw_smooth_options *options) {
    *options = (bw_smooth_options){.rounds = 20, .iterations = 30, .leave = 0};
}

static bool better(const bw_smooth_state *a, const bw_smooth_state *b) {
    if (a->corners != b->corners) return a->corners < b->corners;
    double x = fmin(a->least, enough), y = fmin(b->least, enough);
    return x != y ? x > y : a->mean > b->mean;
}

static void copy(smoothing *w, double (*to)[3], double (*from)[3]) { memcpy(to, from, w->s.mesh->vertex_count * sizeof *to); }

/* Measures the mesh, and keeps it if it is the best so far. */
static bw_status judge(bw_context *ctx, smoothing *w) {
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    if (better(&w->now, &w->least)) w->least = w->now, copy(w, w->best, w->s.mesh->position);
    return BW_OK;
}

/* One round: descent in the directions that are free now, projection. gain: the part of the energy that was lost. */
static bw_status descend(bw_context *ctx, smoothing *w, double *gain) {
    const bw_lbfgs_options options = {.iterations = w->options->iterations, .step = 0.05, .settled = 1e-5};
    bw_lbfgs_report found;
    size_t n;
    *gain = 0;
    copy(w, w->before, w->s.mesh->position);
    if (bw_smoother_frame(ctx, &w->s, &n)) return ctx->error.status;
    memset(w->x, 0, n * sizeof *w->x);
    if (bw_lbfgs(ctx, n, w->x, bw_smoother_energy, &w->s, &options, &found)) return ctx->error.status;
    if (bw_smoother_place(ctx, &w->s, w->x) || bw_smoother_frame(ctx, &w->s, &n)) return ctx->error.status;
    w->report->rounds++, w->report->iterations += (uint64_t)found.iterations;
    if (isfinite(found.before) && found.before > 0) *gain = 1 - found.after / found.before;
    return judge(ctx, w);
}

static bw_status untangle(bw_context *ctx, smoothing *w) {
    w->s.epsilon = 1, w->s.sharpness = 0, w->s.size = 1;
    for (int i = 0; i < w->options->rounds && w->least.corners; i++) {
        double gain;
        bw_smoother_rest(&w->s, 0.25);
        if (descend(ctx, w, &gain)) return ctx->error.status;
        w->s.epsilon *= 1 - fmin(0.9, fmax(0.3, gain));
        bw_progress(ctx, 0.3 * (i + 1) / w->options->rounds);
    }
    return BW_OK;
}

/* Positions between those of the round before and now, projected, until no corner is inverted: a projection may do that. */
static bw_status back_off(bw_context *ctx, smoothing *w) {
    size_t n;
    for (int i = 0; i < 6 && w->now.corners; i++) {
        for (size_t v = 0; v < w->s.mesh->vertex_count; v++)
            for (int k = 0; k < 3; k++)
                w->s.mesh->position[v][k] = 0.5 * (w->s.mesh->position[v][k] + w->before[v][k]);
        if (bw_smoother_frame(ctx, &w->s, &n) || judge(ctx, w)) return ctx->error.status;
    }
    return BW_OK;
}

/* Rounds with the barrier, from a state without inverted corners. */
static bw_status improve(bw_context *ctx, smoothing *w, int rounds, double sharpness) {
    w->s.epsilon = 0, w->s.sharpness = sharpness;
    for (int i = 0; i < rounds; i++) {
        double gain;
        bw_smoother_rest(&w->s, 0.05);
        if (descend(ctx, w, &gain)) return ctx->error.status;
        if (w->now.corners && back_off(ctx, w)) return ctx->error.status;
        if (w->now.corners || gain < 1e-3) break;
    }
    return BW_OK;
}

static bw_status run(bw_context *ctx, smoothing *w) {
    size_t n;
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    w->report->before = w->least = w->now;
    bw_smoother_rest(&w->s, 0.25);
    if (bw_smoother_frame(ctx, &w->s, &n) || judge(ctx, w) || untangle(ctx, w)) return ctx->error.status;
    if (w->least.corners) return BW_OK;
    copy(w, w->s.mesh->position, w->best);
    if (improve(ctx, w, 4, 0)) return ctx->error.status;
    copy(w, w->s.mesh->position, w->best);
    for (int i = 0; i < 3; i++) {
        copy(w, w->s.mesh->position, w->best);
        if (improve(ctx, w, 3, 4 << i)) return ctx->error.status;
    }
    return BW_OK;
}

static void report_moves(smoothing *w) {
    bw_smooth_report *r = w->report;
    size_t n = w->s.mesh->vertex_count, held = 0;
    for (size_t v = 0; v < n; v++) {
        double p[3], direction[3][3], moved = 0, off = 0;
        memcpy(p, w->best[v], sizeof p);
        bw_hex_surface_project(w->s.surface, w->s.hold[v], p, direction);
        for (int k = 0; k < 3; k++) {
            moved += (w->best[v][k] - w->start[v][k]) * (w->best[v][k] - w->start[v][k]);
            off += (w->best[v][k] - p[k]) * (w->best[v][k] - p[k]);
        }
        r->moved_max = fmax(r->moved_max, sqrt(moved)), r->moved_mean += sqrt(moved) / (double)n;
        r->off_max = fmax(r->off_max, sqrt(off)), r->off_mean += sqrt(off);
        held += w->s.hold[v].held == BW_HELD_SURFACE || w->s.hold[v].held == BW_HELD_CURVE;
        r->left += w->s.loose[v] && off > 0;
    }
    if (held) r->off_mean /= (double)held;
}

bw_status bw_hex_smooth(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, const bw_smooth_options *options,
                        bw_smooth_report *report) {
    size_t n = mesh->vertex_count;
    smoothing w = {.options = options, .report = report};
    *report = (bw_smooth_report){0};
    if (bw_smoother_init(ctx, mesh, surface, &w.s)) return ctx->error.status;
    w.start = bw_alloc(ctx, n, sizeof *w.start);
    w.best = bw_alloc(ctx, n, sizeof *w.best);
    w.before = bw_alloc(ctx, n, sizeof *w.before);
    w.x = bw_alloc(ctx, 3 * n, sizeof *w.x);
    if (w.start && w.best && w.before && w.x) {
        copy(&w, w.start, mesh->position), copy(&w, w.best, mesh->position);
        if (run(ctx, &w) == BW_OK) {
            report->after = w.least, report->evaluations = w.s.evaluations;
            report_moves(&w);
            copy(&w, mesh->position, w.best);
        } else {
            copy(&w, mesh->position, w.start);
        }
    }
    bw_free(ctx, w.start), bw_free(ctx, w.best), bw_free(ctx, w.before), bw_free(ctx, w.x);
    bw_smoother_clear(ctx, &w.s);
    return ctx->error.status;
}
