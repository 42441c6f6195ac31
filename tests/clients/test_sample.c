/* `blockwright sample` makes the models of tests/models, the same bytes every time. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "kit/kit.h"
#include "models/models.h"

static void the_list_names_every_model(void **state) {
    (void)state;
    size_t n;
    const bw_model_info *list = bw_model_list(&n);
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "--list", NULL});
    assert_int_equal(r.exit, 0);
    assert_true(n > 0);
    for (size_t i = 0; i < n; i++) {
        char line[64];
        snprintf(line, sizeof line, "\n%s ", list[i].name);
        if (!strstr(r.out, line)) fail_msg("the list lacks %s:\n%s", list[i].name, r.out);
    }
    kit_result_clear(&r);
}

static void every_listed_model_can_be_made(void **state) {
    (void)state;
    size_t n;
    const bw_model_info *list = bw_model_list(&n);
    for (size_t i = 0; i < n; i++) {
        const char *file = kit_temp_path("%s.hexex", list[i].name);
        kit_result r =
            kit_run((const char *[]){kit_program("blockwright"), "sample", list[i].name, "-o", file, NULL});
        if (r.exit != 0) fail_msg("%s: exit %d: %s", list[i].name, r.exit, r.err);
        assert_int_equal(r.out_size, 0);
        assert_true(kit_exists(file));
        kit_result_clear(&r);
    }
}

/* Both ways of output, and the options, against the library called directly. */
static void options_reach_the_generator(void **state) {
    (void)state;
    const char *name = bw_model_list(&(size_t){0})[0].name;
    const char *by_library = kit_temp_path("library.hexex");
    bw_context ctx;
    bw_model model;
    bw_model_options o;
    bw_context_init(&ctx);
    bw_model_options_defaults(&o);
    o.size = 3;
    o.stretch = 1.5;
    o.noise = 0.25;
    o.perturb = 0.001;
    o.scramble = BW_SCRAMBLE_TETS;
    o.features = 1;
    o.seed = 11;
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &o, &model));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, by_library));
    bw_model_clear(&ctx, &model);

    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", name, "--size=3",
                                            "--stretch", "1.5", "--noise=0.25", "--perturb", "0.001",
                                            "--scramble=tets", "--features", "--seed", "11", "-o-", NULL});
    size_t size;
    char *bytes = kit_read_file(by_library, &size);
    assert_int_equal(r.exit, 0);
    assert_int_equal(r.out_size, size);
    assert_memory_equal(r.out, bytes, size);
    free(bytes);
    kit_result_clear(&r);
}

static void a_place_that_cannot_be_written_is_exit_5(void **state) {
    (void)state;
    const char *name = bw_model_list(&(size_t){0})[0].name;
    kit_result r = kit_run(
        (const char *[]){kit_program("blockwright"), "sample", name, "-o", "/nowhere/at/all.hexex", NULL});
    assert_int_equal(r.exit, 5);
    assert_non_null(strstr(r.err, "/nowhere/at/all.hexex"));
    kit_result_clear(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_list_names_every_model),
        cmocka_unit_test(every_listed_model_can_be_made),
        cmocka_unit_test(options_reach_the_generator),
        cmocka_unit_test(a_place_that_cannot_be_written_is_exit_5),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
