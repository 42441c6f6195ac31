#include "format/state.h"

#include <stdlib.h>
#include <string.h>

#include "format/container.h"

/* All sizes, in a section of their own; they are read before anything else. Those of cells go from cell_vertex to distance, those of the
 * complex from node to torus_splits. */
typedef struct {
    uint64_t vertex, tet, facet, edge, wall, feature_vertex, feature_edge, feature_facet;
    uint64_t cell_vertex, cell_edge, cell_half, cell_polygon, cell, distance;
    uint64_t node, arc, patch, block, arc_edge, patch_polygon, patch_chain, block_side, block_edge, chart, torus_splits;
    uint64_t igm_vertex, igm_tet, igm_facet, igm_edge, igm_feature_vertex, igm_feature_edge, igm_feature_facet, hex_vertex, hex, source_vertex, source;
    int64_t exponent, igm_exponent, subdivide;
    uint8_t mirrored, has_cells, has_complex, has_length, has_igm, has_hex, has_source, source_renumbered;
} counts;

/* One array of the state: where its pointer is kept, and its shape. */
typedef struct {
    const char *tag;
    void **data;
    size_t elem_size, count;
    bool begins; /* offsets into another array, which ends at offset `end` */
    size_t end;
} field;

enum { FIELDS_MAX = 112 };

#define FIELD(tag, pointer, n) list[k++] = (field){tag, (void **)&(pointer), sizeof *(pointer), (size_t)(n), false, 0}
#define BEGINS(tag, pointer, n, end) list[k++] = (field){tag, (void **)&(pointer), sizeof(size_t), (size_t)(n) + 1, true, (size_t)(end)}

static size_t describe_igm(bw_igm *s, const counts *n, field *list) {
    size_t k = 0;
    FIELD("igm.position", s->mesh.position, n->igm_vertex);
    FIELD("igm.tet", s->mesh.tet, n->igm_tet);
    FIELD("igm.tet.id", s->mesh.tet_id, n->igm_tet);
    FIELD("igm.tet.facet", s->mesh.tet_facet, n->igm_tet);
    FIELD("igm.tet.edge", s->mesh.tet_edge, n->igm_tet);
    FIELD("igm.facet", s->mesh.facet, n->igm_facet);
    FIELD("igm.facet.tet", s->mesh.facet_tet, n->igm_facet);
    FIELD("igm.edge", s->mesh.edge, n->igm_edge);
    FIELD("igm.feat.v", s->mesh.feature_vertex, n->igm_feature_vertex);
    FIELD("igm.feat.e", s->mesh.feature_edge, n->igm_feature_edge);
    FIELD("igm.feat.f", s->mesh.feature_facet, n->igm_feature_facet);
    FIELD("igm.value", s->map.value, n->igm_tet);
    FIELD("igm.home", s->home, n->igm_tet);
    FIELD("igm.turn", s->map.turn, n->igm_facet);
    FIELD("igm.align", s->map.align, n->igm_facet);
    FIELD("igm.quarters", s->map.quarters, n->igm_edge);
    FIELD("igm.edge.flags", s->map.edge_flags, n->igm_edge);
    return k;
}

/* The hex mesh that was made, and the one that came in. */
static size_t describe_hexes(bw_hex_mesh *s, const char *const tag[6], uint64_t vertices, uint64_t hexes, field *list) {
    size_t k = 0;
    FIELD(tag[0], s->position, vertices);
    FIELD(tag[1], s->held, vertices);
    FIELD(tag[2], s->carrier, vertices);
    FIELD(tag[3], s->hex, hexes);
    FIELD(tag[4], s->block, hexes);
    FIELD(tag[5], s->ijk, hexes);
    return k;
}

static size_t describe(bw_state *s, const counts *n, field list[FIELDS_MAX]) {
    static const char *const hex[] = {"hex.position", "hex.held", "hex.carrier", "hex.corner", "hex.block", "hex.ijk"};
    static const char *const source[] = {"source.position", "source.held", "source.carrier", "source.corner", "source.block", "source.ijk"};
    size_t k = 0;
    FIELD("position", s->mesh.position, n->vertex);
    FIELD("tet", s->mesh.tet, n->tet);
    FIELD("tet.id", s->mesh.tet_id, n->tet);
    FIELD("tet.facet", s->mesh.tet_facet, n->tet);
    FIELD("tet.edge", s->mesh.tet_edge, n->tet);
    FIELD("facet", s->mesh.facet, n->facet);
    FIELD("facet.tet", s->mesh.facet_tet, n->facet);
    FIELD("edge", s->mesh.edge, n->edge);
    FIELD("wall", s->mesh.wall, n->wall);
    FIELD("wall.distance", s->mesh.wall_distance, n->wall);
    FIELD("feature.vertex", s->mesh.feature_vertex, n->feature_vertex);
    FIELD("feature.edge", s->mesh.feature_edge, n->feature_edge);
    FIELD("feature.facet", s->mesh.feature_facet, n->feature_facet);
    FIELD("value", s->map.value, n->tet);
    FIELD("turn", s->map.turn, n->facet);
    FIELD("align", s->map.align, n->facet);
    FIELD("quarters", s->map.quarters, n->edge);
    FIELD("edge.flags", s->map.edge_flags, n->edge);
    if (n->has_source) k += describe_hexes(&s->source, source, n->source_vertex, n->source, list + k);
    if (n->source_renumbered) FIELD("source.vertex", s->source_vertex, n->source_vertex);
    if (n->has_cells) {
        FIELD("cell.vertex", s->cells.vertex, n->cell_vertex);
        FIELD("cell.edge", s->cells.edge, n->cell_edge);
        FIELD("cell.half", s->cells.half, n->cell_half);
        FIELD("cell.polygon", s->cells.polygon, n->cell_polygon);
        FIELD("cell.first", s->cells.list, n->cell);
        FIELD("cell.tet", s->cells.cut_from, n->cell - n->tet);
        FIELD("section", s->cells.section, n->cell - n->tet);
        FIELD("distance", s->cells.distance, n->distance);
        FIELD("edge.whole", s->cells.of_edge, n->edge);
        FIELD("facet.whole", s->cells.of_facet, n->facet);
    }
    if (!n->has_complex) return k;
    FIELD("node.vertex", s->complex.node_vertex, n->node);
    FIELD("node.flags", s->complex.node_flags, n->node);
    FIELD("arc.node", s->complex.arc_node, n->arc);
    FIELD("arc.length", s->complex.arc_length, n->arc);
    FIELD("arc.quarters", s->complex.arc_quarters, n->arc);
    FIELD("arc.flags", s->complex.arc_flags, n->arc);
    BEGINS("arc.edge.begin", s->complex.arc_edge_begin, n->arc, n->arc_edge);
    FIELD("arc.edge", s->complex.arc_edge, n->arc_edge);
    FIELD("patch.block", s->complex.patch_block, n->patch);
    FIELD("patch.side", s->complex.patch_side, n->patch);
    FIELD("patch.extent", s->complex.patch_extent, n->patch);
    FIELD("patch.low", s->complex.patch_low, n->patch);
    FIELD("patch.distance", s->complex.patch_distance, n->patch);
    FIELD("patch.flags", s->complex.patch_flags, n->patch);
    BEGINS("patch.poly.begin", s->complex.patch_polygon_begin, n->patch, n->patch_polygon);
    FIELD("patch.poly", s->complex.patch_polygon, n->patch_polygon);
    BEGINS("patch.side.begin", s->complex.patch_chain_begin, 4 * n->patch, n->patch_chain);
    FIELD("patch.side.arc", s->complex.patch_chain, n->patch_chain);
    FIELD("patch.corner", s->complex.patch_corner, n->patch);
    FIELD("block.extent", s->complex.block_extent, n->block);
    FIELD("block.corner", s->complex.block_corner, n->block);
    BEGINS("block.side.begin", s->complex.block_side_begin, 6 * n->block, n->block_side);
    FIELD("block.side", s->complex.block_side, n->block_side);
    BEGINS("block.edge.begin", s->complex.block_edge_begin, 12 * n->block, n->block_edge);
    FIELD("block.edge", s->complex.block_edge, n->block_edge);
    FIELD("cell.block", s->complex.cell_block, n->cell);
    FIELD("cell.chart", s->complex.cell_chart, n->cell);
    FIELD("chart", s->complex.chart, n->chart);
    if (n->has_length) FIELD("arc.integer", s->length, n->arc);
    if (n->has_igm) k += describe_igm(&s->igm, n, list + k);
    if (n->has_hex) k += describe_hexes(&s->hex, hex, n->hex_vertex, n->hex, list + k);
    return k;
}

static counts count_state(const bw_state *s) {
    counts n;
    memset(&n, 0, sizeof n);
    const bw_tet_mesh *m = &s->mesh;
    const bw_cells *c = &s->cells;
    const bw_complex *x = &s->complex;
    n.vertex = m->vertex_count, n.tet = m->tet_count, n.facet = m->facet_count, n.edge = m->edge_count;
    n.wall = m->wall_count, n.feature_vertex = m->feature_vertex_count;
    n.feature_edge = m->feature_edge_count, n.feature_facet = m->feature_facet_count;
    n.exponent = s->map.exponent, n.mirrored = m->mirrored;
    n.has_cells = s->has_cells, n.has_complex = s->has_complex, n.has_length = s->length != NULL;
    n.has_igm = s->has_igm, n.has_hex = s->has_hex;
    if (s->has_igm) {
        const bw_tet_mesh *g = &s->igm.mesh;
        n.igm_vertex = g->vertex_count, n.igm_tet = g->tet_count, n.igm_facet = g->facet_count, n.igm_edge = g->edge_count;
        n.igm_feature_vertex = g->feature_vertex_count, n.igm_feature_edge = g->feature_edge_count, n.igm_feature_facet = g->feature_facet_count;
        n.igm_exponent = s->igm.map.exponent;
    }
    if (s->has_source) n.source_vertex = s->source.vertex_count, n.source = s->source.hex_count;
    n.has_source = s->has_source, n.source_renumbered = s->source_vertex != NULL;
    if (s->has_hex) n.hex_vertex = s->hex.vertex_count, n.hex = s->hex.hex_count, n.subdivide = s->hex.subdivide;
    if (s->has_cells) {
        n.cell_vertex = c->vertex_count, n.cell_edge = c->edge_count, n.cell_half = c->half_count;
        n.cell_polygon = c->polygon_count, n.cell = c->cell_count;
        n.distance = c->distance_count;
    }
    if (s->has_complex) {
        n.node = x->node_count, n.arc = x->arc_count, n.patch = x->patch_count, n.block = x->block_count;
        n.arc_edge = x->arc_edge_begin[n.arc], n.patch_polygon = x->patch_polygon_begin[n.patch];
        n.patch_chain = x->patch_chain_begin[4 * n.patch], n.block_side = x->block_side_begin[6 * n.block];
        n.block_edge = x->block_edge_begin[12 * n.block], n.chart = x->chart_count, n.torus_splits = x->torus_splits;
    }
    return n;
}

static void set_counts(bw_state *s, const counts *n) {
    bw_tet_mesh *m = &s->mesh;
    bw_cells *c = &s->cells;
    bw_complex *x = &s->complex;
    m->vertex_count = n->vertex, m->tet_count = n->tet, m->facet_count = n->facet, m->edge_count = n->edge;
    m->wall_count = n->wall, m->feature_vertex_count = n->feature_vertex;
    m->feature_edge_count = n->feature_edge, m->feature_facet_count = n->feature_facet;
    m->mirrored = n->mirrored, m->of_hexes = n->has_source, s->map.exponent = (int32_t)n->exponent;
    s->has_cells = n->has_cells, s->has_complex = n->has_complex;
    c->mesh = m, c->map = &s->map;
    c->vertex_count = c->vertex_room = n->cell_vertex, c->edge_count = c->edge_room = n->cell_edge;
    c->half_count = c->half_room = n->cell_half, c->polygon_count = c->polygon_room = n->cell_polygon;
    c->distance_count = c->distance_room = n->distance;
    c->cell_count = c->cell_room = n->cell, c->cut_room = c->section_room = n->cell - (n->has_cells ? n->tet : 0);
    x->node_count = n->node, x->arc_count = n->arc, x->patch_count = n->patch, x->block_count = n->block;
    x->chart_count = n->chart, x->torus_splits = n->torus_splits, x->cell_count = n->cell;
    bw_tet_mesh *g = &s->igm.mesh;
    g->vertex_count = n->igm_vertex, g->tet_count = n->igm_tet, g->facet_count = n->igm_facet, g->edge_count = n->igm_edge;
    g->feature_vertex_count = n->igm_feature_vertex, g->feature_edge_count = n->igm_feature_edge, g->feature_facet_count = n->igm_feature_facet;
    s->has_igm = n->has_igm, s->igm.map.exponent = (int32_t)n->igm_exponent;
    s->has_source = n->has_source, s->source.vertex_count = n->source_vertex, s->source.hex_count = n->source, s->source.subdivide = 1;
    s->has_hex = n->has_hex, s->hex.vertex_count = n->hex_vertex, s->hex.hex_count = n->hex, s->hex.subdivide = (int32_t)n->subdivide;
}

void bw_state_init(bw_state *state) {
    memset(state, 0, sizeof *state);
    bw_report_init(&state->report);
}

void bw_state_clear(bw_context *ctx, bw_state *state) {
    bw_free(ctx, state->length);
    state->length = NULL;
    bw_complex_clear(ctx, &state->complex);
    bw_cells_clear(ctx, &state->cells);
    bw_grid_map_clear(ctx, &state->map);
    bw_tet_mesh_clear(ctx, &state->mesh);
    bw_hex_mesh_clear(ctx, &state->hex);
    bw_hex_mesh_clear(ctx, &state->source);
    bw_free(ctx, state->source_vertex);
    state->source_vertex = NULL;
    bw_igm_clear(ctx, &state->igm);
    state->has_cells = state->has_complex = state->has_igm = state->has_hex = state->has_source = false;
}

bw_status bw_state_write(bw_context *ctx, bw_state *state, const char *stage, int version, const char *path) {
    counts n = count_state(state);
    field list[FIELDS_MAX];
    bw_section section[FIELDS_MAX + 2];
    size_t fields = describe(state, &n, list);
    char *report = bw_report_to_json(&state->report);
    if (!report) return bw_fail(ctx, BW_E_MEMORY, "no memory for the report");
    section[0] = (bw_section){"counts", sizeof n, 1, &n};
    section[1] = (bw_section){"report", 1, strlen(report), report};
    for (size_t i = 0; i < fields; i++)
        section[i + 2] = (bw_section){list[i].tag, list[i].elem_size, list[i].count, *list[i].data};
    bw_status status = bw_container_write(ctx, path, stage, (uint32_t)version, section, fields + 2, true);
    free(report);
    return status;
}

/* What is not there has no size. The sizes of what is there are compared with their sections'. */
static bool counts_fit(const counts *n) {
    uint64_t any_cells = 0, any_complex = 0;
    for (const uint64_t *size = &n->cell_vertex; size <= &n->distance; size++) any_cells |= *size;
    for (const uint64_t *size = &n->node; size <= &n->torus_splits; size++) any_complex |= *size;
    uint64_t any_igm = 0;
    for (const uint64_t *size = &n->igm_vertex; size <= &n->igm_feature_facet; size++) any_igm |= *size;
    return n->has_cells <= 1 && n->has_complex <= n->has_cells && n->has_length <= n->has_complex &&
           (n->has_cells ? n->cell >= n->tet : !any_cells) && (n->has_complex || !any_complex) &&
           n->has_igm <= n->has_length && n->has_hex <= n->has_length && (n->has_igm || !any_igm) && (n->has_hex || !(n->hex | n->hex_vertex)) &&
           n->has_source <= 1 && n->source_renumbered <= n->has_source && (n->has_source || !(n->source | n->source_vertex)) &&
           n->exponent == (int32_t)n->exponent && n->igm_exponent == (int32_t)n->igm_exponent && n->subdivide == (int32_t)n->subdivide;
}

static bool begins_fit(const field *f, const size_t *begin) {
    for (size_t i = 0; i + 1 < f->count; i++)
        if (begin[i] > begin[i + 1]) return false;
    return begin[0] == 0 && begin[f->count - 1] == f->end;
}

static bw_status read_fields(bw_context *ctx, bw_state *state, const bw_container *file, const counts *n) {
    field list[FIELDS_MAX];
    if (!counts_fit(n)) return bw_fail(ctx, BW_E_IO, "the state file is damaged: its sizes contradict each other");
    size_t fields = describe(state, n, list);
    for (size_t i = 0; i < fields; i++) {
        const void *data = bw_container_section_of(file, list[i].tag, list[i].elem_size, list[i].count);
        if (!data) return ctx->error.status;
        if (list[i].begins && !begins_fit(&list[i], data))
            return bw_fail(ctx, BW_E_IO, "the state file is damaged: offsets in section '%s'", list[i].tag);
        void *copy = bw_alloc(ctx, list[i].count, list[i].elem_size);
        if (!copy) return ctx->error.status;
        memcpy(copy, data, list[i].count * list[i].elem_size);
        *list[i].data = copy;
    }
    set_counts(state, n);
    return BW_OK;
}

bw_status bw_state_read(bw_context *ctx, bw_state *state, const char *stage, int version, const char *path) {
    bw_container *file = NULL;
    bw_status status = bw_container_open(ctx, path, stage, (uint32_t)version, &file);
    if (status != BW_OK) return status;
    size_t length = 0;
    const counts *n = bw_container_section_of(file, "counts", sizeof *n, 1);
    const char *report = bw_container_section(file, "report", 1, &length);
    status = n && report ? read_fields(ctx, state, file, n) : ctx->error.status;
    if (status == BW_OK) status = bw_report_from_json(ctx, report, length, &state->report);
    bw_container_close(file);
    return status;
}
