/* blockwright sample: makes parametrized parts of known structure (tests/models). */
#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "base/context.h"
#include "command.h"
#include "models/models.h"
#include "terminal.h"

typedef struct {
    const char *out, *scramble;
    int64_t size, count, seed, folds;
    double stretch, noise, perturb;
    bool features, list;
} settings;

static const cli_option options[] = {
    {"list", 'l', CLI_FLAG, offsetof(settings, list), NULL,
     "list the samples and the blocks they are made of", 0, 0},
    {"out", 'o', CLI_TEXT, offsetof(settings, out), "FILE",
     "where to write it (default NAME.hexex; - is standard output)", 0, 0},
    {"size", 0, CLI_INTEGER, offsetof(settings, size), "N", "grid cells along the shortest side of a block",
     1, 64},
    {"count", 0, CLI_INTEGER, offsetof(settings, count), "N",
     "number of holes, where a sample has several (0: as listed)", 0, 16},
    {"stretch", 0, CLI_NUMBER, offsetof(settings, stretch), "X", "how unlike the lengths in the map become",
     0.01, 100},
    {"noise", 0, CLI_NUMBER, offsetof(settings, noise), "X", "0..1: moves vertices off their regular places",
     0, 1},
    {"perturb", 0, CLI_NUMBER, offsetof(settings, perturb), "X",
     "random errors of the parameters, relative to the shortest edge", 0, 0.02},
    {"scramble", 0, CLI_CHOICE, offsetof(settings, scramble), "none|blocks|cells|tets",
     "what gets a chart of its own, turned and moved at random", 0, 0},
    {"features", 0, CLI_FLAG, offsetof(settings, features), NULL, "list sharp edges and corners as features",
     0, 0},
    {"folds", 0, CLI_INTEGER, offsetof(settings, folds), "N",
     "moves N vertices past their neighbours in the map: tets there are inverted", 0, 1000},
    {"seed", 0, CLI_INTEGER, offsetof(settings, seed), "N", "seed of noise, perturb, scramble and folds", 0, 9e15},
};

static int print_list(void) {
    size_t n;
    const bw_model_info *list = bw_model_list(&n);
    printf("%-14s %7s  %s\n", "name", "blocks", "what it is");
    for (size_t i = 0; i < n; i++) printf("%-14s %7d  %s\n", list[i].name, list[i].blocks_bc, list[i].title);
    return CLI_DONE;
}

static bool known(const char *name) {
    size_t n;
    const bw_model_info *list = bw_model_list(&n);
    for (size_t i = 0; i < n; i++)
        if (!strcmp(list[i].name, name)) return true;
    return false;
}

static int scramble_of(const char *word) {
    static const char *const words[] = {"none", "blocks", "cells", "tets"};
    for (int i = 0; i < 4; i++)
        if (!strcmp(words[i], word)) return i; /* the order of BW_SCRAMBLE_* */
    return BW_SCRAMBLE_NONE;
}

static bw_status write_model(bw_context *ctx, const bw_model *model, const char *out) {
    if (!strcmp(out, "-")) return bw_model_write(ctx, model, stdout);
    return bw_model_save(ctx, model, out);
}

static int make(const char *name, const bw_model_options *o, const char *out) {
    char file[64];
    bw_context ctx;
    bw_model model = {0};
    bw_context_init(&ctx);
    snprintf(file, sizeof file, "%s.hexex", name);
    if (!out) out = file;
    bw_status status = bw_model_make(&ctx, name, o, &model);
    if (status == BW_OK) status = write_model(&ctx, &model, out);
    if (status != BW_OK)
        cli_error("%s [%s]", ctx.error.message, bw_status_code(status));
    else if (strcmp(out, "-") != 0)
        fprintf(stderr, "%s: %zu vertices, %zu tets; its base complex has %d block%s\n", out, model.vertex_count, model.tet_count,
                model.blocks_bc, model.blocks_bc == 1 ? "" : "s");
    bw_model_clear(&ctx, &model);
    return bw_status_exit(status);
}

static int run(const cli_command *self, int argc, char **argv) {
    bw_model_options o;
    bw_model_options_defaults(&o);
    settings s = {.size = o.size,
                  .count = o.count,
                  .seed = (int64_t)o.seed,
                  .stretch = o.stretch,
                  .noise = o.noise,
                  .perturb = o.perturb,
                  .features = o.features != 0};
    cli_operands operands;
    if (!cli_parse(self, argc, argv, &s, &operands, 0, 1)) return CLI_USAGE;
    if (s.list) return print_list();
    if (operands.count == 0)
        return cli_usage_error(self, "which sample? 'blockwright sample --list' names them");
    if (!known(operands.operand[0]))
        return cli_usage_error(self, "there is no sample '%s'; 'blockwright sample --list' names them",
                               operands.operand[0]);
    o.size = (int)s.size;
    o.count = (int)s.count;
    o.seed = (uint64_t)s.seed;
    o.stretch = s.stretch;
    o.noise = s.noise;
    o.perturb = s.perturb;
    o.features = s.features;
    o.folds = (int)s.folds;
    if (s.scramble) o.scramble = scramble_of(s.scramble);
    return make(operands.operand[0], &o, s.out);
}

const cli_command cli_command_sample = {
    .name = "sample",
    .synopsis = "NAME [options]",
    .summary = "make a parametrized part of known structure",
    .about = "Writes a tet mesh with a seamless parametrization whose block structure is known:\n"
             "cuboids, a cylinder, a ball, tori, a pipe tee, a plate with holes and more. The same\n"
             "name and options give the same bytes. With --perturb the map is no longer exactly\n"
             "seamless, as real ones are not; 'blockwright run' then has something to sanitize. With\n"
             "--scramble neighbouring tets speak of the same place in different charts. With --folds\n"
             "some tets are inverted; 'blockwright run --repair' can deal with most of them.",
    .examples = "  blockwright sample --list\n"
                "  blockwright sample part -o part.hexex --noise 0.5 --perturb 1e-6\n"
                "  blockwright sample plate --count 6 --size 4\n"
                "  blockwright sample ball --noise 0.5 --perturb 0.001 --scramble tets --seed 7",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
