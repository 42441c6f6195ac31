/* The sections of the report that follow from the data of a stage alone. */
#include <stdio.h>
#include <string.h>

#include "format/report_json.h"

#include <float.h>
#include <math.h>

void bw_report_fill_input(bw_report *report, const bw_tet_mesh *mesh) {
    report->has_input = true;
    snprintf(report->input.kind, sizeof report->input.kind, report->input.hexes ? "hex" : "tet");
    report->input.vertices = mesh->vertex_count;
    report->input.tets = mesh->tet_count;
    report->input.facets = mesh->facet_count;
    report->input.edges = mesh->edge_count;
    report->input.boundary_facets = 0;
    for (size_t f = 0; f < mesh->facet_count; f++)
        report->input.boundary_facets += mesh->facet_tet[f][1] == BW_NONE;
    report->input.feature_vertices = mesh->feature_vertex_count;
    report->input.feature_edges = mesh->feature_edge_count;
    report->input.feature_facets = mesh->feature_facet_count;
    report->input.mirrored = mesh->mirrored;
}

void bw_report_fill_singular(bw_report *report, const bw_tet_mesh *mesh, const bw_grid_map *map) {
    uint64_t count[2] = {0, 0};
    for (size_t e = 0; e < mesh->edge_count; e++)
        if (map->edge_flags[e] & BW_EDGE_SINGULAR) count[(map->edge_flags[e] & BW_EDGE_BOUNDARY) != 0]++;
    report->input.singular_edges = count[0] + count[1];
    report->input.singular_edges_interior = count[0];
    report->input.singular_edges_boundary = count[1];
}

/* Edges or facets that are whole, and no complex edges or polygons. */
static uint64_t count_none(const int32_t *list, size_t n) {
    uint64_t count = 0;
    for (size_t i = 0; i < n; i++) count += list[i] == BW_NONE;
    return count;
}

/* A cell that was cut has the section of its last cut as the first of its list. */
static bool was_cut(const bw_cells *cells, bw_tet tet) {
    return bw_cells_is_open(cells, tet) && cells->polygon[cells->list[tet]].kind == BW_IN_TET;
}

void bw_report_fill_trace(bw_report *report, const bw_cells *cells) {
    report->has_trace = true;
    report->trace.vertices = cells->vertex_count;
    report->trace.cells = cells->cell_count;
    report->trace.cut_cells = cells->cell_count - cells->mesh->tet_count;
    for (size_t t = 0; t < cells->mesh->tet_count; t++) report->trace.cut_cells += was_cut(cells, (bw_tet)t);
    report->trace.edges = count_none(cells->of_edge, cells->mesh->edge_count);
    report->trace.polygons = count_none(cells->of_facet, cells->mesh->facet_count);
    for (size_t e = 0; e < cells->edge_count; e++)
        report->trace.edges += bw_cells_edge_is_leaf(cells, (bw_cedge)e);
    for (size_t p = 0; p < cells->polygon_count; p++)
        report->trace.polygons += bw_cells_polygon_is_leaf(cells, (bw_polygon)p);
    bw_report_fill_walls(report, cells);
}

void bw_report_fill_walls(bw_report *report, const bw_cells *cells) {
    report->trace.wall_polygons = report->trace.boundary_polygons = 0;
    for (size_t p = 0; p < cells->polygon_count; p++) {
        if (!bw_cells_polygon_is_leaf(cells, (bw_polygon)p)) continue;
        int flags = cells->polygon[p].flags;
        report->trace.boundary_polygons += (flags & BW_BOUNDARY) != 0;
        report->trace.wall_polygons += (flags & BW_WALL) && !(flags & BW_BOUNDARY);
    }
}

/* The same counts are kept of the raw and of the reduced complex, in structs that have them as members of these names. */
#define FILL_COUNTS(into, complex)                                                                                    \
    do {                                                                                                              \
        (into)->nodes = (complex)->node_count, (into)->arcs = (complex)->arc_count;                                   \
        (into)->patches = (complex)->patch_count, (into)->blocks = (complex)->block_count;                            \
        (into)->singular_nodes = count_flag((complex)->node_flags, (complex)->node_count, BW_NODE_SINGULAR);          \
        (into)->t_arcs = count_flag((complex)->arc_flags, (complex)->arc_count, BW_ARC_T);                            \
        (into)->singular_arcs = count_flag((complex)->arc_flags, (complex)->arc_count, BW_ARC_SINGULAR);              \
        (into)->boundary_patches = count_flag((complex)->patch_flags, (complex)->patch_count, BW_PATCH_BOUNDARY);     \
        (into)->self_adjacent_patches = count_self_adjacent(complex);                                                 \
    } while (0)

static uint64_t count_flag(const uint8_t *flags, size_t n, int flag) {
    uint64_t count = 0;
    for (size_t i = 0; i < n; i++) count += (flags[i] & flag) != 0;
    return count;
}

static uint64_t count_self_adjacent(const bw_complex *complex) {
    uint64_t count = 0;
    for (size_t i = 0; i < complex->patch_count; i++) count += complex->patch_block[i][0] == complex->patch_block[i][1];
    return count;
}

void bw_report_fill_complex(bw_report *report, const bw_complex *complex, const char *kind) {
    report->has_complex = true;
    snprintf(report->complex.kind, sizeof report->complex.kind, "%s", kind);
    FILL_COUNTS(&report->complex.raw, complex);
    report->complex.raw.torus_splits = complex->torus_splits;
}

void bw_report_fill_reduced(bw_report *report, const bw_complex *complex, const char *mode) {
    report->has_reduced = true;
    snprintf(report->complex.reduced.mode, sizeof report->complex.reduced.mode, "%s", mode);
    FILL_COUNTS(&report->complex.reduced, complex);
}

void bw_report_fill_hex_quality(bw_report *report, const bw_hex_mesh *hex, const bw_hex_quality *quality, const bw_hex_distance *distance) {
    report->hex_quality.mesh = *quality;
    for (size_t i = 0; i < quality->worst_count; i++) {
        bw_hex h = quality->worst[i].hex;
        report->hex_quality.worst_block[i] = hex->block[h];
        memcpy(report->hex_quality.worst_ijk[i], hex->ijk[h], sizeof hex->ijk[h]);
    }
    report->hex_quality.to_input = distance->to_input, report->hex_quality.from_input = distance->from_input;
    report->hex_quality.to_curves = distance->curves;
    report->hex_quality.hausdorff = distance->to_input > distance->from_input ? distance->to_input : distance->from_input;
    report->hex_quality.hausdorff_relative = distance->diagonal > 0 ? report->hex_quality.hausdorff / distance->diagonal : 0;
    report->hex_quality.volume_difference = distance->input_volume > 0 ? quality->volume / distance->input_volume - 1 : 0;
    report->has_hex_quality = true;
}

void bw_report_fill_compression(bw_report *report, const bw_predict_report *p, int bits) {
    report->has_compression = true;
    report->compression.blocks = p->blocks;
    report->compression.vertices = p->vertices;
    report->compression.vertices_coded = p->vertices_coded;
    report->compression.coordinates_wrong = p->coordinates_wrong;
    report->compression.bits = (uint64_t)bits;
    report->compression.estimate_pooled = p->e_g_pooled;
    report->compression.estimate_blocks = p->e_g_blocks;
    report->compression.cube_ratio = p->cube_ratio;
    report->compression.cube_ratio_lengths = fmin(p->cube_ratio_lengths, DBL_MAX); /* JSON knows no infinity */
}

void bw_report_fill_written(bw_report *report, const bw_bwh_sizes *sizes, int bits, size_t vertices) {
    uint64_t bytes = sizes->header + sizes->shape + sizes->places;
    report->has_written = true;
    report->compression.written.bits = (uint64_t)bits;
    report->compression.written.error_max = 0;
    for (int k = 0; k < 3; k++)
        if (sizes->step[k] / 2 > report->compression.written.error_max) report->compression.written.error_max = sizes->step[k] / 2;
    report->compression.written.bytes = bytes;
    report->compression.written.bytes_header = sizes->header;
    report->compression.written.bytes_shape = sizes->shape;
    report->compression.written.bytes_places = sizes->places;
    report->compression.written.bits_per_vertex = 8 * (double)bytes / (double)vertices;
    report->compression.written.bits_per_vertex_places = 8 * (double)sizes->places / (double)vertices;
}
