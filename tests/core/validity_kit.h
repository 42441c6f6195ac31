/* A complex ready to be quantized: from a sample model, a flat manifold or a file, as traced or reduced.
 */
#ifndef BW_TESTS_CORE_VALIDITY_KIT_H
#define BW_TESTS_CORE_VALIDITY_KIT_H

#include "kit/kit.h"

#include <math.h>
#include <stdlib.h>

#include "core/flat_kit.h"
#include "format/input.h"
#include "models/models.h"
#include "quantize/quantizer.h"
#include "quantize/validity.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
    bw_quant_model model;
    bw_validity *validity;
    int64_t *length; /* [arc] for the test's use */
    char name[160];
} quantizable;

/* From the mesh as read in q->mesh. */
static inline void quantizable_build(quantizable *q, bw_complex_kind kind, bw_reduce_mode mode) {
    bw_sanitize_report report;
    bw_reduce_report reduced;
    const uint64_t enough = 10000000;
    bw_context *ctx = &q->ctx;
    kit_expect_ok(ctx, bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 1e-2}, &q->mesh, &q->map, &report));
    kit_expect_ok(ctx, bw_cells_init(ctx, &q->cells, &q->mesh, &q->map));
    kit_expect_ok(ctx, bw_trace(ctx, &q->cells, kind, enough));
    kit_expect_ok(ctx, bw_build_complex(ctx, &q->cells, &(bw_build_options){.max_cells = enough}, &q->complex));
    if (mode != BW_REDUCE_NONE)
        kit_expect_ok(ctx, bw_reduce(ctx, &q->cells, &q->complex, &(bw_reduce_options){.mode = mode, .effort = 1}, &reduced));
    kit_expect_ok(ctx, bw_quant_model_init(ctx, &q->complex, q->map.exponent, &q->model));
    kit_expect_ok(ctx, bw_validity_new(ctx, &q->cells, &q->complex, &q->validity));
    q->length = calloc(q->complex.arc_count, sizeof *q->length);
    assert_non_null(q->length);
}

static inline void quantizable_take(quantizable *q, bw_model *model) {
    q->mesh.vertex_count = model->vertex_count, q->mesh.tet_count = model->tet_count;
    q->mesh.position = model->position, q->mesh.tet = model->tet, q->mesh.parameter = model->parameter;
    q->mesh.feature_vertex_count = model->feature_vertex_count, q->mesh.feature_edge_count = model->feature_edge_count;
    q->mesh.feature_vertex = model->feature_vertex, q->mesh.feature_edge = model->feature_edge;
    model->position = NULL, model->tet = NULL, model->parameter = NULL, model->feature_vertex = NULL, model->feature_edge = NULL;
    bw_model_clear(&q->ctx, model);
}

static inline void quantizable_open(quantizable *q, const char *name, const bw_model_options *options, bw_complex_kind kind,
                                    bw_reduce_mode mode) {
    bw_model model;
    memset(q, 0, sizeof *q);
    bw_context_init(&q->ctx);
    snprintf(q->name, sizeof q->name, "%s size %d seed %llu features %d kind %d mode %d", name, options->size,
             (unsigned long long)options->seed, options->features, (int)kind, (int)mode);
    kit_expect_ok(&q->ctx, bw_model_make(&q->ctx, name, options, &model));
    quantizable_take(q, &model);
    quantizable_build(q, kind, mode);
}

static inline void quantizable_open_flat(quantizable *q, const flat_shape *shape, bw_reduce_mode mode) {
    bw_model model;
    memset(q, 0, sizeof *q);
    bw_context_init(&q->ctx);
    snprintf(q->name, sizeof q->name, "%s mode %d", shape->name, (int)mode);
    kit_expect_ok(&q->ctx, flat_make(&q->ctx, shape, 0.2, 1, &model));
    quantizable_take(q, &model);
    quantizable_build(q, BW_COMPLEX_MC, mode);
}

static inline void quantizable_open_file(quantizable *q, const char *folder, const char *file, bw_reduce_mode mode) {
    char path[512];
    memset(q, 0, sizeof *q);
    bw_context_init(&q->ctx);
    snprintf(path, sizeof path, "%s/%s", folder, file);
    snprintf(q->name, sizeof q->name, "%s mode %d", file, (int)mode);
    kit_expect_ok(&q->ctx, bw_input_read(&q->ctx, path, NULL, &q->mesh));
    quantizable_build(q, BW_COMPLEX_MC, mode);
}

static inline void quantizable_close(quantizable *q) {
    bw_validity_free(&q->ctx, q->validity);
    bw_quant_model_clear(&q->ctx, &q->model);
    bw_complex_clear(&q->ctx, &q->complex);
    bw_cells_clear(&q->ctx, &q->cells);
    bw_grid_map_clear(&q->ctx, &q->map);
    bw_tet_mesh_clear(&q->ctx, &q->mesh);
    free(q->length);
    assert_int_equal(q->ctx.memory.used, 0);
}

#endif
