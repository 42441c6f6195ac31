#include "hex/smooth.h"

#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "hex/smooth_energy.h"
#include "solve/lbfgs.h"

static const double flat = 0.02;          /* a scaled Jacobian that is hardly positive */
static const double enough = 0.2;         /* a least scaled Jacobian beyond which the mean counts */
static const double least_epsilon = 5e-4; /* untangling goes no further */
enum {
    WHOLE = 2,    /* above all scaled Jacobians */
    PATIENCE = 6, /* rounds of untangling that may bring nothing */
    WAYS = 4,     /* to untangle */
    HALVINGS = 5, BACK = 16, /* of the way of a round; with all of it taken back */
    WORST = 12, PASSES = 4
};

typedef struct {
    bw_smoother s;
    const bw_smooth_options *options;
    bw_smooth_report *report;
    double (*start)[3], (*best)[3], (*before)[3]; /* positions: as they came in, of the best state, of the round before */
    double *x;                                    /* variables */
    size_t room;
    bw_smooth_state now, least;                   /* of the mesh, of `best` */
    double part;                                  /* progress */
} smoothing;

void bw_smooth_options_defaults(bw_smooth_options *options) {
    *options = (bw_smooth_options){.rounds = 24, .work = 1000000, .whole = 50000, .leave = 0.1};
}

/* The end of it lets the least go on growing where it costs the mean next to nothing. */
static double score(const bw_smooth_state *a) { return a->mean + 2 * fmin(a->least, enough) + 0.02 * a->least; }

/* Whether state a is to be preferred to b: never with more corners that are not positive than at the start. */
static bool better(const smoothing *w, const bw_smooth_state *a, const bw_smooth_state *b) {
    if (a->corners > w->report->before.corners) return false;
    if (a->hexes != b->hexes) return a->hexes < b->hexes;
    if (a->corners != b->corners) return a->corners < b->corners;
    return score(a) > score(b);
}

/* Positions of the vertices that may move now; the others are the same in all three. */
static void copy_moving(smoothing *w, double (*to)[3], double (*from)[3]) {
    for (size_t m = 0; m < w->s.moving_count; m++) memcpy(to[w->s.moving[m]], from[w->s.moving[m]], sizeof *to);
}

/* Measures the mesh, and keeps it if it is the best so far. */
static bw_status judge(bw_context *ctx, smoothing *w) {
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    if (better(w, &w->now, &w->least)) w->least = w->now, copy_moving(w, w->best, w->s.mesh->position);
    return BW_OK;
}

/* Back to the best mesh so far, with other vertices active. */
static bw_status restart(bw_context *ctx, smoothing *w, double threshold, int rings) {
    copy_moving(w, w->s.mesh->position, w->best);
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    return bw_smoother_activate(ctx, &w->s, threshold, rings);
}

/* One round: descent in the directions that are free now, projection. gain: the part of the energy that was lost. */
static bw_status descend(bw_context *ctx, smoothing *w, int iterations, double *gain) {
    const bw_lbfgs_options options = {.iterations = iterations, .step = 0.05, .settled = 1e-5};
    bw_lbfgs_report found;
    size_t n;
    *gain = 0;
    copy_moving(w, w->before, w->s.mesh->position);
    if (bw_smoother_frame(ctx, &w->s, &n) || bw_reserve(ctx, &w->x, &w->room, n + 1)) return ctx->error.status;
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

/* Whether the best mesh has to be untangled: corners are inverted, or flat, where a barrier is no start. */
static bool is_tangled(const smoothing *w) { return w->least.corners || w->least.least < flat; }

/* Rounds for a falling epsilon. Many short ones follow curved surfaces better than few long ones; where they bring nothing, epsilon falls faster. */
static bw_status untangle(bw_context *ctx, smoothing *w, double epsilon, int rounds, int iterations, double falling) {
    rounds = fit(w, 4 * w->options->work, rounds, iterations);
    falling = fmin(falling, pow(1e-3, 1.0 / rounds));
    w->s.epsilon = epsilon, w->s.sharpness = 0;
    for (int i = 0, idle = 0; i < rounds && w->s.epsilon > least_epsilon && is_tangled(w); i++) {
        double gain;
        bw_smooth_state before = w->least;
        if (bw_smoother_rest(ctx, &w->s, 0.25) || descend(ctx, w, iterations, &gain)) return ctx->error.status;
        idle = better(w, &w->least, &before) ? 0 : idle + 1;
        w->s.epsilon *= idle < PATIENCE ? falling : falling * falling * falling;
        bw_progress(ctx, w->part + 0.1 * (i + 1) / rounds);
    }
    w->part = fmin(0.4, w->part + 0.1);
    return BW_OK;
}

/* Takes vertices of the hexes that are not better than `floor` halfway back to where they were in the round before, or all the way. */
static void take_back(smoothing *w, double floor, bool halfway) {
    bw_smoother *s = &w->s;
    for (size_t t = 0; t < s->touched_count; t++) {
        const bw_hvertex *v = s->mesh->hex[s->touched[t]];
        for (int c = 0; c < 8 && s->least[s->touched[t]] <= floor; c++)
            if (s->rank[v[c]] >= 0) s->rank[v[c]] = -2 - s->rank[v[c]]; /* once, though it is in several */
    }
    for (size_t m = 0; m < s->moving_count; m++) {
        bw_hvertex v = s->moving[m];
        double *p = s->mesh->position[v], *q = w->before[v];
        if (s->rank[v] >= 0) continue;
        s->rank[v] = (int32_t)m;
        for (int k = 0; k < 3; k++) p[k] = halfway ? 0.5 * (p[k] + q[k]) : q[k];
        if (halfway && !s->loose[v]) bw_smoother_project(s, v, p);
    }
}

/* Projecting what moved in a tangent plane may spoil hexes: the way there is made shorter, around them. */
static bw_status back_off(bw_context *ctx, smoothing *w, double floor) {
    for (int i = 0; i < BACK && w->now.least <= floor; i++) {
        take_back(w, floor, i < HALVINGS);
        if (judge(ctx, w)) return ctx->error.status;
    }
    return BW_OK;
}

/* Rounds with the barrier, from a state without inverted corners. */
static bw_status improve(bw_context *ctx, smoothing *w, int rounds, int iterations, double sharpness) {
    w->s.epsilon = 0, w->s.sharpness = sharpness;
    for (int i = 0; i < rounds; i++) {
        double gain, before = score(&w->least), floor = fmin(0.999 * w->least.least, enough);
        if (bw_smoother_rest(ctx, &w->s, 0.05) || descend(ctx, w, iterations, &gain)) return ctx->error.status;
        if (back_off(ctx, w, floor)) return ctx->error.status;
        if (w->now.corners || (gain < 2e-3 && score(&w->least) < before + 1e-3)) break;
    }
    return BW_OK;
}

/* Rounds around the hexes that are not positive, or flat, from the best mesh. A small epsilon at the start goes on from there; a large one begins anew. */
static bw_status untangle_near(bw_context *ctx, smoothing *w) {
    static const struct {
        double epsilon;
        int rings, iterations;
    } way[WAYS] = {{1, 2, 8}, {0.1, 2, 16}, {1, 6, 12}, {0.1, 6, 30}};
    for (int i = 0; i < WAYS && is_tangled(w); i++) {
        if (restart(ctx, w, flat, way[i].rings)) return ctx->error.status;
        if (untangle(ctx, w, way[i].epsilon, 2 * w->options->rounds, way[i].iterations, 0.85)) return ctx->error.status;
    }
    return BW_OK;
}

/* Lets vertices of the hexes that are flat or not positive, in the best mesh, leave what holds them. */
static bw_status loosen(bw_context *ctx, smoothing *w) {
    if (restart(ctx, w, flat, 0)) return ctx->error.status;
    w->s.leave = w->options->leave;
    for (size_t m = 0; m < w->s.moving_count && w->s.leave > 0; m++) {
        bw_hvertex v = w->s.moving[m];
        w->s.loose[v] = w->s.hold[v].held == BW_HELD_SURFACE || w->s.hold[v].held == BW_HELD_CURVE;
    }
    return BW_OK;
}

/* Improves the best mesh, which has no inverted corner, where a hex is below `threshold`: short rounds, or longer ones if the whole mesh moves. */
static bw_status improve_near(bw_context *ctx, smoothing *w, double threshold, int rings, double sharpness) {
    if (restart(ctx, w, threshold, rings)) return ctx->error.status;
    uint64_t most = threshold < WHOLE ? 8 : w->options->work / (12 * (w->s.touched_count + 1));
    int iterations = most < 8 ? 8 : most > 30 ? 30 : (int)most;
    return improve(ctx, w, (fit(w, w->options->work, threshold < WHOLE ? 24 : 12, iterations) + 3) / 4, iterations, sharpness);
}

/* Shapes everywhere, or in a large mesh where they are bad; then the worst, again and again. */
static bw_status improve_once(bw_context *ctx, smoothing *w) {
    bool whole = w->s.mesh->hex_count <= w->options->whole;
    for (int i = 0; i < 3; i++)
        if (improve_near(ctx, w, whole ? WHOLE : enough, 2, i ? 2 << i : 0)) return ctx->error.status;
    for (int i = 0; i < WORST && (whole || w->least.least < enough); i++) {
        double before = score(&w->least);
        if (improve_near(ctx, w, w->least.least + 0.05, 1 + i % 4, 16)) return ctx->error.status;
        if (i % 4 == 3 && score(&w->least) < before + 1e-4) break;
    }
    return BW_OK;
}

/* Small meshes are worth more than one pass. */
static bw_status improve_all(bw_context *ctx, smoothing *w) {
    for (int i = 0; i < PASSES && (!i || w->s.work < w->options->work / 2); i++) {
        double before = score(&w->least);
        if (improve_once(ctx, w)) return ctx->error.status;
        bw_progress(ctx, 0.6 + 0.4 * (i + 1) / PASSES);
        if (score(&w->least) < before + 1e-3) break;
    }
    return BW_OK;
}

static bw_status run(bw_context *ctx, smoothing *w) {
    bool large = w->s.mesh->hex_count > w->options->whole;
    bool few = w->least.corners < w->s.mesh->hex_count / 100; /* then what is near them may do */
    if (!few && restart(ctx, w, large ? flat : WHOLE, 4)) return ctx->error.status;
    if (!few && untangle(ctx, w, 1, w->options->rounds, 30, 0.7)) return ctx->error.status;
    if (untangle_near(ctx, w)) return ctx->error.status;
    if (is_tangled(w) && (loosen(ctx, w) || untangle_near(ctx, w))) return ctx->error.status;
    return w->least.corners ? BW_OK : improve_all(ctx, w);
}

static void report_moves(smoothing *w) {
    bw_smooth_report *r = w->report;
    size_t n = w->s.mesh->vertex_count, held = 0;
    for (size_t v = 0; v < n; v++) {
        double moved = 0, off = 0;
        for (int k = 0; k < 3; k++) {
            moved += (w->best[v][k] - w->start[v][k]) * (w->best[v][k] - w->start[v][k]);
            off += (w->best[v][k] - w->before[v][k]) * (w->best[v][k] - w->before[v][k]);
        }
        r->moved_max = fmax(r->moved_max, sqrt(moved)), r->moved_mean += sqrt(moved) / (double)n;
        r->off_max = fmax(r->off_max, sqrt(off)), r->off_mean += sqrt(off);
        held += w->s.hold[v].held == BW_HELD_SURFACE || w->s.hold[v].held == BW_HELD_CURVE;
        r->left += w->s.loose[v] && off > 0;
    }
    if (held) r->off_mean /= (double)held;
}

static bw_status project_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    smoothing *w = user;
    (void)range;
    for (size_t v = begin; v < end; v++) {
        if (v % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        memcpy(w->before[v], w->best[v], sizeof w->before[v]);
        bw_smoother_project(&w->s, (bw_hvertex)v, w->before[v]);
    }
    return BW_OK;
}

static bw_status smooth(bw_context *ctx, smoothing *w, const bw_hex_surface *surface) {
    bw_hex_mesh *mesh = w->s.mesh;
    size_t n = mesh->vertex_count, bytes = n * sizeof *w->start;
    memcpy(w->start, mesh->position, bytes), memcpy(w->best, mesh->position, bytes);
    if (bw_smoother_init(ctx, mesh, surface, &w->report->before, &w->s)) return ctx->error.status;
    w->least = w->report->before;
    if (bw_smoother_measure(ctx, &w->s, &w->now)) return ctx->error.status;
    if (better(w, &w->now, &w->least)) w->least = w->now, memcpy(w->best, mesh->position, bytes);
    else memcpy(mesh->position, w->best, bytes);
    if (run(ctx, w) || bw_parallel_pieces(ctx, n, 4096, bw_parallel_ranges(ctx, n, 256), project_range, w)) return ctx->error.status;
    w->report->after = w->least, w->report->work = w->s.work;
    report_moves(w);
    return BW_OK;
}

bw_status bw_hex_smooth(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, const bw_smooth_options *options,
                        bw_smooth_report *report) {
    size_t n = mesh->vertex_count;
    smoothing w = {.s.mesh = mesh, .options = options, .report = report};
    *report = (bw_smooth_report){0};
    w.start = bw_alloc(ctx, n, sizeof *w.start), w.best = bw_alloc(ctx, n, sizeof *w.best), w.before = bw_alloc(ctx, n, sizeof *w.before);
    if (ctx->error.status == BW_OK) memcpy(mesh->position, smooth(ctx, &w, surface) == BW_OK ? w.best : w.start, n * sizeof *w.start);
    bw_free(ctx, w.start), bw_free(ctx, w.best), bw_free(ctx, w.before), bw_free(ctx, w.x);
    bw_smoother_clear(ctx, &w.s);
    return ctx->error.status;
}
