#include "format/report_json.h"

#include <errno.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- the table: every field of a section, once
 * ------------------------------------------------------------------- */

typedef enum { FLAG, COUNT, NUMBER, INTEGER, TEXT, RANGE, PLACES, SPREAD, COUNTS, WORST, COMPONENTS } field_type;

typedef struct {
    const char *section, *group, *name; /* group: an object inside the section, or NULL */
    field_type type;
    size_t at, size;
} field;

#define MEMBER(section, group, type, path, name)                                                             \
    { section, group, #name, type, offsetof(bw_report, path name), sizeof(((bw_report *)0)->path name) }
#define INPUT(type, name) MEMBER("input", NULL, type, input., name)
#define SANITIZE(type, name) MEMBER("sanitize", NULL, type, sanitize., name)
#define REPAIRED(type, name) MEMBER("sanitize", "repaired", type, sanitize.repaired., name)
#define TRACE(type, name) MEMBER("trace", NULL, type, trace., name)
#define COMPLEX(type, name) MEMBER("complex", NULL, type, complex., name)
#define RAW(type, name) MEMBER("complex", "raw", type, complex.raw., name)
#define REDUCED(type, name) MEMBER("complex", "reduced", type, complex.reduced., name)
#define EXPLORED(type, name) MEMBER("exploration", NULL, type, exploration., name)
#define QUANT(type, name) MEMBER("quantization", NULL, type, quantization., name)
#define ROUNDING(type, name) MEMBER("quantization", "rounding", type, quantization.rounding., name)
#define REPARAM(type, name) MEMBER("reparametrize", NULL, type, reparametrize., name)
#define EXTRACT(type, name) MEMBER("extract", NULL, type, extract., name)
#define HEX(type, name) MEMBER("hex_quality", NULL, type, hex_quality., name)
#define HEX_MESH(type, name) MEMBER("hex_quality", NULL, type, hex_quality.mesh., name)
#define SMOOTHING(type, name) MEMBER("hex_quality", "smoothing", type, hex_quality.smoothing., name)
#define BASE_BEFORE(type, name) MEMBER("base_complex", "before", type, base_complex.before., name)
#define BASE_PLANNED(type, name) MEMBER("base_complex", "planned", type, base_complex.planned., name)
#define BASE_AFTER(type, name) MEMBER("base_complex", "after", type, base_complex.after., name)
#define TSPLINE(type, name) MEMBER("tspline", NULL, type, tspline., name)
#define COMPRESSION(type, name) MEMBER("compression", NULL, type, compression., name)
#define WRITTEN(type, name) MEMBER("compression", "written", type, compression.written., name)
#define QUALITY(type, name) MEMBER("quality", NULL, type, quality., name)

static const field fields[] = {
    INPUT(TEXT, file),
    INPUT(COUNT, bytes),
    INPUT(TEXT, kind),
    INPUT(COUNT, hexes),
    INPUT(COUNT, vertices),
    INPUT(COUNT, tets),
    INPUT(COUNT, facets),
    INPUT(COUNT, edges),
    INPUT(COUNT, boundary_facets),
    INPUT(COUNT, singular_edges),
    INPUT(COUNT, singular_edges_interior),
    INPUT(COUNT, singular_edges_boundary),
    INPUT(COUNT, feature_vertices),
    INPUT(COUNT, feature_edges),
    INPUT(COUNT, feature_facets),
    INPUT(FLAG, mirrored),
    SANITIZE(FLAG, already_exact),
    SANITIZE(NUMBER, displacement_max),
    SANITIZE(NUMBER, residual_seamless_max),
    SANITIZE(NUMBER, residual_alignment_max),
    SANITIZE(COUNT, cut_facets),
    SANITIZE(COUNT, cut_edges),
    SANITIZE(COUNT, branches),
    SANITIZE(COUNT, nodes),
    SANITIZE(COUNT, cut_sheets),
    SANITIZE(COUNT, align_sheets),
    SANITIZE(COUNT, system_rows),
    SANITIZE(COUNT, system_columns),
    SANITIZE(COUNT, system_rank),
    SANITIZE(COUNT, free_variables),
    SANITIZE(INTEGER, grid_exponent),
    REPAIRED(COUNT, regions),
    REPAIRED(COUNT, tets),
    REPAIRED(COUNT, vertices_moved),
    REPAIRED(COUNT, rings),
    REPAIRED(NUMBER, displacement_max),
    REPAIRED(PLACES, places), /* behind regions, which counts them */
    TRACE(COUNT, vertices),
    TRACE(COUNT, edges),
    TRACE(COUNT, polygons),
    TRACE(COUNT, cells),
    TRACE(COUNT, cut_cells),
    TRACE(COUNT, wall_polygons),
    TRACE(COUNT, boundary_polygons),
    COMPLEX(TEXT, kind),
    RAW(COUNT, nodes),
    RAW(COUNT, arcs),
    RAW(COUNT, patches),
    RAW(COUNT, blocks),
    RAW(COUNT, t_arcs),
    RAW(COUNT, torus_splits),
    RAW(COUNT, singular_nodes),
    RAW(COUNT, singular_arcs),
    RAW(COUNT, boundary_patches),
    RAW(COUNT, self_adjacent_patches),
    REDUCED(TEXT, mode),
    REDUCED(TEXT, from),
    REDUCED(COUNT, nodes),
    REDUCED(COUNT, arcs),
    REDUCED(COUNT, patches),
    REDUCED(COUNT, blocks),
    REDUCED(COUNT, t_arcs),
    REDUCED(COUNT, singular_nodes),
    REDUCED(COUNT, singular_arcs),
    REDUCED(COUNT, boundary_patches),
    REDUCED(COUNT, self_adjacent_patches),
    REDUCED(COUNT, effort),
    REDUCED(COUNT, orders_tried),
    REDUCED(COUNT, patches_removed),
    REDUCED(COUNT, blocks_farthest_first),
    EXPLORED(TEXT, method),
    EXPLORED(TEXT, cost),
    EXPLORED(TEXT, weights),
    EXPLORED(TEXT, expand),
    EXPLORED(COUNT, beam),
    EXPLORED(COUNT, seed),
    EXPLORED(COUNT, work),
    EXPLORED(COUNT, lines),
    EXPLORED(COUNT, sheets),
    EXPLORED(COUNT, links),
    EXPLORED(COUNT, crossings),
    EXPLORED(COUNT, crossings_open),
    EXPLORED(COUNT, components),
    EXPLORED(COUNT, variable_patches),
    EXPLORED(NUMBER, start),
    EXPLORED(NUMBER, serial),
    EXPLORED(NUMBER, best),
    EXPLORED(COUNT, start_blocks),
    EXPLORED(COUNT, serial_blocks),
    EXPLORED(COUNT, best_blocks),
    EXPLORED(COUNT, evaluations),
    EXPLORED(COUNT, improved_at),
    EXPLORED(TEXT, cut),
    EXPLORED(FLAG, proven),
    EXPLORED(NUMBER, seconds),
    EXPLORED(COMPONENTS, component),
    QUANT(TEXT, range),
    QUANT(TEXT, fallback),
    QUANT(TEXT, goal),
    QUANT(TEXT, status),
    QUANT(NUMBER, scale),
    QUANT(NUMBER, objective),
    QUANT(NUMBER, bound),
    QUANT(NUMBER, gap),
    QUANT(NUMBER, heuristic),
    QUANT(NUMBER, distortion),
    QUANT(COUNT, target_hexes),
    QUANT(FLAG, target_met),
    QUANT(COUNT, hexes),
    QUANT(COUNT, zero_arcs),
    QUANT(COUNT, negative_arcs),
    QUANT(COUNT, arcs),
    QUANT(COUNT, classes),
    QUANT(COUNT, free_integers),
    QUANT(COUNT, rounds),
    QUANT(COUNT, constraints),
    QUANT(COUNT, nodes),
    QUANT(NUMBER, seconds),
    QUANT(NUMBER, seconds_setup),
    QUANT(NUMBER, seconds_separation),
    QUANT(NUMBER, seconds_solver),
    QUANT(NUMBER, seconds_check),
    QUANT(FLAG, verified),
    ROUNDING(NUMBER, scale),
    ROUNDING(NUMBER, objective),
    ROUNDING(COUNT, integers),
    ROUNDING(COUNT, hexes),
    ROUNDING(FLAG, valid),
    ROUNDING(COUNT, conflicts),
    ROUNDING(COUNT, negative_blocks),
    ROUNDING(COUNT, links),
    ROUNDING(COUNT, separations),
    ROUNDING(COUNT, loops),
    ROUNDING(FLAG, coarsest_valid),
    ROUNDING(NUMBER, coarsest_scale),
    ROUNDING(COUNT, coarsest_hexes),
    ROUNDING(NUMBER, seconds),
    REPARAM(TEXT, route),
    REPARAM(TEXT, requantized),
    REPARAM(TEXT, reason),
    REPARAM(COUNT, hexes_asked),
    REPARAM(COUNT, hexes),
    REPARAM(COUNT, inverted_fit),
    REPARAM(COUNT, inverted_stiffened),
    REPARAM(COUNT, inverted_untangled),
    REPARAM(COUNT, inverted),
    REPARAM(COUNT, stiffenings),
    REPARAM(COUNT, iterations),
    REPARAM(COUNT, restarts),
    REPARAM(COUNT, refinements),
    REPARAM(COUNT, splits),
    REPARAM(COUNT, tets),
    REPARAM(NUMBER, work),
    REPARAM(FLAG, limited),
    REPARAM(NUMBER, distortion_mean),
    REPARAM(NUMBER, distortion_max),
    REPARAM(NUMBER, seconds),
    REPARAM(NUMBER, seconds_frame),
    REPARAM(NUMBER, seconds_fit),
    REPARAM(NUMBER, seconds_untangle),
    REPARAM(NUMBER, seconds_verify),
    EXTRACT(TEXT, from),
    EXTRACT(COUNT, hexes),
    EXTRACT(COUNT, vertices),
    EXTRACT(COUNT, promised),
    EXTRACT(COUNT, subdivide),
    EXTRACT(COUNT, subdivide_asked),
    EXTRACT(NUMBER, seconds),
    EXTRACT(NUMBER, seconds_label),
    EXTRACT(NUMBER, seconds_check),
    HEX_MESH(SPREAD, scaled_jacobian),
    HEX_MESH(COUNT, hexes),
    HEX_MESH(COUNT, nonpositive),
    HEX_MESH(COUNTS, histogram),
    HEX_MESH(WORST, worst),
    HEX_MESH(COUNTS, inner),
    HEX_MESH(COUNTS, boundary),
    HEX_MESH(NUMBER, volume),
    HEX_MESH(SPREAD, edge_length),
    HEX(NUMBER, volume_difference),
    HEX(NUMBER, to_input),
    HEX(NUMBER, from_input),
    HEX(NUMBER, to_curves),
    HEX(NUMBER, hausdorff),
    HEX(NUMBER, hausdorff_relative),
    HEX(NUMBER, seconds),
    SMOOTHING(COUNT, nonpositive_before),
    SMOOTHING(NUMBER, min_before),
    SMOOTHING(NUMBER, mean_before),
    SMOOTHING(COUNT, rounds),
    SMOOTHING(COUNT, iterations),
    SMOOTHING(NUMBER, moved_max),
    SMOOTHING(NUMBER, moved_mean),
    SMOOTHING(NUMBER, off_surface_max),
    SMOOTHING(NUMBER, off_surface_mean),
    SMOOTHING(COUNT, vertices_off_surface),
    SMOOTHING(NUMBER, seconds),
    COMPRESSION(COUNT, blocks),
    COMPRESSION(COUNT, vertices),
    COMPRESSION(COUNT, vertices_coded),
    COMPRESSION(COUNT, coordinates_wrong),
    COMPRESSION(COUNT, bits),
    COMPRESSION(NUMBER, estimate_pooled),
    COMPRESSION(NUMBER, estimate_blocks),
    COMPRESSION(NUMBER, cube_ratio),
    COMPRESSION(NUMBER, cube_ratio_lengths),
    WRITTEN(COUNT, bits),
    WRITTEN(NUMBER, error_max),
    WRITTEN(COUNT, bytes),
    WRITTEN(COUNT, bytes_header),
    WRITTEN(COUNT, bytes_shape),
    WRITTEN(COUNT, bytes_places),
    WRITTEN(NUMBER, bits_per_vertex),
    WRITTEN(NUMBER, bits_per_vertex_places),
    QUALITY(RANGE, block_extent),
    QUALITY(RANGE, block_aspect),
    QUALITY(RANGE, block_volume),
    QUALITY(NUMBER, volume),
    QUALITY(COUNT, traced_vertices),
    QUALITY(COUNT, traced_tets),
    QUALITY(COUNT, traced_walls),
    QUALITY(TEXT, integer_grid_omitted),
    BASE_BEFORE(COUNT, hexes),
    BASE_BEFORE(COUNT, blocks),
    BASE_BEFORE(COUNT, irregular_edges),
    BASE_PLANNED(COUNT, hexes),
    BASE_PLANNED(COUNT, blocks),
    BASE_PLANNED(COUNT, irregular_edges),
    BASE_AFTER(COUNT, hexes),
    BASE_AFTER(COUNT, blocks),
    BASE_AFTER(COUNT, irregular_edges),
    TSPLINE(TEXT, knots),
    TSPLINE(COUNT, blocks),
    TSPLINE(COUNT, cells),
    TSPLINE(COUNT, added_cells),
    TSPLINE(COUNT, refined_blocks),
    TSPLINE(COUNT, vertices),
    TSPLINE(COUNT, t_joints),
    TSPLINE(COUNT, extraordinary_arcs),
    TSPLINE(NUMBER, seconds),
};

static const struct {
    const char *name;
    size_t flag;
} sections[] = {
    {"input", offsetof(bw_report, has_input)},     {"sanitize", offsetof(bw_report, has_sanitize)},
    {"trace", offsetof(bw_report, has_trace)},     {"complex", offsetof(bw_report, has_complex)},
    {"exploration", offsetof(bw_report, has_exploration)},
    {"quantization", offsetof(bw_report, has_quantization)},
    {"reparametrize", offsetof(bw_report, has_reparametrize)},
    {"extract", offsetof(bw_report, has_extract)},
    {"hex_quality", offsetof(bw_report, has_hex_quality)},
    {"compression", offsetof(bw_report, has_compression)},
    {"quality", offsetof(bw_report, has_quality)},
    {"base_complex", offsetof(bw_report, has_base_complex)},
    {"tspline", offsetof(bw_report, has_tspline)},
};

/* Groups that may be missing from their section. */
static const struct {
    const char *name;
    size_t flag;
} optional_groups[] = {
    {"reduced", offsetof(bw_report, has_reduced)},
    {"repaired", offsetof(bw_report, has_repaired)},
    {"rounding", offsetof(bw_report, has_rounding)},
    {"smoothing", offsetof(bw_report, has_smoothing)},
    {"written", offsetof(bw_report, has_written)},
    {"before", offsetof(bw_report, has_base_before)},
    {"planned", offsetof(bw_report, has_base_planned)},
    {"after", offsetof(bw_report, has_base_after)},
};

enum { FIELDS = sizeof fields / sizeof *fields, SECTIONS = sizeof sections / sizeof *sections };

/* ---- filling
 * ----------------------------------------------------------------------------------------------------- */

void bw_report_init(bw_report *report) {
    memset(report, 0, sizeof *report);
}

void bw_report_add_stage(bw_report *report, const char *name, double seconds, uint64_t peak_bytes) {
    if (report->stage_count == BW_REPORT_STAGES) return;
    bw_report_stage *stage = &report->stage[report->stage_count++];
    snprintf(stage->name, sizeof stage->name, "%s", name);
    stage->seconds = seconds;
    stage->peak_bytes = peak_bytes;
}

void bw_report_add_result(bw_report *report, const char *name, uint64_t bytes) {
    size_t at = 0;
    while (at < report->result_count && strcmp(report->result[at].name, name)) at++;
    if (at == BW_REPORT_RESULTS) return;
    if (at == report->result_count) report->result_count++;
    snprintf(report->result[at].name, sizeof report->result[at].name, "%s", name);
    report->result[at].bytes = bytes;
}

/* ---- to JSON
 * ----------------------------------------------------------------------------------------------------- */

/* Bytes of the UTF-8 sequence at `s` (NUL-terminated); 0 if there is none. */
static size_t utf8_length(const unsigned char *s) {
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    size_t n = *s < 0x80 ? 1 : *s >= 0xc2 && *s < 0xe0 ? 2 : *s >= 0xe0 && *s < 0xf0 ? 3 : *s >= 0xf0 && *s < 0xf5 ? 4 : 0;
    if (n < 2) return n;
    uint32_t code = *s & (0x7fu >> n);
    for (size_t i = 1; i < n; i++) {
        if ((s[i] & 0xc0) != 0x80) return 0;
        code = code << 6 | (s[i] & 0x3fu);
    }
    return code >= least[n] && code < 0x110000 && (code < 0xd800 || code > 0xdfff) ? n : 0;
}

/* A string of any bytes (names and messages may hold foreign text, and are cut to fit): '?' stands for what is not UTF-8. */
static json_t *text_to_json(const char *text) {
    size_t length = strlen(text), at = 0;
    char *clean = malloc(length + 1);
    if (!clean) return NULL;
    memcpy(clean, text, length + 1);
    while (at < length) {
        size_t n = utf8_length((const unsigned char *)clean + at);
        if (!n) clean[at] = '?';
        at += n ? n : 1;
    }
    json_t *string = json_string(clean);
    free(clean);
    return string;
}

static json_t *range_to_json(const bw_report_range *range) {
    return json_pack("{s:f, s:f, s:f}", "min", range->min, "median", range->median, "max", range->max);
}

static json_t *point_to_json(const double p[3]) { return json_pack("[f, f, f]", p[0], p[1], p[2]); }

static json_t *regions_to_json(const bw_region *regions, size_t count) {
    json_t *list = json_array();
    for (size_t i = 0; i < count && i < BW_REGIONS_KEPT; i++) {
        const bw_region *r = &regions[i];
        json_t *ids = json_array();
        for (size_t k = 0; k < r->tet_count && k < BW_REGION_TETS; k++)
            json_array_append_new(ids, json_integer((json_int_t)r->tets[k]));
        json_array_append_new(list, json_pack("{s:I, s:o, s:o, s:[o, o]}", "tets", (json_int_t)r->tet_count, "ids", ids,
                                              "position", point_to_json(r->centre), "box", point_to_json(r->low),
                                              point_to_json(r->high)));
    }
    return list;
}

static json_t *counts_to_json(const uint64_t *counts, size_t size) {
    json_t *list = json_array();
    for (size_t i = 0; i < size / sizeof *counts; i++) json_array_append_new(list, json_integer((json_int_t)counts[i]));
    return list;
}

static json_t *worst_to_json(const bw_report *report) {
    json_t *list = json_array();
    for (size_t i = 0; i < report->hex_quality.mesh.worst_count; i++) {
        const bw_hex_worst *w = &report->hex_quality.mesh.worst[i];
        const int32_t *ijk = report->hex_quality.worst_ijk[i];
        json_array_append_new(list, json_pack("{s:i, s:f, s:o, s:i, s:[i, i, i]}", "hex", (int)w->hex, "scaled_jacobian", w->scaled_jacobian,
                                              "position", point_to_json(w->centre), "block", (int)report->hex_quality.worst_block[i], "ijk",
                                              (int)ijk[0], (int)ijk[1], (int)ijk[2]));
    }
    return list;
}

static json_t *components_to_json(const bw_report *report) {
    json_t *list = json_array();
    for (size_t i = 0; i < report->exploration.component_count; i++) {
        const bw_explore_component *c = &report->exploration.component[i];
        json_array_append_new(list, json_pack("{s:I, s:I, s:I, s:I, s:b, s:b}", "sheets", (json_int_t)c->sheets, "links", (json_int_t)c->links, "states",
                                              (json_int_t)c->states, "leaves", (json_int_t)c->leaves, "complete", c->complete, "bounded", c->bounded));
    }
    return list;
}

static json_t *field_to_json(const field *f, const bw_report *report) {
    const void *at = (const char *)report + f->at;
    switch (f->type) {
    case FLAG:
        return json_boolean(*(const bool *)at);
    case COUNT:
        return json_integer((json_int_t) * (const uint64_t *)at);
    case INTEGER:
        return json_integer(*(const int64_t *)at);
    case NUMBER:
        return json_real(*(const double *)at);
    case RANGE:
        return range_to_json(at);
    case PLACES:
        return regions_to_json(at, report->sanitize.repaired.regions);
    case SPREAD:
        return json_pack("{s:f, s:f, s:f}", "min", ((const bw_hex_range *)at)->min, "mean", ((const bw_hex_range *)at)->mean, "max",
                         ((const bw_hex_range *)at)->max);
    case COUNTS:
        return counts_to_json(at, f->size);
    case WORST:
        return worst_to_json(report);
    case COMPONENTS:
        return components_to_json(report);
    case TEXT:
        break;
    }
    return text_to_json(at);
}

/* Where in a report it is said whether the field's group is there; NULL for what always is. */
static const bool *presence(const field *f, const bw_report *report) {
    for (size_t i = 0; f->group && i < sizeof optional_groups / sizeof *optional_groups; i++)
        if (!strcmp(f->group, optional_groups[i].name)) return (const bool *)report + optional_groups[i].flag;
    return NULL;
}

static json_t *sweep_to_json(const bw_report *report) {
    json_t *list = json_array();
    for (size_t i = 0; i < report->sweep_count; i++) {
        const bw_report_sweep *r = &report->sweep[i];
        json_array_append_new(list, json_pack("{s:f, s:I, s:f, s:f, s:f, s:I, s:I, s:s, s:s, s:f}", "scale", r->scale, "hexes", (json_int_t)r->hexes,
                                              "objective", r->objective, "bound", r->bound, "distortion", r->distortion,
                                              "zero_arcs", (json_int_t)r->zero_arcs, "negative_arcs", (json_int_t)r->negative_arcs,
                                              "status", r->status, "fallback", r->fallback, "seconds", r->seconds));
    }
    return list;
}

static json_t *section_to_json(const char *name, const bw_report *report) {
    json_t *section = json_object();
    for (size_t i = 0; i < FIELDS; i++) {
        const field *f = &fields[i];
        const bool *there = presence(f, report);
        if (strcmp(f->section, name) || (there && !*there)) continue;
        json_t *into = section;
        if (f->group && !(into = json_object_get(section, f->group))) {
            json_object_set_new(section, f->group, json_object());
            into = json_object_get(section, f->group);
        }
        if (json_object_set_new(into, f->name, field_to_json(f, report))) {
            json_decref(section);
            return NULL;
        }
    }
    if (!strcmp(name, "quantization") && json_object_set_new(section, "sweep", sweep_to_json(report))) {
        json_decref(section);
        return NULL;
    }
    return section;
}

static json_t *error_to_json(const bw_error *error) {
    json_t *elements = json_array();
    for (size_t i = 0; i < error->element_count && i < BW_ELEMENTS_KEPT; i++) {
        const bw_element *e = &error->elements[i];
        json_t *element = json_pack("{s:o, s:I}", "kind", text_to_json(e->kind), "id", (json_int_t)e->id);
        if (e->has_position) json_object_set_new(element, "position", point_to_json(e->position));
        json_array_append_new(elements, element);
    }
    json_t *object = json_pack("{s:s, s:s, s:o, s:I, s:o}", "status", bw_status_code(error->status), "class",
                               bw_class_name(bw_status_class(error->status)), "message", text_to_json(error->message),
                               "element_count", (json_int_t)error->element_count, "elements", elements);
    if (error->region_count) {
        json_object_set_new(object, "region_count", json_integer((json_int_t)error->region_count));
        json_object_set_new(object, "regions", regions_to_json(error->regions, error->region_count));
    }
    return object;
}

char *bw_report_error_json(const bw_error *error) {
    json_t *object = error_to_json(error);
    char *text = object ? json_dumps(object, JSON_COMPACT) : NULL;
    json_decref(object);
    return text;
}

static json_t *stages_to_json(const bw_report *report) {
    json_t *list = json_array();
    for (size_t i = 0; i < report->stage_count; i++)
        json_array_append_new(list, json_pack("{s:o, s:f, s:I}", "name", text_to_json(report->stage[i].name), "seconds",
                                              report->stage[i].seconds, "peak_bytes",
                                              (json_int_t)report->stage[i].peak_bytes));
    return list;
}

static json_t *results_to_json(const bw_report *report) {
    json_t *list = json_array();
    for (size_t i = 0; i < report->result_count; i++)
        json_array_append_new(list, json_pack("{s:o, s:I}", "name", text_to_json(report->result[i].name), "bytes",
                                              (json_int_t)report->result[i].bytes));
    return list;
}

char *bw_report_to_json(const bw_report *report) {
    bool failed = report->error.status != BW_OK;
    json_t *object =
        json_pack("{s:s, s:i, s:s, s:s}", "format", "blockwright-report", "report_version", BW_REPORT_VERSION,
                  "version", BW_VERSION, "status", bw_status_code(report->error.status));
    if (!object) return NULL;
    bool whole = !failed || !json_object_set_new(object, "error", error_to_json(&report->error));
    for (size_t i = 0; i < SECTIONS; i++)
        if (*((const bool *)report + sections[i].flag))
            whole =
                !json_object_set_new(object, sections[i].name, section_to_json(sections[i].name, report)) &&
                whole;
    whole = !json_object_set_new(object, "stages", stages_to_json(report)) && whole;
    whole = !json_object_set_new(object, "results", results_to_json(report)) && whole;
    char *text = whole ? json_dumps(object, JSON_INDENT(2) | JSON_REAL_PRECISION(17)) : NULL;
    json_decref(object);
    size_t length = text ? strlen(text) : 0;
    char *line = text ? realloc(text, length + 2) : NULL;
    if (!line) {
        free(text);
        return NULL;
    }
    memcpy(line + length, "\n", 2);
    return line;
}

bw_status bw_report_write(bw_context *ctx, const bw_report *report, const char *path) {
    char *text = bw_report_to_json(report);
    if (!text) return bw_fail(ctx, BW_E_MEMORY, "out of memory for the report");
    FILE *file = fopen(path, "wb");
    bool good = file && fputs(text, file) >= 0;
    int error = errno;
    if (file && fclose(file)) good = false, error = errno;
    free(text);
    return good ? BW_OK : bw_fail(ctx, BW_E_IO, "cannot write %s: %s", path, strerror(error));
}

/* ---- from JSON
 * --------------------------------------------------------------------------------------------------- */

static bool range_from_json(const json_t *value, bw_report_range *range) {
    const json_t *min = json_object_get(value, "min"), *median = json_object_get(value, "median");
    const json_t *max = json_object_get(value, "max");
    if (!json_is_number(min) || !json_is_number(median) || !json_is_number(max)) return false;
    *range = (bw_report_range){json_number_value(min), json_number_value(median), json_number_value(max)};
    return true;
}

static bool point_from_json(json_t *value, double out[3]) {
    return !json_unpack(value, "[F, F, F!]", &out[0], &out[1], &out[2]);
}

/* Requires room for BW_REGIONS_KEPT. */
static bool regions_from_json(const json_t *list, bw_region *out, size_t count) {
    size_t kept = count < BW_REGIONS_KEPT ? count : BW_REGIONS_KEPT;
    if (json_array_size(list) != kept) return false;
    for (size_t i = 0; i < kept; i++) {
        json_t *ids, *position, *low, *high;
        json_int_t tets;
        if (json_unpack(json_array_get(list, i), "{s:I, s:o, s:o, s:[o, o!]}", "tets", &tets, "ids", &ids, "position",
                        &position, "box", &low, &high))
            return false;
        out[i].tet_count = (size_t)tets;
        for (size_t k = 0; k < json_array_size(ids) && k < BW_REGION_TETS; k++)
            out[i].tets[k] = json_integer_value(json_array_get(ids, k));
        if (!point_from_json(position, out[i].centre) || !point_from_json(low, out[i].low) ||
            !point_from_json(high, out[i].high))
            return false;
    }
    return true;
}

static bool counts_from_json(const json_t *list, uint64_t *counts, size_t size) {
    if (json_array_size(list) != size / sizeof *counts) return false;
    for (size_t i = 0; i < size / sizeof *counts; i++) counts[i] = (uint64_t)json_integer_value(json_array_get(list, i));
    return true;
}

static bool worst_from_json(const json_t *list, bw_report *report) {
    if (!json_is_array(list) || json_array_size(list) > BW_HEX_WORST) return false;
    for (size_t i = 0; i < json_array_size(list); i++) {
        bw_hex_worst *w = &report->hex_quality.mesh.worst[i];
        int hex, block, ijk[3];
        json_t *position;
        if (json_unpack(json_array_get(list, i), "{s:i, s:F, s:o, s:i, s:[i, i, i!]}", "hex", &hex, "scaled_jacobian", &w->scaled_jacobian,
                        "position", &position, "block", &block, "ijk", &ijk[0], &ijk[1], &ijk[2]) ||
            !point_from_json(position, w->centre))
            return false;
        w->hex = hex, report->hex_quality.worst_block[i] = block;
        for (int k = 0; k < 3; k++) report->hex_quality.worst_ijk[i][k] = ijk[k];
    }
    report->hex_quality.mesh.worst_count = json_array_size(list);
    return true;
}

static bool components_from_json(const json_t *list, bw_report *report) {
    if (!json_is_array(list) || json_array_size(list) > BW_EXPLORE_LISTED) return false;
    for (size_t i = 0; i < json_array_size(list); i++) {
        bw_explore_component *c = &report->exploration.component[i];
        json_int_t sheets, links, states, leaves;
        int complete, bounded;
        if (json_unpack(json_array_get(list, i), "{s:I, s:I, s:I, s:I, s:b, s:b}", "sheets", &sheets, "links", &links, "states", &states, "leaves", &leaves, "complete",
                        &complete, "bounded", &bounded))
            return false;
        *c = (bw_explore_component){(size_t)sheets, (size_t)links, (uint64_t)states, (uint64_t)leaves, complete != 0, bounded != 0};
    }
    report->exploration.component_count = json_array_size(list);
    return true;
}

static bool spread_from_json(const json_t *value, bw_hex_range *range) {
    return !json_unpack((json_t *)value, "{s:F, s:F, s:F}", "min", &range->min, "mean", &range->mean, "max", &range->max);
}

static bool field_from_json(const field *f, const json_t *value, bw_report *report) {
    void *at = (char *)report + f->at;
    switch (f->type) {
    case FLAG:
        *(bool *)at = json_is_true(value);
        return json_is_boolean(value);
    case COUNT:
        *(uint64_t *)at = (uint64_t)json_integer_value(value);
        return json_is_integer(value);
    case INTEGER:
        *(int64_t *)at = json_integer_value(value);
        return json_is_integer(value);
    case NUMBER:
        *(double *)at = json_number_value(value);
        return json_is_number(value);
    case RANGE:
        return range_from_json(value, at);
    case PLACES:
        return regions_from_json(value, at, report->sanitize.repaired.regions);
    case SPREAD:
        return spread_from_json(value, at);
    case COUNTS:
        return counts_from_json(value, at, f->size);
    case WORST:
        return worst_from_json(value, report);
    case COMPONENTS:
        return components_from_json(value, report);
    case TEXT:
        break;
    }
    if (!json_is_string(value)) return false;
    snprintf(at, f->size, "%s", json_string_value(value));
    return true;
}

static bool sweep_from_json(const json_t *list, bw_report *report) {
    if (!json_is_array(list) || json_array_size(list) > BW_REPORT_SWEEP) return false;
    for (size_t i = 0; i < json_array_size(list); i++) {
        bw_report_sweep *r = &report->sweep[i];
        json_int_t hexes, zero, negative;
        const char *status, *fallback;
        if (json_unpack(json_array_get(list, i), "{s:F, s:I, s:F, s:F, s:F, s:I, s:I, s:s, s:s, s:F}", "scale", &r->scale, "hexes", &hexes,
                        "objective", &r->objective, "bound", &r->bound, "distortion", &r->distortion, "zero_arcs", &zero,
                        "negative_arcs", &negative, "status", &status, "fallback", &fallback, "seconds", &r->seconds))
            return false;
        r->hexes = (uint64_t)hexes, r->zero_arcs = (uint64_t)zero, r->negative_arcs = (uint64_t)negative;
        snprintf(r->status, sizeof r->status, "%s", status);
        snprintf(r->fallback, sizeof r->fallback, "%s", fallback);
    }
    report->sweep_count = json_array_size(list);
    return true;
}

static bool section_from_json(const char *name, const json_t *section, bw_report *report) {
    if (!json_is_object(section)) return false;
    for (size_t i = 0; i < FIELDS; i++) {
        const field *f = &fields[i];
        if (strcmp(f->section, name)) continue;
        const json_t *from = f->group ? json_object_get(section, f->group) : section;
        bool *there = (bool *)presence(f, report);
        if (there && !from) continue;
        if (there) *there = true;
        if (!field_from_json(f, json_object_get(from, f->name), report)) return false;
    }
    if (!strcmp(name, "quantization")) return sweep_from_json(json_object_get(section, "sweep"), report);
    return true;
}

static bool error_from_json(json_t *object, bw_error *error) {
    const char *status, *message;
    json_int_t count;
    json_t *elements;
    if (json_unpack(object, "{s:s, s:s, s:I, s:o}", "status", &status, "message", &message, "element_count",
                    &count, "elements", &elements))
        return false;
    error->status = bw_status_from_code(status);
    snprintf(error->message, sizeof error->message, "%s", message);
    error->element_count = (size_t)count;
    for (size_t i = 0; i < json_array_size(elements) && i < BW_ELEMENTS_KEPT; i++) {
        bw_element *e = &error->elements[i];
        json_int_t id;
        const char *kind;
        json_t *element = json_array_get(elements, i), *position = json_object_get(element, "position");
        if (json_unpack(element, "{s:s, s:I}", "kind", &kind, "id", &id)) return false;
        snprintf(e->kind, sizeof e->kind, "%s", kind);
        e->id = id;
        e->has_position = position != NULL;
        if (position && !point_from_json(position, e->position)) return false;
    }
    error->region_count = (size_t)json_integer_value(json_object_get(object, "region_count"));
    if (!regions_from_json(json_object_get(object, "regions"), error->regions, error->region_count)) return false;
    return json_array_size(elements) ==
           (error->element_count < BW_ELEMENTS_KEPT ? error->element_count : BW_ELEMENTS_KEPT);
}

static bool lists_from_json(const json_t *object, bw_report *report) {
    const json_t *stages = json_object_get(object, "stages"), *results = json_object_get(object, "results");
    if (!json_is_array(stages) || !json_is_array(results)) return false;
    const char *name;
    double seconds;
    json_int_t bytes;
    for (size_t i = 0; i < json_array_size(stages); i++) {
        if (json_unpack(json_array_get(stages, i), "{s:s, s:F, s:I}", "name", &name, "seconds", &seconds,
                        "peak_bytes", &bytes))
            return false;
        bw_report_add_stage(report, name, seconds, (uint64_t)bytes);
    }
    for (size_t i = 0; i < json_array_size(results); i++) {
        if (json_unpack(json_array_get(results, i), "{s:s, s:I}", "name", &name, "bytes", &bytes))
            return false;
        if (strlen(name) >= sizeof report->result->name) return false; /* cut short it could become another's */
        bw_report_add_result(report, name, (uint64_t)bytes);
    }
    return true;
}

static bool report_from_json(const json_t *object, bw_report *report) {
    const char *format = json_string_value(json_object_get(object, "format"));
    if (!format || strcmp(format, "blockwright-report")) return false;
    if (json_integer_value(json_object_get(object, "report_version")) != BW_REPORT_VERSION) return false;
    json_t *error = json_object_get(object, "error");
    if (error && !error_from_json(error, &report->error)) return false;
    for (size_t i = 0; i < SECTIONS; i++) {
        const json_t *section = json_object_get(object, sections[i].name);
        if (!section) continue;
        if (!section_from_json(sections[i].name, section, report)) return false;
        *((bool *)report + sections[i].flag) = true;
    }
    return lists_from_json(object, report);
}

bw_status bw_report_from_json(bw_context *ctx, const char *json, size_t length, bw_report *report) {
    bw_report_init(report);
    json_error_t where;
    json_t *object = json_loadb(json, length, JSON_REJECT_DUPLICATES, &where);
    bool good = object && report_from_json(object, report);
    json_decref(object);
    if (good) return BW_OK;
    bw_report_init(report);
    return bw_fail(ctx, BW_E_VERSION, "the stored report is not one of version %d", BW_REPORT_VERSION);
}
