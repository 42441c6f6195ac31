/* What of a hex mesh meets what: mates across quads, and the edges with their hexes counted.
 *
 * Everything is found by sorting into buckets by lowest vertex, so time and memory are linear and the order is that of the mesh.
 * Errors: BW_E_MEMORY; BW_E_LIMIT beyond 350 million hexes. Indices must be in range.
 */
#ifndef BW_HEX_INCIDENCE_H
#define BW_HEX_INCIDENCE_H

#include "hex/hexmesh.h"

#define BW_HEX_NO_MATE UINT32_MAX

extern const uint8_t bw_hex_face_corner[6][4]; /* of a face, counter-clockwise seen from outside a positive hex */
extern const uint8_t bw_hex_edge_corner[12][2];

/* *mate (owned by the caller): [6 * hex + face] the same quad as 6 * hex + face of its other hex; BW_HEX_NO_MATE on the boundary. Where more than two
 * quads have the same vertices, or two that are joined by other edges, which no mesh that passes its check has, some stay without. */
bw_status bw_hex_mates(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t **mate);
/* The same; *crowd is the lowest of such quads, or BW_HEX_NO_MATE. */
bw_status bw_hex_mates_and_crowd(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t **mate, uint32_t *crowd);

/* All edges, ascending by lower vertex, then by higher one. */
typedef struct {
    uint32_t *begin;     /* [vertex + 1] edges whose lower vertex it is */
    bw_hvertex *high;    /* [edge] their other vertex */
    int32_t *valence;    /* [edge] hexes around it */
} bw_hex_edges;

bw_status bw_hex_edges_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_edges *edges);
void bw_hex_edges_clear(bw_context *ctx, bw_hex_edges *edges);
/* The edge between two vertices, in either order; there must be one. */
static inline uint32_t bw_hex_edges_find(const bw_hex_edges *edges, bw_hvertex a, bw_hvertex b) {
    bw_hvertex low = a < b ? a : b, high = a < b ? b : a;
    uint32_t e = edges->begin[low], end = edges->begin[low + 1];
    while (end - e > 16) { /* high[e] <= high < high[end] */
        uint32_t middle = e + (end - e) / 2;
        if (edges->high[middle] <= high) e = middle;
        else end = middle;
    }
    while (edges->high[e] != high) e++;
    return e;
}

#endif
