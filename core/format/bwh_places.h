/* Coordinates of the compact hex mesh (hex_bwh.h): what they are coded as, how they are foreseen, and the models of what is left.
 *
 * Vertices come one after another, each beside vertices that are there: those one step back along each of the axes. By the number of axes along which
 * there are such:
 *   0  the vertex before it;
 *   1  the line through the last two;
 *   2  the parallelogram, and of what it failed by at the neighbours (e_a, e_b, e_ab) (2 e_a + 2 e_b - e_ab) / 4: half way to the next order, which follows
 *      curved walls without following their noise;
 *   3  the parallelepiped, that is what a sum of functions of two axes each would be.
 * How large the rest is, is told by its number of bits, in a context of those at the neighbours; its sign, by theirs; the bit after its highest has a model as
 * well, those below are noise and are written as they are.
 *
 * All sums are of doubles in a fixed order, and of integers below 2^50 where coordinates are coded as such; the only products are by powers of two. So every machine
 * gets the same bits.
 */
#ifndef BW_FORMAT_BWH_PLACES_H
#define BW_FORMAT_BWH_PLACES_H

#include "format/hex_bwh.h"
#include "format/range_coder.h"

enum {
    BW_BWH_CLASSES = 4, /* neighbours, 0..3 */
    BW_BWH_HIGH = 0,                                        /* [class][expected / 4][tree of 3]: bits / 16 */
    BW_BWH_LOW = BW_BWH_HIGH + BW_BWH_CLASSES * 17 * 8,     /* [class][expected][bits / 16][tree of 4]: bits % 16 */
    BW_BWH_SIGN = BW_BWH_LOW + BW_BWH_CLASSES * 65 * 5 * 16, /* [class][signs of neighbours, base 3] */
    BW_BWH_NEXT = BW_BWH_SIGN + BW_BWH_CLASSES * 27,        /* [bits]: the bit after the highest */
    BW_BWH_PLACE_MODELS = BW_BWH_NEXT + 65
};

/* Neighbours of a vertex, by their numbers: at[i + 3 j + 9 k] is i, j, k steps back along the axes, -1 if it is not there. Two steps matter where there
 * are one or two axes. */
typedef struct {
    unsigned axes; /* along which there is one: bits */
    int32_t at[27];
} bw_bwh_near;

typedef struct {
    bw_context *ctx;
    bw_bwh_kind kind;
    int parameter;
    double low[3], step[3];
    double scale;         /* 10^parameter */
    double (*value)[3];   /* [number] what is coded: a whole number, or the coordinate */
    uint8_t (*bits)[3];   /* [number] bits of what was left, */
    uint8_t (*sign)[3];   /* and its sign: 0 none, 1 positive, 2 negative */
    size_t count;
    bw_range_encoder coder;
    bw_bit_writer plain;
    bw_bit_model *model;
} bw_bwh_places;

/* bits as in bw_bwh_write. */
bw_status bw_bwh_places_init(bw_context *ctx, const bw_hex_mesh *mesh, int bits, bw_bwh_places *places);
void bw_bwh_places_clear(bw_bwh_places *places);
/* Codes a position of the mesh, which gets the next number. Requires fewer than its vertices so far. */
void bw_bwh_places_put(bw_bwh_places *places, const double position[3], const bw_bwh_near *near);

#endif
