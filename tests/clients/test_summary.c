/* The summary of a result shows the counts of its report: of the complex as traced, and of the reduced one.
 */
#include "kit/kit.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void run_blockwright(const char *const *arguments, kit_result *result) {
    const char *argv[16] = {kit_program("blockwright")};
    for (size_t i = 0; arguments[i]; i++) argv[i + 1] = arguments[i];
    *result = kit_run(argv);
    if (result->exit) print_message("%s", result->err);
    assert_int_equal(result->exit, 0);
}

static const char *sample(void) {
    const char *path = kit_temp_path("plate.hexex");
    kit_result result;
    run_blockwright((const char *[]){"sample", "plate", "--size", "1", "-o", path, NULL}, &result);
    kit_result_clear(&result);
    return path;
}

/* What `show` prints of a run with these options; free() it. */
static char *shown(const char *folder, const char *reduce, const char *complex) {
    kit_result result;
    run_blockwright((const char *[]){"run", sample(), "--out", folder, "--reduce", reduce, "--complex",
                                     complex, "--quiet", NULL},
                    &result);
    kit_result_clear(&result);
    run_blockwright((const char *[]){"show", folder, NULL}, &result);
    char *out = strdup(result.out);
    kit_result_clear(&result);
    return out;
}

static json_int_t count_of(const char *folder, const char *name, const char *what) {
    char path[1024];
    json_error_t error;
    snprintf(path, sizeof path, "%s/report.json", folder);
    json_t *root = json_load_file(path, 0, &error);
    assert_non_null(root);
    const json_t *value = json_object_get(json_object_get(json_object_get(root, "complex"), name), what);
    json_int_t count = json_is_integer(value) ? json_integer_value(value) : -1;
    json_decref(root);
    return count;
}

/* The line that starts with `label` ("" if there is none) begins with this many blocks and has this many
 * patches. */
static void expect_line(const char *text, const char *label, json_int_t blocks, json_int_t patches) {
    const char *line = strstr(text, label);
    char expected[64], rest[256];
    if (!line) fail_msg("no line '%s' in:\n%s", label, text);
    snprintf(rest, sizeof rest, "%.*s", (int)strcspn(line, "\n"), line);
    snprintf(expected, sizeof expected, "%-15s %lld blocks, %lld patches, ", label, (long long)blocks,
             (long long)patches);
    if (strncmp(rest, expected, strlen(expected)) != 0)
        fail_msg("'%s' does not begin with '%s'", rest, expected);
}

static void raw_and_reduced_counts_are_shown(void **state) {
    (void)state;
    static const char *const modes[] = {"keep-singular", "full"}, *const complexes[] = {"mc", "bc", "serial"};
    for (int i = 0; i < 3; i++) {
        char label[32];
        const char *folder = kit_temp_path("reduced-%d", i);
        char *text = shown(folder, modes[i % 2], complexes[i]);
        snprintf(label, sizeof label, "%s, raw", complexes[i]);
        expect_line(text, label, count_of(folder, "raw", "blocks"), count_of(folder, "raw", "patches"));
        snprintf(label, sizeof label, "%s, reduced", complexes[i]);
        expect_line(text, label, count_of(folder, "reduced", "blocks"),
                    count_of(folder, "reduced", "patches"));
        snprintf(label, sizeof label, "%-15s %s, effort 1 (", "reduction", modes[i % 2]);
        assert_non_null(strstr(text, label));
        free(text);
    }
}

static void without_reduction_nothing_is_said_of_it(void **state) {
    (void)state;
    const char *folder = kit_temp_path("none");
    char *text = shown(folder, "none", "mc");
    expect_line(text, "mc, raw", count_of(folder, "raw", "blocks"), count_of(folder, "raw", "patches"));
    assert_null(strstr(text, "reduced"));
    assert_null(strstr(text, "reduction"));
    free(text);
}

static void a_repair_is_shown(void **state) {
    (void)state;
    const char *path = kit_temp_path("folded.hexex"), *folder = kit_temp_path("repaired");
    kit_result result;
    run_blockwright((const char *[]){"sample", "plate", "--size", "2", "--folds", "3", "-o", path, NULL}, &result);
    kit_result_clear(&result);
    result = kit_run((const char *[]){kit_program("blockwright"), "run", path, "--out", folder, "--quiet", NULL});
    assert_int_equal(result.exit, 3);
    assert_non_null(strstr(result.err, "[inverted]\n  "));
    assert_non_null(strstr(result.err, " tets around ("));
    kit_result_clear(&result);
    run_blockwright((const char *[]){"run", path, "--repair", "--out", folder, "--until", "sanitize", "--quiet", NULL}, &result);
    kit_result_clear(&result);
    run_blockwright((const char *[]){"show", folder, NULL}, &result);
    const char *line = strstr(result.out, "repaired  ");
    assert_non_null(line);
    unsigned regions = 0, tets = 0, moved = 0;
    assert_int_equal(sscanf(line, "repaired %u %*[a-z], %u inverted or degenerate %*[a-z], %u %*[a-z] moved", &regions, &tets, &moved), 3);
    assert_true(regions >= 1 && tets >= regions && moved >= 1);
    kit_result_clear(&result);
}

static char *show(const char *folder) {
    kit_result result;
    run_blockwright((const char *[]){"show", folder, NULL}, &result);
    char *out = strdup(result.out);
    kit_result_clear(&result);
    return out;
}

static void expect_text(const char *text, const char *part) {
    if (!strstr(text, part)) fail_msg("no '%s' in:\n%s", part, text);
}

/* A row for each size, without a distortion where there is no scale; what was given up or not proven is said. */
static void a_quantization_is_shown_with_its_table_of_sizes(void **state) {
    (void)state;
    kit_result result;
    const char *folder = kit_temp_path("quantized"), *path = kit_temp_path("quantized/report.json");
    run_blockwright((const char *[]){"run", sample(), "--out", folder, "--quantize", "any", "--scales", "0,2", "--coarsest", "--quiet", NULL}, &result);
    kit_result_clear(&result);
    char *text = show(folder);
    expect_text(text, "any lengths, ");
    expect_text(text, "scale      hexes    objective        bound   zeros negatives  distortion  status\n");
    json_t *root = json_load_file(path, 0, NULL), *found = json_object_get(root, "quantization"), *sweep = json_object_get(found, "sweep");
    assert_int_equal(json_array_size(sweep), 2);
    for (size_t i = 0; i < 3; i++) {
        const json_t *row = i < 2 ? json_array_get(sweep, i) : found;
        double scale = json_number_value(json_object_get(row, "scale"));
        char line[120], distortion[24] = "-";
        if (scale > 0) snprintf(distortion, sizeof distortion, "%.3f", json_number_value(json_object_get(row, "distortion")));
        snprintf(line, sizeof line, "%-15s %8.4g %10lld ", i < 2 ? "sweep" : "lengths", scale, (long long)json_integer_value(json_object_get(row, "hexes")));
        expect_text(text, line);
        snprintf(line, sizeof line, " %11s  optimal\n", distortion);
        expect_text(strstr(text, i < 2 ? "sweep" : "lengths  "), line);
    }
    assert_null(strstr(text, "given up"));
    free(text);
    json_object_set_new(found, "fallback", json_string("positive"));
    json_object_set_new(found, "goal", json_string("hexes"));
    json_object_set_new(found, "gap", json_real(0.25));
    assert_int_equal(json_dump_file(root, path, 0), 0);
    json_decref(root);
    text = show(folder);
    expect_text(text, ", may be better by 25 %, as few hexes as found, given up for positive ones by the check\n");
    free(text);
}

/* Whether hexes come from a map or from blocks, and why they do not as asked for. */
static void the_origin_of_the_hexes_is_shown(void **state) {
    (void)state;
    static const char *const routes[] = {"auto", "guaranteed"}, *const lines[] = {"map             of the tets, distortion 1.", "map             none; hexes block by block\n"};
    const char *folder = kit_temp_path("hexes"), *path = kit_temp_path("hexes/report.json");
    for (int i = 0; i < 2; i++) {
        kit_result result;
        run_blockwright((const char *[]){"run", sample(), "--out", folder, "--quantize", "positive", "--route", routes[i], "--hex-formats", "none", "--quiet", NULL}, &result);
        kit_result_clear(&result);
        char *text = show(folder);
        expect_text(text, lines[i]);
        free(text);
    }
    json_t *root = json_load_file(path, 0, NULL), *extract = json_object_get(root, "extract");
    json_object_set_new(json_object_get(root, "reparametrize"), "reason", json_string("2 of 9 tets\x1b stay inverted"));
    json_object_set_new(extract, "subdivide", json_integer(3));
    assert_int_equal(json_dump_file(root, path, 0), 0);
    json_decref(root);
    char *text = show(folder);
    expect_text(text, "block by block (2 of 9 tets? stay inverted); each hex in 3 along an edge, or faces would coincide\n");
    free(text);
}

static void one_of_a_thing_is_told_in_the_singular(void **state) {
    (void)state;
    const char *path = kit_temp_path("cuboid.hexex"), *folder = kit_temp_path("one");
    kit_result result;
    run_blockwright((const char *[]){"sample", "cuboid", "--size", "1", "-o", path, NULL}, &result);
    assert_non_null(strstr(result.err, "its base complex has 1 block\n"));
    kit_result_clear(&result);
    run_blockwright((const char *[]){"run", path, "--out", folder, "--explore", "swap", "--quiet", NULL}, &result);
    kit_result_clear(&result);
    run_blockwright((const char *[]){"show", folder, NULL}, &result);
    assert_non_null(strstr(result.out, "mc, raw         1 block, 6 patches, 12 arcs, 0 T-arcs, 8 nodes"));
    assert_non_null(strstr(result.out, "(farthest first: 1 block)"));
    kit_result_clear(&result);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_of_a_thing_is_told_in_the_singular),
        cmocka_unit_test(raw_and_reduced_counts_are_shown),
        cmocka_unit_test(a_quantization_is_shown_with_its_table_of_sizes),
        cmocka_unit_test(the_origin_of_the_hexes_is_shown),
        cmocka_unit_test(without_reduction_nothing_is_said_of_it),
        cmocka_unit_test(a_repair_is_shown),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
