/* Verifier, 5: the contracted complex is a hexahedral mesh with the critical entities of the complex on it.
 *
 * Why that is enough. Contracting is a map of the volume onto the contracted complex: a block goes onto its box. The set of points that one point P comes from (its fibre) is
 * connected, since only what touches was identified. P's surroundings are found to be one ball (half a ball on the boundary), so the fibre has a
 * neighbourhood bounded by one sphere, that is, the fibre is a point as far as topology goes, in any volume that lies in space, and it can be shrunk to one within that
 * neighbourhood. On the boundary and on links the same holds one and two dimensions lower: P's half ball meets the boundary in one disc with as many quadrants as
 * its fibre's node, link or region has, and a disc of boundary that held a handle would need more (Gauss-Bonnet); P has at most one point of one
 * link, or one critical node, and links keep their lengths. So all fibres shrink at the same time, within their critical entities, which is what Q 5.1 asks of blocks without
 * extent, and what is left is an integer-grid map of the same volume with the same singularities.
 *
 * And nothing valid is refused: contracting blocks to nothing, each within its critical entities, gives just this mesh.
 */
#include <stdlib.h>
#include <string.h>

#include "quantize/verify_cells.h"

/* What one element of the contracted complex has around it. Indexed by roots. */
typedef struct {
    int32_t cubes, outside, inner; /* hexes; pieces of boundary; pieces of feature surfaces */
    int32_t patch;                 /* one of those; BW_NONE */
} around_square;

typedef struct {
    int32_t quadrants, outside, inner, groups; /* of hexes; squares on boundary and feature surfaces; groups of hexes that hang together */
    int32_t link;                              /* on which it is; BW_NONE */
} around_edge;

typedef struct {
    int32_t octants, quadrants, groups, euler; /* of hexes; of boundary squares; groups; Euler characteristic of its surroundings' surface */
    int32_t link;                              /* it lies inside; BW_NONE */
    bw_node node;                              /* critical; BW_NONE */
} around_point;

/* A piece of a link between two planes. */
typedef struct {
    int64_t from, to;
    int32_t link, edge, point[2];
    bool doubtful; /* inside a side that others have slid along: it may have left the block */
} piece;

typedef struct {
    bw_cell_grid g;
    bw_verifier *v;
    around_square *square;
    around_edge *edge;
    around_point *point;
    piece *item;
    size_t count, room;
    int32_t *node_point; /* [node], critical ones; BW_NONE if not known */
} inspection;

static void coincide(inspection *s, const char *kind, int64_t id, int64_t other, const char *message) {
    bw_verify_fault(s->v, BW_FAULT_COINCIDENCE, kind, id, other, message);
}

/* ---- what is around ---- */

/* Edges (by rim) and points (by corner) of a square. */
static void rim_of(const bw_cell_grid *g, size_t block, int axis, const int at[3], int32_t edge[4], int32_t point[4]) {
    for (int i = 0; i < 4; i++) {
        int there[3] = {at[0], at[1], at[2]}, along = (axis + 1 + (i >> 1)) % 3, other = (axis + 2 - (i >> 1)) % 3;
        there[other] += i & 1;
        edge[i] = g->edge[bw_grid_edge(g, block, along, there)];
        memcpy(there, at, sizeof there);
        there[(axis + 1) % 3] += i & 1, there[(axis + 2) % 3] += i >> 1;
        point[i] = g->point[bw_grid_point(g, block, there)];
    }
}

static void count_cubes(inspection *s) {
    const bw_cell_grid *g = &s->g;
    for (size_t b = 0; b < s->v->x->block_count; b++) {
        int n[3] = {(int)bw_grid_planes(g, b, 0) - 1, (int)bw_grid_planes(g, b, 1) - 1, (int)bw_grid_planes(g, b, 2) - 1}, at[3];
        for (at[2] = 0; at[2] < n[2]; at[2]++)
            for (at[1] = 0; at[1] < n[1]; at[1]++)
                for (at[0] = 0; at[0] < n[0]; at[0]++) {
                    for (int side = 0; side < 6; side++) {
                        int there[3] = {at[0], at[1], at[2]}, axis = side >> 1;
                        int32_t edge[4], point[4];
                        there[axis] += side & 1;
                        s->square[g->square[bw_grid_square(g, b, axis, there)]].cubes++;
                        if (axis == 2) continue; /* two pairs of sides have all edges along the third axis once, ... */
                        rim_of(g, b, axis, there, edge, point);
                        for (int i = 0; i < 4; i++) { /* ... and the first pair has all points */
                            if (axis == 0) s->edge[edge[i]].quadrants++, s->point[point[i]].octants++;
                            else if (i >> 1) s->edge[edge[i]].quadrants++;
                        }
                    }
                }
    }
}

static bw_status mark_surfaces(inspection *s) {
    const bw_verifier *v = s->v;
    for (size_t k = 0; k < v->contact_count; k++) {
        const bw_contact *contact = &v->contact[k];
        bw_grid_contact c;
        if (!contact->critical) continue;
        bw_status status = bw_grid_contact_open(&s->g, contact, &c);
        if (status != BW_OK) return status;
        for (int i = c.first[0]; i < c.last[0]; i++)
            for (int j = c.first[1]; j < c.last[1]; j++) {
                int at[3];
                bw_grid_contact_at(&c, i, j, at);
                around_square *a = &s->square[s->g.square[bw_grid_square(&s->g, (size_t)contact->block[0], c.normal[0], at)]];
                if (a->outside + a->inner) coincide(s, "patch", a->patch, contact->patch, "surfaces coincide");
                if (contact->block[1] == BW_NONE) a->outside++;
                else a->inner++;
                a->patch = contact->patch;
            }
    }
    return BW_OK;
}

/* Squares with what they give to their edges and points; groups of rims and corners. */
static void count_squares(inspection *s) {
    const bw_cell_grid *g = &s->g;
    for (size_t b = 0; b < s->v->x->block_count; b++)
        for (int axis = 0; axis < 3; axis++) {
            int n[3] = {(int)bw_grid_planes(g, b, 0), (int)bw_grid_planes(g, b, 1), (int)bw_grid_planes(g, b, 2)}, at[3];
            n[(axis + 1) % 3]--, n[(axis + 2) % 3]--;
            for (at[2] = 0; at[2] < n[2]; at[2]++)
                for (at[1] = 0; at[1] < n[1]; at[1]++)
                    for (at[0] = 0; at[0] < n[0]; at[0]++) {
                        size_t q = bw_grid_square(g, b, axis, at);
                        int32_t edge[4], point[4];
                        rim_of(g, b, axis, at, edge, point);
                        for (size_t i = 0; i < 4; i++) {
                            s->edge[edge[i]].groups += g->rim[4 * q + i] == (int32_t)(4 * q + i);
                            s->point[point[i]].groups += g->corner[4 * q + i] == (int32_t)(4 * q + i);
                            if (g->square[q] != (int32_t)q) continue;
                            s->edge[edge[i]].outside += s->square[q].outside;
                            s->edge[edge[i]].inner += s->square[q].inner;
                            s->point[point[i]].quadrants += s->square[q].outside;
                            s->point[point[i]].euler--;
                        }
                    }
        }
}

static void count_edges(inspection *s) {
    const bw_cell_grid *g = &s->g;
    for (size_t b = 0; b < s->v->x->block_count; b++)
        for (int axis = 0; axis < 3; axis++) {
            int n[3] = {(int)bw_grid_planes(g, b, 0), (int)bw_grid_planes(g, b, 1), (int)bw_grid_planes(g, b, 2)}, at[3];
            n[axis]--;
            for (at[2] = 0; at[2] < n[2]; at[2]++)
                for (at[1] = 0; at[1] < n[1]; at[1]++)
                    for (at[0] = 0; at[0] < n[0]; at[0]++) {
                        size_t e = bw_grid_edge(g, b, axis, at);
                        if (g->edge[e] != (int32_t)e) continue;
                        int there[3] = {at[0], at[1], at[2]};
                        s->point[g->point[bw_grid_point(g, b, at)]].euler++;
                        there[axis]++;
                        s->point[g->point[bw_grid_point(g, b, there)]].euler++;
                    }
        }
    for (size_t p = 0; p < g->points; p++) s->point[p].euler += s->point[p].octants;
}

/* ---- links ---- */

/* The pieces of links that an arc with a positive length has on the surface of a block. */
static bw_status list_pieces(inspection *s, size_t block, const bw_rib *r) {
    bw_verifier *v = s->v;
    const bw_cell_grid *g = &s->g;
    const bw_verify_link *l = &v->link[v->arc_link[r->arc]];
    const bw_pair *low = v->place[r->place[0]].at, *high = v->place[r->place[1]].at;
    int at[3];
    for (int k = 0; k < 3; k++) {
        if (k == r->axis) continue;
        if (low[k].q < 0 || low[k].q > v->extent[block][k]) return BW_OK; /* it has slid out of the block */
        at[k] = bw_grid_find_plane(g, block, k, low[k].q);
        if (at[k] < 0) return BW_OK; /* likewise, on a wall that has slid: others have it */
    }
    int sense = v->arc_sense[r->arc] * (r->reversed ? -1 : 1);
    int64_t origin = v->arc_at[r->arc] - sense * (r->reversed ? high : low)[r->axis].q; /* link coordinate of the block's low end */
    const int64_t *plane = bw_grid_plane(g, block, r->axis);
    for (int i = 0; i + 1 < (int)bw_grid_planes(g, block, r->axis); i++) {
        if (plane[i] < low[r->axis].q || plane[i + 1] > high[r->axis].q) continue;
        int64_t end[2] = {origin + sense * plane[i], origin + sense * plane[i + 1]};
        bool turned = end[1] < end[0];
        piece p = {.from = end[turned], .to = end[!turned], .link = v->arc_link[r->arc]};
        p.doubtful = r->side[0] == r->side[1] && v->slid[6 * block + r->side[0]];
        if (l->end[0] == BW_NONE) {
            int64_t round = (p.from % l->length + l->length) % l->length - p.from;
            p.from += round, p.to += round;
        } else if (p.from < 0 || p.to > l->length) {
            continue;
        }
        at[r->axis] = i;
        p.edge = g->edge[bw_grid_edge(g, block, r->axis, at)];
        p.point[turned] = g->point[bw_grid_point(g, block, at)];
        at[r->axis] = i + 1;
        p.point[!turned] = g->point[bw_grid_point(g, block, at)];
        bw_status status = bw_reserve(v->ctx, &s->item, &s->room, s->count + 1);
        if (status != BW_OK) return status;
        s->item[s->count++] = p;
    }
    return BW_OK;
}

static int compare_pieces(const void *a, const void *b) {
    const piece *x = a, *y = b;
    if (x->link != y->link) return x->link < y->link ? -1 : 1;
    if (x->from != y->from) return x->from < y->from ? -1 : 1;
    if (x->doubtful != y->doubtful) return x->doubtful ? 1 : -1;
    return (x->to > y->to) - (x->to < y->to);
}

static void put_node(inspection *s, int32_t point, bw_node n) {
    around_point *p = &s->point[point];
    if (p->link != BW_NONE) coincide(s, "node", n, -1, "a critical node lies on a link that it is no end of");
    else if (p->node != BW_NONE && p->node != n) coincide(s, "node", p->node, n, "critical nodes coincide");
    else if (s->node_point[n] != BW_NONE && s->node_point[n] != point)
        bw_verify_fault(s->v, BW_FAULT_TOPOLOGY, "node", n, -1, "a critical node is in two places");
    p->node = n;
    s->node_point[n] = point;
}

static void put_inside(inspection *s, int32_t point, int32_t link) {
    around_point *p = &s->point[point];
    bw_arc a = s->v->link[link].arc;
    if (p->link != BW_NONE) coincide(s, "arc", s->v->link[p->link].arc, a, "points of links coincide");
    else if (p->node != BW_NONE) coincide(s, "node", p->node, -1, "a critical node lies on a link that it is no end of");
    p->link = link;
}

/* Lays a link on its edges and points. first..end: its pieces, in order, each once for every block that has it. */
static void lay_link(inspection *s, int32_t link, size_t first, size_t end) {
    bw_verifier *v = s->v;
    const bw_verify_link *l = &v->link[link];
    bool closed = l->end[0] == BW_NONE, whole = first < end && (closed || s->item[first].from == 0);
    size_t last = first;
    for (size_t i = first; i < end && v->verdict->fault == BW_VALID; i++) {
        const piece *p = &s->item[i], *before = &s->item[last];
        if (i > first && p->from == before->from) {
            if (p->doubtful && !before->doubtful) continue;
            if (p->to != before->to || p->edge != before->edge || p->point[0] != before->point[0] || p->point[1] != before->point[1])
                bw_verify_fault(v, BW_FAULT_TOPOLOGY, "arc", l->arc, -1, "the link of the arc is torn");
            continue;
        }
        if (i > first && p->from != before->to) whole = false;
        if (s->edge[p->edge].link != BW_NONE)
            coincide(s, "arc", v->link[s->edge[p->edge].link].arc, l->arc, "links coincide");
        s->edge[p->edge].link = link;
        if (p->from == 0 && !closed) put_node(s, p->point[0], l->end[0]);
        else put_inside(s, p->point[0], link);
        if (p->to == l->length && !closed) put_node(s, p->point[1], l->end[1]);
        last = i;
    }
    if (whole && s->item[last].to - s->item[first].from != l->length) whole = false;
    if (!whole) bw_verify_fault(v, BW_FAULT_TOPOLOGY, "arc", l->arc, -1, "the link of the arc is not on the mesh all along");
}

static bw_status lay_links(inspection *s) {
    bw_verifier *v = s->v;
    bw_status status = BW_OK;
    for (size_t b = 0; b < v->x->block_count; b++)
        for (size_t i = v->rib_begin[b]; i < v->rib_begin[b + 1] && status == BW_OK; i++)
            if (v->arc_link[v->rib[i].arc] != BW_NONE && v->length[v->rib[i].arc] > 0) status = list_pieces(s, b, &v->rib[i]);
    if (status != BW_OK) return status;
    if (s->count) qsort(s->item, s->count, sizeof *s->item, compare_pieces);
    size_t at = 0;
    for (size_t l = 0; l < v->link_count; l++) {
        size_t first = at;
        while (at < s->count && s->item[at].link == (int32_t)l) at++;
        lay_link(s, (int32_t)l, first, at);
    }
    return BW_OK;
}

/* Critical nodes on no link. */
static void put_nodes(inspection *s) {
    bw_verifier *v = s->v;
    for (size_t b = 0; b < v->x->block_count; b++)
        for (size_t i = v->place_begin[b]; i < v->place_begin[b + 1]; i++) {
            bw_node n = v->place[i].node;
            int at[3];
            if (!v->node_critical[n] || s->node_point[n] != BW_NONE) continue;
            for (int k = 0; k < 3; k++) at[k] = bw_grid_find_plane(&s->g, b, k, v->place[i].at[k].q);
            if (at[0] >= 0 && at[1] >= 0 && at[2] >= 0) put_node(s, s->g.point[bw_grid_point(&s->g, b, at)], n);
        }
    for (size_t n = 0; n < v->x->node_count; n++)
        if (v->node_critical[n] && s->node_point[n] == BW_NONE)
            bw_verify_fault(v, BW_FAULT_TOPOLOGY, "node", (int64_t)n, -1, "a critical node is not on the mesh");
}

/* ---- verdict ---- */

static void check_squares(inspection *s) {
    for (size_t q = 0; q < s->g.squares; q++) {
        const around_square *a = &s->square[q];
        if (s->g.square[q] != (int32_t)q) continue;
        bool boundary = a->cubes == 1 && a->outside == 1 && !a->inner;
        if (boundary || (a->cubes == 2 && !a->outside && a->inner <= 1)) continue;
        if (a->outside + a->inner) coincide(s, "patch", a->patch, -1, "a surface has nothing behind it");
        bw_verify_fault(s->v, BW_FAULT_TOPOLOGY, "", -1, -1, "something without volume is left");
    }
}

static void check_edges(inspection *s) {
    bw_verifier *v = s->v;
    for (size_t e = 0; e < s->g.edges; e++) {
        const around_edge *a = &s->edge[e];
        if (s->g.edge[e] != (int32_t)e) continue;
        if (a->link != BW_NONE) {
            const bw_verify_link *l = &v->link[a->link];
            bool right = a->quadrants == l->quarters && a->outside == (l->boundary ? 2 : 0) && a->outside + a->inner == l->surfaces;
            if (!right) coincide(s, "arc", l->arc, -1, "a link coincides with something else");
        } else {
            bool right = a->outside ? a->quadrants == 2 && a->outside == 2 && !a->inner
                                    : a->quadrants == 4 && (a->inner == 0 || a->inner == 2);
            if (!right && a->outside + a->inner) coincide(s, "", -1, -1, "a surface coincides with something else, or is folded");
            if (!right) bw_verify_fault(v, BW_FAULT_TOPOLOGY, "", -1, -1, "an edge that is not singular has not four hexes");
        }
        if (a->groups != 1) bw_verify_fault(v, BW_FAULT_TOPOLOGY, "", -1, -1, "hexes meet in an edge only");
    }
}

static void check_points(inspection *s) {
    bw_verifier *v = s->v;
    for (size_t p = 0; p < s->g.points; p++) {
        const around_point *a = &s->point[p];
        if (s->g.point[p] != (int32_t)p) continue;
        int32_t octants = a->quadrants ? 4 : 8, quadrants = a->quadrants ? 4 : 0;
        if (a->node != BW_NONE) octants = v->node_octants[a->node], quadrants = v->node_quadrants[a->node];
        else if (a->link != BW_NONE) octants = 2 * v->link[a->link].quarters, quadrants = v->link[a->link].boundary ? 4 : 0;
        bool right = a->octants == octants && a->quadrants == quadrants;
        if (!right && a->node != BW_NONE) coincide(s, "node", a->node, -1, "a critical node coincides with something else");
        if (!right && a->link != BW_NONE) coincide(s, "arc", v->link[a->link].arc, -1, "a link coincides with something else");
        if (!right || a->groups != 1 || a->euler != (quadrants ? 1 : 2))
            bw_verify_fault(v, BW_FAULT_TOPOLOGY, "", -1, -1, "the surroundings of a vertex are no ball");
    }
}

static void check_euler(inspection *s) {
    const bw_complex *x = s->v->x;
    int64_t here = -(int64_t)s->g.cubes, there = (int64_t)x->node_count - (int64_t)x->arc_count + (int64_t)x->patch_count - (int64_t)x->block_count;
    for (size_t i = 0; i < s->g.points; i++) here += s->g.point[i] == (int32_t)i;
    for (size_t i = 0; i < s->g.edges; i++) here -= s->g.edge[i] == (int32_t)i;
    for (size_t i = 0; i < s->g.squares; i++) here += s->g.square[i] == (int32_t)i;
    if (here != there) bw_verify_fault(s->v, BW_FAULT_TOPOLOGY, "", -1, -1, "the Euler characteristic has changed");
}

static bw_status inspection_open(bw_verifier *v, inspection *s) {
    *s = (inspection){.v = v};
    bw_status status = bw_grid_open(v, &s->g);
    if (status != BW_OK || v->too_fine) return status;
    s->square = bw_alloc(v->ctx, s->g.squares, sizeof *s->square);
    s->edge = bw_alloc(v->ctx, s->g.edges, sizeof *s->edge);
    s->point = bw_alloc(v->ctx, s->g.points, sizeof *s->point);
    s->node_point = bw_alloc(v->ctx, v->x->node_count, sizeof *s->node_point);
    if (v->ctx->error.status != BW_OK) return v->ctx->error.status;
    for (size_t i = 0; i < s->g.squares; i++) s->square[i].patch = BW_NONE;
    for (size_t i = 0; i < s->g.edges; i++) s->edge[i].link = BW_NONE;
    for (size_t i = 0; i < s->g.points; i++) s->point[i].link = s->point[i].node = BW_NONE;
    for (size_t i = 0; i < v->x->node_count; i++) s->node_point[i] = BW_NONE;
    return BW_OK;
}

bw_status bw_verify_contraction(bw_verifier *v) {
    inspection s;
    bw_status status = inspection_open(v, &s);
    if (status == BW_OK && !v->too_fine) status = mark_surfaces(&s);
    if (status == BW_OK && !v->too_fine) {
        v->verdict->cells = s.g.cubes;
        count_cubes(&s);
        count_squares(&s);
        count_edges(&s);
        status = lay_links(&s);
    }
    if (status == BW_OK && !v->too_fine) {
        put_nodes(&s);
        check_squares(&s);
        check_edges(&s);
        check_points(&s);
        check_euler(&s);
    }
    bw_grid_close(&s.g);
    void *blocks[] = {s.square, s.edge, s.point, s.node_point, s.item};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(v->ctx, blocks[i]);
    return status;
}
