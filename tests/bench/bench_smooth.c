/* Seconds and peak bytes of geometric optimization and of measuring the quality of hex meshes, by their size.
 *
 *     bench_smooth [MODEL [NOISE [SUBDIVIDE...]]]        sample model (default part), its hexes cut into N^3 each (default 1 and 2); vertices are shaken by NOISE edges (default 0.3)
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "hex/extract.h"
#include "hex/quality.h"
#include "hex/smooth.h"
#include "machine.h"
#include "models/models.h"
#include "stage/sanitize.h"

static void need(bw_context *ctx, bw_status status) {
    if (status == BW_OK) return;
    fprintf(stderr, "bench_smooth: %s\n", ctx->error.message);
    exit(1);
}

static void make_map(bw_context *ctx, const char *name, bw_igm *igm) {
    bw_model model;
    bw_model_options options;
    bw_sanitize_report report;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.5, options.integral = 1;
    memset(igm, 0, sizeof *igm);
    need(ctx, bw_model_make(ctx, name, &options, &model));
    igm->mesh.vertex_count = model.vertex_count, igm->mesh.tet_count = model.tet_count;
    igm->mesh.position = model.position, igm->mesh.tet = model.tet, igm->mesh.parameter = model.parameter;
    model.position = NULL, model.tet = NULL, model.parameter = NULL;
    bw_model_clear(ctx, &model);
    need(ctx, bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 1e-2}, &igm->mesh, &igm->map, &report));
}

static void shake(const bw_hex_surface *surface, double by, bw_hex_mesh *mesh) {
    uint64_t random = 1;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        double direction[3][3], *p = mesh->position[v];
        bw_hex_surface_hold hold = bw_hex_surface_holds(surface, mesh->held[v], mesh->carrier[v], p);
        for (int k = 0; k < 3; k++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            if (hold.held != BW_HELD_POINT) p[k] += by * (2 * (double)(random >> 11) * 0x1p-53 - 1);
        }
        bw_hex_surface_project(surface, hold, p, direction);
    }
}

static void run(bw_context *ctx, const bw_igm *igm, double noise, int32_t subdivide) {
    bw_hex_mesh mesh;
    bw_hex_origin origin = {0};
    bw_hex_surface surface;
    bw_hex_quality quality;
    bw_hex_distance distance;
    bw_smooth_options options;
    bw_smooth_report report;
    double at[5];
    need(ctx, bw_hex_extract(ctx, igm, subdivide, 100000000, &mesh, &origin));
    bw_hex_origin_clear(ctx, &origin);
    at[0] = bench_seconds();
    need(ctx, bw_hex_surface_build(ctx, &igm->mesh, igm->map.edge_flags, &surface));
    need(ctx, bw_hex_measure(ctx, &mesh, &quality));
    shake(&surface, noise * quality.edge_length.mean, &mesh);
    bw_smooth_options_defaults(&options);
    ctx->memory.peak = ctx->memory.used;
    at[1] = bench_seconds();
    need(ctx, bw_hex_smooth(ctx, &mesh, &surface, &options, &report));
    at[2] = bench_seconds();
    double peak = (double)ctx->memory.peak;
    need(ctx, bw_hex_measure(ctx, &mesh, &quality));
    at[3] = bench_seconds();
    need(ctx, bw_hex_measure_distance(ctx, &mesh, &surface, &distance));
    at[4] = bench_seconds();
    printf("%9zu hexes: smoothing %.2f s, peak %.0f MB, %llu rounds, %llu iterations, not positive %llu -> %llu, scaled Jacobian %.3f / %.3f -> %.3f / %.3f; quality %.2f s, "
           "distance %.2f s\n",
           mesh.hex_count, at[2] - at[1], peak * 1e-6, (unsigned long long)report.rounds, (unsigned long long)report.iterations,
           (unsigned long long)report.before.hexes, (unsigned long long)report.after.hexes, report.before.least, report.before.mean, report.after.least,
           report.after.mean, at[3] - at[2], at[4] - at[3]);
    bw_hex_surface_clear(ctx, &surface);
    bw_hex_mesh_clear(ctx, &mesh);
}

int main(int argc, char **argv) {
    static char *const usual[] = {"1", "2"};
    bw_context ctx;
    bw_igm igm;
    bw_context_init(&ctx);
    bench_print_machine("geometric optimization of hex meshes");
    make_map(&ctx, argc > 1 ? argv[1] : "part", &igm);
    double noise = argc > 2 ? atof(argv[2]) : 0.3;
    int sizes = argc > 3 ? argc - 3 : 2;
    for (ctx.threads = 1; ctx.threads <= 2; ctx.threads++) {
        printf("%d threads\n", ctx.threads);
        for (int i = 0; i < sizes; i++) run(&ctx, &igm, noise, atoi(argc > 3 ? argv[3 + i] : usual[i]));
    }
    bw_igm_clear(&ctx, &igm);
    return 0;
}
