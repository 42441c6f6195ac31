/* The blocks of a hexahedral input, as text for whatever else works on that file.
 *
 *     labels.txt   the index of its block (blocks.json) for every hex, in the order of the input, one a line
 *     walls.txt    the quads inside that are walls, as their four vertices around, numbered from 0 as in the input, one a line. Labels alone do not tell where a block
 *                  that touches itself is parted from itself
 */
#ifndef BW_FORMAT_HEX_LABELS_H
#define BW_FORMAT_HEX_LABELS_H

#include "hex/trivial.h"

/* BW_E_IO, BW_E_MEMORY, BW_E_CANCELLED. *bytes: the file's size. */
bw_status bw_hex_labels_write(bw_context *ctx, const bw_hex_mesh *source, const char *path, uint64_t *bytes);
/* `source_vertex`: [vertex] its number in the input; NULL: the same. */
bw_status bw_hex_walls_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_hex_mesh *source, const bw_vertex *source_vertex,
                             const char *path, uint64_t *bytes);

#endif
