#include "hex/smooth.h"

#include <math.h>
#include <string.h>

#include "hex/smooth_energy.h"
#include "solve/lbfgs.h"

static const double flat = 0.02;   /* a scaled Jacobian that is hardly positive */
static const double enough = 0.2; /* a least scaled Jacobian beyond which the mean counts */

typedef struct {
    bw_smoother s;
    const bw_smooth_options *options;
    bw_smooth_report *report;
    double (*start)[3], (*best)[3], (*before)[3]; /* positions: as they came in, of the best state, of the round before */
    double *x;                                    /* variables; room for 3 per vertex */
    bw_smooth_state now, least;                   /* of the mesh, of `best` */
    int iterations;                               /* of a round of improving */
    double part;                                  /* progress */
} smoothing;

void bw_smooth_options_defaults(bw_smooth_options *options) {
    *options = (bw_smooth_options){.rounds = 24, .work = 1000000, .whole = 50000, .leave = 0.1};
}

static double score(const bw_smooth_state *a) { return a->mean + 2 * fmin(a->least, enough); }

/* Whether state a is to be preferred to b: never with more corners that are not positive than at the start. */
static bool better(const smoothing *w, const bw_smooth_state *a, const bw_smooth_state *b) {
    if (a->corners > w->report->before.corners) return false;
    if (a->hexes != b->hexes) return a->hexes < b->hexes;
    if (a->corners != b->corners) return a->corners < b->corners;
    return score(a) > score(b);
}

static void copy(smoothing *w, double (*to)[3], double (*from)[3]) { memcpy(to, from, w->s.mesh->vertex_count * sizeof *to); }

/* Measures the mesh, and keeps it if it is the best so far. */
static bw_status judge(bw_context *ctx, smoothing *w) {
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    if (better(w, &w->now, &w->least)) w->least = w->now, copy(w, w->best, w->s.mesh->position);
    return BW_OK;
}

/* Back to the best mesh so far; hexes are measured again, all of them. */
static bw_status return_to_best(bw_context *ctx, smoothing *w) {
    copy(w, w->s.mesh->position, w->best);
    bw_smoother_activate(&w->s, 2, 0);
    return bw_smoother_measure(ctx, &w->s, &w->now);
}

/* One round: descent in the directions that are free now, projection. gain: the part of the energy that was lost. */
static bw_status descend(bw_context *ctx, smoothing *w, int iterations, double *gain) {
    const bw_lbfgs_options options = {.iterations = iterations, .step = 0.05, .settled = 1e-5};
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

/* How many of `rounds` rounds of so many iterations the work allows, but 4 at least. */
static int fit(const smoothing *w, uint64_t work, int rounds, int iterations) {
    uint64_t most = work / ((uint64_t)iterations * (w->s.touched_count + 1));
    return most >= (uint64_t)rounds ? rounds : most < 4 ? 4 : (int)most;
}

/* Whether the best mesh has to be untangled: corners are inverted, or flat where vertices may leave what holds them. */
static bool is_tangled(const smoothing *w) { return w->least.corners || (w->s.leave > 0 && w->least.least < flat); }

/* Rounds for a falling epsilon. Many short ones follow curved surfaces better than few long ones. */
static bw_status untangle(bw_context *ctx, smoothing *w, int rounds, int iterations, double falling) {
    rounds = fit(w, 4 * w->options->work, rounds, iterations);
    falling = fmin(falling, pow(1e-3, 1.0 / rounds));
    w->s.epsilon = 1, w->s.sharpness = 0;
    for (int i = 0; i < rounds && is_tangled(w); i++) {
        double gain;
        bw_smoother_rest(&w->s, 0.25);
        if (descend(ctx, w, iterations, &gain)) return ctx->error.status;
        w->s.epsilon *= falling;
        bw_progress(ctx, w->part + 0.1 * (i + 1) / rounds);
    }
    w->part = fmin(0.4, w->part + 0.1);
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
        double gain, before = score(&w->least);
        bw_smoother_rest(&w->s, 0.05);
        if (descend(ctx, w, w->iterations, &gain)) return ctx->error.status;
        if (w->now.corners && back_off(ctx, w)) return ctx->error.status;
        if (w->now.corners || (gain < 2e-3 && score(&w->least) < before + 1e-3)) break;
    }
    return BW_OK;
}

/* Rounds around the hexes that are not positive, from the best mesh. */
static bw_status untangle_near(bw_context *ctx, smoothing *w, int rings, int iterations) {
    if (!is_tangled(w)) return BW_OK;
    if (return_to_best(ctx, w)) return ctx->error.status;
    bw_smoother_activate(&w->s, flat, rings);
    return untangle(ctx, w, 2 * w->options->rounds, iterations, 0.85);
}

/* Lets vertices of the hexes that are flat or not positive, in the best mesh, leave what holds them. */
static bw_status loosen(bw_context *ctx, smoothing *w) {
    if (return_to_best(ctx, w)) return ctx->error.status;
    w->s.leave = w->options->leave;
    for (size_t h = 0; h < w->s.mesh->hex_count && w->s.leave > 0; h++)
        for (int c = 0; c < 8 && w->s.least[h] < flat; c++) {
            bw_hvertex v = w->s.mesh->hex[h][c];
            w->s.loose[v] = w->s.hold[v].held == BW_HELD_SURFACE || w->s.hold[v].held == BW_HELD_CURVE;
        }
    return BW_OK;
}

/* Improves the best mesh, which has no inverted corner; progress from `from` on to 0.2 more. */
static bw_status improve_all(bw_context *ctx, smoothing *w, double from) {
    bool whole = w->s.mesh->hex_count <= w->options->whole;
    for (int i = 0; i < 4; i++) {
        if (return_to_best(ctx, w)) return ctx->error.status;
        if (!whole) bw_smoother_activate(&w->s, enough, 2);
        uint64_t most = w->options->work / (12 * (w->s.touched_count + 1));
        w->iterations = most < 8 ? 8 : most > 30 ? 30 : (int)most;
        if (improve(ctx, w, (fit(w, w->options->work, 12, w->iterations) + 3) / 4, i ? 2 << i : 0)) return ctx->error.status;
        bw_progress(ctx, from + 0.05 * (i + 1));
    }
    return BW_OK;
}

static bw_status run(bw_context *ctx, smoothing *w) {
    size_t n;
    w->s.epsilon = 1;
    bw_smoother_rest(&w->s, 0.25);
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    w->report->before = w->least = w->now;
    if (bw_smoother_frame(ctx, &w->s, &n) || judge(ctx, w)) return ctx->error.status;
    if (w->s.mesh->hex_count > w->options->whole) bw_smoother_activate(&w->s, flat, 4);
    bool few = w->least.corners < w->s.mesh->hex_count / 100; /* then what is near them may do */
    if (few && (untangle_near(ctx, w, 2, 8) || untangle_near(ctx, w, 6, 12))) return ctx->error.status;
    if (!few && untangle(ctx, w, w->options->rounds / 2, 30, 0.7)) return ctx->error.status;
    if (!few && (untangle_near(ctx, w, 2, 8) || untangle_near(ctx, w, 6, 12))) return ctx->error.status;
    if (w->least.corners && (loosen(ctx, w) || untangle_near(ctx, w, 2, 8) || untangle_near(ctx, w, 6, 12))) return ctx->error.status;
    if (w->least.corners || improve_all(ctx, w, 0.6)) return ctx->error.status;
    if (w->least.least >= flat || w->s.leave > 0) return BW_OK;
    if (loosen(ctx, w) || untangle_near(ctx, w, 2, 8) || untangle_near(ctx, w, 6, 12)) return ctx->error.status;
    return w->least.corners ? BW_OK : improve_all(ctx, w, 0.8);
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
            report->after = w.least, report->work = w.s.work;
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
