/* What space.c leaves to sheets.c and links.c, in this order; part of bw_space_init. */
#ifndef BW_EXPLORE_SHEETS_H
#define BW_EXPLORE_SHEETS_H

#include "explore/space.h"

/* Singular lines, their sheets, of_patch. */
bw_status bw_sheets_find(bw_context *ctx, const bw_complex *complex, bw_space *space);
/* Crossings, watchers, the conflict graph and its components. */
bw_status bw_sheets_link(bw_context *ctx, bw_space *space);

/* member [place in of_patch]: the same pair's place in sheet_patch. place [patch] is scratch. */
void bw_sheets_pair(const bw_space *space, int32_t *place, int32_t *member);

/* Disjoint sets of numbers whose roots are the lowest of each. */
static inline int32_t bw_set_root(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}
static inline void bw_set_join(int32_t *parent, int32_t i, int32_t j) {
    i = bw_set_root(parent, i), j = bw_set_root(parent, j);
    if (i < j) parent[j] = i;
    else parent[i] = j;
}

#endif
