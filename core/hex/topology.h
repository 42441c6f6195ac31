/* Euler characteristic and connected components of a hex mesh and of a tet mesh: what a hex mesh has in common with the mesh it was made from. */
#ifndef BW_HEX_TOPOLOGY_H
#define BW_HEX_TOPOLOGY_H

#include "hex/hexmesh.h"
#include "mesh/tetmesh.h"

typedef struct {
    int64_t euler; /* vertices - edges + faces - cells */
    size_t components;
} bw_topology;

/* Requires a mesh that bw_hex_mesh_check accepts. O(n). */
bw_status bw_hex_mesh_topology(bw_context *ctx, const bw_hex_mesh *mesh, bw_topology *out);
/* Of the vertices that tets use. Requires a connected (bw_tet_mesh_connect) mesh. O(n). */
bw_status bw_tet_mesh_topology(bw_context *ctx, const bw_tet_mesh *mesh, bw_topology *out);

#endif
