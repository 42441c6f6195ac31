/* Random models of every family, through all stages as one job each, and checked by programs that share
 * nothing with the core.
 *
 * BW_GENERATOR_MODELS is the number of models: 200 unless it is set, 20 in builds with sanitizers. BW_SEED
 * sets the seed; each model prints what it is. A wall checker of somebody else's, if the shared data has one,
 * is given every traced.hexex as well.
 */
#include "kit/kit.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "core/flat_kit.h"
#include "core/traced_check.h"

/* The sanitizers' runtimes, if this program is linked with one. */
extern void __asan_init(void) __attribute__((weak));
extern void __ubsan_handle_out_of_bounds(void *, void *) __attribute__((weak));

static size_t models_wanted(void) {
    const char *text = getenv("BW_GENERATOR_MODELS");
    if (text) return strtoul(text, NULL, 10);
    return __asan_init || __ubsan_handle_out_of_bounds ? 20 : 200;
}

/* ---- random jobs ------------------------------------------------------------------------------------ */

typedef struct {
    const char *family;
    const flat_shape *flat; /* NULL: a sample model */
    bw_model_options model;
    bw_options options;
    bool exact; /* the map has no defects: the number of blocks of its base complex is known */
    char text[200];
} job;

static void describe(job *j) {
    static const char *const complexes[] = {"mc", "bc", "serial"}, *const modes[] = {"none", "keep-singular", "full"};
    const bw_model_options *m = &j->model;
    snprintf(
        j->text, sizeof j->text,
        "%s size %d count %d stretch %.3g noise %.2f perturb %.1g scramble %d seed %llu%s: %s %s%s effort %d",
        j->family, m->size, m->count, m->stretch, m->noise, m->perturb, m->scramble,
        (unsigned long long)m->seed, m->features ? " features" : "", complexes[j->options.complex],
        modes[j->options.reduce], j->options.self_adjacent == BW_SELF_ADJACENT_SPLIT ? " split" : "",
        j->options.effort);
}

/* A job of the family whose turn it is. Errors of the parameters are 10^low to 10^high of the shortest edge,
 * for two thirds of the motorcycle complexes, simultaneous or serial. They part singular edges that lay on one wall, and a base
 * complex may then become as large as one likes: those are drawn exact. */
static job draw(size_t number, kit_random *random, double low, double high) {
    size_t samples;
    const bw_model_info *list = bw_model_list(&samples);
    size_t family = number % (samples + FLAT_SHAPES);
    job j = {.flat = family < samples ? NULL : &flat_shapes[family - samples]};
    j.family = j.flat ? j.flat->name : list[family].name;
    bw_options_defaults(&j.options);
    j.options.complex = (bw_complex_kind)kit_random_below(random, 3);
    j.options.reduce = (bw_reduce_mode)kit_random_below(random, 3);
    j.options.self_adjacent = kit_random_below(random, 3) ? BW_SELF_ADJACENT_ALLOW : BW_SELF_ADJACENT_SPLIT;
    j.options.effort = (int)kit_random_below(random, 3);
    j.options.max_cells = 400000;
    j.options.tolerance = 0.02;
    bw_model_options_defaults(&j.model);
    j.exact = j.flat || j.options.complex == BW_COMPLEX_BC || kit_random_below(random, 3) == 0;
    int blocks = j.flat ? 9 : list[family].blocks_bc, largest = blocks < 4 ? 3 : blocks < 8 ? 2 : 1;
    j.model.size = 1 + (int)kit_random_below(random, (uint64_t)largest);
    j.model.count = 1 + (int)kit_random_below(random, 4);
    j.model.stretch = exp2(kit_random_range(random, -2, 2));
    j.model.noise = kit_random_unit(random);
    double error = pow(10, kit_random_range(random, low, high));
    j.model.perturb = j.exact ? 0 : error;
    j.model.scramble = (int)kit_random_below(random, 4);
    j.model.features = (int)kit_random_below(random, 2);
    j.model.seed = kit_random_next(random) % 1000000;
    describe(&j);
    return j;
}

static int write_input(const job *j, const char *path) {
    bw_context ctx;
    bw_model model;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, j->flat ? flat_make(&ctx, j->flat, 0.2 * j->model.noise, j->model.seed, &model)
                                : bw_model_make(&ctx, j->family, &j->model, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    int blocks = j->flat ? 0 : model.blocks_bc;
    bw_model_clear(&ctx, &model);
    return blocks;
}

/* ---- what has to hold ------------------------------------------------------------------------------- */

static size_t blocks_of(const json_t *complex, const char *name) {
    return (size_t)json_integer_value(json_object_get(json_object_get(complex, name), "blocks"));
}

/* The counts of the report; returns the blocks that the traced mesh must have. */
static size_t check_report(const job *j, const char *folder, int known, size_t *raw) {
    json_error_t error;
    char path[1024];
    snprintf(path, sizeof path, "%s/report.json", folder);
    json_t *root = json_load_file(path, 0, &error);
    assert_non_null(root);
    const json_t *complex = json_object_get(root, "complex");
    size_t blocks = *raw = blocks_of(complex, "raw");
    bool allow = j->options.self_adjacent == BW_SELF_ADJACENT_ALLOW;
    if (allow && known && j->exact && j->options.complex == BW_COMPLEX_BC && !j->model.features)
        assert_int_equal(*raw, known);
    if (j->options.reduce == BW_REDUCE_NONE)
        assert_null(json_object_get(complex, "reduced"));
    else
        blocks = blocks_of(complex, "reduced");
    assert_in_range(blocks, 1, *raw);
    json_decref(root);
    return blocks;
}

static void check_traced(const job *j, const char *folder, size_t blocks) {
    char path[1024];
    traced_verdict verdict;
    snprintf(path, sizeof path, "%s/traced.hexex", folder);
    char *text = kit_read_file(path, NULL);
    assert_true(traced_check(text, true, &verdict));
    free(text);
    if (traced_faults(&verdict)) traced_print(j->text, &verdict);
    assert_int_equal(traced_faults(&verdict), 0);
    assert_int_equal(verdict.blocks, blocks);
}

/* The checker that comes with the shared data, NULL if there is none. */
static const char *other_checker(void) {
    static char path[1100];
    const char *folder = BW_SHARED_DIR "/tools";
    if (*path || !kit_exists(folder)) return *path ? path : NULL;
    size_t count;
    char **names = kit_names(folder, "_walls.py", &count);
    if (count) snprintf(path, sizeof path, "%s/%s", folder, names[0]);
    kit_names_free(names, count);
    return *path ? path : NULL;
}

static void check_by_other(const char *folder) {
    char path[1024];
    snprintf(path, sizeof path, "%s/traced.hexex", folder);
    setenv("XDG_CACHE_HOME", kit_temp_dir(), 1); /* it keeps a compiled form of itself */
    kit_result result = kit_run((const char *const[]){"python3", other_checker(), path, NULL});
    if (result.exit != 0) print_message("%s%s", result.out, result.err);
    assert_int_equal(result.exit, 0);
    kit_result_clear(&result);
}

/* ---- tests ------------------------------------------------------------------------------------------ */

/* Runs a job and checks its results, which are left in the folder. */
static void run_and_check(const job *j, const char *folder) {
    const char *input = kit_temp_path("in.hexex");
    int known = write_input(j, input);
    bw_context ctx;
    bw_context_init(&ctx);
    bw_status status = bw_run(&ctx, &j->options, input, folder);
    if (status != BW_OK) print_message("\n");
    kit_expect_ok(&ctx, status);
    assert_int_equal(ctx.memory.used, 0);
    size_t raw, blocks = check_report(j, folder, known, &raw);
    print_message(" -> %zu, %zu\n", raw, blocks);
    check_traced(j, folder, blocks);
}

static size_t checked_by_other;

static void random_models_of_every_family_pass_all_checks(void **state) {
    (void)state;
    size_t wanted = models_wanted();
    kit_random random = kit_random_start(1);
    assert_true(wanted > 0);
    for (size_t i = 0; i < wanted; i++) {
        job j = draw(i, &random, -5, -3);
        const char *folder = kit_temp_path("out");
        print_message("%3zu %s", i, j.text);
        run_and_check(&j, folder);
        if (!other_checker()) continue;
        check_by_other(folder);
        checked_by_other++;
    }
}

static void another_checker_finds_nothing_either(void **state) {
    (void)state;
    if (!other_checker()) kit_skip("no other checker in %s", BW_SHARED_DIR);
    assert_int_equal(checked_by_other, models_wanted());
}

/* Down to the last bits of a double. Walls a hair apart cut tets so thin that angles measured in floating
 * point mean nothing, so these are not for the other checker, which measures them so. */
enum { ERRORS = 2 }; /* stream of random numbers */

/* Jobs that failed once: by the seed of the test above and their number in it. */
static void what_failed_once_passes(void **state) {
    (void)state;
    static const struct {
        uint64_t seed;
        size_t number;
    } known[] = {{13, 3} /* a cell so thin that doubles put all its vertices into one plane */};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        kit_random random = kit_random_of(known[i].seed, ERRORS);
        job j = draw(0, &random, -16, -5);
        for (size_t n = 1; n <= known[i].number; n++) j = draw(n, &random, -16, -5);
        print_message("    %s", j.text);
        run_and_check(&j, kit_temp_path("out"));
    }
}

static void errors_of_any_size_do_no_harm(void **state) {
    (void)state;
    kit_random random = kit_random_start(ERRORS);
    for (size_t i = 0; i < models_wanted() / 5; i++) {
        job j = draw(i, &random, -16, -5);
        print_message("%3zu %s", i, j.text);
        run_and_check(&j, kit_temp_path("out"));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_models_of_every_family_pass_all_checks),
        cmocka_unit_test(another_checker_finds_nothing_either),
        cmocka_unit_test(what_failed_once_passes),
        cmocka_unit_test(errors_of_any_size_do_no_harm),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
