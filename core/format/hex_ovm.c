/* OpenVolumeMesh, text form: edges, faces made of halfedges, cells made of halffaces.
 *
 * A cell lists its halffaces low 0, high 0, low 1, high 1, low 2, high 2, all seen counter-clockwise from inside the cell: the order that its kernel for hexahedral meshes asks
 * for, and the sense in which its tets have theirs.
 */
#include "format/hex_write.h"
#include "format/output.h"

static void put_title(bw_output *out, const char *title, size_t count) {
    bw_put_text(out, title);
    bw_put_bytes(out, "\n", 1);
    bw_put_integer(out, (int64_t)count);
    bw_put_bytes(out, "\n", 1);
}

static void put_edges(bw_output *out, const bw_hex_mesh *mesh, const bw_hex_edges *edges) {
    put_title(out, "Edges", edges->begin[mesh->vertex_count]);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (uint32_t e = edges->begin[v]; e < edges->begin[v + 1]; e++) {
            bw_put_integer(out, (int64_t)v), bw_put_bytes(out, " ", 1);
            bw_put_integer(out, edges->high[e]), bw_put_bytes(out, "\n", 1);
        }
}

/* A quad is listed as the hex that comes first sees it from inside, so that hex has its halfface 2 * face, the other one 2 * face + 1. */
static bool is_first(const uint32_t *mate, size_t x) {
    return mate[x] == BW_HEX_NO_MATE || x < mate[x];
}

static void put_face(bw_output *out, const bw_hex_mesh *mesh, const bw_hex_edges *edges, size_t x) {
    bw_put_bytes(out, "4", 1);
    for (int i = 3; i >= 0; i--) {
        const uint8_t *c = bw_hex_face_corner[x % 6];
        bw_hvertex a = mesh->hex[x / 6][c[(i + 1) & 3]], b = mesh->hex[x / 6][c[i]];
        bw_put_bytes(out, " ", 1);
        bw_put_integer(out, 2 * (int64_t)bw_hex_edges_find(edges, a, b) + (a > b));
    }
    bw_put_bytes(out, "\n", 1);
}

/* halfface: [6 * hex + face], filled here. */
static void put_faces(bw_output *out, const bw_hex_mesh *mesh, const bw_hex_edges *edges, const uint32_t *mate, uint32_t *halfface) {
    size_t count = 0;
    for (size_t x = 0; x < 6 * mesh->hex_count; x++) count += is_first(mate, x);
    put_title(out, "Faces", count);
    uint32_t next = 0;
    for (size_t x = 0; x < 6 * mesh->hex_count; x++) {
        if (!is_first(mate, x)) continue;
        put_face(out, mesh, edges, x);
        halfface[x] = next;
        if (mate[x] != BW_HEX_NO_MATE) halfface[mate[x]] = next + 1;
        next += 2;
    }
}

static void put_cells(bw_output *out, const bw_hex_mesh *mesh, const uint32_t *halfface) {
    put_title(out, "Polyhedra", mesh->hex_count);
    for (size_t h = 0; h < mesh->hex_count; h++) {
        bw_put_bytes(out, "6", 1);
        for (size_t f = 0; f < 6; f++) bw_put_bytes(out, " ", 1), bw_put_integer(out, halfface[6 * h + f]);
        bw_put_bytes(out, "\n", 1);
    }
    bw_put_text(out, "CProp int \"block\"\n");
    for (size_t h = 0; h < mesh->hex_count; h++) bw_put_integer(out, mesh->block[h]), bw_put_bytes(out, "\n", 1);
    bw_put_text(out, "VProp int \"held\"\n");
    for (size_t v = 0; v < mesh->vertex_count; v++) bw_put_integer(out, mesh->held[v]), bw_put_bytes(out, "\n", 1);
}

bw_status bw_hex_write_ovm(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    (void)skin;
    bw_hex_edges edges = {0};
    uint32_t *mate = NULL, *halfface = NULL;
    bw_status status = bw_hex_edges_init(ctx, mesh, &edges);
    if (status == BW_OK) status = bw_hex_mates(ctx, mesh, &mate);
    if (status == BW_OK && !(halfface = bw_alloc(ctx, 6 * mesh->hex_count, sizeof *halfface))) status = ctx->error.status;
    if (status == BW_OK) {
        bw_output out;
        bw_output_open(ctx, &out, path);
        bw_put_text(&out, "OVM ASCII\n");
        put_title(&out, "Vertices", mesh->vertex_count);
        for (size_t v = 0; v < mesh->vertex_count; v++)
            for (int k = 0; k < 3; k++) bw_put_number(&out, mesh->position[v][k]), bw_put_bytes(&out, k < 2 ? " " : "\n", 1);
        put_edges(&out, mesh, &edges);
        put_faces(&out, mesh, &edges, mate, halfface);
        put_cells(&out, mesh, halfface);
        status = bw_output_close(&out, bytes);
    }
    bw_hex_edges_clear(ctx, &edges);
    bw_free(ctx, mate);
    bw_free(ctx, halfface);
    return status;
}
