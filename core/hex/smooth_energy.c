#include "hex/smooth_energy.h"

#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "hex/quality.h"
#include "solve/foldover.h"

enum { CHUNK = 128, LEAST_CHUNKS = 4, LEAST_VERTICES = 2048 }; /* hexes per partial sum; work per thread at least */

/* ---- positions -------------------------------------------------------------------------------------------------- */

static bw_status place_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        bw_hvertex v = s->moving[i];
        double *p = s->mesh->position[v];
        memcpy(p, s->base[v], sizeof s->base[v]);
        for (int d = 0; d < s->freedom[v]; d++)
            for (int k = 0; k < 3; k++) p[k] += s->unit[v] * s->x[s->first[v] + (size_t)d] * s->direction[v][d][k];
    }
    return BW_OK;
}

bw_status bw_smoother_place(bw_context *ctx, bw_smoother *s, const double *x) {
    s->x = x;
    return bw_parallel(ctx, s->moving_count, bw_parallel_ranges(ctx, s->moving_count, LEAST_VERTICES), place_range, s);
}

/* ---- energies of corners ---------------------------------------------------------------------------------------- */

/* Foldover-free energy of corner c; its gradient is added to slope. */
static double shape_energy(const bw_smoother *s, const double p[8][3], const double rest[3], int c, double slope[8][3]) {
    double j[3][3], scale[3];
    for (int k = 0; k < 3; k++) {
        scale[k] = (c >> k & 1 ? -1 : 1) / rest[k];
        for (int i = 0; i < 3; i++) j[i][k] = (p[c ^ 1 << k][i] - p[c][i]) * scale[k];
    }
    double value = bw_foldover(j, s->epsilon, s->size);
    if (isinf(value)) return value;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) {
            double g = j[i][k] * scale[k];
            slope[c ^ 1 << k][i] += g, slope[c][i] -= g;
        }
    return value;
}

/* exp(sharpness (1 - J)) of the scaled Jacobian J of corner c; its gradient is added to slope. */
static double scaled_energy(const bw_smoother *s, const double p[8][3], int c, double slope[8][3]) {
    double u[3][3], length[3];
    int mirrored = (c ^ c >> 1 ^ c >> 2) & 1;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) u[k][i] = p[c ^ 1 << k][i] - p[c][i];
        length[k] = sqrt(u[k][0] * u[k][0] + u[k][1] * u[k][1] + u[k][2] * u[k][2]);
        if (!(length[k] > 0)) return INFINITY;
        for (int i = 0; i < 3; i++) u[k][i] /= length[k];
    }
    double cofactor[3][3], sign = mirrored ? -1 : 1;
    double value = sign * bw_cofactors(u, cofactor), e = exp(s->sharpness * (1 - value));
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < 3; i++) {
            double g = -s->sharpness * e * (sign * cofactor[k][i] - value * u[k][i]) / length[k];
            slope[c ^ 1 << k][i] += g, slope[c][i] -= g;
        }
    return e;
}

static double hex_energy(bw_smoother *s, size_t h) {
    double p[8][3], sum = 0, (*slope)[3] = &s->slope[8 * h];
    bw_hex_corners(s->mesh, (bw_hex)h, p);
    memset(slope, 0, 8 * sizeof *slope);
    for (int c = 0; c < 8; c++) {
        sum += shape_energy(s, (const double(*)[3])p, s->rest[h], c, slope);
        if (s->sharpness > 0) sum += scaled_energy(s, (const double(*)[3])p, c, slope);
    }
    return sum;
}

static bw_status energy_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        size_t last = (i + 1) * CHUNK < s->touched_count ? (i + 1) * CHUNK : s->touched_count;
        s->sum[i] = 0;
        for (size_t t = i * CHUNK; t < last && !isinf(s->sum[i]); t++) s->sum[i] += hex_energy(s, (size_t)s->touched[t]);
    }
    return BW_OK;
}

static bw_status gather_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t m = begin; m < end; m++) {
        bw_hvertex v = s->moving[m];
        double g[3] = {0};
        for (size_t i = s->corner_begin[v]; i < s->corner_begin[v + 1] && s->freedom[v]; i++)
            for (int k = 0; k < 3; k++) g[k] += s->slope[s->corner[i]][k];
        for (int i = 0; i < s->freedom[v]; i++) {
            const double *d = s->direction[v][i];
            s->gradient[s->first[v] + (size_t)i] = s->unit[v] * (g[0] * d[0] + g[1] * d[1] + g[2] * d[2]);
        }
    }
    return BW_OK;
}

double bw_smoother_energy(void *user, const double *x, double *gradient) {
    bw_smoother *s = user;
    size_t chunks = (s->touched_count + CHUNK - 1) / CHUNK, vertices = s->moving_count;
    double sum = 0;
    s->gradient = gradient;
    s->work += s->touched_count;
    if (bw_smoother_place(s->ctx, s, x)) return INFINITY;
    if (bw_parallel(s->ctx, chunks, bw_parallel_ranges(s->ctx, chunks, LEAST_CHUNKS), energy_range, s)) return INFINITY;
    for (size_t i = 0; i < chunks; i++) sum += s->sum[i];
    if (!isfinite(sum)) return INFINITY;
    if (bw_parallel(s->ctx, vertices, bw_parallel_ranges(s->ctx, vertices, LEAST_VERTICES), gather_range, s)) return INFINITY;
    return sum;
}

/* ---- frames ----------------------------------------------------------------------------------------------------- */

/* Moves p to what holds v; if v is loose only so far that it is no farther from there than it may be. The directions to move in. */
static int hold_vertex(const bw_smoother *s, bw_hvertex v, double p[3], double direction[3][3]) {
    double from[3], way = 0;
    if (!s->loose[v]) return bw_hex_surface_project(s->surface, s->hold[v], p, direction);
    memcpy(from, p, sizeof from);
    bw_hex_surface_project(s->surface, s->hold[v], p, direction);
    for (int k = 0; k < 3; k++) way += (from[k] - p[k]) * (from[k] - p[k]);
    double most = s->leave * s->unit[v], part = way > most * most ? most / sqrt(way) : 1;
    for (int k = 0; k < 3; k++) p[k] += part * (from[k] - p[k]);
    for (int i = 0; i < 9; i++) direction[i / 3][i % 3] = i % 4 == 0;
    return s->epsilon > 0 ? 3 : 0; /* away from there as far as untangling needs, no farther */
}

static bw_status frame_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)range;
    for (size_t m = begin; m < end; m++) {
        bw_hvertex v = s->moving[m];
        double sum = 0, *p = s->base[v];
        if (m % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        for (size_t i = s->corner_begin[v]; i < s->corner_begin[v + 1]; i++) {
            const double *r = s->rest[s->corner[i] / 8];
            sum += r[0] + r[1] + r[2];
        }
        size_t count = s->corner_begin[v + 1] - s->corner_begin[v];
        s->unit[v] = count ? sum / (3 * (double)count) : 1;
        memcpy(p, s->mesh->position[v], sizeof s->base[v]);
        s->freedom[v] = (uint8_t)hold_vertex(s, v, p, s->direction[v]);
        memcpy(s->mesh->position[v], p, sizeof s->base[v]);
    }
    return BW_OK;
}

bw_status bw_smoother_frame(bw_context *ctx, bw_smoother *s, size_t *variables) {
    size_t n = s->moving_count;
    *variables = 0;
    if (bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST_VERTICES / 8), frame_range, s)) return ctx->error.status;
    for (size_t i = 0; i < n; i++) s->first[s->moving[i]] = *variables, *variables += s->freedom[s->moving[i]];
    return BW_OK;
}

void bw_smoother_rest(bw_smoother *s, double floor) {
    for (size_t t = 0; t < s->touched_count; t++) {
        bw_hex h = s->touched[t];
        double p[8][3], mean = 0, *rest = s->rest[h];
        bw_hex_corners(s->mesh, h, p);
        for (int k = 0; k < 3; k++) {
            rest[k] = 0;
            for (int c = 0; c < 8; c++) {
                double d[3], *a = p[c], *b = p[c | 1 << k];
                if (c >> k & 1) continue;
                for (int i = 0; i < 3; i++) d[i] = b[i] - a[i];
                rest[k] += sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / 4;
            }
            mean += rest[k] / 3;
        }
        for (int k = 0; k < 3; k++) rest[k] = mean > 0 ? fmax(rest[k], floor * mean) : 1;
    }
}

/* ---- what is active --------------------------------------------------------------------------------------------- */

static bool has_active(const bw_smoother *s, size_t h) {
    for (int c = 0; c < 8; c++)
        if (s->active[s->mesh->hex[h][c]]) return true;
    return false;
}

void bw_smoother_activate(bw_smoother *s, double threshold, int rings) {
    const bw_hex_mesh *m = s->mesh;
    memset(s->active, 0, m->vertex_count);
    for (size_t h = 0; h < m->hex_count; h++)
        for (int c = 0; c < 8 && s->least[h] < threshold; c++) s->active[m->hex[h][c]] = 1;
    for (int i = 0; i < rings; i++) { /* marks of this ring are 2 until it is whole */
        for (size_t h = 0; h < m->hex_count; h++) {
            bool any = false;
            for (int c = 0; c < 8; c++) any |= s->active[m->hex[h][c]] == 1;
            for (int c = 0; c < 8 && any; c++)
                if (!s->active[m->hex[h][c]]) s->active[m->hex[h][c]] = 2;
        }
        for (size_t v = 0; v < m->vertex_count; v++) s->active[v] = s->active[v] != 0;
    }
    s->moving_count = s->touched_count = 0;
    for (size_t v = 0; v < m->vertex_count; v++)
        if (s->active[v]) s->moving[s->moving_count++] = (bw_hvertex)v;
    for (size_t h = 0; h < m->hex_count; h++)
        if (has_active(s, h)) s->touched[s->touched_count++] = (bw_hex)h;
}

/* ---- state ------------------------------------------------------------------------------------------------------ */

static bw_status measure_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        bw_hex h = s->touched[i];
        double p[8][3], least = 1;
        int bad = 0;
        bw_hex_corners(s->mesh, h, p);
        for (int c = 0; c < 8; c++) {
            double value = bw_hex_corner_jacobian((const double(*)[3])p, c);
            bad += !(value > 0);
            least = fmin(least, value);
        }
        s->least[h] = least, s->bad[h] = (uint8_t)bad;
    }
    return BW_OK;
}

bw_status bw_smoother_measure(bw_context *ctx, bw_smoother *s, bw_smooth_state *state) {
    size_t n = s->touched_count;
    *state = (bw_smooth_state){.least = 1};
    if (bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST_CHUNKS * CHUNK), measure_range, s)) return ctx->error.status;
    for (size_t h = 0; h < s->mesh->hex_count; h++) {
        state->least = fmin(state->least, s->least[h]), state->mean += s->least[h];
        state->corners += s->bad[h], state->hexes += s->bad[h] != 0;
    }
    if (s->mesh->hex_count) state->mean /= (double)s->mesh->hex_count;
    return BW_OK;
}

static void list_corners(bw_smoother *s) {
    const bw_hex_mesh *m = s->mesh;
    size_t *begin = s->corner_begin;
    for (size_t i = 0; i < 8 * m->hex_count; i++) begin[m->hex[i / 8][i % 8] + 1]++;
    for (size_t v = 0; v < m->vertex_count; v++) begin[v + 1] += begin[v];
    for (size_t i = 8 * m->hex_count; i-- > 0;) s->corner[--begin[m->hex[i / 8][i % 8] + 1]] = (uint32_t)i;
    /* begin[v + 1] now is where v begins */
    for (size_t v = 0; v < m->vertex_count; v++) begin[v] = begin[v + 1];
    begin[m->vertex_count] = 8 * m->hex_count;
}

bw_status bw_smoother_init(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_smoother *s) {
    size_t v = mesh->vertex_count, h = mesh->hex_count;
    *s = (bw_smoother){.ctx = ctx, .mesh = mesh, .surface = surface, .size = 1};
    if (h > UINT32_MAX / 8) return bw_fail(ctx, BW_E_LIMIT, "more than 500 million hexes");
    if (!(s->hold = bw_alloc(ctx, v, sizeof *s->hold)) || !(s->loose = bw_alloc(ctx, v, 1)) ||
        !(s->base = bw_alloc(ctx, v, sizeof *s->base)) || !(s->direction = bw_alloc(ctx, v, sizeof *s->direction)) ||
        !(s->unit = bw_alloc(ctx, v, sizeof *s->unit)) || !(s->freedom = bw_alloc(ctx, v, 1)) ||
        !(s->first = bw_alloc(ctx, v, sizeof *s->first)) || !(s->corner_begin = bw_alloc(ctx, v + 1, sizeof *s->corner_begin)) ||
        !(s->corner = bw_alloc(ctx, 8 * h, sizeof *s->corner)) || !(s->rest = bw_alloc(ctx, h, sizeof *s->rest)) ||
        !(s->slope = bw_alloc(ctx, 8 * h, sizeof *s->slope)) || !(s->sum = bw_alloc(ctx, h / CHUNK + 1, sizeof *s->sum)) ||
        !(s->least = bw_alloc(ctx, h, sizeof *s->least)) || !(s->bad = bw_alloc(ctx, h, 1)) || !(s->active = bw_alloc(ctx, v, 1)) ||
        !(s->moving = bw_alloc(ctx, v, sizeof *s->moving)) || !(s->touched = bw_alloc(ctx, h, sizeof *s->touched))) {
        bw_smoother_clear(ctx, s);
        return ctx->error.status;
    }
    list_corners(s);
    bw_smoother_activate(s, 2, 0); /* everything */
    for (size_t i = 0; i < v; i++) s->hold[i] = bw_hex_surface_holds(surface, mesh->held[i], mesh->carrier[i], mesh->position[i]);
    return BW_OK;
}

void bw_smoother_clear(bw_context *ctx, bw_smoother *s) {
    bw_free(ctx, s->hold), bw_free(ctx, s->loose), bw_free(ctx, s->base), bw_free(ctx, s->direction), bw_free(ctx, s->unit);
    bw_free(ctx, s->freedom), bw_free(ctx, s->first), bw_free(ctx, s->corner_begin), bw_free(ctx, s->corner), bw_free(ctx, s->rest);
    bw_free(ctx, s->slope), bw_free(ctx, s->sum), bw_free(ctx, s->least), bw_free(ctx, s->bad), bw_free(ctx, s->active);
    bw_free(ctx, s->moving), bw_free(ctx, s->touched);
    *s = (bw_smoother){0};
}
