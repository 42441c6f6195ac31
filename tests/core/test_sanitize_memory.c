/* Sanitization reports every failing allocation and leaks nothing. */
#include "sanitize_kit.h"

static bw_status run(bw_context *ctx, void *user) {
    bw_tet_mesh mesh = {0};
    bw_grid_map map = {0};
    bw_sanitize_report report;
    bw_status status = mesh_from_model(ctx, user, &mesh);
    if (status == BW_OK) status = bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 1e-2}, &mesh, &map, &report);
    bw_tet_mesh_clear(ctx, &mesh);
    bw_grid_map_clear(ctx, &map);
    return status;
}

static void check_model(const char *name, double perturb) {
    bw_model_options o = model_options(1, 0.5, perturb, BW_SCRAMBLE_NONE, kit_seed());
    bw_model model = make_model(name, &o);
    size_t runs = kit_fail_each_allocation(run, &model);
    print_message("%s: %zu allocations\n", name, runs - 1);
    assert_true(runs > 50);
    drop_model(&model);
}

static void every_failing_allocation_is_reported(void **state) {
    (void)state;
    check_model("torus-quarter", 1e-4);
    check_model("plus", 1e-4);
    check_model("torus-half", 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_failing_allocation_is_reported)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
