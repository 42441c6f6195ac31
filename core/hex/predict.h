/* How well the vertices of a block are foreseen from its eight corners, and what the rest costs to code: the cost E_g of X 4.1. And how near blocks are to
 * cubes (X 4.5).
 *
 * Positions are put on a lattice of 2^bits points along each axis of the mesh's box (X: 12 bits). A vertex of a block of l x m x n hexes is foreseen by trilinear
 * interpolation of the corners, at its place in the grid (X equation 1, with j running the same way on both sides); that is put on the lattice too, and
 * each coordinate's error has three parts: whether there is one, its sign, its magnitude. With the Shannon entropies E_z, E_s, E_m of these,
 *
 *     E_g = (3 N E_z + R (E_s + E_m)) / vertices of the mesh
 *
 * where N vertices are coded and R coordinates are wrong. Every block codes all vertices of its grid, corners included; so N counts a vertex of a wall once for each
 * block there. Entropies are of the whole mesh (pooled), or of each block by itself; then the products are summed over blocks.
 *
 * X prints one 3 E_z for all vertices together, which cannot be meant, and an equation (1) that is no interpolant.
 *
 * For a search: what a block is like is found once (bw_predict_errors) and added to a tally or taken away again in a time proportional to its distinct magnitudes.
 * Costs are integers, in units of 2^-BW_PREDICT_SHIFT bits, so they do not depend on the order in which blocks came and went.
 */
#ifndef BW_HEX_PREDICT_H
#define BW_HEX_PREDICT_H

#include "hex/grid.h"

enum { BW_PREDICT_BITS = 12, BW_PREDICT_MOST_BITS = 21, BW_PREDICT_SHIFT = 20 };

/* Positions on the lattice. */
typedef struct {
    const double (*position)[3]; /* [vertex], borrowed */
    int32_t (*at)[3];            /* [vertex] 0 .. 2^bits - 1 */
    double low[3], extent[3];    /* of the box; extent 1 where it is flat */
    int bits;
} bw_predictor;

/* Errors of blocks, counted. */
typedef struct {
    uint64_t coordinates;     /* 3 N */
    uint64_t wrong, negative; /* of them; an error is position minus what was foreseen */
    uint32_t *times;          /* [2^bits] how often each magnitude came; 0 is not counted */
    uint32_t highest;         /* no magnitude above it has come since bw_predict_tally_empty */
    int64_t repeated;         /* sum of n log2 n over `times`, in units of 2^-BW_PREDICT_SHIFT */
    int bits;
} bw_predict_tally;

typedef struct {
    uint32_t magnitude, times;
} bw_predict_times;

/* Errors of one block. */
typedef struct {
    uint64_t coordinates, wrong, negative;
    size_t count;
    bw_predict_times *list; /* [count] ascending by magnitude */
    int64_t cost;           /* with entropies of its own, in units of 2^-BW_PREDICT_SHIFT bits */
} bw_predict_errors;

void bw_predict_box(const double (*position)[3], size_t count, double low[3], double high[3]); /* 0 for none */

/* The box is that of all positions given. Requires bits in 1..BW_PREDICT_MOST_BITS, finite positions. Errors: BW_E_MEMORY. */
bw_status bw_predictor_init(bw_context *ctx, const double (*position)[3], size_t count, int bits, bw_predictor *predictor);
void bw_predictor_clear(bw_context *ctx, bw_predictor *predictor);

bw_status bw_predict_tally_init(bw_context *ctx, int bits, bw_predict_tally *tally);
void bw_predict_tally_clear(bw_context *ctx, bw_predict_tally *tally);
/* Forgets all it counted. O(highest). */
void bw_predict_tally_empty(bw_predict_tally *tally);

/* Adds the errors of a block of n hexes along each axis; vertex: its grid points, the first axis fastest. Allocates nothing, so threads may each fill a tally
 * of their own. O(points). */
void bw_predict_tally_block(const bw_predictor *predictor, const uint32_t n[3], const bw_hvertex *vertex, bw_predict_tally *tally);
/* The same blocks as errors, added or taken away (they must have been added). O(errors->count). */
void bw_predict_tally_add(bw_predict_tally *tally, const bw_predict_errors *errors);
void bw_predict_tally_remove(bw_predict_tally *tally, const bw_predict_errors *errors);
/* 3 N E_z + R (E_s + E_m) of all it holds, in units of 2^-BW_PREDICT_SHIFT bits. O(1). */
int64_t bw_predict_tally_cost(const bw_predict_tally *tally);

/* What a tally holds, as errors: the caller's. */
bw_status bw_predict_errors_init(bw_context *ctx, const bw_predict_tally *tally, bw_predict_errors *errors);
void bw_predict_errors_clear(bw_context *ctx, bw_predict_errors *errors);

/* Costs as bits per vertex. */
static inline double bw_predict_per_vertex(int64_t cost, size_t vertices) {
    return vertices ? (double)cost / (1 << BW_PREDICT_SHIFT) / (double)vertices : 0;
}

/* Longest side of a block by its shortest (X 4.5: the less the nearer to a cube, 1 at least), in hexes, and in the lengths of its edges: the mean over
 * the four along an axis of the polyline through its vertices. Infinite if a side has no length. */
double bw_cube_ratio(const uint32_t n[3]);
double bw_cube_ratio_of_lengths(const double (*position)[3], const uint32_t n[3], const bw_hvertex *vertex);

/* ---- a mesh with blocks -------------------------------------------------------------------------------------------- */

typedef struct {
    size_t blocks;               /* that are grids */
    uint64_t vertices_coded;     /* N, and of the mesh: */
    uint64_t vertices;
    uint64_t coordinates_wrong;  /* R */
    double e_g_pooled, e_g_blocks; /* bits per vertex */
    double cube_ratio, cube_ratio_lengths; /* summed over blocks */
} bw_predict_report;

/* For a mesh all of whose blocks are grids (hexmesh.h, invariant 4); *known is false, and nothing else is set, if it has none. Errors: BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_predict_mesh(bw_context *ctx, const bw_hex_mesh *mesh, int bits, bool *known, bw_predict_report *report);

#endif
