/* The sample models are what their table says (tests/models/models.h). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "models/build.h"
#include "models/survey.h"

static void make(bw_context *ctx, const char *name, const bw_model_options *o, bw_model *m,
                 bw_model_survey *s) {
    print_message("%s: size %d count %d stretch %g noise %g perturb %g scramble %d seed %llu\n", name,
                  o->size, o->count, o->stretch, o->noise, o->perturb, o->scramble,
                  (unsigned long long)o->seed);
    bw_context_init(ctx);
    if (bw_model_make(ctx, name, o, m) || bw_model_look(ctx, m, s))
        fail_msg("%s: %s", name, ctx->error.message);
}

static void drop(bw_context *ctx, bw_model *m) {
    bw_model_clear(ctx, m);
    assert_int_equal(ctx->memory.used, 0);
}

static void check_valid(const char *name, const bw_model_options *o) {
    bw_context ctx;
    bw_model m;
    bw_model_survey s;
    make(&ctx, name, o, &m, &s);
    assert_true(s.space_volume_min > 0);
    assert_true(s.map_volume_min > 0);
    assert_true(s.facet_tets_max == 2);
    assert_true(s.seam_defect == 0);
    assert_true(s.alignment_defect == 0);
    assert_true(s.angle_defect < 1e-5);
    assert_int_equal(s.euler, m.euler);
    assert_int_equal(s.singular_curves, m.singular_inside);
    drop(&ctx, &m);
}

static void every_model_is_valid_and_has_the_declared_structure(void **state) {
    static const bw_model_options variants[] = {
        {.size = 1, .stretch = 1, .noise = 0, .seed = 1},
        {.size = 1, .stretch = 1, .noise = 1, .seed = 2},
        {.size = 2, .stretch = 3, .noise = 0.7, .seed = 3, .scramble = BW_SCRAMBLE_BLOCKS},
        {.size = 2, .stretch = 0.2, .noise = 1, .seed = 4, .scramble = BW_SCRAMBLE_TETS},
    };
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < sizeof variants / sizeof *variants; k++)
            check_valid(list[i].name, &variants[k]);
}

static void small_models_are_valid_for_many_seeds(void **state) {
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++)
        for (uint64_t seed = 100; seed < 106; seed++) {
            bw_model_options o = {
                .size = 1, .stretch = 1, .noise = 1, .seed = seed, .scramble = (int)(seed % 4)};
            check_valid(list[i].name, &o);
        }
}

static void the_plate_has_as_many_holes_as_asked_for(void **state) {
    (void)state;
    for (int holes = 1; holes <= 16; holes += 5) {
        bw_context ctx;
        bw_model m;
        bw_model_survey s;
        bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.5, .seed = 5, .count = holes};
        make(&ctx, "plate", &o, &m, &s);
        assert_int_equal(m.blocks_bc, 9 * holes + 3);
        assert_int_equal(s.euler, 1 - holes);
        assert_int_equal(s.singular_curves, 4 * holes);
        drop(&ctx, &m);
    }
}

static void the_layout_has_the_declared_base_complex(void **state) {
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++) {
        bw_context ctx;
        bw_layout layout;
        int blocks = 0;
        bw_context_init(&ctx);
        bw_layout_init(&ctx, &layout);
        print_message("%s\n", list[i].name);
        assert_int_equal(bw_shape_make(list[i].name, 0, &layout), BW_OK);
        assert_int_equal(bw_layout_finish(&layout, 1, 1, false), BW_OK);
        assert_int_equal(bw_layout_base_complex(&layout, &blocks), BW_OK);
        assert_int_equal(blocks, list[i].blocks_bc);
        assert_int_equal(layout.blocks_bc, list[i].blocks_bc);
        assert_int_equal(layout.euler, list[i].euler);
        assert_int_equal(layout.singular_inside, list[i].singular_inside);
        bw_layout_clear(&layout);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void the_volume_of_the_map_is_that_of_the_blocks(void **state) {
    size_t count;
    const bw_model_info *list = bw_model_list(&count);
    (void)state;
    for (size_t i = 0; i < count; i++) {
        bw_context ctx;
        bw_layout layout;
        bw_model m;
        bw_model_survey s;
        bw_model_options o = {.size = 1, .stretch = 2, .noise = 1, .seed = 6, .scramble = BW_SCRAMBLE_CELLS};
        double boxes = 0, tets = 0;
        make(&ctx, list[i].name, &o, &m, &s);
        bw_layout_init(&ctx, &layout);
        assert_int_equal(bw_shape_make(list[i].name, 0, &layout), BW_OK);
        assert_int_equal(bw_layout_finish(&layout, 1, 2, false), BW_OK);
        for (int32_t b = 0; b < (int32_t)layout.block_count; b++)
            boxes += bw_layout_length(&layout, b, 0) * bw_layout_length(&layout, b, 1) *
                     bw_layout_length(&layout, b, 2);
        for (size_t t = 0; t < m.tet_count; t++) {
            double(*u)[3] = m.parameter[t];
            tets += bw_volume6(u[0], u[1], u[2], u[3]) / 6;
        }
        assert_true(fabs(tets - boxes) < 1e-11 * boxes);
        bw_layout_clear(&layout);
        drop(&ctx, &m);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_model_is_valid_and_has_the_declared_structure),
        cmocka_unit_test(small_models_are_valid_for_many_seeds),
        cmocka_unit_test(the_plate_has_as_many_holes_as_asked_for),
        cmocka_unit_test(the_layout_has_the_declared_base_complex),
        cmocka_unit_test(the_volume_of_the_map_is_that_of_the_blocks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
