/* Seconds and memory of every stage, as a job reports them: bw_run in this process, best of some runs.
 *
 *     bench_stages [options] [FILE ...]          sample models if no file is given
 *
 * Two lines an input: seconds of each stage and their sum from trace to reduce, then peak MB of each and the
 * most from trace to reduce, that in bytes per tet and per cut cell, and as a part of 300 bytes per tet + 500 per
 * cut cell. With --refine and --compare a line of ratios follows. Files are in the page cache; MB are 10^6 bytes;
 * cut cells (those of tets that a wall cuts) and walls are those of the result.
 */
#include <getopt.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "blockwright.h"
#include "format/hexex_write.h"
#include "format/input.h"
#include "machine.h"
#include "models/models.h"
#include "refine.h"

static const char usage[] =
    "Usage: bench_stages [options] [FILE ...]\n"
    "\n"
    "      --complex mc|bc|serial               mc: motorcycle complex (default); bc: base complex; serial: mc, wall by wall\n"
    "      --reduce none|keep-singular|full     (default keep-singular)\n"
    "      --self-adjacent allow|split          (default allow)\n"
    "      --effort 0..3                        (default 1)\n"
    "      --until STAGE                        last stage (default encode)\n"
    "      --repeat N                           runs of each, of which the best counts (default 5)\n"
    "      --refine L                           each input also refined 1..L times, 1:8 each, with the "
    "growth\n"
    "      --compare                            each input as mc and as bc, with the ratios bc / mc\n"
    "      --max-cells N                        work limit: cells that cuts add\n"
    "      --threads N                          (default: the cores of the machine)\n"
    "  -h, --help\n";

enum { LOAD, SANITIZE, TRACE, BUILD, REDUCE, QUANTIZE, REPARAMETRIZE, EXTRACT, ENCODE, STAGES };
static const char *const stage_name[STAGES] = {"load", "sanitize", "trace", "build", "reduce", "quantize", "reparametrize", "extract", "encode"};

typedef struct {
    bw_options options;
    int repeat, refine, threads;
    bool compare;
    char folder[64];
} bench;

/* All as doubles, for ratios; 0: not there. */
typedef struct {
    double tets, bytes, seconds[STAGES], core_seconds, peak[STAGES], core_peak, cells, walls, raw, reduced;
} figures;

/* ---- one run ---------------------------------------------------------------------------------------- */

static double number(const json_t *object, const char *name) {
    return json_number_value(json_object_get(object, name));
}

static void read_stages(const json_t *list, figures *f) {
    size_t i;
    const json_t *stage;
    json_array_foreach(list, i, stage) {
        const char *name = json_string_value(json_object_get(stage, "name"));
        for (int s = 0; s < STAGES; s++) {
            if (!name || strcmp(name, stage_name[s])) continue;
            f->seconds[s] = number(stage, "seconds");
            f->peak[s] = number(stage, "peak_bytes");
            if (s < TRACE || s > REDUCE) continue;
            f->core_seconds += f->seconds[s];
            if (f->peak[s] > f->core_peak) f->core_peak = f->peak[s];
        }
    }
}

static bool read_report(const char *folder, figures *f) {
    char path[128];
    json_error_t error;
    snprintf(path, sizeof path, "%s/report.json", folder);
    json_t *root = json_load_file(path, 0, &error);
    if (!root) return false;
    const json_t *complex = json_object_get(root, "complex");
    *f = (figures){.tets = number(json_object_get(root, "input"), "tets"),
                   .bytes = number(json_object_get(root, "input"), "bytes"),
                   .cells = number(json_object_get(root, "trace"), "cut_cells"),
                   .walls = number(json_object_get(root, "trace"), "wall_polygons"),
                   .raw = number(json_object_get(complex, "raw"), "blocks"),
                   .reduced = number(json_object_get(complex, "reduced"), "blocks")};
    read_stages(json_object_get(root, "stages"), f);
    json_decref(root);
    return true;
}

/* Counts and peaks are the same each time, times are not. */
static void keep_best(figures *best, const figures *f) {
    for (int s = 0; s < STAGES; s++)
        if (f->seconds[s] < best->seconds[s]) best->seconds[s] = f->seconds[s];
    if (f->core_seconds < best->core_seconds) best->core_seconds = f->core_seconds;
}

static bool measure(const bench *b, const char *input, bw_complex_kind kind, figures *best) {
    bw_options options = b->options;
    options.complex = kind;
    for (int i = 0; i < b->repeat; i++) {
        bw_context ctx;
        figures f;
        bw_context_init(&ctx);
        ctx.threads = b->threads;
        if (bw_run(&ctx, &options, input, b->folder) != BW_OK) {
            printf("  %s\n", ctx.error.message);
            return false;
        }
        if (!read_report(b->folder, &f)) return false;
        if (i == 0)
            *best = f;
        else
            keep_best(best, &f);
    }
    return true;
}

/* ---- the table -------------------------------------------------------------------------------------- */

static void print_head(void) {
    printf("\n%-34s %9s %7s", "input", "tets", "MB/s");
    for (int s = 0; s < STAGES; s++) printf(" %9s", stage_name[s]);
    printf(" %9s %9s %9s %6s %7s\n%-34s %9s %7s%60s %9s %9s %9s %6s\n", "t+b+r", "cut cells", "walls", "raw",
           "reduced", "", "", "", "peak MB of each", "most", "B/tet", "B/cell", "quota");
}

static void print_figures(const char *title, const figures *f) {
    printf("%-34.34s %9.0f %7.0f", title, f->tets,
           f->seconds[LOAD] > 0 ? f->bytes / f->seconds[LOAD] / 1e6 : 0);
    for (int s = 0; s < STAGES; s++) printf(" %9.4f", f->seconds[s]);
    printf(" %9.4f %9.0f %9.0f %6.0f %7.0f\n%-34s %9s %7s", f->core_seconds, f->cells, f->walls, f->raw,
           f->reduced, "", "", "");
    for (int s = 0; s < STAGES; s++) printf(" %9.1f", f->peak[s] / 1e6);
    printf(" %9.1f %9.0f %9.0f %6.2f\n", f->core_peak / 1e6, f->core_peak / f->tets,
           f->cells > 0 ? f->core_peak / f->cells : 0, f->core_peak / (300 * f->tets + 500 * f->cells));
    fflush(stdout);
}

static double over(double a, double b) {
    return b > 0 ? a / b : 0;
}

static void print_ratios(const char *title, const figures *a, const figures *b) {
    printf("%-34s %9.2f %7s", title, over(a->tets, b->tets), "");
    for (int s = 0; s < STAGES; s++) printf(" %9.2f", over(a->seconds[s], b->seconds[s]));
    printf(" %9.2f %9.2f %9.2f %6.2f %7.2f\n%-34s %9s %7s", over(a->core_seconds, b->core_seconds),
           over(a->cells, b->cells), over(a->walls, b->walls), over(a->raw, b->raw),
           over(a->reduced, b->reduced), "", "", "");
    for (int s = 0; s < STAGES; s++) printf(" %9.2f", over(a->peak[s], b->peak[s]));
    printf(" %9.2f\n", over(a->core_peak, b->core_peak));
    fflush(stdout);
}

/* ---- inputs ----------------------------------------------------------------------------------------- */

static bool refine_file(const char *from, const char *to) {
    bw_context ctx;
    bw_tet_mesh mesh = {0}, fine = {0};
    bw_context_init(&ctx);
    bool done = bw_input_read(&ctx, from, NULL, &mesh) == BW_OK &&
                bench_refine(&ctx, &mesh, &fine) == BW_OK && bw_hexex_write_mesh(&ctx, to, &fine) == BW_OK;
    if (!done) printf("  %s\n", ctx.error.message);
    bw_tet_mesh_clear(&ctx, &mesh);
    bw_tet_mesh_clear(&ctx, &fine);
    return done;
}

static bool bench_one(const bench *b, const char *path, const char *title, figures *f) {
    if (!measure(b, path, b->compare ? BW_COMPLEX_MC : b->options.complex, f)) return false;
    print_figures(title, f);
    if (!b->compare) return true;
    figures base;
    if (!measure(b, path, BW_COMPLEX_BC, &base)) return true; /* larger than the limit: said so */
    print_figures("  its base complex", &base);
    print_ratios("  bc / mc", &base, f);
    return true;
}

static bool bench_input(const bench *b, const char *path, const char *title) {
    figures f[2];
    char level[2][128], name[64];
    if (!bench_one(b, path, title, &f[0])) return false;
    for (int i = 1; i <= b->refine; i++) {
        snprintf(level[i & 1], sizeof level[0], "%s/level%d.hexex", b->folder, i & 1);
        snprintf(name, sizeof name, "  refined %d times", i);
        bool fine = refine_file(i == 1 ? path : level[!(i & 1)], level[i & 1]);
        if (!fine || !bench_one(b, level[i & 1], name, &f[i & 1])) return false;
        print_ratios("  growth", &f[i & 1], &f[!(i & 1)]);
    }
    return true;
}

static bool bench_samples(const bench *b) {
    static const struct {
        const char *name;
        int size;
    } samples[] = {{"ball", 4}, {"tee", 3}, {"plate", 6}, {"part", 2}};
    bool fine = true;
    for (size_t i = 0; i < sizeof samples / sizeof *samples && fine; i++) {
        char path[128], title[64];
        bw_context ctx;
        bw_model_options options;
        bw_model model;
        bw_context_init(&ctx);
        bw_model_options_defaults(&options);
        options.size = samples[i].size;
        snprintf(path, sizeof path, "%s/sample.hexex", b->folder);
        snprintf(title, sizeof title, "sample %s, size %d", samples[i].name, samples[i].size);
        fine = bw_model_make(&ctx, samples[i].name, &options, &model) == BW_OK &&
               bw_model_save(&ctx, &model, path) == BW_OK;
        bw_model_clear(&ctx, &model);
        if (!fine) fprintf(stderr, "%s\n", ctx.error.message);
        fine = fine && bench_input(b, path, title);
    }
    return fine;
}

/* ---- the command ------------------------------------------------------------------------------------ */

static bool set_option(bench *b, const char *name, const char *value) {
    char json[128];
    bw_context ctx;
    bw_context_init(&ctx);
    bool count = !strcmp(name, "effort") || !strcmp(name, "max_cells");
    snprintf(json, sizeof json, count ? "{\"%s\": %.80s}" : "{\"%s\": \"%.80s\"}", name, value);
    if (bw_options_from_json(&ctx, &b->options, json, strlen(json)) == BW_OK) return true;
    fprintf(stderr, "bench_stages: %s\n", ctx.error.message);
    return false;
}

static bool read_count(const char *value, int low, int high, int *out) {
    char *end;
    long n = strtol(value, &end, 10);
    if (*end || end == value || n < low || n > high) {
        fprintf(stderr, "bench_stages: '%s' is no number from %d to %d\n", value, low, high);
        return false;
    }
    *out = (int)n;
    return true;
}

static bool read_arguments(bench *b, int argc, char **argv) {
    static const struct option known[] = {
        {"complex", 1, NULL, 'o'}, {"reduce", 1, NULL, 'o'}, {"self-adjacent", 1, NULL, 'o'},
        {"effort", 1, NULL, 'o'},  {"until", 1, NULL, 'o'},  {"max-cells", 1, NULL, 'o'},
        {"repeat", 1, NULL, 'r'},  {"refine", 1, NULL, 'f'}, {"compare", 0, NULL, 'c'},
        {"threads", 1, NULL, 't'}, {"help", 0, NULL, 'h'},   {NULL, 0, NULL, 0},
    };
    int index = 0;
    for (int c; (c = getopt_long(argc, argv, "h", known, &index)) >= 0;) {
        char name[32] = "";
        if (c == 'o') snprintf(name, sizeof name, "%s", known[index].name);
        for (char *dash = name; (dash = strchr(dash, '-'));) *dash = '_';
        if (c == 'h')
            fputs(usage, stdout), exit(0);
        else if (c == 'c')
            b->compare = true;
        else if (c == 'r' && read_count(optarg, 1, 1000, &b->repeat))
            continue;
        else if (c == 'f' && read_count(optarg, 0, 8, &b->refine))
            continue;
        else if (c == 't' && read_count(optarg, 1, 64, &b->threads))
            continue;
        else if (c == 'o' && set_option(b, name, optarg))
            continue;
        else
            return false;
    }
    return true;
}

static void remove_folder(const char *folder) {
    static const char *const names[] = {"report.json",  "blocks.json",  "view.drc",    "traced.hexex",
                                        "sample.hexex", "level0.hexex", "level1.hexex"};
    char path[128];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        unlink(path);
    }
    rmdir(folder);
}

int main(int argc, char **argv) {
    bench b = {.repeat = 5, .threads = (int)sysconf(_SC_NPROCESSORS_ONLN), .folder = "/tmp/bw-bench-XXXXXX"};
    bw_options_defaults(&b.options);
    if (!read_arguments(&b, argc, argv)) return fputs(usage, stderr), 2;
    if (!mkdtemp(b.folder)) return perror(b.folder), 5;
    bench_print_machine("stages of a job");
    print_head();
    bool fine = true;
    if (optind == argc) fine = bench_samples(&b);
    for (int i = optind; i < argc; i++) {
        const char *slash = strrchr(argv[i], '/');
        fine = bench_input(&b, argv[i], slash ? slash + 1 : argv[i]) && fine;
    }
    remove_folder(b.folder);
    return fine ? 0 : 5;
}
