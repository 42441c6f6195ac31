#include "format/hex_write.h"
#include "format/tmesh_json.h"
#include "format/vtm_file.h"

/* Edges of a cell on extraordinary arcs: by vertices, so without T-joints on them, which there are none of. */
static int extraordinary_edges(const bw_tmesh *mesh, const bw_tcell *cell) {
    int count = 0;
    for (int e = 0; e < 12; e++) {
        int axis = e >> 2, corner = (e & 1) << (axis + 1) % 3 | (e >> 1 & 1) << (axis + 2) % 3;
        count += mesh->vertex_flags[cell->corner[corner]] & mesh->vertex_flags[cell->corner[corner | 1 << axis]] & BW_TVERTEX_EXTRAORDINARY ? 1 : 0;
    }
    return count;
}

static void put_grid(bw_vtm_file *file, const bw_tmesh *mesh, const double (*position)[3]) {
    bw_vtm_array(file);
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int k = 0; k < 3; k++) bw_vtm_float64(file, position[v][k]);
    bw_vtm_array(file);
    for (size_t c = 0; c < mesh->cell_count; c++)
        for (int i = 0; i < 8; i++) bw_vtm_int32(file, mesh->cell[c].corner[bw_hex_ring[i]]);
    bw_vtm_array(file);
    for (size_t c = 0; c < mesh->cell_count; c++) bw_vtm_int64(file, 8 * (int64_t)(c + 1));
    bw_vtm_array(file);
    for (size_t c = 0; c < mesh->cell_count; c++) bw_vtm_uint8(file, 12);
}

static void put_arrays(bw_vtm_file *file, const bw_tmesh *mesh) {
    bw_vtm_array(file);
    for (size_t c = 0; c < mesh->cell_count; c++) bw_vtm_int32(file, mesh->cell[c].block);
    bw_vtm_array(file);
    for (size_t c = 0; c < mesh->cell_count; c++) bw_vtm_uint8(file, (uint8_t)extraordinary_edges(mesh, &mesh->cell[c]));
    bw_vtm_array(file);
    for (size_t v = 0; v < mesh->vertex_count; v++) bw_vtm_uint8(file, (mesh->vertex_flags[v] & BW_TVERTEX_BOUNDARY) != 0);
    bw_vtm_array(file);
    for (size_t v = 0; v < mesh->vertex_count; v++) bw_vtm_uint8(file, (mesh->vertex_flags[v] & BW_TVERTEX_EXTRAORDINARY) != 0);
}

bw_status bw_tmesh_write_vtu(bw_context *ctx, const bw_tmesh *mesh, const double (*position)[3], const char *path, uint64_t *bytes) {
    uint64_t v = mesh->vertex_count, c = mesh->cell_count;
    const bw_vtm_array_info array[] = {
        {BW_VTM_POINTS, "Points", BW_VTM_FLOAT64, 3, 3 * v},     {BW_VTM_CELLS, "connectivity", BW_VTM_INT32, 1, 8 * c},
        {BW_VTM_CELLS, "offsets", BW_VTM_INT64, 1, c},           {BW_VTM_CELLS, "types", BW_VTM_UINT8, 1, c},
        {BW_VTM_CELL_DATA, "block", BW_VTM_INT32, 1, c},         {BW_VTM_CELL_DATA, "extraordinary", BW_VTM_UINT8, 1, c},
        {BW_VTM_POINT_DATA, "boundary", BW_VTM_UINT8, 1, v},     {BW_VTM_POINT_DATA, "extraordinary", BW_VTM_UINT8, 1, v},
    };
    bw_vtm_file file;
    bw_vtm_begin(ctx, &file, path, v, c, array, sizeof array / sizeof *array);
    put_grid(&file, mesh, position);
    put_arrays(&file, mesh);
    return bw_vtm_end(&file, bytes);
}
