/* What the vertices of a hex mesh are held on: the surfaces and curves of the tet mesh it was made from, for closest points.
 *
 *     surfaces   the boundary and inner feature facets, cut along curves into regions
 *     curves     feature edges, edges where other than two of those triangles meet, and singular edges of the boundary that are sharp in space;
 *                cut at points into chains
 *     points     feature vertices, and vertices where curves end, meet or turn sharply
 *
 * A singular edge of the boundary is where the map turns, not necessarily the surface: on a polycube of an organic shape, edges of the cube run across
 * smooth skin. What is flat in space need not hold a vertex on a line (there a hexahedron with two faces on the boundary could
 * only be flat), so such chains are left out: their vertices are held by the surface alone. A chain between branchings is sharp as a whole or not:
 * if the surface turns by more than 30 degrees along it, in the mean by length.
 *
 * Invariants
 *  1. A region is a connected set of triangles; two triangles that share an edge are in one region unless the edge is on a curve.
 *  2. A curve is a path between two points, or closed; every segment is an edge of the tet mesh.
 */
#ifndef BW_HEX_SURFACE_H
#define BW_HEX_SURFACE_H

#include "hex/bvh.h"
#include "hex/hexmesh.h"
#include "mesh/gridmap.h"

typedef struct {
    const bw_tet_mesh *mesh; /* borrowed */
    size_t triangle_count, region_count, segment_count, curve_count;
    int32_t (*triangle)[3]; /* vertices; boundary triangles are seen counterclockwise from outside */
    int32_t *region;        /* [triangle] */
    bool *boundary;         /* [triangle]; else an inner feature facet */
    int32_t (*segment)[3];  /* vertices a, b, b */
    int32_t *curve;         /* [segment] */
    int32_t *facet_triangle;  /* [facet]; BW_NONE */
    int32_t *edge_segment;    /* [edge]; BW_NONE */
    int32_t *edge_triangle;   /* [edge] a triangle at it; BW_NONE */
    int32_t *vertex_triangle; /* [vertex] likewise */
    int32_t *vertex_segment;  /* [vertex] likewise a segment */
    uint8_t *point;           /* [vertex] whether it is a point */
    bw_bvh triangles, segments; /* groups: regions, curves */
    size_t flat_curves;       /* chains of singular edges that hold nothing, for they are flat */
} bw_hex_surface;

/* What holds a vertex in fact: BW_HELD_* and the curve or region; BW_NONE for points and what is not held. */
typedef struct {
    uint8_t held;
    int32_t on;
} bw_hex_surface_hold;

/* edge_flags: BW_EDGE_* of each edge of the mesh (bw_grid_map). Borrows the mesh. O(n log n). Errors: BW_E_MEMORY. */
bw_status bw_hex_surface_build(bw_context *ctx, const bw_tet_mesh *mesh, const uint8_t *edge_flags, bw_hex_surface *surface);
void bw_hex_surface_clear(bw_context *ctx, bw_hex_surface *surface);
/* For a vertex of a hex mesh, by its `held`, `carrier` and position. */
bw_hex_surface_hold bw_hex_surface_holds(const bw_hex_surface *surface, uint8_t held, int32_t carrier, const double p[3]);
/* Moves p to the closest point of what holds it, and gives the directions it is free to move in there, orthonormal: 3 (anywhere), 2 (in
 * the plane of the triangle), 1 (along the segment) or 0 of them, which is the value returned. */
int bw_hex_surface_project(const bw_hex_surface *surface, bw_hex_surface_hold hold, double p[3], double direction[3][3]);
/* Enclosed volume. */
double bw_hex_surface_volume(const bw_hex_surface *surface);

#endif
