/* Union-find over 0..n-1, in an array of parents that the caller has filled with 0..n-1. The lowest member of a set is its root, so what comes out does not
 * depend on the order of joins. */
#ifndef BW_BASE_FOREST_H
#define BW_BASE_FOREST_H

#include <stdbool.h>
#include <stdint.h>

static inline int32_t bw_forest_root(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Whether they were in two sets. */
static inline bool bw_forest_join(int32_t *parent, int32_t a, int32_t b) {
    a = bw_forest_root(parent, a), b = bw_forest_root(parent, b);
    parent[a < b ? b : a] = a < b ? a : b;
    return a != b;
}

#endif
