/* Real inputs: every one passes all stages and their checks, and has the reference's base complex, which the geometry defines. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "format/hexex.h"
#include "stage/build.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

/* Blocks of the base complex as the reference has it; 0 where it has none. Its singular edges in *singular. */
static size_t reference_blocks(const json_t *all, const char *name, size_t *singular) {
    const json_t *entry = json_object_get(all, name);
    const json_t *bc = json_object_get(json_object_get(entry, "mc3d"), "base_complex");
    *singular = (size_t)json_integer_value(json_object_get(entry, "singular_edges"));
    return (size_t)json_integer_value(json_object_get(bc, "blocks"));
}

typedef struct {
    size_t blocks, singular;
    bw_status status;
    char message[480];
} outcome;

static outcome run(const char *path, bw_complex_kind kind) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_tet_mesh mesh = {0};
    bw_grid_map map = {0};
    bw_cells cells = {0};
    bw_complex complex = {0};
    bw_sanitize_report report = {0};
    bw_status status = bw_hexex_read(&ctx, path, &mesh);
    if (status == BW_OK) status = bw_sanitize(&ctx, &(bw_sanitize_options){.tolerance = 1e-4}, &mesh, &map, &report);
    if (status == BW_OK) status = bw_cells_init(&ctx, &cells, &mesh, &map);
    if (status == BW_OK) status = bw_trace(&ctx, &cells, kind, 200000);
    if (status == BW_OK) status = bw_cells_check(&ctx, &cells);
    if (status == BW_OK) status = bw_build_complex(&ctx, &cells, &(bw_build_options){.max_cells = 200000}, &complex);
    outcome result = {complex.block_count, report.singular_interior + report.singular_boundary, status, ""};
    snprintf(result.message, sizeof result.message, "%s", ctx.error.message);
    bw_complex_clear(&ctx, &complex);
    bw_cells_clear(&ctx, &cells);
    bw_grid_map_clear(&ctx, &map);
    bw_tet_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
    return result;
}

static void every_shared_input_has_the_reference_base_complex(void **state) {
    (void)state;
    const char *folder = kit_shared("data/tet");
    json_error_t error;
    json_t *root = json_load_file(kit_shared("data/reference.json"), 0, &error), *all = json_object_get(root, "tet");
    assert_non_null(all);
    size_t count, compared = 0;
    char **names = kit_names(folder, ".hexex", &count);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        char name[256], path[1024];
        size_t singular;
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        snprintf(name, sizeof name, "%.*s", (int)(strlen(names[i]) - strlen(".hexex")), names[i]);
        size_t known = reference_blocks(all, name, &singular);
        outcome mc = run(path, BW_COMPLEX_MC);
        if (mc.status != BW_OK) fail_msg("%s: %s", name, mc.message);
        assert_int_equal(mc.singular, singular);
        outcome serial = run(path, BW_COMPLEX_SERIAL);
        if (serial.status != BW_OK) fail_msg("%s, serial: %s", name, serial.message);
        assert_in_range(serial.blocks, 1, mc.blocks);
        outcome bc = run(path, BW_COMPLEX_BC);
        if (known) {
            if (bc.status != BW_OK || bc.blocks != known) fail_msg("%s: base complex %zu blocks, reference %zu (%s)", name, bc.blocks, known, bc.message);
            assert_in_range(mc.blocks, 1, bc.blocks);
            compared++;
        } else { /* the reference has none; ours either is valid or too large */
            assert_true(bc.status == BW_OK || bc.status == BW_E_LIMIT);
        }
        print_message("%-30s mc %4zu  serial %4zu  bc %4zu  reference bc %4zu\n", name, mc.blocks, serial.blocks, bc.blocks,
                      known);
    }
    assert_true(compared >= 20);
    kit_names_free(names, count);
    json_decref(root);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_shared_input_has_the_reference_base_complex)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
