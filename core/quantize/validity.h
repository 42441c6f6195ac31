/* Validity of a quantization: which constraints it breaks (Q 5.1 to 5.6).
 *
 * Everything is decided in integers, from the complex alone:
 *
 *   consistency  each patch is a rectangle (Q 7), no block has a negative extent (Q 8): sums over chains.
 *   (i)    link      the sum over a singular link is 0 or less (Q 10).
 *   (ii)   separation  floods (flood.h) from all critical cells that touch a block with an extent of 0 or an arc without positive length: arcs of links and
 *                    patches of regions first; where they find nothing nodes, whose coincidence the former see only from the side. A meeting gives
 *                    the constraint that the displacement of the two cells is at least 1 in the directions in which they lie apart in the
 *                    input, added up (Q 11, Fig. 10). These are directions perpendicular to both; and directions along one of them, if there too the cells lie apart, so that
 *                    only ends touch. Of all meetings of two entities the one is taken that is apart in the fewest such directions: cells
 *                    that face each other have none. (Q 11 has directions across only, for all meetings; that separates what could as well be moved aside.)
 *   (iii)  region    a critical patch has turned over or left its block's side; or a flood within a region finds that a loop of it has collapsed.
 *   (iv)   volume    a flood of the volume finds the same. Q 12 asks of each generator to keep its displacement in every direction; that forbids valid
 *                    quantizations (a loop around a hole may well return to where it started), and a loop other than the generators may
 *                    collapse. Here a loop breaks the rule when it collapses, whichever it is, and what is asked is that one direction is left.
 *
 * Where no length is negative, constraints are found exactly if the quantization is invalid. With negative lengths patches may turn over, for blocks on the two sides of
 * a wall may change places along it; that is refused on the boundary and beside critical arcs that are no edge of either block, which
 * excludes a few quantizations that would be valid. A constraint excludes valid quantizations in any case, those that evade the coincidence in a way that it does
 * not offer; there is no linear inequality that would not.
 *
 * (iii) and (iv) are looked at when (ii) finds nothing (Q 5.3.5). Where all lengths are positive nothing coincides and there is nothing to look for.
 *
 * Invariant: each constraint appended is broken by the given lengths and satisfied by the input's own lengths, multiplied by any positive integer.
 */
#ifndef BW_QUANTIZE_VALIDITY_H
#define BW_QUANTIZE_VALIDITY_H

#include "quantize/constraint.h"
#include "quantize/critical.h"
#include "quantize/loops.h"

typedef struct bw_validity bw_validity;

/* Prepares the search; the complex is borrowed until bw_validity_free, the cells are not. */
bw_status bw_validity_new(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_validity **out);
/* Appends constraints that length[arc] breaks; if none is appended, the quantization is valid. The same lengths give the same constraints. */
bw_status bw_validity_separate(bw_validity *validity, const int64_t *length, bw_constraint_list *violated);
void bw_validity_free(bw_context *ctx, bw_validity *validity); /* NULL is fine */
/* From now on constraints of some rules (bits 1 << bw_rule) are not asked for: to see what each of them is needed for. */
void bw_validity_leave_out(bw_validity *validity, unsigned rules);

typedef struct {
    size_t links, regions, nodes;                 /* critical entities */
    size_t region_generators, volume_generators;
    uint64_t calls, floods, states;               /* work so far */
} bw_validity_figures;

bw_validity_figures bw_validity_count(const bw_validity *validity);

/* What was found out about the complex; borrowed from `validity`. */
const bw_surface *bw_validity_surface(const bw_validity *validity);
const bw_critical *bw_validity_critical(const bw_validity *validity);
const bw_loops *bw_validity_loops(const bw_validity *validity);

#endif
