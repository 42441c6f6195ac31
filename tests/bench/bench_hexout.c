/* Seconds, peak bytes and file sizes of hex meshes in every format, and of decoding the compact form.
 *
 *     bench_hexout [EDGE [FOLDER]]        a cube of EDGE^3 hexes (default 100) in 1 block and in 64; files stay in FOLDER if it is given
 */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include "bwh.h"
#include "format/hex_write.h"
#include "machine.h"

static void need(bw_context *ctx, bool good) {
    if (good) return;
    fprintf(stderr, "bench_hexout: %s\n", ctx->error.message);
    exit(1);
}

/* n^3 hexes, bent smoothly and shaken by `noise` of an edge, cut into cuts^3 blocks. */
static void make(bw_context *ctx, int n, int cuts, double noise, bw_hex_mesh *mesh) {
    size_t s = (size_t)n, m = s + 1, vertices = m * m * m;
    uint64_t random = 1;
    *mesh = (bw_hex_mesh){.hex_count = s * s * s, .vertex_count = vertices, .subdivide = 1};
    mesh->position = bw_alloc(ctx, vertices, sizeof *mesh->position), mesh->held = bw_alloc(ctx, vertices, 1);
    mesh->hex = bw_alloc(ctx, s * s * s, sizeof *mesh->hex);
    mesh->block = bw_alloc(ctx, s * s * s, sizeof *mesh->block), mesh->ijk = bw_alloc(ctx, s * s * s, sizeof *mesh->ijk);
    need(ctx, mesh->position && mesh->held && mesh->hex && mesh->block && mesh->ijk);
    for (size_t v = 0; v < vertices; v++) {
        double at[3] = {(double)(v % m) / n, (double)(v / m % m) / n, (double)(v / m / m) / n};
        bool outside = false;
        for (int k = 0; k < 3; k++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            double shake = ((double)(random >> 11) * 0x1p-53 - 0.5) * noise / n;
            mesh->position[v][k] = at[k] + 0.1 * sin(3 * at[(k + 1) % 3]) + shake;
            outside |= at[k] == 0 || at[k] == 1;
        }
        mesh->held[v] = outside ? BW_HELD_SURFACE : BW_HELD_NOT;
    }
    for (size_t h = 0; h < mesh->hex_count; h++) {
        size_t at[3] = {h % s, h / s % s, h / s / s}, block = 0, size = (s + (size_t)cuts - 1) / (size_t)cuts;
        for (int k = 2; k >= 0; k--) block = block * (size_t)cuts + at[k] / size, mesh->ijk[h][k] = (int32_t)(at[k] % size);
        mesh->block[h] = (bw_block)block;
        for (size_t c = 0; c < 8; c++) mesh->hex[h][c] = (bw_hvertex)(at[0] + (c & 1) + m * (at[1] + (c >> 1 & 1) + m * (at[2] + (c >> 2 & 1))));
    }
}

static void decode(const char *path, double vertices, double bytes) {
    FILE *in = fopen(path, "rb");
    char *data = in ? malloc((size_t)bytes) : NULL;
    if (!data || fread(data, 1, (size_t)bytes, in) != (size_t)bytes) exit(1);
    fclose(in);
    double seconds[3];
    bwh_status status = BWH_OK;
    for (int i = 0; i < 3 && status == BWH_OK; i++) {
        bwh_mesh mesh;
        double since = bench_seconds();
        status = bwh_decode(data, (size_t)bytes, 0, &mesh);
        seconds[i] = bench_seconds() - since;
        bwh_clear(&mesh);
    }
    printf("  decoded in C: %.3f s (%s); %.1f bits per vertex\n", bench_summary(seconds, 3).best, bwh_text(status), 8 * bytes / vertices);
    free(data);
}

static void run(int n, int cuts, double noise, const char *folder, bool keep) {
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_skin skin;
    bw_context_init(&ctx);
    make(&ctx, n, cuts, noise, &mesh);
    double since = bench_seconds();
    need(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin) == BW_OK);
    printf("\n%zu hexes, %zu vertices, %d blocks, noise %g: skin %.2f s\n", mesh.hex_count, mesh.vertex_count, cuts * cuts * cuts, noise, bench_seconds() - since);
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++) {
        char path[4096];
        uint64_t bytes;
        snprintf(path, sizeof path, "%s/cube-%d-%g.%s", folder, cuts, noise, bw_hex_formats[f].name);
        size_t before = ctx.memory.peak = ctx.memory.used;
        since = bench_seconds();
        need(&ctx, bw_hex_formats[f].write(&ctx, &mesh, &skin, path, &bytes) == BW_OK);
        printf("  %-5s %8.1f MB %6.2f s   %7.1f MB peak\n", bw_hex_formats[f].name, (double)bytes / 1e6, bench_seconds() - since,
               (double)(ctx.memory.peak - before) / 1e6);
        if (f == BW_HEX_FORMAT_BWH) decode(path, (double)mesh.vertex_count, (double)bytes);
        if (!keep) unlink(path);
    }
    bw_hex_skin_clear(&ctx, &skin);
    bw_hex_mesh_clear(&ctx, &mesh);
}

int main(int argc, char **argv) {
    int n = argc > 1 ? atoi(argv[1]) : 100;
    const char *folder = argc > 2 ? argv[2] : "/tmp";
    if (n < 4 || n > 500 || argc > 3) {
        fprintf(stderr, "Usage: bench_hexout [EDGE [FOLDER]]        EDGE: 4..500\n");
        return 2;
    }
    if (mkdir(folder, 0777) && errno != EEXIST) return 1;
    bench_print_machine("hex meshes, by format");
    run(n, 1, 0, folder, argc > 2);
    run(n, 4, 0.1, folder, argc > 2);
    return 0;
}
