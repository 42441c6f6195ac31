#include "stage/reparametrize.h"

#include <stdio.h>
#include <string.h>

#include "hex/plan.h"
#include "igm/blockwise.h"
#include "igm/parametrize.h"

#define LARGER 1.331 /* of the number of hexes: edges shorter by a tenth */

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *complex;
    const bw_reparametrize_options *options;
    int64_t **length;
    bw_igm *igm;
    bw_report *report;
    bool valid;
} job;

static bool is_positive(const job *j) {
    for (size_t a = 0; a < j->complex->arc_count; a++)
        if ((*j->length)[a] <= 0) return false;
    return true;
}

static void report_map(job *j, const bw_parametrize_report *r) {
    j->report->reparametrize.inverted_fit = r->inverted_fit;
    j->report->reparametrize.inverted_stiffened = r->inverted_stiffened;
    j->report->reparametrize.inverted_untangled = r->inverted_untangled;
    j->report->reparametrize.inverted = r->inverted;
    j->report->reparametrize.stiffenings = (uint64_t)r->stiffenings;
    j->report->reparametrize.iterations = (uint64_t)r->iterations;
    j->report->reparametrize.restarts = (uint64_t)r->restarts;
    j->report->reparametrize.refinements = (uint64_t)r->refinements;
    j->report->reparametrize.splits = r->splits;
    j->report->reparametrize.work += r->work;
    j->report->reparametrize.limited = r->limited;
    j->report->reparametrize.tets = r->tets;
    j->report->reparametrize.distortion_mean = r->distortion_mean;
    j->report->reparametrize.distortion_max = r->distortion_max;
    j->report->reparametrize.seconds_fit += r->seconds_fit;
    j->report->reparametrize.seconds_untangle += r->seconds_untangle;
    j->report->reparametrize.seconds_verify += r->seconds_verify;
}

/* Whether extract would take the present lengths. */
static bw_status check_size(const job *j) { return bw_hex_plan_limit(j->ctx, j->report->quantization.hexes, j->options->subdivide, j->options->max_hexes); }

/* The quality route for the present lengths; j->valid tells whether there is a map. */
static bw_status try_map(job *j) {
    bw_atlas atlas = {0};
    bw_frame frame = {0};
    bw_parametrize_report found = {0};
    double since = bw_seconds_now();
    j->valid = false;
    bw_status status = check_size(j);
    if (status == BW_OK) status = bw_atlas_init(j->ctx, j->cells, j->complex, *j->length, &atlas);
    if (status == BW_OK) status = bw_atlas_check(j->ctx, &atlas);
    if (status == BW_OK) status = bw_frame_init(j->ctx, &atlas, &frame);
    if (status == BW_OK) status = bw_frame_check(j->ctx, &frame);
    j->report->reparametrize.seconds_frame += bw_seconds_now() - since;
    if (status == BW_OK) status = bw_parametrize(j->ctx, &atlas, &frame, j->options->max_work, j->igm, &found);
    if (status == BW_OK) {
        report_map(j, &found);
        j->valid = found.valid;
    }
    bw_frame_clear(j->ctx, &frame);
    bw_atlas_clear(j->ctx, &atlas);
    return status;
}

/* The block-wise map is made and verified here; extract makes it again where it uses it. */
static bw_status prove_blocks(job *j) {
    bw_atlas atlas = {0};
    bw_blockwise map = {0};
    bw_status status = check_size(j);
    if (status == BW_OK) status = bw_atlas_init(j->ctx, j->cells, j->complex, *j->length, &atlas);
    if (status == BW_OK) status = bw_atlas_check(j->ctx, &atlas);
    if (status == BW_OK) status = bw_blockwise_init(j->ctx, &atlas, &map);
    if (status == BW_OK) status = bw_blockwise_check(j->ctx, &map);
    bw_blockwise_clear(j->ctx, &map);
    bw_atlas_clear(j->ctx, &atlas);
    return status;
}

static void explain(job *j, const char *what) {
    char *reason = j->report->reparametrize.reason;
    size_t room = sizeof j->report->reparametrize.reason, used = strlen(reason);
    snprintf(reason + used, room - used, "%s%s", used ? "; " : "", what);
    bw_log(j->ctx, "reparametrize: %s", what);
}

static uint64_t larger(const job *j) { return (uint64_t)(LARGER * (double)j->report->quantization.hexes) + 1; }

static bw_status requantize(job *j, bool positive, uint64_t target) {
    int64_t *other = NULL;
    char what[160];
    uint64_t before = j->report->quantization.hexes;
    bw_status status = j->options->requantize(j->ctx, j->options->user, positive, target, &other, j->report);
    if (status != BW_OK) return status;
    bw_free(j->ctx, *j->length);
    *j->length = other;
    snprintf(j->report->reparametrize.requantized, sizeof j->report->reparametrize.requantized, "%s", target ? "larger" : "positive");
    snprintf(what, sizeof what, "%s lengths instead: %llu hexes, not %llu", target ? "larger" : "positive", (unsigned long long)j->report->quantization.hexes,
             (unsigned long long)before);
    explain(j, what);
    return BW_OK;
}

static void explain_inverted(job *j) {
    char what[160];
    unsigned long long inverted = j->report->reparametrize.inverted;
    if (inverted) snprintf(what, sizeof what, "%llu of %llu tets stay inverted", inverted, (unsigned long long)j->report->reparametrize.tets);
    else snprintf(what, sizeof what, "the map winds around an edge too often, or cannot be rounded");
    if (j->report->reparametrize.limited) strcat(what, ", at the limit of work");
    explain(j, what);
}

/* Maps of the quantization given, of a larger one, of a positive one. */
static bw_status try_maps(job *j) {
    bw_status status = try_map(j);
    if (status != BW_OK || j->valid) return status;
    explain_inverted(j);
    if (j->options->route == BW_ROUTE_QUALITY) return bw_fail(j->ctx, BW_E_ALGORITHM, "no map without inverted tets was found: %s", j->report->reparametrize.reason);
    for (int positive = 0; positive < 2 && !is_positive(j); positive++) {
        if ((status = requantize(j, positive, positive ? 0 : larger(j))) || (status = try_map(j)) || j->valid) return status;
        explain_inverted(j);
    }
    return BW_OK;
}

bw_status bw_reparametrize(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_reparametrize_options *options, int64_t **length,
                           bw_igm *igm, bool *mapped, bw_report *report) {
    job j = {.ctx = ctx, .cells = cells, .complex = complex, .options = options, .length = length, .igm = igm, .report = report};
    double since = bw_seconds_now();
    bw_status status = BW_OK;
    uint64_t asked = report->quantization.hexes;
    memset(igm, 0, sizeof *igm);
    memset(&report->reparametrize, 0, sizeof report->reparametrize);
    snprintf(report->reparametrize.requantized, sizeof report->reparametrize.requantized, "none");
    report->reparametrize.hexes_asked = asked;
    if (options->route != BW_ROUTE_GUARANTEED) status = try_maps(&j);
    else if (!is_positive(&j)) status = requantize(&j, true, 0);
    if (status == BW_OK && !j.valid) status = prove_blocks(&j);
    *mapped = status == BW_OK && j.valid;
    if (status != BW_OK) return status;
    snprintf(report->reparametrize.route, sizeof report->reparametrize.route, "%s", j.valid ? "quality" : "guaranteed");
    report->reparametrize.hexes = report->quantization.hexes;
    report->reparametrize.seconds = bw_seconds_now() - since;
    report->has_reparametrize = true;
    return BW_OK;
}
