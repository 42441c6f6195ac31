/* Stage encode: writes what a job gives back.
 *
 *     traced.hexex   the cell complex as a tet mesh with exact parameters, and its walls   (format/traced.h)
 *     blocks.json    nodes, arcs, patches, blocks                                          (format/blocks_json.h)
 *     constraints.json  with integer lengths: the differences of parameters they ask for   (format/constraints_json.h)
 *     sizes.svg      with a table over sizes: its charts                                   (format/sizes_svg.h)
 *     integer_grid.hexex  with an integer-grid map: that, in units of hexes; with a hex mesh from blocks alone: the block-wise map on a refined mesh,
 *                    unless that has more than 300 000 tets                                (format/igm_hexex.h, igm/overlay.h)
 *     labels.txt, walls.txt  of an input of hexahedra: blocks of its hexes, walls between them (format/hex_labels.h)
 *     hexmesh.*      with a hex mesh: in the formats asked for; of an input of hexahedra without quantization: that, with its blocks (format/hex_write.h)
 *     tmesh.json, tmesh.vtu  if asked for: the T-mesh for solid T-splines                  (format/tmesh_json.h)
 *     view.drc       walls, skins and curves for a viewer                                  (format/view.h)
 *
 * report.json is the pipeline's to write, when the stage's own time is known.
 */
#ifndef BW_STAGE_ENCODE_H
#define BW_STAGE_ENCODE_H

#include "complex/complex.h"
#include "format/report_json.h"
#include "hex/hexmesh.h"
#include "igm/igm.h"

typedef struct {
    bool vtk;              /* also complex.vtm and its files */
    bool tmesh;            /* also tmesh.json and tmesh.vtu */
    unsigned hex_formats;  /* bit 1 << bw_hex_format: write hexmesh.<its name> */
    int bwh_bits;          /* of a coordinate in hexmesh.bwh; 0: lossless */
    const bw_igm *igm;     /* the integer-grid map; NULL: none. Borrowed */
    const bw_hex_mesh *source;      /* the hexes of an input of hexahedra, labelled; NULL: the input has tets. Borrowed */
    const bw_vertex *source_vertex; /* [vertex of source] its number in the input; NULL: the same. Borrowed */
} bw_encode_options;

/* Writes the files into the folder out_dir, which is made if it is missing (its parent is not). Fills quality,
 * compression (of a hex mesh all of whose blocks are grids) and results of the report; its complex.kind says which complex this is. cells was made from mesh and map;
 * all its tets are opened. length: integer lengths of the arcs, or NULL; hex: the hex mesh, or NULL.
 * Each file appears whole or not at all. The same input gives the same bytes. Errors: BW_E_IO, BW_E_MEMORY,
 * BW_E_CHECK, BW_E_CANCELLED. */
bw_status bw_encode(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_cells *cells,
                    const bw_complex *complex, const int64_t *length, const bw_hex_mesh *hex,
                    const bw_encode_options *options, bw_report *report, const char *out_dir);

#endif
