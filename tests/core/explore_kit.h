/* The base complex of a sample model with its space of choices: what the tests of explore start from. */
#ifndef BW_TESTS_CORE_EXPLORE_KIT_H
#define BW_TESTS_CORE_EXPLORE_KIT_H

#include "core/reduce_kit.h"
#include "explore/insert.h"
#include "explore/regions.h"

typedef struct {
    reducible model;
    bw_space space;
    bw_serial serial;
    bw_regions regions;
    bw_sheet *order;
    uint8_t *wall;
} explorable;

typedef struct {
    const char *model;
    int size;
    uint64_t seed;
    double perturb;
} explore_case;

/* `perturb`: nearly coincident walls, so many more sheets cross. */
static inline void explorable_open(explorable *e, const explore_case *c) {
    bw_model_options options = reduce_options_of(c->size, c->seed);
    options.perturb = c->perturb;
    memset(e, 0, sizeof *e);
    reducible_open(&e->model, c->model, &options, BW_COMPLEX_BC, false);
    bw_context *ctx = &e->model.ctx;
    kit_expect_ok(ctx, bw_space_init(ctx, &e->model.cells, &e->model.raw, &e->space));
    kit_expect_ok(ctx, bw_serial_init(ctx, &e->space, &e->serial));
    kit_expect_ok(ctx, bw_regions_init(ctx, &e->space, &e->regions));
    e->order = malloc((e->space.sheet_count + 1) * sizeof *e->order);
    e->wall = malloc(e->space.patch_count);
    assert_true(e->order && e->wall);
    for (size_t i = 0; i < e->space.sheet_count; i++) e->order[i] = (bw_sheet)i;
}

static inline void explorable_close(explorable *e) {
    bw_context *ctx = &e->model.ctx;
    bw_regions_clear(ctx, &e->regions);
    bw_serial_clear(ctx, &e->serial);
    bw_space_clear(ctx, &e->space);
    free(e->order), free(e->wall);
    reducible_close(&e->model);
}

static inline void explorable_shuffle(explorable *e, kit_random *random) {
    for (size_t i = e->space.sheet_count; i > 1; i--) {
        size_t j = kit_random_below(random, i);
        bw_sheet swap = e->order[i - 1];
        e->order[i - 1] = e->order[j], e->order[j] = swap;
    }
}

/* Blocks of the complex that has these walls, built from the cells and verified; 0 if it is none. */
static inline size_t explorable_build(explorable *e, const uint8_t *wall) {
    bw_context apart = e->model.ctx;
    bw_complex x;
    size_t tori;
    reducible_restore(&e->model);
    for (size_t p = 0; p < e->space.patch_count; p++)
        if (!wall[p]) reducible_set_wall(&e->model, p, false);
    bw_status status = reducible_read(&apart, &e->model, &x, &tori);
    size_t blocks = status == BW_OK && !tori && bw_complex_check(&apart, &e->model.cells, &x) == BW_OK ? x.block_count : 0;
    if (apart.error.status != BW_OK) print_message("%s: %s\n", e->model.name, apart.error.message);
    bw_complex_clear(&apart, &x);
    e->model.ctx.memory = apart.memory;
    reducible_restore(&e->model);
    return blocks;
}

/* Several shapes of complexes: trees of blocks, rings, holes, tori, singular arcs inside and on the boundary. */
static const explore_case explore_cases[] = {
    {"cuboid", 3, 1, 0},  {"l-shape", 3, 1, 0},       {"plus", 3, 1, 0},        {"cylinder", 3, 1, 0},      {"cylinder", 3, 2, 1e-5},
    {"ball", 3, 1, 0},    {"ball", 3, 2, 1e-5},        {"torus", 3, 1, 0},       {"torus-quarter", 3, 1, 0}, {"torus-half", 3, 1, 0},
    {"tee", 2, 1, 0},     {"tee", 2, 2, 1e-5},         {"plate", 2, 1, 0},       {"plate", 2, 2, 1e-5},       {"hollow-torus", 3, 1, 0},
    {"bearing", 2, 1, 0}, {"bearing", 2, 2, 1e-5},     {"part", 2, 1, 0},
};
enum { EXPLORE_CASES = sizeof explore_cases / sizeof *explore_cases };

#endif
