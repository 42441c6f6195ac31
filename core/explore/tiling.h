/* A complex under local change: boxes that are cut in two or joined, with their cost, and the way back.
 *
 * Any complex can be reached from any other of the same base complex by cuts and joins; serial insertion and wall retraction both end in one. So a search here has
 * the complexes of X and those of MC 5.4 within reach, X Fig. 4d included.
 *
 * Invariants
 *  1. wall[] makes cuboids; box[block] names the box that holds a block by one of its blocks.
 *  2. size, hash and price belong to the boxes named; count and the pricer's total to all of them.
 *  3. The log leads back to the last bw_tiling_keep.
 */
#ifndef BW_EXPLORE_TILING_H
#define BW_EXPLORE_TILING_H

#include "explore/cost.h"

typedef struct {
    int32_t kind, at; /* what was changed */
    int64_t old;
} bw_tiling_change;

typedef struct {
    int32_t size, price;
    uint64_t hash;
} bw_tiling_box;

typedef struct {
    const bw_space *space;
    bw_pricer *pricer;    /* holds the boxes of this tiling only */
    const uint8_t *stays; /* [patch] walls that no join takes away */
    uint8_t *wall;
    bw_block *box;        /* [block] */
    bw_tiling_box *of;    /* [block], of those that name a box */
    size_t count;
    uint64_t hash;        /* of the walls */
    bw_tiling_change *log;
    size_t logged, room;
    bw_tiling_box *old_box; /* boxes that the log names */
    size_t old_count, old_room;
    bw_patch *face;       /* scratch: the patches of a cut or join */
    size_t face_count;
    uint32_t *mark, *seen, round; /* scratch [patch], [block] */
    bw_block *queue;      /* scratch */
} bw_tiling;

/* The tiling of a set of walls that makes cuboids. Borrows space, pricer (emptied first) and stays. */
bw_status bw_tiling_init(bw_context *ctx, const bw_space *space, bw_pricer *pricer, const uint8_t *stays, const uint8_t *wall, bw_tiling *tiling);
/* Other walls for the same tiling. */
bw_status bw_tiling_set(bw_context *ctx, bw_tiling *tiling, const uint8_t *wall);
void bw_tiling_clear(bw_context *ctx, bw_tiling *tiling);

/* Cuts the box around an open patch by its plane. *done is false, and nothing changed, if the base complex has no wall there that parts the box. */
bw_status bw_tiling_cut(bw_context *ctx, bw_tiling *tiling, bw_patch patch, bool *done);
/* Joins the boxes on both sides of a wall, if it is a whole side of both and none of it stays. */
bw_status bw_tiling_join(bw_context *ctx, bw_tiling *tiling, bw_patch patch, bool *done);
/* What was done since the last keep becomes final. */
void bw_tiling_keep(bw_tiling *tiling);
/* Undoes what was done since `logged` had this value; 0: since the last keep. */
void bw_tiling_undo(bw_tiling *tiling, size_t logged);
/* The walls of a box that a join may take away, as patches, each once per side it is seen from. out has room for 2 * patch_count. Returns how many. */
size_t bw_tiling_sides(bw_tiling *tiling, bw_block name, bw_patch *out);

/* Verifies invariants 1 and 2 from scratch. BW_E_CHECK. */
bw_status bw_tiling_check(bw_context *ctx, const bw_tiling *tiling);

#endif
