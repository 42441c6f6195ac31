/* Exact coordinates of cell complex vertices.
 *
 * A vertex in a tet edge is stored as a ratio along the edge and compared in 128-bit integers. A vertex in a facet has two integer
 * coordinates (the planes that made it); its third is the solution of the facet's plane equation, and is stored as its floor
 * and whether there is a fraction, found once: in extended precision with an error bound, by GMP where that does not decide.
 */
#include "mesh/cells_geometry.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exact/det.h"

typedef __int128 i128;

static int sign128(i128 x) { return (x > 0) - (x < 0); }

static const int64_t *value_at(const bw_cells *cells, bw_tet tet, bw_vertex v) {
    return cells->map->value[tet][bw_tet_corner(cells->mesh, tet, v)];
}

static bw_tet home_of(const bw_cells *cells, bw_facet facet) { return cells->mesh->facet_tet[facet][0]; }

bw_plane bw_cells_plane_at_home(const bw_cells *cells, bw_facet facet, bw_tet tet, bw_plane plane, int *sign) {
    *sign = 1;
    if (tet == home_of(cells, facet)) return plane;
    bw_transition in = bw_grid_map_across(cells->mesh, cells->map, facet, tet);
    bw_plane home = bw_transition_plane(&in, plane);
    *sign = bw_rotation_sign[in.rotation][home.axis];
    return home;
}

static int compare_floor(const bw_cell_vertex *v, bw_plane plane) {
    int64_t floor = v->exact[plane.axis];
    if (floor != plane.value) return floor < plane.value ? -1 : 1;
    return v->fraction >> plane.axis & 1;
}

int bw_cells_side(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, bw_plane plane) {
    const bw_cell_vertex *v = &cells->vertex[vertex];
    int sign;
    switch ((bw_carrier)v->kind) {
    case BW_IN_VERTEX: {
        int64_t x = value_at(cells, tet, v->carrier)[plane.axis];
        return (x > plane.value) - (x < plane.value);
    }
    case BW_IN_EDGE: {
        int64_t p = value_at(cells, tet, cells->mesh->edge[v->carrier][0])[plane.axis];
        int64_t q = value_at(cells, tet, cells->mesh->edge[v->carrier][1])[plane.axis];
        return sign128((i128)(p - plane.value) * v->exact[1] + (i128)v->exact[0] * (q - p));
    }
    case BW_IN_FACET: {
        bw_plane home = bw_cells_plane_at_home(cells, v->carrier, tet, plane, &sign);
        return sign * compare_floor(v, home);
    }
    case BW_IN_TET: break;
    }
    return compare_floor(v, plane);
}

/* Normal of a facet in its home chart (exact) and one of its corners. */
static void facet_plane(const bw_cells *cells, bw_facet facet, i128 normal[3], int64_t corner[3]) {
    int64_t d[2][3];
    const bw_vertex *v = cells->mesh->facet[facet];
    memcpy(corner, value_at(cells, home_of(cells, facet), v[0]), 3 * sizeof *corner);
    for (int i = 0; i < 2; i++) {
        const int64_t *x = value_at(cells, home_of(cells, facet), v[i + 1]);
        for (int k = 0; k < 3; k++) d[i][k] = x[k] - corner[k];
    }
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        normal[k] = (i128)d[0][i] * d[1][j] - (i128)d[0][j] * d[1][i];
    }
}

static void mpz_set_128(mpz_t z, i128 x) {
    uint64_t low = (uint64_t)x, high = (uint64_t)((x < 0 ? -x : x) >> 64);
    if (x < 0) low = (uint64_t)-x;
    mpz_set_ui(z, high);
    mpz_mul_2exp(z, z, 64);
    mpz_add_ui(z, z, low);
    if (x < 0) mpz_neg(z, z);
}

/* The third coordinate of the point of a facet's plane whose coordinates at[r+1], at[r+2] (cyclic) are given: corner[r] +
 * numerator / denominator. */
static void third_exact(const i128 normal[3], const int64_t corner[3], const int64_t at[3], int r, mpz_t numerator,
                        mpz_t denominator) {
    mpz_set_ui(numerator, 0);
    for (int i = 1; i < 3; i++) {
        int k = (r + i) % 3;
        mpz_set_128(denominator, normal[k] * (at[k] < corner[k] ? 1 : -1));
        mpz_mul_ui(denominator, denominator, (unsigned long)llabs(at[k] - corner[k]));
        mpz_add(numerator, numerator, denominator);
    }
    mpz_set_128(denominator, normal[r]);
    if (mpz_sgn(denominator) < 0) mpz_neg(denominator, denominator), mpz_neg(numerator, numerator);
}

/* Floor of that coordinate; extended precision decides unless the value is too near an integer. Every operation below is
 * rounded by at most 2^-63 relative to the magnitudes in `size`. */
static int64_t third_floor(const i128 normal[3], const int64_t corner[3], const int64_t at[3], int r, bool *fraction) {
    int b = (r + 1) % 3, d = (r + 2) % 3;
    long double p = (long double)normal[b] * (long double)(at[b] - corner[b]);
    long double q = (long double)normal[d] * (long double)(at[d] - corner[d]);
    long double n = (long double)normal[r], offset = -(p + q) / n, whole = floorl(offset);
    long double error = (fabsl(p) + fabsl(q)) / fabsl(n) * 0x1p-60L;
    if (offset - whole > error && whole + 1 - offset > error && error < 0x1p-3L) {
        *fraction = true;
        return corner[r] + (int64_t)whole;
    }
    mpz_t numerator, denominator, floor, rest;
    mpz_inits(numerator, denominator, floor, rest, NULL);
    third_exact(normal, corner, at, r, numerator, denominator);
    mpz_fdiv_qr(floor, rest, numerator, denominator);
    *fraction = mpz_sgn(rest) != 0;
    int64_t result = corner[r] + mpz_get_si(floor);
    mpz_clears(numerator, denominator, floor, rest, NULL);
    return result;
}

static bw_cell_vertex cross_mesh_edge(const bw_cells *cells, bw_edge edge, bw_tet tet, bw_plane plane) {
    int64_t p = value_at(cells, tet, cells->mesh->edge[edge][0])[plane.axis];
    int64_t q = value_at(cells, tet, cells->mesh->edge[edge][1])[plane.axis];
    bw_cell_vertex v = {.kind = BW_IN_EDGE, .carrier = edge, .exact = {plane.value - p, q - p, 0}};
    if (v.exact[1] < 0) v.exact[0] = -v.exact[0], v.exact[1] = -v.exact[1];
    return v;
}

/* The value of one of an edge's iso-planes: the coordinate of its vertices. */
static int64_t value_on_edge(const bw_cells *cells, const bw_cell_edge *e, bw_tet tet, int axis) {
    bool fraction;
    return bw_cells_floor(cells, e->vertex[0], tet, axis, &fraction);
}

static bw_cell_vertex cross_in_facet(const bw_cells *cells, const bw_cell_edge *e, bw_tet tet, bw_plane plane) {
    int sign;
    bw_plane home = bw_cells_plane_at_home(cells, e->carrier, tet, plane, &sign);
    bw_cell_vertex v = {.kind = BW_IN_FACET, .carrier = e->carrier};
    int r = 3 - home.axis - e->axis;
    v.exact[home.axis] = home.value;
    v.exact[e->axis] = value_on_edge(cells, e, home_of(cells, e->carrier), e->axis);
    i128 normal[3];
    int64_t corner[3];
    bool fraction;
    facet_plane(cells, e->carrier, normal, corner);
    v.exact[r] = third_floor(normal, corner, v.exact, r, &fraction);
    v.fraction = (uint8_t)(fraction << r);
    return v;
}

bw_cell_vertex bw_cells_crossing(const bw_cells *cells, bw_cedge edge, bw_tet tet, bw_plane plane) {
    const bw_cell_edge *e = &cells->edge[edge];
    if (e->kind == BW_IN_EDGE) return cross_mesh_edge(cells, e->carrier, tet, plane);
    if (e->kind == BW_IN_FACET) return cross_in_facet(cells, e, tet, plane);
    bw_cell_vertex v = {.kind = BW_IN_TET, .carrier = e->carrier};
    for (int i = 0; i < 3; i++) v.exact[i] = i == e->axis ? plane.value : value_on_edge(cells, e, tet, i);
    return v;
}

bw_plane bw_cells_polygon_plane(const bw_cells *cells, bw_polygon polygon, bw_tet tet) {
    const bw_cell_polygon *p = &cells->polygon[polygon];
    if (p->kind == BW_IN_TET) return (bw_plane){cells->section[p->carrier], p->axis};
    if (p->axis < 0) return (bw_plane){0, -1};
    int8_t axis = p->axis;
    if (tet != home_of(cells, p->carrier)) axis = bw_rotation_image[bw_grid_map_rotation(cells->map, p->carrier)][axis];
    return (bw_plane){value_at(cells, tet, cells->mesh->facet[p->carrier][0])[axis], axis};
}

int bw_cells_edge_axis(const bw_cells *cells, bw_cedge edge, bw_tet tet) {
    const bw_cell_edge *e = &cells->edge[edge];
    if (e->kind == BW_IN_TET) return e->axis;
    if (e->kind == BW_IN_EDGE) {
        const int64_t *p = value_at(cells, tet, cells->mesh->edge[e->carrier][0]);
        const int64_t *q = value_at(cells, tet, cells->mesh->edge[e->carrier][1]);
        int axis = -1, differing = 0;
        for (int k = 0; k < 3; k++)
            if (p[k] != q[k]) axis = k, differing++;
        return differing == 1 ? axis : -1;
    }
    i128 normal[3];
    int64_t corner[3];
    facet_plane(cells, e->carrier, normal, corner);
    int b = e->axis, axis = -1; /* the edge's direction is the normal crossed with axis b */
    for (int i = 1; i < 3; i++)
        if (normal[(b + i) % 3] == 0) axis = (b + i) % 3;
    if (axis < 0 || tet == home_of(cells, e->carrier)) return axis;
    return bw_rotation_image[bw_grid_map_rotation(cells->map, e->carrier)][axis];
}

bool bw_cells_edge_is_boundary(const bw_cells *cells, bw_cedge e) {
    const bw_cell_edge *x = &cells->edge[e];
    if (x->kind == BW_IN_EDGE) return cells->map->edge_flags[x->carrier] & BW_EDGE_BOUNDARY;
    return x->kind == BW_IN_FACET && cells->mesh->facet_tet[x->carrier][1] == BW_NONE;
}

/* The ratio s = exact[0] / exact[1] of a vertex in a tet edge, nearly. */
static double ratio_of(const bw_cell_vertex *v) { return (double)v->exact[0] / (double)v->exact[1]; }

/* p + floor(s (q - p)) for the ratio s of a vertex in a tet edge. The quotient is guessed in floating point, to one or two, and put right
 * by its exact remainder. */
static int64_t floor_between(const bw_cell_vertex *v, double ratio, int64_t p, int64_t q, bool *fraction) {
    *fraction = false;
    if (p == q) return p;
    int64_t whole = (int64_t)(ratio * (double)(q - p));
    i128 rest = (i128)v->exact[0] * (q - p) - (i128)whole * v->exact[1];
    for (; rest < 0; rest += v->exact[1]) whole--;
    for (; rest >= v->exact[1]; rest -= v->exact[1]) whole++;
    *fraction = rest != 0;
    return p + whole;
}

int64_t bw_cells_floor(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, int axis, bool *fraction) {
    const bw_cell_vertex *v = &cells->vertex[vertex];
    *fraction = false;
    if (v->kind == BW_IN_VERTEX) return value_at(cells, tet, v->carrier)[axis];
    if (v->kind == BW_IN_EDGE) {
        int64_t p = value_at(cells, tet, cells->mesh->edge[v->carrier][0])[axis];
        int64_t q = value_at(cells, tet, cells->mesh->edge[v->carrier][1])[axis];
        return floor_between(v, ratio_of(v), p, q, fraction);
    }
    if (v->kind == BW_IN_TET || tet == home_of(cells, v->carrier)) {
        *fraction = v->fraction >> axis & 1;
        return v->exact[axis];
    }
    bw_transition out = bw_grid_map_across(cells->mesh, cells->map, v->carrier, home_of(cells, v->carrier));
    int from = bw_rotation_axis[out.rotation][axis];
    *fraction = v->fraction >> from & 1;
    if (bw_rotation_sign[out.rotation][axis] > 0) return v->exact[from] + out.shift[axis];
    return -v->exact[from] - *fraction + out.shift[axis];
}

unsigned bw_cells_locate(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, int64_t out[3]) {
    const bw_cell_vertex *v = &cells->vertex[vertex];
    if (v->kind == BW_IN_VERTEX) {
        memcpy(out, value_at(cells, tet, v->carrier), 3 * sizeof *out);
        return 0;
    }
    if (v->kind == BW_IN_TET || (v->kind == BW_IN_FACET && tet == home_of(cells, v->carrier))) {
        memcpy(out, v->exact, 3 * sizeof *out);
        return v->fraction;
    }
    unsigned fractions = 0;
    bool fraction;
    if (v->kind == BW_IN_EDGE) {
        const int64_t *p = value_at(cells, tet, cells->mesh->edge[v->carrier][0]);
        const int64_t *q = value_at(cells, tet, cells->mesh->edge[v->carrier][1]);
        double ratio = ratio_of(v);
        for (int k = 0; k < 3; k++) {
            out[k] = floor_between(v, ratio, p[k], q[k], &fraction);
            fractions |= (unsigned)fraction << k;
        }
        return fractions;
    }
    bw_transition t = bw_grid_map_across(cells->mesh, cells->map, v->carrier, home_of(cells, v->carrier));
    for (int k = 0; k < 3; k++) {
        int from = bw_rotation_axis[t.rotation][k], part = v->fraction >> from & 1;
        out[k] = t.shift[k] + (bw_rotation_sign[t.rotation][k] > 0 ? v->exact[from] : -v->exact[from] - part);
        fractions |= (unsigned)part << k;
    }
    return fractions;
}

static void facet_parameter(const bw_cells *cells, const bw_cell_vertex *v, bw_tet tet, mpq_t out[3]) {
    mpq_t home[3];
    for (int k = 0; k < 3; k++) mpq_init(home[k]), mpq_set_si(home[k], v->exact[k], 1);
    for (int r = 0; r < 3; r++) {
        if (!(v->fraction >> r & 1)) continue;
        i128 normal[3];
        int64_t corner[3];
        facet_plane(cells, v->carrier, normal, corner);
        third_exact(normal, corner, v->exact, r, mpq_numref(home[r]), mpq_denref(home[r]));
        mpq_canonicalize(home[r]);
        mpq_set_si(out[r], corner[r], 1);
        mpq_add(home[r], home[r], out[r]);
    }
    bw_transition t = {{0, 0, 0}, 0};
    if (tet != home_of(cells, v->carrier)) t = bw_grid_map_across(cells->mesh, cells->map, v->carrier, home_of(cells, v->carrier));
    for (int k = 0; k < 3; k++) {
        mpq_set(out[k], home[bw_rotation_axis[t.rotation][k]]);
        if (bw_rotation_sign[t.rotation][k] < 0) mpq_neg(out[k], out[k]);
        mpz_t shift;
        mpz_init_set_si(shift, t.shift[k]);
        mpz_addmul(mpq_numref(out[k]), mpq_denref(out[k]), shift);
        mpz_clear(shift);
    }
    for (int k = 0; k < 3; k++) mpq_clear(home[k]);
}

void bw_cells_parameter(const bw_cells *cells, bw_cvertex vertex, bw_tet tet, mpq_t out[3]) {
    const bw_cell_vertex *v = &cells->vertex[vertex];
    if (v->kind == BW_IN_FACET) {
        facet_parameter(cells, v, tet, out);
        return;
    }
    for (int k = 0; k < 3; k++) {
        if (v->kind == BW_IN_TET) {
            mpq_set_si(out[k], v->exact[k], 1);
        } else if (v->kind == BW_IN_VERTEX) {
            mpq_set_si(out[k], value_at(cells, tet, v->carrier)[k], 1);
        } else {
            int64_t p = value_at(cells, tet, cells->mesh->edge[v->carrier][0])[k];
            int64_t q = value_at(cells, tet, cells->mesh->edge[v->carrier][1])[k];
            mpz_set_128(mpq_numref(out[k]), (i128)p * v->exact[1] + (i128)v->exact[0] * (q - p));
            mpz_set_si(mpq_denref(out[k]), v->exact[1]);
            mpq_canonicalize(out[k]);
        }
    }
}

int bw_cells_compare_along(const bw_cells *cells, bw_cvertex a, bw_cvertex b, bw_tet tet, int axis) {
    bool fraction[2];
    int64_t x = bw_cells_floor(cells, a, tet, axis, &fraction[0]), y = bw_cells_floor(cells, b, tet, axis, &fraction[1]);
    if (x != y) return x < y ? -1 : 1;
    if (!fraction[0] || !fraction[1]) return fraction[0] - fraction[1];
    mpq_t p[3], q[3];
    for (int k = 0; k < 3; k++) mpq_inits(p[k], q[k], NULL);
    bw_cells_parameter(cells, a, tet, p);
    bw_cells_parameter(cells, b, tet, q);
    int order = mpq_cmp(p[axis], q[axis]);
    for (int k = 0; k < 3; k++) mpq_clears(p[k], q[k], NULL);
    return (order > 0) - (order < 0);
}

/* Weights of the other corners when `at` is written from corner 0 of a tet or, with the normal added as a third direction,
 * of a facet: Cramer's rule. */
static void solve_weights(double direction[3][3], const double at[3], double weight[3]) {
    double whole = bw_det3_rounded(direction[0], direction[1], direction[2]);
    for (int i = 0; i < 3; i++) {
        double m[3][3];
        memcpy(m, direction, sizeof m);
        memcpy(m[i], at, sizeof m[i]);
        weight[i] = bw_det3_rounded(m[0], m[1], m[2]) / whole;
    }
}

void bw_cells_position(const bw_cells *cells, bw_cvertex vertex, double out[3]) {
    const bw_cell_vertex *v = &cells->vertex[vertex];
    const bw_tet_mesh *mesh = cells->mesh;
    if (v->kind == BW_IN_VERTEX) {
        memcpy(out, mesh->position[v->carrier], 3 * sizeof *out);
        return;
    }
    if (v->kind == BW_IN_EDGE) {
        const double *p = mesh->position[mesh->edge[v->carrier][0]], *q = mesh->position[mesh->edge[v->carrier][1]];
        double s = (double)v->exact[0] / (double)v->exact[1];
        for (int k = 0; k < 3; k++) out[k] = p[k] + s * (q[k] - p[k]);
        return;
    }
    bool in_facet = v->kind == BW_IN_FACET;
    bw_tet tet = in_facet ? home_of(cells, v->carrier) : v->carrier;
    const bw_vertex *corner = in_facet ? mesh->facet[v->carrier] : mesh->tet[tet];
    double direction[3][3], at[3], weight[3];
    const int64_t *origin = value_at(cells, tet, corner[0]);
    for (int i = 0; i < (in_facet ? 2 : 3); i++)
        for (int k = 0; k < 3; k++) direction[i][k] = (double)(value_at(cells, tet, corner[i + 1])[k] - origin[k]);
    for (int k = 0; k < 3; k++) at[k] = (double)(v->exact[k] - origin[k]) + 0.5 * (v->fraction >> k & 1);
    if (in_facet)
        for (int k = 0; k < 3; k++) {
            int i = (k + 1) % 3, j = (k + 2) % 3;
            direction[2][k] = direction[0][i] * direction[1][j] - direction[0][j] * direction[1][i];
        }
    solve_weights(direction, at, weight);
    for (int k = 0; k < 3; k++) {
        out[k] = mesh->position[corner[0]][k];
        for (int i = 0; i < (in_facet ? 2 : 3); i++)
            out[k] += weight[i] * (mesh->position[corner[i + 1]][k] - mesh->position[corner[0]][k]);
    }
}
