/* Parts of a mesh that several readers make in the same way. */
#ifndef BW_FORMAT_INPUT_MESH_H
#define BW_FORMAT_INPUT_MESH_H

#include "format/input_scan.h"
#include "mesh/tetmesh.h"

/* Largest counts: every vertex, and every facet and edge derived from the tets, has an index that fits its
 * type. */
#define BW_INPUT_VERTICES_MAX ((int64_t)INT32_MAX)
#define BW_INPUT_TETS_MAX ((int64_t)1 << 28)
#define BW_INPUT_HEXES_MAX ((int64_t)1 << 25)
#define BW_INPUT_CELLS_MAX ((int64_t)1 << 30) /* elements of every kind, lower-dimensional ones included */

typedef struct {
    size_t room[4];
} bw_input_room;

/* Adds a feature vertex, edge, facet or quad (1 to 4 corners) at the end of its list. */
bw_status bw_input_add_feature(bw_context *ctx, bw_tet_mesh *mesh, bw_input_room *room, int corners,
                               const bw_vertex *corner);

/* Turns the corners of a hex as most formats list them, around the low face, then around the high one, to those by bits (hex/hexmesh.h). */
void bw_input_from_ring(bw_vertex hex[8]);

/* Refuses a mesh that has no cells, or both tets and hexes, and features that are no face of its cells. `place`: what errors tell. BW_E_EMPTY, BW_E_SYNTAX
 * with the first hex, BW_E_INDEX. */
bw_status bw_input_check_cells(bw_scan *place, const bw_tet_mesh *mesh);

/* Among arrays (fields, properties) that could be the parametrization, the one to take: the one with the best
 * name (parametrization, uvw, param; letters of either case are the same), or the only one. -1: none, -2:
 * several and no such name. */
int64_t bw_input_choose(const char *(*name)(const void *user, size_t i), const void *user, size_t count);

#endif
