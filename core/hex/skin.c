#include "hex/skin.h"

/* ---- quads --------------------------------------------------------------------------------------------------------- */

static bw_status find_quads(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    uint32_t *mate;
    bw_status status = bw_hex_mates(ctx, mesh, &mate);
    if (status != BW_OK) return status;
    for (size_t x = 0; x < 6 * mesh->hex_count; x++) skin->quad_count += mate[x] == BW_HEX_NO_MATE;
    skin->quad = bw_alloc(ctx, skin->quad_count, sizeof *skin->quad);
    if (!skin->quad) status = ctx->error.status;
    for (size_t x = 0, n = 0; x < 6 * mesh->hex_count && status == BW_OK; x++)
        if (mate[x] == BW_HEX_NO_MATE) {
            skin->quad[n] = (bw_hex_quad){.hex = (bw_hex)(x / 6), .face = (uint8_t)(x % 6), .surface = (int32_t)n};
            n++;
        }
    bw_free(ctx, mate);
    return status;
}

/* ---- edges of the boundary ----------------------------------------------------------------------------------------- */

/* The first two quads at an edge, and how many there are. */
typedef struct {
    int32_t quad[2], count;
} edge_quads;

static bw_status find_edge_quads(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_edges *edges, edge_quads **found) {
    edge_quads *at = *found = bw_alloc(ctx, edges->begin[mesh->vertex_count], sizeof *at);
    if (!at) return ctx->error.status;
    for (size_t q = 0; q < skin->quad_count; q++)
        for (int i = 0; i < 4; i++) {
            bw_hvertex a = bw_hex_quad_vertex(mesh, &skin->quad[q], i), b = bw_hex_quad_vertex(mesh, &skin->quad[q], (i + 1) & 3);
            edge_quads *e = &at[bw_hex_edges_find(edges, a, b)];
            if (e->count < 2) e->quad[e->count] = (int32_t)q;
            e->count++;
        }
    return BW_OK;
}

/* ---- surfaces: union-find over quads, the lowest is the root ------------------------------------------------------- */

static int32_t root_of(bw_hex_skin *skin, int32_t quad) {
    while (skin->quad[quad].surface != quad) quad = skin->quad[quad].surface = skin->quad[skin->quad[quad].surface].surface;
    return quad;
}

static void join(bw_hex_skin *skin, int32_t a, int32_t b) {
    a = root_of(skin, a), b = root_of(skin, b);
    if (a < b) skin->quad[b].surface = a;
    else skin->quad[a].surface = b;
}

static void number_surfaces(bw_hex_skin *skin) {
    for (size_t q = 0; q < skin->quad_count; q++) {
        int32_t up = skin->quad[q].surface; /* not after its quad, and that one is numbered: stored as -1 - number */
        skin->quad[q].surface = up == (int32_t)q ? -1 - (int32_t)skin->surface_count++ : skin->quad[up].surface;
    }
    for (size_t q = 0; q < skin->quad_count; q++) skin->quad[q].surface = -1 - skin->quad[q].surface;
}

/* Irregular edges, and regular ones if these are wanted too; quads that an edge holds together are joined. */
static bw_status list_edges(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_edges *edges, const edge_quads *at, bool regular, bw_hex_skin *skin) {
    size_t room = 0;
    bw_status status = BW_OK;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (uint32_t e = edges->begin[v]; e < edges->begin[v + 1] && status == BW_OK; e++) {
            bool boundary = at[e].count > 0;
            if (at[e].count == 2 && edges->valence[e] == 2) join(skin, at[e].quad[0], at[e].quad[1]);
            if (!regular && edges->valence[e] == (boundary ? 2 : 4)) continue;
            status = bw_reserve(ctx, &skin->edge, &room, skin->edge_count + 1);
            if (status == BW_OK)
                skin->edge[skin->edge_count++] =
                    (bw_hex_edge){.vertex = {(bw_hvertex)v, edges->high[e]}, .valence = edges->valence[e], .boundary = boundary};
        }
    return status;
}

static bw_status init(bw_context *ctx, const bw_hex_mesh *mesh, bool regular, bw_hex_skin *skin) {
    *skin = (bw_hex_skin){0};
    bw_hex_edges edges = {0};
    edge_quads *at = NULL;
    bw_status status = find_quads(ctx, mesh, skin);
    if (status == BW_OK) status = bw_hex_edges_init(ctx, mesh, &edges);
    if (status == BW_OK) status = find_edge_quads(ctx, mesh, skin, &edges, &at);
    if (status == BW_OK) status = list_edges(ctx, mesh, &edges, at, regular, skin);
    if (status == BW_OK) number_surfaces(skin);
    bw_free(ctx, at);
    bw_hex_edges_clear(ctx, &edges);
    return status;
}

bw_status bw_hex_skin_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    return init(ctx, mesh, false, skin);
}

bw_status bw_hex_skin_init_all(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    return init(ctx, mesh, true, skin);
}

void bw_hex_skin_clear(bw_context *ctx, bw_hex_skin *skin) {
    bw_free(ctx, skin->quad);
    bw_free(ctx, skin->edge);
    *skin = (bw_hex_skin){0};
}
