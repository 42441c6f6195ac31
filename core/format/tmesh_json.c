#include "format/tmesh_json.h"

#include <stdlib.h>

#include "format/output.h"

typedef struct {
    bw_output out;
    const bw_tmesh *mesh;
    const double (*position)[3];
} writer;

static void put_key(writer *w, const char *key, bool first) {
    bw_put_text(&w->out, first ? "{\"" : ", \"");
    bw_put_text(&w->out, key);
    bw_put_text(&w->out, "\": ");
}

static void put_count(writer *w, const char *key, bool first, int64_t value) {
    put_key(w, key, first);
    bw_put_integer(&w->out, value);
}

static void put_flag(writer *w, const char *key, int value) {
    put_key(w, key, false);
    bw_put_text(&w->out, value ? "true" : "false");
}

/* A knot; as text if a double does not hold it. */
static void put_knot(writer *w, int64_t value) {
    bool text = llabs(value) >= (int64_t)1 << 53;
    if (text) bw_put_text(&w->out, "\"");
    bw_put_integer(&w->out, value);
    if (text) bw_put_text(&w->out, "\"");
}

static void put_knots(writer *w, const char *key, bool first, const int64_t value[3]) {
    put_key(w, key, first);
    for (int k = 0; k < 3; k++) {
        bw_put_text(&w->out, k ? ", " : "[");
        put_knot(w, value[k]);
    }
    bw_put_text(&w->out, "]");
}

static void put_list(writer *w, const char *key, bool first, const int32_t *value, size_t count) {
    put_key(w, key, first);
    bw_put_text(&w->out, "[");
    for (size_t i = 0; i < count; i++) {
        if (i) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, value[i]);
    }
    bw_put_text(&w->out, "]");
}

/* ---- elements ------------------------------------------------------------------------------------------------------ */

static void put_vertex(writer *w, size_t i) {
    put_key(w, "position", true);
    for (int k = 0; k < 3; k++) {
        bw_put_text(&w->out, k ? ", " : "[");
        bw_put_number(&w->out, w->position[i][k]);
    }
    bw_put_text(&w->out, "]");
    put_flag(w, "boundary", w->mesh->vertex_flags[i] & BW_TVERTEX_BOUNDARY);
    put_flag(w, "extraordinary", w->mesh->vertex_flags[i] & BW_TVERTEX_EXTRAORDINARY);
}

static void put_cell(writer *w, size_t i) {
    const bw_tcell *cell = &w->mesh->cell[i];
    put_count(w, "block", true, cell->block);
    put_knots(w, "low", false, cell->low);
    put_knots(w, "high", false, cell->high);
    put_list(w, "corners", false, cell->corner, 8);
}

static void put_face(writer *w, size_t i) {
    const bw_tface *face = &w->mesh->face[i];
    const int32_t side[2] = {face->side[0], face->side[1]};
    size_t cells = face->cell[1] == BW_NONE ? 1 : 2;
    put_list(w, "cells", true, face->cell, cells);
    put_list(w, "sides", false, side, cells);
    put_knots(w, "low", false, face->low);
    put_knots(w, "high", false, face->high);
    put_key(w, "patch", false);
    if (face->patch == BW_NONE) bw_put_text(&w->out, "null");
    else bw_put_integer(&w->out, face->patch);
}

/* False for a patch on the boundary, which has none. */
static bool put_transition(writer *w, size_t patch, bool first) {
    if (w->mesh->atlas->complex->patch_block[patch][1] == BW_NONE) return false;
    bw_transition t = bw_tmesh_out(w->mesh->atlas, (bw_patch)patch, 0);
    int32_t turn[3];
    for (int k = 0; k < 3; k++) turn[k] = bw_rotation_sign[t.rotation][k] * (bw_rotation_axis[t.rotation][k] + 1);
    bw_put_text(&w->out, first ? "\n" : ",\n");
    put_count(w, "patch", true, (int64_t)patch);
    put_list(w, "rotation", false, turn, 3);
    put_knots(w, "shift", false, t.shift);
    bw_put_text(&w->out, "}");
    return true;
}

static void put_joint(writer *w, size_t i) {
    const bw_tjoint *joint = &w->mesh->joint[i];
    int32_t axis[3];
    size_t axes = 0;
    for (int k = 0; k < 3; k++)
        if (joint->inside >> k & 1) axis[axes++] = k;
    put_count(w, "vertex", true, joint->vertex);
    put_count(w, "cell", false, joint->cell);
    put_list(w, "axes", false, axis, axes);
}

/* False for an arc that is not extraordinary. */
static bool put_arc(writer *w, size_t arc, bool first) {
    const bw_complex *x = w->mesh->atlas->complex;
    size_t count;
    if (!w->mesh->thickness[arc]) return false;
    const int32_t *vertex = bw_tmesh_along(w->mesh, (bw_arc)arc, &count);
    bw_put_text(&w->out, first ? "\n" : ",\n");
    put_count(w, "arc", true, (int64_t)arc);
    put_count(w, "quarters", false, x->arc_quarters[arc]);
    put_flag(w, "boundary", x->arc_flags[arc] & BW_ARC_BOUNDARY);
    put_key(w, "thickness", false);
    put_knot(w, w->mesh->thickness[arc]);
    put_list(w, "vertices", false, vertex, count);
    bw_put_text(&w->out, "}");
    return true;
}

/* ---- the file ------------------------------------------------------------------------------------------------------ */

static void put_head(writer *w, const char *kind) {
    const bw_atlas *atlas = w->mesh->atlas;
    bool hexes = atlas->length != atlas->complex->arc_length;
    put_key(w, "format", true);
    bw_put_text(&w->out, "\"blockwright-tmesh\"");
    put_count(w, "version", false, BW_TMESH_VERSION);
    put_key(w, "complex", false);
    bw_put_text(&w->out, "\""), bw_put_text(&w->out, kind), bw_put_text(&w->out, "\",\n\"knots\": {\"of\": ");
    bw_put_text(&w->out, hexes ? "\"hexes\"" : "\"map\"");
    put_count(w, "exponent", false, (hexes ? 0 : atlas->cells->map->exponent) + 2); /* BW_TMESH_UNIT is 2^2 */
    bw_put_text(&w->out, "},\n\"counts\": ");
    put_count(w, "blocks", true, (int64_t)atlas->complex->block_count);
    put_count(w, "cells", false, (int64_t)w->mesh->cell_count);
    put_count(w, "vertices", false, (int64_t)w->mesh->vertex_count);
    put_count(w, "faces", false, (int64_t)w->mesh->face_count);
    put_count(w, "t_joints", false, (int64_t)w->mesh->joint_count);
    bw_put_text(&w->out, "}");
    _Static_assert(BW_TMESH_UNIT == 4, "exponent");
}

static void put_section(writer *w, const char *name, size_t count, void (*put)(writer *, size_t)) {
    bw_put_text(&w->out, ",\n\""), bw_put_text(&w->out, name), bw_put_text(&w->out, "\": [");
    for (size_t i = 0; i < count; i++) {
        bw_put_text(&w->out, i ? ",\n" : "\n");
        put(w, i);
        bw_put_text(&w->out, "}");
    }
    bw_put_text(&w->out, "]");
}

static void put_some(writer *w, const char *name, size_t count, bool (*put)(writer *, size_t, bool first)) {
    bool first = true;
    bw_put_text(&w->out, ",\n\""), bw_put_text(&w->out, name), bw_put_text(&w->out, "\": [");
    for (size_t i = 0; i < count; i++)
        if (put(w, i, first)) first = false;
    bw_put_text(&w->out, "]");
}

bw_status bw_tmesh_write(bw_context *ctx, const bw_tmesh *mesh, const double (*position)[3], const char *kind, const char *path, uint64_t *bytes) {
    const bw_complex *x = mesh->atlas->complex;
    writer w = {.mesh = mesh, .position = position};
    bw_output_open(ctx, &w.out, path);
    put_head(&w, kind);
    put_section(&w, "vertices", mesh->vertex_count, put_vertex);
    put_section(&w, "cells", mesh->cell_count, put_cell);
    put_section(&w, "faces", mesh->face_count, put_face);
    put_some(&w, "transitions", x->patch_count, put_transition);
    put_section(&w, "t_joints", mesh->joint_count, put_joint);
    put_some(&w, "extraordinary_arcs", x->arc_count, put_arc);
    bw_put_text(&w.out, "}\n");
    return bw_output_close(&w.out, bytes);
}
