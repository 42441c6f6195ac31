/* Every real map of the shared data becomes exact, without moving. */
#include "sanitize_kit.h"

#include <stdio.h>

#include "format/hexex.h"

/* noise: errors added to the parameters, relative to the largest of them. */
static void check_file(const char *folder, const char *name, double noise) {
    char path[512];
    sanitized s = {0};
    bw_context_init(&s.ctx);
    snprintf(path, sizeof path, "%s/%s", folder, name);
    kit_expect_ok(&s.ctx, bw_hexex_read(&s.ctx, path, &s.mesh));
    double largest = 0;
    for (size_t i = 0; i < 12 * s.mesh.tet_count; i++)
        largest = fmax(largest, fabs(s.mesh.parameter[i / 12][i % 12 / 3][i % 3]));
    kit_random random = kit_random_start(1);
    for (size_t i = 0; noise > 0 && i < 12 * s.mesh.tet_count; i++)
        s.mesh.parameter[i / 12][i % 12 / 3][i % 3] += kit_random_range(&random, -noise, noise) * largest;
    sanitize_mesh(&s, 1e-2);
    if (s.status) fail_msg("%s: %s: %s", name, bw_status_code(s.status), s.ctx.error.message);
    print_message("%-36s %6zu tets, moved %.1e, cut %zu, system %zu x %zu, rank %zu\n", name,
                  s.mesh.tet_count, s.report.displacement_max, s.report.cut_facets, s.report.system_rows,
                  s.report.system_columns, s.report.system_rank);
    check_exact(&s);
    if (noise > 0) assert_false(s.report.already_exact);
    assert_true(s.report.displacement_max <= (noise > 0 ? 20 * noise * largest : ldexp(largest, -42)));
    drop_sanitized(&s);
}

static void check_folder(const char *folder, double noise) {
    size_t count;
    char **names = kit_names(folder, ".hexex", &count);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) check_file(folder, names[i], noise);
    kit_names_free(names, count);
}

static void every_tet_file_becomes_exact(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet"), 0);
}

/* Most of these maps are exact once rounded to the grid; with errors a thousand times larger all of them need
 * the core system. */
static void every_tet_file_with_errors_becomes_exact(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet"), 1e-11);
}

static void files_with_features_become_exact(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet-features"), 0);
    check_folder(kit_shared("data/tet-features"), 1e-11);
}

static void traced_files_become_exact(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet-walls"), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_tet_file_becomes_exact),
        cmocka_unit_test(every_tet_file_with_errors_becomes_exact),
        cmocka_unit_test(files_with_features_become_exact),
        cmocka_unit_test(traced_files_become_exact),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
