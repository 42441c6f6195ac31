/* Abaqus. One element list in the order of the mesh; sets and surfaces name what is in them. */
#include "hex/groups.h"
#include "format/hex_write.h"
#include "format/output.h"

enum { INP_PER_LINE = 16 };
static const char side_of_face[6] = {'6', '4', '3', '5', '1', '2'}; /* S1 .. S6 of C3D8 */

/* A keyword line that ends with the name of a set. */
static void put_keyword(bw_output *out, const char *keyword, int32_t key, const char *after) {
    bw_put_text(out, keyword);
    if (key == BW_NONE) bw_put_text(out, "NONE");
    else bw_put_integer(out, key);
    bw_put_text(out, after);
}

static void put_member(bw_output *out, size_t index, size_t *on_line) {
    if (*on_line == INP_PER_LINE) bw_put_bytes(out, "\n", 1), *on_line = 0;
    else if (*on_line) bw_put_bytes(out, ", ", 2);
    bw_put_integer(out, (int64_t)index + 1);
    (*on_line)++;
}

static void put_nodes(bw_output *out, const bw_hex_mesh *mesh) {
    bw_put_text(out, "*NODE\n");
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        bw_put_integer(out, (int64_t)v + 1);
        for (int k = 0; k < 3; k++) bw_put_bytes(out, ", ", 2), bw_put_number(out, mesh->position[v][k]);
        bw_put_bytes(out, "\n", 1);
    }
    bw_put_text(out, "*ELEMENT, TYPE=C3D8, ELSET=HEXES\n");
    for (size_t h = 0; h < mesh->hex_count; h++) {
        bw_put_integer(out, (int64_t)h + 1);
        for (int i = 0; i < 8; i++) bw_put_bytes(out, ", ", 2), bw_put_integer(out, (int64_t)mesh->hex[h][bw_hex_ring[i]] + 1);
        bw_put_bytes(out, "\n", 1);
    }
}

static void put_blocks(bw_output *out, const bw_hex_groups *blocks) {
    for (size_t g = 0; g < blocks->count; g++) {
        size_t on_line = 0;
        put_keyword(out, "*ELSET, ELSET=BLOCK_", blocks->key[g], "\n");
        for (size_t i = blocks->begin[g]; i < blocks->begin[g + 1]; i++) put_member(out, blocks->item[i], &on_line);
        bw_put_bytes(out, "\n", 1);
    }
}

/* The nodes of a surface, each once; seen[v]: the last surface + 1 that had v. */
static void put_surface_nodes(bw_output *out, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_groups *surfaces, size_t g, int32_t *seen) {
    size_t on_line = 0;
    int32_t mark = surfaces->key[g] + 1;
    put_keyword(out, "*NSET, NSET=SURFACE_", surfaces->key[g], "\n");
    for (size_t i = surfaces->begin[g]; i < surfaces->begin[g + 1]; i++)
        for (int c = 0; c < 4; c++) {
            bw_hvertex v = bw_hex_quad_vertex(mesh, &skin->quad[surfaces->item[i]], c);
            if (seen[v] != mark) put_member(out, (size_t)v, &on_line);
            seen[v] = mark;
        }
    bw_put_bytes(out, "\n", 1);
}

static void put_surface(bw_output *out, const bw_hex_skin *skin, const bw_hex_groups *surfaces, size_t g) {
    put_keyword(out, "*SURFACE, TYPE=ELEMENT, NAME=SURFACE_", surfaces->key[g], "\n");
    for (size_t i = surfaces->begin[g]; i < surfaces->begin[g + 1]; i++) {
        const bw_hex_quad *quad = &skin->quad[surfaces->item[i]];
        bw_put_integer(out, (int64_t)quad->hex + 1);
        bw_put_bytes(out, ", S", 3);
        bw_put_bytes(out, &side_of_face[quad->face], 1);
        bw_put_bytes(out, "\n", 1);
    }
}

bw_status bw_hex_write_inp(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    bw_hex_groups blocks = {0}, surfaces = {0};
    int32_t *seen = bw_alloc(ctx, mesh->vertex_count, sizeof *seen);
    bw_status status = seen ? bw_hex_groups_of_blocks(ctx, mesh, &blocks) : ctx->error.status;
    if (status == BW_OK) status = bw_hex_groups_of_surfaces(ctx, skin, &surfaces);
    if (status == BW_OK) {
        bw_output out;
        bw_output_open(ctx, &out, path);
        bw_put_text(&out, "*HEADING\nhexahedral mesh\n");
        put_nodes(&out, mesh);
        put_blocks(&out, &blocks);
        for (size_t g = 0; g < surfaces.count; g++) put_surface_nodes(&out, mesh, skin, &surfaces, g, seen);
        for (size_t g = 0; g < surfaces.count; g++) put_surface(&out, skin, &surfaces, g);
        status = bw_output_close(&out, bytes);
    }
    bw_hex_groups_clear(ctx, &blocks);
    bw_hex_groups_clear(ctx, &surfaces);
    bw_free(ctx, seen);
    return status;
}
