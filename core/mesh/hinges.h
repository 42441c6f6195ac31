/* Hinges: the tets around every edge, in order.
 *
 * The tets around an edge form fans in which consecutive tets share a facet; a hinge is one such fan. A
 * manifold edge has one hinge; an edge in which parts of the mesh merely touch has several, and what is said
 * about them is said of each apart.
 *
 * Invariants
 *  1. Hinges are numbered by edge; the hinges of edge e are first[e] .. first[e + 1] - 1.
 *  2. Seen with the edge (edge[e][0] -> edge[e][1]) pointing at the viewer, tet[i] .. tet[i + 1] turn
 * counterclockwise, provided that tets are positive; exit[i] is the facet between tet[i] and its successor.
 *  3. An open hinge starts at a boundary facet, its entry, and ends at another; the entry of a closed one is
 * its last exit.
 */
#ifndef BW_MESH_HINGES_H
#define BW_MESH_HINGES_H

#include "mesh/tetmesh.h"

typedef int32_t bw_hinge;

typedef struct {
    bw_edge edge;
    bw_facet entry;
    int32_t begin, end; /* into tet and exit */
    bool open;          /* on the boundary */
} bw_ring;

typedef struct {
    size_t count;
    bw_hinge *first;         /* [edge + 1] */
    bw_ring *ring;           /* [hinge] */
    bw_tet *tet;             /* [6 per tet] */
    bw_facet *exit;          /* [6 per tet] */
    bw_hinge (*of_facet)[3]; /* [facet][i]: hinge of the edge opposite vertex i of the facet */
} bw_hinges;

/* Corners of a tet ordered for an edge: out[0] and out[1] on the edge, the lower vertex first, and (out[0] ..
 * out[3]) an even permutation, so that in a positive tet out[2] turns to out[3] counterclockwise. */
void bw_hinge_corners(const bw_tet_mesh *mesh, bw_tet tet, int local_edge, int out[4]);

/* Requires a connected mesh. BW_E_INVERTED, with the facets, if two tets that share a facet are oriented
 * oppositely: they lie on the same side of it in the parametrization. O(tets). */
bw_status bw_hinges_init(bw_context *ctx, bw_hinges *hinges, const bw_tet_mesh *mesh);
void bw_hinges_clear(bw_context *ctx, bw_hinges *hinges);

/* The facet through which tet i of the ring (an index into tet) is entered. */
static inline bw_facet bw_hinge_enter(const bw_hinges *hinges, bw_hinge h, int32_t i) {
    return i == hinges->ring[h].begin ? hinges->ring[h].entry : hinges->exit[i - 1];
}

#endif
