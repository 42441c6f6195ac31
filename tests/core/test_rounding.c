/* Rounding, the alternative that quantization is compared with (Q 7): what it gives is consistent, fine sizes succeed, coarse ones have conflicts, and where it
 * succeeds it is no better than the optimum. */
#include "core/verify_kit.h"

#include "quantize/quantizer.h"
#include "quantize/rounding.h"

static bw_status separate(void *user, const int64_t *length, bw_constraint_list *violated) { return bw_validity_separate(user, length, violated); }

static double best_objective(quantizable *q, double scale) {
    bw_quantizer z;
    bw_quant_result result;
    bw_quant_oracle oracle = {.separate = separate, .user = q->validity};
    kit_expect_ok(&q->ctx, bw_quantizer_open(&q->ctx, &q->complex, q->map.exponent, BW_QUANTIZE_ANY, &oracle, &z));
    kit_expect_ok(&q->ctx, bw_quantizer_solve(&q->ctx, &z, scale, 10, &result));
    bw_quantizer_close(&q->ctx, &z);
    return result.bound;
}

static size_t runs, valid, conflicts[BW_RULE_COUNT];

static void check_scale(quantizable *q, bw_rounding *r, double scale) {
    bw_rounding_result result, again;
    kit_expect_ok(&q->ctx, bw_rounding_run(r, scale, q->length, &result));
    bw_verdict d = verdict_of(q);
    if (d.fault == BW_FAULT_RECTANGLE) fail_msg("%s: rounding breaks a rectangle", q->name);
    if ((d.fault == BW_VALID) != result.valid) fail_msg("%s scale %g: the verifier says %s of a rounding with %llu conflicts", q->name, scale,
                                                        bw_fault_name(d.fault), (unsigned long long)result.conflicts);
    if (result.valid) assert_true(result.objective >= best_objective(q, scale) - 1e-6 * (1 + result.objective));
    kit_expect_ok(&q->ctx, bw_rounding_run(r, scale, q->length, &again));
    assert_memory_equal(&result, &again, sizeof result);
    assert_true(result.integers > 0 && result.integers <= q->model.free_count);
    runs++, valid += result.valid;
    for (int rule = 0; rule < BW_RULE_COUNT; rule++) conflicts[rule] += result.broken[rule];
}

static void check(quantizable *q, bool show) {
    bw_rounding *r;
    bw_rounding_result coarsest;
    double shortest = INFINITY, longest = 0;
    kit_expect_ok(&q->ctx, bw_rounding_new(&q->ctx, q->validity, &q->model, &r));
    for (size_t a = 0; a < q->complex.arc_count; a++) {
        shortest = fmin(shortest, (double)q->complex.arc_length[a] / q->model.unit);
        longest = fmax(longest, (double)q->complex.arc_length[a] / q->model.unit);
    }
    for (double scale = 0; scale <= 8 / longest; scale += 1 / longest) check_scale(q, r, scale);
    kit_expect_ok(&q->ctx, bw_rounding_coarsest(r, 12, q->length, &coarsest));
    if (coarsest.valid) expect_fault(q, BW_VALID, "the coarsest rounding");
    if (show)
        print_message("%-44s %zu integers of %zu; coarsest valid rounding: scale %.4f, %llu hexes\n", q->name, coarsest.integers, q->model.free_count,
                      coarsest.scale, (unsigned long long)coarsest.hexes);
    if (shortest * 50 > longest) { /* fine enough: every arc is longer than all errors together */
        bw_rounding_result fine;
        kit_expect_ok(&q->ctx, bw_rounding_run(r, 40 / shortest, q->length, &fine));
        assert_true(fine.valid && coarsest.valid);
    }
    bw_rounding_free(&q->ctx, r);
}

static void rounding_of_models(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    runs = valid = 0, memset(conflicts, 0, sizeof conflicts);
    for (size_t i = 0; i < count + FLAT_SHAPES; i++)
        for (int way = 0; way < 2; way++) {
            quantizable q;
            bw_model_options options;
            bw_model_options_defaults(&options);
            options.size = 1, options.noise = 0.5, options.seed = i, options.perturb = way ? 1e-3 : 0, options.features = way;
            if (i < count) quantizable_open(&q, models[i].name, &options, BW_COMPLEX_MC, way ? BW_REDUCE_KEEP_SINGULAR : BW_REDUCE_NONE);
            else quantizable_open_flat(&q, &flat_shapes[i - count], BW_REDUCE_NONE);
            check(&q, false);
            quantizable_close(&q);
        }
    print_message("%zu roundings, %zu valid; conflicts:", runs, valid);
    for (int rule = 0; rule < BW_RULE_COUNT; rule++) print_message(" %s %zu", bw_rule_name((bw_rule)rule), conflicts[rule]);
    print_message("\n");
    assert_true(valid > 20 && runs - valid > 20);
    assert_int_equal(conflicts[BW_RULE_RECTANGLE], 0);
    assert_true(conflicts[BW_RULE_LINK] > 0 && conflicts[BW_RULE_SEPARATION] > 0);
}

static void rounding_of_shared_models(void **state) {
    (void)state;
    size_t count;
    const char *folder = kit_shared("data/tet");
    char **names = kit_names(folder, ".hexex", &count);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_KEEP_SINGULAR);
        check(&q, true);
        quantizable_close(&q);
    }
    kit_names_free(names, count);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(rounding_of_models),
    cmocka_unit_test(rounding_of_shared_models),
};
KIT_MAIN(tests)
