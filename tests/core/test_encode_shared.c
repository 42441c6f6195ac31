/* Real inputs: their traced meshes pass the exact check, with as many blocks as the complex has. */
#include "core/encode_kit.h"

#include "core/traced_check.h"
#include "format/hexex.h"

static void encode_file(encoded *e, const char *path, bw_complex_kind kind) {
    bw_sanitize_report report;
    memset(e, 0, sizeof *e);
    bw_context_init(&e->ctx);
    kit_expect_ok(&e->ctx, bw_hexex_read(&e->ctx, path, &e->mesh));
    kit_expect_ok(&e->ctx, bw_sanitize(&e->ctx, &(bw_sanitize_options){.tolerance = 1e-3}, &e->mesh, &e->map, &report));
    encode_trace_and_build(e, kind);
    e->folder = kit_temp_path("shared");
    encode_run(e);
}

static void expect_exact(const char *name, bw_complex_kind kind) {
    encoded e;
    traced_verdict v;
    size_t size;
    encode_file(&e, kit_shared(name), kind);
    char *text = encode_read(&e, "traced.hexex", &size);
    if (!traced_check(text, true, &v)) fail_msg("traced.hexex of %s cannot be read", name);
    free(text);
    traced_print(name, &v);
    assert_int_equal(traced_faults(&v), 0);
    assert_int_equal(v.blocks, e.complex.block_count);
    encode_clear(&e);
}

static void walls_that_follow_facets_give_exact_blocks(void **state) {
    (void)state;
    expect_exact("data/tet/hm_s07c_notch.hexex", BW_COMPLEX_MC);
}

static void walls_that_cut_tets_give_exact_blocks(void **state) {
    (void)state;
    expect_exact("data/tet/mm2012_SRF_fandisk.hexex", BW_COMPLEX_MC);
    expect_exact("data/tet/mm2012_SRF_fandisk.hexex", BW_COMPLEX_BC);
}

/* 11 472 tets, 26 000 wall polygons: nearly every cell can be coned from one of its own vertices. */
static void a_heavily_cut_model_stays_small(void **state) {
    (void)state;
    encoded e;
    encode_file(&e, kit_shared("data/tet/hand.hexex"), BW_COMPLEX_MC);
    assert_true(e.report.quality.traced_tets < 4 * e.cells.cell_count);
    assert_true(e.report.quality.traced_vertices - e.cells.vertex_count < e.cells.cell_count / 100);
    assert_true(e.report.result[0].bytes < (uint64_t)50 << 20);
    encode_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(walls_that_follow_facets_give_exact_blocks),
        cmocka_unit_test(walls_that_cut_tets_give_exact_blocks),
        cmocka_unit_test(a_heavily_cut_model_stays_small),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
