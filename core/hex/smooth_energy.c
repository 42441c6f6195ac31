#include "hex/smooth_energy.h"

#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "hex/corner_energy.h"
#include "hex/quality.h"

enum { CHUNK = 128, LEAST_CHUNKS = 4, LEAST_VERTICES = 8192, LEAST_HELD = 256 }; /* hexes per partial sum; work per thread at least */

/* ---- positions -------------------------------------------------------------------------------------------------- */

static bw_status place_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t m = begin; m < end; m++) {
        const bw_smooth_frame *f = &s->frame[m];
        double *p = s->mesh->position[s->moving[m]];
        memcpy(p, f->base, sizeof f->base);
        for (int d = 0; d < f->freedom; d++)
            for (int k = 0; k < 3; k++) p[k] += f->unit * s->x[f->first + (size_t)d] * f->direction[d][k];
    }
    return BW_OK;
}

bw_status bw_smoother_place(bw_context *ctx, bw_smoother *s, const double *x) {
    s->x = x;
    return bw_parallel(ctx, s->moving_count, bw_parallel_ranges(ctx, s->moving_count, LEAST_VERTICES), place_range, s);
}

/* ---- energies --------------------------------------------------------------------------------------------------- */

static bw_status energy_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t i = begin; i < end; i++) {
        size_t last = (i + 1) * CHUNK < s->touched_count ? (i + 1) * CHUNK : s->touched_count;
        s->sum[i] = 0;
        for (size_t t = i * CHUNK; t < last && !isinf(s->sum[i]); t++) {
            double p[8][3];
            bw_hex_corners(s->mesh, s->touched[t], p);
            s->sum[i] += bw_corner_energy((const double(*)[3])p, s->rest[t], s->epsilon, s->sharpness, &s->slope[8 * t]);
        }
    }
    return BW_OK;
}

static bw_status gather_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t m = begin; m < end; m++) {
        const bw_smooth_frame *f = &s->frame[m];
        double g[3] = {0};
        for (uint32_t i = s->corner_begin[m]; i < s->corner_begin[m + 1] && f->freedom; i++)
            for (int k = 0; k < 3; k++) g[k] += s->slope[s->corner[i]][k];
        for (int i = 0; i < f->freedom; i++) {
            const double *d = f->direction[i];
            s->gradient[f->first + (size_t)i] = f->unit * (g[0] * d[0] + g[1] * d[1] + g[2] * d[2]);
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

void bw_smoother_project(const bw_smoother *s, bw_hvertex v, double p[3]) {
    double direction[3][3];
    if (s->hold[v].held == BW_HELD_SURFACE || s->hold[v].held == BW_HELD_CURVE) bw_hex_surface_project(s->surface, s->hold[v], p, direction);
}

/* Moves p to what holds v; if v is loose only so far that it is no farther from there than it may be. The directions to move in. */
static int hold_vertex(const bw_smoother *s, bw_hvertex v, double unit, double p[3], double direction[3][3]) {
    double from[3], way = 0;
    if (!s->loose[v]) return bw_hex_surface_project(s->surface, s->hold[v], p, direction);
    memcpy(from, p, sizeof from);
    bw_hex_surface_project(s->surface, s->hold[v], p, direction);
    for (int k = 0; k < 3; k++) way += (from[k] - p[k]) * (from[k] - p[k]);
    double most = s->leave * unit, part = way > most * most ? most / sqrt(way) : 1;
    for (int k = 0; k < 3; k++) p[k] += part * (from[k] - p[k]);
    for (int i = 0; i < 9; i++) direction[i / 3][i % 3] = i % 4 == 0;
    return s->epsilon > 0 ? 3 : 0; /* away from there as far as untangling needs, no farther */
}

static bw_status frame_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)range;
    for (size_t m = begin; m < end; m++) {
        bw_smooth_frame *f = &s->frame[m];
        bw_hvertex v = s->moving[m];
        double sum = 0, *p = s->mesh->position[v];
        if (m % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        for (uint32_t i = s->corner_begin[m]; i < s->corner_begin[m + 1]; i++) {
            const double *r = s->rest[s->corner[i] / 8];
            sum += r[0] + r[1] + r[2];
        }
        f->unit = sum / (3 * (double)(s->corner_begin[m + 1] - s->corner_begin[m]));
        f->freedom = (uint8_t)hold_vertex(s, v, f->unit, p, f->direction);
        memcpy(f->base, p, sizeof f->base);
    }
    return BW_OK;
}

bw_status bw_smoother_frame(bw_context *ctx, bw_smoother *s, size_t *variables) {
    size_t n = s->moving_count;
    *variables = 0;
    if (bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST_HELD), frame_range, s)) return ctx->error.status;
    for (size_t m = 0; m < n; m++) s->frame[m].first = *variables, *variables += s->frame[m].freedom;
    return BW_OK;
}

static void rest_of(const double p[8][3], double floor, double rest[3]) {
    double mean = 0;
    for (int k = 0; k < 3; k++) {
        rest[k] = 0;
        for (int c = 0; c < 8; c++) {
            double d[3];
            if (c >> k & 1) continue;
            for (int i = 0; i < 3; i++) d[i] = p[c | 1 << k][i] - p[c][i];
            rest[k] += sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / 4;
        }
        mean += rest[k] / 3;
    }
    for (int k = 0; k < 3; k++) rest[k] = mean > 0 ? fmax(rest[k], floor * mean) : 1;
}

typedef struct {
    bw_smoother *s;
    double floor;
} resting;

static bw_status rest_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const resting *r = user;
    (void)ctx, (void)range;
    for (size_t t = begin; t < end; t++) {
        double p[8][3];
        bw_hex_corners(r->s->mesh, r->s->touched[t], p);
        rest_of((const double(*)[3])p, r->floor, r->s->rest[t]);
    }
    return BW_OK;
}

bw_status bw_smoother_rest(bw_context *ctx, bw_smoother *s, double floor) {
    resting r = {s, floor};
    return bw_parallel(ctx, s->touched_count, bw_parallel_ranges(ctx, s->touched_count, LEAST_VERTICES), rest_range, &r);
}

/* ---- what is active --------------------------------------------------------------------------------------------- */

/* Marks as rank 0 what a threshold and rings choose; other ranks are BW_NONE. */
static void mark(bw_smoother *s, double threshold, int rings) {
    enum { NEW = -2 };
    const bw_hex_mesh *m = s->mesh;
    for (size_t v = 0; v < m->vertex_count; v++) s->rank[v] = BW_NONE;
    for (size_t h = 0; h < m->hex_count; h++)
        for (int c = 0; c < 8 && s->least[h] < threshold; c++) s->rank[m->hex[h][c]] = 0;
    for (int i = 0; i < rings; i++) {
        for (size_t h = 0; h < m->hex_count; h++) {
            bool any = false;
            for (int c = 0; c < 8; c++) any |= s->rank[m->hex[h][c]] == 0;
            for (int c = 0; c < 8 && any; c++)
                if (s->rank[m->hex[h][c]] == BW_NONE) s->rank[m->hex[h][c]] = NEW;
        }
        for (size_t v = 0; v < m->vertex_count; v++)
            if (s->rank[v] == NEW) s->rank[v] = 0;
    }
}

static bool has_active(const bw_smoother *s, size_t h) {
    for (int c = 0; c < 8; c++)
        if (s->rank[s->mesh->hex[h][c]] != BW_NONE) return true;
    return false;
}

/* More room for the lists of active vertices and touched hexes; what was in them is lost. */
static bw_status make_room(bw_context *ctx, bw_smoother *s) {
    size_t m = s->moving_count, t = s->touched_count, *mr = s->moving_room, *tr = s->touched_room;
    if (bw_reserve(ctx, &s->moving, &mr[0], m) || bw_reserve(ctx, &s->frame, &mr[1], m) || bw_reserve(ctx, &s->corner_begin, &mr[2], m + 1))
        return ctx->error.status;
    if (bw_reserve(ctx, &s->touched, &tr[0], t) || bw_reserve(ctx, &s->rest, &tr[1], t) || bw_reserve(ctx, &s->corner, &tr[2], 8 * t) ||
        bw_reserve(ctx, &s->slope, &tr[3], 8 * t) || bw_reserve(ctx, &s->sum, &tr[4], t / CHUNK + 1))
        return ctx->error.status;
    return BW_OK;
}

static void list_corners(bw_smoother *s) {
    uint32_t *begin = s->corner_begin;
    memset(begin, 0, (s->moving_count + 1) * sizeof *begin);
    for (int fill = 0; fill < 2; fill++) {
        for (size_t t = s->touched_count; t-- > 0;)
            for (int c = 8; c-- > 0;) {
                int32_t m = s->rank[s->mesh->hex[s->touched[t]][c]];
                if (m == BW_NONE) continue;
                if (fill) s->corner[--begin[m]] = (uint32_t)(8 * t) + (uint32_t)c;
                else begin[m]++;
            }
        for (size_t m = 0, sum = 0; m <= s->moving_count && !fill; m++) begin[m] = (uint32_t)(sum += begin[m]);
    }
}

bw_status bw_smoother_activate(bw_context *ctx, bw_smoother *s, double threshold, int rings) {
    const bw_hex_mesh *mesh = s->mesh;
    size_t m = 0, t = 0;
    mark(s, threshold, rings);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        if (s->rank[v] != BW_NONE) s->rank[v] = (int32_t)m++;
    for (size_t h = 0; h < mesh->hex_count; h++) t += has_active(s, h);
    s->moving_count = m, s->touched_count = t;
    if (make_room(ctx, s)) return ctx->error.status;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        if (s->rank[v] != BW_NONE) s->moving[s->rank[v]] = (bw_hvertex)v;
    t = 0;
    for (size_t h = 0; h < mesh->hex_count; h++)
        if (has_active(s, h)) s->touched[t++] = (bw_hex)h;
    list_corners(s);
    return BW_OK;
}

/* ---- state ------------------------------------------------------------------------------------------------------ */

static void measure_hex(bw_smoother *s, bw_hex h) {
    double p[8][3], least = 1;
    int bad = 0;
    bw_hex_corners(s->mesh, h, p);
    for (int c = 0; c < 8; c++) {
        double value = bw_hex_corner_jacobian((const double(*)[3])p, c);
        bad += !(value > 0);
        least = value < least ? value : least;
    }
    s->least[h] = least, s->bad[h] = (uint8_t)bad;
}

static bw_status measure_touched(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    (void)ctx, (void)range;
    for (size_t t = begin; t < end; t++) measure_hex(s, s->touched[t]);
    return BW_OK;
}

static bw_status measure_all(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    (void)ctx, (void)range;
    for (size_t h = begin; h < end; h++) measure_hex(user, (bw_hex)h);
    return BW_OK;
}

static void add_up(const bw_smoother *s, bw_smooth_state *state) {
    *state = (bw_smooth_state){.least = 1};
    for (size_t h = 0; h < s->mesh->hex_count; h++) {
        state->least = s->least[h] < state->least ? s->least[h] : state->least, state->mean += s->least[h];
        state->corners += s->bad[h], state->hexes += s->bad[h] != 0;
    }
    if (s->mesh->hex_count) state->mean /= (double)s->mesh->hex_count;
}

bw_status bw_smoother_measure(bw_context *ctx, bw_smoother *s, bw_smooth_state *state) {
    size_t n = s->touched_count;
    if (bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST_CHUNKS * CHUNK), measure_touched, s)) return ctx->error.status;
    add_up(s, state);
    return BW_OK;
}

static bw_status hold_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_smoother *s = user;
    bw_hex_mesh *m = s->mesh;
    (void)range;
    for (size_t v = begin; v < end; v++) {
        if (v % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        s->hold[v] = bw_hex_surface_holds(s->surface, m->held[v], m->carrier[v], m->position[v]);
        bw_smoother_project(s, (bw_hvertex)v, m->position[v]);
    }
    return BW_OK;
}

bw_status bw_smoother_init(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_smooth_state *before, bw_smoother *s) {
    size_t v = mesh->vertex_count, h = mesh->hex_count;
    *s = (bw_smoother){.ctx = ctx, .mesh = mesh, .surface = surface};
    if (h > UINT32_MAX / 8) return bw_fail(ctx, BW_E_LIMIT, "more than 500 million hexes");
    s->hold = bw_alloc(ctx, v, sizeof *s->hold), s->loose = bw_alloc(ctx, v, 1), s->rank = bw_alloc(ctx, v, sizeof *s->rank);
    s->least = bw_alloc(ctx, h, sizeof *s->least), s->bad = bw_alloc(ctx, h, 1);
    if (ctx->error.status == BW_OK && !bw_parallel(ctx, h, bw_parallel_ranges(ctx, h, LEAST_CHUNKS * CHUNK), measure_all, s)) {
        add_up(s, before);
        bw_parallel_pieces(ctx, v, 16 * LEAST_HELD, bw_parallel_ranges(ctx, v, LEAST_HELD), hold_range, s);
    }
    if (ctx->error.status == BW_OK) bw_parallel(ctx, h, bw_parallel_ranges(ctx, h, LEAST_CHUNKS * CHUNK), measure_all, s);
    if (ctx->error.status != BW_OK) bw_smoother_clear(ctx, s);
    return ctx->error.status;
}

void bw_smoother_clear(bw_context *ctx, bw_smoother *s) {
    void *blocks[] = {s->hold, s->loose, s->rank, s->least, s->bad, s->moving, s->frame, s->corner_begin, s->touched, s->rest, s->corner, s->slope, s->sum};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    *s = (bw_smoother){0};
}
