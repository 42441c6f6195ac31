/* A sample model encoded into a folder: what the tests of the result files start from. */
#ifndef BW_TESTS_CORE_ENCODE_KIT_H
#define BW_TESTS_CORE_ENCODE_KIT_H

#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>

#include "core/sample_map.h"
#include "stage/build.h"
#include "stage/encode.h"
#include "stage/trace.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
    bw_report report;
    const char *folder;
    int64_t *length; /* NULL unless quantized */
} encoded;

/* The stages between the sanitized map, which e->mesh and e->map hold, and encode. */
static inline void encode_trace_and_build(encoded *e, bw_complex_kind kind) {
    kit_expect_ok(&e->ctx, bw_cells_init(&e->ctx, &e->cells, &e->mesh, &e->map));
    kit_expect_ok(&e->ctx, bw_trace(&e->ctx, &e->cells, kind, UINT64_MAX));
    kit_expect_ok(&e->ctx, bw_build_complex(&e->ctx, &e->cells, &(bw_build_options){.max_cells = UINT64_MAX}, &e->complex));
    bw_report_init(&e->report);
    bw_report_fill_input(&e->report, &e->mesh);
    bw_report_fill_singular(&e->report, &e->mesh, &e->map);
    bw_report_fill_trace(&e->report, &e->cells);
    static const char *const names[] = {"mc", "bc", "serial"};
    bw_report_fill_complex(&e->report, &e->complex, names[kind]);
}

static inline void encode_prepare(encoded *e, const char *name, int size, double noise,
                                  bw_complex_kind kind) {
    memset(e, 0, sizeof *e);
    bw_context_init(&e->ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = noise, options.seed = kit_seed();
    kit_expect_ok(&e->ctx, sample_map(&e->ctx, name, &options, &e->mesh, &e->map));
    encode_trace_and_build(e, kind);
    e->folder = kit_temp_path("%s-%d-%d", name, size, (int)kind);
}

static inline void encode_run_with(encoded *e, const bw_encode_options *options) {
    kit_expect_ok(&e->ctx, bw_encode(&e->ctx, &e->mesh, &e->map, &e->cells, &e->complex, e->length, NULL, options, &e->report, e->folder));
}

static inline void encode_run(encoded *e) { encode_run_with(e, &(bw_encode_options){0}); }

static inline char *encode_read(const encoded *e, const char *file, size_t *size) {
    return kit_read_file(kit_temp_path("%s/%s", strrchr(e->folder, '/') + 1, file), size);
}

static inline void encode_clear(encoded *e) {
    bw_free(&e->ctx, e->length);
    bw_complex_clear(&e->ctx, &e->complex);
    bw_cells_clear(&e->ctx, &e->cells);
    bw_grid_map_clear(&e->ctx, &e->map);
    bw_tet_mesh_clear(&e->ctx, &e->mesh);
    assert_int_equal(e->ctx.memory.used, 0);
}

#endif
