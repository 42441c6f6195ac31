/* Stage sanitize: an almost seamless map becomes an exact one on a dyadic grid (MC 6).
 *
 * Input: tets with parameters in doubles. Output: the same tets in the same charts (up to a translation by a
 * few grid units), every parameter an integer multiple of 2^-exponent, every transition, alignment and
 * orientation verified in integers.
 *
 *   1. Round to the grid; choose it so that the largest parameter is about 2^44 steps.
 *      Tets that are not positive there are refused by place, or repaired if that is asked for and certain
 *      (sanitize_repair.h).
 *   2. Read off what the map means: rotations, constant axes, quarter turns (mesh/seams.h). Refuse what is
 * beyond tolerance.
 *   3. If no defect is left, the rounded values are the result: integer-grid maps, and what this stage once
 * made, come out unchanged.
 *   4. Otherwise comb and cut (mesh/cutset.h), collect the core system (mesh/sectors.h), solve it in exact
 * integers next to the input's values (solve/echelon.h), and give every corner the value that follows.
 *   5. Derive and verify everything from the values alone (mesh/gridmap.h): the result does not rest on steps
 * 2 to 4 being right.
 */
#ifndef BW_STAGE_SANITIZE_H
#define BW_STAGE_SANITIZE_H

#include "mesh/gridmap.h"

typedef struct {
    bool already_exact;           /* nothing had to move beyond rounding to the grid; no system was solved */
    double displacement_max;      /* largest change of a parameter, in parameter units, rounding to the grid
                                     included */
    double residual_seamless_max; /* largest defects of the input, relative to the edge they occur on, as the
                                     tolerance is */
    double residual_alignment_max;
    size_t cut_facets, cut_edges, branches, nodes, cut_sheets, align_sheets; /* MC 6.2.1 */
    size_t system_rows, system_columns, system_rank, free_variables;
    int64_t divisor_max; /* free variables were rounded to multiples of this or less, in grid units */
    int32_t grid_exponent;
    size_t singular_interior, singular_boundary; /* edges */
    bool repaired; /* there were defective tets, in these places, and they could be repaired */
    size_t region_count, defective_tets, vertices_moved;
    int rings;                         /* edges from a defective tet to the farthest vertex that was free to move */
    double repair_displacement_max;    /* parameter units */
    bw_region regions[BW_REGIONS_KEPT]; /* the first of them */
} bw_sanitize_report;

typedef struct {
    double tolerance; /* largest accepted defect, relative to the edge it occurs on */
    bool repair;      /* re-solve where tets are inverted or degenerate and the fix is certain (sanitize_repair.h) */
} bw_sanitize_options;

/* Requires position, tet and parameter as read; or, of a map that is made on the grid (hex/trivial.h), ordered tets and map->value, of which everything is derived and
 * verified just the same. On success `mesh` is connected, its parameters are freed and
 * `map` is complete; on failure both are as far as they got, for their clear functions. If most tets are
 * negative in the parametrization the file lists mirrored tets: corners 2 and 3 of all of them are swapped
 * and mesh->mirrored is set. Errors, with the elements at fault: BW_E_DUPLICATE, BW_E_NONMANIFOLD,
 * BW_E_INVERTED (with the regions), BW_E_NOT_SEAMLESS, BW_E_NOT_ALIGNED, BW_E_SINGULAR, BW_E_RANGE, BW_E_INDEX
 * (feature lists). O(tets), and what the core system takes. */
bw_status bw_sanitize(bw_context *ctx, const bw_sanitize_options *options, bw_tet_mesh *mesh, bw_grid_map *map,
                      bw_sanitize_report *report);

#endif
