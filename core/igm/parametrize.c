#include "igm/parametrize.h"

#include <math.h>
#include <string.h>

#include "igm/assemble.h"
#include "igm/split.h"
#include "solve/distortion.h"
#include "solve/untangle.h"

enum { STIFFENINGS = 10, REFINEMENTS = 12, ATTEMPTS = 3, UNWINDINGS = 3 };

#define STRIDE_LEAST (1.0 / 40) /* of a march: a stop for refinement */

static const bw_untangle_options untangling = {.rounds = 120, .patience = 25, .polish = 12, .settled = 1e-3};

/* Against what shapes are measured. */
typedef enum { SHAPE_MAP, SHAPE_SPACE } shape;

typedef struct {
    bw_context *ctx;
    const bw_atlas *atlas;
    bw_frame *f;
    double unit;            /* hexes per grid unit of the input's map: equal volumes */
    double space;           /* hexes per unit of space, likewise */
    shape against;
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
    double hexes = 0, volume = 0, space = 0;
    for (size_t b = 0; b < x->block_count; b++) {
        double q = 1, p = 1;
        for (int k = 0; k < 3; k++) q *= (double)m->atlas->extent[b][k], p *= (double)x->block_extent[b][k];
        hexes += q, volume += p;
    }
    for (size_t t = 0; t < m->f->tet_count; t++) {
        double e[3][3];
        for (int i = 0; i < 9; i++)
            e[i / 3][i % 3] = m->f->position[m->f->tet[t].vertex[i % 3 + 1]][i / 3] - m->f->position[m->f->tet[t].vertex[0]][i / 3];
        space += fabs(bw_det3((const double(*)[3])e)) / 6;
    }
    m->unit = cbrt(hexes / volume);
    m->space = cbrt(hexes / space);
}

/* Edges from corner 0 as columns: in the input's map, in hexes, or in space. False if the latter is not positive. */
static bool wanted_edges(const maker *m, const bw_frame_tet *t, shape against, double e[3][3]) {
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            e[k][i] = against == SHAPE_MAP ? m->unit * (t->p[i + 1][k] - t->p[0][k])
                                           : m->space * (m->f->position[t->vertex[i + 1]][k] - m->f->position[t->vertex[0]][k]);
    return bw_det3((const double(*)[3])e) > 1e-9 || against == SHAPE_MAP;
}

/* The Jacobian to start near: the input's map, in space measured block by block as the integers stretch it. */
static void set_target(maker *m, size_t tet) {
    const bw_frame_tet *t = &m->f->tet[tet];
    double e[3][3];
    wanted_edges(m, t, SHAPE_MAP, e);
    for (int k = 0; k < 3 && m->against == SHAPE_SPACE; k++)
        for (int i = 0; i < 3; i++)
            e[k][i] *= (double)m->atlas->extent[t->home][k] / ((double)m->atlas->complex->block_extent[t->home][k] * m->unit);
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

static bw_status pose(maker *m) {
    release(m);
    m->tet = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->tet);
    m->weight = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->weight);
    m->target = bw_alloc(m->ctx, m->f->tet_count, sizeof *m->target);
    m->x = bw_alloc(m->ctx, m->f->variable_count, sizeof *m->x);
    if (m->ctx->error.status) return m->ctx->error.status;
    for (size_t i = 0; i < m->f->tet_count; i++) {
        const bw_frame_tet *t = &m->f->tet[i];
        double e[3][3];
        if (!wanted_edges(m, t, m->against, e)) wanted_edges(m, t, SHAPE_MAP, e);
        m->weight[i] = bw_inverse3((const double(*)[3])e, m->tet[i].rest) / 6;
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 3; k++) m->tet[i].at[c][k] = (double)t->at[c][k];
        memcpy(m->tet[i].variable, t->variable, sizeof t->variable);
        memcpy(m->tet[i].sign, t->sign, sizeof t->sign);
        set_target(m, i);
    }
    return bw_untangler_new(m->ctx, m->tet, m->f->tet_count, m->f->variable_count, &m->u);
}

/* ---- the steps ---- */

static size_t count_inverted(const maker *m) {
    size_t count = 0;
    for (size_t t = 0; t < m->f->tet_count; t++) count += !(bw_untangle_volume(&m->tet[t], m->x) > 0);
    return count;
}

/* Least squares, again and again with the inverted tets made stiffer; the best result is kept. */
static bw_status fit(maker *m) {
    double since = bw_seconds_now();
    double *best = bw_alloc(m->ctx, m->f->variable_count, sizeof *best);
    bw_status status = m->ctx->error.status;
    size_t fewest = SIZE_MAX, inverted = 1;
    int round = 0;
    for (; round < STIFFENINGS && inverted && status == BW_OK; round++) {
        if ((status = bw_poll(m->ctx)) || (status = bw_untangler_fit(m->ctx, m->u, m->weight, (const double(*)[3][3])m->target, m->x))) break;
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

static bw_status untangle(maker *m) {
    double since = bw_seconds_now();
    bw_status status = bw_untangler_run(m->ctx, m->u, &untangling, m->x, &m->last);
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

/* Makes the map once all tets are positive; report->valid tells whether it is one. */
static bw_status conclude(maker *m) {
    double since = bw_seconds_now();
    if (m->last.inverted) return BW_OK;
    measure(m);
    bw_free(m->ctx, m->wound);
    if (!(m->wound = bw_alloc(m->ctx, m->f->tet_count, 1))) return m->ctx->error.status;
    bw_status status = bw_igm_assemble(m->ctx, m->atlas->cells->mesh, m->f, m->x, m->igm, &m->report->valid, m->wound);
    m->report->seconds_verify += bw_seconds_now() - since;
    return status;
}

/* ---- marching ---- */

/* Constants between those of the input's map and the integers: at = (1 - far) * input + far * integer. */
static void set_constants(maker *m, double far) {
    for (size_t i = 0; i < m->f->tet_count; i++) {
        const bw_frame_tet *t = &m->f->tet[i];
        for (int c = 0; c < 4; c++)
            for (int k = 0; k < 3; k++) {
                int32_t v = t->variable[c][k];
                double input = m->unit * t->p[c][k];
                if (v != BW_NONE) input -= t->sign[c][k] * m->unit * m->f->tet[m->f->reference[v][0] / 4].p[m->f->reference[v][0] % 4][m->f->reference[v][1]];
                m->tet[i].at[c][k] = (1 - far) * input + far * (double)t->at[c][k];
            }
    }
}

/* From constants at `from` to those at `to`: the change of Jacobians is spread as evenly as may be, then what it inverted is untangled. */
static bw_status advance(maker *m, double from, double to) {
    bw_untangle_options options = untangling;
    options.polish = to < 1 ? 4 : untangling.polish;
    set_constants(m, from);
    for (size_t t = 0; t < m->f->tet_count; t++) bw_untangle_jacobian(&m->tet[t], m->x, m->target[t]);
    set_constants(m, to);
    bw_status status = bw_untangler_fit(m->ctx, m->u, m->weight, (const double(*)[3][3])m->target, m->x);
    if (status == BW_OK) status = bw_untangler_run(m->ctx, m->u, &options, m->x, &m->last);
    m->report->iterations += m->last.iterations;
    return status;
}

/* From the input's map, which is valid, to the integers in small steps, so that nothing is ever far from valid and no edge is wound around too often. */
static bw_status march(maker *m) {
    double far = 0, stride = 0.25, since = bw_seconds_now();
    double *kept = bw_alloc(m->ctx, m->f->variable_count, sizeof *kept);
    bw_status status = m->ctx->error.status;
    for (size_t v = 0; v < m->f->variable_count && status == BW_OK; v++)
        m->x[v] = m->unit * m->f->tet[m->f->reference[v][0] / 4].p[m->f->reference[v][0] % 4][m->f->reference[v][1]];
    while (far < 1 && stride > STRIDE_LEAST && status == BW_OK) {
        double next = fmin(1, far + stride);
        memcpy(kept, m->x, m->f->variable_count * sizeof *kept);
        if ((status = advance(m, far, next))) break;
        if (m->last.inverted) {
            memcpy(m->x, kept, m->f->variable_count * sizeof *kept);
            stride *= 0.5;
        } else {
            far = next;
        }
    }
    if (status == BW_OK && far < 1) status = advance(m, far, 1);
    set_constants(m, 1);
    m->report->inverted = m->last.inverted;
    m->report->seconds_untangle += bw_seconds_now() - since;
    if (status == BW_OK) bw_frame_write(m->f, m->x);
    bw_free(m->ctx, kept);
    return status;
}

/* Splits around what is inverted, and goes on from where the map was. */
static bw_status refine(maker *m, size_t *count) {
    uint8_t *marked = bw_alloc(m->ctx, m->f->tet_count, 1);
    bw_status status = m->ctx->error.status;
    for (size_t t = 0; t < m->f->tet_count && status == BW_OK; t++) marked[t] = !(bw_untangle_volume(&m->tet[t], m->x) > 0);
    if (status == BW_OK) status = bw_frame_split(m->ctx, m->f, marked, count);
    bw_free(m->ctx, marked);
    m->report->splits += *count;
    m->report->refinements++;
    if (status == BW_OK) status = pose(m);
    if (status == BW_OK) bw_frame_read(m->f, m->x);
    return status;
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

/* A start and untangling, for each way of measuring shapes, and a march; the frame keeps the better result. */
static bw_status start(maker *m) {
    double (*u)[4][3] = bw_alloc(m->ctx, m->f->tet_count, sizeof *u);
    bw_status status = m->ctx->error.status;
    size_t fewest = SIZE_MAX; /* inverted tets; a map that winds too often is worse than any */
    shape best = SHAPE_MAP;
    for (int attempt = 0; attempt < ATTEMPTS && !m->report->valid && status == BW_OK; attempt++) {
        m->against = attempt == 1 ? SHAPE_SPACE : SHAPE_MAP;
        m->report->restarts = attempt;
        status = pose(m);
        if (status == BW_OK && attempt < 2) status = fit(m);
        if (status == BW_OK) status = attempt < 2 ? untangle(m) : march(m);
        if (status == BW_OK) status = conclude(m);
        if (status != BW_OK) break;
        if (m->report->valid || (m->last.inverted && m->last.inverted < fewest)) {
            fewest = m->last.inverted, best = m->against;
            for (size_t t = 0; t < m->f->tet_count; t++) memcpy(u[t], m->f->tet[t].u, sizeof u[t]);
        }
        bw_progress(m->ctx, 0.2 * (attempt + 1));
    }
    if (fewest < SIZE_MAX) m->report->inverted_untangled = m->report->inverted = fewest;
    if (status == BW_OK && m->against != best && fewest < SIZE_MAX) {
        m->against = best;
        for (size_t t = 0; t < m->f->tet_count; t++) memcpy(m->f->tet[t].u, u[t], sizeof u[t]);
        status = pose(m);
        if (status == BW_OK) bw_frame_read(m->f, m->x);
    }
    bw_free(m->ctx, u);
    return status;
}

bw_status bw_parametrize(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame, bw_igm *igm, bw_parametrize_report *report) {
    maker m = {.ctx = ctx, .atlas = atlas, .f = frame, .igm = igm, .report = report};
    *report = (bw_parametrize_report){0};
    memset(igm, 0, sizeof *igm);
    set_units(&m);
    bw_status status = start(&m);
    for (int i = 0; i < UNWINDINGS && m.wound && !report->valid && status == BW_OK; i++) {
        status = unwind(&m);
        if (status == BW_OK) status = start(&m);
    }
    size_t hopeless = 10 * report->inverted + 50;
    for (int i = 0; i < REFINEMENTS && report->inverted && report->inverted < hopeless && status == BW_OK; i++) {
        size_t count = 0;
        status = refine(&m, &count);
        if (status == BW_OK) status = untangle(&m);
        if (status == BW_OK) status = conclude(&m);
        bw_progress(ctx, 0.6 + 0.3 * (i + 1) / REFINEMENTS);
    }
    report->tets = frame->tet_count;
    release(&m);
    bw_free(ctx, m.wound);
    return status;
}
