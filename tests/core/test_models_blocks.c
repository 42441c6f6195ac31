/* What the core finds in the sample models is what is known of them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "models/models.h"
#include "stage/build.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

typedef struct {
    size_t blocks, splits;
    double displacement;
} found;

static bw_status compute(bw_context *ctx, bw_tet_mesh *mesh, bw_complex_kind kind, double tolerance,
                         found *out) {
    const uint64_t enough = 10000000;
    bw_grid_map map = {0};
    bw_cells cells = {0};
    bw_complex complex = {0};
    bw_sanitize_report report = {0};
    bw_status status = bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = tolerance}, mesh, &map, &report);
    if (!status) status = bw_cells_init(ctx, &cells, mesh, &map);
    if (!status) status = bw_trace(ctx, &cells, kind, enough);
    if (!status) status = bw_build_complex(ctx, &cells, &(bw_build_options){.max_cells = enough}, &complex);
    *out = (found){complex.block_count, (size_t)complex.torus_splits, report.displacement_max};
    bw_complex_clear(ctx, &complex);
    bw_cells_clear(ctx, &cells);
    bw_grid_map_clear(ctx, &map);
    return status;
}

/* The mesh owns the model's arrays from now on. */
static bw_tet_mesh take(bw_model *model) {
    bw_tet_mesh mesh = {.vertex_count = model->vertex_count,
                        .tet_count = model->tet_count,
                        .position = model->position,
                        .tet = model->tet,
                        .parameter = model->parameter};
    model->position = NULL;
    model->tet = NULL;
    model->parameter = NULL;
    return mesh;
}

static found analyse(const char *name, const bw_model_options *o, bw_complex_kind kind) {
    bw_context ctx;
    bw_model model;
    found result = {0};
    bw_context_init(&ctx);
    print_message("%s: noise %g perturb %g scramble %d seed %llu\n", name, o->noise, o->perturb, o->scramble,
                  (unsigned long long)o->seed);
    bw_status status = bw_model_make(&ctx, name, o, &model);
    bw_tet_mesh mesh = take(&model);
    if (!status) status = compute(&ctx, &mesh, kind, 0.05, &result);
    if (status) fail_msg("%s: %s", name, ctx.error.message);
    bw_tet_mesh_clear(&ctx, &mesh);
    bw_model_clear(&ctx, &model);
    assert_int_equal(ctx.memory.used, 0);
    return result;
}

static void every_damage_is_refused_with_its_own_status(void **state) {
    static const struct {
        bw_model_damage_kind kind;
        bw_status status;
    } expected[] = {{BW_DAMAGE_INVERT, BW_E_INVERTED},
                    {BW_DAMAGE_DUPLICATE, BW_E_DUPLICATE},
                    {BW_DAMAGE_NONMANIFOLD, BW_E_NONMANIFOLD},
                    {BW_DAMAGE_SEAM, BW_E_NOT_SEAMLESS},
                    {BW_DAMAGE_TILT, BW_E_NOT_ALIGNED}};
    (void)state;
    for (size_t i = 0; i < sizeof expected / sizeof *expected; i++)
        for (uint64_t seed = 1; seed <= 5; seed++) {
            bw_context ctx;
            bw_model model;
            found unused;
            bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.6, .seed = seed};
            bw_context_init(&ctx);
            assert_int_equal(bw_model_make(&ctx, "cylinder", &o, &model), BW_OK);
            assert_int_equal(bw_model_damage(&ctx, &model, expected[i].kind, seed), BW_OK);
            bw_tet_mesh mesh = take(&model);
            bw_status status = compute(&ctx, &mesh, BW_COMPLEX_MC, 0.005, &unused);
            print_message("damage %d seed %llu: %s\n", (int)expected[i].kind, (unsigned long long)seed,
                          ctx.error.message);
            assert_int_equal(status, expected[i].status);
            assert_true(ctx.error.element_count > 0);
            bw_tet_mesh_clear(&ctx, &mesh);
            bw_model_clear(&ctx, &model);
            assert_int_equal(ctx.memory.used, 0);
        }
}

static void every_model_has_the_declared_base_complex(void **state) {
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++)
        for (uint64_t seed = 1; seed <= 3; seed++) {
            bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.4 * (double)(seed - 1), .seed = seed};
            o.scramble = (int)seed;
            found f = analyse(list[i].name, &o, BW_COMPLEX_BC);
            assert_true(f.displacement == 0); /* parameters are on the grid as they are */
            assert_int_equal(f.blocks, list[i].blocks_bc);
        }
}

/* Where all singular edges of a wall meet in nodes, errors that sanitizing removes part nothing. */
static void errors_do_not_change_models_without_chance_meetings(void **state) {
    static const char *const names[] = {"cuboid", "l-shape",       "plus",       "ball",
                                        "torus",  "torus-quarter", "torus-half", "hollow-torus"};
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < sizeof names / sizeof *names; k++) {
            if (strcmp(list[i].name, names[k])) continue;
            bw_model_options o = {
                .size = 1, .stretch = 1, .noise = 0.6, .perturb = 0.01, .seed = 20 + k, .scramble = 3};
            found f = analyse(names[k], &o, BW_COMPLEX_BC);
            assert_true(f.displacement > 0);
            assert_int_equal(f.blocks, list[i].blocks_bc);
        }
}

static void tori_are_split_once_per_toroidal_block(void **state) {
    static const char *const names[] = {"torus", "torus-quarter", "torus-half", "hollow-torus", "cuboid"};
    static const size_t splits[] = {1, 1, 1, 8, 0};
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.6, .seed = 30 + i};
        assert_int_equal(analyse(names[i], &o, BW_COMPLEX_MC).splits, splits[i]);
    }
}

static void the_motorcycle_complex_has_no_more_blocks(void **state) {
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++) {
        bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.6, .seed = 40 + i};
        found f = analyse(list[i].name, &o, BW_COMPLEX_MC);
        print_message("%zu blocks of %d\n", f.blocks, list[i].blocks_bc);
        assert_true(f.blocks >= 1 && (int)f.blocks <= list[i].blocks_bc);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_damage_is_refused_with_its_own_status),
        cmocka_unit_test(every_model_has_the_declared_base_complex),
        cmocka_unit_test(errors_do_not_change_models_without_chance_meetings),
        cmocka_unit_test(tori_are_split_once_per_toroidal_block),
        cmocka_unit_test(the_motorcycle_complex_has_no_more_blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
