/* Convex polyhedra with exact rational corners, cut by planes: what igm/overlay.c cuts cells of the complex into.
 *
 * Coordinates are those of a block's chart, in half grid units. Faces keep all their corners, straight ones among them, so that pieces that share a face or a part of an
 * edge have the same corners there.
 */
#ifndef BW_IGM_PIECES_H
#define BW_IGM_PIECES_H

#include <gmp.h>

#include "base/context.h"

/* normal . x = offset; positive inside. */
typedef struct {
    mpz_t normal[3], offset;
    double n[3], d;     /* the same, rounded */
    int64_t through[3]; /* a point of the plane */
} bw_cutter;

typedef struct {
    mpq_t x[3];
    double at[3];   /* rounded */
    int32_t vertex; /* the caller's number; BW_NONE for a corner that a cut made */
} bw_corner;

typedef struct {
    size_t begin, count; /* in `loop` */
    int32_t tag;         /* face of the polyhedron that was cut; BW_NONE for a face that a cut made */
} bw_piece_face;

/* Reused from piece to piece: corners stay initialised. */
typedef struct {
    bw_corner *corner;
    size_t corner_count, corner_ready, corner_room;
    bw_piece_face *face;
    size_t face_count, face_room;
    int32_t *loop;
    size_t loop_count, loop_room;
    struct { /* scratch of bw_piece_cut */
        int8_t *side;          /* [corner of the polyhedron that is cut] */
        int32_t *copy;         /* [likewise]: its number here; BW_NONE */
        int32_t (*crossed)[3]; /* edges that were crossed: two corners there, the corner here */
        int32_t (*rim)[2];     /* edges here that lie in the plane */
        uint8_t *flat;         /* [corner here] it is on the plane */
        size_t crossings, rims, side_room, copy_room, crossing_room, rim_room, flat_room;
    } cut;
} bw_piece;

void bw_cutter_init(bw_cutter *cutter, const int64_t a[3], const int64_t b[3], const int64_t c[3], const int64_t inside[3]);
void bw_cutter_clear(bw_cutter *cutter);
/* Sign of a point's distance. Exact. */
int bw_cutter_side(const bw_cutter *cutter, const bw_corner *corner);

void bw_piece_clear(bw_context *ctx, bw_piece *piece);
void bw_piece_empty(bw_piece *piece);
/* A new corner at zero, and a corner of the open loop; bw_piece_close ends the loop as a face, or drops it if it has less than three corners. */
bw_status bw_piece_corner(bw_context *ctx, bw_piece *piece, int32_t *corner);
bw_status bw_piece_put(bw_context *ctx, bw_piece *piece, int32_t corner);
bw_status bw_piece_close(bw_context *ctx, bw_piece *piece, int32_t tag);
void bw_corner_round(bw_corner *corner); /* sets `at` after `x` was set */

/* The part of `from` on the positive side, into `to`; empty if that has no volume. BW_E_CHECK if `from` is not convex. */
bw_status bw_piece_cut(bw_context *ctx, const bw_piece *from, const bw_cutter *cutter, bw_piece *to);
/* Sign of the volume of a tet of corners. Exact. */
int bw_corner_sign(const bw_corner *a, const bw_corner *b, const bw_corner *c, const bw_corner *d);
bool bw_corner_collinear(const bw_corner *a, const bw_corner *b, const bw_corner *c);

#endif
