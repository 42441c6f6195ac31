/* Distances between the hex mesh's boundary and the input's (quality.h). */
#include <math.h>
#include <string.h>

#include "base/parallel.h"
#include "hex/quality.h"
#include "hex/skin.h"

enum { SAMPLES = 4, LEAST = 256 }; /* points along each side of a triangle; triangles per thread at least */

/* Distance from samples of items to a tree: the items are triangles, or segments (last two corners the same). */
typedef struct {
    const double (*point)[3];
    const int32_t (*item)[3];
    const uint8_t *skip;  /* items left out; NULL: none */
    const bw_bvh *tree;
    double most[BW_PARALLEL_MOST]; /* squared, by range */
} one_sided;

/* Takes the sample at p into account. It is no farther than the last one's distance plus the way from there, which mostly tells that it is not the farthest, and
 * else where to search. */
static void take_sample(const one_sided *w, const double p[3], double last[3], double *last_distance, double *most) {
    bw_bvh_hit hit;
    double way = 0;
    for (int k = 0; k < 3; k++) way += (p[k] - last[k]) * (p[k] - last[k]);
    double bound = (*last_distance + sqrt(way)) * (1 + 1e-9);
    if (bound * bound <= *most) return;
    bw_bvh_closest(w->tree, BW_NONE, p, bound * bound, &hit);
    if (hit.item == BW_NONE) return;
    *most = fmax(*most, hit.squared);
    *last_distance = sqrt(hit.squared);
    memcpy(last, p, 3 * sizeof *last);
}

static bw_status sample_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    one_sided *w = user;
    double most = 0, last[3] = {0}, last_distance = INFINITY;
    for (size_t i = begin; i < end; i++) {
        const int32_t *t = w->item[i];
        if (i % 256 == 0 && bw_poll(ctx)) break;
        if (w->skip && w->skip[i]) continue;
        for (int a = 0; a <= SAMPLES; a++)
            for (int b = 0; b <= (t[1] == t[2] ? 0 : SAMPLES - a); b++) {
                double p[3], u = (double)a / SAMPLES, v = (double)b / SAMPLES;
                for (int k = 0; k < 3; k++)
                    p[k] = (1 - u - v) * w->point[t[0]][k] + u * w->point[t[1]][k] + v * w->point[t[2]][k];
                take_sample(w, p, last, &last_distance, &most);
            }
    }
    w->most[range] = most;
    return ctx->error.status;
}

static bw_status farthest(bw_context *ctx, one_sided *w, size_t count, double *out) {
    int ranges = bw_parallel_ranges(ctx, count, LEAST);
    if (bw_parallel(ctx, count, ranges, sample_range, w)) return ctx->error.status;
    for (int i = 0; i < ranges; i++) *out = fmax(*out, sqrt(w->most[i]));
    return BW_OK;
}

/* ---- surfaces --------------------------------------------------------------------------------------------------- */

typedef struct {
    double (*point)[3];
    int32_t (*triangle)[3];
    int32_t *group;
    size_t point_count, count;
    bw_bvh tree;
} soup;

static void soup_clear(bw_context *ctx, soup *s) {
    bw_bvh_clear(ctx, &s->tree);
    bw_free(ctx, s->point), bw_free(ctx, s->triangle), bw_free(ctx, s->group);
}

/* Boundary quads as four triangles around their centres; points are the mesh's vertices and the centres. */
static bw_status triangulate(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, soup *s) {
    *s = (soup){.point_count = mesh->vertex_count + skin->quad_count, .count = 4 * skin->quad_count};
    s->point = bw_alloc(ctx, s->point_count, sizeof *s->point);
    s->triangle = bw_alloc(ctx, s->count, sizeof *s->triangle);
    s->group = bw_alloc(ctx, s->count, sizeof *s->group);
    if (!s->point || !s->triangle || !s->group) return ctx->error.status;
    memcpy(s->point, mesh->position, mesh->vertex_count * sizeof *s->point);
    for (size_t q = 0; q < skin->quad_count; q++)
        for (int i = 0; i < 4; i++) {
            int32_t *t = s->triangle[4 * q + (size_t)i];
            t[0] = (int32_t)(mesh->vertex_count + q);
            for (int j = 0; j < 2; j++) t[1 + j] = bw_hex_quad_vertex(mesh, &skin->quad[q], (i + j) % 4);
            for (int k = 0; k < 3; k++) s->point[t[0]][k] += mesh->position[t[1]][k] / 4;
        }
    return bw_bvh_build(ctx, (const double(*)[3])s->point, (const int32_t(*)[3])s->triangle, s->count, s->group, 1, &s->tree);
}

/* Inner feature facets have no counterpart on the hex mesh's boundary. */
static uint8_t *inner_triangles(bw_context *ctx, const bw_hex_surface *surface) {
    uint8_t *inner = bw_alloc(ctx, surface->triangle_count, sizeof *inner);
    for (size_t i = 0; inner && i < surface->triangle_count; i++) inner[i] = !surface->boundary[i];
    return inner;
}

static bw_status measure_surfaces(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_surface *surface,
                                  bw_hex_distance *d) {
    soup s;
    uint8_t *inner = inner_triangles(ctx, surface);
    if (!triangulate(ctx, mesh, skin, &s) && inner) {
        one_sided to = {(const double(*)[3])s.point, (const int32_t(*)[3])s.triangle, NULL, &surface->triangles, {0}};
        one_sided from = {(const double(*)[3])surface->mesh->position, (const int32_t(*)[3])surface->triangle, inner, &s.tree, {0}};
        if (!farthest(ctx, &to, s.count, &d->to_input)) farthest(ctx, &from, surface->triangle_count, &d->from_input);
    }
    soup_clear(ctx, &s), bw_free(ctx, inner);
    return ctx->error.status;
}

/* ---- curves ----------------------------------------------------------------------------------------------------- */

/* Whether an edge of the hex mesh may run along a curve: its ends are on one curve, or at points. */
static bool may_follow(const bw_hex_mesh *mesh, const bw_hex_surface *surface, const bw_hex_edge *edge) {
    bw_hex_surface_hold hold[2];
    for (int i = 0; i < 2; i++) {
        bw_hvertex v = edge->vertex[i];
        hold[i] = bw_hex_surface_holds(surface, mesh->held[v], mesh->carrier[v], mesh->position[v]);
        if (hold[i].held > BW_HELD_CURVE) return false;
    }
    return hold[0].on == BW_NONE || hold[1].on == BW_NONE || hold[1].on == hold[0].on;
}

static bw_status measure_curves(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_surface *surface,
                                bw_hex_distance *d) {
    soup s = {.tree = {.top = BW_NONE}};
    s.triangle = bw_alloc(ctx, skin->edge_count, sizeof *s.triangle);
    s.group = bw_alloc(ctx, skin->edge_count, sizeof *s.group);
    uint8_t *regular = bw_alloc(ctx, skin->edge_count, sizeof *regular); /* may also cut across from one place of a curve to another */
    for (size_t e = 0; s.triangle && s.group && regular && e < skin->edge_count; e++) {
        const bw_hex_edge *edge = &skin->edge[e];
        if (!may_follow(mesh, surface, edge)) continue;
        s.triangle[s.count][0] = edge->vertex[0], s.triangle[s.count][1] = s.triangle[s.count][2] = edge->vertex[1];
        regular[s.count++] = edge->valence == (edge->boundary ? 2 : 4) || !edge->boundary;
    }
    const double(*point)[3] = (const double(*)[3])mesh->position;
    const int32_t(*item)[3] = (const int32_t(*)[3])s.triangle;
    if (ctx->error.status == BW_OK && !bw_bvh_build(ctx, point, item, s.count, s.group, 1, &s.tree)) {
        one_sided to = {point, item, regular, &surface->segments, {0}};
        one_sided from = {(const double(*)[3])surface->mesh->position, (const int32_t(*)[3])surface->segment, NULL, &s.tree, {0}};
        if (!farthest(ctx, &to, s.count, &d->curves)) farthest(ctx, &from, surface->segment_count, &d->curves);
    }
    soup_clear(ctx, &s), bw_free(ctx, regular);
    return ctx->error.status;
}

static double diagonal_of(const bw_hex_surface *s) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, sum = 0;
    for (size_t t = 0; t < s->triangle_count; t++)
        for (int i = 0; i < 9; i++) {
            double x = s->mesh->position[s->triangle[t][i / 3]][i % 3];
            low[i % 3] = fmin(low[i % 3], x), high[i % 3] = fmax(high[i % 3], x);
        }
    for (int k = 0; k < 3 && s->triangle_count; k++) sum += (high[k] - low[k]) * (high[k] - low[k]);
    return sqrt(sum);
}

bw_status bw_hex_measure_distance(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_hex_distance *distance) {
    bw_hex_skin skin;
    *distance = (bw_hex_distance){.diagonal = diagonal_of(surface), .input_volume = bw_hex_surface_volume(surface)};
    if (bw_hex_skin_init_all(ctx, mesh, &skin) == BW_OK && !measure_surfaces(ctx, mesh, &skin, surface, distance))
        measure_curves(ctx, mesh, &skin, surface, distance);
    bw_hex_skin_clear(ctx, &skin);
    return ctx->error.status;
}
