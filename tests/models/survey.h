/* What a model really is, found without any of the core's or the generator's tables: facets and edges are
 * sorted anew, parameters compared in doubles, angles measured. */
#ifndef BW_TESTS_SURVEY_H
#define BW_TESTS_SURVEY_H

#include "models/models.h"

typedef struct {
    double space_volume_min, map_volume_min; /* six times the volume of the smallest tet */
    size_t facets, edges;
    size_t facet_tets_max; /* tets on one facet, at most */
    size_t facets_inside;  /* with two tets */
    size_t facets_moved;   /* inside, and the two charts differ by more than 1e-9 */
    size_t facets_turned;  /* inside, and the two charts differ by a rotation */
    size_t facets_flat;    /* inside, and constant in one parameter up to 1e-9 */
    double seam_defect;    /* over interior facets, distance to the nearest rotation plus translation */
    double
        alignment_defect; /* over boundary facets, distance to the nearest plane of one constant parameter */
    int64_t euler;
    int singular_edges;  /* inside */
    int singular_curves; /* inside, from a vertex in which other than two singular edges meet to the next */
    double angle_defect; /* over interior edges, distance of the angle of the map to a whole number of
                            quarters */
} bw_model_survey;

/* Errors: BW_E_MEMORY. The corners must be in range. O(n log n). */
bw_status bw_model_look(bw_context *ctx, const bw_model *model, bw_model_survey *out);

#endif
