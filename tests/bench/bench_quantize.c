/* Seconds of quantization by part: setup, separation of validity constraints, solver, and the check of the result; and per arc.
 *
 *     bench_quantize [options] [FILE ...]        sample models if no file is given
 *
 * An input is traced, built and reduced once (not timed here: bench_stages does that), then quantized for every range and scale, best sum of some runs.
 * Ends with median, 90th percentile and maximum over all quantizations, and how many are proven optimal.
 */
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/input.h"
#include "machine.h"
#include "models/models.h"
#include "stage/build.h"
#include "stage/quantize.h"
#include "stage/reduce.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

static const char usage[] = "Usage: bench_quantize [options] [FILE ...]\n"
                            "\n"
                            "      --range positive|nonnegative|any     (default: each of them)\n"
                            "      --scales S,S,...                     0: the coarsest (default 0,0.25,0.5,1,2,4)\n"
                            "      --reduce none|keep-singular|full     (default keep-singular)\n"
                            "      --time-limit SECONDS                 of each search (default 10)\n"
                            "      --repeat N                           runs of each, of which the best counts (default 5)\n"
                            "  -h, --help\n";

enum { SCALES = 64, CELLS = 4000000 };
static const char *const range_names[] = {"none", "positive", "nonnegative", "any"};

typedef struct {
    int first, last; /* ranges */
    double scales[SCALES], time_limit;
    size_t scale_count;
    bw_reduce_mode reduce;
    int repeat;
    double *seconds; /* of all quantizations */
    size_t count, room, optimal;
} bench;

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
} input;

/* ---- an input ---- */

static bw_status prepare(const bench *b, input *in) {
    bw_sanitize_report sanitized;
    bw_reduce_report reduced;
    bw_reduce_options how = {.mode = b->reduce, .effort = 1};
    bw_context *ctx = &in->ctx;
    bw_status status = bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &in->mesh, &in->map, &sanitized);
    if (status == BW_OK) status = bw_cells_init(ctx, &in->cells, &in->mesh, &in->map);
    if (status == BW_OK) status = bw_trace(ctx, &in->cells, BW_COMPLEX_MC, CELLS);
    if (status == BW_OK) status = bw_build_complex(ctx, &in->cells, &(bw_build_options){.max_cells = CELLS}, &in->complex);
    if (status == BW_OK && b->reduce != BW_REDUCE_NONE) status = bw_reduce(ctx, &in->cells, &in->complex, &how, &reduced);
    return status;
}

static double total(const bw_report_quantization *q) {
    return q->seconds_setup + q->seconds_separation + q->seconds_solver + q->seconds_check;
}

static bw_status measure(bench *b, input *in, int range, double scale, bw_report_quantization *best) {
    bw_quantize_options options = {.range = (bw_quantize_range)range, .scale = scale, .seconds = b->time_limit};
    for (int i = 0; i < b->repeat; i++) {
        static bw_report report;
        int64_t *length = NULL;
        bw_report_init(&report);
        bw_status status = bw_quantize(&in->ctx, &in->cells, &in->complex, &options, &length, &report);
        bw_free(&in->ctx, length);
        if (status != BW_OK) return status;
        if (i == 0 || total(&report.quantization) < total(best)) *best = report.quantization;
    }
    return BW_OK;
}

static bool keep(bench *b, const bw_report_quantization *q) {
    if (b->count == b->room) {
        size_t room = b->room ? 2 * b->room : 256;
        double *grown = realloc(b->seconds, room * sizeof *grown);
        if (!grown) return false;
        b->seconds = grown, b->room = room;
    }
    b->seconds[b->count++] = total(q);
    b->optimal += !strcmp(q->status, "optimal");
    return true;
}

static void print_row(const char *title, int range, const bw_report_quantization *q) {
    printf("%-32.32s %-11s %6.3g %5.0f %5.0f %8.3f %8.3f %8.3f %8.3f %8.3f %8.2f %8.0f %6.0f %6.0f  %s%s\n", title, range_names[range], q->scale,
           (double)q->arcs, (double)q->free_integers, 1e3 * q->seconds_setup, 1e3 * q->seconds_separation, 1e3 * q->seconds_solver,
           1e3 * q->seconds_check, 1e3 * total(q), 1e6 * total(q) / (double)q->arcs, (double)q->hexes, (double)q->zero_arcs,
           (double)q->negative_arcs, q->status, strcmp(q->fallback, "none") ? ", of a narrower range" : "");
    fflush(stdout);
}

static bool bench_input(bench *b, input *in, const char *title) {
    bw_status status = prepare(b, in);
    for (int range = b->first; range <= b->last && status == BW_OK; range++)
        for (size_t i = 0; i < b->scale_count && status == BW_OK; i++) {
            bw_report_quantization best = {0};
            status = measure(b, in, range, b->scales[i], &best);
            if (status == BW_OK && keep(b, &best)) print_row(title, range, &best);
        }
    if (status != BW_OK) printf("%-32.32s %s\n", title, in->ctx.error.message);
    bw_complex_clear(&in->ctx, &in->complex);
    bw_cells_clear(&in->ctx, &in->cells);
    bw_grid_map_clear(&in->ctx, &in->map);
    bw_tet_mesh_clear(&in->ctx, &in->mesh);
    return status == BW_OK;
}

static bool bench_file(bench *b, const char *path) {
    input in = {0};
    const char *slash = strrchr(path, '/');
    bw_context_init(&in.ctx);
    if (bw_input_read(&in.ctx, path, NULL, &in.mesh) == BW_OK) return bench_input(b, &in, slash ? slash + 1 : path);
    printf("%-32.32s %s\n", slash ? slash + 1 : path, in.ctx.error.message);
    return false;
}

static bool bench_sample(bench *b, const char *name) {
    input in = {0};
    bw_model_options options;
    bw_model model;
    bw_context_init(&in.ctx);
    bw_model_options_defaults(&options);
    options.noise = 0.5, options.perturb = 1e-6; /* singular curves on common walls part: thin blocks, which zeros are for */
    bool made = bw_model_make(&in.ctx, name, &options, &model) == BW_OK;
    if (made) {
        in.mesh.vertex_count = model.vertex_count, in.mesh.tet_count = model.tet_count;
        in.mesh.position = model.position, in.mesh.tet = model.tet, in.mesh.parameter = model.parameter;
        model.position = NULL, model.tet = NULL, model.parameter = NULL;
    } else {
        printf("%-32.32s %s\n", name, in.ctx.error.message);
    }
    bw_model_clear(&in.ctx, &model);
    return made && bench_input(b, &in, name);
}

/* ---- the command ---- */

static int word_of(const char *word, const char *const *words, int count) {
    for (int i = 0; i < count; i++)
        if (!strcmp(word, words[i])) return i;
    return -1;
}

static bool read_number(const char *text, double low, double high, char stop, const char **end, double *out) {
    char *after;
    *out = strtod(text, &after);
    *end = after;
    return after != text && (!*after || *after == stop) && *out >= low && *out <= high;
}

static bool read_scales(bench *b, const char *text) {
    for (b->scale_count = 0; b->scale_count < SCALES; text++) {
        if (!read_number(text, 0, 1e4, ',', &text, &b->scales[b->scale_count])) return false;
        b->scale_count++;
        if (!*text) return true;
    }
    return false;
}

static bool read_option(bench *b, int c, const char *value) {
    static const char *const modes[] = {"none", "keep-singular", "full"};
    const char *end;
    double number;
    int i;
    switch (c) {
    case 'r':
        if ((i = word_of(value, range_names, 4)) < 1) return false;
        b->first = b->last = i;
        return true;
    case 'm':
        if ((i = word_of(value, modes, 3)) < 0) return false;
        b->reduce = (bw_reduce_mode)i;
        return true;
    case 's':
        return read_scales(b, value);
    case 't':
        return read_number(value, 0, 3600, 0, &end, &b->time_limit);
    case 'n':
        if (!read_number(value, 1, 1000, 0, &end, &number) || number != floor(number)) return false;
        b->repeat = (int)number;
        return true;
    default:
        return false;
    }
}

static void print_summary(bench *b) {
    if (!b->count) return;
    bench_times t = bench_summary(b->seconds, (int)b->count); /* sorts */
    printf("\n%zu quantizations, %zu proven optimal (%.1f %%); ms: median %.3f, 90 %% below %.3f, most %.3f\n", b->count, b->optimal,
           100.0 * (double)b->optimal / (double)b->count, 1e3 * t.median, 1e3 * b->seconds[(b->count * 9 - 1) / 10],
           1e3 * b->seconds[b->count - 1]);
}

int main(int argc, char **argv) {
    static const struct option known[] = {{"range", 1, NULL, 'r'},      {"scales", 1, NULL, 's'}, {"reduce", 1, NULL, 'm'},
                                          {"time-limit", 1, NULL, 't'}, {"repeat", 1, NULL, 'n'}, {"help", 0, NULL, 'h'},
                                          {NULL, 0, NULL, 0}};
    static const char *const samples[] = {"ball", "cylinder", "hollow-torus", "tee", "plate", "bearing", "part"};
    bench b = {.first = BW_QUANTIZE_POSITIVE, .last = BW_QUANTIZE_ANY, .scales = {0, 0.25, 0.5, 1, 2, 4}, .scale_count = 6,
               .time_limit = 10, .reduce = BW_REDUCE_KEEP_SINGULAR, .repeat = 5};
    for (int c; (c = getopt_long(argc, argv, "h", known, NULL)) >= 0;) {
        if (c == 'h') return fputs(usage, stdout), 0;
        if (!read_option(&b, c, optarg)) return fputs(usage, stderr), 2;
    }
    bool fine = true;
    bench_print_machine("quantization");
    printf("\n%-32s %-11s %6s %5s %5s %8s %8s %8s %8s %8s %8s %8s %6s %6s  %s\n%-32s %-11s %6s %5s %5s %8s %8s %8s %8s %8s %8s\n", "input", "range",
           "scale", "arcs", "free", "setup", "separate", "solve", "check", "sum", "per arc", "hexes", "zeros", "negat.", "status", "", "", "", "",
           "", "ms", "ms", "ms", "ms", "ms", "us");
    for (size_t i = 0; optind == argc && i < sizeof samples / sizeof *samples; i++) fine = bench_sample(&b, samples[i]) && fine;
    for (int i = optind; i < argc; i++) fine = bench_file(&b, argv[i]) && fine;
    print_summary(&b);
    free(b.seconds);
    return fine ? 0 : 5;
}
