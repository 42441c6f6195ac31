/* The tree of choices of one component of the conflict graph (X 3.3): its states, and how a state is expanded.
 *
 * A state is a set of walls and the sheets that are still to be inserted, both as bits. Sheets that nothing left can stop, and that stop nothing, are inserted at once;
 * each of the others may be the next. Where none is left the state is a leaf: the walls of a complex, as far as the component goes.
 */
#ifndef BW_EXPLORE_TREE_H
#define BW_EXPLORE_TREE_H

#include "explore/insert.h"

typedef struct {
    int32_t from, to;   /* places in the sheet */
    bw_patch beside[2]; /* BW_NONE: never a wall */
} bw_tree_step;

typedef struct {
    const bw_space *space;
    bw_sheet *sheet;      /* [count] of the component, ascending */
    size_t count;
    size_t wall_words, words; /* of a state: walls, and walls and sheets */
    size_t *step_begin;   /* [count + 1] */
    bw_tree_step *step;   /* by from */
    size_t *first_step;   /* [place in sheet_patch of the component's sheets, one after another] into step */
    size_t *place_begin;  /* [count + 1] into first_step */
    uint64_t *reach;      /* scratch [count][wall_words]: what each sheet would reach next */
    uint64_t *least;      /* scratch [count][wall_words]: what it reaches if all others go before */
    uint64_t *after;      /* scratch [count + 1][wall_words] */
    uint64_t *choices;    /* [sheet words] by the last bw_tree_settle: those that may be next */
    uint8_t *now;         /* scratch */
    int32_t *queue;       /* scratch */
    uint64_t floods;
} bw_tree;

bw_status bw_tree_init(bw_context *ctx, const bw_space *space, int32_t component, bw_tree *tree);
void bw_tree_clear(bw_context *ctx, bw_tree *tree);

/* Nothing inserted: the given walls, all sheets left. */
void bw_tree_root(const bw_tree *tree, uint64_t *state);
/* Inserts what is in nobody's way, ascending; those sheets are added to `order` (may be NULL) from *inserted on. Returns how many sheets may be next; 0: a leaf. */
size_t bw_tree_settle(bw_tree *tree, uint64_t *state, bw_sheet *order, size_t *inserted);
/* The walls that every leaf below the state settled last has. */
void bw_tree_sure_walls(const bw_tree *tree, const uint64_t *state, uint64_t *walls);
/* Inserts one sheet (0 .. count-1). */
void bw_tree_choose(bw_tree *tree, uint64_t *state, size_t sheet);
/* Inserts all that are left, ascending, into a copy of a state. */
void bw_tree_finish(bw_tree *tree, uint64_t *state);

uint64_t bw_tree_hash(const bw_tree *tree, const uint64_t *state);       /* of all of it */
uint64_t bw_tree_hash_walls(const bw_tree *tree, const uint64_t *state); /* of its walls */

static inline bool bw_tree_bit(const uint64_t *words, size_t i) { return words[i >> 6] >> (i & 63) & 1; }
static inline void bw_tree_set_bit(uint64_t *words, size_t i) { words[i >> 6] |= (uint64_t)1 << (i & 63); }

#endif
