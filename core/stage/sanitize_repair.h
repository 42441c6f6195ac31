/* Repair of local defects: tets that are not positive are made so by moving vertices in parameter space,
 * where the fix is certain.
 *
 *  1. A vertex may move along the axes that are free at it (mesh/star.h), so transitions, alignment, singular
 * edges and features stay exactly what they are. Where a defect leaves open what a transition is, nothing
 * moves.
 *  2. The vertices of the defective tets are tried first, then those up to 1, 2, ... BW_REPAIR_RINGS edges
 * away; vertices whose tets touch are solved for together (solve/untangle.h), all tets around them taken into
 * account, at most BW_REPAIR_TETS. The shape that tets should have is that of the model under the map's mean
 * metric nearby.
 *  3. The result is rounded to the grid. It is kept if every tet around a moved vertex is positive, exactly;
 * else all of it is undone. Tets thinner than BW_REPAIR_THIN of their wanted volume are given further rings.
 *  4. Positive tets may still turn around an edge once too often or too seldom. What the turns have to be
 * follows from the transitions and from the singular edges that go on outside: bw_repair_check_turns
 * compares.
 *
 * Nothing is verified less for it: the stage's full verification follows, as for any other map. The outcome
 * depends on the mesh and its values alone.
 */
#ifndef BW_STAGE_SANITIZE_REPAIR_H
#define BW_STAGE_SANITIZE_REPAIR_H

#include "mesh/defects.h"
#include "mesh/star.h"

enum { BW_REPAIR_RINGS = 4, BW_REPAIR_TETS = 20000 };
#define BW_REPAIR_THIN 0.01

/* Why a tet could not be repaired. */
typedef enum {
    BW_REPAIR_DONE,
    BW_REPAIR_UNCLEAR, /* what the charts around it have to do with each other is not clear */
    BW_REPAIR_HELD,    /* none of its vertices may move */
    BW_REPAIR_LARGE,   /* too many tets around it */
    BW_REPAIR_TANGLED  /* no positions were found that make all tets positive */
} bw_repair_verdict;

typedef struct {
    size_t vertices_moved;
    int rings; /* edges between a defective tet and the farthest vertex that was free to move, at most */
    int64_t displacement; /* largest change of a coordinate, grid units */
} bw_repair_report;

/* Repairs what it can in `value` (which input->value points to). verdict[i] tells of defects->tet[i]. Errors:
 * BW_E_MEMORY, BW_E_CANCELLED; that something cannot be repaired is none. */
bw_status bw_repair(bw_context *ctx, const bw_star_input *input, const bw_defects *defects,
                    int64_t (*value)[4][3], bw_repair_verdict *verdict, bw_repair_report *report);
/* A clause for messages: "cannot be repaired: <text>". */
const char *bw_repair_verdict_text(bw_repair_verdict verdict);

/* Marks the hinges ([hinge]) whose turns after a repair are not certain, and counts them. `before`: what was
 * read off the map with its defects, their tets unsure; `after`: off the repaired map. Certain are
 *   - the turns around edges without defective tets, if they are the same as before;
 *   - regular ones and those a quarter off: transitions give turns up to whole ones, and any other number
 * that agrees with them is farther from the regular one;
 *   - others that are the same as the signed angles gave before, or as those of the singular edge's certain
 * continuation, the only other one at a vertex. */
bw_status bw_repair_check_turns(bw_context *ctx, const bw_star_input *before, const bw_seams *after,
                                uint8_t *doubtful, size_t *count);

#endif
