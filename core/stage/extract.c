#include "stage/extract.h"

#include <string.h>
#include <time.h>

#include "hex/extract.h"
#include "hex/topology.h"

static double seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static bw_status check_topology(bw_context *ctx, const bw_igm *igm, const bw_hex_mesh *hex) {
    bw_topology tets, hexes;
    bw_status status = bw_tet_mesh_topology(ctx, &igm->mesh, &tets);
    if (status == BW_OK) status = bw_hex_mesh_topology(ctx, hex, &hexes);
    if (status == BW_OK && (tets.euler != hexes.euler || tets.components != hexes.components))
        status = bw_fail(ctx, BW_E_CHECK, "the hex mesh has Euler characteristic %lld and %zu parts, but the input %lld and %zu", (long long)hexes.euler, hexes.components,
                         (long long)tets.euler, tets.components);
    return status;
}

static void report_mesh(const bw_hex_mesh *hex, bw_report *report) {
    report->extract.hexes = hex->hex_count;
    report->extract.vertices = hex->vertex_count;
    report->extract.subdivide = (uint64_t)hex->subdivide;
    report->has_extract = true;
}

bw_status bw_extract(bw_context *ctx, const bw_igm *igm, const bw_extract_options *options, bw_hex_mesh *hex, bw_report *report) {
    bw_hex_origin origin = {0};
    double since = seconds_now();
    bw_status status = bw_hex_extract(ctx, igm, options->subdivide, options->max_hexes, hex, &origin);
    report->extract.seconds = seconds_now() - since;
    bw_progress(ctx, 0.5);
    since = seconds_now();
    if (status == BW_OK) status = bw_poll(ctx);
    if (status == BW_OK) status = bw_hex_mesh_check(ctx, hex);
    if (status == BW_OK) status = check_topology(ctx, igm, hex);
    report->extract.seconds_check = seconds_now() - since;
    if (status == BW_OK) report_mesh(hex, report);
    else bw_hex_mesh_clear(ctx, hex);
    bw_hex_origin_clear(ctx, &origin);
    return status;
}
