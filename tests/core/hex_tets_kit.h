/* The tet mesh of a hex mesh, for tests: each hex as 24 tets around its centre and those of its faces. Its boundary, and the edges of it that are singular
 * for the hexes, are what the vertices of the hex mesh are held on; their carriers are set.
 */
#ifndef BW_TESTS_CORE_HEX_TETS_KIT_H
#define BW_TESTS_CORE_HEX_TETS_KIT_H

#include "core/hex_kit.h"

#include "hex/surface.h"

typedef struct {
    bw_tet_mesh mesh;
    uint8_t *edge_flags;
    bw_hex_surface surface;
} hex_tets;

/* Vertices: those of the hex mesh, one for each pair of mates (or face without one), one for each hex. */
static inline void hex_tets_fill(bw_context *ctx, const bw_hex_mesh *hex, const uint32_t *mate, bw_tet_mesh *tets) {
    size_t n = hex->vertex_count, used = n;
    int32_t *centre = calloc(6 * hex->hex_count, sizeof *centre);
    tets->tet_count = 24 * hex->hex_count;
    tets->position = bw_alloc(ctx, n + 7 * hex->hex_count, sizeof *tets->position);
    tets->tet = bw_alloc(ctx, tets->tet_count, sizeof *tets->tet);
    memcpy(tets->position, hex->position, n * sizeof *hex->position);
    for (size_t x = 0; x < 6 * hex->hex_count; x++) {
        bool second = mate[x] != BW_HEX_NO_MATE && mate[x] < x;
        centre[x] = second ? centre[mate[x]] : (int32_t)used++;
        for (int i = 0; i < 4 && !second; i++)
            for (int k = 0; k < 3; k++)
                tets->position[centre[x]][k] += hex->position[hex->hex[x / 6][bw_hex_face_corner[x % 6][i]]][k] / 4;
    }
    for (size_t h = 0; h < hex->hex_count; h++, used++) {
        for (int i = 0; i < 24; i++) tets->position[used][i % 3] += hex->position[hex->hex[h][i / 3]][i % 3] / 8;
        for (size_t i = 0; i < 24; i++) {
            bw_vertex *t = tets->tet[24 * h + i];
            t[0] = (bw_vertex)used, t[1] = centre[6 * h + i / 4];
            for (size_t k = 0; k < 2; k++) t[2 + k] = hex->hex[h][bw_hex_face_corner[i / 4][(i + k) % 4]];
        }
    }
    tets->vertex_count = used;
    free(centre);
}

static inline void hex_tets_carry(const bw_hex_mesh *hex, const bw_hex_skin *skin, hex_tets *t) {
    for (size_t f = 0; f < t->mesh.facet_count; f++)
        for (int i = 0; i < 3 && t->mesh.facet_tet[f][1] == BW_NONE; i++)
            if (t->mesh.facet[f][i] < (bw_vertex)hex->vertex_count) hex->carrier[t->mesh.facet[f][i]] = (int32_t)f;
    for (size_t e = 0; e < skin->edge_count; e++) {
        bw_edge edge = bw_tet_mesh_find_edge(&t->mesh, skin->edge[e].vertex);
        if (!skin->edge[e].boundary) continue;
        t->edge_flags[edge] = BW_EDGE_SINGULAR | BW_EDGE_BOUNDARY;
        for (int i = 0; i < 2; i++) hex->carrier[skin->edge[e].vertex[i]] = edge;
    }
    for (size_t v = 0; v < hex->vertex_count; v++)
        if (hex->held[v] == BW_HELD_POINT) hex->carrier[v] = (int32_t)v;
}

/* Sets hex->carrier. Free with hex_tets_clear. */
static inline void hex_tets_make(bw_context *ctx, bw_hex_mesh *hex, hex_tets *t) {
    uint32_t *mate;
    bw_hex_skin skin;
    *t = (hex_tets){0};
    kit_expect_ok(ctx, bw_hex_mates(ctx, hex, &mate));
    hex_tets_fill(ctx, hex, mate, &t->mesh);
    bw_free(ctx, mate);
    kit_expect_ok(ctx, bw_tet_mesh_connect(ctx, &t->mesh));
    t->edge_flags = bw_alloc(ctx, t->mesh.edge_count, 1);
    kit_expect_ok(ctx, bw_hex_skin_init(ctx, hex, &skin));
    hex_tets_carry(hex, &skin, t);
    bw_hex_skin_clear(ctx, &skin);
    kit_expect_ok(ctx, bw_hex_surface_build(ctx, &t->mesh, t->edge_flags, &t->surface));
}

static inline void hex_tets_clear(bw_context *ctx, hex_tets *t) {
    bw_hex_surface_clear(ctx, &t->surface);
    bw_tet_mesh_clear(ctx, &t->mesh);
    bw_free(ctx, t->edge_flags);
}

#endif
