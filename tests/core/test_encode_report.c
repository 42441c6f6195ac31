/* A report survives the trip through JSON, whole or in part; anything else is refused. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/report_json.h"

static void fill_region(bw_region *region, int i) {
    region->tet_count = (size_t)(3 * i + 1);
    for (size_t k = 0; k < region->tet_count && k < BW_REGION_TETS; k++) region->tets[k] = 100 * i + (int64_t)k;
    for (int k = 0; k < 3; k++) region->centre[k] = i + 0.1 * k, region->low[k] = i - 0.3, region->high[k] = i + 1.0 / 3;
}

/* Every byte of every section set to something that JSON can carry. */
static void fill(bw_report *r) {
    bw_report_init(r);
    r->has_input = r->has_sanitize = r->has_trace = r->has_complex = r->has_quality = true;
    snprintf(r->input.file, sizeof r->input.file, "part \"7\" \xc3\xa9.hexex");
    uint64_t *count = &r->input.bytes, n = 1;
    for (; count <= &r->input.feature_facets; count++) *count = n++;
    r->input.mirrored = r->sanitize.already_exact = true;
    r->sanitize.displacement_max = 1.0 / 3;
    r->sanitize.residual_seamless_max = 5e-324;
    r->sanitize.residual_alignment_max = 1e300;
    for (count = &r->sanitize.cut_facets; count <= &r->sanitize.free_variables; count++) *count = n++;
    r->sanitize.grid_exponent = -3;
    r->has_repaired = true;
    for (count = &r->sanitize.repaired.regions; count <= &r->sanitize.repaired.rings; count++) *count = n++;
    r->sanitize.repaired.displacement_max = 0.1;
    for (int i = 0; i < BW_REGIONS_KEPT; i++) fill_region(&r->sanitize.repaired.places[i], i);
    r->sanitize.repaired.regions = 40;
    for (count = &r->trace.vertices; count <= &r->trace.boundary_polygons; count++) *count = n++;
    snprintf(r->complex.kind, sizeof r->complex.kind, "bc");
    for (count = &r->complex.raw.nodes; count <= &r->complex.raw.self_adjacent_patches; count++) *count = n++;
    r->quality.block_extent = (bw_report_range){0.1, 0.2, 0.7};
    r->quality.block_aspect = (bw_report_range){1, 2, 3};
    r->quality.block_volume = (bw_report_range){1e-30, 2, 3e30};
    r->quality.volume = 123.456;
    for (count = &r->quality.traced_vertices; count <= &r->quality.traced_walls; count++) *count = n++;
    bw_report_add_stage(r, "sanitize", 0.125, (uint64_t)1 << 40);
    bw_report_add_stage(r, "trace", 1e-7, 0);
    bw_report_add_result(r, "traced.hexex", 1);
    bw_report_add_result(r, "view.drc", (uint64_t)1 << 50);
}

static void expect_round_trip(const bw_report *report) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_report back;
    char *text = bw_report_to_json(report);
    assert_non_null(text);
    kit_expect_ok(&ctx, bw_report_from_json(&ctx, text, strlen(text), &back));
    assert_memory_equal(&back, report, sizeof back);
    char *again = bw_report_to_json(&back);
    assert_string_equal(again, text);
    free(text), free(again);
}

static void a_full_report_comes_back_as_it_was(void **state) {
    (void)state;
    bw_report report;
    fill(&report);
    expect_round_trip(&report);
}

static void a_report_without_sections_stays_without_them(void **state) {
    (void)state;
    for (int section = 0; section < 6; section++) {
        bw_report report, whole;
        fill(&whole);
        bw_report_init(&report);
        if (section == 1) report.has_input = true, report.input = whole.input;
        if (section == 2) report.has_sanitize = report.has_repaired = true, report.sanitize = whole.sanitize;
        if (section == 3) report.has_trace = true, report.trace = whole.trace;
        if (section == 4) report.has_complex = true, report.complex = whole.complex;
        if (section == 5) report.has_quality = true, report.quality = whole.quality;
        expect_round_trip(&report);
    }
}

static void a_failure_comes_back_with_its_elements(void **state) {
    (void)state;
    for (int elements = 0; elements <= 40; elements += 20) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_report report;
        bw_report_init(&report);
        bw_fail(&ctx, BW_E_NOT_SEAMLESS, "%d facets\nare \"off\"", elements);
        for (int i = 0; i < elements; i++) bw_fail_element(&ctx, "facet", i, (double[3]){i, 0.1 * i, -1});
        report.error = ctx.error;
        expect_round_trip(&report);
        char *text = bw_report_error_json(&ctx.error);
        assert_non_null(strstr(text, "\"class\":\"input\""));
        assert_non_null(strstr(text, "\"status\":\"not-seamless\""));
        free(text);
    }
}

static void a_failure_comes_back_with_its_regions(void **state) {
    (void)state;
    for (int regions = 1; regions <= 40; regions += 13) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_report report;
        bw_report_init(&report);
        for (int i = 0; i < regions; i++) {
            bw_region region = {0};
            fill_region(&region, i);
            bw_fail_region(&ctx, &region);
        }
        bw_fail(&ctx, BW_E_INVERTED, "%d regions", regions);
        assert_int_equal(ctx.error.region_count, regions);
        report.error = ctx.error;
        expect_round_trip(&report);
    }
}

static void text_that_is_no_report_is_refused(void **state) {
    (void)state;
    bw_report report;
    fill(&report);
    char *good = bw_report_to_json(&report);
    size_t length = strlen(good);
    for (int damage = 0; damage < 6; damage++) {
        char *text = strdup(good), *at;
        size_t n = length;
        if (damage == 0) n = 0;
        if (damage == 1) n = length / 2;
        if (damage == 2) memcpy(strstr(text, "blockwright-report"), "blockwright-rapport", 18);
        if (damage == 3) at = strstr(text, "\"report_version\": 1") + 18, *at = '9';
        if (damage == 4) at = strstr(text, "\"cells\""), at[1] = 'b'; /* a member that is missing */
        if (damage == 5)
            at = strstr(text, "\"torus_splits\": ") + 16, memcpy(at, "[]", 2); /* one of another type */
        bw_context ctx;
        bw_context_init(&ctx);
        bw_report back;
        kit_expect_status(&ctx, bw_report_from_json(&ctx, text, n, &back), BW_E_VERSION);
        assert_false(back.has_input);
        free(text);
    }
    free(good);
}

static void what_has_no_room_is_dropped_and_names_are_cut(void **state) {
    (void)state;
    bw_report report;
    bw_report_init(&report);
    for (int i = 0; i < 2 * BW_REPORT_STAGES; i++)
        bw_report_add_stage(&report, "a stage with a very long name indeed", i, 0);
    assert_int_equal(report.stage_count, BW_REPORT_STAGES);
    for (int i = 0; i < 2 * BW_REPORT_RESULTS; i++) {
        char name[20];
        snprintf(name, sizeof name, "%d", i);
        bw_report_add_result(&report, name, 1);
    }
    assert_int_equal(report.result_count, BW_REPORT_RESULTS);
    bw_report_add_result(&report, "3", 77);
    assert_int_equal(report.result_count, BW_REPORT_RESULTS);
    assert_int_equal(report.result[3].bytes, 77);
    expect_round_trip(&report);
}

/* A file name can be any bytes; messages and names are cut, maybe in the middle of a letter. */
static void text_that_is_not_utf8_is_kept_as_far_as_it_is(void **state) {
    (void)state;
    static const struct {
        const char *bytes, *kept;
    } cases[] = {{"\xff\xfe.hexex", "??.hexex"},
                 {"caf\xc3\xa9.hexex", "caf\xc3\xa9.hexex"},
                 {"caf\xc3", "caf?"},
                 {"\xc0\xaf \xe0\x80\xaf", "?? ???"},
                 {"\xed\xa0\x80\xed\x9f\xbf", "???\xed\x9f\xbf"},
                 {"\xf4\x90\x80\x80\xf0\x9f\x98\x80", "????\xf0\x9f\x98\x80"},
                 {"\xf0\x9f\x98", "???"}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bw_report report, back;
        bw_context ctx;
        bw_context_init(&ctx);
        fill(&report);
        snprintf(report.input.file, sizeof report.input.file, "%s", cases[i].bytes);
        snprintf(report.stage[0].name, sizeof report.stage[0].name, "%s", cases[i].bytes);
        snprintf(report.result[1].name, sizeof report.result[1].name, "%s", cases[i].bytes);
        report.error.status = BW_E_IO;
        snprintf(report.error.message, sizeof report.error.message, "%s", cases[i].bytes);
        char *text = bw_report_to_json(&report);
        assert_non_null(text);
        kit_expect_ok(&ctx, bw_report_from_json(&ctx, text, strlen(text), &back));
        assert_string_equal(back.input.file, cases[i].kept);
        assert_int_equal(back.stage_count, report.stage_count);
        assert_string_equal(back.stage[0].name, cases[i].kept);
        assert_int_equal(back.result_count, report.result_count);
        assert_string_equal(back.result[1].name, cases[i].kept);
        assert_string_equal(back.error.message, cases[i].kept);
        free(text);
    }
}

static void a_report_is_written_even_when_the_job_failed(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_report report, back;
    fill(&report);
    bw_fail(&ctx, BW_E_LIMIT, "too much work");
    report.error = ctx.error;
    const char *path = kit_temp_path("report.json");
    assert_int_equal(bw_report_write(&ctx, &report, path), BW_OK);
    size_t size;
    char *text = kit_read_file(path, &size);
    bw_context fresh;
    bw_context_init(&fresh);
    kit_expect_ok(&fresh, bw_report_from_json(&fresh, text, size, &back));
    assert_int_equal(back.error.status, BW_E_LIMIT);
    assert_string_equal(back.error.message, "too much work");
    free(text);
    kit_expect_status(&fresh, bw_report_write(&fresh, &report, kit_temp_path("no/report.json")), BW_E_IO);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_full_report_comes_back_as_it_was),
        cmocka_unit_test(a_report_without_sections_stays_without_them),
        cmocka_unit_test(a_failure_comes_back_with_its_elements),
        cmocka_unit_test(a_failure_comes_back_with_its_regions),
        cmocka_unit_test(text_that_is_no_report_is_refused),
        cmocka_unit_test(what_has_no_room_is_dropped_and_names_are_cut),
        cmocka_unit_test(text_that_is_not_utf8_is_kept_as_far_as_it_is),
        cmocka_unit_test(a_report_is_written_even_when_the_job_failed),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
