/* Swapping (X 3.4): of two sheets that can stop each other the later one gets its place just before the earlier one, as long as that makes a complex cheaper. */
#ifndef BW_EXPLORE_SWAP_H
#define BW_EXPLORE_SWAP_H

#include "explore/search.h"

/* From the order in `serial`, whose sheets are all inserted, until no swap helps, or the search has made `until` evaluations. *cost: of what serial then holds. */
bw_status bw_swap(bw_search *search, bw_serial *serial, uint64_t until, int64_t *cost);
/* An order with nothing in it but chance. */
bw_status bw_random_order(bw_search *search, bw_serial *serial);

#endif
