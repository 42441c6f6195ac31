/* What is said of the memory that a stage will need is no less than nine tenths of what it takes. */
#include "kit/kit.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "blockwright.h"
#include "models/models.h"

static const char *const choices[] = {
    "{}",
    "{\"quantize\":\"positive\",\"hex_formats\":[\"mesh\",\"vtu\",\"msh\",\"bwh\"],\"vtk\":\"yes\",\"tmesh\":\"yes\"}",
    "{\"quantize\":\"any\",\"scale\":0,\"effort\":2,\"subdivide\":3}",
    "{\"complex\":\"bc\",\"reduce\":\"full\",\"quantize\":\"positive\",\"target_hexes\":5000}",
};

static void expect_enough(const char *input, const char *choice) {
    uint64_t told = 0;
    const char *from = input;
    for (int s = 0; s < BW_STAGE_COUNT; s++) {
        bw_context ctx;
        bw_options options;
        bw_context_init(&ctx);
        bw_options_defaults(&options);
        kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, choice, strlen(choice)));
        const char *to = s == BW_STAGE_ENCODE ? kit_temp_path("out") : kit_temp_path("state.%s", bw_stage_name((bw_stage)s));
        kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, (bw_stage)s, from, to));
        if (s && told < ctx.memory.peak / 10 * 9)
            fail_msg("%s %s: %s took %zu bytes, and %llu were told", input, choice, bw_stage_name((bw_stage)s), ctx.memory.peak,
                     (unsigned long long)told);
        assert_int_equal(ctx.next_need != 0, s < BW_STAGE_ENCODE);
        told = ctx.next_need;
        from = to;
    }
}

static const char *sample(const char *name) {
    bw_context ctx;
    bw_model_options options;
    bw_model model;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.5;
    const char *path = kit_temp_path("%s.hexex", name);
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    return path;
}

static void generated_models_take_what_was_told(void **state) {
    (void)state;
    static const char *const names[] = {"cuboid", "tee"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++) {
        char input[300];
        snprintf(input, sizeof input, "%s", sample(names[m]));
        for (size_t c = 0; c < sizeof choices / sizeof *choices; c++) expect_enough(input, choices[c]);
    }
}

static void real_models_take_what_was_told(void **state) {
    (void)state;
    static const char *const names[] = {"scf_fanpart"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++) {
        char path[400];
        snprintf(path, sizeof path, "%s/data/tet/%s.hexex", BW_SHARED_DIR, names[m]);
        if (access(path, R_OK) != 0) skip();
        expect_enough(path, choices[1]);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(generated_models_take_what_was_told),
    cmocka_unit_test(real_models_take_what_was_told),
};
KIT_MAIN(tests)
