/* A block of a hex mesh as a grid of vertices: for formats that write blocks as grids. */
#ifndef BW_HEX_GRID_H
#define BW_HEX_GRID_H

#include "hex/groups.h"

/* Number of a grid point, or of a cell of a grid that has one less along each axis: the first axis fastest. */
static inline size_t bw_hex_grid_point(const uint32_t n[3], uint32_t x, uint32_t y, uint32_t z) {
    return x + ((size_t)n[0] + 1) * (y + ((size_t)n[1] + 1) * z);
}
static inline size_t bw_hex_grid_points(const uint32_t n[3]) {
    return bw_hex_grid_point(n, n[0], n[1], n[2]) + 1;
}

/* Hexes along the axes of group g, if it is a known block and their number is that of a box. */
bool bw_hex_grid_measure(const bw_hex_mesh *mesh, const bw_hex_groups *blocks, size_t g, uint32_t n[3]);
/* vertex: [bw_hex_grid_points]. false if its hexes disagree about a point, or some place of the box has none. */
bool bw_hex_grid_fill(const bw_hex_mesh *mesh, const bw_hex_groups *blocks, size_t g, const uint32_t n[3], bw_hvertex *vertex);

#endif
