/* Real inputs: every one passes all stages and their checks, has the reference's base complex, which the geometry defines, and no more blocks than
 * the reference leaves after reduction. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "format/hexex.h"
#include "stage/build.h"
#include "stage/reduce.h"
#include "stage/sanitize.h"
#include "stage/trace.h"

/* Blocks as the reference has them, 0 where it has none: of the complex after tracing, after reduction, and of the base complex. */
typedef struct {
    size_t raw, reduced, base, singular;
} reference;

static reference reference_of(const json_t *all, const char *name) {
    const json_t *entry = json_object_get(all, name), *mc3d = json_object_get(entry, "mc3d");
    return (reference){(size_t)json_integer_value(json_object_get(json_object_get(mc3d, "raw"), "blocks")),
                       (size_t)json_integer_value(json_object_get(json_object_get(mc3d, "mc_plus"), "blocks")),
                       (size_t)json_integer_value(json_object_get(json_object_get(mc3d, "base_complex"), "blocks")),
                       (size_t)json_integer_value(json_object_get(entry, "singular_edges"))};
}

typedef struct {
    size_t blocks, reduced, singular;
    bw_status status;
    char message[480];
} outcome;

static outcome run(const char *path, bw_complex_kind kind, bw_reduce_mode mode) {
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
    size_t blocks = complex.block_count;
    bw_reduce_report reduced = {0};
    if (status == BW_OK) status = bw_reduce(&ctx, &cells, &complex, &(bw_reduce_options){.mode = mode, .effort = 1}, &reduced);
    outcome result = {blocks, reduced.blocks, report.singular_interior + report.singular_boundary, status, ""};
    snprintf(result.message, sizeof result.message, "%s", ctx.error.message);
    bw_complex_clear(&ctx, &complex);
    bw_cells_clear(&ctx, &cells);
    bw_grid_map_clear(&ctx, &map);
    bw_tet_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
    return result;
}

static void shared_inputs_have_the_reference_base_complex_and_no_more_blocks(void **state) {
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
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        snprintf(name, sizeof name, "%.*s", (int)(strlen(names[i]) - strlen(".hexex")), names[i]);
        reference known = reference_of(all, name);
        outcome mc = run(path, BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR), full = run(path, BW_COMPLEX_MC, BW_REDUCE_FULL);
        if (mc.status != BW_OK) fail_msg("%s: %s", name, mc.message);
        if (full.status != BW_OK) fail_msg("%s, fully reduced: %s", name, full.message);
        assert_int_equal(mc.singular, known.singular);
        assert_in_range(full.reduced, 1, mc.reduced);
        if (known.reduced) assert_in_range(mc.reduced, 1, known.reduced);
        outcome serial = run(path, BW_COMPLEX_SERIAL, BW_REDUCE_KEEP_SINGULAR);
        if (serial.status != BW_OK) fail_msg("%s, serial: %s", name, serial.message);
        assert_in_range(serial.blocks, 1, mc.blocks);
        outcome bc = run(path, BW_COMPLEX_BC, BW_REDUCE_FULL);
        if (known.base) {
            if (bc.status != BW_OK || bc.blocks != known.base)
                fail_msg("%s: base complex %zu blocks, reference %zu (%s)", name, bc.blocks, known.base, bc.message);
            assert_in_range(mc.blocks, 1, bc.blocks);
            compared++;
        } else { /* the reference has none; ours either is valid or too large */
            assert_true(bc.status == BW_OK || bc.status == BW_E_LIMIT);
        }
        print_message("%-30s raw %3zu (%3zu)  mc+ %3zu (%3zu)  mc %3zu  bc %4zu (%3zu)  bc- %3zu  serial %3zu, %3zu\n", name, mc.blocks, known.raw,
                      mc.reduced, known.reduced, full.reduced, bc.blocks, known.base, bc.reduced, serial.blocks, serial.reduced);
    }
    assert_true(compared >= 20);
    kit_names_free(names, count);
    json_decref(root);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(shared_inputs_have_the_reference_base_complex_and_no_more_blocks)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
