/* Seconds, peak bytes and file sizes of hex meshes in every format; of the compact form with and without loss, decoded in C and JavaScript.
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
#include "format/hex_bwh.h"
#include "hex/predict.h"
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

/* Seconds of the decoder in JavaScript, of a file that is there; nothing without node. */
static void decode_in_javascript(const char *path) {
    char command[8192];
    snprintf(command, sizeof command,
             "node --input-type=module -e \"import {decode} from '%s/clients/decode/bwh.mjs'; import {readFileSync} from 'node:fs'; const b = new Uint8Array(readFileSync('%s')); "
             "let t = 1e9; for (let i = 0; i < 3; i++) { const s = performance.now(); await decode(b); t = Math.min(t, performance.now() - s); } "
             "console.log('    decoded in JavaScript: ' + (t / 1000).toFixed(3) + ' s');\" 2>/dev/null",
             BW_SOURCE_DIR, path);
    fflush(stdout);
    if (system(command)) printf("    node is not installed\n");
}

static void decode(const char *path, size_t bytes, double mesh_bytes) {
    FILE *in = fopen(path, "rb");
    char *data = in ? malloc(bytes) : NULL;
    if (!data || fread(data, 1, bytes, in) != bytes) exit(1);
    fclose(in);
    double seconds[3];
    bwh_status status = BWH_OK;
    for (int i = 0; i < 3 && status == BWH_OK; i++) {
        bwh_mesh mesh;
        double since = bench_seconds();
        status = bwh_decode(data, bytes, 0, &mesh);
        seconds[i] = bench_seconds() - since;
        bwh_clear(&mesh);
    }
    double best = bench_summary(seconds, 3).best;
    printf("    decoded in C: %.3f s, %.0f MB of mesh per second (%s)\n", best, mesh_bytes / 1e6 / best, bwh_text(status));
    free(data);
}

/* The compact form with and without loss. A mesh has 24 bytes for each vertex and 32 for each hex. */
static void compact(bw_context *ctx, const bw_hex_mesh *mesh, int bits, const char *folder) {
    char path[4096];
    bw_bwh_sizes sizes;
    double seconds[3], v = (double)mesh->vertex_count, mesh_bytes = 24 * v + 32 * (double)mesh->hex_count;
    snprintf(path, sizeof path, "%s/compact.bwh", folder);
    for (int i = 0; i < 3; i++) {
        double since = bench_seconds();
        need(ctx, bw_bwh_write(ctx, mesh, bits, path, &sizes) == BW_OK);
        seconds[i] = bench_seconds() - since;
    }
    size_t bytes = (size_t)(sizes.header + sizes.shape + sizes.places);
    double best = bench_summary(seconds, 3).best;
    printf("  bwh, %2d bits: %.2f bits per vertex, %.2f of them coordinates; written in %.2f s, %.0f MB of mesh per second\n", bits, 8 * (double)bytes / v,
           8 * (double)sizes.places / v, best, mesh_bytes / 1e6 / best);
    decode(path, bytes, mesh_bytes);
    decode_in_javascript(path);
    unlink(path);
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
        if (!keep) unlink(path);
    }
    bw_hex_skin_clear(&ctx, &skin);
    compact(&ctx, &mesh, 0, folder);
    compact(&ctx, &mesh, 12, folder);
    bool known;
    bw_predict_report predicted;
    double e_g = bench_seconds();
    need(&ctx, bw_predict_mesh(&ctx, &mesh, 12, &known, &predicted) == BW_OK);
    if (known) printf("  E_g at 12 bits: %.2f pooled, %.2f by blocks; found in %.2f s\n", predicted.e_g_pooled, predicted.e_g_blocks, bench_seconds() - e_g);
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
