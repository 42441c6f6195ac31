#include "format/hexex_write.h"

#include <math.h>
#include <string.h>

static bw_status refuse(bw_hexex_writer *w, const char *what) {
    if (w->out.status == BW_OK) w->out.status = bw_fail(w->out.ctx, BW_E_INTERNAL, "writing %s: %s", w->out.path, what);
    return w->out.status;
}

/* Opens the section `to` with `count` records; all sections before it must be complete. */
static void announce(bw_hexex_writer *w, bw_hexex_section to, size_t count) {
    for (int s = BW_HEXEX_VERTICES; s < BW_HEXEX_SECTIONS; s++)
        if (w->left[s]) refuse(w, "a section was left before all its records were written");
    if (w->section >= to) refuse(w, "sections out of order");
    w->section = to;
    w->left[to] = count;
    bw_put_integer(&w->out, (int64_t)count);
}

/* One more record of `section`? Feature lists follow each other without an announcement. */
static bool record(bw_hexex_writer *w, bw_hexex_section section) {
    for (int s = BW_HEXEX_FEATURE_VERTICES; s < (int)section; s++)
        if (w->left[s]) refuse(w, "feature lists out of order");
    if (!w->left[section]) {
        refuse(w, "more records than announced");
        return false;
    }
    w->left[section]--;
    return w->out.status == BW_OK;
}

static void put_indices(bw_output *out, const bw_vertex *index, int n) {
    for (int i = 0; i < n; i++) {
        if (i) bw_put_bytes(out, " ", 1);
        bw_put_integer(out, index[i]);
    }
}

static void put_number(bw_hexex_writer *w, double value) {
    if (isfinite(value)) bw_put_number(&w->out, value);
    else refuse(w, "a number is not finite");
}

static bw_status end_record(bw_hexex_writer *w) {
    bw_put_bytes(&w->out, "\n", 1);
    return w->out.status;
}

bw_status bw_hexex_write_begin(bw_context *ctx, bw_hexex_writer *w, const char *path, size_t vertex_count) {
    memset(w, 0, sizeof *w);
    bw_output_open(ctx, &w->out, path);
    w->left[BW_HEXEX_VERTICES] = vertex_count;
    bw_put_integer(&w->out, (int64_t)vertex_count);
    return end_record(w);
}

bw_status bw_hexex_write_vertex(bw_hexex_writer *w, const double position[3]) {
    if (!record(w, BW_HEXEX_VERTICES)) return w->out.status;
    for (int i = 0; i < 3; i++) {
        if (i) bw_put_bytes(&w->out, " ", 1);
        put_number(w, position[i]);
    }
    return end_record(w);
}

bw_status bw_hexex_write_tets(bw_hexex_writer *w, size_t count) {
    announce(w, BW_HEXEX_TETS, count);
    return end_record(w);
}

bw_status bw_hexex_write_tet(bw_hexex_writer *w, const bw_vertex corner[4], const double parameter[4][3]) {
    if (!record(w, BW_HEXEX_TETS)) return w->out.status;
    put_indices(&w->out, corner, 4);
    for (int i = 0; i < 12; i++) {
        bw_put_bytes(&w->out, " ", 1);
        put_number(w, parameter[i / 3][i % 3]);
    }
    return end_record(w);
}

bw_status bw_hexex_write_tet_text(bw_hexex_writer *w, const bw_vertex corner[4], const char *const number[12]) {
    if (!record(w, BW_HEXEX_TETS)) return w->out.status;
    put_indices(&w->out, corner, 4);
    for (int i = 0; i < 12; i++) {
        bw_put_bytes(&w->out, " ", 1);
        bw_put_text(&w->out, number[i]);
    }
    return end_record(w);
}

bw_status bw_hexex_write_walls(bw_hexex_writer *w, size_t count) {
    announce(w, BW_HEXEX_WALLS, count);
    return end_record(w);
}

bw_status bw_hexex_write_wall(bw_hexex_writer *w, const bw_vertex corner[3], double distance) {
    if (!record(w, BW_HEXEX_WALLS)) return w->out.status;
    put_indices(&w->out, corner, 3);
    bw_put_bytes(&w->out, " ", 1);
    put_number(w, distance);
    return end_record(w);
}

bw_status bw_hexex_write_features(bw_hexex_writer *w, size_t vertices, size_t edges, size_t facets) {
    announce(w, BW_HEXEX_FEATURE_VERTICES, vertices);
    w->left[BW_HEXEX_FEATURE_EDGES] = edges;
    w->left[BW_HEXEX_FEATURE_FACETS] = facets;
    bw_put_bytes(&w->out, " ", 1);
    bw_put_integer(&w->out, (int64_t)edges);
    bw_put_bytes(&w->out, " ", 1);
    bw_put_integer(&w->out, (int64_t)facets);
    return end_record(w);
}

static bw_status put_feature(bw_hexex_writer *w, bw_hexex_section section, const bw_vertex *index, int n) {
    if (!record(w, section)) return w->out.status;
    put_indices(&w->out, index, n);
    return end_record(w);
}

bw_status bw_hexex_write_feature_vertex(bw_hexex_writer *w, bw_vertex vertex) {
    return put_feature(w, BW_HEXEX_FEATURE_VERTICES, &vertex, 1);
}

bw_status bw_hexex_write_feature_edge(bw_hexex_writer *w, const bw_vertex end[2]) {
    return put_feature(w, BW_HEXEX_FEATURE_EDGES, end, 2);
}

bw_status bw_hexex_write_feature_facet(bw_hexex_writer *w, const bw_vertex corner[3]) {
    return put_feature(w, BW_HEXEX_FEATURE_FACETS, corner, 3);
}

bw_status bw_hexex_write_end(bw_hexex_writer *w, uint64_t *bytes) {
    if (w->section < BW_HEXEX_TETS) refuse(w, "it has no tets");
    for (int s = BW_HEXEX_VERTICES; s < BW_HEXEX_SECTIONS; s++)
        if (w->left[s]) refuse(w, "fewer records than announced");
    return bw_output_close(&w->out, bytes);
}

bw_status bw_hexex_write_mesh(bw_context *ctx, const char *path, const bw_tet_mesh *m) {
    bw_hexex_writer w;
    bw_hexex_write_begin(ctx, &w, path, m->vertex_count);
    for (size_t i = 0; i < m->vertex_count; i++) bw_hexex_write_vertex(&w, m->position[i]);
    bw_hexex_write_tets(&w, m->tet_count);
    for (size_t i = 0; i < m->tet_count; i++)
        bw_hexex_write_tet(&w, m->tet[i], (const double(*)[3])m->parameter[i]);
    if (m->wall_count) bw_hexex_write_walls(&w, m->wall_count);
    for (size_t i = 0; i < m->wall_count; i++) bw_hexex_write_wall(&w, m->wall[i], m->wall_distance[i]);
    if (m->feature_vertex_count || m->feature_edge_count || m->feature_facet_count)
        bw_hexex_write_features(&w, m->feature_vertex_count, m->feature_edge_count, m->feature_facet_count);
    for (size_t i = 0; i < m->feature_vertex_count; i++) bw_hexex_write_feature_vertex(&w, m->feature_vertex[i]);
    for (size_t i = 0; i < m->feature_edge_count; i++) bw_hexex_write_feature_edge(&w, m->feature_edge[i]);
    for (size_t i = 0; i < m->feature_facet_count; i++) bw_hexex_write_feature_facet(&w, m->feature_facet[i]);
    return bw_hexex_write_end(&w, NULL);
}
