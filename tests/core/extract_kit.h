/* Integer-grid maps for the tests of extraction: sample models whose cells are unit cubes, flat manifolds, files. */
#ifndef BW_TESTS_CORE_EXTRACT_KIT_H
#define BW_TESTS_CORE_EXTRACT_KIT_H

#include "kit/kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/flat_kit.h"
#include "format/input.h"
#include "hex/extract.h"
#include "models/models.h"
#include "stage/sanitize.h"

typedef struct {
    bw_context ctx;
    bw_igm igm;
    bw_hex_mesh mesh;
    bw_hex_origin origin;
    char name[200];
} extractable;

static inline void extractable_sanitize(extractable *x) {
    bw_sanitize_report report;
    kit_expect_ok(&x->ctx, bw_sanitize(&x->ctx, &(bw_sanitize_options){.tolerance = 1e-2}, &x->igm.mesh, &x->igm.map, &report));
}

static inline void extractable_take(extractable *x, bw_model *model) {
    bw_tet_mesh *m = &x->igm.mesh;
    m->vertex_count = model->vertex_count, m->tet_count = model->tet_count;
    m->position = model->position, m->tet = model->tet, m->parameter = model->parameter;
    m->feature_vertex_count = model->feature_vertex_count, m->feature_edge_count = model->feature_edge_count;
    m->feature_vertex = model->feature_vertex, m->feature_edge = model->feature_edge;
    model->position = NULL, model->tet = NULL, model->parameter = NULL, model->feature_vertex = NULL, model->feature_edge = NULL;
    bw_model_clear(&x->ctx, model);
    extractable_sanitize(x);
}

static inline void extractable_open(extractable *x, const char *name, int size, double noise, int features, uint64_t seed) {
    bw_model_options options;
    bw_model model;
    memset(x, 0, sizeof *x);
    bw_context_init(&x->ctx);
    bw_model_options_defaults(&options);
    options.size = size, options.noise = noise, options.features = features, options.seed = seed, options.integral = 1;
    options.scramble = (int)(seed % 4); /* BW_SCRAMBLE_NONE to _TETS */
    snprintf(x->name, sizeof x->name, "%s size %d noise %g features %d seed %llu", name, size, noise, features, (unsigned long long)seed);
    kit_expect_ok(&x->ctx, bw_model_make(&x->ctx, name, &options, &model));
    extractable_take(x, &model);
}

/* One unit per half cell, so boxes as small as the shape. */
static inline void extractable_open_flat(extractable *x, const flat_shape *shape, double noise, uint64_t seed) {
    bw_model model;
    memset(x, 0, sizeof *x);
    bw_context_init(&x->ctx);
    snprintf(x->name, sizeof x->name, "%s noise %g seed %llu", shape->name, noise, (unsigned long long)seed);
    kit_expect_ok(&x->ctx, flat_make(&x->ctx, shape, noise, seed, &model));
    for (size_t i = 0; i < 12 * model.tet_count; i++) {
        double *u = &model.parameter[i / 12][i / 3 % 4][i % 3];
        *u = i % 3 ? *u / 0.3125 : *u / 0.375; /* exact: multiples of 2^-12 */
        *u = round(*u * 0x1p12) * 0x1p-12;
    }
    extractable_take(x, &model);
}

static inline void extractable_open_file(extractable *x, const char *path) {
    memset(x, 0, sizeof *x);
    bw_context_init(&x->ctx);
    const char *slash = strrchr(path, '/');
    snprintf(x->name, sizeof x->name, "%s", slash ? slash + 1 : path);
    kit_expect_ok(&x->ctx, bw_input_read(&x->ctx, path, NULL, &x->igm.mesh));
    extractable_sanitize(x);
}

static inline void extractable_extract(extractable *x, int32_t subdivide) {
    kit_expect_ok(&x->ctx, bw_hex_extract(&x->ctx, &x->igm, subdivide, 10000000, &x->mesh, &x->origin));
}

static inline void extractable_drop(extractable *x) {
    bw_hex_mesh_clear(&x->ctx, &x->mesh);
    bw_hex_origin_clear(&x->ctx, &x->origin);
}

static inline void extractable_close(extractable *x) {
    extractable_drop(x);
    bw_igm_clear(&x->ctx, &x->igm);
    assert_int_equal(x->ctx.memory.used, 0);
}

#endif
