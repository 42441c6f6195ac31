#include "format/ovm.h"

#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "format/input_mesh.h"

typedef enum { OF_VERTICES, OF_EDGES, OF_HALFEDGES, OF_FACES, OF_HALFFACES, OF_CELLS, OF_MESH, OWNERS } owner;

typedef struct {
    char name[80];
    bw_scan scan; /* at the first value */
} property;

typedef struct {
    bw_scan scan;
    bw_context *ctx;
    bw_tet_mesh *mesh;
    size_t count[OWNERS];
    bw_vertex (*edge)[2];
    int32_t (*face)[4];   /* [face]: halfedges; the last one is BW_NONE for a triangle */
    int32_t (*cell)[6];   /* [cell]: halffaces; a tet has four */
    uint8_t *used;        /* [halfface] by a cell */
    property *parameters; /* HFProps of type vec3d */
    size_t property_count, property_room;
    bool has_feature[OWNERS];
    bw_scan feature[OWNERS];
} reader;

/* ---- topology ------------------------------------------------------------------------------------------ */

static bw_status begin_list(reader *r, const char *title, const char *plural, int64_t most, uint64_t bytes,
                            int64_t *count) {
    bw_scan *s = &r->scan;
    bw_word word = {0};
    char text[40];
    s->kind = NULL;
    bw_status status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, title))
        status = bw_scan_fail(s, BW_E_SYNTAX, "'%s' stands where %s is due",
                              bw_word_show(word, text, sizeof text), title);
    if (status == BW_OK) status = bw_scan_whole(s, count);
    return status == BW_OK ? bw_scan_count(s, plural, *count, most, bytes) : status;
}

static bw_status read_vertices(reader *r) {
    int64_t count = 0;
    bw_tet_mesh *m = r->mesh;
    bw_status status = begin_list(r, "Vertices", "vertices", BW_INPUT_VERTICES_MAX, 6, &count);
    if (status == BW_OK && !(m->position = bw_alloc(r->ctx, (size_t)count, sizeof *m->position)))
        status = r->ctx->error.status;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "vertex", i);
        for (int k = 0; k < 3 && status == BW_OK; k++) status = bw_scan_number(&r->scan, &m->position[i][k]);
    }
    r->count[OF_VERTICES] = m->vertex_count = (size_t)count;
    return status;
}

static bw_status read_edges(reader *r) {
    int64_t count = 0;
    bw_status status = begin_list(r, "Edges", "edges", INT32_MAX / 2, 4, &count);
    if (status == BW_OK && !(r->edge = bw_alloc(r->ctx, (size_t)count, sizeof *r->edge)))
        status = r->ctx->error.status;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "edge", i);
        for (int k = 0; k < 2 && status == BW_OK; k++)
            status = bw_scan_index(&r->scan, 0, r->count[OF_VERTICES], &r->edge[i][k]);
    }
    r->count[OF_EDGES] = (size_t)count, r->count[OF_HALFEDGES] = 2 * (size_t)count;
    return status;
}

static bw_vertex start_of(const reader *r, int32_t halfedge) {
    return r->edge[halfedge >> 1][halfedge & 1];
}
static bw_vertex end_of(const reader *r, int32_t halfedge) {
    return r->edge[halfedge >> 1][1 - (halfedge & 1)];
}

static int sides_of(const int32_t face[4]) { return face[3] == BW_NONE ? 3 : 4; }

static bw_status read_face(reader *r, int32_t face[4]) {
    int64_t corners = 0;
    bw_status status = bw_scan_whole(&r->scan, &corners);
    if (status == BW_OK && corners != 3 && corners != 4)
        status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "%lld corners; only triangles and quads are read", (long long)corners);
    face[3] = BW_NONE;
    for (int k = 0; k < corners && status == BW_OK; k++)
        status = bw_scan_index(&r->scan, 0, r->count[OF_HALFEDGES], &face[k]);
    for (int k = 0; k < corners && status == BW_OK; k++)
        if (end_of(r, face[k]) != start_of(r, face[(k + 1) % corners]))
            status = bw_scan_fail(&r->scan, BW_E_SYNTAX, "its halfedges are no closed walk");
    return status;
}

static bw_status read_faces(reader *r) {
    int64_t count = 0;
    bw_status status = begin_list(r, "Faces", "faces", INT32_MAX / 2, 8, &count);
    if (status == BW_OK && !(r->face = bw_alloc(r->ctx, (size_t)count, sizeof *r->face)))
        status = r->ctx->error.status;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "face", i);
        if (status == BW_OK) status = read_face(r, r->face[i]);
    }
    r->count[OF_FACES] = (size_t)count, r->count[OF_HALFFACES] = 2 * (size_t)count;
    return status;
}

/* Corners of a halfface, in its sense; how many. Turned over, it starts at the same vertex. */
static int corners_of(const reader *r, int32_t halfface, bw_vertex corner[4]) {
    const int32_t *face = r->face[halfface >> 1];
    int n = sides_of(face);
    for (int i = 0; i < n; i++) corner[i] = start_of(r, face[halfface & 1 ? (n - i) % n : i]);
    return n;
}

/* The corner of a tet that a halfface of it does not have; -1 unless the others are the halfface's. */
static int opposite_of(const reader *r, const bw_vertex tet[4], int32_t halfface) {
    bw_vertex corner[4];
    if (corners_of(r, halfface, corner) != 3) return -1;
    int rest = 6;
    for (int i = 0; i < 3; i++) {
        int k = 0;
        while (k < 4 && tet[k] != corner[i]) k++;
        if (k == 4) return -1;
        rest -= k;
    }
    for (int i = 0; i < 3; i++) /* also where corners repeat */
        if (rest < 0 || rest > 3 || corner[i] == tet[rest] || corner[i] == corner[(i + 1) % 3]) return -1;
    return rest;
}

static bool make_tet(const reader *r, const int32_t *halfface, bw_vertex tet[4]) {
    bw_vertex first[4], corner[4];
    if (corners_of(r, halfface[0], first) != 3 || corners_of(r, halfface[1], corner) != 3) return false;
    memcpy(tet, first, 3 * sizeof *tet);
    tet[3] = BW_NONE;
    for (int i = 0; i < 3; i++)
        if (corner[i] != tet[0] && corner[i] != tet[1] && corner[i] != tet[2]) tet[3] = corner[i];
    unsigned seen = 0;
    for (int k = 0; k < 4 && tet[3] != BW_NONE; k++) {
        int opposite = opposite_of(r, tet, halfface[k]);
        if (opposite >= 0) seen |= 1u << opposite;
    }
    return seen == 15;
}

/* Where `from` is followed by `to` in a loop of four; -1: nowhere. */
static int step_in(const bw_vertex loop[4], bw_vertex from, bw_vertex to) {
    for (int i = 0; i < 4; i++)
        if (loop[i] == from && loop[(i + 1) & 3] == to) return i;
    return -1;
}

/* Corners by bits: around the first halfface, and what is across from them along the four quads at its sides. Seen from inside, its halffaces turn
 * counter-clockwise in the mesh that we write; whichever sense a file has, all cells have the same. */
static bool make_hex(const reader *r, const int32_t *halfface, bw_vertex hex[8]) {
    bw_vertex loop[6][4];
    unsigned seen = 1;
    for (int k = 0; k < 6; k++)
        if (corners_of(r, halfface[k], loop[k]) != 4) return false;
    for (int i = 0; i < 4; i++) hex[i] = loop[0][i], hex[4 + i] = BW_NONE;
    for (int i = 0; i < 4; i++)
        for (int k = 1; k < 6; k++) {
            int next = (i + 1) & 3, at = step_in(loop[k], hex[next], hex[i]);
            if (at < 0 || seen >> k & 1) continue;
            bw_vertex across[2] = {loop[k][(at + 2) & 3], loop[k][(at + 3) & 3]};
            if ((hex[4 + i] != BW_NONE && hex[4 + i] != across[0]) || (hex[4 + next] != BW_NONE && hex[4 + next] != across[1])) return false;
            hex[4 + i] = across[0], hex[4 + next] = across[1];
            seen |= 1u << k;
            break;
        }
    int last = __builtin_ctz(~seen & 63u);
    if (__builtin_popcount(seen) != 5) return false;
    for (int i = 0; i < 4; i++)
        if (step_in(loop[last], hex[4 + ((i + 1) & 3)], hex[4 + i]) < 0) return false;
    bw_input_from_ring(hex);
    return true;
}

/* The first cell says what all are. */
static bw_status choose_kind(reader *r, int64_t faces, size_t cells) {
    bw_tet_mesh *m = r->mesh;
    if (faces == 4 ? m->hex != NULL : m->tet != NULL)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "a %s among %s; the cells of a mesh are all of one kind, or it is not read", faces == 4 ? "tet" : "hex",
                            faces == 4 ? "hexes" : "tets");
    if (m->tet || m->hex) return BW_OK;
    if (faces == 6 && cells > (size_t)BW_INPUT_HEXES_MAX)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "more than the %lld hexes supported", (long long)BW_INPUT_HEXES_MAX);
    if (faces == 4) m->tet = bw_alloc(r->ctx, cells, sizeof *m->tet);
    else m->hex = bw_alloc(r->ctx, cells, sizeof *m->hex);
    return r->ctx->error.status;
}

static bw_status read_cell(reader *r, int64_t c, size_t cells) {
    bw_scan *s = &r->scan;
    int64_t faces = 0;
    bw_tet_mesh *m = r->mesh;
    bw_status status = bw_scan_whole(s, &faces);
    if (status == BW_OK && faces != 4 && faces != 6)
        status = bw_scan_fail(s, BW_E_SYNTAX, "%lld halffaces; only tets and hexes are read", (long long)faces);
    if (status == BW_OK) s->kind = faces == 4 ? "tet" : "hex", status = choose_kind(r, faces, cells);
    for (int k = 0; k < faces && status == BW_OK; k++)
        status = bw_scan_index(s, 0, r->count[OF_HALFFACES], &r->cell[c][k]);
    for (int k = 0; k < faces && status == BW_OK; k++) {
        if (r->used[r->cell[c][k]])
            status = bw_scan_fail(s, BW_E_SYNTAX, "halfface %d belongs to another cell already", r->cell[c][k]);
        else
            r->used[r->cell[c][k]] = 1;
    }
    if (status != BW_OK) return status;
    if (faces == 4 ? make_tet(r, r->cell[c], m->tet[m->tet_count++]) : make_hex(r, r->cell[c], m->hex[m->hex_count++])) return BW_OK;
    return bw_scan_fail(s, BW_E_SYNTAX, "its halffaces are not the sides of a %s", s->kind);
}

static bw_status read_cells(reader *r) {
    int64_t count = 0;
    bw_status status = begin_list(r, "Polyhedra", "cells", BW_INPUT_TETS_MAX, 10, &count);
    if (status == BW_OK && !(r->cell = bw_alloc(r->ctx, (size_t)count, sizeof *r->cell)))
        status = r->ctx->error.status;
    if (status == BW_OK && !(r->used = bw_alloc(r->ctx, r->count[OF_HALFFACES], 1)))
        status = r->ctx->error.status;
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_record(&r->scan, "cell", i);
        if (status == BW_OK) status = read_cell(r, i, (size_t)count);
    }
    r->scan.kind = NULL;
    r->count[OF_CELLS] = (size_t)count;
    return status;
}

/* ---- properties ---------------------------------------------------------------------------------------- */

static const char *const titles[OWNERS] = {"VProp", "EProp", "HEProp", "FProp", "HFProp", "CProp", "MProp"};

/* Numbers per element of the types whose values are known; 0: the values are passed line by line. */
static int numbers_of(bw_word type) {
    static const struct {
        const char *name;
        int numbers;
    } types[] = {{"int", 1},           {"unsigned int", 1}, {"uint", 1},  {"short", 1},  {"long", 1},
                 {"unsigned long", 1}, {"bool", 1},         {"float", 1}, {"double", 1}, {"vec2d", 2},
                 {"vec2f", 2},         {"vec3d", 3},        {"vec3f", 3}, {"vec4d", 4},  {"vec4f", 4}};
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (bw_word_is(type, types[i].name)) return types[i].numbers;
    return 0;
}

/* Whether the next property begins here: no value begins with a capital. */
static bool ends_properties(const bw_scan *s) {
    if (*s->at < 'A' || *s->at > 'Z') return false;
    for (int i = 0; i < OWNERS; i++)
        if (bw_word_starts((bw_word){s->at, bw_scan_left(s)}, titles[i])) return true;
    return false;
}

/* Values of unknown types (strings, vectors): to the line that begins the next property. */
static bw_status pass_lines(reader *r) {
    bw_status status = BW_OK;
    while (status == BW_OK && bw_scan_blanks(&r->scan) && !ends_properties(&r->scan)) {
        bw_scan_line(&r->scan);
        status = bw_poll(r->ctx);
    }
    return status;
}

static bw_status pass_values(reader *r, uint64_t count) {
    bw_word word;
    bw_status status = bw_scan_count(&r->scan, "values", (int64_t)count, INT64_MAX, 2);
    for (uint64_t i = 0; i < count && status == BW_OK; i++) {
        if (bw_scan_blanks(&r->scan) && ends_properties(&r->scan))
            return bw_scan_fail(&r->scan, BW_E_SYNTAX, "values are missing before this property");
        status = bw_scan_word(&r->scan, &word);
        if (status == BW_OK && i % 65536 == 0) status = bw_poll(r->ctx);
    }
    return status;
}

/* type "name", which may have blanks */
static bool split_title(bw_word line, bw_word *type, char name[80]) {
    const char *open = memchr(line.text, '"', line.length), *end = line.text + line.length;
    if (!open || end[-1] != '"' || end - 1 == open) return false;
    *type = (bw_word){line.text, (size_t)(open - line.text)};
    while (type->length && type->text[type->length - 1] == ' ') type->length--;
    bw_word_show((bw_word){open + 1, (size_t)(end - open - 2)}, name, 80);
    return true;
}

static bw_status read_property(reader *r, owner of) {
    bw_scan *s = &r->scan;
    bw_word line = bw_scan_line(s), type;
    char name[80], text[40];
    if (!split_title(line, &type, name))
        return bw_scan_fail(s, BW_E_SYNTAX, "'%s' stands where a type and a name in quotes are due",
                            bw_word_show(line, text, sizeof text));
    if (of == OF_HALFFACES && bw_word_is(type, "vec3d")) {
        bw_status status = bw_reserve(r->ctx, &r->parameters, &r->property_room, r->property_count + 1);
        if (status != BW_OK) return status;
        property *p = &r->parameters[r->property_count++];
        p->scan = *s;
        p->scan.part = true;
        snprintf(p->name, sizeof p->name, "%s",
                 strcasecmp(name, "HexHex::Parametrization") ? name : "parametrization");
    }
    if (!strcmp(name, "feature") && (of == OF_VERTICES || of == OF_EDGES || of == OF_FACES)) {
        if (!bw_word_is(type, "int") && !bw_word_is(type, "bool"))
            return bw_scan_fail(s, BW_E_SYNTAX, "the property feature is neither int nor bool");
        if (r->has_feature[of]) return bw_scan_fail(s, BW_E_SYNTAX, "a second %s feature", titles[of]);
        r->has_feature[of] = true;
        r->feature[of] = *s;
        r->feature[of].part = true;
    }
    uint64_t values = (uint64_t)numbers_of(type) * (of == OF_MESH ? 1 : r->count[of]);
    return numbers_of(type) ? pass_values(r, values) : pass_lines(r);
}

static bw_status read_properties(reader *r) {
    bw_scan *s = &r->scan;
    bw_status status = BW_OK;
    while (status == BW_OK && bw_scan_blanks(s)) {
        bw_word word;
        char text[40];
        status = bw_scan_word(s, &word);
        if (status != BW_OK) break;
        int of = 0;
        while (of < OWNERS && !bw_word_is(word, titles[of])) of++;
        if (of == OWNERS)
            return bw_scan_fail(s, BW_E_SYNTAX, "'%s' stands where a property is due",
                                bw_word_show(word, text, sizeof text));
        status = read_property(r, (owner)of);
    }
    return status;
}

/* ---- what they say ------------------------------------------------------------------------------------- */

static bw_status take_features(reader *r, owner of) {
    bw_scan *s = &r->feature[of];
    bw_input_room room = {{0}};
    bw_status status = BW_OK;
    if (!r->has_feature[of]) return BW_OK;
    for (size_t i = 0; i < r->count[of] && status == BW_OK; i++) {
        int64_t value = 0;
        bw_vertex corner[4] = {(bw_vertex)i};
        int corners = of == OF_EDGES ? 2 : 1;
        status = bw_scan_record(s,
                                of == OF_VERTICES ? "vertex"
                                : of == OF_EDGES  ? "edge"
                                                  : "face",
                                (int64_t)i);
        if (status == BW_OK) status = bw_scan_whole(s, &value);
        if (status != BW_OK || !value) continue;
        if (of == OF_EDGES) memcpy(corner, r->edge[i], sizeof r->edge[i]);
        if (of == OF_FACES) corners = corners_of(r, 2 * (int32_t)i, corner);
        status = bw_input_add_feature(r->ctx, r->mesh, &room, corners, corner);
    }
    return status;
}

static const char *property_name(const void *user, size_t i) {
    return ((const property *)user)[i].name;
}

/* The values of all halffaces, in their order, then to the corners opposite. */
static bw_status take_parameters(reader *r) {
    bw_tet_mesh *m = r->mesh;
    int64_t best = bw_input_choose(property_name, r->parameters, r->property_count);
    if (best == -1)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX,
                            "there is no HFProp of type vec3d: the parametrization is missing");
    if (best == -2)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX,
                            "%zu HFProps have the type vec3d, and none is named HexHex::Parametrization, "
                            "parametrization, uvw or param",
                            r->property_count);
    bw_scan *s = &r->parameters[best].scan;
    double(*value)[3] = bw_alloc(r->ctx, r->count[OF_HALFFACES], sizeof *value);
    m->parameter = bw_alloc(r->ctx, m->tet_count, sizeof *m->parameter);
    bw_status status = value && m->parameter ? BW_OK : r->ctx->error.status;
    for (size_t i = 0; i < r->count[OF_HALFFACES] && status == BW_OK; i++) {
        status = bw_scan_record(s, "halfface", (int64_t)i);
        for (int k = 0; k < 3 && status == BW_OK; k++) status = bw_scan_number(s, &value[i][k]);
    }
    for (size_t t = 0; t < m->tet_count && status == BW_OK; t++)
        for (int k = 0; k < 4; k++)
            memcpy(m->parameter[t][opposite_of(r, m->tet[t], r->cell[t][k])], value[r->cell[t][k]],
                   sizeof *value);
    bw_free(r->ctx, value);
    return status;
}

static bw_status read_all(reader *r) {
    bw_scan *s = &r->scan;
    bw_word word = {0};
    s->comment = '#';
    bw_status status = bw_scan_word(s, &word);
    if (status == BW_OK && bw_word_is(word, "OVMB"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "OpenVolumeMesh's binary form is not read, its text form is");
    if (status == BW_OK && !bw_word_is(word, "OVM"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "the file does not begin with OVM ASCII");
    if (status == BW_OK) status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, "ASCII"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "the file does not begin with OVM ASCII");
    if (status == BW_OK) status = read_vertices(r);
    if (status == BW_OK) status = read_edges(r);
    if (status == BW_OK) status = read_faces(r);
    if (status == BW_OK) status = read_cells(r);
    if (status == BW_OK && !r->count[OF_CELLS]) status = bw_fail(r->ctx, BW_E_EMPTY, "the input has no tets and no hexes");
    if (status == BW_OK) status = read_properties(r);
    if (status == BW_OK) status = take_features(r, OF_VERTICES);
    if (status == BW_OK) status = take_features(r, OF_EDGES);
    if (status == BW_OK) status = take_features(r, OF_FACES);
    if (status == BW_OK) status = bw_input_check_cells(s, r->mesh);
    return status == BW_OK && r->mesh->tet_count ? take_parameters(r) : status;
}

bw_status bw_ovm_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    reader r = {.scan = bw_scan_open(ctx, data, size), .ctx = ctx, .mesh = mesh};
    bw_status status = read_all(&r);
    if (status == BW_OK) bw_progress(ctx, 1);
    bw_free(ctx, r.edge), bw_free(ctx, r.face), bw_free(ctx, r.cell), bw_free(ctx, r.used),
        bw_free(ctx, r.parameters);
    if (status != BW_OK) bw_tet_mesh_clear(ctx, mesh);
    return status;
}
