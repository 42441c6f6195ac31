/* report.json, blocks.json, tmesh.json and constraints.json keep to api/schemas. The validator below knows the words of JSON Schema that
 * the schemas use and fails on any other, so that no rule is passed over in silence. */
#include "core/encode_kit.h"
#include "core/hex_kit.h"
#include "stage/quantize.h"

#include <jansson.h>
#include <math.h>
#include <regex.h>

static json_t *schema;  /* the document, for $ref */
static char fault[400]; /* first violation, with its place; empty if none */

static bool valid(const json_t *rule, json_t *value, const char *place);

static bool fail_at(const char *place, const char *what) {
    if (!*fault) snprintf(fault, sizeof fault, "%s: %s", place, what);
    return false;
}

static bool has_type(const char *type, const json_t *value) {
    if (!strcmp(type, "object")) return json_is_object(value);
    if (!strcmp(type, "array")) return json_is_array(value);
    if (!strcmp(type, "string")) return json_is_string(value);
    if (!strcmp(type, "integer")) return json_is_integer(value);
    if (!strcmp(type, "number")) return json_is_number(value);
    if (!strcmp(type, "boolean")) return json_is_boolean(value);
    if (!strcmp(type, "null")) return json_is_null(value);
    fail_msg("schema type %s is not known to this test", type);
    return false;
}

static bool properties_valid(const json_t *rule, json_t *value, const char *place) {
    const char *key;
    json_t *member;
    const json_t *properties = json_object_get(rule, "properties");
    json_object_foreach(value, key, member) {
        char inner[300];
        snprintf(inner, sizeof inner, "%s.%s", place, key);
        const json_t *sub = json_object_get(properties, key);
        if (!sub && json_is_false(json_object_get(rule, "additionalProperties")))
            return fail_at(inner, "not in the schema");
        if (sub && !valid(sub, member, inner)) return false;
    }
    return true;
}

static bool required_valid(const json_t *names, const json_t *value, const char *place) {
    for (size_t i = 0; i < json_array_size(names); i++)
        if (!json_object_get(value, json_string_value(json_array_get(names, i))))
            return fail_at(place, json_string_value(json_array_get(names, i)));
    return true;
}

static bool items_valid(const json_t *sub, json_t *value, const char *place) {
    for (size_t i = 0; i < json_array_size(value); i++) {
        char inner[300];
        snprintf(inner, sizeof inner, "%s[%zu]", place, i);
        if (!valid(sub, json_array_get(value, i), inner)) return false;
    }
    return true;
}

static bool matches(const char *pattern, const char *text) {
    regex_t regex;
    assert_int_equal(regcomp(&regex, pattern, REG_EXTENDED | REG_NOSUB), 0);
    bool match = !regexec(&regex, text, 0, NULL, 0);
    regfree(&regex);
    return match;
}

static bool one_of(const json_t *list, json_t *value, bool equal, const char *place) {
    for (size_t i = 0; i < json_array_size(list); i++) {
        json_t *item = json_array_get(list, i);
        if (equal ? json_equal(item, value) : valid(item, value, place)) {
            *fault = 0;
            return true;
        }
    }
    return fail_at(place, "none of the allowed");
}

static bool word_valid(const json_t *rule, const char *word, const json_t *arg, json_t *value,
                       const char *place) {
    double number = json_number_value(value), bound = json_number_value(arg);
    size_t items = json_array_size(value);
    if (!strcmp(word, "type")) return has_type(json_string_value(arg), value) || fail_at(place, "wrong type");
    if (!strcmp(word, "properties")) return properties_valid(rule, value, place);
    if (!strcmp(word, "required")) return required_valid(arg, value, place);
    if (!strcmp(word, "items")) return items_valid(arg, value, place);
    if (!strcmp(word, "minItems")) return (double)items >= bound || fail_at(place, "too few items");
    if (!strcmp(word, "maxItems")) return (double)items <= bound || fail_at(place, "too many items");
    if (!strcmp(word, "minimum")) return number >= bound || fail_at(place, "too small");
    if (!strcmp(word, "exclusiveMinimum")) return number > bound || fail_at(place, "too small");
    if (!strcmp(word, "maximum")) return number <= bound || fail_at(place, "too large");
    if (!strcmp(word, "const")) return json_equal(arg, value) || fail_at(place, "another constant");
    if (!strcmp(word, "enum")) return one_of(arg, value, true, place);
    if (!strcmp(word, "anyOf")) return one_of(arg, value, false, place);
    if (!strcmp(word, "pattern"))
        return matches(json_string_value(arg), json_string_value(value)) || fail_at(place, "pattern");
    if (!strcmp(word, "$ref")) {
        const char *name = strrchr(json_string_value(arg), '/') + 1;
        const json_t *target = json_object_get(json_object_get(schema, "$defs"), name);
        assert_non_null(target);
        return valid(target, value, place);
    }
    static const char *const silent[] = {
        "additionalProperties", "description", "title", "$schema", "$id", "$defs"};
    for (size_t i = 0; i < sizeof silent / sizeof *silent; i++)
        if (!strcmp(word, silent[i])) return true;
    fail_msg("schema word %s is not known to this test", word);
    return false;
}

static bool valid(const json_t *rule, json_t *value, const char *place) {
    const json_t *type = json_object_get(rule, "type"); /* first: the other words rely on it */
    if (type && !word_valid(rule, "type", type, value, place)) return false;
    const char *word;
    json_t *arg;
    json_object_foreach((json_t *)rule, word,
                        arg) if (!word_valid(rule, word, arg, value, place)) return false;
    return true;
}

static json_t *load(const char *path) {
    json_error_t error;
    json_t *value = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!value) fail_msg("%s:%d: %s", path, error.line, error.text);
    return value;
}

static bool keeps_to(const char *name, json_t *value) {
    char path[500];
    snprintf(path, sizeof path, "%s/api/schemas/%s", BW_SOURCE_DIR, name);
    schema = load(path);
    *fault = 0;
    bool good = valid(schema, value, "$");
    json_decref(schema);
    return good;
}

static json_t *encoded_json(const encoded *e, const char *file) {
    return load(kit_temp_path("%s/%s", strrchr(e->folder, '/') + 1, file));
}

static const struct {
    const char *name;
    bw_complex_kind kind;
} samples[] = {{"l-shape", BW_COMPLEX_MC},
               {"ball", BW_COMPLEX_BC},
               {"torus-quarter", BW_COMPLEX_MC},
               {"tee", BW_COMPLEX_SERIAL}};

/* Any hex mesh gives the section. */
static void fill_hexes(bw_context *ctx, bw_report *report, bool smoothing) {
    bw_hex_mesh mesh;
    bw_hex_quality quality;
    hex_kit_cube(ctx, 2, &mesh);
    kit_expect_ok(ctx, bw_hex_measure(ctx, &mesh, &quality));
    bw_report_fill_hex_quality(report, &mesh, &quality, &(bw_hex_distance){.diagonal = 1, .to_input = 0.1, .input_volume = 2});
    report->has_smoothing = smoothing;
    bw_report_fill_compression(report, &(bw_predict_report){.blocks = 1, .vertices = 27, .vertices_coded = 27, .e_g_pooled = 1, .cube_ratio = 1, .cube_ratio_lengths = INFINITY}, 12);
    if (smoothing) bw_report_fill_written(report, &(bw_bwh_sizes){64, 20, 30, {0.5, 0.25, 0}}, 12, 27);
    bw_hex_mesh_clear(ctx, &mesh);
}

static void blocks_and_reports_of_samples_keep_to_the_schemas(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        encoded e;
        encode_prepare(&e, samples[i].name, 1, 0.5, samples[i].kind);
        bw_quantize_options size = {.range = BW_QUANTIZE_POSITIVE, .scale = 1, .seconds = 10, .scale_count = 2, .scales = {0, 2}};
        if (i) kit_expect_ok(&e.ctx, bw_quantize(&e.ctx, &e.cells, &e.complex, &size, &e.length, &e.report));
        encode_run_with(&e, &(bw_encode_options){.tmesh = true});
        e.report.has_sanitize = true;
        e.report.sanitize.grid_exponent = e.map.exponent;
        e.report.has_repaired = i % 2;
        e.report.sanitize.repaired.regions = e.report.sanitize.repaired.tets = 1;
        e.report.sanitize.repaired.places[0] = (bw_region){.tet_count = 1, .high = {1, 1, 1}};
        fill_hexes(&e.ctx, &e.report, i % 2);
        e.report.has_base_complex = e.report.has_base_after = true, e.report.has_base_before = i % 2, e.report.has_base_planned = i > 1;
        e.report.base_complex.before = e.report.base_complex.planned = e.report.base_complex.after = (bw_report_base){8, 1, 12};
        bw_report_add_stage(&e.report, "encode", 0.25, 4096);
        kit_expect_ok(&e.ctx, bw_report_write(&e.ctx, &e.report,
                                              kit_temp_path("%s/report.json", strrchr(e.folder, '/') + 1)));
        static const char *const pair[][2] = {{"blocks.json", "blocks.schema.json"},
                                              {"report.json", "report.schema.json"},
                                              {"tmesh.json", "tmesh.schema.json"},
                                              {"constraints.json", "constraints.schema.json"}};
        for (int f = 0; f < (i ? 4 : 3); f++) {
            json_t *value = encoded_json(&e, pair[f][0]);
            if (!keeps_to(pair[f][1], value)) fail_msg("%s of %s: %s", pair[f][0], samples[i].name, fault);
            json_decref(value);
        }
        encode_clear(&e);
    }
}

static void reports_of_failures_and_of_nothing_keep_to_the_schema(void **state) {
    (void)state;
    for (int failed = 0; failed < 2; failed++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_report report;
        bw_report_init(&report);
        const double position[3] = {1, -2.5, 1e-9};
        const bw_region region = {.tet_count = 2, .tets = {17, 18}, .high = {1, 2, 3}};
        if (failed) {
            bw_fail(&ctx, BW_E_INVERTED, "one tet is inverted: \"17\"");
            bw_fail_element(&ctx, "tet", 17, position);
            bw_fail_element(&ctx, "tet", 18, NULL);
            bw_fail_region(&ctx, &region);
            report.error = ctx.error;
        }
        char *text = bw_report_to_json(&report);
        json_t *value = json_loads(text, 0, NULL);
        if (!keeps_to("report.schema.json", value)) fail_msg("%s", fault);
        json_decref(value);
        free(text);
    }
}

static void the_validator_notices_what_is_wrong(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "l-shape", 1, 0.5, BW_COMPLEX_MC);
    encode_run(&e);
    for (int damage = 0; damage < 7; damage++) {
        json_t *value = encoded_json(&e, "blocks.json");
        json_t *arc = json_array_get(json_object_get(value, "arcs"), 0),
               *block = json_array_get(json_object_get(value, "blocks"), 0);
        if (damage == 0) json_object_del(value, "grid");
        if (damage == 1) json_object_set_new(value, "extra", json_true());
        if (damage == 2) json_object_set_new(arc, "length", json_string("1"));
        if (damage == 3) json_object_set_new(arc, "length", json_integer(0));
        if (damage == 4) json_array_remove(json_object_get(block, "corners"), 0);
        if (damage == 5) json_object_set_new(arc, "length_grid", json_string("12x"));
        if (damage == 6)
            json_array_set_new(json_array_get(json_object_get(block, "edges"), 3), 0, json_real(0.5));
        assert_false(keeps_to("blocks.schema.json", value));
        assert_true(*fault);
        json_decref(value);
    }
    encode_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_and_reports_of_samples_keep_to_the_schemas),
        cmocka_unit_test(reports_of_failures_and_of_nothing_keep_to_the_schema),
        cmocka_unit_test(the_validator_notices_what_is_wrong),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
