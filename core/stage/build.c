#include "stage/build.h"

#include <stdlib.h>

#include "mesh/fire.h"
#include "mesh/walk.h"

/* Where a block is cut in two: strictly inside an edge at which two of its walls meet at a right angle, perpendicular to it; or, where tets are those of hexes, at an
 * end of such an edge. */
typedef struct {
    bw_cell cell;
    bw_plane plane;
    int64_t length;   /* of the edge; 0: none found */
    bw_vertex vertex; /* that end; BW_NONE: inside */
} start;

/* The plane across the middle of a complex edge, seen from one of its cells. */
static start across_edge(const bw_cells *c, bw_cedge e, bw_cell cell) {
    bw_tet tet = bw_cells_tet(c, cell);
    int axis = bw_cells_edge_axis(c, e, tet);
    if (axis < 0) return (start){.length = 0};
    bool fraction;
    int64_t x[2];
    for (int i = 0; i < 2; i++) x[i] = bw_cells_floor(c, c->edge[e].vertex[i], tet, axis, &fraction);
    int64_t low = x[0] < x[1] ? x[0] : x[1], length = x[0] < x[1] ? x[1] - x[0] : x[0] - x[1];
    if (length < 2) return (start){.length = 0}; /* no integer strictly between its ends, for certain */
    return (start){cell, {low + length / 2, (int8_t)axis}, length, BW_NONE};
}

/* The plane across an end of a complex edge that is a whole edge of the tet mesh. */
static start at_end(const bw_cells *c, bw_cedge e, int end, bw_cell cell) {
    start at = across_edge(c, e, cell);
    const bw_cell_vertex *v = &c->vertex[c->edge[e].vertex[end]];
    if (!at.length || v->kind != BW_IN_VERTEX) return (start){.length = 0};
    at.vertex = v->carrier;
    at.plane.value = c->map->value[cell][bw_tet_corner(c->mesh, cell, v->carrier)][at.plane.axis];
    return at;
}

/* Burns the facets in the plane at the vertex, as far as its block goes on one side of them. */
static bw_status ignite_facets(bw_fire *fire, start from) {
    bw_cells *c = fire->cells;
    const bw_tet_mesh *mesh = c->mesh;
    struct reached {
        bw_tet tet;
        bw_transition chart; /* from that of the first */
    } *list = NULL;
    size_t count = 0, room = 0;
    bw_status status = bw_reserve(fire->ctx, &list, &room, 1);
    if (status == BW_OK) list[count++] = (struct reached){.tet = from.cell};
    for (size_t i = 0; i < count && status == BW_OK; i++)
        for (int k = 0; k < 4 && status == BW_OK; k++) {
            bw_tet t = list[i].tet, next;
            bw_facet f = mesh->tet_facet[t][k];
            bw_plane plane = bw_transition_plane(&list[i].chart, from.plane);
            bool wall = c->of_facet[f] != BW_NONE && c->polygon[c->of_facet[f]].flags & BW_WALL, known = false, flat = true;
            if (wall || mesh->tet[t][k] == from.vertex) continue;
            for (int j = 0; j < 4; j++) flat = flat && (j == k || c->map->value[t][j][plane.axis] == plane.value);
            if (flat) {
                bw_polygon p;
                status = bw_cells_polygon_of(fire->ctx, c, f, &p);
                if (status == BW_OK) status = bw_fire_ignite_polygon(fire, p);
                continue;
            }
            next = bw_tet_across(mesh, f, t);
            for (size_t j = 0; j < count; j++) known = known || list[j].tet == next;
            if (known || bw_reserve(fire->ctx, &list, &room, count + 1)) continue;
            bw_transition step = bw_grid_map_across(mesh, c->map, f, t);
            list[count].tet = next;
            list[count].chart = bw_transition_compose(&step, &list[i].chart);
            count++;
        }
    bw_free(fire->ctx, list);
    return fire->ctx->error.status;
}

static bw_status ignite_start(bw_fire *fire, start from) {
    return from.vertex == BW_NONE ? bw_fire_ignite_plane(fire, from.cell, from.plane) : ignite_facets(fire, from);
}

/* ---- tori ---------------------------------------------------------------------------------------------------------- */

/* Whether a wall polygon bounds a block with the cell in its slot s. Cutting another torus may have added cells that no block has yet. */
static bool bounds(const bw_cells *c, const bw_complex *x, bw_polygon p, int s, bw_block block) {
    bw_cell cell = c->polygon[p].cell[s];
    return bw_cells_polygon_is_leaf(c, p) && c->polygon[p].flags & BW_WALL && cell != BW_NONE && (size_t)cell < x->cell_count &&
           x->cell_block[cell] == block;
}

/* Considers the edges of one wall polygon, seen from the cell in its slot s: keeps the longest right-angled one. */
static void consider(const bw_cells *c, bw_polygon p, int s, start *best) {
    bw_half h = c->polygon[p].half;
    do {
        bw_cedge e = c->half[h].edge;
        h = c->half[h].next;
        start at = c->mesh->of_hexes ? at_end(c, e, 0, c->polygon[p].cell[s]) : across_edge(c, e, c->polygon[p].cell[s]);
        if (at.length <= best->length) continue;
        int slot = s;
        bw_plane plane = bw_cells_polygon_plane(c, p, bw_cells_tet(c, c->polygon[p].cell[s]));
        bw_polygon q = bw_walk_wall(c, e, p, &slot, &plane);
        bool flat = bw_walk_side(c, q, e, bw_cells_tet(c, c->polygon[q].cell[slot]), plane) == 0;
        if (!flat) *best = at;
    } while (h != c->polygon[p].half);
}

static start longest_right_angle(const bw_cells *c, const bw_complex *x, bw_block block) {
    start best = {.length = 0};
    for (size_t p = 0; p < c->polygon_count; p++)
        for (int s = 0; s < 2; s++)
            if (bounds(c, x, (bw_polygon)p, s, block)) consider(c, (bw_polygon)p, s, &best);
    return best;
}

/* Where a wall of other blocks ends on a side of a torus: going straight on there opens the torus without a new arc length, so the quantization is as free
 * as before. */
typedef struct {
    bw_cedge edge;
    bw_continuation at;
    int64_t length; /* of the edge; 0: none found */
} joint;

static int64_t edge_length(const bw_cells *c, bw_cedge e, bw_tet tet) {
    int axis = bw_cells_edge_axis(c, e, tet);
    bool fraction;
    return axis < 0 ? 0 : llabs(bw_cells_floor(c, c->edge[e].vertex[1], tet, axis, &fraction) - bw_cells_floor(c, c->edge[e].vertex[0], tet, axis, &fraction));
}

/* Considers the edges of one wall polygon with the block in its slot s: the wall that stands on it from outside, perpendicular to axis `ring` of the block's chart. */
static void consider_joint(const bw_cells *c, const bw_complex *x, bw_polygon p, int s, int ring, joint *best) {
    bw_block block = x->cell_block[c->polygon[p].cell[s]];
    bw_half h = c->polygon[p].half;
    if (c->polygon[p].cell[!s] == BW_NONE) return;
    do {
        bw_cedge e = c->half[h].edge;
        h = c->half[h].next;
        bw_tet tet = bw_cells_tet(c, c->polygon[p].cell[!s]);
        joint here = {.edge = e, .length = edge_length(c, e, tet)};
        if (here.length <= best->length || bw_cells_edge_is_singular(c, e) || bw_cells_edge_is_boundary(c, e)) continue;
        int slot = !s;
        bw_plane plane = bw_cells_polygon_plane(c, p, tet);
        bw_polygon wall = bw_walk_wall(c, e, p, &slot, &plane);
        if (bw_walk_side(c, wall, e, bw_cells_tet(c, c->polygon[wall].cell[slot]), plane) == 0) continue; /* p goes on flat */
        if (!bw_walk_straight(c, e, wall, slot, 0, &here.at)) continue;
        bw_cell cell = here.at.cell;
        bool inside = (size_t)cell < x->cell_count && x->cell_block[cell] == block;
        if (!inside || (here.at.polygon != BW_NONE && c->polygon[here.at.polygon].flags & BW_WALL)) continue;
        if (bw_transition_plane(bw_complex_chart(x, cell), here.at.plane).axis == ring) *best = here;
    } while (h != c->polygon[p].half);
}

/* `from`: a right-angled edge of the block; such edges run around the ring. */
static joint longest_joint(const bw_cells *c, const bw_complex *x, start from) {
    bw_block block = x->cell_block[from.cell];
    int ring = bw_transition_plane(bw_complex_chart(x, from.cell), from.plane).axis;
    joint best = {.length = 0};
    for (size_t p = 0; p < c->polygon_count; p++)
        for (int s = 0; s < 2; s++)
            if (bounds(c, x, (bw_polygon)p, s, block)) consider_joint(c, x, (bw_polygon)p, s, ring, &best);
    return best;
}

/* A vertex of the tet mesh in the block of `member`, which has no right-angled edge, on its walls if it has any, and the axes in those walls. */
static bw_vertex vertex_without_arcs(const bw_cells *c, const bw_complex *x, bw_cell member, bw_tet *tet, unsigned *axes) {
    for (size_t i = 0; i < 2 * c->polygon_count; i++) {
        bw_polygon p = (bw_polygon)(i / 2);
        if (!bounds(c, x, p, i % 2, x->cell_block[member])) continue;
        *tet = bw_cells_tet(c, c->polygon[p].cell[i % 2]);
        bw_half h = c->polygon[p].half;
        do {
            const bw_cell_vertex *v = &c->vertex[c->half[h].origin];
            *axes = 7u & ~(1u << bw_cells_polygon_plane(c, p, *tet).axis);
            if (v->kind == BW_IN_VERTEX) return v->carrier;
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    *axes = 7; /* no walls: a closed manifold */
    *tet = bw_cells_tet(c, member);
    return c->mesh->tet[*tet][0];
}

/* A map without any singularity near the block: the fire of a single point cuts it (MC 4.1.2, closed facets). */
static bw_status ignite_anywhere(bw_fire *fire, const bw_complex *x, bw_cell member) {
    const bw_tet_mesh *mesh = fire->cells->mesh;
    bw_tet first, *tets = NULL;
    unsigned axes;
    size_t count = 0, room = 0;
    bw_vertex v = vertex_without_arcs(fire->cells, x, member, &first, &axes);
    bw_status status = bw_reserve(fire->ctx, &tets, &room, 1);
    if (status == BW_OK) tets[count++] = first;
    for (size_t t = 0; t < mesh->tet_count && status == BW_OK; t++) {
        if ((bw_tet)t == first || bw_tet_corner(mesh, (bw_tet)t, v) < 0) continue;
        status = bw_reserve(fire->ctx, &tets, &room, count + 1);
        if (status == BW_OK) tets[count++] = (bw_tet)t;
    }
    if (status == BW_OK) status = bw_fire_ignite_vertex(fire, v, tets, count, axes);
    bw_free(fire->ctx, tets);
    return status;
}

/* The fire stops at the walls of its block, and at its own. */
static void init_fire(bw_fire *fire, bw_context *ctx, bw_cells *cells, uint64_t max_cells) {
    bw_fire_init(fire, ctx, cells, &(bw_fire_rules){.stops_at_walls = true, .flags = BW_SPLIT, .max_cells = max_cells});
}

static bw_status split_tori(bw_context *ctx, bw_cells *cells, const bw_complex *complex, const bw_torus_list *tori, uint64_t max_cells) {
    bw_fire fire;
    init_fire(&fire, ctx, cells, max_cells);
    bw_status status = BW_OK;
    for (size_t i = 0; i < tori->count && status == BW_OK; i++) {
        start from = longest_right_angle(cells, complex, complex->cell_block[tori->cell[i]]);
        joint at = from.length ? longest_joint(cells, complex, from) : (joint){.length = 0};
        if (at.length) status = bw_fire_ignite_at(&fire, at.edge, at.at);
        else if (from.length) status = ignite_start(&fire, from);
        else status = ignite_anywhere(&fire, complex, tori->cell[i]);
        if (status == BW_OK) status = bw_fire_run(&fire);
    }
    bw_fire_clear(&fire);
    return status;
}

static bw_status build_cuboids(bw_context *ctx, bw_cells *cells, uint64_t max_cells, bw_complex *complex, size_t *splits) {
    bw_torus_list tori = {0};
    bw_status status = bw_complex_build(ctx, cells, complex, &tori);
    for (int round = 0; status == BW_OK && tori.count; round++) {
        if (round == 8) { /* one wall opens a torus, two a block without arcs */
            bw_tet tet = bw_cells_tet(cells, tori.cell[0]);
            double centre[3];
            bw_tet_centre(cells->mesh, tet, centre);
            bw_fail_element(ctx, "tet", cells->mesh->tet_id[tet], centre);
            status = bw_fail(ctx, BW_E_ALGORITHM, "the block that holds tet %d stays other than a cuboid however often it is cut",
                             cells->mesh->tet_id[tet]);
        }
        *splits += tori.count;
        if (status == BW_OK) status = split_tori(ctx, cells, complex, &tori, max_cells);
        bw_complex_clear(ctx, complex);
        if (status == BW_OK) status = bw_complex_build(ctx, cells, complex, &tori);
    }
    bw_free(ctx, tori.cell);
    return status;
}

/* ---- self-adjacent blocks ------------------------------------------------------------------------------------------- */

/* A place to cut a block across one of its axes: the longest of the complex edges along it. */
static start across_block(const bw_cells *c, const bw_complex *x, bw_block block, int axis) {
    start best = {.length = 0};
    for (size_t k = 12 * (size_t)block + 4 * (size_t)axis; k < 12 * (size_t)block + 4 * (size_t)axis + 4; k++)
        for (size_t i = x->block_edge_begin[k]; i < x->block_edge_begin[k + 1]; i++) {
            bw_arc a = x->block_edge[i] >> 1;
            for (size_t j = x->arc_edge_begin[a]; j < x->arc_edge_begin[a + 1]; j++) {
                bw_cedge e = x->arc_edge[j];
                bw_half head = c->edge[e].half, h = head;
                if (head == BW_NONE) continue; /* split since: the next round sees its parts */
                do {
                    for (int s = 0; s < 2; s++) {
                        bw_cell cell = c->polygon[c->half[h].polygon].cell[s];
                        if (cell == BW_NONE || (size_t)cell >= x->cell_count || x->cell_block[cell] != block) continue;
                        start at = across_edge(c, e, cell);
                        bw_plane turned = bw_transition_plane(bw_complex_chart(x, cell), at.plane);
                        if (at.length > best.length && turned.axis == axis) best = at;
                    }
                    h = c->half[h].radial;
                } while (h != head);
            }
        }
    return best;
}

/* Whether a cut there is nearer to the middle of its block than another, which may be none. */
static bool better_middle(const bw_complex *x, bw_block block, int axis, int64_t place, int64_t *margin) {
    int64_t end = x->block_extent[block][axis], here = place < end - place ? place : end - place;
    if (here <= *margin) return false;
    *margin = here;
    return true;
}

/* Likewise at the vertex of a complex edge along the axis that is nearest to the middle of the block. A block that is one hex long has none. */
static start in_block(const bw_cells *c, const bw_complex *x, bw_block block, int axis) {
    start best = {.length = 0};
    int64_t margin = 0;
    for (size_t k = 12 * (size_t)block + 4 * (size_t)axis; k < 12 * (size_t)block + 4 * (size_t)axis + 4; k++)
        for (size_t i = x->block_edge_begin[k]; i < x->block_edge_begin[k + 1]; i++) {
            bw_arc a = x->block_edge[i] >> 1;
            for (size_t j = 2 * x->arc_edge_begin[a]; j < 2 * x->arc_edge_begin[a + 1]; j++) {
                bw_cedge e = x->arc_edge[j / 2];
                bw_half head = c->edge[e].half, h = head;
                do {
                    for (int s = 0; s < 2; s++) {
                        bw_cell cell = c->polygon[c->half[h].polygon].cell[s];
                        if (cell == BW_NONE || x->cell_block[cell] != block) continue;
                        start at = at_end(c, e, (int)(j % 2), cell);
                        bw_plane turned = bw_transition_plane(bw_complex_chart(x, cell), at.plane);
                        if (at.length && turned.axis == axis && better_middle(x, block, axis, turned.value, &margin)) best = at;
                    }
                    h = c->half[h].radial;
                } while (h != head);
            }
        }
    return best;
}

/* Cuts every block that touches itself across opposite sides; *cut counts them. */
static bw_status split_self_adjacent(bw_context *ctx, bw_cells *cells, const bw_complex *x, uint64_t max_cells, size_t *cut) {
    bw_fire fire;
    init_fire(&fire, ctx, cells, max_cells);
    bw_status status = BW_OK;
    bw_block last = BW_NONE;
    *cut = 0;
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++) {
        if (x->patch_block[p][0] != x->patch_block[p][1] || x->patch_block[p][0] == last) continue;
        if (x->patch_side[p][0] >> 1 != x->patch_side[p][1] >> 1 || x->patch_side[p][0] == x->patch_side[p][1]) continue;
        int axis = x->patch_side[p][0] >> 1;
        start from = cells->mesh->of_hexes ? in_block(cells, x, x->patch_block[p][0], axis) : across_block(cells, x, x->patch_block[p][0], axis);
        if (!from.length) continue;
        last = x->patch_block[p][0];
        ++*cut;
        status = ignite_start(&fire, from);
        if (status == BW_OK) status = bw_fire_run(&fire);
    }
    bw_fire_clear(&fire);
    return status;
}

bw_status bw_build_complex(bw_context *ctx, bw_cells *cells, const bw_build_options *options, bw_complex *complex) {
    size_t splits = 0, cut = options->split_self_adjacent;
    bw_status status = build_cuboids(ctx, cells, options->max_cells, complex, &splits);
    for (int round = 0; round < 8 && cut && status == BW_OK; round++) {
        status = split_self_adjacent(ctx, cells, complex, options->max_cells, &cut);
        if (!cut || status != BW_OK) break;
        bw_complex_clear(ctx, complex);
        status = build_cuboids(ctx, cells, options->max_cells, complex, &splits);
    }
    complex->torus_splits = splits;
    bw_progress(ctx, 0.7);
    if (status == BW_OK) status = bw_complex_check(ctx, cells, complex);
    return status;
}
