#include "stage/quantize.h"

#include <stdio.h>
#include <string.h>
#include <time.h>

#include "quantize/quantizer.h"
#include "quantize/rounding.h"
#include "quantize/validity.h"
#include "quantize/verify.h"

static const char *const range_names[] = {"none", "positive", "nonnegative", "any"};

static double seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* ---- report ---- */

static void report_result(bw_quantizer *q, double scale, const bw_quant_result *r, bw_report_quantization *out) {
    bw_quant_figures f = bw_quantizer_figures(q);
    snprintf(out->status, sizeof out->status, "%s", bw_quant_status_name(r->status));
    out->scale = scale;
    out->objective = r->objective, out->bound = r->bound, out->gap = bw_quant_gap(r);
    out->heuristic = r->heuristic;
    out->rounds = r->rounds, out->constraints = r->rows, out->nodes = r->nodes;
    out->hexes = f.hexes, out->zero_arcs = f.zero_arcs, out->negative_arcs = f.negative_arcs;
    out->distortion = f.distortion;
    out->seconds_solver = r->seconds - r->seconds_separation, out->seconds_separation = r->seconds_separation;
    out->seconds = r->seconds;
}

static void report_row(const bw_report_quantization *from, bw_report_sweep *row) {
    *row = (bw_report_sweep){.scale = from->scale, .objective = from->objective, .bound = from->bound, .distortion = from->distortion,
                             .hexes = from->hexes, .zero_arcs = from->zero_arcs, .negative_arcs = from->negative_arcs, .seconds = from->seconds};
    memcpy(row->status, from->status, sizeof row->status);
}

/* ---- the stage ---- */

static bw_status separate(void *user, const int64_t *length, bw_constraint_list *violated) {
    return bw_validity_separate(user, length, violated);
}

/* A result on trial: by contraction, which knows nothing of the constraints that it was found with. Leaves its lengths in `length`. */
static bw_status verify(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_quantizer *q, int64_t *length,
                        bw_report_quantization *out) {
    double since = seconds_now();
    bw_verdict verdict;
    bw_quant_model_lengths(&q->model, q->value, length);
    bw_status status = bw_verify(ctx, cells, complex, length, &verdict);
    out->seconds_check += seconds_now() - since;
    if (status != BW_OK || verdict.fault == BW_VALID) return status;
    out->verified = false;
    if (verdict.fault == BW_UNDECIDED) {
        bw_log(ctx, "quantize: a result is not verified: %s", verdict.message);
        return BW_OK;
    }
    if (*verdict.kind) bw_fail_element(ctx, verdict.kind, verdict.id, NULL);
    return bw_fail(ctx, BW_E_CHECK, "the quantization found is not valid (%s): %s", bw_fault_name(verdict.fault), verdict.message);
}

static bw_status sweep(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_quantizer *q, const bw_quantize_options *options,
                       int64_t *length, bw_report *report) {
    report->sweep_count = 0;
    for (size_t i = 0; i < options->scale_count; i++) {
        bw_quant_result result;
        bw_report_quantization found;
        if (bw_quantizer_solve(ctx, q, options->scales[i], options->seconds, &result)) return ctx->error.status;
        if (verify(ctx, cells, complex, q, length, &report->quantization)) return ctx->error.status;
        report_result(q, options->scales[i], &result, &found);
        report_row(&found, &report->sweep[report->sweep_count++]);
        bw_progress(ctx, (double)(i + 1) / (double)(options->scale_count + 1));
    }
    return BW_OK;
}

static bw_status find_lengths(bw_context *ctx, bw_quantizer *q, const bw_quantize_options *options, bw_report *report) {
    bw_report_quantization *out = &report->quantization;
    bw_quant_result result;
    double scale = options->scale;
    bw_status status = options->fewest_hexes   ? bw_quantizer_fewest(ctx, q, options->seconds, &result)
                       : options->target_hexes ? bw_quantizer_aim(ctx, q, options->target_hexes, options->seconds, &scale, &result)
                                               : bw_quantizer_solve(ctx, q, scale, options->seconds, &result);
    if (status != BW_OK) return status;
    if (options->fewest_hexes) scale = 0;
    snprintf(out->goal, sizeof out->goal, "%s", options->fewest_hexes ? "hexes" : "lengths");
    report_result(q, scale, &result, out);
    out->target_hexes = options->target_hexes;
    double miss = (double)out->hexes - (double)options->target_hexes;
    out->target_met = options->target_hexes && 20 * (miss < 0 ? -miss : miss) <= (double)options->target_hexes;
    return BW_OK;
}

/* The comparison of Q 7.2: rounding at the scale of the answer, and the coarsest at which it succeeds. */
static bw_status compare_rounding(bw_context *ctx, const bw_quantizer *q, bw_validity *validity, double scale, bw_report *report) {
    enum { HALVINGS = 20 };
    bw_report_rounding *out = &report->quantization.rounding;
    double since = seconds_now();
    bw_rounding *r = NULL;
    bw_rounding_result here, coarsest;
    int64_t *length = bw_alloc(ctx, q->model.arc_count, sizeof *length);
    bw_status status = length ? bw_rounding_new(ctx, validity, &q->model, &r) : ctx->error.status;
    if (status == BW_OK) status = bw_rounding_run(r, scale, length, &here);
    if (status == BW_OK) status = bw_rounding_coarsest(r, HALVINGS, length, &coarsest);
    if (status == BW_OK) {
        *out = (bw_report_rounding){.scale = scale, .integers = here.integers, .valid = here.valid, .conflicts = here.conflicts,
                                    .negative_blocks = here.broken[BW_RULE_EXTENT], .links = here.broken[BW_RULE_LINK],
                                    .separations = here.broken[BW_RULE_SEPARATION],
                                    .loops = here.broken[BW_RULE_REGION] + here.broken[BW_RULE_VOLUME], .hexes = here.hexes,
                                    .objective = here.objective, .coarsest_valid = coarsest.valid};
        if (coarsest.valid) out->coarsest_scale = coarsest.scale, out->coarsest_hexes = coarsest.hexes;
        out->seconds = seconds_now() - since;
        report->has_rounding = true;
    }
    bw_rounding_free(ctx, r);
    bw_free(ctx, length);
    return status;
}

bw_status bw_quantize(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_quantize_options *options,
                      int64_t **length, bw_report *report) {
    double since = seconds_now();
    bw_quantizer q;
    bw_quant_oracle oracle = {0}; /* positive lengths are valid whatever the complex */
    bw_validity *validity = NULL;
    bool positive = options->range == BW_QUANTIZE_POSITIVE;
    bw_status status = positive && !options->rounding ? BW_OK : bw_validity_new(ctx, cells, complex, &validity);
    if (!positive) oracle.separate = separate, oracle.user = validity;
    if (status == BW_OK) status = bw_quantizer_open(ctx, complex, cells->map->exponent, options->range, &oracle, &q);
    *length = NULL;
    if (status != BW_OK) {
        bw_validity_free(ctx, validity);
        return status;
    }
    report->quantization = (bw_report_quantization){.arcs = q.model.arc_count, .classes = q.model.class_count, .free_integers = q.model.free_count};
    report->quantization.verified = true;
    double setup = seconds_now() - since;
    if (!(*length = bw_alloc(ctx, complex->arc_count, sizeof **length))) status = ctx->error.status;
    if (status == BW_OK) status = sweep(ctx, cells, complex, &q, options, *length, report);
    if (status == BW_OK) status = find_lengths(ctx, &q, options, report);
    if (status == BW_OK) status = verify(ctx, cells, complex, &q, *length, &report->quantization);
    if (status == BW_OK && options->rounding) status = compare_rounding(ctx, &q, validity, report->quantization.scale, report);
    if (status == BW_OK) {
        snprintf(report->quantization.range, sizeof report->quantization.range, "%s", range_names[options->range]);
        report->quantization.seconds_setup = setup;
        report->has_quantization = true;
    }
    bw_quantizer_close(ctx, &q);
    bw_validity_free(ctx, validity);
    return status;
}
