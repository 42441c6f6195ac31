/* Hexahedral block layouts: the coarse structure every sample model is cut from.
 *
 *     6-------7     corners: bit a of a corner's number is its side on axis a
 *    /|      /|     faces:   2 * axis + side
 *   4-------5 |     edges:   4 * axis + (side on axis + 1) + 2 * (side on axis + 2), axes modulo 3;
 *   | 2-----|-3              from side 0 to side 1 of their axis
 *   |/      |/
 *   0-------1
 *
 * Invariants after bw_layout_finish
 *  1. Two blocks share a face (edge, node) iff their corners say so; no two edges have the same end nodes, no
 *     two faces the same nodes. A ring of blocks thus has at least three of them.
 *  2. No edge has an angle at which the map would be singular without turning anything (8 blocks inside, 4 on
 *     the boundary), so an edge is singular iff its star does not let a vertex leave it.
 *  3. Parallel edges (one sheet) have the same length and number of cells.
 */
#ifndef BW_TESTS_LAYOUT_H
#define BW_TESTS_LAYOUT_H

#include "base/context.h"

/* v[i] = sign[i] * u[axis[i]] */
typedef struct {
    int8_t axis[3], sign[3];
} bw_turn;

typedef struct {
    bw_turn turn;
    double shift[3];
} bw_move;

typedef struct {
    int32_t corner[8], face[6], edge[12];
    double point[8][3]; /* of the corners, before the layout's warp */
    int tag;            /* for the warp */
} bw_layout_block;

typedef struct {
    int32_t node[4];  /* ascending */
    int32_t block[2]; /* block[1] is -1 on the boundary */
} bw_layout_face;

typedef struct {
    int32_t node[2]; /* ascending */
    int32_t sheet, valence;
    bool boundary, curved;
    int axis;         /* of the arc, if curved */
    double centre[3]; /* of the arc */
} bw_layout_edge;

typedef struct {
    double length; /* in the parametrization */
    int cells;
} bw_sheet;

/* The blocks around an element, and how charts turn on the way to each. */
typedef struct {
    int32_t block;
    bw_turn turn; /* from the chart of the star's first block, which has the lowest number */
} bw_spoke;
typedef struct {
    size_t first, count; /* in bw_layout.spoke */
    bool free[3];        /* axes of the first block along which a vertex on this element may move */
} bw_star;

/* From pseudo-space, in which blocks are boxes with straight or circular edges, to space. */
typedef void (*bw_warp)(const double data[8], int tag, const double point[3], double out[3]);

typedef struct {
    bw_context *ctx;
    size_t node_count, block_count, face_count, edge_count, sheet_count, key_count, arc_count;
    size_t block_capacity, key_capacity, arc_capacity, spoke_count, spoke_capacity;
    bw_layout_block *block;
    bw_layout_face *face; /* by nodes, ascending */
    bw_layout_edge *edge;
    bw_sheet *sheet;
    bw_star *star; /* of every node, then edge, then face, then block */
    bw_spoke *spoke;
    struct bw_layout_key {
        int64_t key;
        int32_t node;
    } * key;
    bw_layout_edge *arc;
    bw_warp warp; /* NULL: none */
    double data[8];
    int blocks_bc, euler, singular_inside; /* declared by the shape */
} bw_layout;

void bw_layout_init(bw_context *ctx, bw_layout *layout);
void bw_layout_clear(bw_layout *layout);

/* Building. Nodes are named by keys of the shape's choosing; a new key makes a new node. A failure is kept in
 * layout->ctx and the calls after it do nothing. */
void bw_layout_block_add(bw_layout *layout, const int64_t key[8], const double point[8][3], int tag);
void bw_layout_alias(bw_layout *layout, int64_t key,
                     int64_t other); /* key names the node of other from now on */
/* The edge between two nodes is an arc around `centre`, in a plane of constant `axis`. */
void bw_layout_arc(bw_layout *layout, int64_t from, int64_t to, const double centre[3], int axis);

/* Derives faces, edges, sheets (with lengths measured in space, then made irregular and stretched, and `size`
 * cells along the shortest) and stars. Errors: BW_E_INTERNAL if an invariant does not hold. */
bw_status bw_layout_finish(bw_layout *layout, int size, double stretch, bool integral);

double bw_layout_length(const bw_layout *layout, int32_t block, int axis);
int bw_layout_cells(const bw_layout *layout, int32_t block, int axis);
/* Point of a block in space; local coordinates 0..1 inside. */
void bw_layout_point(const bw_layout *layout, int32_t block, const double local[3], double out[3]);
/* From the chart of a block across one of its interior faces. */
bw_move bw_layout_across(const bw_layout *layout, int32_t block, int face);
bool bw_layout_singular(const bw_layout *layout, int32_t edge);
int32_t bw_layout_find_edge(const bw_layout *layout, int32_t a, int32_t b);  /* -1 if there is none */
int32_t bw_layout_find_face(const bw_layout *layout, const int32_t node[4]); /* any order */
/* Number of blocks of the base complex, by extending walls from singular edges across regular ones (MC 2). */
bw_status bw_layout_base_complex(const bw_layout *layout, int *blocks);

/* Nearest multiple of 2^-32. Lengths of cells, parameters and chart shifts are such multiples and below 2^20,
 * so their sums are exact: singular edges that lie on a common wall do so exactly, whichever way the charts
 * go from one to the other. (Off by one rounding error, they would send two walls a hair apart, and the base
 * complex would be another.) */
double bw_snap(double value);

bw_turn bw_turn_identity(void);
bw_turn bw_turn_compose(bw_turn after, bw_turn before);
bw_turn bw_turn_number(int number); /* 0..23, 0 is the identity */
void bw_turn_apply(bw_turn turn, const double u[3], double out[3]);
void bw_move_apply(const bw_move *move, const double u[3], double out[3]);

#endif
