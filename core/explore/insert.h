/* Serial insertion (X 3.2): one sheet after another, each as far as walls of those before it let it, in any order; and what changes when one sheet gets another
 * place in it.
 *
 * Invariants
 *  1. A sheet with a smaller key comes earlier; no two have the same.
 *  2. first[patch] is the smallest key of the sheets that reach it, BW_GIVEN for walls that are there from the start, BW_OPEN if none does. So walls are what is not open.
 *  3. A sheet goes straight over a regular arc unless walls of earlier sheets, or of itself, stand on both sides there; it always has its seeds.
 *  4. `hash` belongs to the set of walls, given ones left out.
 */
#ifndef BW_EXPLORE_INSERT_H
#define BW_EXPLORE_INSERT_H

#include "explore/space.h"

#define BW_GIVEN (-1)
#define BW_OPEN INT64_MAX

typedef struct {
    const bw_space *space;
    int64_t *key;      /* [sheet] */
    bw_sheet *order;   /* sheets by key */
    int64_t *first;    /* [patch] */
    uint8_t *reached;  /* [place in sheet_patch] */
    uint64_t hash;
    uint64_t floods;   /* since bw_serial_init: how much work was done */
    int32_t *member;   /* [place in of_patch] the same pair's place in sheet_patch */
    uint8_t *now;      /* scratch: `reached` of the sheet that is flooded */
    int32_t *place;    /* scratch [patch] */
    int32_t *queue;    /* scratch */
    bw_sheet *heap;    /* sheets to be flooded again */
    uint8_t *queued;
    size_t heap_count;
} bw_serial;

/* Nothing is inserted yet. Borrows the space. Errors: BW_E_MEMORY. */
bw_status bw_serial_init(bw_context *ctx, const bw_space *space, bw_serial *serial);
void bw_serial_clear(bw_context *ctx, bw_serial *serial);
bw_status bw_serial_copy(bw_context *ctx, const bw_serial *from, bw_serial *to);

/* Inserts all sheets in an order, each named once. O(patches of all sheets). */
void bw_serial_insert(bw_serial *serial, const bw_sheet *order);
/* Moves a sheet to directly before another: floods what that can change, in order. The outcome is that of bw_serial_insert. */
void bw_serial_move_before(bw_serial *serial, bw_sheet sheet, bw_sheet other);
/* The same, by its place 0.. in the order without it. */
void bw_serial_move_to(bw_serial *serial, bw_sheet sheet, size_t place);
size_t bw_serial_place(const bw_serial *serial, bw_sheet sheet);
/* wall[patch] becomes 1 or 0. */
void bw_serial_walls(const bw_serial *serial, uint8_t *wall);

#endif
