/* Quantizations of 300 random models: valid by the independent check, bounded from below by what is claimed, never worse for a wider range, and
 * never much better than what the heuristic finds alone. */
#include "core/reduce_kit.h"

#include <math.h>

#include "quantize/quantizer.h"
#include "quantize/validity.h"
#include "quantize/verify.h"

enum { MODELS = 300 };

static uint64_t seed;

static uint64_t draw(uint64_t n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (seed >> 33) % n;
}

static bw_status separate(void *user, const int64_t *length, bw_constraint_list *violated) {
    return bw_validity_separate(user, length, violated);
}

static int zeros, negatives, searched, excluded;

static void expect_valid(bw_context *ctx, const bw_cells *cells, const bw_complex *x, const bw_quantizer *q, const char *name, int range, double scale) {
    int64_t *length = malloc(x->arc_count * sizeof *length);
    bw_verdict verdict;
    bw_quant_model_lengths(&q->model, q->value, length);
    kit_expect_ok(ctx, bw_verify(ctx, cells, x, length, &verdict));
    if (verdict.fault != BW_VALID) fail_msg("%s range %d scale %g: %s", name, range, scale, verdict.message);
    free(length);
}

/* Lengths found without and with a search; the former takes longer, so not for all models. */
static void try_size(reducible *r, bw_quantizer *q, int range, double scale, bool both, double *objective) {
    bw_quant_result best, quick;
    int64_t *kept = malloc(q->model.class_count * sizeof *kept);
    if (both) {
        kit_expect_ok(&r->ctx, bw_quantizer_solve(&r->ctx, q, scale, 0, &quick));
        expect_valid(&r->ctx, &r->cells, &r->raw, q, r->name, range, scale);
        memcpy(kept, q->value, q->model.class_count * sizeof *kept);
    }
    kit_expect_ok(&r->ctx, bw_quantizer_solve(&r->ctx, q, scale, 60, &best));
    expect_valid(&r->ctx, &r->cells, &r->raw, q, r->name, range, scale);
    double slack = 1e-6 * (1 + best.objective);
    if (best.status != BW_QUANT_OPTIMAL) fail_msg("%s range %d scale %g: %s", r->name, range, scale, bw_quant_status_name(best.status));
    assert_true(best.simple_bound <= best.objective + slack);
    if (both && quick.objective > 1.05 * best.objective + slack)
        fail_msg("%s range %d scale %g: heuristic %g, optimum %g", r->name, range, scale, quick.objective, best.objective);
    if (both && best.objective > quick.objective + slack) { /* only where a constraint learnt since excludes what is valid all the same */
        assert_false(bw_quant_problem_allows(bw_quantizer_problem(q), kept));
        excluded++;
    }
    bw_quant_figures f = bw_quantizer_figures(q);
    zeros += f.zero_arcs > 0, negatives += f.negative_arcs > 0, searched += best.nodes > 0;
    *objective = best.objective;
    free(kept);
}

static void try_sizes(reducible *r, bool both) {
    static const double relative[] = {0, 0.3, 1, 3};
    double typical = 0;
    bw_validity *validity;
    bw_quantizer q[3];
    for (size_t a = 0; a < r->raw.arc_count; a++) typical += (double)r->raw.arc_length[a] / (double)r->raw.arc_count;
    kit_expect_ok(&r->ctx, bw_validity_new(&r->ctx, &r->cells, &r->raw, &validity));
    bw_quant_oracle oracle = {.separate = separate, .user = validity};
    for (int k = 0; k < 3; k++)
        kit_expect_ok(&r->ctx, bw_quantizer_open(&r->ctx, &r->raw, r->map.exponent, (bw_quantize_range)(BW_QUANTIZE_POSITIVE + k), &oracle, &q[k]));
    for (int i = 0; i < 2; i++) {
        double scale = relative[i ? 1 + draw(3) : 0] * q[0].model.unit / typical, objective, last = INFINITY;
        for (int k = 0; k < 3; k++) {
            try_size(r, &q[k], k, scale, both, &objective);
            if (objective > last + 1e-6 * (1 + last)) fail_msg("%s range %d scale %g: worse than in a narrower range", r->name, k, scale);
            last = objective;
        }
    }
    for (int k = 0; k < 3; k++) bw_quantizer_close(&r->ctx, &q[k]);
    bw_validity_free(&r->ctx, validity);
}

static void random_models_are_quantized_validly_and_optimally(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    seed = 31;
    print_message("seed %d\n", (int)seed);
    for (size_t i = 0; i < MODELS; i++) {
        reducible r;
        bw_model_options options = reduce_options_of(1, 1000 + i);
        options.stretch = 0.3 + 0.1 * (double)draw(40);
        options.noise = 0.1 * (double)draw(8);
        options.perturb = draw(2) ? 5e-6 * (double)(1 + draw(3)) : 0;
        reducible_open(&r, models[i % count].name, &options, draw(4) ? BW_COMPLEX_MC : BW_COMPLEX_BC, false);
        size_t used = r.ctx.memory.used;
        try_sizes(&r, i % 20 == 0);
        assert_int_equal(r.ctx.memory.used, used);
        reducible_close(&r);
    }
    print_message("%d with zeros, %d with negative lengths, %d searched, %d times a valid one was excluded\n", zeros, negatives, searched, excluded);
    assert_true(zeros > 50 && searched > 50);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(random_models_are_quantized_validly_and_optimally),
};
KIT_MAIN(tests)
