/* Nodes and arcs: where walls meet other than flat (MC 4.1). */
#include <string.h>

#include "complex/build.h"
#include "mesh/walk.h"

enum { FORCED = -3 /* a feature vertex: a node wherever it is on an arc */ };

/* Counts the wall polygons around every edge. */
static void count_walls(bw_build *b) {
    const bw_cells *c = b->cells;
    for (size_t p = 0; p < c->polygon_count; p++) {
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p) || !(c->polygon[p].flags & BW_WALL)) continue;
        bw_half h = c->polygon[p].half;
        do {
            bw_build_edge *e = &b->edge[c->half[h].edge];
            *e = (*e ^ (bw_build_edge)p << 2) + ((*e & 3) < 3);
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
}

/* What all edges of one arc have in common: quarter turns around it, its flags, and its number of walls. */
typedef struct {
    uint16_t quarters;
    uint8_t flags;
    int walls;
} arc_kind;

static arc_kind kind_of(const bw_cells *c, bw_cedge e) {
    bool boundary = bw_cells_edge_is_boundary(c, e), singular = bw_cells_edge_is_singular(c, e);
    arc_kind k = {.quarters = boundary ? 2 : 4, .walls = bw_cells_walls_at(c, e)};
    if (singular) k.quarters = c->map->quarters[c->edge[e].carrier];
    k.flags = (uint8_t)((boundary ? BW_ARC_BOUNDARY : 0) | (singular ? BW_ARC_SINGULAR : 0) |
                        (bw_cells_edge_is_feature(c, e) ? BW_ARC_FEATURE : 0));
    return k;
}

/* Arc edges at each vertex, as lists, and the nodes. */
typedef struct {
    size_t *begin;
    bw_cedge *edge;
    bw_node *node; /* [vertex]: the node there, or BW_NONE */
} fans;

static bw_status list_fans(bw_build *b, fans *out) {
    const bw_cells *c = b->cells;
    out->begin = bw_alloc(b->ctx, c->vertex_count + 2, sizeof *out->begin);
    if (!out->begin) return b->ctx->error.status;
    count_walls(b);
    for (size_t e = 0; e < c->edge_count; e++) {
        if (!bw_cells_edge_is_arc(c, (bw_cedge)e, b->edge[e] & 3)) continue;
        b->edge[e] = BW_EDGE_WAITS;
        for (int i = 0; i < 2; i++) out->begin[c->edge[e].vertex[i] + 2]++;
    }
    for (size_t v = 2; v < c->vertex_count + 2; v++) out->begin[v] += out->begin[v - 1];
    out->edge = bw_alloc(b->ctx, out->begin[c->vertex_count + 1], sizeof *out->edge);
    if (!out->edge) return b->ctx->error.status;
    for (size_t e = 0; e < c->edge_count; e++)
        for (int i = 0; i < 2; i++)
            if (b->edge[e] == BW_EDGE_WAITS) out->edge[out->begin[c->edge[e].vertex[i] + 1]++] = (bw_cedge)e;
    return BW_OK;
}

static bool is_node(const bw_cells *c, const fans *f, bw_cvertex v) {
    size_t n = f->begin[v + 1] - f->begin[v];
    if (n != 2) return n > 0;
    arc_kind k[2] = {kind_of(c, f->edge[f->begin[v]]), kind_of(c, f->edge[f->begin[v] + 1])};
    return k[0].quarters != k[1].quarters || k[0].flags != k[1].flags || k[0].walls != k[1].walls;
}

static bw_status number_nodes(bw_build *b, fans *f) {
    const bw_cells *c = b->cells;
    const bw_tet_mesh *mesh = c->mesh;
    bw_complex *x = b->complex;
    f->node = bw_alloc(b->ctx, c->vertex_count, sizeof *f->node);
    if (!f->node) return b->ctx->error.status;
    for (size_t i = 0; i < mesh->feature_vertex_count; i++) f->node[mesh->feature_vertex[i]] = FORCED;
    for (size_t v = 0; v < c->vertex_count; v++) {
        bool forced = f->node[v] == FORCED && f->begin[v + 1] > f->begin[v];
        f->node[v] = forced || is_node(c, f, (bw_cvertex)v) ? (bw_node)x->node_count++ : BW_NONE;
    }
    x->node_vertex = bw_alloc(b->ctx, x->node_count, sizeof *x->node_vertex);
    x->node_flags = bw_alloc(b->ctx, x->node_count, sizeof *x->node_flags);
    if (!x->node_vertex || !x->node_flags) return b->ctx->error.status;
    for (size_t v = 0; v < c->vertex_count; v++) {
        bw_node n = f->node[v];
        if (n == BW_NONE) continue;
        x->node_vertex[n] = (bw_cvertex)v;
        for (size_t i = f->begin[v]; i < f->begin[v + 1]; i++) {
            uint8_t flags = kind_of(c, f->edge[i]).flags;
            if (flags & BW_ARC_SINGULAR) x->node_flags[n] |= BW_NODE_SINGULAR;
            if (flags & BW_ARC_BOUNDARY) x->node_flags[n] |= BW_NODE_BOUNDARY;
        }
    }
    for (size_t i = 0; i < mesh->feature_vertex_count; i++) {
        bw_node n = f->node[mesh->feature_vertex[i]];
        if (n != BW_NONE) x->node_flags[n] |= BW_NODE_FEATURE;
    }
    return BW_OK;
}

/* Difference of the floors of an edge's directed coordinate. The fractions of neighbouring edges agree at their common vertex and
 * are zero at nodes, so the sum over an arc is its exact length. */
static int64_t floor_length(const bw_cells *c, bw_cedge e, bw_cvertex from) {
    bw_tet tet = bw_cells_tet(c, c->polygon[c->half[c->edge[e].half].polygon].cell[0]);
    bw_cvertex end[2] = {from, c->edge[e].vertex[c->edge[e].vertex[0] == from]};
    int axis = bw_cells_edge_axis(c, e, tet);
    int64_t x[2];
    bool fraction[2];
    for (int i = 0; i < 2; i++) x[i] = bw_cells_floor(c, end[i], tet, axis, &fraction[i]);
    bool rising = bw_cells_compare_along(c, end[0], end[1], tet, axis) < 0;
    return rising ? x[1] - x[0] : (x[0] + fraction[0]) - (x[1] + fraction[1]);
}

/* Follows an arc from `start` along `edge` to the next node, or around to the start. */
static bw_status follow(bw_build *b, const fans *f, bw_cvertex start, bw_cedge edge, size_t *edges) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    bw_arc a = (bw_arc)x->arc_count++;
    arc_kind kind = kind_of(c, edge);
    x->arc_quarters[a] = kind.quarters;
    x->arc_flags[a] = kind.flags;
    bw_cvertex v = start;
    for (;;) {
        b->edge[edge] = (bw_build_edge)a << 2 | BW_EDGE_ON_ARC;
        x->arc_edge[(*edges)++] = edge;
        x->arc_length[a] += floor_length(c, edge, v);
        v = c->edge[edge].vertex[c->edge[edge].vertex[0] == v];
        if (f->node[v] != BW_NONE || v == start) break;
        const bw_cedge *fan = &f->edge[f->begin[v]];
        edge = fan[fan[0] == edge];
    }
    x->arc_node[a][0] = f->node[start];
    x->arc_node[a][1] = f->node[v];
    x->arc_edge_begin[a + 1] = *edges;
    return bw_poll(b->ctx);
}

static bw_status number_arcs(bw_build *b, const fans *f) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    size_t room = f->begin[c->vertex_count] / 2, edges = 0; /* no more arcs than arc edges */
    x->arc_node = bw_alloc(b->ctx, room, sizeof *x->arc_node);
    x->arc_length = bw_alloc(b->ctx, room, sizeof *x->arc_length);
    x->arc_quarters = bw_alloc(b->ctx, room, sizeof *x->arc_quarters);
    x->arc_flags = bw_alloc(b->ctx, room, sizeof *x->arc_flags);
    x->arc_edge_begin = bw_alloc(b->ctx, room + 1, sizeof *x->arc_edge_begin);
    x->arc_edge = bw_alloc(b->ctx, room, sizeof *x->arc_edge);
    bw_status status = b->ctx->error.status;
    for (int closed = 0; closed < 2 && status == BW_OK; closed++) /* arcs between nodes, then circles without any */
        for (size_t v = 0; v < c->vertex_count && status == BW_OK; v++) {
            if (!closed && f->node[v] == BW_NONE) continue;
            for (size_t i = f->begin[v]; i < f->begin[v + 1] && status == BW_OK; i++)
                if (b->edge[f->edge[i]] == BW_EDGE_WAITS) status = follow(b, f, (bw_cvertex)v, f->edge[i], &edges);
        }
    return status;
}

bw_status bw_build_arcs(bw_build *b) {
    fans f = {NULL, NULL, NULL};
    bw_status status = list_fans(b, &f);
    if (status == BW_OK) status = number_nodes(b, &f);
    if (status == BW_OK) status = number_arcs(b, &f);
    bw_free(b->ctx, f.begin);
    bw_free(b->ctx, f.edge);
    bw_free(b->ctx, f.node);
    return status;
}
