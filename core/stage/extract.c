#include "stage/extract.h"

#include <stdio.h>
#include <string.h>

#include "hex/blockfill.h"
#include "hex/extract.h"
#include "hex/label.h"
#include "hex/topology.h"
#include "hex/base_complex.h"
#include "hex/trivial.h"

static double seconds_since(double *since) {
    double now = bw_seconds_now(), passed = now - *since;
    *since = now;
    return passed;
}

static bw_status from_blocks(bw_context *ctx, const bw_hex_plan *plan, bw_hex_mesh *hex) {
    const bw_verifier *v = &plan->verifier;
    bw_atlas atlas = {0};
    bw_blockwise map = {0};
    bw_status status = bw_atlas_init(ctx, v->cells, v->x, v->length, &atlas);
    if (status == BW_OK) status = bw_blockwise_init(ctx, &atlas, &map);
    if (status == BW_OK) status = bw_blockwise_check(ctx, &map);
    if (status == BW_OK) status = bw_blockfill(ctx, &map, plan->subdivide, hex);
    bw_blockwise_clear(ctx, &map);
    bw_atlas_clear(ctx, &atlas);
    return status;
}

static bw_status from_map(bw_context *ctx, const bw_hex_plan *plan, const bw_igm *igm, uint64_t most, bw_hex_mesh *hex, bw_report *report) {
    bw_hex_origin origin;
    double since = bw_seconds_now();
    bw_status status = bw_hex_extract(ctx, igm, plan->subdivide, most, hex, &origin);
    report->extract.seconds = seconds_since(&since);
    bw_hex_origin_clear(ctx, &origin);
    bw_progress(ctx, 0.4);
    if (status == BW_OK) status = bw_hex_label(ctx, plan, igm, hex);
    report->extract.seconds_label = seconds_since(&since);
    return status;
}

static bw_status check_blocks(bw_context *ctx, const bw_hex_plan *plan, const bw_hex_mesh *hex) {
    size_t blocks = plan->verifier.x->block_count, *count = bw_alloc(ctx, blocks, sizeof *count);
    bw_status status = count ? BW_OK : ctx->error.status;
    for (size_t h = 0; h < hex->hex_count && status == BW_OK; h++) count[hex->block[h]]++;
    for (size_t b = 0; b < blocks && status == BW_OK; b++) {
        const int64_t *n = plan->size[b];
        size_t promised = (size_t)(n[0] / 2 * (n[1] / 2) * (n[2] / 2));
        if (count[b] != promised) status = bw_fail(ctx, BW_E_CHECK, "block %zu has %zu hexes, but the quantization promised %zu", b, count[b], promised);
    }
    bw_free(ctx, count);
    return status;
}

static bw_status check_topology(bw_context *ctx, const bw_tet_mesh *mesh, const bw_hex_mesh *hex) {
    bw_topology tets, hexes;
    bw_status status = bw_tet_mesh_topology(ctx, mesh, &tets);
    if (status == BW_OK) status = bw_hex_mesh_topology(ctx, hex, &hexes);
    if (status == BW_OK && (tets.euler != hexes.euler || tets.components != hexes.components))
        status = bw_fail(ctx, BW_E_CHECK, "the hex mesh has Euler characteristic %lld and %zu parts, but the input %lld and %zu", (long long)hexes.euler, hexes.components,
                         (long long)tets.euler, tets.components);
    return status;
}

static bw_status make(bw_context *ctx, const bw_extract_input *in, int32_t subdivide, uint64_t most, bw_hex_mesh *hex, bw_report *report) {
    const bw_igm *igm = in->igm;
    bw_hex_plan plan;
    double since = bw_seconds_now();
    bw_status status = bw_hex_plan_init(ctx, in->cells, in->complex, in->length, subdivide, &plan);
    if (status == BW_OK) status = bw_hex_plan_limit(ctx, plan.cubes, 1, most);
    if (status == BW_OK && igm) status = from_map(ctx, &plan, igm, most, hex, report);
    else if (status == BW_OK) status = from_blocks(ctx, &plan, hex), report->extract.seconds = seconds_since(&since);
    bw_progress(ctx, 0.6);
    since = bw_seconds_now();
    if (status == BW_OK) status = bw_poll(ctx);
    if (status == BW_OK) status = bw_hex_mesh_check(ctx, hex);
    if (status == BW_OK) status = check_blocks(ctx, &plan, hex);
    if (status == BW_OK) status = check_topology(ctx, igm ? &igm->mesh : in->cells->mesh, hex);
    report->extract.seconds_check = seconds_since(&since);
    report->extract.promised = plan.cubes;
    bw_hex_plan_clear(ctx, &plan);
    if (status != BW_OK) bw_hex_mesh_clear(ctx, hex);
    return status;
}

static bw_status find_base_complex(bw_context *ctx, const bw_hex_mesh *mesh, bw_report *report, bw_report_base *out, bool *has) {
    bw_hex_base_complex found;
    bw_status status = bw_hex_find_base_complex(ctx, mesh, &found, NULL);
    if (status != BW_OK) return status;
    *out = (bw_report_base){mesh->hex_count, found.blocks, found.irregular_edges};
    report->has_base_complex = *has = true;
    return BW_OK;
}

bw_status bw_extract(bw_context *ctx, const bw_extract_input *in, const bw_extract_options *options, bw_hex_mesh *hex, bw_report *report) {
    bw_status status;
    for (int32_t n = options->subdivide;; n++) {
        bw_context apart = *ctx; /* its own error */
        memset(hex, 0, sizeof *hex);
        status = make(&apart, in, n, options->max_hexes, hex, report);
        ctx->memory = apart.memory;
        if (status == BW_E_CHECK && n < BW_SUBDIVIDE_SIMPLE) {
            bw_log(ctx, "extract: %s; with %d hexes along a unit?", apart.error.message, n + 1);
            continue;
        }
        ctx->error = apart.error;
        break;
    }
    if (status != BW_OK) return status;
    snprintf(report->extract.from, sizeof report->extract.from, "%s", in->igm ? "map" : "blocks");
    report->extract.hexes = hex->hex_count, report->extract.vertices = hex->vertex_count;
    report->extract.subdivide = (uint64_t)hex->subdivide, report->extract.subdivide_asked = (uint64_t)options->subdivide;
    report->has_extract = true;
    status = find_base_complex(ctx, hex, report, &report->base_complex.after, &report->has_base_after);
    if (status != BW_OK) bw_hex_mesh_clear(ctx, hex);
    return status;
}

bw_status bw_extract_labels(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_hex_mesh *source, bw_report *report) {
    double since = bw_seconds_now();
    bw_status status = bw_trivial_label(ctx, cells, complex, source);
    if (status == BW_OK) status = bw_trivial_hold(ctx, cells->mesh, cells->map, source);
    report->extract.seconds_label = seconds_since(&since);
    if (status == BW_OK) status = bw_hex_mesh_check(ctx, source);
    report->extract.seconds_check = seconds_since(&since);
    if (status != BW_OK) return status;
    snprintf(report->extract.from, sizeof report->extract.from, "input");
    report->extract.hexes = report->extract.promised = source->hex_count, report->extract.vertices = source->vertex_count;
    report->extract.subdivide = report->extract.subdivide_asked = 1;
    report->has_extract = true;
    return find_base_complex(ctx, source, report, &report->base_complex.before, &report->has_base_before);
}
