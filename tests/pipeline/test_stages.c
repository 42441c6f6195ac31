/* A job run in one process and the same job run stage by stage, from file to file, give the same bytes. */
#include "kit/kit.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "blockwright.h"
#include "models/models.h"
#include "pipeline/stages_kit.h"

static const char *const results[] = {"traced.hexex", "blocks.json", "view.drc"};

static const char *sample(const char *name, double perturb) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5, options.perturb = perturb;
    bw_model model;
    const char *path = kit_temp_path("%s.hexex", name);
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

static void run(const char *input, const char *out, const bw_options *options, int threads) {
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.threads = threads;
    kit_expect_ok(&ctx, bw_run(&ctx, options, input, out));
    assert_int_equal(ctx.memory.used, 0);
}

static void expect_same_results(const char *a, const char *b) {
    for (size_t i = 0; i < sizeof results / sizeof *results; i++) {
        size_t size[2];
        char *bytes[2] = {kit_read_file(kit_temp_path("%s/%s", a, results[i]), &size[0]),
                          kit_read_file(kit_temp_path("%s/%s", b, results[i]), &size[1])};
        assert_int_equal(size[0], size[1]);
        assert_true(size[0] > 0);
        assert_memory_equal(bytes[0], bytes[1], size[0]);
        free(bytes[0]), free(bytes[1]);
    }
}

static void one_process_stages_and_threads_agree(void **state) {
    (void)state;
    const char *names[] = {"part", "torus-quarter", "ball", "bearing"};
    static const bw_complex_kind kinds[] = {BW_COMPLEX_MC, BW_COMPLEX_MC, BW_COMPLEX_BC, BW_COMPLEX_SERIAL};
    for (int m = 0; m < 4; m++) {
        const char *input = sample(names[m], m ? 1e-7 : 0);
        bw_options options;
        bw_options_defaults(&options);
        options.complex = kinds[m];
        options.time_limit = 3600; /* what a clock ends is no answer to compare */
        options.quantize = (bw_quantize_range)(BW_QUANTIZE_ANY - m % 3), options.scale = m, options.scale_count = 1, options.scales[0] = 3;
        run(input, kit_temp_path("once"), &options, 1);
        run(input, kit_temp_path("again"), &options, 1);
        run(input, kit_temp_path("threads"), &options, 2);
        run_by_stages(input, kit_temp_path("stages"), &options);
        expect_same_results("once", "again");
        expect_same_results("once", "threads");
        expect_same_results("once", "stages");
    }
}

/* The order of the tets in the file has no part in any result. */
static void shuffled_tets_give_the_same_bytes(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.6, options.perturb = 1e-7, options.scramble = BW_SCRAMBLE_BLOCKS;
    bw_options job;
    bw_options_defaults(&job);
    kit_random random = kit_random_start(5);
    for (int i = 0; i < 9; i++) {
        bool first = i % 6 == 0;
        job.complex = i < 6 ? BW_COMPLEX_MC : BW_COMPLEX_SERIAL;
        bw_model model;
        kit_expect_ok(&ctx, bw_model_make(&ctx, "bearing", &options, &model));
        for (size_t t = model.tet_count - 1; !first && t > 0; t--) {
            size_t other = kit_random_below(&random, t + 1);
            int32_t tet[4];
            double parameter[4][3];
            memcpy(tet, model.tet[t], sizeof tet), memcpy(parameter, model.parameter[t], sizeof parameter);
            memcpy(model.tet[t], model.tet[other], sizeof tet), memcpy(model.parameter[t], model.parameter[other], sizeof parameter);
            memcpy(model.tet[other], tet, sizeof tet), memcpy(model.parameter[other], parameter, sizeof parameter);
        }
        kit_expect_ok(&ctx, bw_model_save(&ctx, &model, kit_temp_path("shuffled.hexex")));
        bw_model_clear(&ctx, &model);
        run(kit_temp_path("shuffled.hexex"), first ? kit_temp_path("in-order") : kit_temp_path("shuffled"), &job, 1);
        if (!first) expect_same_results("in-order", "shuffled");
    }
}

static void until_stops_there(void **state) {
    (void)state;
    const char *input = sample("cuboid", 0);
    bw_options options;
    bw_options_defaults(&options);
    options.until = BW_STAGE_TRACE;
    run(input, kit_temp_path("until"), &options, 1);
    char *report = kit_read_file(kit_temp_path("until/report.json"), NULL);
    assert_non_null(strstr(report, "\"trace\""));
    assert_null(strstr(report, "\"complex\""));
    assert_false(kit_exists(kit_temp_path("until/traced.hexex")));
    free(report);
}

static void a_failed_job_leaves_a_report(void **state) {
    (void)state;
    kit_write_text(kit_temp_path("bad.hexex"), "4\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1\n0 1 2 9 0 0 0 1 0 0 0 1 0 0 0 1\n");
    bw_context ctx;
    bw_context_init(&ctx);
    bw_options options;
    bw_options_defaults(&options);
    kit_expect_status(&ctx, bw_run(&ctx, &options, kit_temp_path("bad.hexex"), kit_temp_path("bad")), BW_E_INDEX);
    char *report = kit_read_file(kit_temp_path("bad/report.json"), NULL), *error = bw_error_json(&ctx);
    assert_non_null(strstr(report, "index-out-of-range"));
    assert_non_null(strstr(error, "\"class\""));
    free(report), free(error);
    assert_int_equal(ctx.memory.used, 0);
}

static void state_files_are_refused_if_damaged_or_of_another_stage(void **state) {
    (void)state;
    const char *input = sample("cuboid", 0), *good = kit_temp_path("good.state");
    bw_options options;
    bw_options_defaults(&options);
    bw_context ctx;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, BW_STAGE_SANITIZE, input, good));
    size_t size;
    char *bytes = kit_read_file(good, &size);
    for (int i = 0; i < 3; i++) {
        bw_context_init(&ctx);
        if (i == 1) bytes[size / 2] ^= 1;
        kit_write_file(kit_temp_path("tried.state"), bytes, i == 2 ? size / 3 : size);
        bw_status status = bw_stage_run(&ctx, &options, i ? BW_STAGE_TRACE : BW_STAGE_BUILD, kit_temp_path("tried.state"),
                                        kit_temp_path("never.state"));
        kit_expect_status(&ctx, status, i ? BW_E_IO : BW_E_VERSION);
        assert_false(kit_exists(kit_temp_path("never.state")));
        assert_int_equal(ctx.memory.used, 0);
    }
    free(bytes);
}

static bw_status trace_from_state(bw_context *ctx, void *user) {
    bw_options options;
    bw_options_defaults(&options);
    return bw_stage_run(ctx, &options, BW_STAGE_TRACE, user, kit_temp_path("traced.state"));
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    char *from = kit_temp_dir() ? strdup(kit_temp_path("loop.state")) : NULL;
    bw_options options;
    bw_options_defaults(&options);
    bw_context ctx;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, BW_STAGE_SANITIZE, sample("cuboid", 0), from));
    assert_true(kit_fail_each_allocation(trace_from_state, from) > 20);
    free(from);
}

static void a_byte_budget_is_a_limit(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.memory.limit = 300000;
    bw_options options;
    bw_options_defaults(&options);
    kit_expect_status(&ctx, bw_run(&ctx, &options, sample("ball", 0), kit_temp_path("small")), BW_E_MEMORY);
    assert_int_equal(ctx.memory.used, 0);
}

static void cancellation_ends_any_stage(void **state) {
    (void)state;
    static volatile sig_atomic_t cancel = 1;
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.cancel = &cancel;
    bw_options options;
    bw_options_defaults(&options);
    kit_expect_status(&ctx, bw_run(&ctx, &options, sample("ball", 0), kit_temp_path("cancelled")), BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, 0);
}

static void options_are_read_strictly(void **state) {
    (void)state;
    const struct {
        const char *json;
        bw_status status;
    } cases[] = {{"{}", BW_OK},
                 {"{\"complex\": \"bc\", \"until\": \"build\", \"tolerance\": 0.001, \"max_cells\": 5}", BW_OK},
                 {"{\"complex\": \"serial\"}", BW_OK},
                 {"{\"kind\": \"hex\"}", BW_OK},
                 {"{\"kind\": \"quad\"}", BW_E_USAGE},
                 {"{\"complex\": \"abc\"}", BW_E_USAGE},
                 {"{\"complex\": 1}", BW_E_USAGE},
                 {"{\"until\": \"never\"}", BW_E_USAGE},
                 {"{\"tolerance\": -1}", BW_E_USAGE},
                 {"{\"tolerance\": \"1\"}", BW_E_USAGE},
                 {"{\"max_cells\": 0}", BW_E_USAGE},
                 {"{\"max_cells\": 1.5}", BW_E_USAGE},
                 {"{\"quantize\": \"positive\", \"scale\": 0, \"target_hexes\": 7, \"time_limit\": 0.5, \"scales\": [0, 0.5, 2]}", BW_OK},
                 {"{\"quantize\": \"yes\"}", BW_E_USAGE},
                 {"{\"quantize\": \"none\", \"scale\": 1, \"target_hexes\": 0, \"fewest_hexes\": false, \"scales\": [], \"rounding\": false}", BW_OK},
                 {"{\"quantize\": \"any\", \"fewest_hexes\": true, \"target_hexes\": 7}", BW_E_USAGE},
                 {"{\"scale\": -1}", BW_E_USAGE},
                 {"{\"target_hexes\": 1.5}", BW_E_USAGE},
                 {"{\"scales\": 1}", BW_E_USAGE},
                 {"{\"scales\": [1, -1]}", BW_E_USAGE},
                 {"{\"time_limit\": \"long\"}", BW_E_USAGE},
                 {"{\"colour\": 1}", BW_E_USAGE},
                 {"{\"complex\": \"mc\", \"complex\": \"bc\"}", BW_E_USAGE},
                 {"[]", BW_E_USAGE},
                 {"{", BW_E_USAGE}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_options options;
        bw_options_defaults(&options);
        kit_expect_status(&ctx, bw_options_from_json(&ctx, &options, cases[i].json, strlen(cases[i].json)), cases[i].status);
        if (i == 1) {
            assert_int_equal(options.complex, BW_COMPLEX_BC);
            assert_int_equal(options.until, BW_STAGE_BUILD);
            assert_int_equal(options.max_cells, 5);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_process_stages_and_threads_agree),
        cmocka_unit_test(shuffled_tets_give_the_same_bytes),
        cmocka_unit_test(until_stops_there),
        cmocka_unit_test(a_failed_job_leaves_a_report),
        cmocka_unit_test(state_files_are_refused_if_damaged_or_of_another_stage),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(a_byte_budget_is_a_limit),
        cmocka_unit_test(cancellation_ends_any_stage),
        cmocka_unit_test(options_are_read_strictly),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
