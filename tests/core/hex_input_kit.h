/* A hex mesh as a reader leaves it, and what becomes of it: its tets, their map, a complex of them. */
#ifndef BW_TESTS_CORE_HEX_INPUT_KIT_H
#define BW_TESTS_CORE_HEX_INPUT_KIT_H

#include "core/hex_kit.h"

#include "hex/trivial.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_hex_mesh source;
    bw_vertex *source_vertex;
    bw_trivial_report report;
    bw_cells cells;
    bw_complex complex;
} hex_input;

/* `hex`, hexes in the order given ([place] hex; NULL: as they are), vertex v with the number number[v] (NULL: likewise). */
static inline void hex_input_read(hex_input *in, const bw_hex_mesh *hex, const size_t *order, const bw_vertex *number) {
    memset(in, 0, sizeof *in);
    bw_context_init(&in->ctx);
    bw_tet_mesh *m = &in->mesh;
    m->vertex_count = hex->vertex_count, m->hex_count = hex->hex_count;
    m->position = bw_alloc(&in->ctx, m->vertex_count, sizeof *m->position);
    m->hex = bw_alloc(&in->ctx, m->hex_count, sizeof *m->hex);
    for (size_t v = 0; v < m->vertex_count; v++) memcpy(m->position[number ? (size_t)number[v] : v], hex->position[v], sizeof *m->position);
    for (size_t i = 0; i < 8 * m->hex_count; i++) {
        bw_hvertex v = hex->hex[order ? order[i / 8] : i / 8][i % 8];
        m->hex[i / 8][i % 8] = number ? number[v] : v;
    }
}

static inline bw_status hex_input_split(hex_input *in) {
    return bw_trivial_map(&in->ctx, &in->mesh, &in->map, &in->source, &in->source_vertex, &in->report);
}

static inline void hex_input_map(hex_input *in) {
    bw_sanitize_report report;
    kit_expect_ok(&in->ctx, hex_input_split(in));
    kit_expect_ok(&in->ctx, bw_sanitize(&in->ctx, &(bw_sanitize_options){.tolerance = 0}, &in->mesh, &in->map, &report));
    assert_true(report.already_exact);
}

/* Labels the hexes too. */
static inline void hex_input_build(hex_input *in, bw_complex_kind kind, bw_reduce_mode mode, bool split) {
    bw_context *ctx = &in->ctx;
    bw_reduce_report reduced;
    kit_expect_ok(ctx, bw_cells_init(ctx, &in->cells, &in->mesh, &in->map));
    kit_expect_ok(ctx, bw_trace(ctx, &in->cells, kind, 1000));
    kit_expect_ok(ctx, bw_build_complex(ctx, &in->cells, &(bw_build_options){.max_cells = 1000, .split_self_adjacent = split}, &in->complex));
    kit_expect_ok(ctx, bw_reduce(ctx, &in->cells, &in->complex, &(bw_reduce_options){mode, split, 1}, &reduced));
    kit_expect_ok(ctx, bw_trivial_label(ctx, &in->cells, &in->complex, &in->source));
    kit_expect_ok(ctx, bw_trivial_hold(ctx, &in->mesh, &in->map, &in->source));
}

static inline void hex_input_clear(hex_input *in) {
    bw_complex_clear(&in->ctx, &in->complex);
    bw_cells_clear(&in->ctx, &in->cells);
    bw_grid_map_clear(&in->ctx, &in->map);
    bw_tet_mesh_clear(&in->ctx, &in->mesh);
    bw_hex_mesh_clear(&in->ctx, &in->source);
    bw_free(&in->ctx, in->source_vertex);
    assert_int_equal(in->ctx.memory.used, 0);
}

static inline void hex_input_shuffle(kit_random *random, size_t *list, size_t count) {
    for (size_t i = 0; i < count; i++) list[i] = i;
    for (size_t i = count; i > 1; i--) {
        size_t j = (size_t)kit_random_below(random, i), keep = list[i - 1];
        list[i - 1] = list[j], list[j] = keep;
    }
}

/* The number of a vertex after a shuffle; free() it. */
static inline bw_vertex *hex_input_numbers(kit_random *random, size_t count) {
    size_t *list = calloc(count, sizeof *list);
    bw_vertex *number = calloc(count, sizeof *number);
    hex_input_shuffle(random, list, count);
    for (size_t i = 0; i < count; i++) number[i] = (bw_vertex)list[i];
    free(list);
    return number;
}

#endif
