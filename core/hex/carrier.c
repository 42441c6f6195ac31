#include "hex/carrier.h"

#include <string.h>

#include "hex/hexmesh.h"

/* Facet i of a tet has all its edges but those at corner i: whether edge e is one of them. */
static bool edge_of_facet(int facet, int e) { return bw_tet_edge_corners[e][0] != facet && bw_tet_edge_corners[e][1] != facet; }

static void hold_facets(const bw_tet_mesh *mesh, bw_carriers *c) {
    for (size_t f = 0; f < mesh->facet_count; f++) c->facet[f] = mesh->facet_tet[f][1] == BW_NONE ? BW_HELD_SURFACE : BW_HELD_NOT;
    for (size_t i = 0; i < mesh->feature_facet_count; i++) {
        bw_facet f = bw_tet_mesh_find_facet(mesh, mesh->feature_facet[i]);
        if (f != BW_NONE) c->facet[f] = BW_HELD_SURFACE;
    }
}

static void first(int32_t *slot, int32_t candidate) {
    if (*slot == BW_NONE || candidate < *slot) *slot = candidate;
}

static void hold_edges(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_carriers *c, uint8_t *facets) {
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            bw_facet f = mesh->tet_facet[t][i];
            if (c->facet[f] == BW_HELD_NOT || mesh->facet_tet[f][0] != (bw_tet)t) continue;
            for (int k = 0; k < 6; k++) {
                bw_edge e = mesh->tet_edge[t][k];
                if (!edge_of_facet(i, k)) continue;
                if (facets[e] < UINT8_MAX) facets[e]++;
                first(&c->edge_on[e], f);
            }
            for (int k = 0; k < 3; k++) first(&c->vertex_on[mesh->facet[f][k]], f);
        }
    for (size_t e = 0; e < mesh->edge_count; e++) {
        uint8_t flags = map->edge_flags[e];
        bool curve = flags & BW_EDGE_FEATURE || ((flags & BW_EDGE_BOUNDARY) && (flags & BW_EDGE_SINGULAR)) || (facets[e] && facets[e] != 2);
        c->edge[e] = curve ? BW_HELD_CURVE : facets[e] ? BW_HELD_SURFACE : BW_HELD_NOT;
    }
}

/* At each vertex: how many curves, the lowest of them, and whether they differ in angle. */
static void hold_vertices(const bw_tet_mesh *mesh, const bw_grid_map *map, bw_carriers *c, uint8_t *curves, bw_edge *curve) {
    for (size_t v = 0; v < mesh->vertex_count; v++) c->vertex[v] = c->vertex_on[v] == BW_NONE ? BW_HELD_NOT : BW_HELD_SURFACE, curve[v] = BW_NONE;
    for (size_t e = 0; e < mesh->edge_count; e++) {
        if (c->edge[e] != BW_HELD_CURVE) continue;
        for (int i = 0; i < 2; i++) {
            bw_vertex v = mesh->edge[e][i];
            if (curves[v] < UINT8_MAX) curves[v]++;
            c->vertex[v] = BW_HELD_CURVE;
            if (curve[v] == BW_NONE) curve[v] = (bw_edge)e;
            else if (map->quarters[curve[v]] != map->quarters[e]) c->vertex[v] = BW_HELD_POINT, curves[v] = UINT8_MAX;
        }
    }
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        if (curve[v] != BW_NONE) c->vertex_on[v] = curve[v];
        if (curves[v] && curves[v] != 2) c->vertex[v] = BW_HELD_POINT;
    }
    for (size_t i = 0; i < mesh->feature_vertex_count; i++) c->vertex[mesh->feature_vertex[i]] = BW_HELD_POINT;
}

static void find_tets(const bw_tet_mesh *mesh, bw_carriers *c) {
    for (size_t t = mesh->tet_count; t-- > 0;) {
        for (int k = 0; k < 6; k++) c->edge_tet[mesh->tet_edge[t][k]] = (bw_tet)t;
        for (int i = 0; i < 4; i++) c->vertex_tet[mesh->tet[t][i]] = (bw_tet)t;
    }
}

bw_status bw_carriers_init(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_carriers *c) {
    *c = (bw_carriers){bw_alloc(ctx, mesh->facet_count, 1),
                       bw_alloc(ctx, mesh->edge_count, 1),
                       bw_alloc(ctx, mesh->vertex_count, 1),
                       bw_alloc(ctx, mesh->edge_count, sizeof *c->edge_on),
                       bw_alloc(ctx, mesh->vertex_count, sizeof *c->vertex_on),
                       bw_alloc(ctx, mesh->edge_count, sizeof *c->edge_tet),
                       bw_alloc(ctx, mesh->vertex_count, sizeof *c->vertex_tet)};
    uint8_t *facets = bw_alloc(ctx, mesh->edge_count, 1), *curves = bw_alloc(ctx, mesh->vertex_count, 1);
    bw_edge *curve = bw_alloc(ctx, mesh->vertex_count, sizeof *curve);
    if (ctx->error.status == BW_OK) {
        for (size_t e = 0; e < mesh->edge_count; e++) c->edge_on[e] = BW_NONE;
        for (size_t v = 0; v < mesh->vertex_count; v++) c->vertex_on[v] = c->vertex_tet[v] = BW_NONE;
        hold_facets(mesh, c);
        hold_edges(mesh, map, c, facets);
        hold_vertices(mesh, map, c, curves, curve);
        find_tets(mesh, c);
    }
    bw_free(ctx, facets);
    bw_free(ctx, curves);
    bw_free(ctx, curve);
    return ctx->error.status;
}

void bw_carriers_clear(bw_context *ctx, bw_carriers *c) {
    void *blocks[] = {c->facet, c->edge, c->vertex, c->edge_on, c->vertex_on, c->edge_tet, c->vertex_tet};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(c, 0, sizeof *c);
}
