/* Frame: the tets of an integer-grid map to be, each in the integer chart of a block, with all integers of the map known and only reals left open.
 *
 * A tet's home is a block that holds part of it; its parameters are in the integer chart of that block (atlas.h). The transition of each facet follows: compose across the
 * walls between the homes of its two tets. So do the constants of aligned facets, of singular and feature edges and of feature vertices: they are read off the
 * patches, arcs and nodes that these lie on. All of this holds for zero and negative lengths alike, no matter that the walls will lie elsewhere. Nothing is left of the
 * differential constraints of Q 6 (equation 13): every translation is a constant. The unknowns are positions, along the axes in which nothing holds a vertex:
 *
 *     coordinate k of corner i = at[i][k] + sign[i][k] * x[variable[i][k]],      at[i][k] alone if variable[i][k] is BW_NONE
 *
 * so any x keeps to all transitions and constants exactly.
 *
 * Invariants (bw_frame_check verifies 1 to 4)
 *  1. next[i] is the tet across facet i (opposite corner i); across[i], from the chart of this tet to that of next[i], is the inverse of the one back.
 *  2. Corners of a vertex that are joined across facets share their unknowns: one reference corner has sign 1 and at 0 where it is free.
 *  3. mask[i] has the axes in which corner i is held, at hold[i]; the same for all corners joined with it, and fixed by every loop around the vertex.
 *  4. plane[i] is the constant axis of facet i if it is on the boundary or a feature, line[j] the axis of local edge j if it is singular or a feature; else -1. Their
 *     corners are held accordingly.
 */
#ifndef BW_IGM_FRAME_H
#define BW_IGM_FRAME_H

#include "igm/atlas.h"

typedef struct {
    bw_vertex vertex[4];
    bw_tet next[4]; /* BW_NONE outside */
    bw_transition across[4];
    int64_t hold[4][3], at[4][3];
    double p[4][3]; /* the input's map, in the home's chart, in grid units of the map */
    double u[4][3]; /* the map being made, in units of hexes (parametrize.h) */
    int32_t variable[4][3];
    int8_t sign[4][3];
    int8_t plane[4], line[6];
    uint16_t quarters[6]; /* around local edges in the input's map, and so in every map of this frame */
    uint8_t mask[4];
    uint8_t feature_edges, feature_facets; /* bits: local edges and facets that the user marked */
    bw_block home;
    bw_tet origin; /* the tet of the input that this is, or is part of */
} bw_frame_tet;

typedef struct {
    size_t vertex_count, tet_count, variable_count;
    double (*position)[3]; /* [vertex] */
    bw_frame_tet *tet;
    int32_t (*reference)[2]; /* [variable]: 4 * tet + corner, axis: there it is the coordinate itself */
    size_t vertex_room, tet_room, reference_room;
} bw_frame;

/* The frame of the mesh of an atlas. BW_E_CHECK if integers do not fit together, which a complex and an atlas that pass their checks never cause. O(n). */
bw_status bw_frame_init(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame);
void bw_frame_clear(bw_context *ctx, bw_frame *frame);
/* Derives next from vertices. BW_E_INTERNAL if three tets share a facet. O(n log n). */
bw_status bw_frame_connect(bw_context *ctx, bw_frame *frame);
/* Spreads mask and hold over the stars of vertices and derives the unknowns. Requires next and across. BW_E_CHECK if two constants disagree. O(n). */
bw_status bw_frame_resolve(bw_context *ctx, bw_frame *frame);
/* BW_E_CHECK naming the first violation. O(n). */
bw_status bw_frame_check(bw_context *ctx, const bw_frame *frame);

/* The unknowns as u has them, and back: u of all corners from x. */
void bw_frame_read(const bw_frame *frame, double *x);
void bw_frame_write(bw_frame *frame, const double *x);

#endif
