/* The hex mesh that a quantization promises, without making it: blocks as boxes of cubes, and what lies beyond each of their faces.
 *
 * Blocks touch where the verifier says (quantize/verify_contacts.c), which with zero and negative lengths is not where they do in the complex; blocks without extent are passed
 * through. Coordinates are in half hexes, so centres of cubes are odd and corners even.
 */
#ifndef BW_HEX_PLAN_H
#define BW_HEX_PLAN_H

#include "quantize/verify_parts.h"

/* A rectangle of a block's side, and what it leads to. */
typedef struct {
    int64_t low[3], high[3];
    bw_transition to; /* to the chart of `block` */
    bw_block block;   /* BW_NONE: outside */
    bw_patch patch;   /* outside: on which */
} bw_plan_square;

typedef struct {
    bw_verifier verifier;
    bw_verdict verdict;
    int32_t subdivide;
    int64_t (*size)[3];     /* [block] half hexes */
    size_t *square_begin;   /* [6 * block + side] */
    bw_plan_square *square;
    uint64_t cubes;
} bw_hex_plan;

/* A cube, seen by someone whose axes are turned: `turn` carries them to those of the block. */
typedef struct {
    bw_block block;
    int64_t centre[3];
    bw_rotation turn;
} bw_plan_cube;

typedef enum { BW_PLAN_CUBE, BW_PLAN_OUTSIDE, BW_PLAN_NOTHING } bw_plan_step;

/* BW_E_LIMIT if so many hexes, each cut in subdivide^3, are more than max_hexes. */
bw_status bw_hex_plan_limit(bw_context *ctx, uint64_t hexes, int32_t subdivide, uint64_t max_hexes);
/* BW_E_CHECK if the lengths are not valid; BW_E_LIMIT beyond 2^32 - 1 hexes. After a failure too *plan is to be cleared. */
bw_status bw_hex_plan_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, int32_t subdivide, bw_hex_plan *plan);
void bw_hex_plan_clear(bw_context *ctx, bw_hex_plan *plan);

/* The cube beyond face 2 * axis + (0 low | 1 high) of a cube, by the viewer's axes. Outside, *patch is where. NOTHING: the plan has a gap there, which no valid
 * quantization has. O(squares of the side). */
bw_plan_step bw_hex_plan_step(const bw_hex_plan *plan, const bw_plan_cube *from, int face, bw_plan_cube *to, bw_patch *patch);

#endif
