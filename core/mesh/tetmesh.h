/* Tet mesh: the input's vertices and tets, and the connectivity derived from them.
 *
 *            3                 local facets: facet i is opposite corner i
 *           /|\                local edges:  0:(0,1) 1:(0,2) 2:(0,3) 3:(1,2) 4:(1,3) 5:(2,3)
 *          / | \               a tet is positive if (p1-p0) x (p2-p0) . (p3-p0) > 0
 *         /  |  \              (in the parametrization)
 *        0---|---2
 *         \  |  /
 *          \ | /
 *            1
 *
 * Invariants after bw_tet_mesh_connect
 *  1. facet[f] and edge[e] list vertices in ascending order; facets and edges are numbered by those lists, ascending.
 *  2. facet_tet[f][0] < facet_tet[f][1]; facet_tet[f][1] is BW_NONE on the boundary.
 *  3. Tets are ordered by their vertices, lowest first, so nothing that is computed depends on their order in the file.
 *  4. No tet repeats a vertex, no two tets have the same vertices, no facet has more than two tets.
 * Vertices that no tet uses are kept and have no other part in anything.
 */
#ifndef BW_MESH_TETMESH_H
#define BW_MESH_TETMESH_H

#include "base/context.h"
#include "base/index.h"

typedef struct {
    size_t vertex_count, tet_count, facet_count, edge_count;
    double (*position)[3];   /* [vertex][xyz] */
    bw_vertex (*tet)[4];     /* [tet][corner] */
    double (*parameter)[4][3]; /* [tet][corner][axis], as read (nearest doubles); NULL once sanitized */

    /* An input of hexahedra instead of tets, as read, corners by bits (hex/hexmesh.h): until hex/trivial.h makes tets of it. */
    size_t hex_count, feature_quad_count;
    bw_vertex (*hex)[8];
    bw_vertex (*feature_quad)[4]; /* around */

    bw_tet *tet_id;          /* [tet]: its number in the input; if that is of hexahedra, the number of its hex */
    bw_facet (*tet_facet)[4];
    bw_edge (*tet_edge)[6];
    bw_vertex (*facet)[3];
    bw_tet (*facet_tet)[2];
    bw_vertex (*edge)[2];

    /* Optional lists of the input. A wall list comes with traced meshes; features are marked by the user. */
    size_t wall_count, feature_vertex_count, feature_edge_count, feature_facet_count;
    bw_vertex (*wall)[3];
    double *wall_distance;
    bw_vertex *feature_vertex;
    bw_vertex (*feature_edge)[2];
    bw_vertex (*feature_facet)[3];

    uint8_t of_hexes; /* made of hexes, each a unit cube of the map (hex/trivial.h): walls run along facets only, and distances are counted in hexes */
    uint8_t mirrored; /* the input listed negative tets: corners 2 and 3 of every tet were swapped */
} bw_tet_mesh;

extern const uint8_t bw_tet_edge_corners[6][2];
extern const uint8_t bw_tet_edge_of[4][4]; /* local edge between two corners (undefined on the diagonal) */

/* Puts the tets, with their parameters, in order and sets tet_id. O(n log n), O(n) if they are in order. */
bw_status bw_tet_mesh_order(bw_context *ctx, bw_tet_mesh *mesh);
/* Derives facets and edges, after ordering if that was not done. Errors: BW_E_DUPLICATE, BW_E_NONMANIFOLD, with the tets at fault, as
 * everywhere by their numbers in the input. O(n). */
bw_status bw_tet_mesh_connect(bw_context *ctx, bw_tet_mesh *mesh);
void bw_tet_mesh_clear(bw_context *ctx, bw_tet_mesh *mesh);

/* The facet or edge with these vertices, in any order; BW_NONE if the mesh has none. O(log n). */
bw_facet bw_tet_mesh_find_facet(const bw_tet_mesh *mesh, const bw_vertex vertex[3]);
bw_edge bw_tet_mesh_find_edge(const bw_tet_mesh *mesh, const bw_vertex vertex[2]);

/* Local corner of `vertex` in `tet`; -1 if it is not one. */
static inline int bw_tet_corner(const bw_tet_mesh *mesh, bw_tet tet, bw_vertex vertex) {
    for (int i = 0; i < 4; i++)
        if (mesh->tet[tet][i] == vertex) return i;
    return -1;
}
/* The tet across a facet; BW_NONE on the boundary. */
static inline bw_tet bw_tet_across(const bw_tet_mesh *mesh, bw_facet facet, bw_tet from) {
    return mesh->facet_tet[facet][mesh->facet_tet[facet][0] == from];
}
void bw_facet_centre(const bw_tet_mesh *mesh, bw_facet facet, double out[3]);
void bw_tet_centre(const bw_tet_mesh *mesh, bw_tet tet, double out[3]);
void bw_edge_centre(const bw_tet_mesh *mesh, bw_edge edge, double out[3]);

#endif
