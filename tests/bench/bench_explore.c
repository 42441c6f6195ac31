/* Exploration: what each method comes to, in how long, and evaluations per second.
 *
 *     bench_explore [options] [FILE ...]        sample models if no file is given
 *
 * The base complex of an input is made once (not timed here: bench_stages does that); then every method is run with every seed.
 */
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "explore/explore.h"
#include "format/input.h"
#include "hex/trivial.h"
#include "machine.h"
#include "models/models.h"
#include "stage/build.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

static const char usage[] = "Usage: bench_explore [options] [FILE ...]\n"
                            "\n"
                            "      --methods M,M,...   of auto, enumerate, swap, enumerate+swap, anneal, exact (default all)\n"
                            "      --beam N            of enumerate (default 500)\n"
                            "      --expand random|cheapest             (default random)\n"
                            "      --cost COST         blocks (default), bits, bits-by-block or cubes\n"
                            "      --work N            most evaluations (default 200000)\n"
                            "      --seeds N           1..N (default 1)\n"
                            "      --no-retract\n"
                            "  -h, --help\n";

enum { CELLS = 8000000 };
static const char *const costs[BW_COST_TERMS] = {"blocks", "bits", "bits-by-block", "cubes"};
static const char *const names[] = {"none", "auto", "enumerate", "swap", "enumerate+swap", "anneal", "exact"};

typedef struct {
    const char *methods;
    bw_explore_choice choice;
    int seeds;
} bench;

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
    bw_space space;
    bw_hex_mesh hexes;
    bw_block_grids grids;
} input;

/* The map of tets, or the trivial one of hexes. */
static bw_status make_map(input *in, bool hexes) {
    bw_sanitize_report sanitized;
    bw_trivial_report trivial;
    bw_vertex *source = NULL;
    bw_status status = hexes ? bw_trivial_map(&in->ctx, &in->mesh, &in->map, &in->hexes, &source, &trivial) : BW_OK;
    bw_free(&in->ctx, source);
    return status == BW_OK ? bw_sanitize(&in->ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &in->mesh, &in->map, &sanitized) : status;
}

static bw_status prepare(input *in) {
    bw_context *ctx = &in->ctx;
    bool hexes = in->mesh.hex_count != 0;
    bw_status status = make_map(in, hexes);
    if (status == BW_OK) status = bw_cells_init(ctx, &in->cells, &in->mesh, &in->map);
    if (status == BW_OK) status = bw_trace(ctx, &in->cells, BW_COMPLEX_BC, CELLS);
    if (status == BW_OK) status = bw_build_complex(ctx, &in->cells, &(bw_build_options){.max_cells = CELLS}, &in->complex);
    if (status == BW_OK) status = bw_space_init(ctx, &in->cells, &in->complex, &in->space);
    if (status != BW_OK || !hexes) return status;
    status = bw_trivial_label(ctx, &in->cells, &in->complex, &in->hexes);
    if (status == BW_OK) status = bw_block_grids_init(ctx, &in->space, &in->hexes, (int64_t)1 << in->map.exponent, &in->grids);
    return status;
}

static void clear(input *in) {
    bw_block_grids_clear(&in->ctx, &in->grids);
    bw_hex_mesh_clear(&in->ctx, &in->hexes);
    bw_space_clear(&in->ctx, &in->space);
    bw_complex_clear(&in->ctx, &in->complex);
    bw_cells_clear(&in->ctx, &in->cells);
    bw_grid_map_clear(&in->ctx, &in->map);
    bw_tet_mesh_clear(&in->ctx, &in->mesh);
}

static bool wanted(const char *list, const char *name) {
    size_t n = strlen(name);
    for (const char *at = list; at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL)
        if (!strncmp(at, name, n) && (at[n] == ',' || !at[n])) return true;
    return !list;
}

static void run(bench *b, input *in, const char *name) {
    printf("%-34s %4zu blocks %5zu patches %4zu sheets %5zu links %2zu components %4zu variable, %zu crossings and %zu open\n", name, in->space.block_count,
           in->space.patch_count, in->space.sheet_count, bw_space_links(&in->space), in->space.component_count, in->space.variable_patches, in->space.crossings,
           in->space.crossings_open);
    uint8_t *wall = malloc(in->space.patch_count);
    b->choice.grids = in->grids.vertex ? &in->grids : NULL;
    for (int m = BW_EXPLORE_AUTO; m <= BW_EXPLORE_EXACT && wall; m++)
        for (int seed = 1; seed <= b->seeds && wanted(b->methods, names[m]); seed++) {
            bw_explore_found f;
            b->choice.method = (bw_explore_method)m, b->choice.seed = (uint64_t)seed;
            if (bw_explore(&in->ctx, &in->space, &b->choice, wall, &f) != BW_OK) {
                printf("  %-15s %s\n", names[m], in->ctx.error.message);
                free(wall);
                return;
            }
            printf("  %-15s seed %d  start %9.3f (%3zu)  serial %9.3f (%3zu)%s  best %9.3f (%3zu)  %8.3f s  %9llu evaluations, the last gain at %9llu  %8.0f/s ", names[m], seed, f.start,
                   f.start_blocks, f.serial, f.serial_blocks, f.proven ? "!" : " ", f.best, f.best_blocks, f.seconds, (unsigned long long)f.evaluations, (unsigned long long)f.improved,
                   (double)f.evaluations / f.seconds);
            for (size_t c = 0; c < f.listed && c < 4; c++)
                if (f.component[c].states)
                    printf(" [%zu sheets: %llu states %llu leaves%s]", f.component[c].sheets, (unsigned long long)f.component[c].states, (unsigned long long)f.component[c].leaves,
                           f.component[c].complete ? ", all" : f.component[c].bounded ? ", bounded" : "");
            printf("\n");
        }
    free(wall);
}

static int measure(bench *b, const char *file, const char *model) {
    static input in;
    memset(&in, 0, sizeof in);
    bw_context_init(&in.ctx);
    bw_status status;
    if (file) {
        status = bw_input_read(&in.ctx, file, NULL, &in.mesh);
    } else {
        bw_model made;
        bw_model_options options;
        bw_model_options_defaults(&options);
        options.size = 2, options.perturb = 1e-5;
        status = bw_model_make(&in.ctx, model, &options, &made);
        if (status == BW_OK) {
            in.mesh.vertex_count = made.vertex_count, in.mesh.tet_count = made.tet_count;
            in.mesh.position = made.position, in.mesh.tet = made.tet, in.mesh.parameter = made.parameter;
            made.position = NULL, made.tet = NULL, made.parameter = NULL;
        }
        bw_model_clear(&in.ctx, &made);
    }
    if (status == BW_OK) status = prepare(&in);
    const char *slash = file ? strrchr(file, '/') : NULL;
    if (status == BW_OK) run(b, &in, slash ? slash + 1 : file ? file : model);
    else printf("%s: %s\n", file ? file : model, in.ctx.error.message);
    clear(&in);
    return status != BW_OK;
}

int main(int argc, char **argv) {
    enum { METHODS = 256, BEAM, EXPAND, COST, WORK, SEEDS, NO_RETRACT };
    static const struct option options[] = {{"methods", 1, NULL, METHODS}, {"beam", 1, NULL, BEAM}, {"expand", 1, NULL, EXPAND}, {"cost", 1, NULL, COST},
                                            {"work", 1, NULL, WORK}, {"seeds", 1, NULL, SEEDS}, {"no-retract", 0, NULL, NO_RETRACT}, {"help", 0, NULL, 'h'}, {0}};
    static const char *const models[] = {"cylinder", "tee", "plate", "bearing", "part"};
    bench b = {.choice = {.beam = 500, .work = 200000, .retract = true}, .seeds = 1};
    b.choice.weight[BW_COST_BLOCKS] = 1;
    for (int c; (c = getopt_long(argc, argv, "h", options, NULL)) != -1;) {
        if (c == METHODS) b.methods = optarg;
        else if (c == BEAM) b.choice.beam = strtoull(optarg, NULL, 10);
        else if (c == EXPAND) b.choice.expand = strcmp(optarg, "cheapest") ? BW_EXPLORE_EXPAND_RANDOM : BW_EXPLORE_EXPAND_CHEAPEST;
        else if (c == WORK) b.choice.work = strtoull(optarg, NULL, 10);
        else if (c == SEEDS) b.seeds = atoi(optarg);
        else if (c == NO_RETRACT) b.choice.retract = false;
        else if (c == COST) for (int i = 0; i < BW_COST_TERMS; i++) b.choice.weight[i] = !strcmp(optarg, costs[i]);
        else {
            fputs(usage, c == 'h' ? stdout : stderr);
            return c == 'h' ? 0 : 2;
        }
    }
    bench_print_machine("bench_explore");
    int failed = 0;
    for (int i = optind; i < argc; i++) failed += measure(&b, argv[i], NULL);
    for (size_t i = 0; i < sizeof models / sizeof *models && optind == argc; i++) failed += measure(&b, NULL, models[i]);
    return failed != 0;
}
