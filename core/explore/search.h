/* What every method of exploration shares: how costly a choice is, the best one so far, how much more work there may be.
 *
 * Work is counted in evaluations, so that where a search ends does not depend on the machine. A limit in seconds, one on memory, and a user who wants what there is
 * (bw_context.finish) end it sooner; `cut` says so, and the best found is kept.
 */
#ifndef BW_EXPLORE_SEARCH_H
#define BW_EXPLORE_SEARCH_H

#include "explore/cost.h"
#include "explore/insert.h"
#include "explore/regions.h"

typedef enum { BW_CUT_NOT, BW_CUT_TIME, BW_CUT_MEMORY, BW_CUT_FINISH } bw_explore_cut;

enum { BW_PRICES_MOST = 256 << 20 }; /* bytes of prices that are kept before all are forgotten */

typedef struct {
    uint64_t state;
} bw_explore_random;

typedef struct {
    bw_context *ctx;
    const bw_space *space;
    bw_pricer *pricer;
    bw_regions regions;
    uint8_t *wall;         /* scratch [patch] */
    uint64_t *region_hash; /* scratch [block] */
    bw_block *region_block; /* scratch [block] */
    const uint8_t *stays;  /* [patch] walls that joins leave */
    bw_explore_random random;
    uint64_t work, evaluations; /* the limit, and how many there were */
    double since, seconds;      /* seconds 0: no limit */
    bw_explore_cut cut;

    uint8_t *best;         /* [patch] walls of the best complex seen */
    int64_t best_cost;     /* INT64_MAX: none yet */
    size_t best_blocks;
    uint64_t improved;     /* evaluations when it was found */
    const char *method;    /* what runs, for who watches */
} bw_search;

bw_status bw_search_init(bw_context *ctx, const bw_space *space, bw_pricer *pricer, const uint8_t *stays, uint64_t seed, bw_search *search);
void bw_search_clear(bw_search *search);

uint64_t bw_search_random(bw_search *search);                        /* splitmix64 */
static inline size_t bw_search_below(bw_search *search, size_t bound) { return (size_t)(bw_search_random(search) % bound); }

/* Whether the search was cut, asked anew; counts nothing. */
bool bw_search_is_cut(bw_search *search);
/* Counts an evaluation. True if there may be no more: the work is done, or the search was cut. */
bool bw_search_spent(bw_search *search, uint64_t until);
/* Cost of a set of walls, which is completed (regions.h) in search->wall. Keeps it if it is the best. BW_E_CHECK if the walls are no complex. */
bw_status bw_search_price(bw_search *search, const uint8_t *wall, int64_t *cost);
bw_status bw_search_price_serial(bw_search *search, const bw_serial *serial, int64_t *cost);
/* What any complex with these walls and more costs at least, for the cost of blocks alone. */
int64_t bw_search_bound(bw_search *search, const uint8_t *wall);
/* Tells of a complex whose cost is known. */
void bw_search_offer(bw_search *search, const uint8_t *wall, int64_t cost, size_t blocks);

#endif
