/* A set of 64-bit hashes; 0 is none. */
#ifndef BW_EXPLORE_HASHSET_H
#define BW_EXPLORE_HASHSET_H

#include "base/context.h"

typedef struct {
    uint64_t *slot;
    size_t size, count;
} bw_hashset;

void bw_hashset_clear(bw_context *ctx, bw_hashset *set);
void bw_hashset_empty(bw_hashset *set);
/* *added: it was not there. */
bw_status bw_hashset_add(bw_context *ctx, bw_hashset *set, uint64_t hash, bool *added);

#endif
