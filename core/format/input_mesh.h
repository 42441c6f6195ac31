/* Parts of a mesh that several readers make in the same way. */
#ifndef BW_FORMAT_INPUT_MESH_H
#define BW_FORMAT_INPUT_MESH_H

#include "format/input_scan.h"
#include "mesh/tetmesh.h"

/* Largest counts: every vertex, and every facet and edge derived from the tets, has an index that fits its
 * type. */
#define BW_INPUT_VERTICES_MAX ((int64_t)INT32_MAX)
#define BW_INPUT_TETS_MAX ((int64_t)1 << 28)
#define BW_INPUT_CELLS_MAX ((int64_t)1 << 30) /* elements of every kind, lower-dimensional ones included */

typedef struct {
    size_t room[3];
} bw_input_room;

/* Adds a feature vertex, edge or facet (1, 2 or 3 corners) at the end of its list. */
bw_status bw_input_add_feature(bw_context *ctx, bw_tet_mesh *mesh, bw_input_room *room, int corners,
                               const bw_vertex *corner);

/* Among arrays (fields, properties) that could be the parametrization, the one to take: the one with the best
 * name (parametrization, uvw, param; letters of either case are the same), or the only one. -1: none, -2:
 * several and no such name. */
int64_t bw_input_choose(const char *(*name)(const void *user, size_t i), const void *user, size_t count);

#endif
