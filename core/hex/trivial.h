/* The trivial map of a hexahedral mesh (Q 7.2.1): the mesh as tets whose parameters make every hex a unit cube. With it a hex mesh is a tet mesh with an exact
 * seamless map, and whatever is done to those is done to hexes (MC 5.1): iso-surfaces through singular edges run along the faces of hexes, so no tet is cut, and walls are
 * the quads that they would be if fire burnt on the hex mesh itself (MC Algorithm 1).
 *
 * A hex is six tets: its lowest vertex joined to the halves of the three faces that do not have it, every face being halved from its lowest vertex. So neighbours agree, no
 * vertex is added, and the tets do not depend on the order of the hexes. Where that would give two edges the same two vertices, as hexes that share two faces do, the face
 * is cut from its centre into four, and hexes with such faces are joined to their own centres; the vertices of these centres come after those of the input.
 *
 * Charts: neighbours share one wherever that is possible, breadth first over the hexes of a component from the one with the lowest vertices. Grid units: the edge of a
 * hex is 2^exponent, as large as the grid allows, for what comes later may need places inside hexes.
 */
#ifndef BW_HEX_TRIVIAL_H
#define BW_HEX_TRIVIAL_H

#include "complex/complex.h"
#include "hex/hexmesh.h"

typedef struct {
    size_t crossed;  /* faces cut into four */
    size_t centred;  /* hexes joined to their centres */
    bool mirrored;   /* the input lists left-handed corners: `source` has them mirrored along the first axis */
} bw_trivial_report;

/* Requires the hexes of mesh->hex, as read. Checks them (bw_hex_mesh_check_input) and moves them to *source, right-handed as a whole, without blocks, without `held`. *mesh
 * becomes their tets, ordered, tet_id the number of the hex; map->value and map->exponent are set. Vertices that are in no hex are dropped: *source_vertex ([vertex of
 * *source], its number in the input) is NULL if there were none. Feature quads become feature facets.
 * Errors: BW_E_DUPLICATE, BW_E_NONMANIFOLD, BW_E_INVERTED, BW_E_INDEX (a feature edge at a dropped vertex), BW_E_LIMIT, BW_E_MEMORY; what was made until then is for the clear functions. O(n log n). */
bw_status bw_trivial_map(bw_context *ctx, bw_tet_mesh *mesh, bw_grid_map *map, bw_hex_mesh *source, bw_vertex **source_vertex, bw_trivial_report *report);

/* Gives every hex of `source` its block and its place there, and turns its corners to the axes of the block. `cells` and `complex` are of the trivial map. May be
 * done again for another complex. The result is proved by invariant 4 of bw_hex_mesh_check. BW_E_CHECK if a wall runs through a hex. O(tets). */
bw_status bw_trivial_label(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_hex_mesh *source);

/* What every vertex of `source` lies on (bw_hex_mesh.held, .carrier). O(tets). */
bw_status bw_trivial_hold(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_hex_mesh *source);

/* Which faces of the hexes are walls inside: *wall ([6 * hex + face], owned by the caller) is set for one of both faces of each, the lower one. Requires labels. O(polygons). */
bw_status bw_trivial_walls(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_hex_mesh *source, uint8_t **wall);

#endif
