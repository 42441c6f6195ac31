#include "hex/predict.h"

#include <math.h>
#include <string.h>

/* ---- n log2 n as integers ------------------------------------------------------------------------------------------ */

static int64_t n_log_n(uint64_t n) {
    return n < 2 ? 0 : (int64_t)llround(ldexp((double)n * log2((double)n), BW_PREDICT_SHIFT));
}

/* ---- the lattice --------------------------------------------------------------------------------------------------- */

/* What is outside by rounding is put on the box; what is no number, for a prediction may leave the range of doubles, at its low end. */
static int32_t on_lattice(const bw_predictor *p, double x, int k) {
    double most = (double)((1 << p->bits) - 1), at = rint((x - p->low[k]) / p->extent[k] * most);
    return (int32_t)(at > 0 ? at < most ? at : most : 0);
}

void bw_predict_box(const double (*position)[3], size_t count, double low[3], double high[3]) {
    for (int k = 0; k < 3; k++) low[k] = high[k] = count ? position[0][k] : 0;
    for (size_t v = 1; v < count; v++)
        for (int k = 0; k < 3; k++) low[k] = fmin(low[k], position[v][k]), high[k] = fmax(high[k], position[v][k]);
}

bw_status bw_predictor_init(bw_context *ctx, const double (*position)[3], size_t count, int bits, bw_predictor *p) {
    *p = (bw_predictor){.position = position, .bits = bits};
    double high[3];
    bw_predict_box(position, count, p->low, high);
    for (int k = 0; k < 3; k++) p->extent[k] = high[k] > p->low[k] ? high[k] - p->low[k] : 1;
    p->at = bw_alloc(ctx, count, sizeof *p->at);
    if (!p->at) return ctx->error.status;
    for (size_t v = 0; v < count; v++)
        for (int k = 0; k < 3; k++) p->at[v][k] = on_lattice(p, position[v][k], k);
    return BW_OK;
}

void bw_predictor_clear(bw_context *ctx, bw_predictor *p) {
    bw_free(ctx, p->at);
    *p = (bw_predictor){0};
}

/* ---- tallies ------------------------------------------------------------------------------------------------------- */

bw_status bw_predict_tally_init(bw_context *ctx, int bits, bw_predict_tally *tally) {
    *tally = (bw_predict_tally){.bits = bits};
    tally->times = bw_alloc(ctx, (size_t)1 << bits, sizeof *tally->times);
    return tally->times ? BW_OK : ctx->error.status;
}

void bw_predict_tally_clear(bw_context *ctx, bw_predict_tally *tally) {
    bw_free(ctx, tally->times);
    *tally = (bw_predict_tally){0};
}

void bw_predict_tally_empty(bw_predict_tally *tally) {
    memset(tally->times, 0, ((size_t)tally->highest + 1) * sizeof *tally->times);
    tally->coordinates = tally->wrong = tally->negative = 0;
    tally->highest = 0, tally->repeated = 0;
}

static void recount(bw_predict_tally *tally, uint32_t magnitude, uint32_t to) {
    tally->repeated += n_log_n(to) - n_log_n(tally->times[magnitude]);
    tally->times[magnitude] = to;
    if (magnitude > tally->highest) tally->highest = magnitude;
}

static void count_error(bw_predict_tally *tally, int32_t error) {
    tally->coordinates++;
    if (!error) return;
    uint32_t magnitude = (uint32_t)(error < 0 ? -error : error);
    tally->wrong++, tally->negative += error < 0;
    tally->times[magnitude]++;
    if (magnitude > tally->highest) tally->highest = magnitude;
}

/* X 4.1: along the first axis, then the second, then the third. */
static void count_row(const bw_predictor *p, const double corner[8], int axis, const uint32_t n[3], const bw_hvertex *vertex, uint32_t y, uint32_t z, bw_predict_tally *tally) {
    double j = n[1] ? (double)y / n[1] : 0, k = (double)z / n[2];
    for (uint32_t x = 0; x <= n[0]; x++) {
        double i = (double)x / n[0];
        double a = corner[0] + i * (corner[1] - corner[0]), b = corner[2] + i * (corner[3] - corner[2]);
        double c = corner[6] + i * (corner[7] - corner[6]), d = corner[4] + i * (corner[5] - corner[4]);
        double ab = a + j * (b - a), cd = d + j * (c - d);
        count_error(tally, p->at[vertex[x]][axis] - on_lattice(p, ab + k * (cd - ab), axis));
    }
}

void bw_predict_tally_block(const bw_predictor *p, const uint32_t n[3], const bw_hvertex *vertex, bw_predict_tally *tally) {
    for (int axis = 0; axis < 3; axis++) {
        double corner[8];
        for (int c = 0; c < 8; c++) corner[c] = p->position[vertex[bw_hex_grid_point(n, c & 1 ? n[0] : 0, c & 2 ? n[1] : 0, c & 4 ? n[2] : 0)]][axis];
        for (uint32_t z = 0; z <= n[2]; z++)
            for (uint32_t y = 0; y <= n[1]; y++) count_row(p, corner, axis, n, vertex + bw_hex_grid_point(n, 0, y, z), y, z, tally);
    }
    tally->repeated = 0;
    for (uint32_t m = 1; m <= tally->highest; m++) tally->repeated += n_log_n(tally->times[m]);
}

void bw_predict_tally_add(bw_predict_tally *tally, const bw_predict_errors *errors) {
    tally->coordinates += errors->coordinates, tally->wrong += errors->wrong, tally->negative += errors->negative;
    for (size_t i = 0; i < errors->count; i++) recount(tally, errors->list[i].magnitude, tally->times[errors->list[i].magnitude] + errors->list[i].times);
}

void bw_predict_tally_remove(bw_predict_tally *tally, const bw_predict_errors *errors) {
    tally->coordinates -= errors->coordinates, tally->wrong -= errors->wrong, tally->negative -= errors->negative;
    for (size_t i = 0; i < errors->count; i++) recount(tally, errors->list[i].magnitude, tally->times[errors->list[i].magnitude] - errors->list[i].times);
}

/* With f(n) = n log2 n, a part of n things has n times its entropy f(n) - sum of f over its classes. */
int64_t bw_predict_tally_cost(const bw_predict_tally *t) {
    int64_t all = n_log_n(t->coordinates), wrong = n_log_n(t->wrong);
    int64_t zero = all - wrong - n_log_n(t->coordinates - t->wrong);
    int64_t sign = wrong - n_log_n(t->negative) - n_log_n(t->wrong - t->negative);
    return zero + sign + wrong - t->repeated;
}

bw_status bw_predict_errors_init(bw_context *ctx, const bw_predict_tally *tally, bw_predict_errors *errors) {
    *errors = (bw_predict_errors){.coordinates = tally->coordinates, .wrong = tally->wrong, .negative = tally->negative, .cost = bw_predict_tally_cost(tally)};
    for (uint32_t m = 1; m <= tally->highest; m++) errors->count += tally->times[m] != 0;
    errors->list = bw_alloc(ctx, errors->count, sizeof *errors->list);
    if (!errors->list) return ctx->error.status;
    size_t i = 0;
    for (uint32_t m = 1; m <= tally->highest; m++)
        if (tally->times[m]) errors->list[i++] = (bw_predict_times){m, tally->times[m]};
    return BW_OK;
}

void bw_predict_errors_clear(bw_context *ctx, bw_predict_errors *errors) {
    bw_free(ctx, errors->list);
    *errors = (bw_predict_errors){0};
}

/* ---- cubes --------------------------------------------------------------------------------------------------------- */

static double ratio(const double side[3]) {
    double most = fmax(fmax(side[0], side[1]), side[2]), least = fmin(fmin(side[0], side[1]), side[2]);
    return least > 0 ? most / least : INFINITY;
}

double bw_cube_ratio(const uint32_t n[3]) {
    return ratio((const double[3]){n[0], n[1], n[2]});
}

static double edge_length(const double (*position)[3], const bw_hvertex *from, size_t step, uint32_t count) {
    double sum = 0;
    for (uint32_t i = 0; i < count; i++, from += step) {
        const double *a = position[from[0]], *b = position[from[step]];
        sum += sqrt((b[0] - a[0]) * (b[0] - a[0]) + (b[1] - a[1]) * (b[1] - a[1]) + (b[2] - a[2]) * (b[2] - a[2]));
    }
    return sum;
}

double bw_cube_ratio_of_lengths(const double (*position)[3], const uint32_t n[3], const bw_hvertex *vertex) {
    const size_t step[3] = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * ((size_t)n[1] + 1)};
    double side[3] = {0};
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        for (int i = 0; i < 4; i++) side[k] += edge_length(position, vertex + (i & 1 ? step[a] * n[a] : 0) + (i & 2 ? step[b] * n[b] : 0), step[k], n[k]) / 4;
    }
    return ratio(side);
}

/* ---- a mesh with blocks -------------------------------------------------------------------------------------------- */

typedef struct {
    bw_context *ctx;
    const bw_hex_mesh *mesh;
    bw_hex_groups blocks;
    bw_predictor predictor;
    bw_predict_tally all, one;
    bw_hvertex *grid;
    int64_t apart; /* costs of blocks with entropies of their own */
} survey;

static bw_status survey_block(survey *s, size_t g, bool *known, bw_predict_report *report) {
    uint32_t n[3];
    *known = bw_hex_grid_measure(s->mesh, &s->blocks, g, n);
    if (!*known) return BW_OK;
    bw_free(s->ctx, s->grid);
    s->grid = bw_alloc(s->ctx, bw_hex_grid_points(n), sizeof *s->grid);
    if (!s->grid) return s->ctx->error.status;
    *known = bw_hex_grid_fill(s->mesh, &s->blocks, g, n, s->grid);
    if (!*known) return BW_OK;
    bw_predict_errors errors;
    bw_predict_tally_empty(&s->one);
    bw_predict_tally_block(&s->predictor, n, s->grid, &s->one);
    bw_status status = bw_predict_errors_init(s->ctx, &s->one, &errors);
    if (status == BW_OK) bw_predict_tally_add(&s->all, &errors);
    s->apart += errors.cost;
    report->cube_ratio += bw_cube_ratio(n);
    report->cube_ratio_lengths += bw_cube_ratio_of_lengths(s->predictor.position, n, s->grid);
    bw_predict_errors_clear(s->ctx, &errors);
    return status == BW_OK ? bw_poll(s->ctx) : status;
}

static void fill_report(const survey *s, bw_predict_report *report) {
    report->blocks = s->blocks.count;
    report->vertices = s->mesh->vertex_count;
    report->vertices_coded = s->all.coordinates / 3;
    report->coordinates_wrong = s->all.wrong;
    report->e_g_pooled = bw_predict_per_vertex(bw_predict_tally_cost(&s->all), s->mesh->vertex_count);
    report->e_g_blocks = bw_predict_per_vertex(s->apart, s->mesh->vertex_count);
}

bw_status bw_predict_mesh(bw_context *ctx, const bw_hex_mesh *mesh, int bits, bool *known, bw_predict_report *report) {
    survey s = {.ctx = ctx, .mesh = mesh};
    bw_predict_report found = {0};
    *known = mesh->hex_count > 0;
    bw_status status = bw_hex_groups_of_blocks(ctx, mesh, &s.blocks);
    if (status == BW_OK) status = bw_predictor_init(ctx, (const double(*)[3])mesh->position, mesh->vertex_count, bits, &s.predictor);
    if (status == BW_OK) status = bw_predict_tally_init(ctx, bits, &s.all);
    if (status == BW_OK) status = bw_predict_tally_init(ctx, bits, &s.one);
    for (size_t g = 0; g < s.blocks.count && *known && status == BW_OK; g++) status = survey_block(&s, g, known, &found);
    if (status == BW_OK && *known) {
        fill_report(&s, &found);
        *report = found;
    }
    bw_hex_groups_clear(ctx, &s.blocks);
    bw_predictor_clear(ctx, &s.predictor);
    bw_predict_tally_clear(ctx, &s.all), bw_predict_tally_clear(ctx, &s.one);
    bw_free(ctx, s.grid);
    return status;
}
