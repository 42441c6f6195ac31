/* The model of a quantization: every integer choice of its free unknowns makes all patches rectangular, and every integer
 * solution is such a choice. */
#include "core/reduce_kit.h"

#include "format/hexex.h"
#include "quantize/model.h"

static uint64_t seed;

static int64_t draw(int64_t low, int64_t high) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return low + (int64_t)((seed >> 33) % (uint64_t)(high - low + 1));
}

static int64_t side_length(const bw_complex *x, size_t patch, size_t side, const int64_t *length) {
    int64_t sum = 0;
    for (size_t i = x->patch_chain_begin[4 * patch + side]; i < x->patch_chain_begin[4 * patch + side + 1]; i++)
        sum += length[x->patch_chain[i] >> 1];
    return sum;
}

static bool is_consistent(const bw_complex *x, const int64_t *length) {
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t side = 0; side < 2; side++)
            if (side_length(x, p, side, length) != side_length(x, p, side + 2, length)) return false;
    return true;
}

static void check_random_choices(bw_context *ctx, const bw_complex *x, int32_t exponent, const char *name) {
    bw_quant_model m;
    kit_expect_ok(ctx, bw_quant_model_init(ctx, x, exponent, &m));
    kit_expect_ok(ctx, bw_quant_model_check(ctx, x, &m));
    int64_t *unknown = malloc((m.free_count + 1) * sizeof *unknown), *value = malloc(m.class_count * sizeof *value);
    int64_t *length = malloc(m.arc_count * sizeof *length);
    for (int i = 0; i < 20; i++) {
        for (size_t f = 0; f < m.free_count; f++) unknown[f] = draw(-50, 50);
        bw_quant_model_expand(&m, unknown, value);
        bw_quant_model_lengths(&m, value, length);
        if (!is_consistent(x, length)) fail_msg("%s: choice %d is not consistent", name, i);
        for (size_t f = 0; f < m.free_count; f++) assert_int_equal(value[m.free_class[f]], unknown[f]);
    }
    /* the input's own lengths, in grid units, are one of the choices */
    for (size_t f = 0; f < m.free_count; f++) unknown[f] = m.class_length[m.free_class[f]];
    bw_quant_model_expand(&m, unknown, value);
    bw_quant_model_lengths(&m, value, length);
    for (size_t a = 0; a < m.arc_count; a++)
        if (length[a] != x->arc_length[a]) fail_msg("%s: arc %zu is not as in the input", name, a);
    int64_t volume = 0, expected = 0; /* modulo 2^64 */
    for (size_t b = 0; b < x->block_count; b++)
        expected = (int64_t)((uint64_t)expected + (uint64_t)x->block_extent[b][0] * (uint64_t)x->block_extent[b][1] * (uint64_t)x->block_extent[b][2]);
    for (size_t b = 0; b < m.block_count; b++)
        volume = (int64_t)((uint64_t)volume + (uint64_t)bw_quant_model_extent(&m, b, 0, value) *
                           (uint64_t)bw_quant_model_extent(&m, b, 1, value) * (uint64_t)bw_quant_model_extent(&m, b, 2, value));
    assert_true(volume == expected);
    free(unknown), free(value), free(length);
    bw_quant_model_clear(ctx, &m);
}

static void every_choice_is_consistent_on_all_models(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    seed = 11;
    print_message("seed %d\n", (int)seed);
    for (size_t i = 0; i < count; i++) {
        reducible r;
        bw_model_options options = reduce_options_of(2, i);
        reducible_open(&r, models[i].name, &options, BW_COMPLEX_MC, false);
        size_t used = r.ctx.memory.used;
        check_random_choices(&r.ctx, &r.raw, r.map.exponent, r.name);
        assert_int_equal(r.ctx.memory.used, used);
        reducible_close(&r);
    }
}

static void every_choice_is_consistent_on_the_shared_inputs(void **state) {
    (void)state;
    static const char *const names[] = {"hand_q", "mm2017_ECM_femur_shell1", "hm_n06u_anti_pentapyr"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char path[1000];
        snprintf(path, sizeof path, "%s/data/tet/%s.hexex", BW_SHARED_DIR, names[i]);
        FILE *file = fopen(path, "r");
        if (!file) skip();
        fclose(file);
        reducible r = {0};
        bw_sanitize_report report;
        bw_context_init(&r.ctx);
        bw_build_options build = {.max_cells = REDUCE_MAX_CELLS};
        kit_expect_ok(&r.ctx, bw_hexex_read(&r.ctx, path, &r.mesh));
        kit_expect_ok(&r.ctx, bw_sanitize(&r.ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &r.mesh, &r.map, &report));
        kit_expect_ok(&r.ctx, bw_cells_init(&r.ctx, &r.cells, &r.mesh, &r.map));
        kit_expect_ok(&r.ctx, bw_trace(&r.ctx, &r.cells, BW_COMPLEX_MC, REDUCE_MAX_CELLS));
        kit_expect_ok(&r.ctx, bw_build_complex(&r.ctx, &r.cells, &build, &r.raw));
        check_random_choices(&r.ctx, &r.raw, r.map.exponent, names[i]);
        reducible_close(&r);
    }
}

static void a_box_has_three_free_lengths(void **state) {
    (void)state;
    reducible r;
    bw_model_options options = reduce_options_of(2, 0);
    reducible_open(&r, "cuboid", &options, BW_COMPLEX_MC, false);
    bw_quant_model m;
    kit_expect_ok(&r.ctx, bw_quant_model_init(&r.ctx, &r.raw, r.map.exponent, &m));
    assert_int_equal(m.free_count, 3);
    assert_int_equal(m.class_count, 3);
    for (size_t c = 0; c < 3; c++) assert_int_equal(m.class_weight[c], 4);
    bw_quant_model_clear(&r.ctx, &m);
    reducible_close(&r);
}

static void a_damaged_model_is_found(void **state) {
    (void)state;
    reducible r;
    bw_model_options options = reduce_options_of(2, 4);
    reducible_open(&r, "part", &options, BW_COMPLEX_MC, false);
    bw_quant_model m;
    kit_expect_ok(&r.ctx, bw_quant_model_init(&r.ctx, &r.raw, r.map.exponent, &m));
    m.form[m.form_begin[m.class_count] - 1].factor++;
    assert_int_equal(bw_quant_model_check(&r.ctx, &r.raw, &m), BW_E_CHECK);
    bw_quant_model_clear(&r.ctx, &m);
    reducible_close(&r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_choice_is_consistent_on_all_models),
    cmocka_unit_test(every_choice_is_consistent_on_the_shared_inputs),
    cmocka_unit_test(a_box_has_three_free_lengths),
    cmocka_unit_test(a_damaged_model_is_found),
};
KIT_MAIN(tests)
