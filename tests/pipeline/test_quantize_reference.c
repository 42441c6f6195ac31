/* Quantizations of real inputs: at the coarsest no more hexes than published (paper Q, Tables 1, 3 and 4), proven optimal at five sizes.
 * Reads data beside the checkout; skipped if it is not there. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "blockwright.h"
#include "format/state.h"

typedef struct {
    const char *name;
    uint64_t hexes[3]; /* published: positive, nonnegative, any; 0: none */
    uint64_t later;    /* measured with a later method of the same authors (negative lengths allowed); 0: not */
} reference;

static const reference references[] = {
    {"scf_sphere", {7, 7, 7}, 0},
    {"scf_fanpart", {5, 5, 5}, 0},
    {"scf_prisma", {3, 3, 3}, 0},
    {"mm2012_SRF_ellipsoid-B", {7, 7, 7}, 0},
    {"mm2012_SRF_fandisk", {80, 30, 30}, 45},
    {"mm2016_PCS_femur_polycube_out", {43, 34, 25}, 0},
    {"mm2017_ECM_cylinder_grid", {1, 1, 1}, 0},
    {"mm2017_ECM_femur_shell0", {11, 8, 8}, 0},
    {"mm2017_ECM_femur_shell1", {190, 19, 20}, 18},
    {"mm2019_DSM_double-torus", {7, 7, 7}, 5},
    {"mm2019_DSM_fandisk", {161, 53, 62}, 60},
    {"mm2019_DSM_hanger", {50, 41, 41}, 0},
    {"mm2019_SP_Wrench", {122, 41, 35}, 0},
    {"mm2019_SP_Chamfer_L4", {26, 7, 7}, 8},
    {"hand", {0, 0, 0}, 112},
    {"hand_q", {0, 0, 0}, 112},
    {"hm_n06u_anti_pentapyr", {0, 0, 0}, 107},
    {"hm_n08c_pentapyr", {0, 0, 0}, 74},
    {"hm_s15c_cylinder", {0, 0, 0}, 5},
    {"hm_s06c_dodecahedron", {0, 0, 0}, 0},
    {"hm_n12c_limit_cycle_genus0", {0, 0, 0}, 0},
};

/* The state after stage reduce; `json`: its options. */
static const char *reduced(const char *folder, const char *name, const char *ending, const char *json) {
    char input[1000];
    const char *from = input;
    snprintf(input, sizeof input, "%s/data/%s/%s.%s", BW_SHARED_DIR, folder, name, ending);
    if (access(input, R_OK)) return NULL;
    for (int s = 0; s <= BW_STAGE_REDUCE; s++) {
        bw_context ctx;
        bw_options options;
        const char *to = kit_temp_path("state.%d", s);
        bw_context_init(&ctx);
        bw_options_defaults(&options);
        kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
        kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, (bw_stage)s, from, to));
        from = to;
    }
    return from;
}

static bw_report *quantize(const char *state, const char *json) {
    bw_context ctx;
    bw_options options;
    bw_state *found = calloc(1, sizeof *found);
    bw_report *report = malloc(sizeof *report);
    const char *to = kit_temp_path("quantized.state");
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    kit_expect_ok(&ctx, bw_options_from_json(&ctx, &options, json, strlen(json)));
    kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, BW_STAGE_QUANTIZE, state, to));
    bw_state_init(found);
    kit_expect_ok(&ctx, bw_state_read(&ctx, found, "quantize", bw_stage_version(BW_STAGE_QUANTIZE), to));
    *report = found->report;
    assert_non_null(found->length);
    bw_state_clear(&ctx, found);
    free(found);
    return report;
}

static const char *const ranges[] = {"positive", "nonnegative", "any"};

/* The coarsest by both objectives: squared lengths, as the paper's, and hexes. No more hexes than published by the better of them. */
static void expect_coarse(const reference *r, const char *state) {
    for (int k = 0; k < 3; k++) {
        char json[200], published[24] = "-", later[24] = "-";
        snprintf(json, sizeof json, "{\"quantize\": \"%s\", \"scale\": 0, \"time_limit\": 120}", ranges[k]);
        bw_report *report = quantize(state, json);
        uint64_t coarsest = report->quantization.hexes;
        assert_string_equal(report->quantization.status, "optimal");
        free(report);
        snprintf(json, sizeof json, "{\"quantize\": \"%s\", \"fewest_hexes\": true, \"time_limit\": 2}", ranges[k]);
        report = quantize(state, json);
        uint64_t fewest = report->quantization.hexes;
        if (r->hexes[k]) snprintf(published, sizeof published, "%llu", (unsigned long long)r->hexes[k]);
        if (r->later && k == 2) snprintf(later, sizeof later, "%llu", (unsigned long long)r->later);
        print_message("%-30s %-12s %8llu %8llu %-10s %9s %6s\n", r->name, ranges[k], (unsigned long long)coarsest, (unsigned long long)fewest,
                      report->quantization.status, published, later);
        free(report);
        assert_true(fewest <= coarsest);
        if ((r->hexes[k] && fewest > r->hexes[k]) || (r->later && k == 2 && fewest > r->later)) fail_msg("more hexes than published");
    }
}

static void expect_optimal_sizes(const reference *r, const char *state) {
    bw_report *report[3];
    for (int k = 0; k < 3; k++) {
        char json[200];
        snprintf(json, sizeof json, "{\"quantize\": \"%s\", \"scales\": [0.25, 0.5, 1, 2], \"scale\": 4, \"time_limit\": 120}", ranges[k]);
        report[k] = quantize(state, json);
        assert_string_equal(report[k]->quantization.status, "optimal");
        assert_int_equal(report[k]->sweep_count, 4);
        for (size_t i = 0; i < 4; i++) {
            const bw_report_sweep *row = &report[k]->sweep[i];
            assert_string_equal(row->status, "optimal");
            double slack = 1e-6 * (1 + row->objective);
            if (k && row->objective > report[k - 1]->sweep[i].objective + slack)
                fail_msg("%s at %g: %s is worse than %s", r->name, row->scale, ranges[k], ranges[k - 1]);
        }
    }
    for (int k = 0; k < 3; k++) free(report[k]);
}

static void real_inputs_are_quantized_as_coarsely_as_published(void **state) {
    (void)state;
    print_message("%-30s %-12s %8s %8s %-10s %9s %6s\n", "hexes at the coarsest", "", "lengths", "fewest", "", "published", "later");
    for (size_t i = 0; i < sizeof references / sizeof *references; i++) {
        const char *file = reduced("tet", references[i].name, "hexex", "{}");
        if (!file) skip();
        expect_coarse(&references[i], file);
        expect_optimal_sizes(&references[i], file);
    }
}

/* Q Table 3: base complexes of hex meshes, simplified by the coarsest quantization. */
static void base_complexes_of_hex_meshes_become_as_simple_as_published(void **state) {
    (void)state;
    static const reference impeller = {"impeller_stresstest_out", {0, 0, 224}, 0};
    const char *file = reduced("hex", impeller.name, "mesh", "{}");
    if (!file) skip();
    expect_coarse(&impeller, file);
    bw_report *report = quantize(file, "{\"quantize\": \"any\", \"scale\": 0}");
    assert_true(report->has_base_planned);
    print_message("%s: %llu blocks\n", impeller.name, (unsigned long long)report->base_complex.planned.blocks);
    assert_true(report->base_complex.planned.blocks <= impeller.hexes[2]);
    free(report);
}

/* Fully reduced, its blocks slide past each other in circles: what lies beside one of them is never reached. */
static void walls_that_spiral_are_left_to_the_narrower_range(void **state) {
    (void)state;
    const char *file = reduced("tet", "hm_n06u_anti_pentapyr", "hexex", "{\"reduce\": \"full\"}");
    if (!file) skip();
    bw_report *report = quantize(file, "{\"quantize\": \"any\", \"scale\": 0}");
    assert_string_equal(report->quantization.fallback, "nonnegative");
    assert_true(report->quantization.verified);
    free(report);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(walls_that_spiral_are_left_to_the_narrower_range),
                                       cmocka_unit_test(real_inputs_are_quantized_as_coarsely_as_published),
                                       cmocka_unit_test(base_complexes_of_hex_meshes_become_as_simple_as_published)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
