#include "format/hex_labels.h"

#include "format/output.h"
#include "hex/incidence.h"

bw_status bw_hex_labels_write(bw_context *ctx, const bw_hex_mesh *source, const char *path, uint64_t *bytes) {
    bw_output out;
    bw_output_open(ctx, &out, path);
    for (size_t h = 0; h < source->hex_count; h++) bw_put_integer(&out, source->block[h]), bw_put_bytes(&out, "\n", 1);
    return bw_output_close(&out, bytes);
}

bw_status bw_hex_walls_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_hex_mesh *source, const bw_vertex *source_vertex,
                             const char *path, uint64_t *bytes) {
    uint8_t *wall;
    bw_status status = bw_trivial_walls(ctx, cells, complex, source, &wall);
    if (status != BW_OK) return status;
    bw_output out;
    bw_output_open(ctx, &out, path);
    for (size_t x = 0; x < 6 * source->hex_count; x++) {
        if (!wall[x]) continue;
        for (int i = 0; i < 4; i++) {
            bw_hvertex v = source->hex[x / 6][bw_hex_face_corner[x % 6][i]];
            bw_put_integer(&out, source_vertex ? source_vertex[v] : v);
            bw_put_bytes(&out, i < 3 ? " " : "\n", 1);
        }
    }
    bw_free(ctx, wall);
    return bw_output_close(&out, bytes);
}
