/* Legacy VTK, ASCII: read by far more programs than the XML forms. */
#include "format/hex_write.h"
#include "format/output.h"
#include "hex/quality.h"

double bw_hex_write_jacobian(const bw_hex_mesh *mesh, size_t hex) {
    double corner[8][3];
    bw_hex_corners(mesh, (bw_hex)hex, corner);
    return bw_hex_scaled_jacobian((const double(*)[3])corner);
}

static void put_count(bw_output *out, const char *before, size_t count, const char *after) {
    bw_put_text(out, before);
    bw_put_integer(out, (int64_t)count);
    bw_put_text(out, after);
}

static void put_cells(bw_output *out, const bw_hex_mesh *mesh) {
    put_count(out, "CELLS ", mesh->hex_count, " ");
    put_count(out, "", 9 * mesh->hex_count, "\n");
    for (size_t h = 0; h < mesh->hex_count; h++) {
        bw_put_bytes(out, "8", 1);
        for (int i = 0; i < 8; i++) bw_put_bytes(out, " ", 1), bw_put_integer(out, mesh->hex[h][bw_hex_ring[i]]);
        bw_put_bytes(out, "\n", 1);
    }
    put_count(out, "CELL_TYPES ", mesh->hex_count, "\n");
    for (size_t h = 0; h < mesh->hex_count; h++) bw_put_bytes(out, "12\n", 3);
}

static void put_arrays(bw_output *out, const bw_hex_mesh *mesh) {
    put_count(out, "CELL_DATA ", mesh->hex_count, "\nFIELD arrays 3\n");
    put_count(out, "block 1 ", mesh->hex_count, " int\n");
    for (size_t h = 0; h < mesh->hex_count; h++) bw_put_integer(out, mesh->block[h]), bw_put_bytes(out, "\n", 1);
    put_count(out, "ijk 3 ", mesh->hex_count, " int\n");
    for (size_t h = 0; h < mesh->hex_count; h++)
        for (int k = 0; k < 3; k++) bw_put_integer(out, mesh->ijk[h][k]), bw_put_bytes(out, k < 2 ? " " : "\n", 1);
    put_count(out, "scaled_jacobian 1 ", mesh->hex_count, " double\n");
    for (size_t h = 0; h < mesh->hex_count; h++) bw_put_number(out, bw_hex_write_jacobian(mesh, h)), bw_put_bytes(out, "\n", 1);
    put_count(out, "POINT_DATA ", mesh->vertex_count, "\nFIELD arrays 1\n");
    put_count(out, "held 1 ", mesh->vertex_count, " int\n");
    for (size_t v = 0; v < mesh->vertex_count; v++) bw_put_integer(out, mesh->held[v]), bw_put_bytes(out, "\n", 1);
}

bw_status bw_hex_write_vtk(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    (void)skin;
    bw_output out;
    bw_output_open(ctx, &out, path);
    bw_put_text(&out, "# vtk DataFile Version 3.0\nhexahedral mesh\nASCII\nDATASET UNSTRUCTURED_GRID\n");
    put_count(&out, "POINTS ", mesh->vertex_count, " double\n");
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int k = 0; k < 3; k++) bw_put_number(&out, mesh->position[v][k]), bw_put_bytes(&out, k < 2 ? " " : "\n", 1);
    put_cells(&out, mesh);
    put_arrays(&out, mesh);
    return bw_output_close(&out, bytes);
}
