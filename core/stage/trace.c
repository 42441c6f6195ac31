#include "stage/trace.h"

#include "mesh/fire_serial.h"
#include "mesh/rectangles.h"

/* All leaves of a tet edge. */
static bw_status ignite_edge(bw_fire *fire, bw_cedge e) {
    if (bw_cells_edge_is_leaf(fire->cells, e)) return bw_fire_ignite_edge(fire, e);
    bw_status status = BW_OK;
    for (int i = 0; i < 2 && status == BW_OK; i++) status = ignite_edge(fire, bw_cells_edge_part(fire->cells, e, i));
    return status;
}

/* Feature facets are walls from the start, and burn on from their rims. */
static bw_status ignite_feature_facets(bw_fire *fire) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    bw_status status = BW_OK;
    for (size_t i = 0; i < mesh->feature_facet_count && status == BW_OK; i++) {
        bw_polygon p; /* nothing is cut yet */
        status = bw_cells_polygon_of(fire->ctx, fire->cells, bw_tet_mesh_find_facet(mesh, mesh->feature_facet[i]), &p);
        if (status == BW_OK) status = bw_fire_ignite_polygon(fire, p);
        if (status == BW_OK) fire->cells->polygon[p].flags |= BW_FEATURE;
    }
    return status;
}

/* Opens the tets around the edges that will be lit. */
static bw_status open_around_edges(bw_fire *fire) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    bw_status status = BW_OK;
    for (size_t t = 0; t < mesh->tet_count && status == BW_OK; t++) {
        unsigned flags = 0;
        for (int i = 0; i < 6; i++) flags |= fire->cells->map->edge_flags[mesh->tet_edge[t][i]];
        if (flags & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE)) status = bw_cells_open(fire->ctx, fire->cells, (bw_tet)t);
    }
    return status;
}

static bw_status ignite_edges(bw_fire *fire) {
    bw_status status = open_around_edges(fire);
    for (size_t e = 0; e < fire->cells->mesh->edge_count && status == BW_OK; e++)
        if (fire->cells->map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE)) status = ignite_edge(fire, fire->cells->of_edge[e]);
    return status;
}

/* Tets at a vertex, and what singular and feature edges meet there. */
typedef struct {
    bw_tet *tet;
    size_t tet_count, tet_room;
    bw_edge edge[3]; /* up to three of them; beyond that it does not matter which */
    size_t edge_count;
} star;

static bw_status look_around(bw_fire *fire, bw_vertex v, star *s) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    s->tet_count = s->edge_count = 0;
    for (size_t t = 0; t < mesh->tet_count; t++) {
        int corner = bw_tet_corner(mesh, (bw_tet)t, v);
        if (corner < 0) continue;
        bw_status status = bw_reserve(fire->ctx, &s->tet, &s->tet_room, s->tet_count + 1);
        if (status != BW_OK) return status;
        s->tet[s->tet_count++] = (bw_tet)t;
        for (int i = 0; i < 4; i++) {
            bw_edge e = i == corner ? BW_NONE : mesh->tet_edge[t][bw_tet_edge_of[corner][i]];
            bool known = e == BW_NONE || !(fire->cells->map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE));
            for (size_t j = 0; j < s->edge_count && j < 3; j++) known = known || s->edge[j] == e;
            if (known) continue;
            if (s->edge_count < 3) s->edge[s->edge_count] = e;
            s->edge_count++;
        }
    }
    return BW_OK;
}

/* A feature vertex has to become a node. Where three or more singular or feature edges meet it is one; on a curve of them the
 * iso-surface across the curve makes it one; elsewhere all three iso-surfaces do. */
static bw_status ignite_feature_vertex(bw_fire *fire, bw_vertex v, star *s) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    bw_status status = look_around(fire, v, s);
    if (status != BW_OK || s->tet_count == 0 || s->edge_count >= 3) return status;
    unsigned axes = 7;
    for (size_t i = 0; i < s->tet_count && s->edge_count; i++) {
        bw_tet t = s->tet[i];
        const bw_vertex *end = mesh->edge[s->edge[0]];
        if (bw_tet_corner(mesh, t, end[0]) < 0 || bw_tet_corner(mesh, t, end[1]) < 0) continue;
        axes = 1u << bw_cells_edge_axis(fire->cells, fire->cells->of_edge[s->edge[0]], t);
        s->tet[i] = s->tet[0], s->tet[0] = t;
        break;
    }
    return bw_fire_ignite_vertex(fire, v, s->tet, s->tet_count, axes);
}

static bw_status ignite_feature_vertices(bw_fire *fire) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    star s = {0};
    bw_status status = BW_OK;
    for (size_t i = 0; i < mesh->feature_vertex_count && status == BW_OK; i++)
        status = ignite_feature_vertex(fire, mesh->feature_vertex[i], &s);
    bw_free(fire->ctx, s.tet);
    return status;
}

static bw_status burn_simultaneously(bw_fire *fire) {
    bw_status status = ignite_feature_facets(fire);
    if (status == BW_OK) status = ignite_edges(fire);
    if (status == BW_OK) status = ignite_feature_vertices(fire);
    return status == BW_OK ? bw_fire_run(fire) : status;
}

/* What has to burn first, whatever else there is; then arc by arc. */
static bw_status burn_serially(bw_fire *fire) {
    bw_status status = ignite_feature_facets(fire);
    if (status == BW_OK) status = open_around_edges(fire);
    if (status == BW_OK) status = ignite_feature_vertices(fire);
    if (status == BW_OK) status = bw_fire_run(fire);
    if (status == BW_OK) status = bw_fire_serial(fire);
    return status == BW_OK ? bw_rectangles(fire) : status;
}

bw_status bw_trace(bw_context *ctx, bw_cells *cells, bw_complex_kind kind, uint64_t max_cells) {
    bw_fire fire;
    bw_fire_init(&fire, ctx, cells, &(bw_fire_rules){.stops_at_walls = kind != BW_COMPLEX_BC, .max_cells = max_cells});
    bw_status status = kind == BW_COMPLEX_SERIAL ? burn_serially(&fire) : burn_simultaneously(&fire);
    bw_fire_clear(&fire);
    return status == BW_OK ? bw_cells_trim(ctx, cells) : status;
}
