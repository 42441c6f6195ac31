/* The base complex of a hex mesh, found on its quads: sheets from all irregular edges, each as far as it goes (MC 2, 5.1 without the stopping; Q 7.2.1 counts its blocks).
 *
 * Shares nothing with tracing, and so is a check of it: the base complex that the pipeline finds by the trivial map has the same blocks. Feature quads, edges and points
 * are not looked at. Tori are one block, as they are after they are split (MC 5.3).
 */
#ifndef BW_HEX_BASE_COMPLEX_H
#define BW_HEX_BASE_COMPLEX_H

#include "hex/incidence.h"
#include "hex/plan.h"

typedef struct {
    uint64_t blocks;
    uint64_t wall_quads;      /* inside */
    uint64_t irregular_edges; /* inside with other than four hexes, on the boundary with other than two */
} bw_hex_base_complex;

/* Requires a mesh that bw_hex_mesh_check accepts. block: [hex] its block, numbered by first hex; NULL: not wanted. O(hexes). Errors: BW_E_MEMORY, BW_E_CANCELLED; BW_E_LIMIT beyond 350 million hexes. */
bw_status bw_hex_find_base_complex(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_base_complex *found, bw_block *block);

/* The same of the mesh that a quantization promises, which need not be made. Also BW_E_CHECK if the plan has a gap. O(hexes * squares of a side). */
bw_status bw_hex_plan_base_complex(bw_context *ctx, const bw_hex_plan *plan, bw_hex_base_complex *found);

#endif
