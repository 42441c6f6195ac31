/* From integers to files of hexes: seconds and peak bytes of each part, by number of hexes.
 *
 *     bench_hex [options] [FILE ...]        sample model "bearing" if no file is given
 *
 * Stages up to reparametrize run from file to file (bw_stage_run), what follows is called part by part: reparametrize (of it, fit and untangle), plan (what the quantization promises),
 * extract, label, check (conforming, manifold, blocks, Euler characteristic), smooth, quality (with distances), then every format. Peaks are those of the part's own memory beside what was
 * there before; of reparametrize, of the whole stage. Of several runs each part's best counts.
 */
#include <dirent.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "blockwright.h"
#include "format/hex_write.h"
#include "format/state.h"
#include "hex/extract.h"
#include "hex/label.h"
#include "hex/quality.h"
#include "hex/smooth.h"
#include "hex/topology.h"
#include "machine.h"
#include "models/models.h"

static const char usage[] = "Usage: bench_hex [options] [FILE ...]\n"
                            "\n"
                            "      --hexes N,N,...       (default 10000,100000,1000000)\n"
                            "      --threads N           (default 2)\n"
                            "      --repeat N            runs of each, of which the best counts (default 1)\n"
                            "  -h, --help\n";

enum { SIZES = 16 };
typedef enum { REPARAMETRIZE, FIT, UNTANGLE, PLAN, EXTRACT, LABEL, CHECK, SMOOTH, QUALITY, SKIN, WRITE, PARTS = WRITE + BW_HEX_FORMAT_COUNT } part;
static const char *const part_names[WRITE] = {"reparametrize", "  fit", "  untangle", "plan", "extract", "label", "check", "smooth", "quality", "skin"};

typedef struct {
    double seconds, peak; /* peak < 0: not measured */
    bool good;
} figure;

typedef struct {
    bw_context ctx;
    long long hexes[SIZES];
    int count, threads, repeat;
    char out[64], sample[128], path[256];
    double since;
    size_t before;
    figure best[PARTS], run[PARTS];
    bw_smooth_report smoothing;
} bench;

static void begin(bench *b) {
    b->before = b->ctx.memory.peak = b->ctx.memory.used;
    b->since = bench_seconds();
}

static bool end(bench *b, part p, bw_status status) {
    b->run[p] = (figure){bench_seconds() - b->since, (double)(b->ctx.memory.peak - b->before), status == BW_OK};
    return status == BW_OK;
}

/* Runs the stages up to reparametrize. */
static bool make_state(bench *b, const char *input, long long hexes, bw_state *state) {
    bw_options options;
    char json[128], from[300], to[300];
    bw_options_defaults(&options);
    int n = snprintf(json, sizeof json, "{\"quantize\": \"nonnegative\", \"target_hexes\": %lld}", hexes);
    bw_status status = bw_options_from_json(&b->ctx, &options, json, (size_t)n);
    snprintf(to, sizeof to, "%s", input);
    for (int s = 0; s <= BW_STAGE_REPARAMETRIZE && status == BW_OK; s++) {
        memcpy(from, to, sizeof from);
        snprintf(to, sizeof to, "%s/%s.state", b->out, bw_stage_name((bw_stage)s));
        status = bw_stage_run(&b->ctx, &options, (bw_stage)s, from, to);
    }
    bw_state_init(state);
    if (status == BW_OK) status = bw_state_read(&b->ctx, state, bw_stage_name(BW_STAGE_REPARAMETRIZE), bw_stage_version(BW_STAGE_REPARAMETRIZE), to);
    if (status == BW_OK && !state->has_igm) status = bw_fail(&b->ctx, BW_E_CHECK, "no integer-grid map: hexes are made block by block");
    return status == BW_OK;
}

static void read_report(bench *b, const bw_report *r) {
    for (size_t i = 0; i < r->stage_count; i++)
        if (!strcmp(r->stage[i].name, bw_stage_name(BW_STAGE_REPARAMETRIZE)))
            b->run[REPARAMETRIZE] = (figure){r->stage[i].seconds, (double)r->stage[i].peak_bytes, true};
    b->run[FIT] = (figure){r->reparametrize.seconds_fit, -1, true};
    b->run[UNTANGLE] = (figure){r->reparametrize.seconds_untangle, -1, true};
}

static bool check(bench *b, const bw_hex_mesh *hex) {
    bw_topology found;
    begin(b);
    return end(b, CHECK, bw_hex_mesh_check(&b->ctx, hex) ? b->ctx.error.status : bw_hex_mesh_topology(&b->ctx, hex, &found));
}

static bool extract(bench *b, const bw_state *s, bw_hex_mesh *hex) {
    bw_hex_plan plan;
    bw_hex_origin origin = {0};
    begin(b);
    bool good = end(b, PLAN, bw_hex_plan_init(&b->ctx, &s->cells, &s->complex, s->length, 1, &plan));
    begin(b);
    good = good && end(b, EXTRACT, bw_hex_extract(&b->ctx, &s->igm, 1, 350000000, hex, &origin));
    bw_hex_origin_clear(&b->ctx, &origin);
    begin(b);
    good = good && end(b, LABEL, bw_hex_label(&b->ctx, &plan, &s->igm, hex)) && check(b, hex);
    bw_hex_plan_clear(&b->ctx, &plan);
    return good;
}

static bw_status measure_quality(bw_context *ctx, const bw_hex_mesh *hex, const bw_hex_surface *surface) {
    bw_hex_quality quality;
    bw_hex_distance distance;
    return bw_hex_measure(ctx, hex, &quality) ? ctx->error.status : bw_hex_measure_distance(ctx, hex, surface, &distance);
}

static bool finish(bench *b, const bw_state *s, bw_hex_mesh *hex) {
    bw_hex_surface surface;
    bw_smooth_options options;
    bw_smooth_options_defaults(&options);
    begin(b);
    if (bw_hex_surface_build(&b->ctx, &s->igm.mesh, s->igm.map.edge_flags, &surface)) return false;
    bool good = end(b, SMOOTH, bw_hex_smooth(&b->ctx, hex, &surface, &options, &b->smoothing));
    begin(b);
    good = good && end(b, QUALITY, measure_quality(&b->ctx, hex, &surface));
    bw_hex_surface_clear(&b->ctx, &surface);
    return good;
}

static bool write_all(bench *b, const bw_hex_mesh *hex) {
    bw_hex_skin skin;
    begin(b);
    bool good = end(b, SKIN, bw_hex_skin_init(&b->ctx, hex, &skin));
    for (int f = 0; f < BW_HEX_FORMAT_COUNT && good; f++) {
        snprintf(b->path, sizeof b->path, "%s/hexmesh.%s", b->out, bw_hex_formats[f].name);
        begin(b);
        good = end(b, (part)(WRITE + f), bw_hex_formats[f].write(&b->ctx, hex, &skin, b->path, NULL));
        unlink(b->path);
    }
    bw_hex_skin_clear(&b->ctx, &skin);
    return good;
}

static bool run(bench *b, const char *input, long long hexes, size_t *count) {
    bw_state *state = calloc(1, sizeof *state);
    bw_hex_mesh hex = {0};
    if (!state) return false;
    memset(b->run, 0, sizeof b->run);
    bool good = make_state(b, input, hexes, state);
    if (good) read_report(b, &state->report);
    good = good && extract(b, state, &hex) && finish(b, state, &hex) && write_all(b, &hex);
    *count = hex.hex_count;
    bw_hex_mesh_clear(&b->ctx, &hex);
    bw_state_clear(&b->ctx, state);
    free(state);
    return good;
}

static void print_row(const bench *b, part p, size_t hexes) {
    const figure *f = &b->best[p];
    char peak[32] = "";
    if (!f->good) return;
    if (f->peak >= 0) snprintf(peak, sizeof peak, "%.1f", 1e-6 * f->peak);
    printf("  %-14s %9.3f %10.2f %10s\n", p < WRITE ? part_names[p] : bw_hex_formats[p - WRITE].name, f->seconds, f->seconds > 0 ? 1e-6 * (double)hexes / f->seconds : 0, peak);
}

static bool measure(bench *b, const char *input) {
    const char *slash = strrchr(input, '/');
    for (int i = 0; i < b->count; i++) {
        size_t hexes = 0;
        for (int r = 0; r < b->repeat; r++) {
            if (!run(b, input, b->hexes[i], &hexes)) {
                printf("%s, %lld hexes: %s: %s\n", slash ? slash + 1 : input, b->hexes[i], bw_status_code(b->ctx.error.status), b->ctx.error.message);
                return false;
            }
            for (int p = 0; p < PARTS; p++)
                if (!r || b->run[p].seconds < b->best[p].seconds) b->best[p] = b->run[p];
        }
        const bw_smooth_report *s = &b->smoothing;
        printf("%s: %zu hexes; scaled Jacobian %.3f least, %.3f mean; smoothed %.3f, %.3f in %llu rounds\n  %-14s %9s %10s %10s\n", slash ? slash + 1 : input, hexes, s->before.least,
               s->before.mean, s->after.least, s->after.mean, (unsigned long long)s->rounds, "part", "seconds", "Mhexes/s", "peak MB");
        for (int p = 0; p < PARTS; p++) print_row(b, (part)p, hexes);
        fflush(stdout);
    }
    return true;
}

/* Writes the sample model that is measured when no file is given. */
static bool make_sample(bench *b) {
    bw_model model;
    bw_model_options options;
    bw_model_options_defaults(&options);
    snprintf(b->sample, sizeof b->sample, "%s/bearing.hexex", b->out);
    bw_status status = bw_model_make(&b->ctx, "bearing", &options, &model);
    if (status == BW_OK) status = bw_model_save(&b->ctx, &model, b->sample);
    bw_model_clear(&b->ctx, &model);
    if (status != BW_OK) fprintf(stderr, "bench_hex: %s\n", b->ctx.error.message);
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
    static const struct option table[] = {{"hexes", 1, NULL, 'n'},  {"threads", 1, NULL, 't'}, {"repeat", 1, NULL, 'r'}, {"help", 0, NULL, 'h'},    {NULL, 0, NULL, 0}};
    for (int c; (c = getopt_long(argc, argv, "h", table, NULL)) != -1;) {
        if (c == 'n' && !read_sizes(b, optarg)) return false;
        if (c == 't') b->threads = atoi(optarg);
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
    bench b = {.hexes = {10000, 100000, 1000000}, .count = 3, .threads = 2, .repeat = 1};
    if (!read_options(&b, argc, argv)) {
        fputs(usage, stderr);
        return 2;
    }
    snprintf(b.out, sizeof b.out, "/tmp/bench_hex.XXXXXX");
    if (!mkdtemp(b.out)) {
        perror("bench_hex");
        return 1;
    }
    bw_context_init(&b.ctx);
    b.ctx.threads = b.threads;
    bench_print_machine("from integers to files of hexes");
    printf("%d threads\n", b.threads);
    bool good = true;
    if (optind == argc) {
        good = make_sample(&b);
        good = good && measure(&b, b.sample);
    }
    for (int i = optind; i < argc; i++) good = measure(&b, argv[i]) && good;
    remove_results(&b);
    return good ? 0 : 1;
}
