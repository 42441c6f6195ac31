#include "stage/quantize.h"

#include <stdio.h>
#include <string.h>

#include "hex/base_complex.h"
#include "quantize/quantizer.h"
#include "quantize/rounding.h"
#include "quantize/validity.h"

#define HEXES_MAX ((uint64_t)1 << 53) /* readers of the report may hold numbers as doubles */

static const char *const range_names[] = {"none", "positive", "nonnegative", "any"};

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *complex;
    const bw_quantize_options *options;
    bw_quantizer q;
    int64_t *length; /* [arc] of the last answer */
    double seconds_check;
} job;

/* What is asked for; as in bw_quantize_options. */
typedef struct {
    double scale;
    bool fewest_hexes;
    uint64_t target_hexes;
} size;

/* ---- report ---- */

static bw_status report_result(job *j, double scale, const bw_quant_result *r, bw_quantize_range range, bw_report_quantization *out) {
    bw_quant_figures f = bw_quantizer_figures(&j->q);
    if (f.hexes > HEXES_MAX) return bw_fail(j->ctx, BW_E_RANGE, "at scale %g there would be more than 2^53 hexes", scale);
    snprintf(out->status, sizeof out->status, "%s", bw_quant_status_name(r->status));
    snprintf(out->fallback, sizeof out->fallback, "%s", range_names[range < j->options->range ? range : BW_QUANTIZE_NONE]);
    out->scale = scale;
    out->objective = r->objective, out->bound = r->bound, out->gap = bw_quant_gap(r);
    out->heuristic = r->heuristic;
    out->rounds = r->rounds, out->constraints = r->rows, out->nodes = r->nodes;
    out->hexes = f.hexes, out->zero_arcs = f.zero_arcs, out->negative_arcs = f.negative_arcs;
    out->distortion = f.distortion;
    out->seconds_solver = r->seconds - r->seconds_separation, out->seconds_separation = r->seconds_separation;
    out->seconds = r->seconds;
    return BW_OK;
}

static void report_row(const bw_report_quantization *from, bw_report_sweep *row) {
    *row = (bw_report_sweep){.scale = from->scale, .objective = from->objective, .bound = from->bound, .distortion = from->distortion,
                             .hexes = from->hexes, .zero_arcs = from->zero_arcs, .negative_arcs = from->negative_arcs, .seconds = from->seconds};
    memcpy(row->status, from->status, sizeof row->status);
    memcpy(row->fallback, from->fallback, sizeof row->fallback);
}

/* ---- one size ---- */

static bw_status separate(void *user, const int64_t *length, bw_constraint_list *violated) {
    return bw_validity_separate(user, length, violated);
}

/* The answer in the range in use: *scale is 0 for the fewest hexes, and found for a target. */
static bw_status solve(job *j, const size *wanted, double *scale, bw_quant_result *result) {
    double seconds = j->options->seconds;
    *scale = wanted->fewest_hexes ? 0 : wanted->scale;
    if (wanted->fewest_hexes) return bw_quantizer_fewest(j->ctx, &j->q, seconds, result);
    if (wanted->target_hexes) return bw_quantizer_aim(j->ctx, &j->q, wanted->target_hexes, seconds, scale, result);
    return bw_quantizer_solve(j->ctx, &j->q, *scale, seconds, result);
}

/* Tries the answer; leaves its lengths in j->length. *refused: it is not valid, or too large to tell; a narrower range is to be tried. */
static bw_status verify(job *j, bw_quantize_range range, bool *refused) {
    double since = bw_seconds_now();
    bw_verdict verdict;
    bw_quantize_verifier *verifier = j->options->verifier ? j->options->verifier : bw_verify;
    bw_quant_model_lengths(&j->q.model, j->q.value, j->length);
    bw_status status = verifier(j->ctx, j->cells, j->complex, j->length, &verdict);
    j->seconds_check += bw_seconds_now() - since;
    *refused = status == BW_OK && verdict.fault != BW_VALID;
    if (!*refused) return status;
    if (range == BW_QUANTIZE_POSITIVE) {
        if (*verdict.kind) bw_fail_element(j->ctx, verdict.kind, verdict.id, NULL);
        return bw_fail(j->ctx, BW_E_CHECK, "the quantization found is not valid (%s): %s", bw_fault_name(verdict.fault), verdict.message);
    }
    bw_log(j->ctx, "quantize: %s lengths are given up for %s ones: the check says %s (%s)", range_names[range], range_names[range - 1],
           bw_fault_name(verdict.fault), verdict.message);
    return BW_OK;
}

/* Finds a size, in the widest range whose answer is verified. */
static bw_status find(job *j, const size *wanted, bw_report_quantization *found) {
    double scale, seconds = 0, separation = 0; /* of answers given up */
    bool refused = true;
    bw_quantize_range range = j->options->range;
    for (;; range--) {
        bw_quant_result result;
        bw_quantizer_use(&j->q, range);
        if (solve(j, wanted, &scale, &result) || verify(j, range, &refused)) return j->ctx->error.status;
        result.seconds += seconds, result.seconds_separation += separation;
        seconds = result.seconds, separation = result.seconds_separation;
        if (!refused) return report_result(j, scale, &result, range, found);
    }
}

/* ---- the stage ---- */

static bw_status sweep(job *j, bw_report *report) {
    size_t count = j->options->scale_count;
    report->sweep_count = 0;
    for (size_t i = 0; i < count; i++) {
        bw_report_quantization found;
        if (find(j, &(size){.scale = j->options->scales[i]}, &found)) return j->ctx->error.status;
        report_row(&found, &report->sweep[report->sweep_count++]);
        bw_progress(j->ctx, (double)(i + 1) / (double)(count + 1));
    }
    return BW_OK;
}

static bw_status find_lengths(job *j, bw_report_quantization *out) {
    const bw_quantize_options *o = j->options;
    if (find(j, &(size){o->scale, o->fewest_hexes, o->target_hexes}, out)) return j->ctx->error.status;
    snprintf(out->range, sizeof out->range, "%s", range_names[o->range]);
    snprintf(out->goal, sizeof out->goal, "%s", o->fewest_hexes ? "hexes" : "lengths");
    out->target_hexes = o->target_hexes;
    double miss = (double)out->hexes - (double)o->target_hexes;
    out->target_met = o->target_hexes && 20 * (miss < 0 ? -miss : miss) <= (double)o->target_hexes;
    out->verified = true;
    return BW_OK;
}

/* The comparison of Q 7.2: rounding at the scale of the answer, and the coarsest at which it succeeds. */
static bw_status compare_rounding(bw_context *ctx, const bw_quantizer *q, bw_validity *validity, double scale, bw_report *report) {
    enum { HALVINGS = 20 };
    bw_report_rounding *out = &report->quantization.rounding;
    double since = bw_seconds_now();
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
        out->seconds = bw_seconds_now() - since;
        report->has_rounding = true;
    }
    bw_rounding_free(ctx, r);
    bw_free(ctx, length);
    return status;
}

/* The base complex of the hex mesh that the lengths promise, whether it will be made or not. Its blocks do not depend on how finely hexes are cut; of very fine meshes it is left out. */
static bw_status plan_base_complex(job *j, bw_report *report) {
    enum { MOST = 1 << 18 };
    bw_hex_base_complex found;
    bw_hex_plan plan = {0};
    report->has_base_planned = false;
    if (report->quantization.hexes > MOST) return BW_OK;
    bw_status status = bw_hex_plan_init(j->ctx, j->cells, j->complex, j->length, 1, &plan);
    if (status == BW_OK) status = bw_hex_plan_base_complex(j->ctx, &plan, &found);
    bw_hex_plan_clear(j->ctx, &plan);
    if (status != BW_OK) return status;
    report->base_complex.planned = (bw_report_base){report->quantization.hexes, found.blocks, found.irregular_edges};
    report->has_base_complex = report->has_base_planned = true;
    return BW_OK;
}

bw_status bw_quantize(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_quantize_options *options,
                      int64_t **length, bw_report *report) {
    double since = bw_seconds_now();
    job j = {.ctx = ctx, .cells = cells, .complex = complex, .options = options};
    bw_quant_oracle oracle = {0}; /* positive lengths are valid whatever the complex */
    bw_validity *validity = NULL;
    bool positive = options->range == BW_QUANTIZE_POSITIVE;
    bw_status status = positive && !options->rounding ? BW_OK : bw_validity_new(ctx, cells, complex, &validity);
    if (!positive) oracle.separate = separate, oracle.user = validity;
    if (status == BW_OK) status = bw_quantizer_open(ctx, complex, cells->map->exponent, options->range, &oracle, &j.q);
    *length = NULL;
    if (status != BW_OK) {
        bw_validity_free(ctx, validity);
        return status;
    }
    bw_report_quantization *out = &report->quantization;
    *out = (bw_report_quantization){.arcs = j.q.model.arc_count, .classes = j.q.model.class_count, .free_integers = j.q.model.free_count};
    out->seconds_setup = bw_seconds_now() - since;
    if (!(j.length = bw_alloc(ctx, complex->arc_count, sizeof *j.length))) status = ctx->error.status;
    if (status == BW_OK) status = sweep(&j, report);
    if (status == BW_OK) status = find_lengths(&j, out);
    if (status == BW_OK && options->rounding) status = compare_rounding(ctx, &j.q, validity, out->scale, report);
    if (status == BW_OK) status = plan_base_complex(&j, report);
    out->seconds_check = j.seconds_check;
    report->has_quantization = status == BW_OK;
    if (status == BW_OK) *length = j.length;
    else bw_free(ctx, j.length);
    bw_quantizer_close(ctx, &j.q);
    bw_validity_free(ctx, validity);
    return status;
}
