#include "stage/extract_finish.h"

#include "hex/smooth.h"

static bw_status optimize(bw_context *ctx, const bw_hex_surface *surface, bw_hex_mesh *hex, bw_report *report) {
    bw_smooth_options options;
    bw_smooth_report found;
    double since = bw_seconds_now();
    bw_smooth_options_defaults(&options);
    if (bw_hex_smooth(ctx, hex, surface, &options, &found)) return ctx->error.status;
    report->hex_quality.smoothing.nonpositive_before = found.before.hexes;
    report->hex_quality.smoothing.min_before = found.before.least, report->hex_quality.smoothing.mean_before = found.before.mean;
    report->hex_quality.smoothing.rounds = found.rounds, report->hex_quality.smoothing.iterations = found.iterations;
    report->hex_quality.smoothing.moved_max = found.moved_max, report->hex_quality.smoothing.moved_mean = found.moved_mean;
    report->hex_quality.smoothing.off_surface_max = found.off_max, report->hex_quality.smoothing.off_surface_mean = found.off_mean;
    report->hex_quality.smoothing.vertices_off_surface = found.left;
    report->hex_quality.smoothing.seconds = bw_seconds_now() - since;
    report->has_smoothing = true;
    bw_log(ctx, "smoothing: %llu of %zu hexes not positive, then %llu; scaled Jacobian %.3f, then %.3f at least, %.3f, then %.3f in the mean",
           (unsigned long long)found.before.hexes, hex->hex_count, (unsigned long long)found.after.hexes, found.before.least, found.after.least,
           found.before.mean, found.after.mean);
    return BW_OK;
}

static bw_status measure(bw_context *ctx, const bw_hex_surface *surface, const bw_hex_mesh *hex, bw_report *report) {
    bw_hex_quality quality;
    bw_hex_distance distance;
    double since = bw_seconds_now();
    if (bw_hex_measure(ctx, hex, &quality) || bw_hex_measure_distance(ctx, hex, surface, &distance)) return ctx->error.status;
    bw_report_fill_hex_quality(report, hex, &quality, &distance);
    report->hex_quality.seconds = bw_seconds_now() - since;
    return BW_OK;
}

bw_status bw_extract_finish(bw_context *ctx, const bw_tet_mesh *mesh, const uint8_t *edge_flags, bool smooth, bw_hex_mesh *hex, bw_report *report) {
    bw_hex_surface surface;
    bw_status status = bw_hex_surface_build(ctx, mesh, edge_flags, &surface);
    if (status != BW_OK) return status;
    if (smooth) status = optimize(ctx, &surface, hex, report);
    if (status == BW_OK) status = measure(ctx, &surface, hex, report);
    bw_hex_surface_clear(ctx, &surface);
    return status;
}
