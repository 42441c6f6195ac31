/* The stage: an answer that the independent check refuses, or is too large for, is replaced by that of the next narrower range, and the report says so (the check is
 * replaced by ones that refuse); cancellation, memory that runs out, sizes beyond all numbers. */
#include "core/verify_kit.h"

#include "stage/quantize.h"

enum { SCALES = 2 };

static int refusals, calls; /* of the next answers; since */
static bw_fault reason;
static char logged[2000];

static bw_status refuse_some(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *verdict) {
    bw_status status = bw_verify(ctx, cells, complex, length, verdict);
    assert_int_equal(verdict->fault, BW_VALID);
    if (calls++ < refusals) *verdict = (bw_verdict){.fault = reason, .kind = "block", .id = 0, .other = -1, .message = "for a test"};
    return status;
}

/* As if only positive lengths were small enough to be looked at. */
static bw_status refuse_zeros(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *verdict) {
    bw_status status = bw_verify(ctx, cells, complex, length, verdict);
    for (size_t a = 0; a < complex->arc_count; a++)
        if (length[a] <= 0) verdict->fault = BW_UNDECIDED;
    return status;
}

static void keep_line(void *user, const char *line) {
    (void)user;
    size_t n = strlen(logged);
    snprintf(logged + n, sizeof logged - n, "%s\n", line);
}

static bw_status quantize(quantizable *q, bw_quantize_range range, bw_quantize_verifier *verifier, int64_t **length, bw_report *report) {
    bw_quantize_options options = {.range = range, .scale = 0, .seconds = 10, .scale_count = SCALES, .scales = {0, 0.5}, .verifier = verifier};
    bw_report_init(report);
    calls = 0, *logged = 0;
    q->ctx.log = keep_line;
    return bw_quantize(&q->ctx, &q->cells, &q->complex, &options, length, report);
}

/* Thin blocks between singular curves, which zeros are for. */
static void open_thin(quantizable *q) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.5, options.seed = 2, options.perturb = 1e-3;
    quantizable_open(q, "plate", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
}

static int64_t least_of(const quantizable *q, const int64_t *length) {
    int64_t least = INT64_MAX;
    for (size_t a = 0; a < q->complex.arc_count; a++) least = length[a] < least ? length[a] : least;
    return least;
}

static void expect_same(const bw_report_sweep *a, const bw_report_sweep *b) {
    assert_true(a->objective == b->objective && a->hexes == b->hexes && a->zero_arcs == b->zero_arcs);
}

static void an_answer_that_is_refused_is_replaced_by_a_narrower_one(void **state) {
    (void)state;
    static const bw_fault reasons[] = {BW_FAULT_TOPOLOGY, BW_UNDECIDED};
    static bw_report any, nonnegative, positive, found;
    int64_t *length;
    quantizable q;
    open_thin(&q);
    bw_report *plain[] = {&positive, &nonnegative, &any};
    for (int i = 0; i < 3; i++) {
        kit_expect_ok(&q.ctx, quantize(&q, (bw_quantize_range)(BW_QUANTIZE_POSITIVE + i), NULL, &length, plain[i]));
        assert_string_equal(plain[i]->quantization.fallback, "none");
        assert_true(plain[i]->quantization.verified && !*logged);
        bw_free(&q.ctx, length);
    }
    for (int i = 0; i < 2; i++) {
        reason = reasons[i];
        for (refusals = 1; refusals <= 2; refusals++) { /* of the first row of the table; all else is as it was */
            kit_expect_ok(&q.ctx, quantize(&q, BW_QUANTIZE_ANY, refuse_some, &length, &found));
            assert_int_equal(calls, SCALES + 1 + refusals);
            assert_string_equal(found.sweep[0].fallback, refusals == 1 ? "nonnegative" : "positive");
            expect_same(&found.sweep[0], refusals == 1 ? &nonnegative.sweep[0] : &positive.sweep[0]);
            assert_string_equal(found.sweep[1].fallback, "none");
            expect_same(&found.sweep[1], &any.sweep[1]);
            assert_string_equal(found.quantization.fallback, "none");
            assert_string_equal(found.quantization.range, "any");
            assert_true(found.quantization.verified);
            assert_non_null(strstr(logged, "any lengths are given up for nonnegative ones"));
            assert_int_equal(strstr(logged, "nonnegative lengths are given up for positive ones") != NULL, refusals == 2);
            assert_non_null(strstr(logged, bw_fault_name(reason)));
            bw_free(&q.ctx, length);
        }
    }
    quantizable_close(&q);
}

static void lengths_of_the_answer_are_those_of_the_narrower_range(void **state) {
    (void)state;
    static bw_report wide, found;
    int64_t *length;
    quantizable q;
    open_thin(&q);
    kit_expect_ok(&q.ctx, quantize(&q, BW_QUANTIZE_NONNEGATIVE, NULL, &length, &wide));
    assert_int_equal(least_of(&q, length), 0);
    bw_free(&q.ctx, length);
    for (int range = BW_QUANTIZE_NONNEGATIVE; range <= BW_QUANTIZE_ANY; range++) {
        kit_expect_ok(&q.ctx, quantize(&q, (bw_quantize_range)range, refuse_zeros, &length, &found));
        assert_string_equal(found.quantization.fallback, "positive");
        assert_int_equal(least_of(&q, length), 1);
        assert_int_equal(found.quantization.zero_arcs, 0);
        assert_true(found.quantization.objective > wide.quantization.objective);
        assert_true(found.quantization.bound <= found.quantization.objective);
        bw_free(&q.ctx, length);
    }
    quantizable_close(&q);
}

static void without_a_narrower_range_the_job_fails(void **state) {
    (void)state;
    static bw_report report;
    int64_t *length;
    quantizable q;
    open_thin(&q);
    reason = BW_FAULT_TOPOLOGY, refusals = 3;
    assert_int_equal(quantize(&q, BW_QUANTIZE_ANY, refuse_some, &length, &report), BW_E_CHECK);
    assert_int_equal(calls, 3);
    assert_false(report.has_quantization);
    assert_int_equal(q.ctx.error.element_count, 1);
    bw_free(&q.ctx, length);
    quantizable_close(&q);
}

/* Beyond what integers hold: refused, not wrapped around. */
static void sizes_beyond_all_numbers_are_refused(void **state) {
    (void)state;
    static const double scales[] = {1e9, 1e13, 1e300};
    static bw_report report;
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        quantizable q;
        int64_t *length;
        open_thin(&q);
        bw_quantize_options options = {.range = BW_QUANTIZE_ANY, .scale = scales[i], .seconds = 10};
        bw_report_init(&report);
        assert_int_equal(bw_quantize(&q.ctx, &q.cells, &q.complex, &options, &length, &report), BW_E_RANGE);
        assert_null(length);
        quantizable_close(&q);
    }
}

static volatile sig_atomic_t cancel;

static void cancel_now(void *user, const char *stage, double fraction) {
    (void)user, (void)stage;
    if (fraction > 0) cancel = 1;
}

static void a_cancelled_search_ends(void **state) {
    (void)state;
    static bw_report report;
    int64_t *length;
    quantizable q;
    open_thin(&q);
    cancel = 0;
    q.ctx.cancel = &cancel, q.ctx.progress = cancel_now;
    assert_int_equal(quantize(&q, BW_QUANTIZE_ANY, NULL, &length, &report), BW_E_CANCELLED);
    assert_int_equal(report.sweep_count, 1); /* then progress was told of */
    bw_free(&q.ctx, length);
    quantizable_close(&q);
}

static bw_status quantize_once(bw_context *ctx, void *user) {
    quantizable *q = user;
    static bw_report report;
    int64_t *length;
    bw_quantize_options options = {.range = BW_QUANTIZE_ANY, .seconds = 10, .rounding = true, .scale_count = 1, .scales = {0.3}};
    bw_report_init(&report);
    bw_status status = bw_quantize(ctx, &q->cells, &q->complex, &options, &length, &report);
    assert_int_equal(length != NULL, status == BW_OK);
    bw_free(ctx, length);
    return status;
}

static void each_allocation_of_the_stage_may_fail(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1;
    quantizable_open(&q, "cylinder", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    assert_true(kit_fail_each_allocation(quantize_once, &q) > 100);
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_cancelled_search_ends),
    cmocka_unit_test(each_allocation_of_the_stage_may_fail),
    cmocka_unit_test(an_answer_that_is_refused_is_replaced_by_a_narrower_one),
    cmocka_unit_test(lengths_of_the_answer_are_those_of_the_narrower_range),
    cmocka_unit_test(without_a_narrower_range_the_job_fails),
    cmocka_unit_test(sizes_beyond_all_numbers_are_refused),
};
KIT_MAIN(tests)
