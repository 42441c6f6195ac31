/* What a parametrizer has to keep so that its map realizes a quantization: differences of parameters (Q 6, equation 13).
 *
 *     u(to) - T u(from) = vector        T: the transition along a path of tets, from the chart of its first tet to that of its last
 *
 * for a spanning tree of the critical entities, rooted in critical nodes, and for a generating loop of each handle. T is composed from the facets between the
 * tets of the path, whose translations are the parametrizer's unknowns; `vector` is the integer sum of the lengths of the arcs that the path follows, in the chart of the
 * last tet. Together with seamlessness, alignment of the boundary and of singular and feature edges, and one root in an integer point, this makes the
 * map an integer-grid map. Positions of other nodes stay free.
 *
 *   from, to   nodes. Critical nodes are vertices of the mesh. A cycle of links, or a closed region, has no critical node: any of its nodes stands for it, which may lie
 *              inside an edge, facet or tet (bw_differential_weights).
 *   axes       the directions, in the chart of the last tet, in which the difference is prescribed: all between critical nodes, for their links are integer on both sides;
 *              across the link or region where `to` only stands for one.
 *   loops      have from = to. Generators of the first homology group, which suffice for volumes in space whose handles do not turn the chart.
 */
#ifndef BW_QUANTIZE_DIFFERENTIAL_H
#define BW_QUANTIZE_DIFFERENTIAL_H

#include "quantize/validity.h"

typedef struct {
    bw_node from, to;
    int64_t vector[3];
    uint8_t axes; /* bits */
} bw_difference;

typedef struct {
    size_t count;
    bw_difference *difference;
    size_t *tet_begin; /* [count + 1] */
    bw_tet *tet;       /* consecutive ones share a facet */
    size_t root_count; /* one for each connected part of the mesh */
    bw_node *root;     /* to be put in integer points */
    bw_tet *root_tet;  /* a tet that holds it */
    size_t difference_room, begin_room, tet_room, root_room, root_tet_room;
} bw_differential;

/* Requires lengths that `validity` finds nothing wrong with; any consistent ones give differences. */
bw_status bw_differential_init(bw_context *ctx, const bw_cells *cells, const bw_validity *validity, const int64_t *length, bw_differential *out);
void bw_differential_clear(bw_context *ctx, bw_differential *differential);

/* A node as a combination of a tet's corners: its barycentric coordinates, exact up to rounding to doubles; 0 at corners that have no part in it. `tet` holds it. */
void bw_differential_weights(const bw_cells *cells, const bw_complex *complex, bw_node node, bw_tet tet, double weight[4]);

#endif
