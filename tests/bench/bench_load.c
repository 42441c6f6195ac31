/* How fast .hexex files load: a sample model written in the three forms that numbers come in, then the files given.
 *
 *     bench_load [FILE.hexex ...]
 *
 * The file is in the page cache (a run that is not counted brings it there); one thread. MB are 10^6 bytes.
 */
#include <gmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "format/hexex.h"
#include "format/hexex_write.h"
#include "machine.h"
#include "models/models.h"

enum { RUNS = 15, NUMBER_ROOM = 1200 };

typedef enum { SHORTEST, EXACT_DECIMAL, RATIONAL, FORMS } form;
static const char *const form_name[FORMS] = {"shortest decimals", "exact decimals", "rationals"};

static void stop(const bw_context *ctx) {
    fprintf(stderr, "%s\n", ctx->error.message);
    exit(1);
}

static bool load(const char *path, const char *title) {
    double seconds[RUNS];
    size_t peak = 0, tets = 0;
    struct stat info;
    for (int i = -1; i < RUNS; i++) {
        bw_context ctx;
        bw_tet_mesh mesh;
        bw_context_init(&ctx);
        double start = bench_seconds();
        bw_status status = bw_hexex_read(&ctx, path, &mesh);
        if (i >= 0) seconds[i] = bench_seconds() - start;
        if (status != BW_OK) {
            fprintf(stderr, "%s: %s\n", path, ctx.error.message);
            return false;
        }
        peak = ctx.memory.peak;
        tets = mesh.tet_count;
        bw_tet_mesh_clear(&ctx, &mesh);
    }
    if (stat(path, &info)) return false;
    bench_times t = bench_summary(seconds, RUNS);
    double megabytes = (double)info.st_size / 1e6;
    printf("%-40s %9zu %9.2f %9.2f %9.2f %8.0f %8.0f %9.1f\n", title, tets, megabytes, t.best * 1e3, t.median * 1e3, megabytes / t.best,
           megabytes / t.median, (double)peak / 1e6);
    fflush(stdout);
    return true;
}

static void number_text(form how, double value, char text[NUMBER_ROOM], mpq_t q) {
    if (how == RATIONAL) {
        mpq_set_d(q, value);
        mpz_mul_ui(mpq_numref(q), mpq_numref(q), 1000003); /* as long as those of a traced mesh */
        mpz_mul_ui(mpq_denref(q), mpq_denref(q), 1000003);
        mpq_get_str(text, 10, q);
        return;
    }
    int n = snprintf(text, NUMBER_ROOM, "%.1074f", value);
    while (text[n - 1] == '0') n--;
    if (text[n - 1] == '.') n--;
    text[n] = 0;
}

static void write_model(const bw_model *m, form how, const char *path) {
    static char text[12][NUMBER_ROOM];
    const char *number[12];
    bw_context ctx;
    bw_hexex_writer w;
    mpq_t q;
    mpq_init(q);
    bw_context_init(&ctx);
    bw_hexex_write_begin(&ctx, &w, path, m->vertex_count);
    for (size_t v = 0; v < m->vertex_count; v++) bw_hexex_write_vertex(&w, m->position[v]);
    bw_hexex_write_tets(&w, m->tet_count);
    for (size_t t = 0; t < m->tet_count; t++) {
        if (how == SHORTEST) bw_hexex_write_tet(&w, m->tet[t], (const double(*)[3])m->parameter[t]);
        for (int i = 0; i < 12 && how != SHORTEST; i++) number_text(how, m->parameter[t][i / 3][i % 3], text[i], q), number[i] = text[i];
        if (how != SHORTEST) bw_hexex_write_tet_text(&w, m->tet[t], number);
    }
    mpq_clear(q);
    if (bw_hexex_write_end(&w, NULL) != BW_OK) stop(&ctx);
}

static bool load_sample(void) {
    char folder[] = "/tmp/bw-bench-XXXXXX", path[64], title[64];
    bw_context ctx;
    bw_model_options options;
    bw_model model;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 7; /* 142 000 tets */
    options.noise = 0.5;
    if (bw_model_make(&ctx, "ball", &options, &model) != BW_OK || !mkdtemp(folder)) stop(&ctx);
    bool fine = true;
    for (int how = 0; how < FORMS && fine; how++) {
        snprintf(path, sizeof path, "%s/%d.hexex", folder, how);
        snprintf(title, sizeof title, "sample ball, %s", form_name[how]);
        write_model(&model, (form)how, path);
        fine = load(path, title);
        unlink(path);
    }
    bw_model_clear(&ctx, &model);
    rmdir(folder);
    return fine;
}

int main(int argc, char **argv) {
    bench_print_machine("loading .hexex");
    printf("%-40s %9s %9s %9s %9s %8s %8s %9s\n", "input", "tets", "MB", "best ms", "median ms", "MB/s", "median", "peak MB");
    bool fine = load_sample();
    for (int i = 1; i < argc && fine; i++) {
        const char *slash = strrchr(argv[i], '/');
        fine = load(argv[i], slash ? slash + 1 : argv[i]);
    }
    return !fine;
}
