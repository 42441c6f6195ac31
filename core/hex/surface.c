#include "hex/surface.h"

#include <math.h>
#include <string.h>

#include "base/forest.h"

static const double sharp_curve = 30, sharp_point = 45; /* degrees */

enum { CANDIDATE = 1, FEATURE = 2, KEPT = 4 };

typedef struct {
    bw_hex_surface *surface;
    const uint8_t *edge_flags;
    uint8_t *mark;          /* [edge] CANDIDATE: a curve may run here; FEATURE: it does in any case; KEPT: it does */
    uint8_t *triangles_at;  /* [edge] how many, up to 3 */
    int32_t (*both)[2];     /* [edge] its first two triangles */
    int32_t *degree;        /* [vertex] of marked edges */
    int32_t (*near)[2];     /* [vertex] its first two marked edges */
    int32_t *parent;        /* of a union-find over edges or triangles */
    double *turn, *length;  /* [edge] sums of the chain it represents */
} builder;

static void subtract(const double a[3], const double b[3], double out[3]) {
    for (int k = 0; k < 3; k++) out[k] = a[k] - b[k];
}
static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static void cross(const double a[3], const double b[3], double out[3]) {
    for (int k = 0; k < 3; k++) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}
static double angle(const double a[3], const double b[3]) { /* degrees */
    double c[3];
    cross(a, b, c);
    return atan2(sqrt(dot(c, c)), dot(a, b)) * 57.29577951308232;
}
static void normal_of(const bw_hex_surface *s, int32_t triangle, double out[3]) {
    const double(*p)[3] = (const double(*)[3])s->mesh->position;
    const int32_t *t = s->triangle[triangle];
    double u[3], v[3];
    subtract(p[t[1]], p[t[0]], u), subtract(p[t[2]], p[t[0]], v);
    cross(u, v, out);
}

/* ---- triangles -------------------------------------------------------------------------------------------------- */

static void add_triangle(bw_hex_surface *s, bw_facet facet, bool boundary) {
    const bw_tet_mesh *m = s->mesh;
    int32_t *t = s->triangle[s->triangle_count];
    bw_tet tet = m->facet_tet[facet][0];
    memcpy(t, m->facet[facet], 3 * sizeof *t);
    double n[3], inside[3] = {0};
    s->boundary[s->triangle_count] = boundary;
    normal_of(s, (int32_t)s->triangle_count, n);
    for (int i = 0; i < 4; i++)
        if (m->tet_facet[tet][i] == facet) /* facet i is opposite corner i */
            subtract(m->position[m->tet[tet][i]], m->position[t[0]], inside);
    if (dot(n, inside) > 0) {
        int32_t swap = t[1];
        t[1] = t[2], t[2] = swap;
    }
    s->facet_triangle[facet] = (int32_t)s->triangle_count++;
}

static void find_triangles(bw_hex_surface *s) {
    const bw_tet_mesh *m = s->mesh;
    for (size_t f = 0; f < m->facet_count; f++) s->facet_triangle[f] = BW_NONE;
    for (size_t i = 0; i < m->feature_facet_count; i++) {
        bw_facet f = bw_tet_mesh_find_facet(m, m->feature_facet[i]);
        if (f != BW_NONE && m->facet_tet[f][1] != BW_NONE) s->facet_triangle[f] = 0;
    }
    for (size_t f = 0; f < m->facet_count; f++) {
        bool boundary = m->facet_tet[f][1] == BW_NONE;
        if (boundary || s->facet_triangle[f] == 0) add_triangle(s, (bw_facet)f, boundary);
    }
}

static void find_edges_of_triangles(builder *b) {
    bw_hex_surface *s = b->surface;
    for (size_t e = 0; e < s->mesh->edge_count; e++) s->edge_triangle[e] = s->edge_segment[e] = BW_NONE;
    for (size_t v = 0; v < s->mesh->vertex_count; v++) s->vertex_triangle[v] = s->vertex_segment[v] = BW_NONE;
    for (size_t t = 0; t < s->triangle_count; t++)
        for (int i = 0; i < 3; i++) {
            bw_vertex ends[2] = {s->triangle[t][i], s->triangle[t][(i + 1) % 3]};
            bw_edge e = bw_tet_mesh_find_edge(s->mesh, ends);
            if (b->triangles_at[e] < 2) b->both[e][b->triangles_at[e]] = (int32_t)t;
            if (b->triangles_at[e] < 3) b->triangles_at[e]++;
            if (s->edge_triangle[e] == BW_NONE) s->edge_triangle[e] = (int32_t)t;
            if (s->vertex_triangle[ends[0]] == BW_NONE) s->vertex_triangle[ends[0]] = (int32_t)t;
        }
}

/* ---- curves ----------------------------------------------------------------------------------------------------- */

static void mark_candidates(builder *b) {
    for (size_t e = 0; e < b->surface->mesh->edge_count; e++) {
        uint8_t flags = b->edge_flags[e];
        bool junction = b->triangles_at[e] == 1 || b->triangles_at[e] == 3;
        if ((flags & BW_EDGE_FEATURE) || junction)
            b->mark[e] = CANDIDATE | FEATURE;
        else if ((flags & BW_EDGE_SINGULAR) && (flags & BW_EDGE_BOUNDARY) && b->triangles_at[e] == 2)
            b->mark[e] = CANDIDATE;
    }
}

/* Degree of each vertex in the graph of edges that have any of `marks`. */
static void count_degrees(builder *b, uint8_t marks) {
    const bw_tet_mesh *m = b->surface->mesh;
    memset(b->degree, 0, m->vertex_count * sizeof *b->degree);
    for (size_t e = 0; e < m->edge_count; e++)
        for (int i = 0; i < 2 && (b->mark[e] & marks); i++) {
            bw_vertex v = m->edge[e][i];
            if (b->degree[v] < 2) b->near[v][b->degree[v]] = (int32_t)e;
            b->degree[v]++;
        }
}

/* Unites the edges of each chain of the graph: those at a vertex that `stop` (may be NULL) lets pass. */
static void unite_chains(builder *b, const uint8_t *stop) {
    const bw_tet_mesh *m = b->surface->mesh;
    for (size_t e = 0; e < m->edge_count; e++) b->parent[e] = (int32_t)e;
    for (size_t v = 0; v < m->vertex_count; v++)
        if (b->degree[v] == 2 && !(stop && stop[v])) bw_forest_join(b->parent, b->near[v][0], b->near[v][1]);
}

/* Keeps the chains of candidates that are features or sharp. */
static void keep_sharp(builder *b) {
    bw_hex_surface *s = b->surface;
    const bw_tet_mesh *m = s->mesh;
    count_degrees(b, CANDIDATE);
    unite_chains(b, NULL);
    for (size_t e = 0; e < m->edge_count; e++) {
        if (b->mark[e] != CANDIDATE) continue;
        double along[3], n[2][3];
        int32_t chain = bw_forest_root(b->parent, (int32_t)e);
        subtract(m->position[m->edge[e][1]], m->position[m->edge[e][0]], along);
        for (int i = 0; i < 2; i++) normal_of(s, b->both[e][i], n[i]);
        double length = sqrt(dot(along, along));
        b->turn[chain] += length * angle(n[0], n[1]), b->length[chain] += length;
    }
    for (size_t e = 0; e < m->edge_count; e++) {
        if (!b->mark[e]) continue;
        int32_t chain = bw_forest_root(b->parent, (int32_t)e);
        if ((b->mark[e] & FEATURE) || b->turn[chain] > sharp_curve * b->length[chain])
            b->mark[e] |= KEPT;
        else
            s->flat_curves += chain == (int32_t)e;
    }
}

static void find_points(builder *b) {
    bw_hex_surface *s = b->surface;
    const bw_tet_mesh *m = s->mesh;
    for (size_t i = 0; i < m->feature_vertex_count; i++) s->point[m->feature_vertex[i]] = 1;
    for (size_t v = 0; v < m->vertex_count; v++) {
        double way[2][3];
        if (b->degree[v] == 0 || s->point[v]) continue;
        for (int i = 0; i < 2 && b->degree[v] == 2; i++) {
            const bw_vertex *ends = m->edge[b->near[v][i]];
            bw_vertex other = ends[ends[0] == (bw_vertex)v];
            subtract(m->position[other], m->position[v], way[i]);
        }
        s->point[v] = b->degree[v] != 2 || angle(way[0], way[1]) < 180 - sharp_point;
    }
}

static void number_curves(builder *b) {
    bw_hex_surface *s = b->surface;
    const bw_tet_mesh *m = s->mesh;
    count_degrees(b, KEPT);
    find_points(b);
    unite_chains(b, s->point);
    for (size_t e = 0; e < m->edge_count; e++) {
        if (!(b->mark[e] & KEPT)) continue;
        int32_t chain = bw_forest_root(b->parent, (int32_t)e), at = (int32_t)s->segment_count++;
        s->edge_segment[e] = at;
        s->segment[at][0] = m->edge[e][0], s->segment[at][1] = s->segment[at][2] = m->edge[e][1];
        /* the lowest edge represents its chain, so the chain has a number already if this is not it */
        s->curve[at] = chain == (int32_t)e ? (int32_t)s->curve_count++ : s->curve[s->edge_segment[chain]];
        for (int i = 0; i < 2; i++)
            if (s->vertex_segment[m->edge[e][i]] == BW_NONE) s->vertex_segment[m->edge[e][i]] = at;
    }
}

static void number_regions(builder *b) {
    bw_hex_surface *s = b->surface;
    for (size_t t = 0; t < s->triangle_count; t++) b->parent[t] = (int32_t)t;
    for (size_t e = 0; e < s->mesh->edge_count; e++)
        if (b->triangles_at[e] == 2 && !(b->mark[e] & KEPT)) bw_forest_join(b->parent, b->both[e][0], b->both[e][1]);
    for (size_t t = 0; t < s->triangle_count; t++) {
        int32_t first = bw_forest_root(b->parent, (int32_t)t);
        s->region[t] = first == (int32_t)t ? (int32_t)s->region_count++ : s->region[first];
    }
}

/* ---- build ------------------------------------------------------------------------------------------------------ */

static bool take_arrays(bw_context *ctx, builder *b) {
    bw_hex_surface *s = b->surface;
    size_t v = s->mesh->vertex_count, e = s->mesh->edge_count, f = s->mesh->facet_count;
    size_t t = s->triangle_count; /* upper bound: facets that may be triangles */
    return (s->triangle = bw_alloc(ctx, t, sizeof *s->triangle)) && (s->region = bw_alloc(ctx, t, sizeof *s->region)) &&
           (s->boundary = bw_alloc(ctx, t, sizeof *s->boundary)) && (s->facet_triangle = bw_alloc(ctx, f, sizeof *s->facet_triangle)) &&
           (s->edge_segment = bw_alloc(ctx, e, sizeof *s->edge_segment)) &&
           (s->edge_triangle = bw_alloc(ctx, e, sizeof *s->edge_triangle)) &&
           (s->vertex_triangle = bw_alloc(ctx, v, sizeof *s->vertex_triangle)) &&
           (s->vertex_segment = bw_alloc(ctx, v, sizeof *s->vertex_segment)) && (s->point = bw_alloc(ctx, v, sizeof *s->point)) &&
           (b->mark = bw_alloc(ctx, e, sizeof *b->mark)) && (b->triangles_at = bw_alloc(ctx, e, sizeof *b->triangles_at)) &&
           (b->both = bw_alloc(ctx, e, sizeof *b->both)) && (b->degree = bw_alloc(ctx, v, sizeof *b->degree)) &&
           (b->near = bw_alloc(ctx, v, sizeof *b->near)) && (b->parent = bw_alloc(ctx, e > t ? e : t, sizeof *b->parent)) &&
           (b->turn = bw_alloc(ctx, e, sizeof *b->turn)) && (b->length = bw_alloc(ctx, e, sizeof *b->length));
}

static bw_status build(bw_context *ctx, builder *b) {
    bw_hex_surface *s = b->surface;
    size_t kept = 0;
    if (!take_arrays(ctx, b)) return ctx->error.status;
    s->triangle_count = 0;
    find_triangles(s);
    find_edges_of_triangles(b);
    mark_candidates(b);
    keep_sharp(b);
    for (size_t e = 0; e < s->mesh->edge_count; e++) kept += (b->mark[e] & KEPT) != 0;
    s->segment = bw_alloc(ctx, kept, sizeof *s->segment);
    s->curve = bw_alloc(ctx, kept, sizeof *s->curve);
    if (!s->segment || !s->curve) return ctx->error.status;
    number_curves(b);
    number_regions(b);
    const double(*p)[3] = (const double(*)[3])s->mesh->position;
    if (bw_bvh_build(ctx, p, (const int32_t(*)[3])s->triangle, s->triangle_count, s->region, s->region_count, &s->triangles))
        return ctx->error.status;
    return bw_bvh_build(ctx, p, (const int32_t(*)[3])s->segment, s->segment_count, s->curve, s->curve_count, &s->segments);
}

bw_status bw_hex_surface_build(bw_context *ctx, const bw_tet_mesh *mesh, const uint8_t *edge_flags, bw_hex_surface *surface) {
    *surface = (bw_hex_surface){.mesh = mesh};
    builder b = {.surface = surface, .edge_flags = edge_flags};
    for (size_t f = 0; f < mesh->facet_count; f++) surface->triangle_count += mesh->facet_tet[f][1] == BW_NONE;
    surface->triangle_count += mesh->feature_facet_count;
    bw_status status = build(ctx, &b);
    bw_free(ctx, b.mark), bw_free(ctx, b.triangles_at), bw_free(ctx, b.both), bw_free(ctx, b.degree), bw_free(ctx, b.near);
    bw_free(ctx, b.parent), bw_free(ctx, b.turn), bw_free(ctx, b.length);
    if (status) bw_hex_surface_clear(ctx, surface);
    return status;
}

void bw_hex_surface_clear(bw_context *ctx, bw_hex_surface *s) {
    bw_bvh_clear(ctx, &s->triangles), bw_bvh_clear(ctx, &s->segments);
    bw_free(ctx, s->triangle), bw_free(ctx, s->region), bw_free(ctx, s->boundary), bw_free(ctx, s->segment), bw_free(ctx, s->curve);
    bw_free(ctx, s->facet_triangle), bw_free(ctx, s->edge_segment), bw_free(ctx, s->edge_triangle);
    bw_free(ctx, s->vertex_triangle), bw_free(ctx, s->vertex_segment), bw_free(ctx, s->point);
    *s = (bw_hex_surface){0};
}

/* ---- queries ---------------------------------------------------------------------------------------------------- */

/* Whether p is an end of the edge, but for rounding, and that is a point. */
static bool at_point(const bw_hex_surface *s, bw_edge edge, const double p[3]) {
    const bw_vertex *end = s->mesh->edge[edge];
    double way[3], along[3];
    subtract(s->mesh->position[end[1]], s->mesh->position[end[0]], along);
    for (int i = 0; i < 2; i++) {
        subtract(s->mesh->position[end[i]], p, way);
        if (s->point[end[i]] && dot(way, way) <= 1e-18 * dot(along, along)) return true;
    }
    return false;
}

bw_hex_surface_hold bw_hex_surface_holds(const bw_hex_surface *s, uint8_t held, int32_t carrier, const double p[3]) {
    int32_t triangle = BW_NONE, segment = BW_NONE;
    if (held == BW_HELD_POINT) {
        if (s->point[carrier]) return (bw_hex_surface_hold){BW_HELD_POINT, BW_NONE};
        segment = s->vertex_segment[carrier], triangle = s->vertex_triangle[carrier];
    } else if (held == BW_HELD_CURVE) {
        if (at_point(s, carrier, p)) return (bw_hex_surface_hold){BW_HELD_POINT, BW_NONE};
        segment = s->edge_segment[carrier], triangle = s->edge_triangle[carrier];
    } else if (held == BW_HELD_SURFACE) {
        triangle = s->facet_triangle[carrier];
    }
    if (segment != BW_NONE) return (bw_hex_surface_hold){BW_HELD_CURVE, s->curve[segment]};
    if (triangle != BW_NONE) return (bw_hex_surface_hold){BW_HELD_SURFACE, s->region[triangle]};
    return (bw_hex_surface_hold){BW_HELD_NOT, BW_NONE};
}

static bool unit(double v[3]) {
    double length = sqrt(dot(v, v));
    for (int k = 0; k < 3 && length > 0; k++) v[k] /= length;
    return length > 0;
}

/* Two directions that span the plane across n. */
static void span_plane(const double n[3], double direction[3][3]) {
    double axis[3] = {0};
    int least = 0;
    for (int k = 1; k < 3; k++)
        if (fabs(n[k]) < fabs(n[least])) least = k;
    axis[least] = 1;
    cross(n, axis, direction[0]);
    unit(direction[0]);
    cross(n, direction[0], direction[1]);
}

int bw_hex_surface_project(const bw_hex_surface *s, bw_hex_surface_hold hold, double p[3], double direction[3][3]) {
    bw_bvh_hit hit;
    double n[3];
    if (hold.held == BW_HELD_POINT) return 0;
    if (hold.held == BW_HELD_NOT) {
        for (int i = 0; i < 9; i++) direction[i / 3][i % 3] = i % 4 == 0;
        return 3;
    }
    bool curve = hold.held == BW_HELD_CURVE;
    bw_bvh_closest(curve ? &s->segments : &s->triangles, hold.on, p, INFINITY, &hit);
    if (hit.item == BW_NONE) return 0; /* p is not a number */
    memcpy(p, hit.point, sizeof hit.point);
    if (curve) {
        const int32_t *ends = s->segment[hit.item];
        subtract(s->mesh->position[ends[1]], s->mesh->position[ends[0]], direction[0]);
        return unit(direction[0]);
    }
    normal_of(s, hit.item, n);
    if (!unit(n)) return 0;
    span_plane(n, direction);
    return 2;
}

double bw_hex_surface_volume(const bw_hex_surface *s) {
    double sum = 0, n[3], from[3];
    if (!s->triangle_count) return 0;
    const double *origin = s->mesh->position[s->triangle[0][0]];
    for (size_t t = 0; t < s->triangle_count; t++) {
        if (!s->boundary[t]) continue;
        normal_of(s, (int32_t)t, n);
        subtract(s->mesh->position[s->triangle[t][0]], origin, from);
        sum += dot(n, from) / 6;
    }
    return sum;
}
