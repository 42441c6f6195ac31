#include "format/hex_write.h"
#include "format/output.h"

static void put_title(bw_output *out, const char *title, size_t count) {
    bw_put_text(out, title);
    bw_put_bytes(out, "\n", 1);
    bw_put_integer(out, (int64_t)count);
    bw_put_bytes(out, "\n", 1);
}

static void put_reference(bw_output *out, int64_t value) {
    bw_put_integer(out, value);
    bw_put_bytes(out, "\n", 1);
}

static void put_index(bw_output *out, bw_hvertex v) {
    bw_put_integer(out, (int64_t)v + 1);
    bw_put_bytes(out, " ", 1);
}

static void put_points(bw_output *out, const bw_hex_mesh *mesh, const char *title) {
    size_t count = 0;
    for (size_t v = 0; v < mesh->vertex_count; v++) count += mesh->held[v] == BW_HELD_POINT;
    if (!count) return;
    put_title(out, title, count);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        if (mesh->held[v] == BW_HELD_POINT) put_reference(out, (int64_t)v + 1);
}

static void put_edges(bw_output *out, const bw_hex_skin *skin) {
    size_t boundary = 0;
    if (!skin->edge_count) return;
    put_title(out, "Edges", skin->edge_count);
    for (size_t e = 0; e < skin->edge_count; e++) {
        const bw_hex_edge *edge = &skin->edge[e];
        put_index(out, edge->vertex[0]), put_index(out, edge->vertex[1]);
        put_reference(out, edge->valence);
        boundary += edge->boundary;
    }
    if (!boundary) return;
    put_title(out, "Ridges", boundary);
    for (size_t e = 0; e < skin->edge_count; e++)
        if (skin->edge[e].boundary) put_reference(out, (int64_t)e + 1);
}

static void put_hexes(bw_output *out, const bw_hex_mesh *mesh) {
    put_title(out, "Hexahedra", mesh->hex_count);
    for (size_t h = 0; h < mesh->hex_count; h++) {
        for (int i = 0; i < 8; i++) put_index(out, mesh->hex[h][bw_hex_ring[i]]);
        put_reference(out, (int64_t)mesh->block[h] + 1);
    }
}

bw_status bw_hex_write_medit(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    bw_output out;
    bw_output_open(ctx, &out, path);
    bw_put_text(&out, "MeshVersionFormatted 2\nDimension 3\n");
    put_title(&out, "Vertices", mesh->vertex_count);
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        for (int k = 0; k < 3; k++) bw_put_number(&out, mesh->position[v][k]), bw_put_bytes(&out, " ", 1);
        put_reference(&out, mesh->held[v]);
    }
    put_points(&out, mesh, "Corners");
    put_points(&out, mesh, "RequiredVertices");
    put_edges(&out, skin);
    put_title(&out, "Quadrilaterals", skin->quad_count);
    for (size_t q = 0; q < skin->quad_count; q++) {
        for (int i = 0; i < 4; i++) put_index(&out, bw_hex_quad_vertex(mesh, &skin->quad[q], i));
        put_reference(&out, (int64_t)skin->quad[q].surface + 1);
    }
    put_hexes(&out, mesh);
    bw_put_text(&out, "End\n");
    return bw_output_close(&out, bytes);
}
