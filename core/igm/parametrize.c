#include "igm/parametrize.h"

#include <math.h>
#include <string.h>

#include "igm/assemble.h"
#include "igm/split.h"
#include "solve/distortion.h"
#include "solve/untangle.h"

enum { STIFFENINGS = 10, REFINEMENTS = 12, POLISH = 12 };

#define THIN 0.25 /* of a hex: as thick the shapes of tets are at least in blocks that get no extent */

static const bw_untangle_options untangling = {.rounds = 120, .patience = 25, .polish = 4, .settled = 1e-3};

/* The input's map, in hexes of the mean size, or with each block stretched to its integers. */
typedef enum { SHAPE_BLOCKS, SHAPE_MAP, SHAPES } shape;

typedef struct {
    bw_context *ctx;
    const bw_atlas *atlas;
    bw_frame *f;
    double unit;            /* hexes per grid unit of the input's map: equal volumes */
    double left;            /* of the work limit */
    double shown, share;    /* progress of the stage where what runs began, and its part: a third is least squares */
    size_t tets_before;
    bw_untangle_tet *tet;
    double *weight, *x;
    double (*target)[3][3]; /* Jacobians for the start */
    bw_untangler *u;
    bw_untangle_report last;
    bw_igm *igm;
    uint8_t *wound;         /* [tet] around edges that the last map without inverted tets winds around too often; NULL: there was none */
    bw_parametrize_report *report;
} maker;

/* ---- the problem ---- */

static void set_units(maker *m) {
    const bw_complex *x = m->atlas->complex;
    double hexes = 0, volume = 0;
    for (size_t b = 0; b < x->block_count; b++) {
        double q = 1, p = 1;
        for (int k = 0; k < 3; k++) q *= (double)m->atlas->extent[b][k], p *= (double)x->block_extent[b][k];
        hexes += q, volume += p;
    }
    m->unit = cbrt(hexes / volume);
}

/* Edges from corner 0 as columns: in the input's map, in hexes, or as its block is stretched. A block may get no extent, a tet has to have a shape. */
static void wanted_edges(const maker *m, const bw_frame_tet *t, shape wanted, double least, double e[3][3]) {
    for (int k = 0; k < 3; k++) {
        double factor = m->unit, input = factor * (double)m->atlas->complex->block_extent[t->home][k];
        if (wanted == SHAPE_BLOCKS) factor *= fmax((double)m->atlas->extent[t->home][k], fmin(input, least)) / input;
        for (int i = 0; i < 3; i++) e[k][i] = factor * (t->p[i + 1][k] - t->p[0][k]);
    }
}

/* The Jacobian to start near. */
static void set_target(maker *m, size_t tet, shape wanted) {
    double e[3][3];
    wanted_edges(m, &m->f->tet[tet], wanted, 0, e);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            m->target[tet][a][b] = 0;
            for (int i = 0; i < 3; i++) m->target[tet][a][b] += e[a][i] * m->tet[tet].rest[i][b];
        }
}

static void release(maker *m) {
    bw_untangler_free(m->ctx, m->u);
    m->u = NULL;
    void *blocks[] = {m->tet, m->weight, m->x, m->target};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(m->ctx, blocks[i]);
    m->tet = NULL, m->weight = NULL, m->x = NULL, m->target = NULL;
}

/* The problem with shapes measured against `wanted`, and x as the frame has it. */
static bw_status pose(maker *m, shape wanted) {
    release(m);
    m->tet = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->tet);
    m->weight = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->weight);
    m->target = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->target);
    m->x = bw_alloc(m->ctx, m->f->variable_count, sizeof *m->x);
    if (m->ctx->error.status) return m->ctx->error.status;
    for (size_t i = 0; i < m->f->tet_count; i++) {
        const bw_frame_tet *t = &m->f->tet[i];
        double e[3][3];
        wanted_edges(m, t, wanted, THIN, e);
        m->weight[i] = bw_inverse3((const double(*)[3])e, m->tet[i].rest) / 6;
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 3; k++) m->tet[i].at[c][k] = (double)t->at[c][k];
        memcpy(m->tet[i].variable, t->variable, sizeof t->variable);
        memcpy(m->tet[i].sign, t->sign, sizeof t->sign);
    }
    bw_frame_read(m->f, m->x);
    return bw_untangler_new(m->ctx, m->tet, m->f->tet_count, m->f->variable_count, &m->u);
}

/* ---- the steps ---- */

/* How many steps of `most` the work limit allows. */
static int affordable(const maker *m, int most) {
    double steps = m->left * (double)m->tets_before / (double)m->f->tet_count;
    return steps >= most ? most : (int)steps;
}

static void spend(maker *m, int steps) {
    double work = steps * (double)m->f->tet_count / (double)m->tets_before;
    m->left -= work;
    m->report->work += work;
}

static size_t count_inverted(const maker *m) {
    size_t count = 0;
    for (size_t t = 0; t < m->f->tet_count; t++) count += !(bw_untangle_volume(&m->tet[t], m->x) > 0);
    return count;
}

/* Least squares, again and again with the inverted tets made stiffer; the best result is kept. */
static bw_status fit(maker *m, shape wanted) {
    double since = bw_seconds_now();
    double *best = bw_alloc(m->ctx, m->f->variable_count, sizeof *best);
    bw_status status = m->ctx->error.status;
    size_t fewest = SIZE_MAX, inverted = 1;
    int round = 0;
    for (size_t t = 0; t < m->f->tet_count; t++) set_target(m, t, wanted);
    for (int rounds = affordable(m, STIFFENINGS); (round < rounds || !round) && inverted && status == BW_OK; round++) {
        if ((status = bw_poll(m->ctx)) || (status = bw_untangler_fit(m->ctx, m->u, m->weight, (const double(*)[3][3])m->target, m->x))) break;
        spend(m, 1);
        bw_progress(m->ctx, m->shown + m->share / 3 * (round + 1) / STIFFENINGS);
        inverted = count_inverted(m);
        if (!round && !m->report->restarts) m->report->inverted_fit = inverted;
        if (inverted < fewest) memcpy(best, m->x, m->f->variable_count * sizeof *best), fewest = inverted;
        for (size_t t = 0; t < m->f->tet_count; t++)
            if (!(bw_untangle_volume(&m->tet[t], m->x) > 0)) m->weight[t] *= 2;
    }
    if (status == BW_OK) memcpy(m->x, best, m->f->variable_count * sizeof *best);
    if (!m->report->restarts) m->report->inverted_stiffened = fewest, m->report->stiffenings = round - 1;
    m->report->seconds_fit += bw_seconds_now() - since;
    bw_free(m->ctx, best);
    return status;
}

/* `from`: where the sequence of eps begins, as bw_untangle_options.from; `polish`: steps once all is positive. */
static bw_status untangle(maker *m, double from, int polish) {
    double since = bw_seconds_now();
    bw_untangle_options options = untangling;
    options.rounds = affordable(m, untangling.rounds), options.polish = polish, options.from = from;
    options.shown = m->shown + m->share / 3, options.share = m->share * 2 / 3;
    bw_status status = bw_untangler_run(m->ctx, m->u, &options, m->x, &m->last);
    spend(m, m->last.iterations);
    m->report->iterations += m->last.iterations;
    m->report->inverted = m->last.inverted;
    m->report->seconds_untangle += bw_seconds_now() - since;
    if (status == BW_OK) bw_frame_write(m->f, m->x);
    return status;
}

static void measure(maker *m) {
    double sum = 0, most = 0;
    for (size_t t = 0; t < m->f->tet_count; t++) {
        double j[3][3];
        bw_untangle_jacobian(&m->tet[t], m->x, j);
        double d = bw_distortion((const double(*)[3])j, 0) / 5;
        sum += d, most = fmax(most, d);
    }
    m->report->distortion_mean = sum / (double)m->f->tet_count, m->report->distortion_max = most;
}

/* Makes the map once all tets are positive; report->valid tells whether it is one. Where blocks are stretched differently, tets that are as their blocks want them jump from one to the
 * next: so what is left is done against the input's map. */
static bw_status conclude(maker *m) {
    if (m->last.inverted) return BW_OK;
    bw_status status = pose(m, SHAPE_MAP);
    if (status == BW_OK) status = untangle(m, 0, affordable(m, POLISH));
    if (status != BW_OK) return status;
    double since = bw_seconds_now();
    measure(m);
    bw_free(m->ctx, m->wound);
    if (!(m->wound = bw_alloc(m->ctx, m->f->tet_count, 1))) return m->ctx->error.status;
    status = bw_igm_assemble(m->ctx, m->atlas->cells->mesh, m->f, m->x, m->igm, &m->report->valid, m->wound);
    m->report->seconds_verify += bw_seconds_now() - since;
    return status;
}

/* Splits around what is inverted, and goes on from where the map was: with a small eps, for nearly all is well. */
static bw_status refine(maker *m) {
    size_t count = 0;
    uint8_t *marked = bw_alloc(m->ctx, m->f->tet_count, 1);
    bw_status status = m->ctx->error.status;
    for (size_t t = 0; t < m->f->tet_count && status == BW_OK; t++) marked[t] = !(bw_untangle_volume(&m->tet[t], m->x) > 0);
    if (status == BW_OK) status = bw_frame_split(m->ctx, m->f, marked, &count);
    bw_free(m->ctx, marked);
    m->report->splits += count;
    m->report->refinements++;
    if (status == BW_OK) status = pose(m, SHAPE_BLOCKS);
    if (status == BW_OK) status = untangle(m, 1, untangling.polish);
    return status == BW_OK ? conclude(m) : status;
}

/* Splits around edges that the map winds around too often: what is around them is held, else they would not. A new start is needed, for such a map has no inverted tet. */
static bw_status unwind(maker *m) {
    size_t count = 0;
    bw_status status = bw_frame_split(m->ctx, m->f, m->wound, &count);
    bw_free(m->ctx, m->wound);
    m->wound = NULL;
    m->report->splits += count;
    m->report->refinements++;
    return status;
}

/* Least squares and untangling, starting near the input's Jacobians and near those of stretched blocks; the frame keeps the better result. */
static bw_status start(maker *m) {
    double (*u)[4][3] = bw_alloc(m->ctx, m->f->tet_count, sizeof *u);
    bw_status status = m->ctx->error.status;
    size_t fewest = SIZE_MAX; /* inverted tets; a map that winds too often is worse than any */
    static const shape near[] = {SHAPE_MAP, SHAPE_BLOCKS};
    double shown = m->shown;
    m->share /= SHAPES;
    for (int i = 0; i < SHAPES && !m->report->valid && m->left >= 1 && status == BW_OK; i++) {
        m->report->restarts = i;
        m->shown = shown + i * m->share;
        if ((status = pose(m, SHAPE_BLOCKS)) || (status = fit(m, near[i])) || (status = untangle(m, 0, untangling.polish)) || (status = conclude(m))) break;
        if (m->last.inverted && m->last.inverted < fewest) {
            fewest = m->last.inverted;
            for (size_t t = 0; t < m->f->tet_count; t++) memcpy(u[t], m->f->tet[t].u, sizeof u[t]);
        }
        bw_progress(m->ctx, m->shown + m->share);
    }
    if (status == BW_OK && !m->report->valid && fewest < SIZE_MAX) {
        m->report->inverted_untangled = m->report->inverted = m->last.inverted = fewest;
        for (size_t t = 0; t < m->f->tet_count; t++) memcpy(m->f->tet[t].u, u[t], sizeof u[t]);
        status = pose(m, SHAPE_BLOCKS);
    }
    bw_free(m->ctx, u);
    return status;
}

bw_status bw_parametrize(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame, int max_work, bw_igm *igm, bw_parametrize_report *report) {
    maker m = {.ctx = ctx, .atlas = atlas, .f = frame, .igm = igm, .report = report, .left = max_work, .tets_before = frame->tet_count, .share = 0.6};
    *report = (bw_parametrize_report){0};
    memset(igm, 0, sizeof *igm);
    set_units(&m);
    bw_status status = start(&m);
    size_t hopeless = 10 * m.last.inverted + 50;
    for (int i = 0; i < REFINEMENTS && !report->valid && m.last.inverted < hopeless && m.left >= 1 && status == BW_OK; i++) {
        m.shown = 0.6 + 0.3 * i / REFINEMENTS, m.share = 0.3 / REFINEMENTS;
        if (m.last.inverted) {
            status = refine(&m);
        } else {
            status = unwind(&m);
            if (status == BW_OK) status = start(&m);
        }
        bw_progress(ctx, 0.6 + 0.3 * (i + 1) / REFINEMENTS);
    }
    report->limited = !report->valid && m.left < 1;
    report->tets = frame->tet_count;
    release(&m);
    bw_free(ctx, m.wound);
    return status;
}
