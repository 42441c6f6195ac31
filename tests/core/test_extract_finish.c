/* Second part of stage extract: hex meshes of integer-grid maps are optimized, measured, reported (stage/extract_finish.h). */
#include "core/extract_kit.h"

#include <stdio.h>

#include "hex/smooth.h"
#include "stage/extract_finish.h"

static void finish(extractable *x, bool smooth, bw_report *report) {
    bw_report_init(report);
    kit_expect_ok(&x->ctx, bw_extract_finish(&x->ctx, &x->igm.mesh, x->igm.map.edge_flags, smooth, &x->mesh, report));
    assert_true(report->has_hex_quality);
    assert_int_equal(report->has_smoothing, smooth);
}

static void expect_round_trip(extractable *x, const bw_report *report) {
    bw_report back;
    char *text = bw_report_to_json(report);
    assert_non_null(text);
    kit_expect_ok(&x->ctx, bw_report_from_json(&x->ctx, text, strlen(text), &back));
    assert_memory_equal(&back, report, sizeof back);
    free(text);
}

static void extracted_meshes_become_positive(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++) {
        extractable x;
        bw_report before, after;
        extractable_open(&x, models[i].name, 2, 0.7, (int)(i % 2), i);
        extractable_extract(&x, i % 3 ? 1 : 2);
        finish(&x, false, &before);
        finish(&x, true, &after);
        const bw_hex_quality *a = &before.hex_quality.mesh, *b = &after.hex_quality.mesh;
        printf("%-14s %6llu hexes, %llu not positive, scaled Jacobian %.3f / %.3f; then %llu, %.3f / %.3f; off by %.2g %%\n", models[i].name, (unsigned long long)a->hexes,
               (unsigned long long)a->nonpositive, a->scaled_jacobian.min, a->scaled_jacobian.mean, (unsigned long long)b->nonpositive, b->scaled_jacobian.min,
               b->scaled_jacobian.mean, 100 * after.hex_quality.hausdorff_relative);
        assert_int_equal(b->nonpositive, 0);
        assert_int_equal(after.hex_quality.smoothing.nonpositive_before, a->nonpositive);
        assert_true(b->scaled_jacobian.mean + 2 * fmin(b->scaled_jacobian.min, 0.2) >= a->scaled_jacobian.mean + 2 * fmin(a->scaled_jacobian.min, 0.2) - 1e-12);
        assert_true(b->histogram[0] + b->histogram[BW_HEX_BINS - 1] <= b->hexes && b->volume > 0);
        kit_expect_ok(&x.ctx, bw_hex_mesh_check(&x.ctx, &x.mesh));
        expect_round_trip(&x, &before);
        expect_round_trip(&x, &after);
        extractable_close(&x);
    }
}

static void shared_integer_grid_maps_give_positive_meshes(void **state) {
    (void)state;
    static const char *const files[] = {"data/tet/hand_q.hexex"};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        extractable x;
        bw_report report;
        extractable_open_file(&x, kit_shared(files[i]));
        extractable_extract(&x, 1);
        finish(&x, true, &report);
        printf("%s: %llu hexes not positive of %llu, then %llu\n", x.name, (unsigned long long)report.hex_quality.smoothing.nonpositive_before,
               (unsigned long long)report.hex_quality.mesh.hexes, (unsigned long long)report.hex_quality.mesh.nonpositive);
        assert_int_equal(report.hex_quality.mesh.nonpositive, 0);
        extractable_close(&x);
    }
}

typedef struct {
    extractable *x;
    const double (*start)[3];
} attempt;

static bw_status finish_again(bw_context *ctx, void *user) {
    attempt *a = user;
    bw_report report;
    bw_hex_mesh *m = &a->x->mesh;
    size_t bytes = m->vertex_count * sizeof *m->position;
    memcpy(m->position, a->start, bytes);
    bw_report_init(&report);
    bw_status status = bw_extract_finish(ctx, &a->x->igm.mesh, a->x->igm.map.edge_flags, true, m, &report);
    assert_int_equal(report.has_hex_quality, status == BW_OK);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    extractable x;
    extractable_open(&x, "l-shape", 1, 0.5, 0, 1);
    extractable_extract(&x, 1);
    size_t bytes = x.mesh.vertex_count * sizeof *x.mesh.position;
    double(*start)[3] = malloc(bytes);
    memcpy(start, x.mesh.position, bytes);
    assert_true(kit_fail_each_allocation(finish_again, &(attempt){&x, (const double(*)[3])start}) > 50);
    free(start);
    extractable_close(&x);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(extracted_meshes_become_positive),
    cmocka_unit_test(shared_integer_grid_maps_give_positive_meshes),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
