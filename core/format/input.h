/* Reads a job's input, tets or hexes, whatever its format. The format is found by what the file begins with, never by its
 * name:
 *
 *     .hexex         a number                               format/hexex.h
 *     VTK, legacy    # vtk DataFile                         format/vtk.h
 *     VTU            < (XML)                                format/vtu.h
 *     Gmsh           $MeshFormat                            format/msh.h
 *     Medit          MeshVersionFormatted, or int 1         format/medit.h     with a side file of parameters
 *     OpenVolumeMesh OVM ASCII                              format/ovm.h
 *
 * All of them give the same mesh for the same numbers, bit for bit. A small example of each is in
 * api/examples/formats.
 *
 * Positions beyond BW_INPUT_POSITION_MAX are refused in all of them (BW_E_NUMBER, with the vertex).
 *
 * To add a format: a reader <name>.h/.c of the form bw_<name>_read_memory, its row in the tables of input.c,
 * a writer of samples in tests/core/input_kit.h, a fuzz target, an example.
 */
#ifndef BW_FORMAT_INPUT_H
#define BW_FORMAT_INPUT_H

#include "base/context.h"
#include "mesh/tetmesh.h"

#define BW_INPUT_POSITION_MAX 1e30

typedef enum {
    BW_INPUT_UNKNOWN,
    BW_INPUT_EMPTY,
    BW_INPUT_HEXEX,
    BW_INPUT_VTK,
    BW_INPUT_VTU,
    BW_INPUT_MSH,
    BW_INPUT_MEDIT,
    BW_INPUT_OVM
} bw_input_format;

/* Looks at the first bytes of an input; a few hundred are enough unless it begins with long comments. */
bw_input_format bw_input_detect(const void *data, size_t size);
const char *bw_input_format_name(bw_input_format format); /* "hexex"; "" if unknown or empty */

/* Reads the file at `path` (a descriptor under /proc/self/fd will do, and a pipe). `parameters_path`: the
 * side file of a Medit mesh, NULL for none; with any other format it is BW_E_PARAMETERS. *mesh is overwritten, and
 * empty after a failure; clear it with bw_tet_mesh_clear. Files are mapped (.hexex: streamed); what cannot be
 * mapped is read into memory, within the job's budget. A file must not shrink while it is read.
 * Errors: BW_E_EMPTY; BW_E_SYNTAX for an unknown format; BW_E_IO; those of the reader. */
bw_status bw_input_read(bw_context *ctx, const char *path, const char *parameters_path, bw_tet_mesh *mesh);
/* The same from memory. `parameters` may be NULL. */
bw_status bw_input_read_memory(bw_context *ctx, const void *data, size_t size, const void *parameters,
                               size_t parameters_size, bw_tet_mesh *mesh);

#endif
