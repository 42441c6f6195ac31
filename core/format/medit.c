#include "format/medit.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "format/input_mesh.h"

typedef enum {
    NO_SECTION,
    DIMENSION,
    VERTICES,
    TETRAHEDRA,
    EDGES,
    TRIANGLES,
    QUADRILATERALS,
    HEXAHEDRA,
    PRISMS,
    PYRAMIDS,
    CORNERS,
    REQUIRED_VERTICES,
    RIDGES,
    REQUIRED_EDGES,
    REQUIRED_TRIANGLES,
    REQUIRED_QUADRILATERALS,
    END,
    SECTIONS
} section;

static const struct {
    const char *name;
    int code; /* in .meshb */
} sections[SECTIONS] = {[DIMENSION] = {"Dimension", 3},
                        [VERTICES] = {"Vertices", 4},
                        [TETRAHEDRA] = {"Tetrahedra", 8},
                        [EDGES] = {"Edges", 5},
                        [TRIANGLES] = {"Triangles", 6},
                        [QUADRILATERALS] = {"Quadrilaterals", 7},
                        [HEXAHEDRA] = {"Hexahedra", 10},
                        [PRISMS] = {"Prisms", 9},
                        [PYRAMIDS] = {"Pyramids", 49},
                        [CORNERS] = {"Corners", 13},
                        [REQUIRED_VERTICES] = {"RequiredVertices", 15},
                        [RIDGES] = {"Ridges", 14},
                        [REQUIRED_EDGES] = {"RequiredEdges", 16},
                        [REQUIRED_TRIANGLES] = {"RequiredTriangles", 17},
                        [REQUIRED_QUADRILATERALS] = {"RequiredQuadrilaterals", 18},
                        [END] = {"End", 54}};

/* A list of numbers into the vertices, edges or triangles. */
typedef struct {
    int32_t *item;
    size_t count;
} marks;

typedef struct {
    bw_scan scan;
    bw_context *ctx;
    bw_tet_mesh *mesh;
    bool binary, swap, wide_place, wide_number, single;
    bool seen[SECTIONS];
    bw_vertex (*edge)[2];
    bw_vertex (*triangle)[3];
    bw_vertex (*quad)[4];
    size_t edge_count, triangle_count, quad_count;
    marks mark[SECTIONS];
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

static bw_status take_whole(reader *r, bool wide, int64_t *value) {
    if (!r->binary) return bw_scan_whole(&r->scan, value);
    uint64_t bits;
    bw_status status = take_bits(r, wide ? 8 : 4, &bits);
    *value = wide ? (int64_t)bits : (int32_t)bits;
    return status;
}

static bw_status take_real(reader *r, double *value) {
    if (!r->binary) return bw_scan_number(&r->scan, value);
    uint64_t bits;
    bw_status status = take_bits(r, r->single ? 4 : 8, &bits);
    if (r->single) {
        float single;
        uint32_t low = (uint32_t)bits;
        memcpy(&single, &low, sizeof single);
        *value = (double)single;
    } else {
        memcpy(value, &bits, sizeof *value);
    }
    if (status == BW_OK && !isfinite(*value))
        return bw_scan_fail(&r->scan, BW_E_NUMBER, "%s is not a finite number",
                            isnan(*value) ? "nan" : "inf");
    return status;
}

static bw_status take_index(reader *r, size_t bound, int32_t *index) {
    int64_t value = 0;
    bw_status status = take_whole(r, r->wide_number, &value);
    if (status == BW_OK) status = bw_scan_check_index(&r->scan, value, 1, bound);
    if (status == BW_OK) *index = (int32_t)(value - 1);
    return status;
}

static uint64_t number_size(const reader *r) {
    return !r->binary ? 2 : r->wide_number ? 8 : 4;
}

/* ---- sections ------------------------------------------------------------------------------------------ */

static bw_status read_vertices(reader *r, int64_t count) {
    uint64_t real = !r->binary ? 2 : r->single ? 4 : 8;
    bw_tet_mesh *m = r->mesh;
    bw_status status =
        bw_scan_count(&r->scan, "vertices", count, BW_INPUT_VERTICES_MAX, 3 * real + number_size(r));
    if (status == BW_OK && !(m->position = bw_alloc(r->ctx, (size_t)count, sizeof *m->position)))
        status = r->ctx->error.status;
    int64_t reference;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "vertex", i);
        for (int k = 0; k < 3 && status == BW_OK; k++) status = take_real(r, &m->position[i][k]);
        if (status == BW_OK) status = take_whole(r, r->wide_number, &reference);
    }
    if (status == BW_OK) m->vertex_count = (size_t)count;
    return status;
}

/* Cells, faces or edges: `corners` vertices and a reference each. */
static bw_status read_elements(reader *r, const char *kind, const char *plural, int corners, int64_t count,
                               int64_t most, bw_vertex **list) {
    bw_status status = bw_scan_count(&r->scan, plural, count, most, (uint64_t)(corners + 1) * number_size(r));
    if (status == BW_OK && !r->seen[VERTICES])
        status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "%s come before the vertices", plural);
    if (status == BW_OK && !(*list = bw_alloc(r->ctx, (size_t)count, (size_t)corners * sizeof **list)))
        status = r->ctx->error.status;
    int64_t reference;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, kind, i);
        for (int k = 0; k < corners && status == BW_OK; k++)
            status = take_index(r, r->mesh->vertex_count, &(*list)[i * corners + k]);
        if (status == BW_OK) status = take_whole(r, r->wide_number, &reference);
    }
    return status;
}

/* What the numbers mean is checked at the end of the file: the lists that they point into may come later. */
static bw_status read_marks(reader *r, section which, int64_t count) {
    marks *m = &r->mark[which];
    bw_status status = bw_scan_count(&r->scan, "marks", count, INT32_MAX, number_size(r));
    if (status == BW_OK && !(m->item = bw_alloc(r->ctx, (size_t)count, sizeof *m->item)))
        status = r->ctx->error.status;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "mark", i);
        if (status == BW_OK) status = take_index(r, INT32_MAX, &m->item[i]);
    }
    if (status == BW_OK) m->count = (size_t)count;
    return status;
}

static bw_status refuse_cells(reader *r, const char *kind, int64_t count) {
    if (!count) return BW_OK;
    r->scan.kind = kind, r->scan.record = 0;
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "only meshes of tets, or of hexes, are read");
}

static bw_status read_section(reader *r, section which) {
    int64_t count = 0;
    if (which == END) return BW_OK;
    if (r->seen[which])
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "a second section %s", sections[which].name);
    bw_status status = take_whole(r, which != DIMENSION && r->wide_number, &count);
    if (status != BW_OK) return status;
    switch (which) {
    case DIMENSION:
        if (count != 3)
            status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "dimension %lld; only 3 is read", (long long)count);
        break;
    case VERTICES:
        status = read_vertices(r, count);
        break;
    case TETRAHEDRA:
        status = read_elements(r, "tet", "tets", 4, count, BW_INPUT_TETS_MAX, (bw_vertex **)&r->mesh->tet);
        if (status == BW_OK) r->mesh->tet_count = (size_t)count;
        break;
    case EDGES:
        status = read_elements(r, "edge", "edges", 2, count, INT32_MAX, (bw_vertex **)&r->edge);
        r->edge_count = (size_t)count;
        break;
    case TRIANGLES:
        status = read_elements(r, "triangle", "triangles", 3, count, INT32_MAX, (bw_vertex **)&r->triangle);
        r->triangle_count = (size_t)count;
        break;
    case QUADRILATERALS:
        status = read_elements(r, "quad", "quads", 4, count, INT32_MAX, (bw_vertex **)&r->quad);
        r->quad_count = (size_t)count;
        break;
    case HEXAHEDRA:
        status = read_elements(r, "hex", "hexes", 8, count, BW_INPUT_HEXES_MAX, (bw_vertex **)&r->mesh->hex);
        for (int64_t i = 0; i < count && status == BW_OK; i++) bw_input_from_ring(r->mesh->hex[i]);
        if (status == BW_OK) r->mesh->hex_count = (size_t)count;
        break;
    case PRISMS:
    case PYRAMIDS:
        status = refuse_cells(r, which == PRISMS ? "prism" : "pyramid", count);
        break;
    default:
        status = read_marks(r, which, count);
    }
    r->seen[which] = true;
    r->scan.kind = NULL;
    return status;
}

/* ---- features ------------------------------------------------------------------------------------------ */

/* The features of one kind: those in `first`, then those in `second` (NO_SECTION: none) that are not in
 * `first`. */
static bw_status take_features(reader *r, section first, section second, int corners, const bw_vertex *list,
                               size_t bound) {
    const section from[2] = {first, second};
    bw_input_room room = {{0}};
    if (!r->mark[first].count && !r->mark[second].count) return BW_OK;
    uint8_t *taken = bw_alloc(r->ctx, bound, 1);
    bw_status status = taken ? BW_OK : r->ctx->error.status;
    for (int s = 0; s < 2; s++)
        for (size_t i = 0; i < r->mark[from[s]].count && status == BW_OK; i++) {
            bw_vertex at = r->mark[from[s]].item[i];
            if ((size_t)at >= bound) {
                status = bw_scan_fail(&r->scan, BW_E_INDEX, "number %d in %s is outside 1..%zu", at + 1,
                                      sections[from[s]].name, bound);
            } else if (!taken[at]) {
                taken[at] = 1;
                status = bw_input_add_feature(r->ctx, r->mesh, &room, corners,
                                              list ? list + (size_t)at * (size_t)corners : &at);
            }
        }
    bw_free(r->ctx, taken);
    return status;
}

static bw_status take_all_features(reader *r) {
    bw_status status = take_features(r, CORNERS, REQUIRED_VERTICES, 1, NULL, r->mesh->vertex_count);
    if (status == BW_OK)
        status = take_features(r, RIDGES, REQUIRED_EDGES, 2, (const bw_vertex *)r->edge, r->edge_count);
    if (status == BW_OK)
        status = take_features(r, REQUIRED_TRIANGLES, NO_SECTION, 3, (const bw_vertex *)r->triangle,
                               r->triangle_count);
    if (status == BW_OK)
        status = take_features(r, REQUIRED_QUADRILATERALS, NO_SECTION, 4, (const bw_vertex *)r->quad, r->quad_count);
    return status;
}

/* ---- text ---------------------------------------------------------------------------------------------- */

static bool begins_number(bw_word word) {
    char c = *word.text;
    return (c >= '0' && c <= '9') || c == '-' || c == '+' || c == '.';
}

static bw_status read_text(reader *r) {
    bw_scan *s = &r->scan;
    bw_word word = {0};
    char text[40];
    int64_t version = 0;
    s->comment = '#';
    bw_status status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, "MeshVersionFormatted"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "the file does not begin with MeshVersionFormatted");
    if (status == BW_OK) status = bw_scan_whole(s, &version);
    bool passing = false;
    while (status == BW_OK && bw_scan_blanks(s)) {
        if ((status = bw_scan_word(s, &word)) != BW_OK) break;
        if (begins_number(word)) {
            if (passing) continue;
            return bw_scan_fail(s, BW_E_SYNTAX, "'%s' is more than the section holds",
                                bw_word_show(word, text, sizeof text));
        }
        section which = NO_SECTION;
        for (int i = 1; i < SECTIONS; i++)
            if (bw_word_is(word, sections[i].name)) which = (section)i;
        if (which == END) break;
        passing = which == NO_SECTION;
        if (!passing) status = read_section(r, which);
        if (status == BW_OK) status = bw_poll(r->ctx);
    }
    return status;
}

/* ---- binary -------------------------------------------------------------------------------------------- */

/* 1, the version; then sections: a code, the place of the next one (0 after the last), what it holds. */
static bw_status read_binary(reader *r) {
    bw_scan *s = &r->scan;
    int64_t mark = 0, version = 0, code = 0, next = 0;
    r->binary = s->binary = true;
    bw_status status = take_whole(r, false, &mark);
    r->swap = mark == 1 << 24;
    if (status == BW_OK) status = take_whole(r, false, &version);
    if (status == BW_OK && (version < 1 || version > 4))
        return bw_scan_fail(s, BW_E_SYNTAX, "version %lld is not read; 1 to 4 are", (long long)version);
    r->single = version == 1, r->wide_place = version >= 3, r->wide_number = version == 4;
    while (status == BW_OK && bw_scan_left(s)) {
        status = take_whole(r, false, &code);
        if (status == BW_OK) status = take_whole(r, r->wide_place, &next);
        if (status != BW_OK || code == sections[END].code) break;
        section which = NO_SECTION;
        for (int i = 1; i < SECTIONS; i++)
            if (sections[i].code == code) which = (section)i;
        if (next && (next <= s->at - s->data || next > s->end - s->data))
            return bw_scan_fail(s, next > 0 && next > s->end - s->data ? BW_E_TRUNCATED : BW_E_INDEX,
                                "the next section is at byte %lld, not after this one in the input",
                                (long long)next);
        if (which != NO_SECTION) status = read_section(r, which);
        if (status == BW_OK && next && s->at - s->data > next)
            status =
                bw_scan_fail(s, BW_E_SYNTAX, "section %s reaches into the next one", sections[which].name);
        if (status == BW_OK) status = bw_poll(r->ctx);
        if (!next) break;
        s->at = s->data + next;
    }
    return status;
}

/* ---- parameters ---------------------------------------------------------------------------------------- */

static bw_status parse_parameters(bw_tet_mesh *m, bw_scan *s) {
    bw_word word = {0};
    int64_t count = 0;
    char text[40];
    s->comment = '#';
    bw_status status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, "parameters"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "'%s' stands where the word parameters is due",
                              bw_word_show(word, text, sizeof text));
    if (status == BW_OK) status = bw_scan_whole(s, &count);
    if (status == BW_OK && (count < 0 || (size_t)count != m->tet_count))
        status = bw_scan_fail(s, BW_E_PARAMETERS, "parameters of %lld tets, but the mesh has %zu",
                              (long long)count, m->tet_count);
    if (status == BW_OK) status = bw_scan_count(s, "tets", count, BW_INPUT_TETS_MAX, 24);
    if (status == BW_OK && !(m->parameter = bw_alloc(s->ctx, (size_t)count, sizeof *m->parameter)))
        status = s->ctx->error.status;
    for (int64_t t = 0; t < count && status == BW_OK; t++) {
        status = bw_scan_record(s, "tet", t);
        for (int i = 0; i < 12 && status == BW_OK; i++)
            status = bw_scan_number(s, &m->parameter[t][i / 3][i % 3]);
    }
    s->kind = NULL;
    if (status == BW_OK && bw_scan_blanks(s))
        status = bw_scan_fail(s, BW_E_SYNTAX, "there is more text after the last tet");
    return status;
}

static bw_status read_parameters(reader *r, const void *data, size_t size) {
    if (r->mesh->hex_count)
        return !data ? BW_OK : bw_scan_fail(&r->scan, BW_E_PARAMETERS, "a mesh of hexes has no parameters, but a file of them was given");
    if (!data)
        return bw_scan_fail(
            &r->scan, BW_E_PARAMETERS,
            "a Medit mesh has no place for the parametrization: a side file with \"parameters %zu\" and "
            "twelve numbers per tet is missing",
            r->mesh->tet_count);
    bw_scan s = bw_scan_open(r->ctx, data, size);
    bool fresh = r->ctx->error.status == BW_OK;
    bw_status status = parse_parameters(r->mesh, &s);
    bw_error *error = &r->ctx->error;
    if (status != BW_OK && fresh &&
        bw_status_class(status) == BW_CLASS_INPUT) { /* tell which file it is about */
        char message[sizeof error->message];
        snprintf(message, sizeof message, "parameters: %.*s", (int)sizeof message - 20, error->message);
        memcpy(error->message, message, sizeof message);
    }
    return status;
}

bw_status bw_medit_read_memory(bw_context *ctx, const void *data, size_t size, const void *parameters,
                               size_t parameters_size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    reader r = {.scan = bw_scan_open(ctx, data, size), .ctx = ctx, .mesh = mesh};
    const char *first = data;
    bool binary = size >= 4 && (!memcmp(first, "\1\0\0\0", 4) || !memcmp(first, "\0\0\0\1", 4));
    bw_status status = binary ? read_binary(&r) : read_text(&r);
    if (status == BW_OK && !r.seen[TETRAHEDRA] && !r.seen[HEXAHEDRA])
        status = bw_scan_fail(&r.scan, BW_E_TRUNCATED, "the input ends without %s",
                              r.seen[VERTICES] ? "Tetrahedra or Hexahedra" : "Vertices");
    if (status == BW_OK) status = take_all_features(&r);
    if (status == BW_OK) status = bw_input_check_cells(&r.scan, mesh);
    if (status == BW_OK) status = read_parameters(&r, parameters, parameters_size);
    if (status == BW_OK) bw_progress(ctx, 1);
    bw_free(ctx, r.edge), bw_free(ctx, r.triangle), bw_free(ctx, r.quad);
    for (int i = 0; i < SECTIONS; i++) bw_free(ctx, r.mark[i].item);
    if (status != BW_OK) bw_tet_mesh_clear(ctx, mesh);
    return status;
}
