/* Points with exact coordinates, found again by them: behind overlay.c. Their numbers are the bulk of its memory; GMP takes it by itself, so it is counted here as the job's. */
#ifndef BW_IGM_OVERLAY_POINTS_H
#define BW_IGM_OVERLAY_POINTS_H

#include <gmp.h>

#include "base/context.h"
#include "base/index.h"

typedef struct {
    mpq_t x[3];
    double at[3];  /* rounded: equal for equal x */
    int32_t group; /* points of different groups are different */
    int32_t item;  /* what the caller has there */
} bw_exact_point;

typedef struct {
    bw_exact_point *point;
    size_t count, ready, room; /* those up to `ready` are initialised */
    int32_t *slot;             /* by hash; index of a point or BW_NONE */
    size_t slots;              /* a power of two */
    size_t held, charged;      /* bytes of the numbers: what GMP took, and what the job was told of it */
} bw_exact_points;

void bw_exact_points_clear(bw_context *ctx, bw_exact_points *points);
/* Forgets all points. */
void bw_exact_points_empty(bw_exact_points *points);
/* Index of the point; of a new one, whose item is BW_NONE, if there was none. O(1) expected. */
bw_status bw_exact_points_find(bw_context *ctx, bw_exact_points *points, int32_t group, const mpq_t x[3], int32_t *out);

#endif
