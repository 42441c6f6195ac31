/* Exact sample maps in which chosen vertices are moved in parameter space, in all charts alike. */
#ifndef BW_TESTS_FOLD_KIT_H
#define BW_TESTS_FOLD_KIT_H

#include "core/sanitize_kit.h"

/* What a vertex is on or beside; a vertex may be several of these. */
enum {
    FOLD_BOUNDARY = 1,
    FOLD_SINGULAR = 2,      /* on a singular edge */
    FOLD_NEAR_SINGULAR = 4, /* not on one, but joined by an edge to one that is */
    FOLD_SEAM = 8,          /* a transition at it turns */
    FOLD_FEATURE = 16       /* on a feature edge */
};

typedef struct {
    bw_context ctx;
    bw_model model;
    sanitized clean; /* its map is exact; parameters are multiples of 2^-exponent */
    uint8_t *kind;   /* [vertex] */
    size_t *first;
    int32_t *corner; /* 4 * tet + corner, of every vertex */
} folder;

static inline const bw_tet_mesh *fold_mesh(const folder *f) {
    return &f->clean.mesh;
}

static inline void fold_mark(folder *f) {
    const bw_tet_mesh *m = fold_mesh(f);
    for (size_t e = 0; e < m->edge_count; e++) {
        int flags = f->clean.map.edge_flags[e];
        for (int i = 0; i < 2; i++)
            f->kind[m->edge[e][i]] |= (uint8_t)((flags & BW_EDGE_BOUNDARY ? FOLD_BOUNDARY : 0) |
                                                (flags & BW_EDGE_SINGULAR ? FOLD_SINGULAR : 0) |
                                                (flags & BW_EDGE_FEATURE ? FOLD_FEATURE : 0));
    }
    for (size_t e = 0; e < m->edge_count; e++)
        for (int i = 0; i < 2; i++)
            if (f->kind[m->edge[e][!i]] & FOLD_SINGULAR && !(f->kind[m->edge[e][i]] & FOLD_SINGULAR))
                f->kind[m->edge[e][i]] |= FOLD_NEAR_SINGULAR;
    for (size_t t = 0; t < m->facet_count; t++)
        for (int i = 0; i < 3 && m->facet_tet[t][1] != BW_NONE; i++)
            if (bw_grid_map_rotation(&f->clean.map, (bw_facet)t)) f->kind[m->facet[t][i]] |= FOLD_SEAM;
}

/* The exact map that sanitization makes of a model. Takes the model over. */
static inline void fold_start(folder *f, bw_model model, double tolerance) {
    *f = (folder){.model = model};
    bw_context_init(&f->ctx);
    sanitize_model(&f->clean, &f->model, tolerance);
    kit_expect_ok(&f->clean.ctx, f->clean.status);
    const bw_tet_mesh *m = fold_mesh(f);
    f->kind = bw_alloc(&f->ctx, m->vertex_count, 1);
    f->first = bw_alloc(&f->ctx, m->vertex_count + 2, sizeof *f->first);
    f->corner = bw_alloc(&f->ctx, 4 * m->tet_count, sizeof *f->corner);
    for (size_t i = 0; i < 4 * m->tet_count; i++) f->first[m->tet[i / 4][i % 4] + 2]++;
    for (size_t v = 0; v < m->vertex_count; v++) f->first[v + 2] += f->first[v + 1];
    for (size_t i = 0; i < 4 * m->tet_count; i++)
        f->corner[f->first[m->tet[i / 4][i % 4] + 1]++] = (int32_t)i;
    fold_mark(f);
}

static inline void fold_end(folder *f) {
    bw_free(&f->ctx, f->kind);
    bw_free(&f->ctx, f->first);
    bw_free(&f->ctx, f->corner);
    drop_sanitized(&f->clean);
    drop_model(&f->model);
    assert_int_equal(f->ctx.memory.used, 0);
}

/* The turn from the chart of the vertex's first tet to that of each of its tets, by walking across facets;
 * and the axes of that chart along which it can move without changing a transition, an alignment or a
 * feature. */
enum { FOLD_STAR = 512 };
typedef struct {
    size_t count;
    int32_t corner[FOLD_STAR];
    bw_rotation turn[FOLD_STAR];
    int free;
} fold_star;

static inline void fold_hold_edges(const folder *f, bw_vertex v, fold_star *s) {
    const bw_tet_mesh *m = fold_mesh(f);
    for (size_t i = 0; i < s->count; i++)
        for (int c = 0; c < 4; c++) {
            bw_tet t = s->corner[i] / 4;
            if (c == s->corner[i] % 4) continue;
            if (!(f->clean.map.edge_flags[m->tet_edge[t][bw_tet_edge_of[c][s->corner[i] % 4]]] &
                  (BW_EDGE_FEATURE | BW_EDGE_SINGULAR)))
                continue;
            for (int k = 0; k < 3; k++)
                if (f->clean.map.value[t][c][k] == f->clean.map.value[t][s->corner[i] % 4][k])
                    s->free &= ~(1 << bw_rotation_axis[s->turn[i]][k]);
        }
    for (size_t i = 0; i < m->feature_vertex_count; i++)
        if (m->feature_vertex[i] == v) s->free = 0;
}

static inline void fold_read(const folder *f, bw_vertex v, fold_star *s) {
    const bw_tet_mesh *m = fold_mesh(f);
    bool reached[FOLD_STAR] = {true};
    size_t queue[FOLD_STAR], tail = 1, head = 0;
    s->count = f->first[v + 1] - f->first[v];
    assert_in_range(s->count, 1, FOLD_STAR);
    memcpy(s->corner, f->corner + f->first[v], s->count * sizeof *s->corner);
    s->turn[0] = 0, s->free = 7, queue[0] = 0;
    for (; head < tail; head++) {
        size_t at = queue[head];
        bw_tet t = s->corner[at] / 4;
        for (int i = 0; i < 4; i++) {
            bw_facet facet = m->tet_facet[t][i];
            bw_tet next = bw_tet_across(m, facet, t);
            if (i == s->corner[at] % 4) continue;
            if (next == BW_NONE) {
                s->free &= ~(1 << bw_rotation_axis[s->turn[at]][f->clean.map.align[facet]]);
                continue;
            }
            bw_transition over = bw_grid_map_across(m, &f->clean.map, facet, t);
            bw_rotation turn = bw_rotation_compose(over.rotation, s->turn[at]);
            size_t other = 0;
            while (s->corner[other] / 4 != next) other++;
            if (!reached[other]) reached[other] = true, s->turn[other] = turn, queue[tail++] = other;
            for (int k = 0; k < 3; k++) { /* the loop closes without moving the axis, or the axis is held */
                int64_t u[3] = {k == 0, k == 1, k == 2}, a[3], b[3];
                bw_rotate(turn, u, a);
                bw_rotate(s->turn[other], u, b);
                if (memcmp(a, b, sizeof a)) s->free &= ~(1 << k);
            }
        }
    }
    if (tail < s->count) s->free = 0;
    fold_hold_edges(f, v, s);
}

/* A mesh to be sanitized: the exact map as doubles. */
static inline void fold_copy(const folder *f, sanitized *to) {
    *to = (sanitized){0};
    bw_context_init(&to->ctx);
    kit_expect_ok(&to->ctx, mesh_from_model(&to->ctx, &f->model, &to->mesh));
    for (size_t i = 0; i < 12 * f->model.tet_count; i++)
        to->mesh.parameter[f->clean.mesh.tet_id[i / 12]][i % 12 / 3][i % 3] =
            ldexp((double)f->clean.map.value[i / 12][i % 12 / 3][i % 3], -f->clean.map.exponent);
    for (size_t t = 0; t < f->model.tet_count; t++) /* corners are swapped if the file lists mirrored tets */
        memcpy(to->mesh.tet[f->clean.mesh.tet_id[t]], f->clean.mesh.tet[t], sizeof *to->mesh.tet);
}

/* Moves a vertex by delta, given in the chart of its first tet, in the mesh that fold_copy made. */
static inline void fold_move(const folder *f, const fold_star *s, sanitized *to, const int64_t delta[3]) {
    for (size_t i = 0; i < s->count; i++) {
        int64_t d[3];
        bw_rotate(s->turn[i], delta, d);
        for (int k = 0; k < 3; k++)
            to->mesh.parameter[f->clean.mesh.tet_id[s->corner[i] / 4]][s->corner[i] % 4][k] +=
                ldexp((double)d[k], -f->clean.map.exponent);
    }
}

/* Extent of the vertex's first tet along each axis of its chart. */
static inline void fold_extent(const folder *f, const fold_star *s, int64_t out[3]) {
    bw_tet t = s->corner[0] / 4;
    for (int k = 0; k < 3; k++) {
        int64_t low = INT64_MAX, high = INT64_MIN;
        for (int c = 0; c < 4; c++) {
            int64_t x = f->clean.map.value[t][c][k];
            if (x < low) low = x;
            if (x > high) high = x;
        }
        out[k] = high - low;
    }
}

/* Everything that a map means is what it was: transitions, constant axes and their values, turns, singular
 * edges. */
static inline void fold_expect_same_meaning(const folder *f, const sanitized *s) {
    const bw_tet_mesh *m = fold_mesh(f);
    int shift = f->clean.map.exponent - s->map.exponent;
    assert_int_equal(s->mesh.tet_count, m->tet_count);
    assert_memory_equal(s->mesh.tet, m->tet, m->tet_count * sizeof *m->tet);
    assert_memory_equal(s->map.quarters, f->clean.map.quarters, m->edge_count * sizeof *s->map.quarters);
    assert_memory_equal(s->map.edge_flags, f->clean.map.edge_flags, m->edge_count);
    assert_memory_equal(s->map.align, f->clean.map.align, m->facet_count);
    for (size_t i = 0; i < m->feature_vertex_count; i++)
        for (size_t c = f->first[m->feature_vertex[i]]; c < f->first[m->feature_vertex[i] + 1]; c++)
            for (int k = 0; k < 3; k++)
                assert_true(ldexp((double)s->map.value[f->corner[c] / 4][f->corner[c] % 4][k], shift) ==
                            (double)f->clean.map.value[f->corner[c] / 4][f->corner[c] % 4][k]);
    for (size_t t = 0; t < m->facet_count; t++) {
        bw_tet tet = m->facet_tet[t][0];
        int on = bw_tet_corner(m, tet, m->facet[t][0]), axis = s->map.align[t];
        if (m->facet_tet[t][1] == BW_NONE) {
            assert_true(ldexp((double)s->map.value[tet][on][axis], shift) ==
                        (double)f->clean.map.value[tet][on][axis]);
            continue;
        }
        bw_transition a = bw_grid_map_across(m, &s->map, (bw_facet)t, tet),
                      b = bw_grid_map_across(m, &f->clean.map, (bw_facet)t, tet);
        assert_int_equal(a.rotation, b.rotation);
        for (int k = 0; k < 3; k++) assert_true(ldexp((double)a.shift[k], shift) == (double)b.shift[k]);
    }
}

/* A random vertex that is all of `is` and none of `not` and can move; false if there is none. */
static inline bool fold_pick(const folder *f, kit_random *random, int is, int not, bw_vertex *v,
                             fold_star *star) {
    for (int i = 0; i < 2000; i++) {
        *v = (bw_vertex)kit_random_below(random, fold_mesh(f)->vertex_count);
        if ((f->kind[*v] & is) != is || f->kind[*v] & not || f->first[*v] == f->first[*v + 1]) continue;
        fold_read(f, *v, star);
        if (star->free) return true;
    }
    return false;
}

/* Moves the vertex past its neighbours, by `reach` times the extent of a tet. */
static inline void fold_past(const folder *f, kit_random *random, const fold_star *star, double reach,
                             sanitized *s) {
    int64_t extent[3], delta[3];
    fold_extent(f, star, extent);
    for (int k = 0; k < 3; k++) {
        double far = reach * kit_random_range(random, 0.8, 1.2) * (kit_random_below(random, 2) ? 1 : -1);
        delta[k] = star->free & 1 << k ? llrint(far * (double)extent[k]) : 0;
    }
    fold_move(f, star, s, delta);
}

/* ---- runs and what they say ---- */

static inline void repair_mesh(sanitized *s, double tolerance) {
    bw_sanitize_options options = {.tolerance = tolerance, .repair = true};
    s->status = bw_sanitize(&s->ctx, &options, &s->mesh, &s->map, &s->report);
}

/* What a refusal has to say: the code, and where. */
static inline void expect_refused(const sanitized *s) {
    const bw_error *e = &s->ctx.error;
    kit_expect_status(&s->ctx, s->status, BW_E_INVERTED);
    assert_true(e->region_count >= 1 && e->element_count >= 1);
    size_t tets = 0;
    for (size_t r = 0; r < e->region_count && r < BW_REGIONS_KEPT; r++) {
        const bw_region *region = &e->regions[r];
        assert_true(region->tet_count >= 1);
        tets += region->tet_count;
        for (int k = 0; k < 3; k++)
            assert_true(region->low[k] <= region->centre[k] && region->centre[k] <= region->high[k]);
        for (size_t i = 0; i < region->tet_count && i < BW_REGION_TETS; i++)
            assert_in_range(region->tets[i], 0, s->mesh.tet_count - 1);
    }
    if (e->region_count <= BW_REGIONS_KEPT) assert_int_equal(tets, e->element_count);
}

/* ---- collapsed regions ---- */

/* Puts all vertices of a cuboid that lie within `radius` of a point, and are `kinds` of them, onto that
 * point. The charts are one. */
static inline void collapse(sanitized *s, const double at[3], double radius, bool boundary) {
    const double(*position)[3] = (const double(*)[3])s->mesh.position;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY},
           sum[3] = {0, 0, 0};
    size_t count = 0;
    for (size_t v = 0; v < s->mesh.vertex_count; v++)
        for (int k = 0; k < 3; k++)
            low[k] = fmin(low[k], position[v][k]), high[k] = fmax(high[k], position[v][k]);
    for (int pass = 0; pass < 2; pass++)
        for (size_t i = 0; i < 4 * s->mesh.tet_count; i++) {
            const double *p = position[s->mesh.tet[i / 4][i % 4]];
            double *u = s->mesh.parameter[i / 4][i % 4], far = 0;
            bool inside = true;
            for (int k = 0; k < 3; k++) {
                far += (p[k] - at[k]) * (p[k] - at[k]);
                inside = inside && p[k] > low[k] + 1e-9 && p[k] < high[k] - 1e-9;
            }
            if (far > radius * radius || !(inside || boundary)) continue;
            count += !pass;
            for (int k = 0; k < 3; k++) {
                if (pass)
                    u[k] = sum[k] / (double)count;
                else
                    sum[k] += u[k];
            }
        }
    assert_true(count > 0);
}

static inline void start_cuboid(sanitized *s, int size, double noise, double middle[3], double *extent) {
    bw_model_options o = model_options(size, noise, 0, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model("cuboid", &o);
    *s = (sanitized){0};
    bw_context_init(&s->ctx);
    kit_expect_ok(&s->ctx, mesh_from_model(&s->ctx, &model, &s->mesh));
    double high[3] = {-INFINITY, -INFINITY, -INFINITY}, low[3] = {INFINITY, INFINITY, INFINITY};
    for (size_t v = 0; v < model.vertex_count; v++)
        for (int k = 0; k < 3; k++)
            high[k] = fmax(high[k], model.position[v][k]), low[k] = fmin(low[k], model.position[v][k]);
    *extent = 0;
    for (int k = 0; k < 3; k++)
        middle[k] = 0.5 * (low[k] + high[k]), *extent = fmax(*extent, high[k] - low[k]);
    drop_model(&model);
}

#endif
