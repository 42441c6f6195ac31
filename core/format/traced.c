#include "format/traced.h"

#include <math.h>
#include <string.h>

#include "format/hexex_write.h"

typedef struct {
    bw_context *ctx;
    bw_tessellation *t;
    const bw_cells *cells;
    const bw_tet_mesh *mesh;
    bw_hexex_writer out;
    bw_traced_counts counts;
    const double (*position)[3]; /* [point] */
    double *cell_volume;
    bw_chart chart;
    bw_cell_tets tets;
    char *text;       /* parameters of the chart's points, printed */
    size_t *text_end; /* [slot] */
    size_t text_room, end_room, texts;
    bw_cvertex (*triangle)[3];
} writer;

/* ---- tets
 * -------------------------------------------------------------------------------------------------------- */

static bw_status print_new_points(writer *w) {
    for (; w->texts < w->chart.count; w->texts++) {
        size_t begin = w->texts ? w->text_end[w->texts - 1] : 0;
        bw_status status = bw_reserve(w->ctx, &w->text, &w->text_room, begin + BW_POINT_TEXT);
        if (status == BW_OK) status = bw_reserve(w->ctx, &w->text_end, &w->end_room, w->texts + 1);
        if (status != BW_OK) return status;
        w->text_end[w->texts] =
            begin + bw_points_print(&w->t->points, w->chart.point[w->texts], w->chart.tet, w->text + begin);
    }
    return BW_OK;
}

static double volume_in_space(const writer *w, const bw_point tet[4]) {
    double e[3][3];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[i][k] = w->position[tet[i + 1]][k] - w->position[tet[0]][k];
    return (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
            e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
            e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
           6;
}

static void put_tet(writer *w, const bw_point tet[4]) {
    int last = w->mesh->mirrored ? 2 : 3;
    const bw_point v[4] = {tet[0], tet[1], tet[5 - last], tet[last]};
    const char *number[12];
    for (int i = 0; i < 12; i++) {
        int32_t s = w->chart.slot[v[i / 3]];
        const char *before =
            i % 3 ? number[i - 1] + strlen(number[i - 1]) + 1 : w->text + (s ? w->text_end[s - 1] : 0);
        number[i] = before;
    }
    bw_hexex_write_tet_text(&w->out, v, number);
}

static bool is_uncut(const writer *w, const bw_point tet[4]) {
    for (int i = 0; i < 4; i++)
        if ((size_t)tet[i] >= w->mesh->vertex_count) return false;
    return true;
}

static bw_status write_cell(writer *w, bw_cell cell) {
    bw_status status = bw_tessellation_cell(w->ctx, w->t, &w->chart, cell, &w->tets);
    if (status == BW_OK) status = print_new_points(w);
    if (status != BW_OK) return status;
    bool uncut = w->tets.count == 1 && is_uncut(w, w->tets.tet[0]);
    double volume = 0;
    for (size_t i = 0; i < w->tets.count; i++) {
        const bw_point *tet = uncut ? w->mesh->tet[w->chart.tet] : w->tets.tet[i];
        put_tet(w, tet);
        volume += volume_in_space(w, tet);
    }
    if (w->cell_volume) w->cell_volume[cell] = fabs(volume);
    return BW_OK;
}

static bw_status write_tets(writer *w) {
    w->counts.tets = bw_tessellation_count(w->t);
    bw_hexex_write_tets(&w->out, w->counts.tets);
    size_t tets = w->mesh->tet_count;
    bw_status status = BW_OK;
    for (size_t tet = 0; tet < tets && status == BW_OK; tet++) {
        status = bw_chart_open(w->ctx, &w->chart, &w->t->points, (bw_tet)tet);
        w->texts = 0;
        for (size_t i = w->t->tet_begin[tet]; i < w->t->tet_begin[tet + 1] && status == BW_OK; i++)
            status = write_cell(w, w->t->tet_cell[i]);
        if (status == BW_OK && tet % 256 == 0) {
            status = bw_poll(w->ctx);
            bw_progress(w->ctx, (double)tet / (double)tets);
        }
    }
    return status;
}

/* ---- walls
 * ------------------------------------------------------------------------------------------------------- */

static void write_walls(writer *w) {
    for (size_t p = 0; p < w->cells->polygon_count; p++)
        if (w->t->size[p] && (w->cells->polygon[p].flags & BW_WALL))
            w->counts.walls += (uint64_t)w->t->size[p] - 2;
    bw_hexex_write_walls(&w->out, w->counts.walls);
    for (size_t p = 0; p < w->cells->polygon_count; p++) {
        if (!w->t->size[p] || !(w->cells->polygon[p].flags & BW_WALL)) continue;
        bw_tessellation_triangles(w->t, (bw_polygon)p, w->triangle);
        double distance = ldexp((double)bw_cells_distance(w->cells, (bw_polygon)p), -w->cells->map->exponent);
        for (int32_t i = 0; i < w->t->size[p] - 2; i++)
            bw_hexex_write_wall(&w->out, w->triangle[i], distance);
    }
}

/* ---- features: counted in a first pass, written in a second
 * ------------------------------------------------------- */

static int compare_lists(const bw_vertex *a, const bw_vertex *b, int count) {
    for (int i = 0; i < count; i++)
        if (a[i] != b[i]) return a[i] < b[i] ? -1 : 1;
    return 0;
}

/* Index of a vertex list among `total` ascending lists of `size` vertices; BW_NONE if it is not there. */
static int32_t find_list(const bw_vertex *lists, size_t total, int size, const bw_vertex *wanted) {
    bw_vertex key[3] = {0};
    for (int i = 0; i < size; i++) {
        int j = i;
        for (; j > 0 && key[j - 1] > wanted[i]; j--) key[j] = key[j - 1];
        key[j] = wanted[i];
    }
    size_t low = 0, high = total;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (compare_lists(lists + middle * (size_t)size, key, size) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low < total && !compare_lists(lists + low * (size_t)size, key, size) ? (int32_t)low : BW_NONE;
}

static uint64_t feature_edge_pieces(writer *w, bw_cedge e, bool write) {
    const bw_cell_edge *x = &w->cells->edge[e];
    if (!bw_cells_edge_is_leaf(w->cells, e))
        return feature_edge_pieces(w, bw_cells_edge_part(w->cells, e, 0), write) +
               feature_edge_pieces(w, bw_cells_edge_part(w->cells, e, 1), write);
    if (write) bw_hexex_write_feature_edge(&w->out, x->vertex);
    return 1;
}

static uint64_t feature_facet_pieces(writer *w, bw_polygon p, bool write) {
    if (!bw_cells_polygon_is_leaf(w->cells, p))
        return feature_facet_pieces(w, bw_cells_polygon_part(w->cells, p, 0), write) +
               feature_facet_pieces(w, bw_cells_polygon_part(w->cells, p, 1), write);
    bw_tessellation_triangles(w->t, p, w->triangle);
    for (int32_t i = 0; write && i < w->t->size[p] - 2; i++)
        bw_hexex_write_feature_facet(&w->out, w->triangle[i]);
    return (uint64_t)w->t->size[p] - 2;
}

/* Edges (size 2) or facets (size 3). */
static bw_status features_of(writer *w, int size, bool write, uint64_t *count) {
    const bw_tet_mesh *mesh = w->mesh;
    size_t total = size == 2 ? mesh->feature_edge_count : mesh->feature_facet_count;
    const bw_vertex *lists = size == 2 ? (const bw_vertex *)mesh->edge : (const bw_vertex *)mesh->facet;
    const bw_vertex *features =
        size == 2 ? (const bw_vertex *)mesh->feature_edge : (const bw_vertex *)mesh->feature_facet;
    for (size_t i = 0; i < total; i++) {
        int32_t at = find_list(lists, size == 2 ? mesh->edge_count : mesh->facet_count, size,
                               features + i * (size_t)size);
        if (at == BW_NONE)
            return bw_fail(w->ctx, BW_E_CHECK, "feature %s %zu is none of the mesh",
                           size == 2 ? "edge" : "facet", i);
        *count += size == 2 ? feature_edge_pieces(w, w->cells->of_edge[at], write)
                            : feature_facet_pieces(w, w->cells->of_facet[at], write);
    }
    return BW_OK;
}

static bw_status write_features(writer *w) {
    const bw_tet_mesh *mesh = w->mesh;
    if (!mesh->feature_vertex_count && !mesh->feature_edge_count && !mesh->feature_facet_count) return BW_OK;
    uint64_t edges = 0, facets = 0;
    bw_status status = features_of(w, 2, false, &edges);
    if (status == BW_OK) status = features_of(w, 3, false, &facets);
    if (status != BW_OK) return status;
    bw_hexex_write_features(&w->out, mesh->feature_vertex_count, edges, facets);
    for (size_t i = 0; i < mesh->feature_vertex_count; i++)
        bw_hexex_write_feature_vertex(&w->out, mesh->feature_vertex[i]);
    status = features_of(w, 2, true, &edges);
    return status == BW_OK ? features_of(w, 3, true, &facets) : status;
}

bw_status bw_traced_write(bw_context *ctx, bw_tessellation *t, const double (*position)[3], const char *path,
                          bw_traced_counts *counts, double *cell_volume) {
    writer w = {.ctx = ctx,
                .t = t,
                .cells = t->cells,
                .mesh = t->cells->mesh,
                .position = position,
                .cell_volume = cell_volume};
    w.counts.vertices = bw_points_count(&t->points);
    bw_status status = bw_hexex_write_begin(ctx, &w.out, path, w.counts.vertices);
    if (status == BW_OK && !(w.triangle = bw_alloc(ctx, (size_t)t->largest, sizeof *w.triangle)))
        status = ctx->error.status;
    for (size_t v = 0; v < w.counts.vertices; v++) bw_hexex_write_vertex(&w.out, position[v]);
    if (status == BW_OK) status = write_tets(&w);
    if (status == BW_OK) write_walls(&w);
    if (status == BW_OK) status = write_features(&w);
    bw_status closed = bw_hexex_write_end(&w.out, &w.counts.bytes);
    if (status == BW_OK) status = closed;
    bw_chart_clear(ctx, &w.chart);
    bw_cell_tets_clear(ctx, &w.tets);
    bw_free(ctx, w.text), bw_free(ctx, w.text_end), bw_free(ctx, w.triangle);
    *counts = w.counts;
    return status;
}
