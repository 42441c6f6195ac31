/* Seams: what an almost seamless map means (MC 3.1, 6.2): the intended rotation of every facet, the intended
 * constant axis of every boundary facet and the quarter turns around every hinge.
 *
 * Nothing here is a matter of tolerance except acceptance: rotation and axis are those of the smallest
 * defect, and the quarter turns are a sum of angles that must agree with the rotations around the hinge (its
 * monodromy) and with the boundary's normals. What does not agree is refused, with the element; so is what
 * agrees, but with a defect above tolerance.
 */
#ifndef BW_MESH_SEAMS_H
#define BW_MESH_SEAMS_H

#include "exact/rotation.h"
#include "mesh/hinges.h"

typedef struct {
    bw_rotation
        *rotation; /* [facet] from the chart of facet_tet[0] to that of facet_tet[1]; 0 on the boundary */
    int8_t *align; /* [facet] constant axis in the chart of facet_tet[0], of boundary and feature facets; else
                      -1 */
    uint16_t *quarters; /* [hinge] */
    int8_t *line; /* [hinge] axis it runs along, in the chart of its first tet, if it must be aligned and the
                     facets around it do not imply that: a feature, an edge of several hinges, or a number of
                     turns that closes without a rotation and is not the regular one; else -1 */
    bool exact;   /* no defect at all: the values already are an exact seamless map */
    int64_t defect;             /* largest defect of seamlessness, grid units */
    double seamless, alignment; /* largest defects relative to the edge they occur on */
} bw_seams;

/* value: parameters in grid units, below 2^51; every tet positive, unless marked. tolerance is relative to the edge a
 * defect occurs on. `unsure` marks tets ([tet], NULL: none) of which nothing is taken for granted: facets and hinges with
 * such a tet are given what fits best (quarter turns: the sum of signed angles, 0 if that is negative), but are not
 * judged and do not count for `exact` and the largest defects; bw_seams_facet_clear tells which of them say what they
 * mean. Errors, with the elements: BW_E_NOT_SEAMLESS (facets), BW_E_NOT_ALIGNED (facets, edges), BW_E_SINGULAR
 * (edges), BW_E_INDEX for features that are no edge or facet of the mesh. O(tets). */
bw_status bw_seams_init(bw_context *ctx, bw_seams *seams, const bw_tet_mesh *mesh, const bw_hinges *hinges,
                        const int64_t (*value)[4][3], const uint8_t *unsure, double tolerance);
void bw_seams_clear(bw_context *ctx, bw_seams *seams);

/* What the values say about the rotation across an interior facet. */
typedef enum {
    BW_SEAM_CLEAR,     /* one rotation fits, all others are off by far more than the map's defects; or the facet is too degenerate
                          to tell, but both tets give its corners the same values: they share one chart */
    BW_SEAM_AMBIGUOUS, /* several fit */
    BW_SEAM_TORN       /* none fits: off by more than `tolerance` of the longest edge nearby */
} bw_seams_clarity;
bw_seams_clarity bw_seams_facet_clear(const bw_seams *seams, const bw_tet_mesh *mesh, const int64_t (*value)[4][3],
                                      bw_facet f, double tolerance);
/* The longest extent along an axis of an edge of the facet's tets, grid units. */
int64_t bw_seams_reach(const bw_tet_mesh *mesh, const int64_t (*value)[4][3], bw_facet f);

/* Whether a hinge is an ordinary one: a full turn inside, a half turn on the boundary. */
static inline bool bw_seams_regular(const bw_seams *seams, const bw_hinges *hinges, bw_hinge h) {
    return seams->quarters[h] == (hinges->ring[h].open ? 2 : 4);
}

#endif
