/* VTK's XML form, arrays appended as they are (vtm_file.h tells why they are not compressed; hexmesh.bwh is the small form). */
#include "format/hex_write.h"
#include "format/vtm_file.h"

static void put_mesh(bw_vtm_file *file, const bw_hex_mesh *mesh) {
    bw_vtm_array(file);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int k = 0; k < 3; k++) bw_vtm_float64(file, mesh->position[v][k]);
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++)
        for (int i = 0; i < 8; i++) bw_vtm_int32(file, mesh->hex[h][bw_hex_ring[i]]);
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++) bw_vtm_int64(file, 8 * (int64_t)(h + 1));
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++) bw_vtm_uint8(file, 12);
}

static void put_arrays(bw_vtm_file *file, const bw_hex_mesh *mesh) {
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++) bw_vtm_int32(file, mesh->block[h]);
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++)
        for (int k = 0; k < 3; k++) bw_vtm_int32(file, mesh->ijk[h][k]);
    bw_vtm_array(file);
    for (size_t h = 0; h < mesh->hex_count; h++) bw_vtm_float64(file, bw_hex_write_jacobian(mesh, h));
    bw_vtm_array(file);
    for (size_t v = 0; v < mesh->vertex_count; v++) bw_vtm_uint8(file, mesh->held[v]);
}

bw_status bw_hex_write_vtu(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    (void)skin;
    uint64_t v = mesh->vertex_count, h = mesh->hex_count;
    const bw_vtm_array_info array[] = {
        {BW_VTM_POINTS, "Points", BW_VTM_FLOAT64, 3, 3 * v},     {BW_VTM_CELLS, "connectivity", BW_VTM_INT32, 1, 8 * h},
        {BW_VTM_CELLS, "offsets", BW_VTM_INT64, 1, h},           {BW_VTM_CELLS, "types", BW_VTM_UINT8, 1, h},
        {BW_VTM_CELL_DATA, "block", BW_VTM_INT32, 1, h},         {BW_VTM_CELL_DATA, "ijk", BW_VTM_INT32, 3, 3 * h},
        {BW_VTM_CELL_DATA, "scaled_jacobian", BW_VTM_FLOAT64, 1, h}, {BW_VTM_POINT_DATA, "held", BW_VTM_UINT8, 1, v},
    };
    bw_vtm_file file;
    bw_vtm_begin(ctx, &file, path, v, h, array, sizeof array / sizeof *array);
    put_mesh(&file, mesh);
    put_arrays(&file, mesh);
    return bw_vtm_end(&file, bytes);
}
