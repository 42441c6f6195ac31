#include "format/msh.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/input_mesh.h"
#include "format/msh_tags.h"

typedef struct {
    int64_t dimension, tag;
} group; /* a physical group, or an entity */

typedef struct {
    char name[80];
    int64_t rows;
    bw_scan scan; /* at the first row */
} view;

typedef struct {
    bw_scan scan;
    bw_context *ctx;
    bw_tet_mesh *mesh;
    bool binary, swap, version_4;
    bool has_names, has_elements;
    group *feature_group, *feature_entity;
    size_t group_count, group_room, entity_count, entity_room;
    bw_tags nodes, cells;
    size_t cell_room;
    bw_input_room room;
    view *view;
    size_t view_count, view_room;
} reader;

/* ---- values -------------------------------------------------------------------------------------------- */

static bw_status take_bits(reader *r, size_t size, uint64_t *bits) {
    const char *bytes = NULL;
    bw_status status = bw_scan_bytes(&r->scan, size, &bytes);
    *bits = 0;
    for (size_t i = 0; i < size && status == BW_OK; i++)
        *bits |= (uint64_t)(uint8_t)bytes[i] << 8 * (r->swap ? size - 1 - i : i);
    return status;
}

static bw_status take_int(reader *r, int64_t *value) {
    if (!r->binary) return bw_scan_whole(&r->scan, value);
    uint64_t bits;
    bw_status status = take_bits(r, 4, &bits);
    *value = (int32_t)bits;
    return status;
}

/* A size_t of Gmsh's: counts, and the tags of nodes and elements. */
static bw_status take_size(reader *r, int64_t *value) {
    if (!r->binary) return bw_scan_whole(&r->scan, value);
    uint64_t bits;
    bw_status status = take_bits(r, 8, &bits);
    *value = bits > INT64_MAX ? INT64_MAX : (int64_t)bits;
    return status;
}

static bw_status take_real(reader *r, double *value) {
    if (!r->binary) return bw_scan_number(&r->scan, value);
    uint64_t bits;
    bw_status status = take_bits(r, 8, &bits);
    memcpy(value, &bits, sizeof *value);
    if (status == BW_OK && !isfinite(*value))
        return bw_scan_fail(&r->scan, BW_E_NUMBER, "%s is not a finite number",
                            isnan(*value) ? "nan" : "inf");
    return status;
}

static bw_status pass_sizes(reader *r, int64_t count, bool ints) {
    int64_t value;
    bw_status status = bw_scan_count(&r->scan, "tags", count, INT64_MAX, r->binary ? (ints ? 4 : 8) : 2);
    for (int64_t i = 0; i < count && status == BW_OK; i++)
        status = ints ? take_int(r, &value) : take_size(r, &value);
    return status;
}

static bw_status expect_end(reader *r, const char *section) {
    bw_word word;
    char text[40];
    r->scan.kind = NULL;
    bw_status status = bw_scan_word(&r->scan, &word);
    if (status != BW_OK ||
        (bw_word_starts(word, "$End") && bw_word_is((bw_word){word.text + 4, word.length - 4}, section)))
        return status;
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "'%s' stands where $End%s is due",
                        bw_word_show(word, text, sizeof text), section);
}

/* ---- groups and entities ------------------------------------------------------------------------------- */

static int by_dimension_and_tag(const void *a, const void *b) {
    const group *x = a, *y = b;
    return x->dimension != y->dimension ? (x->dimension > y->dimension) - (x->dimension < y->dimension)
                                        : (x->tag > y->tag) - (x->tag < y->tag);
}

static void sort_groups(group *list, size_t count) {
    if (count) qsort(list, count, sizeof *list, by_dimension_and_tag);
}

static bool has_group(const group *list, size_t count, int64_t dimension, int64_t tag) {
    const group wanted = {dimension, tag};
    return count && bsearch(&wanted, list, count, sizeof *list, by_dimension_and_tag);
}

static bw_status read_names(reader *r) {
    int64_t count = 0;
    bw_scan *s = &r->scan;
    bw_status status = bw_scan_whole(s, &count);
    if (status == BW_OK) status = bw_scan_count(s, "physical names", count, INT32_MAX, 6);
    r->has_names = count > 0;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        group g = {0, 0};
        status = bw_scan_record(s, "name", i);
        if (status == BW_OK) status = bw_scan_whole(s, &g.dimension);
        if (status == BW_OK) status = bw_scan_whole(s, &g.tag);
        if (status != BW_OK) break;
        bw_word name = bw_scan_line(s);
        if (!bw_word_starts(name, "\"feature")) continue;
        status = bw_reserve(r->ctx, &r->feature_group, &r->group_room, r->group_count + 1);
        if (status == BW_OK) r->feature_group[r->group_count++] = g;
    }
    sort_groups(r->feature_group, r->group_count);
    return status == BW_OK ? expect_end(r, "PhysicalNames") : status;
}

static bw_status read_entity(reader *r, int64_t dimension) {
    int64_t tag = 0, groups = 0, bounding = 0;
    double box;
    bool feature = false;
    bw_status status = take_int(r, &tag);
    for (int i = 0; i < (dimension ? 6 : 3) && status == BW_OK; i++) status = take_real(r, &box);
    if (status == BW_OK) status = take_size(r, &groups);
    if (status == BW_OK) status = bw_scan_count(&r->scan, "groups", groups, INT64_MAX, r->binary ? 4 : 2);
    for (int64_t i = 0; i < groups && status == BW_OK; i++) {
        int64_t physical = 0;
        status = take_int(r, &physical);
        feature = feature || has_group(r->feature_group, r->group_count, dimension, physical);
    }
    if (status == BW_OK && dimension) status = take_size(r, &bounding);
    if (status == BW_OK && dimension) status = pass_sizes(r, bounding, true);
    if (status != BW_OK || !feature) return status;
    status = bw_reserve(r->ctx, &r->feature_entity, &r->entity_room, r->entity_count + 1);
    if (status == BW_OK) r->feature_entity[r->entity_count++] = (group){dimension, tag};
    return status;
}

static bw_status read_entities(reader *r) {
    static const char *const kind[] = {"point", "curve", "surface", "volume"};
    int64_t count[4] = {0};
    bw_status status = BW_OK;
    for (int d = 0; d < 4 && status == BW_OK; d++) status = take_size(r, &count[d]);
    for (int d = 0; d < 4 && status == BW_OK; d++)
        status = bw_scan_count(&r->scan, "entities", count[d], INT32_MAX, r->binary ? 36 : 10);
    for (int d = 0; d < 4 && status == BW_OK; d++)
        for (int64_t i = 0; i < count[d] && status == BW_OK; i++) {
            status = bw_scan_record(&r->scan, kind[d], i);
            if (status == BW_OK) status = read_entity(r, d);
        }
    sort_groups(r->feature_entity, r->entity_count);
    return status == BW_OK ? expect_end(r, "Entities") : status;
}

/* ---- nodes --------------------------------------------------------------------------------------------- */

static bw_status begin_nodes(reader *r, int64_t count, uint64_t bytes) {
    if (r->mesh->position) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "there are nodes already");
    bw_status status = bw_scan_count(&r->scan, "nodes", count, BW_INPUT_VERTICES_MAX, bytes);
    if (status == BW_OK && !(r->mesh->position = bw_alloc(r->ctx, (size_t)count, sizeof *r->mesh->position)))
        status = r->ctx->error.status;
    return status;
}

static bw_status end_nodes(reader *r, int64_t count) {
    int64_t twice;
    r->mesh->vertex_count = r->nodes.count;
    if ((int64_t)r->nodes.count != count)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "%zu nodes where %lld are announced", r->nodes.count,
                            (long long)count);
    if (!bw_tags_end(&r->nodes, &twice))
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "two nodes have the tag %lld", (long long)twice);
    return expect_end(r, "Nodes");
}

static bw_status read_nodes_2(reader *r) {
    int64_t count = 0, tag = 0;
    bw_status status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK && r->binary) bw_scan_line(&r->scan);
    if (status == BW_OK) status = begin_nodes(r, count, r->binary ? 28 : 8);
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "vertex", i);
        if (status == BW_OK) status = take_int(r, &tag);
        if (status == BW_OK) status = bw_tags_add(r->ctx, &r->nodes, tag);
        for (int k = 0; k < 3 && status == BW_OK; k++) status = take_real(r, &r->mesh->position[i][k]);
    }
    return status == BW_OK ? end_nodes(r, count) : status;
}

static bw_status read_node_block(reader *r, int64_t total) {
    int64_t dimension = 0, entity, parametric = 0, count = 0, tag = 0;
    double extra;
    bw_status status = take_int(r, &dimension);
    if (status == BW_OK) status = take_int(r, &entity);
    if (status == BW_OK) status = take_int(r, &parametric);
    if (status == BW_OK) status = take_size(r, &count);
    if (status == BW_OK)
        status = bw_scan_count(&r->scan, "nodes of a block", count, total - (int64_t)r->nodes.count,
                               r->binary ? 32 : 8);
    if (status == BW_OK && (dimension < 0 || dimension > 3))
        status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "dimension %lld", (long long)dimension);
    size_t first = r->nodes.count;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "vertex", (int64_t)first + i);
        if (status == BW_OK) status = take_size(r, &tag);
        if (status == BW_OK) status = bw_tags_add(r->ctx, &r->nodes, tag);
    }
    for (size_t i = first; i < first + (size_t)count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "vertex", (int64_t)i);
        for (int k = 0; k < 3 && status == BW_OK; k++) status = take_real(r, &r->mesh->position[i][k]);
        for (int k = 0; k < (parametric ? dimension : 0) && status == BW_OK; k++)
            status = take_real(r, &extra);
    }
    r->scan.kind = NULL;
    return status;
}

/* The four counts that begin $Nodes and $Elements of version 4; the last two are the smallest and the largest
 * tag. */
static bw_status read_counts(reader *r, int64_t count[4], const char *blocks) {
    bw_status status = BW_OK;
    for (int i = 0; i < 4 && status == BW_OK; i++) status = take_size(r, &count[i]);
    return status == BW_OK ? bw_scan_count(&r->scan, blocks, count[0], INT32_MAX, r->binary ? 20 : 8)
                           : status;
}

static bw_status read_nodes_4(reader *r) {
    int64_t count[4] = {0};
    bw_status status = read_counts(r, count, "blocks of nodes");
    if (status == BW_OK) status = begin_nodes(r, count[1], r->binary ? 32 : 8);
    for (int64_t b = 0; b < count[0] && status == BW_OK; b++) status = read_node_block(r, count[1]);
    return status == BW_OK ? end_nodes(r, count[1]) : status;
}

/* ---- elements ------------------------------------------------------------------------------------------ */

enum { LINE = 1, TRIANGLE = 2, QUAD = 3, TET = 4, HEX = 5, POINT = 15 };

/* 0: a type that is not read. */
static int corners_of(int64_t type) {
    static const uint8_t corners[] = {[LINE] = 2, [TRIANGLE] = 3, [QUAD] = 4, [TET] = 4, [HEX] = 8, [POINT] = 1};
    return type >= 0 && type <= POINT ? corners[type] : 0;
}

static int dimension_of(int64_t type) { return type == POINT ? 0 : type == LINE ? 1 : type < TET ? 2 : 3; }

static bw_status fail_type(reader *r, int64_t type) {
    return bw_scan_fail(
        &r->scan, BW_E_SYNTAX,
        "elements of type %lld; only hexes (5) or tets (4), quads (3), triangles (2), lines (1) and points (15) are read",
        (long long)type);
}

static bw_status add_tet(reader *r, int64_t tag, const bw_vertex *corner) {
    bw_tet_mesh *m = r->mesh;
    if (m->tet_count == (size_t)BW_INPUT_TETS_MAX)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "more than the %lld tets supported", (long long)BW_INPUT_TETS_MAX);
    bw_status status = bw_reserve(r->ctx, &m->tet, &r->cell_room, m->tet_count + 1);
    if (status == BW_OK) status = bw_tags_add(r->ctx, &r->cells, tag);
    if (status == BW_OK) memcpy(m->tet[m->tet_count++], corner, sizeof *m->tet);
    return status;
}

static bw_status add_hex(reader *r, int64_t tag, const bw_vertex *corner) {
    bw_tet_mesh *m = r->mesh;
    if (m->hex_count == (size_t)BW_INPUT_HEXES_MAX)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "more than the %lld hexes supported", (long long)BW_INPUT_HEXES_MAX);
    bw_status status = bw_reserve(r->ctx, &m->hex, &r->cell_room, m->hex_count + 1);
    if (status == BW_OK) status = bw_tags_add(r->ctx, &r->cells, tag);
    if (status != BW_OK) return status;
    memcpy(m->hex[m->hex_count], corner, sizeof *m->hex);
    bw_input_from_ring(m->hex[m->hex_count++]);
    return BW_OK;
}

/* The nodes of an element. Tags of nodes are size_t in binary files of version 4, int before. */
static bw_status read_element(reader *r, int64_t type, int64_t tag, bool feature) {
    bw_vertex corner[8];
    bw_status status = BW_OK;
    for (int i = 0, corners = corners_of(type); i < corners && status == BW_OK; i++) {
        int64_t node = 0;
        status = r->version_4 ? take_size(r, &node) : take_int(r, &node);
        int64_t index = bw_tags_find(&r->nodes, node);
        if (status == BW_OK && index < 0)
            status = bw_scan_fail(&r->scan, BW_E_INDEX, "there is no node %lld", (long long)node);
        corner[i] = (bw_vertex)index;
    }
    if (status != BW_OK) return status;
    if (dimension_of(type) < 3)
        return feature ? bw_input_add_feature(r->ctx, r->mesh, &r->room, corners_of(type), corner) : BW_OK;
    if (type == HEX ? r->mesh->tet_count : r->mesh->hex_count)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "a %s among %s; the cells of a mesh are all of one kind, or it is not read",
                            type == HEX ? "hex" : "tet", type == HEX ? "tets" : "hexes");
    return type == HEX ? add_hex(r, tag, corner) : add_tet(r, tag, corner);
}

/* type, number of elements and of tags before each of them: in text files every element has them of its own
 * */
static bw_status read_elements_2(reader *r) {
    int64_t count = 0;
    bw_status status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK && r->binary) bw_scan_line(&r->scan);
    if (status == BW_OK) status = bw_scan_count(&r->scan, "elements", count, BW_INPUT_CELLS_MAX, 8);
    int64_t type = 0, run = 0, tags = 0;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        int64_t tag = 0, physical = 0, other;
        status = bw_scan_record(&r->scan, "element", i);
        if (r->binary && run == 0) {
            if (status == BW_OK) status = take_int(r, &type);
            if (status == BW_OK) status = take_int(r, &run);
            if (status == BW_OK) status = take_int(r, &tags);
            if (status == BW_OK && run < 1)
                status = bw_scan_fail(&r->scan, BW_E_COUNT, "a run of %lld elements", (long long)run);
        }
        if (status == BW_OK) status = take_int(r, &tag);
        if (status == BW_OK && !r->binary) status = bw_scan_whole(&r->scan, &type);
        if (status == BW_OK && !r->binary) status = bw_scan_whole(&r->scan, &tags);
        if (status == BW_OK && !corners_of(type)) status = fail_type(r, type);
        if (status == BW_OK) status = bw_scan_count(&r->scan, "tags", tags, INT32_MAX, r->binary ? 4 : 2);
        for (int64_t k = 0; k < tags && status == BW_OK; k++) status = take_int(r, k ? &other : &physical);
        bool feature = !r->has_names || has_group(r->feature_group, r->group_count, dimension_of(type), physical);
        if (status == BW_OK) status = read_element(r, type, tag, feature);
        run--;
    }
    return status;
}

static bw_status read_element_block(reader *r, int64_t *done, int64_t total) {
    int64_t dimension = 0, entity = 0, type = 0, count = 0, tag = 0;
    bw_status status = take_int(r, &dimension);
    if (status == BW_OK) status = take_int(r, &entity);
    if (status == BW_OK) status = take_int(r, &type);
    if (status == BW_OK) status = take_size(r, &count);
    if (status == BW_OK && !corners_of(type)) status = fail_type(r, type);
    int corners = corners_of(type);
    if (status == BW_OK)
        status = bw_scan_count(&r->scan, "elements of a block", count, total - *done,
                               (uint64_t)(corners + 1) * (r->binary ? 8 : 2));
    bool feature = !r->has_names || has_group(r->feature_entity, r->entity_count, dimension, entity);
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "element", *done + i);
        if (status == BW_OK) status = take_size(r, &tag);
        if (status == BW_OK) status = read_element(r, type, tag, feature);
    }
    r->scan.kind = NULL;
    if (status == BW_OK) *done += count;
    return status;
}

static bw_status read_elements_4(reader *r) {
    int64_t count[4] = {0}, done = 0;
    bw_status status = read_counts(r, count, "blocks of elements");
    for (int64_t b = 0; b < count[0] && status == BW_OK; b++) status = read_element_block(r, &done, count[1]);
    if (status == BW_OK && done != count[1])
        status = bw_scan_fail(&r->scan, BW_E_COUNT, "%lld elements where %lld are announced", (long long)done,
                              (long long)count[1]);
    return status;
}

static bw_status read_elements(reader *r) {
    int64_t twice;
    if (!r->mesh->position) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "elements come before the nodes");
    if (r->has_elements) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "there are elements already");
    r->has_elements = true;
    bw_status status = r->version_4 ? read_elements_4(r) : read_elements_2(r);
    if (status == BW_OK && !bw_tags_end(&r->cells, &twice))
        status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "two cells have the tag %lld", (long long)twice);
    return status == BW_OK ? expect_end(r, "Elements") : status;
}

/* ---- data ---------------------------------------------------------------------------------------------- */

static bw_status pass_values(reader *r, int64_t count) {
    const char *bytes;
    bw_word word;
    bw_status status = bw_scan_count(&r->scan, "values", count, INT64_MAX / 8, r->binary ? 8 : 2);
    if (status == BW_OK && r->binary) return bw_scan_bytes(&r->scan, (size_t)count * 8, &bytes);
    for (int64_t i = 0; i < count && status == BW_OK; i++) status = bw_scan_word(&r->scan, &word);
    return status;
}

/* String tags (the first is the name), real tags, integer tags: time step, components, rows. They are text in
 * binary files, too. */
static bw_status read_view_header(reader *r, view *v, int64_t *components) {
    bw_scan *s = &r->scan;
    int64_t strings = 0, reals = 0, wholes = 0, value = 0;
    bw_status status = bw_scan_whole(s, &strings);
    if (status == BW_OK) status = bw_scan_count(s, "string tags", strings, INT32_MAX, 2);
    bw_scan_line(s);
    for (int64_t i = 0; i < strings && status == BW_OK; i++) {
        bw_word name = bw_scan_line(s);
        while (name.length && *name.text == '"') name.text++, name.length--;
        while (name.length && name.text[name.length - 1] == '"') name.length--;
        if (i == 0) bw_word_show(name, v->name, sizeof v->name);
    }
    if (status == BW_OK) status = bw_scan_whole(s, &reals);
    if (status == BW_OK) status = bw_scan_count(s, "real tags", reals, INT32_MAX, 2);
    double real;
    for (int64_t i = 0; i < reals && status == BW_OK; i++) status = bw_scan_number(s, &real);
    if (status == BW_OK) status = bw_scan_whole(s, &wholes);
    if (status == BW_OK) status = bw_scan_count(s, "integer tags", wholes, INT32_MAX, 2);
    if (status == BW_OK && wholes < 3)
        status = bw_scan_fail(s, BW_E_SYNTAX, "a view needs three integer tags");
    for (int64_t i = 0; i < wholes && status == BW_OK; i++) {
        status = bw_scan_whole(s, &value);
        if (i == 1) *components = value;
        if (i == 2) v->rows = value;
    }
    if (r->binary) bw_scan_line(s);
    return status;
}

static bw_status read_view(reader *r) {
    view v = {.rows = 0};
    int64_t components = 0, tag, nodes = 0;
    bw_status status = read_view_header(r, &v, &components);
    if (status == BW_OK)
        status = bw_scan_count(&r->scan, "rows", v.rows, BW_INPUT_CELLS_MAX, r->binary ? 8 : 4);
    if (status == BW_OK) status = bw_scan_count(&r->scan, "components", components, 1 << 16, 0);
    if (status != BW_OK) return status;
    v.scan = r->scan;
    v.scan.part = true;
    if (components == 3) {
        if ((status = bw_reserve(r->ctx, &r->view, &r->view_room, r->view_count + 1)) != BW_OK) return status;
        r->view[r->view_count++] = v;
    }
    for (int64_t i = 0; i < v.rows && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "row", i);
        if (status == BW_OK) status = take_int(r, &tag);
        if (status == BW_OK) status = take_int(r, &nodes);
        if (status == BW_OK) status = bw_scan_count(&r->scan, "nodes", nodes, 1 << 16, 0);
        if (status == BW_OK) status = pass_values(r, nodes * components);
    }
    return status == BW_OK ? expect_end(r, "ElementNodeData") : status;
}

static const char *view_name(const void *user, size_t i) {
    return ((const view *)user)[i].name;
}

static bw_status take_row(reader *r, uint8_t *given) {
    int64_t tag = 0, nodes = 0;
    bw_status status = take_int(r, &tag);
    if (status == BW_OK) status = take_int(r, &nodes);
    if (status != BW_OK) return status;
    if (nodes != 4) return pass_values(r, 3 * nodes);
    int64_t tet = bw_tags_find(&r->cells, tag);
    if (tet < 0)
        return bw_scan_fail(&r->scan, BW_E_INDEX, "there is no tet with the tag %lld", (long long)tag);
    if (given[tet])
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "the tet with the tag %lld has parameters already",
                            (long long)tag);
    given[tet] = 1;
    r->scan.kind = "tet", r->scan.record = tet;
    for (int i = 0; i < 12 && status == BW_OK; i++)
        status = take_real(r, &r->mesh->parameter[tet][i / 3][i % 3]);
    return status;
}

static bw_status read_parameters(reader *r) {
    int64_t best = bw_input_choose(view_name, r->view, r->view_count);
    if (best == -1)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX,
                            "no $ElementNodeData has 3 components: the parametrization is missing");
    if (best == -2)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX,
                            "%zu views have 3 components, and none is named parametrization, uvw or param",
                            r->view_count);
    bw_tet_mesh *m = r->mesh;
    r->scan = r->view[best].scan;
    int64_t rows = r->view[best].rows;
    if ((size_t)rows < m->tet_count)
        return bw_scan_fail(&r->scan, BW_E_TRUNCATED, "%lld rows of parameters for %zu tets", (long long)rows,
                            m->tet_count);
    uint8_t *given = bw_alloc(r->ctx, m->tet_count, 1);
    m->parameter = bw_alloc(r->ctx, m->tet_count, sizeof *m->parameter);
    bw_status status = given && m->parameter ? BW_OK : r->ctx->error.status;
    for (int64_t i = 0; i < rows && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "row", i);
        if (status == BW_OK) status = take_row(r, given);
    }
    for (size_t t = 0; t < m->tet_count && status == BW_OK; t++)
        if (!given[t]) {
            r->scan.kind = "tet", r->scan.record = (int64_t)t;
            status = bw_scan_fail(&r->scan, BW_E_TRUNCATED, "it has no parameters");
        }
    bw_free(r->ctx, given);
    return status;
}

/* ---- the file ------------------------------------------------------------------------------------------ */

static bw_status read_format(reader *r) {
    bw_scan *s = &r->scan;
    bw_word word, version = {0};
    int64_t type = 0, size = 0;
    char text[40];
    bw_status status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, "$MeshFormat"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "the file does not begin with $MeshFormat");
    if (status == BW_OK) status = bw_scan_word(s, &version);
    if (status == BW_OK) status = bw_scan_whole(s, &type);
    if (status == BW_OK) status = bw_scan_whole(s, &size);
    if (status != BW_OK) return status;
    r->version_4 = bw_word_is(version, "4.1");
    if (!r->version_4 && !bw_word_is(version, "2.2") && !bw_word_is(version, "2.1") &&
        !bw_word_is(version, "2"))
        return bw_scan_fail(s, BW_E_SYNTAX, "version '%s' is not read; 4.1 and 2.2 are",
                            bw_word_show(version, text, sizeof text));
    if (type < 0 || type > 1 || size != 8)
        return bw_scan_fail(s, BW_E_SYNTAX,
                            "the file type is neither 0 (text) nor 1 (binary) with sizes of 8 bytes");
    r->binary = s->binary = type;
    bw_scan_line(s);
    if (r->binary) {
        int64_t one = 0;
        status = take_int(r, &one);
        r->swap = one == 1 << 24;
        if (status == BW_OK && one != 1 && !r->swap)
            status = bw_scan_fail(s, BW_E_SYNTAX, "the mark of the byte order is neither");
    }
    return status == BW_OK ? expect_end(r, "MeshFormat") : status;
}

/* To after "$End<name>". */
static bw_status pass_section(reader *r, bw_word name) {
    bw_scan *s = &r->scan;
    char text[40], end[40];
    bw_word_show(name, text, sizeof text);
    if (name.length > 30) return bw_scan_fail(s, BW_E_SYNTAX, "a section '$%s'", text);
    int length = snprintf(end, sizeof end, "$End%s", text);
    const char *found = memmem(s->at, bw_scan_left(s), end, (size_t)length);
    if (!found) return bw_scan_fail(s, BW_E_TRUNCATED, "the section $%s does not end", text);
    for (; s->at < found; s->at++) s->line += *s->at == '\n';
    s->at += length;
    return BW_OK;
}

static bw_status read_section(reader *r, bw_word word) {
    char text[40];
    if (!bw_word_starts(word, "$") || bw_word_starts(word, "$End"))
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "'%s' stands where a section is due",
                            bw_word_show(word, text, sizeof text));
    bool text_section =
        bw_word_is(word, "$PhysicalNames") || bw_word_is(word, "$ElementNodeData") || !r->version_4;
    if (r->binary && !text_section) bw_scan_line(&r->scan); /* binary values begin on the next line */
    if (bw_word_is(word, "$PhysicalNames")) return read_names(r);
    if (bw_word_is(word, "$Entities") && r->version_4) return read_entities(r);
    if (bw_word_is(word, "$Nodes")) return r->version_4 ? read_nodes_4(r) : read_nodes_2(r);
    if (bw_word_is(word, "$Elements")) return read_elements(r);
    if (bw_word_is(word, "$ElementNodeData")) return read_view(r);
    return pass_section(r, (bw_word){word.text + 1, word.length - 1});
}

static void clear(reader *r) {
    bw_free(r->ctx, r->feature_group), bw_free(r->ctx, r->feature_entity), bw_free(r->ctx, r->view);
    bw_tags_clear(r->ctx, &r->nodes), bw_tags_clear(r->ctx, &r->cells);
}

static bw_status read_all(reader *r) {
    bw_status status = read_format(r);
    while (status == BW_OK && bw_scan_blanks(&r->scan)) {
        bw_word word;
        r->scan.kind = NULL;
        status = bw_poll(r->ctx);
        if (status == BW_OK) status = bw_scan_word(&r->scan, &word);
        if (status == BW_OK) status = read_section(r, word);
    }
    if (status != BW_OK) return status;
    if (!r->has_elements)
        return bw_scan_fail(&r->scan, BW_E_TRUNCATED, "the input ends without %s",
                            r->mesh->position ? "elements" : "nodes");
    bw_tet_mesh *m = r->mesh;
    status = bw_input_check_cells(&r->scan, m);
    if (status == BW_OK && m->tet_count) status = bw_trim(r->ctx, &m->tet, &r->cell_room, m->tet_count);
    if (status == BW_OK && m->hex_count) status = bw_trim(r->ctx, &m->hex, &r->cell_room, m->hex_count);
    return status == BW_OK && m->tet_count ? read_parameters(r) : status;
}

bw_status bw_msh_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    reader r = {.scan = bw_scan_open(ctx, data, size), .ctx = ctx, .mesh = mesh};
    bw_status status = read_all(&r);
    if (status == BW_OK) bw_progress(ctx, 1);
    clear(&r);
    if (status != BW_OK) bw_tet_mesh_clear(ctx, mesh);
    return status;
}
