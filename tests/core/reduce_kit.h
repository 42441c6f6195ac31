/* A traced and built sample model that can be reduced again and again: what the tests of reduce start from.
 */
#ifndef BW_TESTS_CORE_REDUCE_KIT_H
#define BW_TESTS_CORE_REDUCE_KIT_H

#include "kit/kit.h"

#include <gmp.h>
#include <stdlib.h>

#include "core/sample_map.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/trace.h"

enum { REDUCE_MAX_CELLS = 1000000 };

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex raw;
    uint8_t *polygon_flags, *edge_flags; /* as build left them */
    char name[120];                      /* for messages */
} reducible;

static inline bw_model_options reduce_options_of(int size, uint64_t seed) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = 0.6, options.seed = seed;
    options.stretch = seed & 1 ? 1 : 1.7;
    return options;
}

static inline void reducible_open(reducible *r, const char *model, const bw_model_options *options,
                                  bw_complex_kind kind, bool split) {
    static const char *const names[] = {"mc", "bc", "serial"};
    memset(r, 0, sizeof *r);
    bw_context_init(&r->ctx);
    snprintf(r->name, sizeof r->name, "%s size %d seed %llu %s %s", model, options->size,
             (unsigned long long)options->seed, names[kind], split ? "split" : "allow");
    kit_expect_ok(&r->ctx, sample_map(&r->ctx, model, options, &r->mesh, &r->map));
    kit_expect_ok(&r->ctx, bw_cells_init(&r->ctx, &r->cells, &r->mesh, &r->map));
    kit_expect_ok(&r->ctx, bw_trace(&r->ctx, &r->cells, kind, REDUCE_MAX_CELLS));
    bw_build_options build = {.max_cells = REDUCE_MAX_CELLS, .split_self_adjacent = split};
    kit_expect_ok(&r->ctx, bw_build_complex(&r->ctx, &r->cells, &build, &r->raw));
    r->polygon_flags = malloc(r->cells.polygon_count);
    r->edge_flags = malloc(r->cells.edge_count);
    assert_true(r->polygon_flags && r->edge_flags);
    for (size_t p = 0; p < r->cells.polygon_count; p++) r->polygon_flags[p] = r->cells.polygon[p].flags;
    for (size_t e = 0; e < r->cells.edge_count; e++) r->edge_flags[e] = r->cells.edge[e].flags;
}

static inline void reducible_close(reducible *r) {
    bw_complex_clear(&r->ctx, &r->raw);
    bw_cells_clear(&r->ctx, &r->cells);
    bw_grid_map_clear(&r->ctx, &r->map);
    bw_tet_mesh_clear(&r->ctx, &r->mesh);
    free(r->polygon_flags), free(r->edge_flags);
    assert_int_equal(r->ctx.memory.used, 0);
}

/* Puts all walls back. */
static inline void reducible_restore(reducible *r) {
    for (size_t p = 0; p < r->cells.polygon_count; p++) r->cells.polygon[p].flags = r->polygon_flags[p];
    for (size_t e = 0; e < r->cells.edge_count; e++) r->cells.edge[e].flags = r->edge_flags[e];
}

/* The complex as the present walls have it; what bw_complex_build says of it. Clear *x in any case. */
static inline bw_status reducible_read(bw_context *ctx, reducible *r, bw_complex *x, size_t *tori) {
    bw_torus_list list = {0};
    memset(x, 0, sizeof *x);
    bw_status status = bw_complex_build(ctx, &r->cells, x, &list);
    *tori = list.count;
    bw_free(ctx, list.cell);
    return status;
}

/* Reduces from the unreduced complex; the caller clears *x. */
static inline bw_status reducible_reduce(bw_context *ctx, reducible *r, const bw_reduce_options *options,
                                         bw_complex *x, bw_reduce_report *report) {
    size_t tori;
    reducible_restore(r);
    bw_status status = reducible_read(ctx, r, x, &tori);
    if (status == BW_OK) status = bw_reduce(ctx, &r->cells, x, options, report);
    return status;
}

/* Whether an edge of a patch's rim is singular, from the map alone. */
static inline bool reducible_is_singular(const reducible *r, const bw_complex *x, size_t patch) {
    for (size_t i = x->patch_chain_begin[4 * patch]; i < x->patch_chain_begin[4 * patch + 4]; i++) {
        size_t arc = (size_t)(x->patch_chain[i] >> 1);
        for (size_t j = x->arc_edge_begin[arc]; j < x->arc_edge_begin[arc + 1]; j++)
            if (bw_cells_edge_is_singular(&r->cells, x->arc_edge[j])) return true;
    }
    return false;
}

static inline void reducible_set_wall(reducible *r, size_t patch, bool wall) {
    for (size_t i = r->raw.patch_polygon_begin[patch]; i < r->raw.patch_polygon_begin[patch + 1]; i++) {
        bw_polygon p = r->raw.patch_polygon[i];
        r->cells.polygon[p].flags = wall ? r->polygon_flags[p] : 0;
    }
}

/* The sum of the volumes of all boxes, in cubic grid units. */
static inline void complex_volume(const bw_complex *x, mpz_t sum) {
    mpz_t box;
    mpz_init(box);
    mpz_set_ui(sum, 0);
    for (size_t b = 0; b < x->block_count; b++) {
        mpz_set_si(box, (long)x->block_extent[b][0]);
        mpz_mul_si(box, box, (long)x->block_extent[b][1]);
        mpz_mul_si(box, box, (long)x->block_extent[b][2]);
        mpz_add(sum, sum, box);
    }
    mpz_clear(box);
}

static inline long complex_euler(const bw_complex *x) {
    return (long)x->node_count - (long)x->arc_count + (long)x->patch_count - (long)x->block_count;
}

#endif
