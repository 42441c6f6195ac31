#include "mesh/gridmap.h"

#include <math.h>
#include <string.h>

#include "exact/det.h"
#include "mesh/defects.h"

void bw_grid_map_clear(bw_context *ctx, bw_grid_map *map) {
    bw_free(ctx, map->value);
    bw_free(ctx, map->turn);
    bw_free(ctx, map->align);
    bw_free(ctx, map->quarters);
    bw_free(ctx, map->edge_flags);
    memset(map, 0, sizeof *map);
}

bw_transition bw_grid_map_across(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_facet facet, bw_tet from) {
    if (bw_grid_map_same_chart(map, facet)) return (bw_transition){{0, 0, 0}, 0};
    bw_vertex v = mesh->facet[facet][0];
    bw_tet to = bw_tet_across(mesh, facet, from);
    const int64_t *x = map->value[from][bw_tet_corner(mesh, from, v)], *y = map->value[to][bw_tet_corner(mesh, to, v)];
    bw_rotation r = bw_grid_map_rotation(map, facet);
    if (mesh->facet_tet[facet][0] != from) r = bw_rotation_inverse(r);
    bw_transition t = {.rotation = r};
    bw_rotate(r, x, t.shift);
    for (int k = 0; k < 3; k++) t.shift[k] = y[k] - t.shift[k];
    return t;
}

static void difference(const int64_t a[3], const int64_t b[3], int64_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = b[k] - a[k];
}

int bw_grid_tet_sign(const int64_t value[4][3]) {
    int64_t d[3][3];
    for (int i = 0; i < 3; i++) difference(value[0], value[i + 1], d[i]);
    return bw_det3_sign(d[0], d[1], d[2]);
}

static bw_status check_range(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map) {
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 12; i++) {
            int64_t x = map->value[t][i / 3][i % 3];
            if (x <= BW_GRID_MAX && x >= -BW_GRID_MAX) continue;
            bw_fail_element(ctx, "tet", mesh->tet_id[t], NULL);
            return bw_fail(ctx, BW_E_RANGE, "a parameter of tet %d is outside the exact grid", mesh->tet_id[t]);
        }
    return BW_OK;
}

static bw_status check_orientation(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map) {
    bw_defects bad;
    if (bw_defects_init(ctx, &bad, mesh, (const int64_t(*)[4][3])map->value)) return ctx->error.status;
    for (size_t r = 0; r < bad.count; r++) bw_defects_blame(ctx, &bad, mesh, r);
    if (bad.count)
        bw_fail(ctx, BW_E_INVERTED, "%zu %s inverted or flat in the parametrization; the first is tet %lld", bw_defects_tets(&bad),
                bw_words(bw_defects_tets(&bad), "tet is", "tets are"), (long long)ctx->error.elements[0].id);
    bw_defects_clear(ctx, &bad);
    return ctx->error.status;
}

/* The values of a facet's three vertices in the chart of one of its tets. */
static void facet_values(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_facet f, bw_tet t, int64_t out[3][3]) {
    for (int i = 0; i < 3; i++)
        memcpy(out[i], map->value[t][bw_tet_corner(mesh, t, mesh->facet[f][i])], sizeof out[i]);
}

/* bw_grid_map.turn of the transition that carries a[i] to b[i] for i = 0..2, if there is one. It is unique: the corners are not collinear. */
static bool find_turn(int64_t a[3][3], int64_t b[3][3], uint8_t *out) {
    int64_t p[2][3], q[2][3];
    for (int i = 0; i < 2; i++) difference(a[0], a[i + 1], p[i]), difference(b[0], b[i + 1], q[i]);
    for (bw_rotation r = 0; r < BW_ROTATIONS; r++) {
        int64_t turned[2][3];
        for (int i = 0; i < 2; i++) bw_rotate(r, p[i], turned[i]);
        if (memcmp(turned, q, sizeof q)) continue;
        bw_rotate(r, a[0], turned[0]);
        *out = (uint8_t)(r | (memcmp(turned[0], b[0], sizeof b[0]) ? BW_TURN_SHIFTED : 0));
        return true;
    }
    return false;
}

static bw_status derive_facets(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map) {
    size_t torn = 0, tilted = 0;
    for (size_t f = 0; f < mesh->facet_count; f++) {
        int64_t a[3][3], b[3][3];
        const bw_tet *t = mesh->facet_tet[f];
        facet_values(mesh, map, (bw_facet)f, t[0], a);
        map->align[f] = -1;
        bool bad;
        if (t[1] != BW_NONE) {
            facet_values(mesh, map, (bw_facet)f, t[1], b);
            bad = !find_turn(a, b, &map->turn[f]);
            torn += bad;
        } else {
            for (int8_t k = 0; k < 3; k++)
                if (a[0][k] == a[1][k] && a[0][k] == a[2][k]) map->align[f] = k;
            bad = map->align[f] < 0;
            tilted += bad;
        }
        if (!bad) continue;
        double centre[3];
        bw_facet_centre(mesh, (bw_facet)f, centre);
        bw_fail_element(ctx, "facet", (int64_t)f, centre);
    }
    if (torn) return bw_fail(ctx, BW_E_NOT_SEAMLESS, "%zu %s no octahedral transition on the grid", torn, bw_words(torn, "facet has", "facets have"));
    if (tilted) return bw_fail(ctx, BW_E_NOT_ALIGNED, "%zu boundary facets are not aligned on the grid", tilted);
    return BW_OK;
}

/* Axis along which the edge between two corners runs in its tet's chart; -1 if along none. */
static int edge_axis(const int64_t a[3], const int64_t b[3]) {
    int axis = -1;
    for (int k = 0; k < 3; k++) {
        if (a[k] == b[k]) continue;
        if (axis >= 0) return -1;
        axis = k;
    }
    return axis;
}

/* The corners of a tet ordered so that, seen with the edge (out[0], out[1]) pointing at the viewer, out[2] turns counterclockwise to
 * out[3]; out[0] is the end with the lower vertex number. */
static void order_corners(const bw_tet_mesh *mesh, bw_tet t, int local_edge, int out[4]) {
    static const uint8_t other[6][2] = {{2, 3}, {3, 1}, {1, 2}, {0, 3}, {2, 0}, {0, 1}};
    int a = bw_tet_edge_corners[local_edge][0], b = bw_tet_edge_corners[local_edge][1];
    bool flip = mesh->tet[t][a] > mesh->tet[t][b];
    out[0] = flip ? b : a, out[1] = flip ? a : b;
    out[2] = other[local_edge][flip], out[3] = other[local_edge][!flip];
}

/* Rays of the axis cross in the half-open wedge (c, d]: summed around an aligned edge they count its quarter turns exactly. */
static int rays_in_wedge(const int64_t c[2], const int64_t d[2]) {
    static const int64_t ray[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    int count = 0;
    for (int i = 0; i < 4; i++)
        count += c[0] * ray[i][1] - c[1] * ray[i][0] > 0 && ray[i][0] * d[1] - ray[i][1] * d[0] >= 0;
    return count;
}

static double wedge_angle(const int64_t value[4][3], const int corner[4]) {
    double e[3], c[3], d[3], n[2][3];
    for (int k = 0; k < 3; k++) {
        e[k] = (double)(value[corner[1]][k] - value[corner[0]][k]);
        c[k] = (double)(value[corner[2]][k] - value[corner[0]][k]);
        d[k] = (double)(value[corner[3]][k] - value[corner[0]][k]);
    }
    double length = sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        n[0][k] = e[i] * c[j] - e[j] * c[i];
        n[1][k] = e[i] * d[j] - e[j] * d[i];
    }
    double dot = n[0][0] * n[1][0] + n[0][1] * n[1][1] + n[0][2] * n[1][2];
    double volume = c[0] * (d[1] * e[2] - d[2] * e[1]) - c[1] * (d[0] * e[2] - d[2] * e[0]) + c[2] * (d[0] * e[1] - d[1] * e[0]);
    return atan2(fabs(volume) * length, dot);
}

/* Per edge: exact ray count if it is aligned, else a sum of angles. Seamlessness and boundary alignment were verified, so
 * this sum is a multiple of a third or half of a turn (rotations about diagonals), on the boundary of a half turn; rounding it to
 * twelfths of a turn therefore decides without doubt. */
typedef struct {
    double *angle;
    int32_t *rays;
    uint8_t *oblique;
} edge_turns;

static void add_turn(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_tet t, int local_edge, edge_turns *turns) {
    int c[4];
    order_corners(mesh, t, local_edge, c);
    const int64_t(*value)[3] = (const int64_t(*)[3])map->value[t];
    bw_edge e = mesh->tet_edge[t][local_edge];
    turns->angle[e] += wedge_angle(value, c);
    int axis = edge_axis(value[c[0]], value[c[1]]);
    if (axis < 0) {
        turns->oblique[e] = 1;
        return;
    }
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    int64_t sense = value[c[1]][axis] > value[c[0]][axis] ? 1 : -1, side[2][2];
    for (int i = 0; i < 2; i++) {
        side[i][0] = value[c[2 + i]][u] - value[c[0]][u];
        side[i][1] = sense * (value[c[2 + i]][v] - value[c[0]][v]);
    }
    turns->rays[e] += rays_in_wedge(side[0], side[1]);
}

static bw_status classify_edges(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map, const edge_turns *turns) {
    size_t bad = 0;
    bool oblique_feature = false;
    for (size_t e = 0; e < mesh->edge_count; e++) {
        bool boundary = map->edge_flags[e] & BW_EDGE_BOUNDARY;
        long regular = boundary ? 2 : 4;
        long twelfths = turns->oblique[e] ? lround(turns->angle[e] / (M_PI / 6)) : 3L * turns->rays[e];
        map->quarters[e] = (uint16_t)(twelfths / 3);
        bool singular = twelfths != 3 * regular;
        if (singular) map->edge_flags[e] |= BW_EDGE_SINGULAR;
        if (!turns->oblique[e] || !(map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE))) continue;
        oblique_feature |= !singular;
        double centre[3];
        bw_edge_centre(mesh, (bw_edge)e, centre);
        bw_fail_element(ctx, "edge", (int64_t)e, centre);
        bad++;
    }
    if (bad && oblique_feature) return bw_fail(ctx, BW_E_NOT_ALIGNED, "%zu feature or singular edges are not aligned on the grid", bad);
    return bad ? bw_fail(ctx, BW_E_SINGULAR, "%zu singular edges are not aligned", bad) : BW_OK;
}

static bw_status derive_edges(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map) {
    edge_turns turns = {bw_alloc(ctx, mesh->edge_count, sizeof(double)), bw_alloc(ctx, mesh->edge_count, sizeof(int32_t)),
                        bw_alloc(ctx, mesh->edge_count, 1)};
    bw_status status = ctx->error.status;
    if (status == BW_OK) {
        for (size_t t = 0; t < mesh->tet_count; t++) {
            for (int i = 0; i < 6; i++) add_turn(mesh, map, (bw_tet)t, i, &turns);
            for (int i = 0; i < 4; i++) {
                if (mesh->facet_tet[mesh->tet_facet[t][i]][1] != BW_NONE) continue;
                for (int j = 0; j < 6; j++)
                    if (bw_tet_edge_corners[j][0] != i && bw_tet_edge_corners[j][1] != i)
                        map->edge_flags[mesh->tet_edge[t][j]] |= BW_EDGE_BOUNDARY;
            }
        }
        status = classify_edges(ctx, mesh, map, &turns);
    }
    bw_free(ctx, turns.angle);
    bw_free(ctx, turns.rays);
    bw_free(ctx, turns.oblique);
    return status;
}

static bool facet_is_aligned(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_facet f) {
    int64_t u[3][3];
    bool aligned = false;
    facet_values(mesh, map, f, mesh->facet_tet[f][0], u);
    for (int k = 0; k < 3; k++) aligned = aligned || (u[0][k] == u[1][k] && u[0][k] == u[2][k]);
    return aligned;
}

static bw_status derive_features(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map) {
    for (size_t i = 0; i < mesh->feature_facet_count; i++) {
        bw_facet f = bw_tet_mesh_find_facet(mesh, mesh->feature_facet[i]);
        if (f == BW_NONE) return bw_fail(ctx, BW_E_INDEX, "feature facet %zu is no facet of the mesh", i);
        if (facet_is_aligned(mesh, map, f)) continue;
        double centre[3];
        bw_facet_centre(mesh, f, centre);
        bw_fail_element(ctx, "facet", f, centre);
        return bw_fail(ctx, BW_E_NOT_ALIGNED, "feature facet %zu is not aligned on the grid", i);
    }
    for (size_t i = 0; i < mesh->feature_edge_count; i++) {
        bw_edge e = bw_tet_mesh_find_edge(mesh, mesh->feature_edge[i]);
        if (e == BW_NONE) return bw_fail(ctx, BW_E_INDEX, "feature edge %zu is no edge of the mesh", i);
        map->edge_flags[e] |= BW_EDGE_FEATURE;
    }
    return BW_OK;
}

bw_status bw_grid_map_derive(bw_context *ctx, const bw_tet_mesh *mesh, bw_grid_map *map) {
    bw_free(ctx, map->turn), bw_free(ctx, map->align), bw_free(ctx, map->quarters), bw_free(ctx, map->edge_flags);
    map->turn = bw_alloc(ctx, mesh->facet_count, sizeof *map->turn);
    map->align = bw_alloc(ctx, mesh->facet_count, sizeof *map->align);
    map->quarters = bw_alloc(ctx, mesh->edge_count, sizeof *map->quarters);
    map->edge_flags = bw_alloc(ctx, mesh->edge_count, sizeof *map->edge_flags);
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = check_range(ctx, mesh, map);
    if (status == BW_OK) status = check_orientation(ctx, mesh, map);
    if (status == BW_OK) status = derive_facets(ctx, mesh, map);
    if (status == BW_OK) status = derive_features(ctx, mesh, map);
    if (status == BW_OK) status = derive_edges(ctx, mesh, map);
    return status;
}
