/* From integers to a file of hexes: seconds and peak bytes of reparametrizing, untangling, extracting, labelling, checking, smoothing and writing, by number of hexes.
 *
 *     bench_hex [options] [FILE ...]        sample model "bearing" if no file is given
 *
 * Runs whole jobs in this process (bw_run) and prints what their reports say; of several runs the one with the least time in these stages. "extract" is the extraction alone (hex/extract.h),
 * in hexes per second too, "write" stage encode with one format.
 */
#include <dirent.h>
#include <getopt.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "blockwright.h"
#include "machine.h"
#include "models/models.h"

static const char usage[] = "Usage: bench_hex [options] [FILE ...]\n"
                            "\n"
                            "      --hexes N,N,...       (default 10000,100000,1000000)\n"
                            "      --threads N           (default 2)\n"
                            "      --smooth on|off       (default off)\n"
                            "      --format NAME         of the file written (default mesh)\n"
                            "      --repeat N            runs of each, of which the best counts (default 1)\n"
                            "  -h, --help\n";

enum { SIZES = 16, STAGES = 3 };
static const char *const stage_names[STAGES] = {"reparametrize", "extract", "encode"};

typedef struct {
    long long hexes[SIZES];
    int count, threads, repeat;
    const char *smooth, *format;
    char out[64], sample[128];
} bench;

typedef struct {
    double seconds[STAGES], peak[STAGES]; /* of stages */
    double fit, untangle, extract, label, check, hexes, total;
    char from[8];
} figures;

static double number_at(const json_t *report, const char *section, const char *name) {
    return json_number_value(json_object_get(json_object_get(report, section), name));
}

static void read_report(const bench *b, figures *f) {
    char path[128];
    json_error_t error;
    snprintf(path, sizeof path, "%s/report.json", b->out);
    json_t *report = json_load_file(path, 0, &error), *stage;
    size_t i;
    json_array_foreach(json_object_get(report, "stages"), i, stage) {
        const char *name = json_string_value(json_object_get(stage, "name"));
        for (int s = 0; s < STAGES; s++) {
            if (!name || strcmp(name, stage_names[s])) continue;
            f->seconds[s] = json_number_value(json_object_get(stage, "seconds"));
            f->peak[s] = json_number_value(json_object_get(stage, "peak_bytes"));
            f->total += f->seconds[s];
        }
    }
    f->fit = number_at(report, "reparametrize", "seconds_fit"), f->untangle = number_at(report, "reparametrize", "seconds_untangle");
    f->extract = number_at(report, "extract", "seconds"), f->label = number_at(report, "extract", "seconds_label");
    f->check = number_at(report, "extract", "seconds_check"), f->hexes = number_at(report, "extract", "hexes");
    const char *from = json_string_value(json_object_get(json_object_get(report, "extract"), "from"));
    snprintf(f->from, sizeof f->from, "%s", from ? from : "none");
    json_decref(report);
}

static bool run(const bench *b, const char *input, long long hexes, figures *f) {
    bw_context ctx;
    bw_options options;
    char json[256];
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    ctx.threads = b->threads;
    int n = snprintf(json, sizeof json, "{\"quantize\": \"nonnegative\", \"target_hexes\": %lld, \"max_hexes\": %d, \"smooth\": \"%s\", \"hex_formats\": [\"%s\"]}", hexes,
                     100000000, b->smooth, b->format);
    bw_status status = bw_options_from_json(&ctx, &options, json, (size_t)n);
    if (status == BW_OK) status = bw_run(&ctx, &options, input, b->out);
    if (status != BW_OK) printf("%-28.28s %9lld  %s: %s\n", strrchr(input, '/') ? strrchr(input, '/') + 1 : input, hexes, bw_status_code(status), ctx.error.message);
    *f = (figures){0};
    if (status == BW_OK) read_report(b, f);
    return status == BW_OK;
}

static void measure(const bench *b, const char *input) {
    const char *slash = strrchr(input, '/');
    for (int i = 0; i < b->count; i++) {
        figures best = {0};
        for (int r = 0; r < b->repeat; r++) {
            figures f;
            if (!run(b, input, b->hexes[i], &f)) return;
            if (!r || f.total < best.total) best = f;
        }
        printf("%-28.28s %9.0f %-6s %8.3f %8.3f %8.3f %8.3f %9.3f %7.3f %7.3f %8.3f %8.3f %9.1f %9.1f %9.1f\n", slash ? slash + 1 : input, best.hexes, best.from, best.seconds[0],
               best.fit, best.untangle, best.extract, best.extract > 0 ? 1e-6 * best.hexes / best.extract : 0, best.label, best.check, best.seconds[1], best.seconds[2],
               1e-6 * best.peak[0], 1e-6 * best.peak[1], 1e-6 * best.peak[2]);
        fflush(stdout);
    }
}

/* Writes the sample model that is measured when no file is given. */
static bool make_sample(bench *b) {
    bw_context ctx;
    bw_model model;
    bw_model_options options;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    snprintf(b->sample, sizeof b->sample, "%s/bearing.hexex", b->out);
    bw_status status = bw_model_make(&ctx, "bearing", &options, &model);
    if (status == BW_OK) status = bw_model_save(&ctx, &model, b->sample);
    bw_model_clear(&ctx, &model);
    if (status != BW_OK) fprintf(stderr, "bench_hex: %s\n", ctx.error.message);
    return status == BW_OK;
}

static bool read_sizes(bench *b, const char *text) {
    b->count = 0;
    for (char *end; b->count < SIZES; text = end + 1) {
        b->hexes[b->count++] = strtoll(text, &end, 10);
        if (end == text || b->hexes[b->count - 1] < 1) return false;
        if (*end != ',') return !*end;
    }
    return false;
}

static bool read_options(bench *b, int argc, char **argv) {
    static const struct option table[] = {{"hexes", 1, NULL, 'n'},  {"threads", 1, NULL, 't'}, {"smooth", 1, NULL, 's'}, {"format", 1, NULL, 'f'},
                                          {"repeat", 1, NULL, 'r'}, {"help", 0, NULL, 'h'},    {NULL, 0, NULL, 0}};
    for (int c; (c = getopt_long(argc, argv, "h", table, NULL)) != -1;) {
        if (c == 'n' && !read_sizes(b, optarg)) return false;
        if (c == 't') b->threads = atoi(optarg);
        if (c == 's') b->smooth = optarg;
        if (c == 'f') b->format = optarg;
        if (c == 'r') b->repeat = atoi(optarg);
        if (c == 'h' || c == '?') return false;
    }
    return b->threads > 0 && b->repeat > 0;
}

static void remove_results(const bench *b) {
    char path[512];
    DIR *folder = opendir(b->out);
    for (struct dirent *e; folder && (e = readdir(folder));) {
        if (e->d_name[0] == '.') continue;
        snprintf(path, sizeof path, "%s/%s", b->out, e->d_name);
        unlink(path);
    }
    if (folder) closedir(folder);
    if (rmdir(b->out)) fprintf(stderr, "bench_hex: %s is left behind\n", b->out);
}

int main(int argc, char **argv) {
    bench b = {.hexes = {10000, 100000, 1000000}, .count = 3, .threads = 2, .repeat = 1, .smooth = "off", .format = "mesh"};
    if (!read_options(&b, argc, argv)) {
        fputs(usage, stderr);
        return 2;
    }
    snprintf(b.out, sizeof b.out, "/tmp/bench_hex.XXXXXX");
    if (!mkdtemp(b.out)) {
        perror("bench_hex");
        return 1;
    }
    bench_print_machine("from integers to a file of hexes");
    printf("threads %d, smooth %s, format %s; times in s, peaks in MB\n", b.threads, b.smooth, b.format);
    printf("%-28s %9s %-6s %8s %8s %8s %8s %9s %7s %7s %8s %8s %9s %9s %9s\n", "input", "hexes", "from", "repara.", "fit", "untangle", "extract", "Mhexes/s", "label", "check", "stage", "write",
           "peak rep.", "peak ext.", "peak wr.");
    bool good = true;
    if (optind == argc) {
        good = make_sample(&b);
        if (good) measure(&b, b.sample);
    }
    for (int i = optind; i < argc; i++) measure(&b, argv[i]);
    remove_results(&b);
    return good ? 0 : 1;
}
