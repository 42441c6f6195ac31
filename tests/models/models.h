/* Sample models: tet meshes with seamless volumetric maps whose structure is known.
 *
 * A model starts as a layout of a few hexahedral blocks glued face to face (layout.h). Every class of
 * parallel edges of the layout (sheet) gets a real length, so the map that sends each block to its box is
 * seamless by construction; no length is a multiple of another, so nothing lies on an integer grid. Every
 * block is cut into grid cells and every cell into tets, conformingly; with noise the vertices then leave the
 * grid, in parameter and in space alike, so that no tet facet lies on the wall between two blocks any more.
 *
 * Invariants of a model made with perturb = 0 and folds = 0
 *  1. Every tet is positive in space and in the parametrization.
 *  2. Across every interior facet the parameters are related by one of the 24 rotations and a translation,
 * and every boundary facet is constant in one parameter: exactly, for all parameters are multiples of 2^-32.
 *  3. Singular edges of the map are exactly the tet edges on the layout's singular edges.
 *  4. The same name and options give the same bytes.
 */
#ifndef BW_TESTS_MODELS_H
#define BW_TESTS_MODELS_H

#include <stdio.h>

#include "base/context.h"

typedef struct {
    const char *name, *title;
    int blocks_bc;       /* of the base complex, perturb = 0; the same before and after tori are split */
    int euler;           /* vertices - edges + facets - tets */
    int singular_inside; /* interior singular curves, counted between their end nodes */
} bw_model_info;

/* What shares one chart. */
enum { BW_SCRAMBLE_NONE, BW_SCRAMBLE_BLOCKS, BW_SCRAMBLE_CELLS, BW_SCRAMBLE_TETS };

/* size      grid cells along the shortest sheet, 1..64; longer sheets get more in proportion
 * count     number of holes of "plate", 1..16; 0: as many as its bw_model_info says
 * stretch   sheet lengths are multiplied by stretch^(-1/2), 1, stretch^(1/2) in turn; 0.01..100
 * noise     0..1; vertices leave their grid place by up to 0.45 cells times this
 * perturb   0..0.02; random errors of every tet's parameters, relative to the shortest edge in the map;
 * however small, they part singular edges that lay on one wall, so the base complex may get more blocks seed
 * of noise, perturb, scramble and folds scramble  BW_SCRAMBLE_*: charts turned and moved at random; NONE combs them
 * along a spanning tree of blocks features  1: sharp edges and corners of the boundary of the map are listed
 * as features  folds  0..1000 vertices are moved past their neighbours in the parametrization, so that tets around them
 * are inverted; transitions, alignment and singular edges stay as they are
 * integral  1: every grid cell is a unit cube of the map, but for the noise: an integer-grid map, of as many hexes as there are cells
 */
typedef struct {
    int size, count;
    double stretch, noise, perturb;
    uint64_t seed;
    int scramble, features;
    int folds;
    int integral;
} bw_model_options;

typedef struct {
    size_t vertex_count, tet_count, feature_vertex_count, feature_edge_count;
    double (*position)[3];
    int32_t (*tet)[4];         /* positive: (p1-p0) x (p2-p0) . (p3-p0) > 0 */
    double (*parameter)[4][3]; /* [tet][corner][axis] */
    int32_t *feature_vertex;
    int32_t (*feature_edge)[2];
    int blocks_bc, euler, singular_inside; /* as in bw_model_info, for the options given */
} bw_model;

/* Ways to damage a valid model in one place. */
typedef enum {
    BW_DAMAGE_INVERT,      /* one tet inverted in the parametrization */
    BW_DAMAGE_DUPLICATE,   /* one tet listed twice */
    BW_DAMAGE_NONMANIFOLD, /* a facet shared by three tets */
    BW_DAMAGE_SEAM,        /* the chart of one tet 1 % too large: no rotation carries it to its neighbours */
    BW_DAMAGE_TILT,        /* boundary facets around one vertex not aligned; wants charts not scrambled */
    BW_DAMAGE_INDEX,       /* one corner names a vertex that is not there */
    BW_DAMAGE_NAN,         /* one parameter is not a number */
    BW_DAMAGE_COUNT
} bw_model_damage_kind;

const bw_model_info *bw_model_list(size_t *count); /* borrowed, static */
void bw_model_options_defaults(bw_model_options *options);

/* Makes the model of that name; *out is overwritten and must be given to bw_model_clear, also after a
 * failure. Errors: BW_E_USAGE for an unknown name or an option out of its range; BW_E_MEMORY. O(tets). */
bw_status bw_model_make(bw_context *ctx, const char *name, const bw_model_options *options, bw_model *out);
void bw_model_clear(bw_context *ctx, bw_model *model);

/* Writes the `.hexex` form: counts, positions, then corners and parameters of every tet, then the features if
 * there are any. Doubles are written with 16 digits where those read back to the same double, else 17.
 * Errors: BW_E_IO. */
bw_status bw_model_write(bw_context *ctx, const bw_model *model, FILE *file);
bw_status bw_model_save(bw_context *ctx, const bw_model *model, const char *path);

/* Damages `model` at a place chosen by `seed`. Errors: BW_E_MEMORY. */
bw_status bw_model_damage(bw_context *ctx, bw_model *model, bw_model_damage_kind kind, uint64_t seed);

#endif
