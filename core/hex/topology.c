#include "hex/topology.h"

#include "base/forest.h"
#include "hex/incidence.h"

/* Joins the vertices of cells of n corners each and counts what hangs together; vertices of no cell are not counted. */
static bw_status join_cells(bw_context *ctx, const int32_t *corner, size_t cells, size_t n, size_t vertex_count, size_t *used, size_t *components) {
    int32_t *parent = bw_alloc(ctx, vertex_count, sizeof *parent);
    if (!parent) return ctx->error.status;
    for (size_t v = 0; v < vertex_count; v++) parent[v] = BW_NONE;
    for (size_t i = 0; i < cells * n; i++) {
        int32_t v = corner[i], w = corner[i / n * n];
        if (parent[v] == BW_NONE) parent[v] = v;
        bw_forest_join(parent, v, w);
    }
    *used = *components = 0;
    for (size_t v = 0; v < vertex_count; v++) *used += parent[v] != BW_NONE, *components += parent[v] == (int32_t)v;
    bw_free(ctx, parent);
    return BW_OK;
}

/* The Euler characteristic of a manifold of three dimensions is half of its boundary's, and that surface of quads has twice as many edges as quads. */
bw_status bw_hex_mesh_topology(bw_context *ctx, const bw_hex_mesh *mesh, bw_topology *out) {
    size_t used;
    int64_t euler = 0;
    uint32_t *mate = NULL;
    uint8_t *outside = bw_alloc(ctx, mesh->vertex_count, 1);
    bw_status status = join_cells(ctx, mesh->hex_count ? mesh->hex[0] : NULL, mesh->hex_count, 8, mesh->vertex_count, &used, &out->components);
    if (status == BW_OK) status = bw_hex_mates(ctx, mesh, &mate);
    for (size_t x = 0; x < 6 * mesh->hex_count && status == BW_OK; x++) {
        if (mate[x] != BW_HEX_NO_MATE) continue;
        euler--;
        for (int i = 0; i < 4; i++) outside[mesh->hex[x / 6][bw_hex_face_corner[x % 6][i]]] = 1;
    }
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++) euler += outside[v];
    out->euler = euler / 2;
    bw_free(ctx, outside);
    bw_free(ctx, mate);
    return status;
}

bw_status bw_tet_mesh_topology(bw_context *ctx, const bw_tet_mesh *mesh, bw_topology *out) {
    size_t used;
    bw_status status = join_cells(ctx, mesh->tet_count ? mesh->tet[0] : NULL, mesh->tet_count, 4, mesh->vertex_count, &used, &out->components);
    if (status == BW_OK) out->euler = (int64_t)used - (int64_t)mesh->edge_count + (int64_t)mesh->facet_count - (int64_t)mesh->tet_count;
    return status;
}
