#include "hex/grid.h"

#include <string.h>

bool bw_hex_grid_measure(const bw_hex_mesh *mesh, const bw_hex_groups *blocks, size_t g, uint32_t n[3]) {
    n[0] = n[1] = n[2] = 0;
    for (size_t i = blocks->begin[g]; i < blocks->begin[g + 1]; i++)
        for (int k = 0; k < 3; k++) {
            int32_t at = mesh->ijk[blocks->item[i]][k];
            if (at < 0 || at == INT32_MAX) return false;
            if ((uint32_t)at >= n[k]) n[k] = (uint32_t)at + 1;
        }
    size_t count = blocks->begin[g + 1] - blocks->begin[g];
    return blocks->key[g] != BW_NONE && n[0] <= count && n[1] <= count / n[0] && (size_t)n[0] * n[1] * n[2] == count;
}

bool bw_hex_grid_fill(const bw_hex_mesh *mesh, const bw_hex_groups *blocks, size_t g, const uint32_t n[3], bw_hvertex *vertex) {
    size_t points = bw_hex_grid_points(n);
    memset(vertex, 0xff, points * sizeof *vertex);
    for (size_t i = blocks->begin[g]; i < blocks->begin[g + 1]; i++) {
        size_t h = blocks->item[i];
        const int32_t *at = mesh->ijk[h];
        for (uint32_t c = 0; c < 8; c++) {
            bw_hvertex *to = &vertex[bw_hex_grid_point(n, (uint32_t)at[0] + (c & 1), (uint32_t)at[1] + (c >> 1 & 1), (uint32_t)at[2] + (c >> 2))];
            if (*to >= 0 && *to != mesh->hex[h][c]) return false;
            *to = mesh->hex[h][c];
        }
    }
    for (size_t p = 0; p < points; p++)
        if (vertex[p] < 0) return false;
    return true;
}
