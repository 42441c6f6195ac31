/* Real hexahedral meshes: base complex as published, traced and reduced complexes within the spread of tie-breaking or better, and every labelling of hexes is found to be one of
 * grids by a program of its own. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "blockwright.h"

/* The counts that are compared: a base complex is what the geometry says; of the others the largest that any tie-breaking gave. */
static const json_t *entry_of(json_t **root, const char *name) {
    json_error_t error;
    if (!*root) *root = json_load_file(kit_shared("data/reference.json"), 0, &error);
    if (!*root) fail_msg("reference.json: %s", error.text);
    return json_object_get(json_object_get(*root, "hex"), name);
}

static int64_t most(const json_t *entry, const char *name) {
    const json_t *value = json_object_get(entry, name);
    return json_integer_value(json_is_array(value) ? json_array_get(value, 1) : value);
}

/* Blocks after reduction, or as traced; *raw as traced. */
static int64_t run(const char *input, bw_complex_kind kind, bw_reduce_mode mode, int64_t *raw, double *t_share) {
    bw_context ctx;
    bw_options options;
    bw_context_init(&ctx);
    bw_options_defaults(&options);
    options.complex = kind, options.reduce = mode, options.hex_formats = 0;
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, kit_temp_path("hexes")));
    assert_int_equal(ctx.memory.used, 0);
    json_t *report = json_load_file(kit_temp_path("hexes/report.json"), 0, NULL);
    const json_t *complex = json_object_get(report, "complex"), *last = json_object_get(complex, mode == BW_REDUCE_NONE ? "raw" : "reduced");
    *raw = json_integer_value(json_object_get(json_object_get(complex, "raw"), "blocks"));
    *t_share = (double)json_integer_value(json_object_get(last, "t_arcs")) / (double)json_integer_value(json_object_get(last, "arcs"));
    int64_t blocks = json_integer_value(json_object_get(last, "blocks"));
    json_decref(report);
    return blocks;
}

static bool has_numpy(void) {
    kit_result r = kit_run((const char *[]){"/usr/bin/python3", "-c", "import numpy", NULL});
    bool good = r.exit == 0;
    kit_result_clear(&r);
    return good;
}

static void check_labels(const char *input) {
    char *script = strdup(kit_shared("tools/hex_blocks/check_blocks.py"));
    kit_result r = kit_run((const char *[]){"/usr/bin/python3", script, input, kit_temp_path("hexes/labels.txt"), "--walls", kit_temp_path("hexes/walls.txt"), NULL});
    if (r.exit) fail_msg("%s: exit %d: %s%s", input, r.exit, r.out, r.err);
    kit_result_clear(&r);
    free(script);
}

static void counts_and_labels_are_those_of_the_reference(void **state) {
    (void)state;
    static const struct {
        bw_complex_kind kind;
        bw_reduce_mode mode;
        const char *name;
    } variants[] = {{BW_COMPLEX_BC, BW_REDUCE_NONE, "base_complex"}, {BW_COMPLEX_MC, BW_REDUCE_NONE, "raw"}, {BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR, "mc_plus"},
                    {BW_COMPLEX_MC, BW_REDUCE_FULL, "mc"}};
    size_t count;
    json_t *root = NULL;
    bool numpy = has_numpy();
    char **names = kit_names(kit_shared("data/hex"), ".mesh", &count);
    for (size_t i = 0; i < count; i++) {
        char *input = strdup(kit_shared("data/hex")), path[4200], name[100];
        snprintf(path, sizeof path, "%s/%s", input, names[i]);
        snprintf(name, sizeof name, "%.*s", (int)strlen(names[i]) - 5, names[i]);
        const json_t *entry = entry_of(&root, name);
        if (!entry) fail_msg("no reference for %s", name);
        for (size_t v = 0; v < sizeof variants / sizeof *variants; v++) {
            int64_t raw, blocks, wanted = most(entry, variants[v].name);
            double share;
            blocks = run(path, variants[v].kind, variants[v].mode, &raw, &share);
            if (v == 0 ? blocks != wanted : blocks > wanted) fail_msg("%s, %s: %lld blocks, not %lld", name, variants[v].name, (long long)blocks, (long long)wanted);
            const json_t *published = json_object_get(json_object_get(entry, "paper_mc_table1"), "t_arc_share");
            if (published && v == 2) assert_true(share - json_number_value(published) < 0.005 && json_number_value(published) - share < 0.005);
            if (numpy) check_labels(path);
        }
        free(input);
    }
    assert_int_equal(count, 4);
    json_decref(root);
    kit_names_free(names, count);
    if (!numpy) kit_skip("counts were compared, labels not: %s", "no python3-numpy");
}

static const struct CMUnitTest tests[] = {cmocka_unit_test(counts_and_labels_are_those_of_the_reference)};
KIT_MAIN(tests)
