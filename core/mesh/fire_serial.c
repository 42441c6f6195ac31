#include "mesh/fire_serial.h"

#include <stdlib.h>

/* ---- one edge ------------------------------------------------------------------------------------------------------ */

/* The iso-surface to light at an edge, of those that could be. The one in the lowest tet, then of the lowest axis of its chart, so that numbers
 * given while cells are cut have no part in it; a tet has at most one of each axis at an edge of its own. */
typedef struct {
    bw_continuation at;
    int64_t key; /* INT64_MAX: none */
} choice;

static void consider(const bw_cells *c, const bw_continuation *at, choice *best) {
    bw_tet tet = bw_cells_tet(c, at->cell);
    int axis = at->plane.axis;
    if (at->polygon != BW_NONE) {
        bw_cell other = bw_cells_across(c, at->polygon, at->cell);
        if (other != BW_NONE && bw_cells_tet(c, other) < tet) tet = bw_cells_tet(c, other);
        axis = bw_cells_polygon_plane(c, at->polygon, tet).axis;
    }
    int64_t key = 4 * (int64_t)tet + axis;
    if (key < best->key) *best = (choice){*at, key};
}

/* What continues walls straight across an edge, where half a turn after them is free of walls. */
static void consider_open_sides(const bw_cells *c, bw_cedge e, choice *best) {
    bw_continuation at;
    bw_half head = c->edge[e].half, h = head;
    do {
        bw_polygon p = c->half[h].polygon;
        for (int slot = 0; slot < 2 && c->polygon[p].flags & BW_WALL; slot++)
            if (c->polygon[p].cell[slot] != BW_NONE && bw_walk_straight(c, e, p, slot, BW_WALL, &at)) consider(c, &at, best);
        h = c->half[h].radial;
    } while (h != head);
}

/* The iso-surfaces at an edge that pass through the interior of a cell. */
static void consider_cell(const bw_cells *c, bw_cedge e, bw_cell cell, choice *best) {
    bw_tet tet = bw_cells_tet(c, cell);
    bw_polygon side[2] = {bw_walk_other(c, e, cell, BW_NONE), BW_NONE};
    side[1] = bw_walk_other(c, e, cell, side[0]);
    int along = bw_cells_edge_axis(c, e, tet);
    for (int i = 1; i < 3; i++) {
        bool fraction;
        bw_continuation at = {.polygon = BW_NONE, .facet = BW_NONE, .cell = cell, .plane.axis = (int8_t)((along + i) % 3)};
        at.plane.value = bw_cells_floor(c, c->edge[e].vertex[0], tet, at.plane.axis, &fraction);
        if (bw_walk_side(c, side[0], e, tet, at.plane) * bw_walk_side(c, side[1], e, tet, at.plane) < 0) consider(c, &at, best);
    }
}

/* All iso-surfaces around an edge that do not burn. */
static void consider_unburnt(const bw_cells *c, bw_cedge e, choice *best) {
    bw_half head = c->edge[e].half, h = head;
    do {
        bw_polygon p = c->half[h].polygon;
        bw_continuation at = {.polygon = p, .facet = BW_NONE, .cell = c->polygon[p].cell[0]};
        bool aligned = bw_cells_polygon_plane(c, p, bw_cells_tet(c, at.cell)).axis >= 0;
        if (aligned && !(c->polygon[p].flags & BW_WALL)) consider(c, &at, best);
        for (int slot = 0; slot < 2; slot++)
            if (c->polygon[p].cell[slot] != BW_NONE) consider_cell(c, e, c->polygon[p].cell[slot], best);
        h = c->half[h].radial;
    } while (h != head);
}

/* What an edge needs next, if anything. */
static bool needs(const bw_cells *c, bw_cedge e, bw_continuation *out) {
    choice best = {.key = INT64_MAX};
    int walls = bw_cells_walls_at(c, e);
    bool want_t = bw_cells_edge_is_feature(c, e) && !bw_cells_edge_is_singular(c, e);
    consider_open_sides(c, e, &best);
    if (best.key == INT64_MAX && (walls == 0 || (want_t && walls < 3))) consider_unburnt(c, e, &best);
    *out = best.at;
    return best.key != INT64_MAX;
}

static bw_status visit_edge(bw_fire *fire, bw_cedge e) {
    const bw_cells *c = fire->cells;
    bw_continuation at;
    bw_status status = BW_OK;
    while (status == BW_OK && bw_cells_edge_is_leaf(c, e) && needs(c, e, &at)) {
        status = bw_fire_ignite_at(fire, e, at);
        if (status == BW_OK) status = bw_fire_run(fire);
    }
    for (int i = 0; i < 2 && status == BW_OK && !bw_cells_edge_is_leaf(c, e); i++) /* cut: before, or by its own fire */
        status = visit_edge(fire, bw_cells_edge_part(c, e, i));
    return status;
}

/* ---- all edges, arc by arc ----------------------------------------------------------------------------------------- */

typedef struct {
    size_t begin, end; /* into `edge` */
    int64_t length;    /* grid units */
    bool boundary;
} chain;

/* Singular and feature edges: at each vertex, and strung together as chains that end where other than two of them meet. */
typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    size_t *at;       /* [vertex + 2]: into fan */
    bw_edge *fan, *edge;
    uint8_t *taken;   /* [mesh edge] */
    chain *chain;
    size_t edges, chains, room;
} chains;

static bool is_marked(const bw_cells *c, size_t e) { return (c->map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE)) != 0; }

static bw_status list_fans(chains *s) {
    const bw_tet_mesh *mesh = s->cells->mesh;
    size_t marked = 0;
    for (size_t e = 0; e < mesh->edge_count; e++) marked += is_marked(s->cells, e);
    s->at = bw_alloc(s->ctx, mesh->vertex_count + 2, sizeof *s->at);
    s->fan = bw_alloc(s->ctx, 2 * marked, sizeof *s->fan);
    s->edge = bw_alloc(s->ctx, marked, sizeof *s->edge);
    s->taken = bw_alloc(s->ctx, mesh->edge_count, 1);
    if (s->ctx->error.status != BW_OK) return s->ctx->error.status;
    for (size_t i = 0; i < 2 * mesh->edge_count; i++)
        if (is_marked(s->cells, i / 2)) s->at[mesh->edge[i / 2][i % 2] + 2]++;
    for (size_t v = 2; v < mesh->vertex_count + 2; v++) s->at[v] += s->at[v - 1];
    for (size_t i = 0; i < 2 * mesh->edge_count; i++)
        if (is_marked(s->cells, i / 2)) s->fan[s->at[mesh->edge[i / 2][i % 2] + 1]++] = (bw_edge)(i / 2);
    return BW_OK;
}

/* Parametric length of a mesh edge. */
static int64_t length_of(const bw_cells *c, bw_edge edge) {
    bw_cedge leaf = c->of_edge[edge];
    while (!bw_cells_edge_is_leaf(c, leaf)) leaf = bw_cells_edge_part(c, leaf, 0);
    bw_tet tet = bw_cells_tet(c, c->polygon[c->half[c->edge[leaf].half].polygon].cell[0]);
    int axis = bw_cells_edge_axis(c, leaf, tet);
    const int64_t(*value)[3] = c->map->value[tet];
    int64_t d = value[bw_tet_corner(c->mesh, tet, c->mesh->edge[edge][0])][axis] -
                value[bw_tet_corner(c->mesh, tet, c->mesh->edge[edge][1])][axis];
    return d < 0 ? -d : d;
}

static bw_status follow(chains *s, bw_vertex v, bw_edge e) {
    const bw_tet_mesh *mesh = s->cells->mesh;
    bw_status status = bw_reserve(s->ctx, &s->chain, &s->room, s->chains + 1);
    if (status != BW_OK) return status;
    chain *x = &s->chain[s->chains++];
    *x = (chain){.begin = s->edges, .boundary = s->cells->map->edge_flags[e] & BW_EDGE_BOUNDARY};
    for (;;) {
        s->taken[e] = 1;
        s->edge[s->edges++] = e;
        x->length += length_of(s->cells, e);
        v = mesh->edge[e][mesh->edge[e][0] == v];
        const bw_edge *fan = &s->fan[s->at[v]];
        if (s->at[v + 1] - s->at[v] != 2 || s->taken[fan[fan[0] == e]]) break;
        e = fan[fan[0] == e];
    }
    x->end = s->edges;
    return BW_OK;
}

/* Arcs of the boundary first: most of the walls around these are given. Then the shortest: their walls are stopped by few others yet, and
 * the walls of long arcs, which are many cells wide, by more. Fewer blocks than in any other order tried (core/README.md). */
static int compare(const void *a, const void *b) {
    const chain *x = a, *y = b;
    if (x->boundary != y->boundary) return x->boundary ? -1 : 1;
    if (x->length != y->length) return x->length < y->length ? -1 : 1;
    return (x->begin > y->begin) - (x->begin < y->begin);
}

/* Chains with ends, then circles; sorted into the order of the visits. */
static bw_status string_together(chains *s) {
    bw_status status = list_fans(s);
    for (int closed = 0; closed < 2 && status == BW_OK; closed++)
        for (size_t v = 0; v < s->cells->mesh->vertex_count && status == BW_OK; v++)
            for (size_t i = s->at[v]; i < s->at[v + 1] && (closed || s->at[v + 1] - s->at[v] != 2) && status == BW_OK; i++)
                if (!s->taken[s->fan[i]]) status = follow(s, (bw_vertex)v, s->fan[i]);
    if (status == BW_OK && s->chains) qsort(s->chain, s->chains, sizeof *s->chain, compare);
    return status;
}

bw_status bw_fire_serial(bw_fire *fire) {
    chains s = {.ctx = fire->ctx, .cells = fire->cells};
    bool silent = fire->silent;
    fire->silent = true;
    bw_status status = string_together(&s);
    for (size_t i = 0; i < s.chains && status == BW_OK; i++) {
        for (size_t j = s.chain[i].begin; j < s.chain[i].end && status == BW_OK; j++) status = visit_edge(fire, fire->cells->of_edge[s.edge[j]]);
        bw_progress(s.ctx, (double)i / (double)s.chains);
    }
    fire->silent = silent;
    bw_free(s.ctx, s.at), bw_free(s.ctx, s.fan), bw_free(s.ctx, s.edge), bw_free(s.ctx, s.taken), bw_free(s.ctx, s.chain);
    return status;
}
