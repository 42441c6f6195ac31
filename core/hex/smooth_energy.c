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
    for (size_t v = begin; v < end; v++) {
        double *p = s->mesh->position[v];
        memcpy(p, s->base[v], sizeof s->base[v]);
        for (int i = 0; i < s->freedom[v]; i++)
            for (int k = 0; k < 3; k++) p[k] += s->unit[v] * s->x[s->first[v] + (size_t)i] * s->direction[v][i][k];
    }
    return BW_OK;
}

bw_status bw_smoother_place(bw_context *ctx, bw_smoother *s, const double *x) {
    s->x = x;
    return bw_parallel(ctx, s->mesh->vertex_count, bw_parallel_ranges(ctx, s->mesh->vertex_count, LEAST_VERTICES), place_range, s);
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
        size_t last = (i + 1) * CHUNK < s->mesh->hex_count ? (i + 1) * CHUNK : s->mesh->hex_count;
        s->sum[i] = 0;
        for (size_t h = i * CHUNK; h < last && !isinf(s->sum[i]); h++) s->sum[i] += hex_energy(s, h);
    }
    return BW_OK;
}

static bw_status gather_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t v = begin; v < end; v++) {
        double g[3] = {0};
        for (size_t i = s->corner_begin[v]; i < s->corner_begin[v + 1]; i++)
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
    size_t chunks = (s->mesh->hex_count + CHUNK - 1) / CHUNK, vertices = s->mesh->vertex_count;
    double sum = 0;
    s->gradient = gradient;
    s->evaluations++;
    if (bw_smoother_place(s->ctx, s, x)) return INFINITY;
    if (bw_parallel(s->ctx, chunks, bw_parallel_ranges(s->ctx, chunks, LEAST_CHUNKS), energy_range, s)) return INFINITY;
    for (size_t i = 0; i < chunks; i++) sum += s->sum[i];
    if (!isfinite(sum)) return INFINITY;
    if (bw_parallel(s->ctx, vertices, bw_parallel_ranges(s->ctx, vertices, LEAST_VERTICES), gather_range, s)) return INFINITY;
    return sum;
}

/* ---- frames ----------------------------------------------------------------------------------------------------- */

static bw_status frame_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)range;
    for (size_t v = begin; v < end; v++) {
        double *p = s->base[v];
        if (v % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        memcpy(p, s->mesh->position[v], sizeof s->base[v]);
        s->freedom[v] = (uint8_t)bw_hex_surface_project(s->surface, s->hold[v], p, s->direction[v]);
        memcpy(s->mesh->position[v], p, sizeof s->base[v]);
        double sum = 0;
        for (size_t i = s->corner_begin[v]; i < s->corner_begin[v + 1]; i++) {
            const double *r = s->rest[s->corner[i] / 8];
            sum += r[0] + r[1] + r[2];
        }
        size_t count = s->corner_begin[v + 1] - s->corner_begin[v];
        s->unit[v] = count ? sum / (3 * (double)count) : 1;
    }
    return BW_OK;
}

bw_status bw_smoother_frame(bw_context *ctx, bw_smoother *s, size_t *variables) {
    size_t n = s->mesh->vertex_count;
    if (bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST_VERTICES / 8), frame_range, s)) return ctx->error.status;
    for (size_t v = 0; v < n; v++) s->first[v + 1] = s->first[v] + s->freedom[v];
    *variables = s->first[n];
    return BW_OK;
}

void bw_smoother_rest(bw_smoother *s, double floor) {
    for (size_t h = 0; h < s->mesh->hex_count; h++) {
        double p[8][3], mean = 0, *rest = s->rest[h];
        bw_hex_corners(s->mesh, (bw_hex)h, p);
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

/* ---- state ------------------------------------------------------------------------------------------------------ */

typedef struct {
    bw_smoother *s;
    bw_smooth_state *state; /* [chunk] */
} measuring;

static bw_status measure_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    measuring *m = user;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        bw_smooth_state *state = &m->state[i];
        *state = (bw_smooth_state){.least = 1};
        for (size_t h = i * CHUNK; h < (i + 1) * CHUNK && h < m->s->mesh->hex_count; h++) {
            double p[8][3], least = 1;
            bw_hex_corners(m->s->mesh, (bw_hex)h, p);
            for (int c = 0; c < 8; c++) {
                double value = bw_hex_corner_jacobian((const double(*)[3])p, c);
                state->corners += !(value > 0);
                least = fmin(least, value);
            }
            state->hexes += !(least > 0);
            state->least = fmin(state->least, least), state->mean += least;
        }
    }
    return BW_OK;
}

bw_status bw_smoother_measure(bw_context *ctx, bw_smoother *s, bw_smooth_state *state) {
    size_t chunks = (s->mesh->hex_count + CHUNK - 1) / CHUNK;
    measuring m = {s, bw_alloc(ctx, chunks, sizeof *m.state)};
    *state = (bw_smooth_state){.least = 1};
    if (m.state && !bw_parallel(ctx, chunks, bw_parallel_ranges(ctx, chunks, LEAST_CHUNKS), measure_range, &m))
        for (size_t i = 0; i < chunks; i++) {
            state->least = fmin(state->least, m.state[i].least), state->mean += m.state[i].mean;
            state->corners += m.state[i].corners, state->hexes += m.state[i].hexes;
        }
    if (s->mesh->hex_count) state->mean /= (double)s->mesh->hex_count;
    bw_free(ctx, m.state);
    return ctx->error.status;
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
        !(s->first = bw_alloc(ctx, v + 1, sizeof *s->first)) || !(s->corner_begin = bw_alloc(ctx, v + 1, sizeof *s->corner_begin)) ||
        !(s->corner = bw_alloc(ctx, 8 * h, sizeof *s->corner)) || !(s->rest = bw_alloc(ctx, h, sizeof *s->rest)) ||
        !(s->slope = bw_alloc(ctx, 8 * h, sizeof *s->slope)) || !(s->sum = bw_alloc(ctx, h / CHUNK + 1, sizeof *s->sum))) {
        bw_smoother_clear(ctx, s);
        return ctx->error.status;
    }
    list_corners(s);
    for (size_t i = 0; i < v; i++) s->hold[i] = bw_hex_surface_holds(surface, mesh->held[i], mesh->carrier[i], mesh->position[i]);
    return BW_OK;
}

void bw_smoother_clear(bw_context *ctx, bw_smoother *s) {
    bw_free(ctx, s->hold), bw_free(ctx, s->loose), bw_free(ctx, s->base), bw_free(ctx, s->direction), bw_free(ctx, s->unit);
    bw_free(ctx, s->freedom), bw_free(ctx, s->first), bw_free(ctx, s->corner_begin), bw_free(ctx, s->corner), bw_free(ctx, s->rest);
    bw_free(ctx, s->slope), bw_free(ctx, s->sum);
    *s = (bw_smoother){0};
}
