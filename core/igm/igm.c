#include "igm/igm.h"

#include <string.h>

void bw_igm_clear(bw_context *ctx, bw_igm *igm) {
    bw_grid_map_clear(ctx, &igm->map);
    bw_tet_mesh_clear(ctx, &igm->mesh);
    bw_free(ctx, igm->home);
    igm->home = NULL;
}

/* ---- invariant 1 ---- */

/* Derives the map anew from its values, which verifies it, and compares. */
static bw_status check_map(bw_context *ctx, const bw_igm *igm) {
    const bw_tet_mesh *mesh = &igm->mesh;
    const bw_grid_map *map = &igm->map;
    bw_grid_map again = {.exponent = map->exponent, .value = map->value};
    bw_status status = bw_grid_map_derive(ctx, mesh, &again);
    if (status == BW_OK)
        for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++)
            if (again.align[f] != map->align[f] || (mesh->facet_tet[f][1] != BW_NONE && again.turn[f] != map->turn[f]))
                status = bw_fail(ctx, BW_E_CHECK, "facet %zu of the integer-grid map is not as its values say", f);
    if (status == BW_OK && (memcmp(again.quarters, map->quarters, mesh->edge_count * sizeof *map->quarters) ||
                            memcmp(again.edge_flags, map->edge_flags, mesh->edge_count * sizeof *map->edge_flags)))
        status = bw_fail(ctx, BW_E_CHECK, "edges of the integer-grid map are not as its values say");
    again.value = NULL;
    bw_grid_map_clear(ctx, &again);
    return status;
}

/* ---- invariants 2 and 3 ---- */

static bool whole(const bw_grid_map *map, int64_t x) { return map->exponent <= 0 || !(x & (((int64_t)1 << map->exponent) - 1)); }

/* Whether the axes in which all of these corners agree have whole values; count of such axes in *constant. */
static bool whole_constants(const bw_igm *igm, bw_tet t, const bw_vertex *vertex, int n, int *constant) {
    const int64_t *at[3] = {NULL};
    bool good = true;
    for (int i = 0; i < n; i++) at[i] = igm->map.value[t][bw_tet_corner(&igm->mesh, t, vertex[i])];
    *constant = 0;
    for (int k = 0; k < 3; k++) {
        bool same = true;
        for (int i = 1; i < n; i++) same = same && at[i][k] == at[0][k];
        *constant += same;
        good = good && (!same || whole(&igm->map, at[0][k]));
    }
    return good;
}

static bw_status check_facets(bw_context *ctx, const bw_igm *igm) {
    const bw_tet_mesh *mesh = &igm->mesh;
    int constant;
    for (size_t f = 0; f < mesh->facet_count; f++) {
        const bw_tet *t = mesh->facet_tet[f];
        if (t[1] == BW_NONE) {
            if (!whole_constants(igm, t[0], mesh->facet[f], 3, &constant)) return bw_fail(ctx, BW_E_CHECK, "boundary facet %zu is not on the integer grid", f);
            continue;
        }
        bw_transition across = bw_grid_map_across(mesh, &igm->map, (bw_facet)f, t[0]);
        for (int k = 0; k < 3; k++)
            if (!whole(&igm->map, across.shift[k])) return bw_fail(ctx, BW_E_CHECK, "the transition across facet %zu is not whole", f);
    }
    for (size_t i = 0; i < mesh->feature_facet_count; i++) {
        bw_facet f = bw_tet_mesh_find_facet(mesh, mesh->feature_facet[i]);
        if (f == BW_NONE || !whole_constants(igm, mesh->facet_tet[f][0], mesh->facet[f], 3, &constant) || !constant)
            return bw_fail(ctx, BW_E_CHECK, "feature facet %zu is not on the integer grid", i);
    }
    return BW_OK;
}

static bw_status check_edges(bw_context *ctx, const bw_igm *igm) {
    const bw_tet_mesh *mesh = &igm->mesh;
    int constant;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 6; i++) {
            bw_edge e = mesh->tet_edge[t][i];
            if (!(igm->map.edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE))) continue;
            if (!whole_constants(igm, (bw_tet)t, mesh->edge[e], 2, &constant) || constant != 2)
                return bw_fail(ctx, BW_E_CHECK, "edge %d, which is singular or a feature, is not on the integer grid", e);
        }
    return BW_OK;
}

bw_status bw_igm_check(bw_context *ctx, const bw_igm *igm) {
    bw_status status = check_map(ctx, igm);
    if (status == BW_OK) status = check_facets(ctx, igm);
    if (status == BW_OK) status = check_edges(ctx, igm);
    return status;
}
