#include "format/blocks_json.h"

#include <math.h>
#include <stdlib.h>

#include "format/output.h"

typedef struct {
    bw_output out;
    const bw_cells *cells;
    const bw_complex *c;
    const int64_t *length; /* [arc] or NULL */
} writer;

/* ---- patches and charts
 * ------------------------------------------------------------------------------------------ */

/* Whether a cell sees the polygon as part of that side of that block. */
static bool sees(const bw_cells *cells, const bw_complex *c, bw_cell cell, bw_polygon p, bw_block block,
                 uint8_t side) {
    if (cell == BW_NONE || c->cell_block[cell] != block) return false;
    bw_plane plane = bw_cells_polygon_plane(cells, p, bw_cells_tet(cells, cell));
    if (plane.axis < 0) return false;
    plane = bw_transition_plane(bw_complex_chart(c, cell), plane);
    return side == 2 * plane.axis + (plane.value != 0);
}

bw_cell bw_patch_cell(const bw_cells *cells, const bw_complex *c, bw_patch patch, bw_polygon polygon,
                      int which) {
    bw_block block = c->patch_block[patch][which];
    const bw_cell *cell = cells->polygon[polygon].cell;
    if (c->patch_block[patch][!which] != block) return cell[c->cell_block[cell[0]] == block ? 0 : 1];
    uint8_t side = c->patch_side[patch][which];
    if (c->patch_side[patch][!which] == side) return cell[which];
    return cell[sees(cells, c, cell[0], polygon, block, side) ? 0 : 1];
}

bw_transition bw_patch_transition(const bw_cells *cells, const bw_complex *c, bw_patch patch) {
    bw_transition back = bw_complex_across(cells, c, patch);
    return bw_transition_inverse(&back);
}

/* ---- values
 * ------------------------------------------------------------------------------------------------------ */

static void put_key(writer *w, const char *key, bool first) {
    bw_put_text(&w->out, first ? "{\"" : ", \"");
    bw_put_text(&w->out, key);
    bw_put_text(&w->out, "\": ");
}

static void put_flag(writer *w, const char *key, int value) {
    put_key(w, key, false);
    bw_put_text(&w->out, value ? "true" : "false");
}

static void put_grid(writer *w, int64_t value) {
    bool text = llabs(value) >= (int64_t)1 << 53; /* more than a double holds: readers would round it */
    if (text) bw_put_text(&w->out, "\"");
    bw_put_integer(&w->out, value);
    if (text) bw_put_text(&w->out, "\"");
}

static void put_parameter(writer *w, int64_t value) {
    bw_put_number(&w->out, ldexp((double)value, -w->cells->map->exponent));
}

static void put_lengths(writer *w, const char *key, const char *grid_key, const int64_t *value, int count) {
    for (int pass = 0; pass < 2; pass++) {
        put_key(w, pass ? grid_key : key, false);
        if (count > 1) bw_put_text(&w->out, "[");
        for (int i = 0; i < count; i++) {
            if (i) bw_put_text(&w->out, ", ");
            if (pass)
                put_grid(w, value[i]);
            else
                put_parameter(w, value[i]);
        }
        if (count > 1) bw_put_text(&w->out, "]");
    }
}

static void put_list(writer *w, const int32_t *value, size_t count) {
    bw_put_text(&w->out, "[");
    for (size_t i = 0; i < count; i++) {
        if (i) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, value[i]);
    }
    bw_put_text(&w->out, "]");
}

static void put_chain(writer *w, const bw_arc_use *use, size_t count) {
    bw_put_text(&w->out, "[");
    for (size_t i = 0; i < count; i++) {
        if (i) bw_put_text(&w->out, ", ");
        bw_put_integer(&w->out, use[i] & 1 ? -1 - (use[i] >> 1) : use[i] >> 1);
    }
    bw_put_text(&w->out, "]");
}

static void put_chains(writer *w, const char *key, const bw_arc_use *use, const size_t *begin, int count) {
    put_key(w, key, false);
    bw_put_text(&w->out, "[");
    for (int i = 0; i < count; i++) {
        if (i) bw_put_text(&w->out, ", ");
        put_chain(w, use + begin[i], begin[i + 1] - begin[i]);
    }
    bw_put_text(&w->out, "]");
}

/* ---- elements
 * ---------------------------------------------------------------------------------------------------- */

static void put_node(writer *w, size_t i, const double position[3]) {
    put_key(w, "vertex", true);
    bw_put_integer(&w->out, w->c->node_vertex[i]);
    put_key(w, "position", false);
    for (int k = 0; k < 3; k++) {
        bw_put_text(&w->out, k ? ", " : "[");
        bw_put_number(&w->out, position[k]);
    }
    bw_put_text(&w->out, "]");
    put_flag(w, "singular", w->c->node_flags[i] & BW_NODE_SINGULAR);
    put_flag(w, "boundary", w->c->node_flags[i] & BW_NODE_BOUNDARY);
}

static void put_arc(writer *w, size_t i) {
    put_key(w, "nodes", true);
    put_list(w, w->c->arc_node[i], 2);
    put_lengths(w, "length", "length_grid", &w->c->arc_length[i], 1);
    put_key(w, "quarters", false);
    bw_put_integer(&w->out, w->c->arc_quarters[i]);
    put_flag(w, "singular", w->c->arc_flags[i] & BW_ARC_SINGULAR);
    put_flag(w, "boundary", w->c->arc_flags[i] & BW_ARC_BOUNDARY);
    put_flag(w, "t", w->c->arc_flags[i] & BW_ARC_T);
    if (!w->length) return;
    put_key(w, "quantized", false);
    bw_put_integer(&w->out, w->length[i]);
}

static void put_transition(writer *w, bw_patch patch) {
    put_key(w, "transition", false);
    if (w->c->patch_block[patch][1] == BW_NONE) {
        bw_put_text(&w->out, "null");
        return;
    }
    bw_transition t = bw_patch_transition(w->cells, w->c, patch);
    int32_t turn[3];
    for (int k = 0; k < 3; k++)
        turn[k] = bw_rotation_sign[t.rotation][k] * (bw_rotation_axis[t.rotation][k] + 1);
    put_key(w, "rotation", true);
    put_list(w, turn, 3);
    put_key(w, "shift_grid", false);
    for (int k = 0; k < 3; k++) {
        bw_put_text(&w->out, k ? ", " : "[");
        put_grid(w, t.shift[k]);
    }
    bw_put_text(&w->out, "]}");
}

static void put_patch(writer *w, size_t i) {
    int flags = w->c->patch_flags[i];
    size_t sides = w->c->patch_block[i][1] == BW_NONE ? 1 : 2;
    const int32_t side[2] = {w->c->patch_side[i][0], w->c->patch_side[i][1]};
    put_key(w, "blocks", true);
    put_list(w, w->c->patch_block[i], sides);
    put_key(w, "sides", false);
    put_list(w, side, sides);
    put_lengths(w, "extent", "extent_grid", w->c->patch_extent[i], 2);
    put_lengths(w, "distance", "distance_grid", &w->c->patch_distance[i], 1);
    put_flag(w, "boundary", flags & BW_PATCH_BOUNDARY);
    put_flag(w, "singular", flags & BW_PATCH_SINGULAR);
    put_flag(w, "torus", flags & BW_PATCH_TORUS);
    put_key(w, "corners", false);
    put_list(w, w->c->patch_corner[i], 4);
    put_chains(w, "chains", w->c->patch_chain, w->c->patch_chain_begin + 4 * i, 4);
    put_transition(w, (bw_patch)i);
}

/* Extents in integers: along the low edge of each axis. */
static void put_hexes(writer *w, size_t block) {
    put_key(w, "hexes", false);
    for (size_t axis = 0; axis < 3; axis++) {
        size_t edge = 12 * block + 4 * axis;
        int64_t sum = 0;
        for (size_t i = w->c->block_edge_begin[edge]; i < w->c->block_edge_begin[edge + 1]; i++) sum += w->length[w->c->block_edge[i] >> 1];
        bw_put_text(&w->out, axis ? ", " : "[");
        bw_put_integer(&w->out, sum);
    }
    bw_put_text(&w->out, "]");
}

static void put_block(writer *w, size_t i, double volume) {
    put_key(w, "volume", true);
    bw_put_number(&w->out, volume);
    put_lengths(w, "extent", "extent_grid", w->c->block_extent[i], 3);
    if (w->length) put_hexes(w, i);
    put_key(w, "corners", false);
    put_list(w, w->c->block_corner[i], 8);
    put_key(w, "sides", false);
    for (size_t s = 6 * i; s < 6 * i + 6; s++) {
        bw_put_text(&w->out, s > 6 * i ? ", " : "[");
        put_list(w, w->c->block_side + w->c->block_side_begin[s],
                 w->c->block_side_begin[s + 1] - w->c->block_side_begin[s]);
    }
    bw_put_text(&w->out, "]");
    put_chains(w, "edges", w->c->block_edge, w->c->block_edge_begin + 12 * i, 12);
}

static void put_head(writer *w, const char *kind) {
    put_key(w, "format", true);
    bw_put_text(&w->out, "\"blockwright-blocks\"");
    put_key(w, "version", false);
    bw_put_integer(&w->out, BW_BLOCKS_VERSION);
    put_key(w, "complex", false);
    bw_put_text(&w->out, "\"");
    bw_put_text(&w->out, kind);
    bw_put_text(&w->out, "\",\n\"grid\": {\"exponent\": ");
    bw_put_integer(&w->out, w->cells->map->exponent);
    bw_put_text(&w->out, "},\n\"counts\": ");
    const struct {
        const char *key;
        size_t count;
    } counts[] = {{"nodes", w->c->node_count},
                  {"arcs", w->c->arc_count},
                  {"patches", w->c->patch_count},
                  {"blocks", w->c->block_count},
                  {"torus_splits", w->c->torus_splits}};
    for (size_t i = 0; i < sizeof counts / sizeof *counts; i++) {
        put_key(w, counts[i].key, i == 0);
        bw_put_integer(&w->out, (int64_t)counts[i].count);
    }
    bw_put_text(&w->out, "}");
}

bw_status bw_blocks_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const char *kind,
                          const int64_t *length, const double *volume, const double (*position)[3], const char *path,
                          uint64_t *bytes) {
    writer w = {.cells = cells, .c = complex, .length = length};
    bw_output_open(ctx, &w.out, path);
    put_head(&w, kind);
    static const char *const names[] = {"nodes", "arcs", "patches", "blocks"};
    const size_t counts[] = {complex->node_count, complex->arc_count, complex->patch_count,
                             complex->block_count};
    for (int list = 0; list < 4; list++) {
        bw_put_text(&w.out, ",\n\"");
        bw_put_text(&w.out, names[list]);
        bw_put_text(&w.out, "\": [");
        for (size_t i = 0; i < counts[list]; i++) {
            bw_put_text(&w.out, i ? ",\n" : "\n");
            if (list == 0) put_node(&w, i, position[complex->node_vertex[i]]);
            if (list == 1) put_arc(&w, i);
            if (list == 2) put_patch(&w, i);
            if (list == 3) put_block(&w, i, volume[i]);
            bw_put_text(&w.out, "}");
        }
        bw_put_text(&w.out, "]");
    }
    bw_put_text(&w.out, "}\n");
    return bw_output_close(&w.out, bytes);
}
