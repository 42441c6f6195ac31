/* blockwright run: the whole pipeline in this process, no daemon. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "command.h"
#include "failure.h"
#include "joboptions.h"
#include "summary.h"
#include "terminal.h"

typedef struct {
    const char *out;
    cli_job_options job;
    int64_t threads;
    uint64_t memory;
    bool quiet, verbose;
} settings;

static const cli_option options[] = {
    {"out", 'o', CLI_TEXT, offsetof(settings, out), "DIR",
     "folder for the results, made if missing (required)", 0, 0},
    CLI_JOB_OPTIONS(settings),
    {"threads", 0, CLI_INTEGER, offsetof(settings, threads), "N",
     "threads to use (default 1); the result is the same", 1, 1024},
    {"memory", 0, CLI_BYTES, offsetof(settings, memory), "BYTES",
     "memory limit, e.g. 500M or 4G (default none)", 0, 0},
    {"quiet", 'q', CLI_FLAG, offsetof(settings, quiet), NULL, "no progress and no summary, only errors", 0,
     0},
    {"verbose", 'v', CLI_FLAG, offsetof(settings, verbose), NULL, "also show what the stages log", 0, 0},
};

static volatile sig_atomic_t cancelled, finish;

/* SIGUSR1 asks a search to end with the best it has found; the job goes on with that. */
static void on_finish(int number) {
    (void)number;
    finish = 1;
}

/* The first signal asks the job to stop at its next poll; SA_RESETHAND lets a second one end the program at
 * once. */
static void on_signal(int number) {
    (void)number;
    cancelled = 1;
}

static void catch_signals(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    action.sa_flags = (int)SA_RESETHAND;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    action.sa_handler = on_finish;
    action.sa_flags = SA_RESTART;
    sigaction(SIGUSR1, &action, NULL);
}

static void on_progress(void *user, const char *stage, double fraction) {
    cli_progress_show(user, stage, fraction);
}

static void on_log(void *user, const char *line) {
    cli_progress_clear(user);
    cli_print_safe(stderr, line);
    fputc('\n', stderr);
}

/* The same check as a worker's. */
static bw_status read_options(bw_context *ctx, const settings *s, bw_options *o) {
    const char *problem = NULL;
    json_t *json = cli_job_options_json(&s->job, &problem);
    char *text = json ? json_dumps(json, 0) : NULL;
    bw_options_defaults(o);
    bw_status status = text ? bw_options_from_json(ctx, o, text, strlen(text))
                   : problem ? bw_fail(ctx, BW_E_USAGE, "%s", problem)
                             : bw_fail(ctx, BW_E_MEMORY, "no memory for the options");
    o->parameters = s->job.parameters;
    free(text);
    json_decref(json);
    return status;
}

static void print_error(const bw_context *ctx, const char *input) {
    const bw_error *e = &ctx->error;
    cli_failure failure = {bw_status_code(e->status), e->message, e->region_count ? e->region_count : e->element_count, 0};
    cli_failure_print(input, &failure);
    for (size_t i = 0; i < e->region_count && i < BW_REGIONS_KEPT; i++) {
        const bw_region *r = &e->regions[i];
        size_t known = r->tet_count < BW_REGION_TETS ? r->tet_count : BW_REGION_TETS;
        cli_failure_region(&failure, r->tet_count, r->tets, known, r->centre);
    }
    for (size_t i = 0; !e->region_count && i < e->element_count && i < BW_ELEMENTS_KEPT; i++)
        cli_failure_element(&failure, e->elements[i].kind, e->elements[i].id,
                            e->elements[i].has_position ? e->elements[i].position : NULL);
    cli_failure_end(&failure);
}

static void print_summary(const char *out, int64_t since) {
    json_t *report = cli_report_load(out);
    if (!report) return;
    cli_summary_print(report);
    cli_files_print(out, since);
    json_decref(report);
}

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {.threads = 1};
    cli_operands operands;
    bw_options o;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1)) return CLI_USAGE;
    if (!s.out || !*s.out) return cli_usage_error(self, "--out DIR says where the results go; it is missing");

    cli_progress progress;
    bw_context ctx;
    cli_progress_open(&progress, s.quiet);
    bw_context_init(&ctx);
    if (read_options(&ctx, &s, &o) != BW_OK) return cli_usage_error(self, "%s", ctx.error.message);
    ctx.threads = (int)s.threads;
    ctx.memory.limit = (size_t)s.memory;
    ctx.cancel = &cancelled;
    ctx.finish = &finish;
    ctx.progress = on_progress;
    ctx.log = ctx.note = s.verbose ? on_log : NULL;
    ctx.user = &progress;
    catch_signals();

    int64_t since = cli_files_now();
    bw_status status = bw_run(&ctx, &o, operands.operand[0], s.out);
    cli_progress_clear(&progress);
    if (status != BW_OK) {
        print_error(&ctx, operands.operand[0]);
        return bw_status_exit(status);
    }
    if (!s.quiet) print_summary(s.out, since);
    return CLI_DONE;
}

const cli_command cli_command_run = {
    .name = "run",
    .synopsis = "INPUT --out DIR [options]",
    .summary = "decompose a part here, without a daemon",
    .about = "Reads INPUT, a tet mesh with a seamless parametrization (12 parameters per tet): .hexex,\n"
             "VTK (.vtk, .vtu), Gmsh .msh, OpenVolumeMesh .ovm, or Medit .mesh with --parameters; or a\n"
             "hexahedral mesh in any of them but .hexex, which needs no parameters: every hex is a unit\n"
             "cube of its map. Format and kind are found by content. Makes the map exactly seamless (sanitize), traces the walls\n"
             "of its motorcycle complex (trace), finds nodes, arcs, patches and blocks (build), takes\n"
             "away the walls that can be spared (reduce). With --quantize it goes on to a hex mesh: integer\n"
             "lengths for all arcs (quantize), a map that takes them (reparametrize), its hexes (extract).\n"
             "Writes to DIR (encode):\n\n"
             "  report.json    counts, displacement, seconds and peak memory per stage; or why it failed\n"
             "  blocks.json    the complex: nodes, arcs, patches, blocks and how they meet; integer lengths\n"
             "  constraints.json   with --quantize: the integer differences a parametrizer has to keep\n"
             "  integer_grid.hexex   the integer-grid map, in units of hexes, if the job has one\n"
             "  sizes.svg      with --scales: charts of hexes, objective, zero arcs, distortion\n"
             "  labels.txt     of hexes in: the block of every hex; walls.txt: the quads between blocks\n"
             "  hexmesh.*      the hex mesh, if the job has one, or the one that came in, with its blocks: mesh (Medit), vtu, bwh (compact; decoders in\n"
             "                 clients/decode), or what --hex-formats says\n"
             "  view.drc       walls, skins and singular curves for viewers (Draco)\n"
             "  traced.hexex   the tet mesh refined along the walls, exact parameters and the wall list\n\n"
             "The same input gives the same bytes, with any number of threads and through a daemon as\n"
             "well. An input that cannot be decomposed is refused with the elements at fault. Ctrl-C\n"
             "cancels; SIGUSR1 ends an exploration with the best it has found, and the job goes on.",
    .examples = "  blockwright run part.hexex --out result\n"
                "  blockwright run part.hexex --out result --complex bc     the base complex instead\n"
                "  blockwright run part.hexex --out result --complex serial     fewer blocks before reduction\n"
                "  blockwright run part.hexex --out result --reduce full    as few blocks as can be\n"
                "  blockwright run part.hexex --out result --quantize any --target-hexes 5000     a hex mesh\n"
                "  blockwright run part.hexex --out result --quantize any --coarsest      as coarse as can be\n"
                "  blockwright run part.hexex --out result --quantize any --scales 0,0.5,1,2    by size\n"
                "  blockwright run part.vtu --out result --vtk              VTK in, and out for ParaView\n"
                "  blockwright run hexes.mesh --out result --reduce full    blocks of a hexahedral mesh\n"
                "  blockwright run hexes.mesh --out result --explore auto   fewer, by searching its base complex\n"
                "  blockwright run part.hexex --out check --until sanitize  is the map good? nothing else\n"
                "  blockwright run part.hexex --out result --memory 4G --max-cells 5000000",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
