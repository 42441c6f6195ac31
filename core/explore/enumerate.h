/* Enumeration of the complexes of one component (X 3.3), from the top down, level by level, with a beam; and the search for a provably best one.
 *
 * States with the same walls and the same sheets left are one state, whatever came first: X removes duplicates among leaves only.
 */
#ifndef BW_EXPLORE_ENUMERATE_H
#define BW_EXPLORE_ENUMERATE_H

#include "base/kinds.h"
#include "explore/search.h"

typedef struct {
    size_t sheets;
    uint64_t states, leaves; /* expanded; distinct complexes seen */
    size_t levels;
    bool complete;           /* no state was left out: leaves are all there are, and the best is the optimum of serial insertion */
    bool bounded;            /* nothing was left out but what a lower bound excludes: the best is the optimum, the number of leaves is not known */
    int64_t best;
} bw_enumeration;

/* Leaves are priced with the walls of the other components, `around` [patch]. At most `beam` states of a
 * level are expanded: chosen at random, or those that are cheapest when the sheets they lack are inserted as numbered. order [sheets of the component] becomes that of
 * the best leaf. Errors: BW_E_MEMORY, BW_E_CANCELLED; a spent search is none. */
bw_status bw_enumerate(bw_search *search, const uint8_t *around, int32_t component, size_t beam, bw_explore_expand expand, uint64_t until, bw_sheet *order,
                       bw_enumeration *found);

/* All states, depth first. If `known` is not INT64_MAX (for the cost of blocks only), those are left out that lead to nothing below it, or below the best leaf. `most_states`
 * bounds the memory; beyond it, or if the search is spent, the result is neither complete nor bounded. `order` stays as it is if no leaf costs less than `known`. */
bw_status bw_enumerate_all(bw_search *search, const uint8_t *around, int32_t component, int64_t known, uint64_t most_states, uint64_t until, bw_sheet *order,
                           bw_enumeration *found);

#endif
