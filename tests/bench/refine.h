/* 1:8 refinement of a tet mesh with parameters: the same map on smaller tets. */
#ifndef BW_TESTS_BENCH_REFINE_H
#define BW_TESTS_BENCH_REFINE_H

#include "mesh/tetmesh.h"

/* Splits every tet at the middles of its edges: four corners, and the octahedron between them in four. `in`
 * is as read, and is connected by this; *out is cleared by the caller, has the parameters and neither walls
 * nor features. Errors: BW_E_MEMORY, and those of bw_tet_mesh_connect. O(tets). */
bw_status bench_refine(bw_context *ctx, bw_tet_mesh *in, bw_tet_mesh *out);

#endif
