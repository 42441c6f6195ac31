/* The brush fire that makes walls (MC 4, 5.2): burns iso-surfaces through a cell complex, cutting cells as it goes.
 *
 * An entry of its queue says that fire stands at `edge`, coming from the burnt polygon `from`, after travelling `distance` in direction
 * `heading`. When it is taken out, and the edge is alive, the fire crosses: the polygon that continues `from` straight across
 * the edge is found or made by one cut, burnt, and the fire stands at its other edges.
 *
 *   as in the paper   entries inside a tet go first, so a wall crosses a tet whole before the next (5.2.1); distances count along
 *                     the heading only (5.2.2), in meshes of hexes whole hexes (5.1); an edge with three burnt polygons is not crossed again (alive, Algorithm 1)
 *   different         a cell is cut when the fire crosses into it, not when it arrives: what dies leaves no cut; entries of edges and
 *                     polygons that were split meanwhile are resolved through the split records when they are taken out
 *
 * Fire does not cross singular edges nor the boundary. Ties are broken by age, so the result is determined by the order of ignition.
 */
#ifndef BW_MESH_FIRE_H
#define BW_MESH_FIRE_H

#include "mesh/walk.h"

typedef struct bw_fire_entry bw_fire_entry;

typedef struct {
    bool stops_at_walls; /* false: the alive test is left out, which gives the base complex (MC 2) */
    uint8_t flags;       /* set on burnt polygons besides BW_WALL */
    uint64_t max_cells;  /* that cuts may add to those of the tets; BW_E_LIMIT beyond */
} bw_fire_rules;

typedef struct {
    bw_context *ctx;
    bw_cells *cells;
    bw_fire_rules rules;
    bool silent; /* reports no progress: its runs are parts of something larger */
    uint64_t age;
    bw_fire_entry *heap;
    size_t count, room;
    bw_cell *around; /* scratch: cells around an edge or a vertex */
    size_t around_room;
} bw_fire;

void bw_fire_init(bw_fire *fire, bw_context *ctx, bw_cells *cells, const bw_fire_rules *rules);
void bw_fire_clear(bw_fire *fire);

/* Sets fire to both iso-surfaces through an axis-parallel complex edge (a leaf), all around it, at distance 0. Requires that all tets
 * around it are opened. */
bw_status bw_fire_ignite_edge(bw_fire *fire, bw_cedge edge);
/* Sets fire to one iso-surface at an axis-parallel complex edge (a leaf), on one side of it: to the polygon or facet named, which does not burn yet, or
 * to that in which the plane cuts the cell. */
bw_status bw_fire_ignite_at(bw_fire *fire, bw_cedge edge, bw_continuation at);
/* Sets fire to the iso-surfaces of the axes in `axes` (bit k: axis k of the chart of `tet`) through a vertex of the tet mesh, all around it.
 * `tets` lists the tets at the vertex, `tet` first. The vertex must be regular. */
bw_status bw_fire_ignite_vertex(bw_fire *fire, bw_vertex vertex, const bw_tet *tets, size_t tet_count, unsigned axes);
/* Burns an aligned polygon (a leaf) at distance 0. */
bw_status bw_fire_ignite_polygon(bw_fire *fire, bw_polygon polygon);
/* Sets fire to one iso-surface at the polygon in which a plane (chart of the cell's tet) cuts a cell. */
bw_status bw_fire_ignite_plane(bw_fire *fire, bw_cell cell, bw_plane plane);
/* Cuts a cell as bw_cells_cut does, within max_cells, and burns nothing. */
bw_status bw_fire_cut(bw_fire *fire, bw_cell cell, bw_plane plane, bw_polygon *section);
/* Burns until nothing is alight. Polls for cancellation and reports progress. */
bw_status bw_fire_run(bw_fire *fire);

#endif
