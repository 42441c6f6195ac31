/* Search over complexes themselves: boxes are cut at random places close to each other, what can be joined around them is joined in a random order, and the outcome is taken
 * if it is not much worse, less and less of it as the search goes on (threshold accepting).
 *
 * Not in X. Its search space holds what serial insertion makes, what wall retraction makes of that (X Fig. 4d), and everything between: from any complex to any other it is a
 * few cuts and joins, each of which changes two boxes.
 */
#ifndef BW_EXPLORE_ANNEAL_H
#define BW_EXPLORE_ANNEAL_H

#include "explore/search.h"
#include "explore/tiling.h"

/* From the walls of `tiling` for `rounds` evaluations at most; the best goes to the search. The tiling ends somewhere. */
bw_status bw_anneal(bw_search *search, bw_tiling *tiling, uint64_t rounds);
/* Joins all boxes that can be joined at a gain, in a random order. */
bw_status bw_retract(bw_search *search, bw_tiling *tiling);

#endif
