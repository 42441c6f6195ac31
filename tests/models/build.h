/* Private to the sample models: what the steps of bw_model_make share. */
#ifndef BW_TESTS_MODELS_BUILD_H
#define BW_TESTS_MODELS_BUILD_H

#include "models/layout.h"
#include "models/models.h"

typedef struct {
    bw_context *ctx;
    const bw_model_options *options;
    bw_layout layout;
    bw_model *model; /* parameters are in the charts of the layout's blocks until bw_charts_apply */
    int32_t *edge_first, *face_first, *block_first; /* first grid vertex inside each element */
    int32_t *star;     /* [vertex] the element it lies on: index into layout.star */
    double (*home)[3]; /* [vertex] its parameters in the chart of the first block of its star */
    int32_t *tet_block;
    int32_t *tet_cell;
} bw_build;

/* shapes.c: the layout of a model. count: as in the options. BW_E_USAGE for an unknown name. */
bw_status bw_shape_make(const char *name, int count, bw_layout *layout);

/* grid.c: cuts the blocks into cells and tets. */
bw_status bw_grid_make(bw_build *build);
/* Grid vertex of a block; index[axis] in 0..cells. */
int32_t bw_grid_vertex(const bw_build *build, int32_t block, const int index[3]);

/* noise.c: vertices leave the grid; folds; charts; errors of single tets. */
bw_status bw_noise_apply(bw_build *build);
bw_status bw_folds_apply(bw_build *build);
bw_status bw_charts_apply(bw_build *build);
bw_status bw_perturb_apply(bw_build *build);

/* Reproducible random numbers (splitmix64). */
static inline uint64_t bw_random(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}
static inline double bw_random_signed(uint64_t *state) { /* -1..1 */
    return (double)(bw_random(state) >> 11) * 0x1p-52 - 1;
}

static inline double bw_volume6(const double *p, const double *q, const double *r, const double *s) {
    double a[3], b[3], c[3];
    for (int i = 0; i < 3; i++) a[i] = q[i] - p[i], b[i] = r[i] - p[i], c[i] = s[i] - p[i];
    return (a[1] * b[2] - a[2] * b[1]) * c[0] + (a[2] * b[0] - a[0] * b[2]) * c[1] +
           (a[0] * b[1] - a[1] * b[0]) * c[2];
}

#endif
