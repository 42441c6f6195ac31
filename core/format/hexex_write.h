/* Writer of .hexex, record by record (the form stands in format/hexex.h).
 *
 *     begin, vertex * N, tets, tet * M, [walls, wall * W], [features, feature vertices, edges, facets], end
 *
 * Every call is cheap and may be left unchecked: the first failure is kept, what follows is dropped, and end returns it.
 * A section that is left before all announced records are written, or overrun, is BW_E_INTERNAL; a failed write is BW_E_IO.
 * Doubles are written as the shortest decimals that read back as the same bits. The file is written in place: who wants it
 * whole or not at all writes under another name and renames it after end.
 */
#ifndef BW_FORMAT_HEXEX_WRITE_H
#define BW_FORMAT_HEXEX_WRITE_H

#include "base/context.h"
#include "base/index.h"
#include "format/output.h"
#include "mesh/tetmesh.h"

typedef enum {
    BW_HEXEX_VERTICES,
    BW_HEXEX_TETS,
    BW_HEXEX_WALLS,
    BW_HEXEX_FEATURE_VERTICES,
    BW_HEXEX_FEATURE_EDGES,
    BW_HEXEX_FEATURE_FACETS,
    BW_HEXEX_SECTIONS
} bw_hexex_section;

typedef struct {
    bw_output out;
    bw_hexex_section section;       /* being written */
    size_t left[BW_HEXEX_SECTIONS]; /* records announced and not yet written */
} bw_hexex_writer;

/* Creates or empties the file at `path` (borrowed until end). bw_hexex_write_end must follow, also after a failure. */
bw_status bw_hexex_write_begin(bw_context *ctx, bw_hexex_writer *w, const char *path, size_t vertex_count);
bw_status bw_hexex_write_vertex(bw_hexex_writer *w, const double position[3]);
bw_status bw_hexex_write_tets(bw_hexex_writer *w, size_t count);
bw_status bw_hexex_write_tet(bw_hexex_writer *w, const bw_vertex corner[4], const double parameter[4][3]);
/* The same with each number as text: a decimal or an exact rational p/q (mpq_get_str writes it), corner by corner. */
bw_status bw_hexex_write_tet_text(bw_hexex_writer *w, const bw_vertex corner[4], const char *const number[12]);
bw_status bw_hexex_write_walls(bw_hexex_writer *w, size_t count);
bw_status bw_hexex_write_wall(bw_hexex_writer *w, const bw_vertex corner[3], double distance);
bw_status bw_hexex_write_features(bw_hexex_writer *w, size_t vertices, size_t edges, size_t facets);
bw_status bw_hexex_write_feature_vertex(bw_hexex_writer *w, bw_vertex vertex);
bw_status bw_hexex_write_feature_edge(bw_hexex_writer *w, const bw_vertex end[2]);
bw_status bw_hexex_write_feature_facet(bw_hexex_writer *w, const bw_vertex corner[3]);
/* Flushes, closes, frees, and returns the first failure of all. bytes (may be NULL): the size of the file. */
bw_status bw_hexex_write_end(bw_hexex_writer *w, uint64_t *bytes);

/* Writes a mesh as read: with its wall list if it has walls, and its feature lists if it has features. */
bw_status bw_hexex_write_mesh(bw_context *ctx, const char *path, const bw_tet_mesh *mesh);

#endif
