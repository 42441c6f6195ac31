/* The outside of a hex mesh, and its irregular edges: what file formats list beside the hexes.
 *
 * A surface is a part of the boundary that edges of the boundary with two hexes hold together: edges with one, three or more end it. So a cube has six, a ball made of
 * a cube has six too, a torus made of a ring of squares four. Surfaces are numbered by their first quad.
 *
 * Invariants: quads ascend by hex and face; irregular edges ascend by their vertices, the lower one first.
 */
#ifndef BW_HEX_SKIN_H
#define BW_HEX_SKIN_H

#include <stdbool.h>

#include "hex/incidence.h"

typedef struct {
    bw_hex hex;
    uint8_t face;    /* 2 * axis + (0 low | 1 high) */
    int32_t surface;
} bw_hex_quad;

/* Irregular: inside and not with four hexes, or of the boundary and not with two. */
typedef struct {
    bw_hvertex vertex[2];
    int32_t valence; /* hexes around it */
    bool boundary;
} bw_hex_edge;

typedef struct {
    size_t quad_count, surface_count, edge_count;
    bw_hex_quad *quad;
    bw_hex_edge *edge;
} bw_hex_skin;

/* Requires indices in range; O(n). Errors: BW_E_MEMORY; BW_E_LIMIT beyond 350 million hexes. After a failure too *skin is to be cleared. */
bw_status bw_hex_skin_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin);
/* `edge` lists all edges, not the irregular ones only. */
bw_status bw_hex_skin_init_all(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin);
void bw_hex_skin_clear(bw_context *ctx, bw_hex_skin *skin);
static inline bw_hvertex bw_hex_quad_vertex(const bw_hex_mesh *mesh, const bw_hex_quad *quad, int corner) {
    return mesh->hex[quad->hex][bw_hex_face_corner[quad->face][corner]];
}

#endif
