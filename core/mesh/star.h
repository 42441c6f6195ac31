/* Stars: the tets around a vertex as seen from one chart, and along which axes the vertex is free to move.
 *
 * If vertex v moves by d in the chart of item[0], its corner in item[i] moves by rotation[i] of d, and every
 * transition between the tets of the star stays exactly what it is, provided that d keeps to the axes of
 * `free`. Held is
 *   - what the monodromy of a singular edge at v turns: there only its axis is free (MC 6.2, fixed points);
 *   - the constant axis of every boundary and feature facet at v, and both other axes of an edge that must
 *     run along one;
 *   - everything at feature vertices, where parts of the mesh merely touch, where turns about several axes
 *     meet, and where a transition next to an unsure tet is not clear (mesh/seams.h).
 */
#ifndef BW_MESH_STAR_H
#define BW_MESH_STAR_H

#include "mesh/seams.h"

typedef struct {
    bw_tet tet;
    int32_t corner;
    bw_rotation rotation; /* from the chart of item[0].tet to that of tet */
    bool reached;         /* by walking across facets at the vertex; else rotation is not known */
} bw_star_item;

typedef struct {
    const bw_tet_mesh *mesh;
    const bw_hinges *hinges;
    const bw_seams *seams;
    const int64_t (*value)[4][3];
    const uint8_t *unsure; /* [tet] NULL: none */
    double tolerance;
} bw_star_input; /* all borrowed */

typedef struct {
    const bw_star_input *in;
    int32_t *first;   /* [vertex + 1] into corner */
    int32_t *corner;  /* 4 * tet + corner, by vertex */
    uint8_t *feature; /* [vertex] */
    int32_t *slot, *stack;
    size_t room, stack_room;
    /* of the vertex read last */
    bw_star_item *item; /* lowest tet first */
    size_t count;
    uint8_t free; /* bit k: axis k of the chart of item[0] */
    bool unclear; /* a transition could not be told */
} bw_stars;

bw_status bw_stars_init(bw_context *ctx, bw_stars *stars, const bw_star_input *input);
void bw_stars_clear(bw_context *ctx, bw_stars *stars);
/* Reads the star of a vertex that at least one tet has. O(tets there). */
bw_status bw_stars_read(bw_context *ctx, bw_stars *stars, bw_vertex vertex);

#endif
