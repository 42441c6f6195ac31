/* Exploration of the complexes of one base complex (X 3): which of its walls to keep, so that what is left is cheap.
 *
 * The methods of X work on orders of sheets: enumeration, component by component, and swapping. Two are not in X: a search over complexes themselves (anneal.h), and
 * one that leaves nothing out, or only what a lower bound excludes, and so proves its answer. `auto` takes them in turn.
 */
#ifndef BW_EXPLORE_EXPLORE_H
#define BW_EXPLORE_EXPLORE_H

#include "base/kinds.h"
#include "explore/enumerate.h"

typedef struct {
    bw_explore_method method; /* not BW_EXPLORE_NONE */
    double weight[BW_COST_TERMS];
    size_t beam;              /* states of a level of the enumeration that are expanded */
    bw_explore_expand expand; /* which of them */
    uint64_t seed, work;      /* work: evaluations */
    double seconds;           /* 0: no limit */
    bool retract;             /* walls that are a whole side of both their boxes go, where that is no dearer */
    const bw_block_grids *grids; /* NULL unless a cost in bits counts */
} bw_explore_choice;

enum { BW_EXPLORE_LISTED = 16 };

/* A component of the conflict graph, and what is known of it. */
typedef struct {
    size_t sheets, links;
    uint64_t states, leaves; /* leaves: distinct complexes seen; all there are if `complete` */
    bool complete, bounded;  /* see enumerate.h */
} bw_explore_component;

typedef struct {
    size_t lines, sheets, links, crossings, crossings_open, components, variable_patches;
    bw_explore_component component[BW_EXPLORE_LISTED]; /* those with most sheets, by number */
    size_t listed;
    double start, serial, best;       /* cost at the start, of the best complex by serial insertion alone, and of the best */
    size_t start_blocks, serial_blocks, best_blocks;
    uint64_t evaluations, improved;   /* how many, and which was the last to find something better */
    double seconds;
    bw_explore_cut cut;
    bool proven;                      /* `serial` is the optimum of serial insertion */
} bw_explore_found;

/* wall [patch]: 1 for the walls of the best complex found. Deterministic for a seed, unless cut. Errors: BW_E_MEMORY, BW_E_CANCELLED, BW_E_CHECK. */
bw_status bw_explore(bw_context *ctx, const bw_space *space, const bw_explore_choice *choice, uint8_t *wall, bw_explore_found *found);

#endif
