/* What blocks cost: the number of them (X: E_n), bits to code their vertices (E_g), how far they are from cubes (X 4.5), and weighted sums of these.
 *
 * A new cost is one function of a box: a row of `terms` in cost.c. Only bits with entropies of the whole mesh are no sum over boxes; for them a tally is kept.
 *
 * Costs are integers, in units of 2^-BW_COST_SHIFT, so that a total does not depend on the order in which boxes came and went. What a box costs is found once and kept
 * by the hash of the set of blocks it is made of.
 */
#ifndef BW_EXPLORE_COST_H
#define BW_EXPLORE_COST_H

#include "explore/box.h"
#include "hex/predict.h"

enum { BW_COST_SHIFT = 20 };

typedef enum {
    BW_COST_BLOCKS,        /* 1 for each */
    BW_COST_BITS,          /* per vertex of the mesh, 12 bits, entropies of the whole mesh */
    BW_COST_BITS_BY_BLOCK, /* the same with entropies of each block by itself */
    BW_COST_CUBES,         /* longest side by shortest, in the map */
    BW_COST_TERMS
} bw_cost_term;

/* The hexes of the blocks of a base complex, for costs in bits. Charts of blocks have `unit` grid units to a hex. */
typedef struct {
    const bw_hex_mesh *mesh; /* borrowed */
    int64_t unit;
    size_t *begin;           /* [block + 1] into vertex */
    bw_hvertex *vertex;      /* the grid points of each block, the first axis fastest */
} bw_block_grids;

/* From a mesh whose hexes have their block and place in it. Errors: BW_E_CHECK, BW_E_MEMORY. */
bw_status bw_block_grids_init(bw_context *ctx, const bw_space *space, const bw_hex_mesh *mesh, int64_t unit, bw_block_grids *grids);
void bw_block_grids_clear(bw_context *ctx, bw_block_grids *grids);

typedef struct bw_pricer bw_pricer;

/* A pricer that holds no boxes. Borrows space and grids; grids may be NULL unless a cost in bits has weight. Weights are finite and not negative, not all zero. */
bw_status bw_pricer_new(bw_context *ctx, const bw_space *space, const double weight[BW_COST_TERMS], const bw_block_grids *grids, bw_pricer **out);
void bw_pricer_free(bw_context *ctx, bw_pricer *pricer);
/* Whether only the number of blocks counts: then boxes need not be laid out, and have price 0 by number. */
bool bw_pricer_counts(const bw_pricer *pricer);

/* The price of a box, by number. `from` is a block of it, `hash` of its blocks. */
bw_status bw_pricer_price(bw_context *ctx, bw_pricer *pricer, uint64_t hash, const uint8_t *wall, bw_block from, int32_t *price);
void bw_pricer_add(bw_pricer *pricer, int32_t price);
void bw_pricer_remove(bw_pricer *pricer, int32_t price);
void bw_pricer_empty(bw_pricer *pricer);
/* Of all boxes that were added and not removed. */
int64_t bw_pricer_total(const bw_pricer *pricer);
/* Prices kept, and bytes they take. */
size_t bw_pricer_bytes(const bw_pricer *pricer);
/* Forgets all prices; the pricer holds no boxes afterwards. */
void bw_pricer_forget(bw_context *ctx, bw_pricer *pricer);

static inline double bw_cost_value(int64_t cost) { return (double)cost / (1 << BW_COST_SHIFT); }

/* As words: "blocks", or a sum like "blocks=1,bits=0.5". out has 120 bytes. */
void bw_cost_print(const double weight[BW_COST_TERMS], char out[120]);

#endif
