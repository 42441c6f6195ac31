/* What a complex of blocks lets one choose from (X 3.1): sheets, where they cross, which of them are in each other's way.
 *
 * Built on a base complex; every set here is one of its patches or blocks. A sheet is what spreads from a singular line in one direction, straight over
 * regular arcs, to the boundary or to singular arcs. A wall of any motorcycle complex is part of a sheet, or closes a torus.
 *
 * Invariants
 *  1. `rim` tells, for each arc on the rim of a patch, which patch goes on straight behind it and which stand beside it a quarter turn away, one on each side of the patch.
 *  2. A sheet's patches begin with its seeds: those at the line itself (or at what a feature marks). They are walls whatever else is.
 *  3. Sheets are numbered by their lowest seed; `of_patch` and `watcher` list them ascending.
 *  4. Two sheets are linked if one can stop the other, and that makes a difference in the end (X 3.3, conflict graph). So crossings are left out at which a sheet has both
 *     its patches anyway (X Fig. 3c: sheets that do not block each other), and sheets all of whose patches are walls in any order, unless they may or may not come to where
 *     they stop one that matters.
 *  5. Sheets that share no component neither stop each other nor share a patch that some order leaves open: the number of blocks is a sum over components.
 */
#ifndef BW_EXPLORE_SPACE_H
#define BW_EXPLORE_SPACE_H

#include "complex/complex.h"

typedef int32_t bw_sheet;

/* An arc on the rim of a patch. */
typedef struct {
    bw_arc arc;
    bw_patch straight;  /* BW_NONE: at a singular, feature or boundary arc, or where no wall of the complex goes on */
    bw_patch beside[2]; /* on side 0 and 1 of the patch; BW_NONE: the complex is flat there, or outside */
    bool inside;        /* a regular arc inside the volume: a wall that does not go straight on needs both beside */
} bw_rim;

typedef struct {
    size_t patch_count, block_count, arc_count;
    bw_patch (*block_corner)[8][3]; /* [block] the patches at each of its corners, one in each of three sides */
    bw_block (*patch_block)[2];     /* [patch] as in the complex */
    bw_transition *across;          /* [patch] inside: from the chart of patch_block[1] to that of patch_block[0] */
    int64_t (*block_extent)[3];     /* [block] grid units */
    uint8_t *given;                 /* [patch] a wall from the start: boundary, feature facet */
    uint8_t *must;                  /* [patch] a wall of any complex that keeps its singular walls */
    size_t *rim_begin;              /* [patch + 1] */
    bw_rim *rim;
    size_t *side_begin;             /* [block + 1]: patches around a block, as 2 * patch + slot, the block being patch_block[patch][slot] */
    int32_t *side;
    uint64_t *patch_key, *block_key; /* random numbers: a set's hash is the exclusive or of its members' */

    size_t sheet_count, line_count;
    size_t *sheet_begin;            /* [sheet + 1] */
    bw_patch *sheet_patch;          /* all it reaches if nothing stops it; seeds first */
    int32_t *sheet_seeds;           /* [sheet] */
    int32_t *sheet_line;            /* [sheet] singular line; BW_NONE: from a feature */
    int32_t *sheet_component;       /* [sheet] */
    size_t *of_patch_begin;         /* [patch + 1] */
    bw_sheet *of_patch;
    size_t *watcher_begin;          /* [patch + 1]: sheets that a wall here helps to stop */
    bw_sheet *watcher;
    size_t *link_begin;             /* [sheet + 1]: conflict graph */
    bw_sheet *link;
    size_t crossings;               /* arcs at which sheets can stop each other */
    size_t crossings_open;          /* arcs at which they cross, but never do (X Fig. 3c) */
    size_t component_count;         /* with a link in them; they come first */
    size_t variable_patches;        /* walls in some orders only */
} bw_space;

/* Reads a complex, which need not be kept, with its cells. Errors: BW_E_MEMORY, BW_E_CANCELLED; BW_E_LIMIT if its sheets have 2^31 patches
 * together; BW_E_CHECK if the complex contradicts itself. */
bw_status bw_space_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_space *space);
void bw_space_clear(bw_context *ctx, bw_space *space);

/* Verifies 1 to 4. BW_E_CHECK naming the first violation. */
bw_status bw_space_check(bw_context *ctx, const bw_space *space);

static inline size_t bw_space_links(const bw_space *s) { return s->link_begin[s->sheet_count] / 2; }

#endif
