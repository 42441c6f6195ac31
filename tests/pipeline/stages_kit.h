/* A pipeline as the service runs it: one stage after the other, each from the file of the one before. */
#ifndef BW_TESTS_STAGES_KIT_H
#define BW_TESTS_STAGES_KIT_H

#include "kit/kit.h"

#include "blockwright.h"

/* The last stage writes into the folder `out`; no stage may leave memory behind. */
static void run_by_stages(const char *input, const char *out, const bw_options *options) {
    const char *from = input;
    for (int s = 0; s < BW_STAGE_COUNT; s++) {
        bw_context ctx;
        bw_context_init(&ctx);
        const char *to = s == BW_STAGE_ENCODE ? out : kit_temp_path("state.%s", bw_stage_name((bw_stage)s));
        kit_expect_ok(&ctx, bw_stage_run(&ctx, options, (bw_stage)s, from, to));
        assert_int_equal(ctx.memory.used, 0);
        from = to;
    }
}

#endif
