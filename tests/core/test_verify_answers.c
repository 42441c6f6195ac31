/* The solver's answers are valid by the verifier; with types of validity constraints left out there are answers that are not (Q 5.3); and on tiny complexes the
 * optimum is that of trying everything, with the verifier as the judge. */
#include "core/neck_kit.h"
#include "core/verify_kit.h"

#include <time.h>

#include "quantize/quantizer.h"

/* ---- solving, with rules of validity left out ---- */

static bw_status separate(void *user, const int64_t *length, bw_constraint_list *violated) {
    return bw_validity_separate(user, length, violated);
}

/* Sets q->length to the best lengths. without: bits of bw_rule. */
static bw_quant_result solve(quantizable *q, bw_quantize_range range, double scale, unsigned without) {
    bw_quantizer z;
    bw_quant_result result;
    bw_quant_oracle oracle = {.separate = separate, .user = q->validity};
    bw_validity_leave_out(q->validity, without);
    kit_expect_ok(&q->ctx, bw_quantizer_open(&q->ctx, &q->complex, q->map.exponent, range, &oracle, &z));
    kit_expect_ok(&q->ctx, bw_quantizer_solve(&q->ctx, &z, scale, 10, &result));
    bw_quant_model_lengths(&z.model, z.value, q->length);
    bw_quantizer_close(&q->ctx, &z);
    bw_validity_leave_out(q->validity, 0);
    return result;
}

static bw_model_options options_of(int size, uint64_t seed, double perturb) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = 0.5, options.seed = seed, options.perturb = perturb;
    options.stretch = seed & 1 ? 1 : 1.7;
    return options;
}

/* ---- answers ---- */

static double slowest;
static size_t answers, with_zeros, with_negatives;

static void check_answers(quantizable *q, const double *scales, size_t count) {
    for (int range = BW_QUANTIZE_POSITIVE; range <= BW_QUANTIZE_ANY; range++)
        for (size_t i = 0; i < count; i++) {
            struct timespec t[2];
            char what[60];
            solve(q, (bw_quantize_range)range, scales[i], 0);
            snprintf(what, sizeof what, "range %d, scale %g", range, scales[i]);
            clock_gettime(CLOCK_MONOTONIC, &t[0]);
            expect_fault(q, BW_VALID, what);
            clock_gettime(CLOCK_MONOTONIC, &t[1]);
            slowest = fmax(slowest, (double)(t[1].tv_sec - t[0].tv_sec) + 1e-9 * (double)(t[1].tv_nsec - t[0].tv_nsec));
            bool zeros = false, negatives = false;
            for (size_t a = 0; a < q->complex.arc_count; a++) zeros = zeros || !q->length[a], negatives = negatives || q->length[a] < 0;
            answers++, with_zeros += zeros, with_negatives += negatives;
        }
}

static void answers_on_models_are_valid(void **state) {
    (void)state;
    static const double scales[] = {0, 0.7, 3};
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int way = 0; way < 4; way++) {
            quantizable q;
            bw_model_options options = options_of(1, 60 + i, way & 1 ? 1e-3 : 0);
            options.features = way == 2;
            quantizable_open(&q, models[i].name, &options, way == 3 ? BW_COMPLEX_BC : BW_COMPLEX_MC, way ? BW_REDUCE_NONE : BW_REDUCE_KEEP_SINGULAR);
            check_answers(&q, scales, 3);
            quantizable_close(&q);
        }
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check_answers(&q, scales, 3);
        quantizable_close(&q);
    }
    print_message("%zu answers, %zu with zeros, %zu with negative lengths; slowest verified in %.1f ms\n", answers, with_zeros, with_negatives, 1e3 * slowest);
}

static void check_folder(const char *folder) {
    static const double scales[] = {0, 0.25, 0.5, 1, 2, 4};
    size_t count;
    char **names = kit_names(folder, ".hexex", &count);
    answers = with_zeros = with_negatives = 0, slowest = 0;
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_KEEP_SINGULAR);
        check_answers(&q, scales, 6);
        quantizable_close(&q);
    }
    kit_names_free(names, count);
    print_message("%zu answers, %zu with zeros, %zu with negative lengths; slowest verified in %.1f ms\n", answers, with_zeros, with_negatives, 1e3 * slowest);
}

static void answers_on_shared_models_are_valid(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet"));
    assert_true(with_zeros > 50 && with_negatives > 0);
    check_folder(kit_shared("data/tet-features"));
}

/* ---- types of constraints left out ---- */

enum { TYPE_I = 1 << BW_RULE_LINK, TYPE_II = 1 << BW_RULE_SEPARATION, TYPE_III = 1 << BW_RULE_REGION, TYPE_IV = 1 << BW_RULE_VOLUME };
enum { ALL_TYPES = TYPE_I | TYPE_II | TYPE_III | TYPE_IV };

/* What the verifier says of the coarsest quantization under constraints of some types only. */
static bw_fault coarsest_with(quantizable *q, bw_quantize_range range, unsigned types) {
    solve(q, range, 0, ALL_TYPES & ~types);
    return verdict_of(q).fault;
}

/* Beside the types `others` one more is needed, and enough. */
static void expect_needed(quantizable *q, unsigned type, unsigned others, bw_fault fault) {
    for (int range = BW_QUANTIZE_NONNEGATIVE; range <= BW_QUANTIZE_ANY; range++) {
        assert_int_equal(coarsest_with(q, (bw_quantize_range)range, others), fault);
        assert_int_equal(coarsest_with(q, (bw_quantize_range)range, others | type), BW_VALID);
    }
}

static void open_plain(quantizable *q, const char *name) {
    bw_model_options options = options_of(1, 1, 0);
    quantizable_open(q, name, &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
}

static void without_type_i_links_collapse(void **state) {
    (void)state;
    static const char *const names[] = {"cuboid", "plus"};
    quantizable q;
    for (int i = 0; i < 2; i++) {
        open_plain(&q, names[i]);
        expect_needed(&q, TYPE_I, TYPE_III | TYPE_IV, BW_FAULT_LINK);
        quantizable_close(&q);
    }
}

static void without_type_ii_critical_entities_coincide(void **state) {
    (void)state;
    static const char *const names[] = {"cylinder", "tee", "bearing", "torus"};
    quantizable q;
    for (int i = 0; i < 4; i++) {
        open_plain(&q, names[i]);
        expect_needed(&q, TYPE_II, TYPE_I | TYPE_III | TYPE_IV, BW_FAULT_REGION);
        quantizable_close(&q);
    }
    open_plain(&q, "plate");
    assert_int_equal(coarsest_with(&q, BW_QUANTIZE_NONNEGATIVE, TYPE_I | TYPE_III | TYPE_IV), BW_FAULT_COINCIDENCE);
    quantizable_close(&q);
}

/* Without a singularity, as the one example of Q 5.3.5. */
static void without_type_iii_boundaries_collapse(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        if (flat_shapes[i].closed) continue;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        expect_needed(&q, TYPE_III, TYPE_I | TYPE_II, BW_FAULT_REGION);
        quantizable_close(&q);
    }
}

static void without_type_iv_volumes_collapse(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        if (flat_shapes[i].closed) expect_needed(&q, TYPE_IV, TYPE_I | TYPE_II | TYPE_III, BW_FAULT_VOLUME);
        else expect_needed(&q, TYPE_IV, TYPE_I | TYPE_II, BW_FAULT_REGION);
        quantizable_close(&q);
    }
}

/* Types overlap as we look for them (core/README.md): (ii) and (iv) alone miss nothing. So each of (i) and (iii) is needed only where others are left out, too. */
static void types_ii_and_iv_imply_the_others(void **state) {
    (void)state;
    static const double scales[] = {0, 0.3};
    size_t count, tried = 0;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count + FLAT_SHAPES + 1; i++)
        for (int way = 0; way < 3; way++) {
            quantizable q;
            bw_model_options options = options_of(1, 60 + i, way == 1 ? 1e-3 : 0);
            options.features = way == 2;
            if (i < count) quantizable_open(&q, models[i].name, &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
            else if (i < count + FLAT_SHAPES) quantizable_open_flat(&q, &flat_shapes[i - count], BW_REDUCE_NONE);
            else quantizable_open_neck(&q);
            for (int k = 0; k < 4; k++, tried++) {
                solve(&q, k & 1 ? BW_QUANTIZE_ANY : BW_QUANTIZE_NONNEGATIVE, scales[k / 2], TYPE_I | TYPE_III);
                expect_fault(&q, BW_VALID, "with (ii) and (iv) only");
            }
            quantizable_close(&q);
        }
    print_message("%zu answers valid with (ii) and (iv) only\n", tried);
}

/* ---- trying everything ---- */

enum { MOST_UNKNOWNS = 8 };

/* The least objective of valid lengths with all unknowns in low..high, INFINITY if there is none; *edge: whether an unknown of it is `high`. */
static double try_everything(quantizable *q, const bw_quant_problem *p, int64_t low, int64_t high, bool *edge) {
    const bw_quant_model *m = &q->model;
    int64_t x[MOST_UNKNOWNS], *value = malloc(m->class_count * sizeof *value);
    double best = INFINITY;
    size_t n = m->free_count;
    assert_true(n <= MOST_UNKNOWNS && value);
    for (size_t f = 0; f < n; f++) x[f] = low;
    for (;;) {
        bw_quant_model_expand(m, x, value);
        double objective = bw_quant_problem_objective(p, value);
        if (objective < best && bw_quant_problem_allows(p, value)) {
            bw_quant_model_lengths(m, value, q->length);
            if (verdict_of(q).fault == BW_VALID) {
                best = objective, *edge = false;
                for (size_t f = 0; f < n; f++) *edge = *edge || x[f] == high;
            }
        }
        size_t f = 0;
        while (f < n && x[f] == high) x[f++] = low;
        if (f == n) break;
        x[f]++;
    }
    free(value);
    return best;
}

static int compared, equal;

static void compare(quantizable *q, bw_quantize_range range, double scale, int64_t high) {
    bw_quant_problem p;
    bool edge = true;
    kit_expect_ok(&q->ctx, bw_quant_problem_init(&q->ctx, &q->model, range, &p));
    bw_quant_problem_set_scale(&p, scale);
    double best = try_everything(q, &p, range == BW_QUANTIZE_ANY ? -2 : range == BW_QUANTIZE_NONNEGATIVE ? 0 : 1, high, &edge);
    bw_quant_problem_clear(&q->ctx, &p);
    if (edge || best == INFINITY) return;
    bw_quant_result result = solve(q, range, scale, 0);
    expect_fault(q, BW_VALID, "the optimum");
    assert_int_equal(result.status, BW_QUANT_OPTIMAL);
    bool same = fabs(result.objective - best) <= 1e-6 * (1 + best);
    if (!same) print_message("%s range %d scale %g: solver %g, by trying everything %g\n", q->name, (int)range, scale, result.objective, best);
    compared++, equal += same;
    assert_true(result.objective >= best - 1e-6 * (1 + best) || range == BW_QUANTIZE_ANY);
}

static void optima_are_those_of_trying_everything(void **state) {
    (void)state;
    enum { SEED = 71 };
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    kit_random random = kit_random_start(SEED);
    print_message("seed %d\n", SEED);
    for (size_t i = 0; i < count + FLAT_SHAPES; i++)
        for (int way = 0; way < 3; way++) {
            quantizable q;
            bw_model_options options = options_of(1, 80 + i, way & 1 ? 2e-3 : 0);
            if (i < count) quantizable_open(&q, models[i].name, &options, way == 2 ? BW_COMPLEX_BC : BW_COMPLEX_MC, BW_REDUCE_NONE);
            else quantizable_open_flat(&q, &flat_shapes[i - count], BW_REDUCE_NONE);
            double longest = 0;
            for (size_t c = 0; c < q.model.class_count; c++) longest = fmax(longest, (double)q.model.class_length[c] / q.model.unit);
            size_t n = q.model.free_count;
            for (int t = 0; t < 9 && n <= MOST_UNKNOWNS; t++) {
                double scale = t < 3 ? 0 : kit_random_range(&random, 0, n > 6 ? 1.2 : 2.5) / longest;
                compare(&q, (bw_quantize_range)(BW_QUANTIZE_POSITIVE + t % 3), scale, n > 6 ? 2 : n > 4 ? 3 : 5);
            }
            quantizable_close(&q);
        }
    print_message("%d compared, %d equal\n", compared, equal);
    assert_true(compared >= 200);
    assert_int_equal(equal, compared);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(answers_on_models_are_valid),
    cmocka_unit_test(answers_on_shared_models_are_valid),
    cmocka_unit_test(without_type_i_links_collapse),
    cmocka_unit_test(without_type_ii_critical_entities_coincide),
    cmocka_unit_test(without_type_iii_boundaries_collapse),
    cmocka_unit_test(without_type_iv_volumes_collapse),
    cmocka_unit_test(types_ii_and_iv_imply_the_others),
    cmocka_unit_test(optima_are_those_of_trying_everything),
};
KIT_MAIN(tests)
