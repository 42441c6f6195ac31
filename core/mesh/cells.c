#include "mesh/cells.h"

#include <string.h>

#include "mesh/cells_geometry.h"

enum { UNKNOWN = 2 };

/* ---- storage ------------------------------------------------------------------------------------------------------- */

void bw_cells_clear(bw_context *ctx, bw_cells *cells) {
    bw_free(ctx, cells->vertex), bw_free(ctx, cells->edge), bw_free(ctx, cells->half);
    bw_free(ctx, cells->polygon), bw_free(ctx, cells->cell);
    bw_free(ctx, cells->sign), bw_free(ctx, cells->touched);
    memset(cells, 0, sizeof *cells);
}

/* Room for everything that one cut of a cell with `size` half-edges can add. */
static bw_status make_room(bw_context *ctx, bw_cells *c, size_t polygons, size_t halves, size_t radial) {
    bw_status s = bw_reserve(ctx, &c->vertex, &c->vertex_room, c->vertex_count + halves);
    if (s == BW_OK) s = bw_reserve(ctx, &c->edge, &c->edge_room, c->edge_count + 2 * halves + polygons);
    if (s == BW_OK) s = bw_reserve(ctx, &c->half, &c->half_room, c->half_count + radial + 4 * polygons + halves);
    if (s == BW_OK) s = bw_reserve(ctx, &c->polygon, &c->polygon_room, c->polygon_count + 2 * polygons + 1);
    if (s == BW_OK) s = bw_reserve(ctx, &c->cell, &c->cell_room, c->cell_count + 1);
    if (s == BW_OK && c->sign_room < c->vertex_room) {
        size_t before = c->sign_room;
        s = bw_reserve(ctx, &c->sign, &c->sign_room, c->vertex_room);
        if (s == BW_OK) memset(c->sign + before, UNKNOWN, c->sign_room - before);
    }
    if (s == BW_OK && (c->vertex_count > INT32_MAX / 4 || c->half_count > INT32_MAX / 4))
        s = bw_fail(ctx, BW_E_LIMIT, "the cut complex has more elements than a 32-bit index can name");
    return s;
}

static void link_radial(bw_cells *c, bw_half h, bw_cedge e) {
    c->half[h].edge = e;
    bw_half head = c->edge[e].half;
    if (head == BW_NONE) {
        c->edge[e].half = c->half[h].radial = h;
    } else {
        c->half[h].radial = c->half[head].radial;
        c->half[head].radial = h;
    }
}

static bw_cedge mesh_edge_between(const bw_tet_mesh *mesh, bw_tet t, bw_vertex a, bw_vertex b) {
    return mesh->tet_edge[t][bw_tet_edge_of[bw_tet_corner(mesh, t, a)][bw_tet_corner(mesh, t, b)]];
}

static void init_polygon(bw_cells *c, bw_facet f) {
    const bw_tet_mesh *mesh = c->mesh;
    bw_cell_polygon *p = &c->polygon[f];
    bool boundary = mesh->facet_tet[f][1] == BW_NONE;
    *p = (bw_cell_polygon){.axis = -1, .carrier = f, .half = 3 * f, .parent = BW_NONE,
                           .cell = {mesh->facet_tet[f][0], mesh->facet_tet[f][1]}, .in_cell = {BW_NONE, BW_NONE},
                           .kind = BW_IN_FACET, .flags = boundary ? BW_WALL | BW_BOUNDARY : 0};
    const int64_t *x[3];
    for (int i = 0; i < 3; i++)
        x[i] = c->map->value[p->cell[0]][bw_tet_corner(mesh, p->cell[0], mesh->facet[f][i])];
    for (int8_t k = 0; k < 3; k++)
        if (x[0][k] == x[1][k] && x[0][k] == x[2][k]) p->axis = k, p->value = x[0][k];
    for (int i = 0; i < 3; i++) {
        bw_half h = 3 * f + i;
        bw_vertex a = mesh->facet[f][i], b = mesh->facet[f][(i + 1) % 3];
        c->half[h] = (bw_cell_half){.origin = a, .polygon = f, .next = 3 * f + (i + 1) % 3};
        link_radial(c, h, mesh_edge_between(mesh, p->cell[0], a, b));
    }
}

bw_status bw_cells_init(bw_context *ctx, bw_cells *cells, const bw_tet_mesh *mesh, const bw_grid_map *map) {
    memset(cells, 0, sizeof *cells);
    cells->mesh = mesh, cells->map = map;
    if (mesh->facet_count > INT32_MAX / 16) return bw_fail(ctx, BW_E_LIMIT, "the mesh has more facets than can be cut");
    cells->vertex_count = mesh->vertex_count, cells->edge_count = mesh->edge_count;
    cells->polygon_count = mesh->facet_count, cells->half_count = 3 * mesh->facet_count;
    cells->cell_count = mesh->tet_count;
    bw_status status = make_room(ctx, cells, 0, 0, 0);
    if (status != BW_OK) return status;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        cells->vertex[v] = (bw_cell_vertex){.kind = BW_IN_VERTEX, .carrier = (int32_t)v};
    for (size_t e = 0; e < mesh->edge_count; e++)
        cells->edge[e] = (bw_cell_edge){.carrier = (int32_t)e, .vertex = {mesh->edge[e][0], mesh->edge[e][1]},
                                        .half = BW_NONE, .child = BW_NONE, .kind = BW_IN_EDGE};
    for (size_t f = 0; f < mesh->facet_count; f++) init_polygon(cells, (bw_facet)f);
    for (size_t t = 0; t < mesh->tet_count; t++) {
        cells->cell[t] = (bw_cell_body){.tet = (bw_tet)t, .first = BW_NONE};
        for (int i = 3; i >= 0; i--) {
            bw_polygon p = mesh->tet_facet[t][i];
            cells->polygon[p].in_cell[cells->polygon[p].cell[0] != (bw_cell)t] = cells->cell[t].first;
            cells->cell[t].first = p;
        }
    }
    return BW_OK;
}

/* ---- splitting ----------------------------------------------------------------------------------------------------- */

/* Splits an edge at a new vertex; every polygon around it gets the vertex. Room was made by the caller. */
static bw_cvertex split_edge(bw_cells *c, bw_cedge e, const bw_cell_vertex *at) {
    bw_cvertex v = (bw_cvertex)c->vertex_count++;
    c->vertex[v] = *at;
    bw_cedge child = (bw_cedge)c->edge_count;
    c->edge_count += 2;
    for (int i = 0; i < 2; i++) {
        bw_cell_edge *x = &c->edge[child + i];
        *x = c->edge[e];
        x->vertex[!i] = v;
        x->half = BW_NONE;
    }
    c->edge[e].child = child;
    bw_half head = c->edge[e].half, h = head;
    do {
        bw_half following = c->half[h].radial, h2 = (bw_half)c->half_count++;
        bw_half next = c->half[h].next;
        bool forward = c->half[h].origin == c->edge[e].vertex[0];
        c->half[h2] = (bw_cell_half){.origin = v, .polygon = c->half[h].polygon, .next = next};
        c->half[h].next = h2;
        link_radial(c, h, child + !forward);
        link_radial(c, h2, child + forward);
        h = following;
    } while (h != head);
    c->edge[e].half = BW_NONE;
    return v;
}

static void replace_in_cell(bw_cells *c, bw_cell cell, bw_polygon old, const bw_polygon child[2]) {
    bw_polygon rest = bw_cells_next_in_cell(c, old, cell);
    c->polygon[child[0]].in_cell[c->polygon[child[0]].cell[0] != cell] = child[1];
    c->polygon[child[1]].in_cell[c->polygon[child[1]].cell[0] != cell] = rest;
    if (c->cell[cell].first == old) {
        c->cell[cell].first = child[0];
        return;
    }
    bw_polygon p = c->cell[cell].first;
    while (bw_cells_next_in_cell(c, p, cell) != old) p = bw_cells_next_in_cell(c, p, cell);
    c->polygon[p].in_cell[c->polygon[p].cell[0] != cell] = child[0];
}

/* Gives the half-edges from `first` up to (not including) `end` to polygon p and closes the cycle with a half-edge of e. */
static void close_cycle(bw_cells *c, bw_polygon p, bw_half first, bw_half last, bw_cvertex from, bw_cedge e) {
    bw_half h = (bw_half)c->half_count++;
    c->half[h] = (bw_cell_half){.origin = from, .polygon = p, .next = first};
    c->half[last].next = h;
    link_radial(c, h, e);
    c->polygon[p].half = first;
    for (bw_half x = first; x != h; x = c->half[x].next) c->half[x].polygon = p;
}

/* Splits a polygon by a new edge between the origins of two of its half-edges. child[0] is the side after h[0]. */
static void split_polygon(bw_cells *c, bw_polygon p, const bw_half h[2], const bw_cell_edge *line, bw_polygon child[2]) {
    bw_cedge e = (bw_cedge)c->edge_count++;
    c->edge[e] = *line;
    c->edge[e].vertex[0] = c->half[h[0]].origin, c->edge[e].vertex[1] = c->half[h[1]].origin;
    bw_half last[2] = {bw_cells_half_previous(c, h[1]), bw_cells_half_previous(c, h[0])};
    for (int i = 0; i < 2; i++) {
        child[i] = (bw_polygon)c->polygon_count++;
        c->polygon[child[i]] = c->polygon[p];
        c->polygon[child[i]].parent = p;
    }
    close_cycle(c, child[0], h[0], last[0], c->edge[e].vertex[1], e);
    close_cycle(c, child[1], h[1], last[1], c->edge[e].vertex[0], e);
    for (int i = 0; i < 2; i++)
        if (c->polygon[p].cell[i] != BW_NONE) replace_in_cell(c, c->polygon[p].cell[i], p, child);
    c->polygon[p].half = BW_NONE;
    c->polygon[p].in_cell[0] = child[0];
}

/* ---- cutting ------------------------------------------------------------------------------------------------------- */

typedef struct {
    bw_cell cell;
    bw_tet tet;
    bw_plane plane;
    size_t touched; /* vertices whose sign is set */
} cut;

#define FOR_POLYGONS(c, p, cell_)                                                                                     \
    for (bw_polygon p = (c)->cell[cell_].first; p != BW_NONE; p = bw_cells_next_in_cell((c), p, (cell_)))

static void set_sign(bw_cells *c, cut *k, bw_cvertex v, int sign) {
    c->sign[v] = (int8_t)sign;
    c->touched[k->touched++] = v;
}

/* Signs of all vertices of the cell; *found has bit 0 if some are negative, bit 1 if some are positive. */
static bw_status classify(bw_context *ctx, bw_cells *c, cut *k, int *found) {
    size_t polygons = 0, halves = 0, radial = 0;
    FOR_POLYGONS(c, p, k->cell) {
        polygons++;
        bw_half h = c->polygon[p].half;
        do {
            halves++;
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    bw_status status = bw_reserve(ctx, &c->touched, &c->touched_room, 2 * halves);
    if (status == BW_OK && c->sign_room < c->vertex_count) status = make_room(ctx, c, 0, 0, 0);
    if (status != BW_OK) return status;
    FOR_POLYGONS(c, p, k->cell) {
        bw_half h = c->polygon[p].half;
        do {
            bw_cvertex v = c->half[h].origin;
            if (c->sign[v] == UNKNOWN) {
                int sign = bw_cells_side(c, v, k->tet, k->plane);
                set_sign(c, k, v, sign);
                *found |= sign < 0 ? 1 : sign > 0 ? 2 : 0;
            }
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    if (*found != 3) return BW_OK;
    FOR_POLYGONS(c, p, k->cell) {
        bw_half h = c->polygon[p].half;
        do {
            if (c->sign[c->half[h].origin] * c->sign[bw_cells_half_end(c, h)] < 0)
                for (bw_half r = c->half[h].radial; r != h; r = c->half[r].radial) radial++;
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    return make_room(ctx, c, polygons, halves, radial + halves);
}

static void split_crossed_edges(bw_cells *c, cut *k) {
    FOR_POLYGONS(c, p, k->cell) {
        bw_half h = c->polygon[p].half;
        do {
            if (c->sign[c->half[h].origin] * c->sign[bw_cells_half_end(c, h)] < 0) {
                bw_cell_vertex at = bw_cells_crossing(c, c->half[h].edge, k->tet, k->plane);
                set_sign(c, k, split_edge(c, c->half[h].edge, &at), 0);
            }
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
}

/* The edge that the cut leaves in a polygon: it lies where the polygon lies, in one more plane. */
static bw_cell_edge section_line(const bw_cells *c, const cut *k, bw_polygon p) {
    bw_cell_edge line = {.kind = c->polygon[p].kind, .carrier = c->polygon[p].carrier, .half = BW_NONE, .child = BW_NONE};
    int sign;
    if (line.kind == BW_IN_TET) line.axis = (int8_t)(3 - c->polygon[p].axis - k->plane.axis);
    else line.axis = bw_cells_plane_at_home(c, line.carrier, k->tet, k->plane, &sign).axis;
    return line;
}

static void split_crossed_polygons(bw_cells *c, cut *k) {
    for (bw_polygon p = c->cell[k->cell].first, next; p != BW_NONE; p = next) {
        next = bw_cells_next_in_cell(c, p, k->cell);
        bw_half zero[2] = {BW_NONE, BW_NONE}, h = c->polygon[p].half;
        int found = 0, zeros = 0;
        do {
            int sign = c->sign[c->half[h].origin];
            found |= sign < 0 ? 1 : sign > 0 ? 2 : 0;
            if (sign == 0 && zeros++ < 2) zero[zeros - 1] = h;
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
        if (found != 3) continue;
        bw_cell_edge line = section_line(c, k, p);
        bw_polygon child[2];
        split_polygon(c, p, zero, &line, child);
    }
}

/* Side of a polygon that the plane does not cross. */
static int polygon_side(const bw_cells *c, bw_polygon p) {
    bw_half h = c->polygon[p].half;
    do {
        if (c->sign[c->half[h].origin]) return c->sign[c->half[h].origin];
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    return 0;
}

/* The section's boundary: the edges in the plane, each seen once from its polygon on the negative side, reversed and put in order. */
static bw_polygon make_section(bw_cells *c, const cut *k, bw_cell other) {
    bw_polygon section = (bw_polygon)c->polygon_count++;
    bw_half begin = (bw_half)c->half_count;
    FOR_POLYGONS(c, p, k->cell) {
        if (polygon_side(c, p) > 0) continue;
        bw_half h = c->polygon[p].half;
        do {
            if (c->sign[c->half[h].origin] == 0 && c->sign[bw_cells_half_end(c, h)] == 0)
                c->half[c->half_count++] = (bw_cell_half){.origin = c->half[h].origin, .edge = c->half[h].edge, .polygon = section};
            h = c->half[h].next;
        } while (h != c->polygon[p].half);
    }
    bw_half end = (bw_half)c->half_count;
    bw_cvertex from = c->half[begin].origin; /* orientations of the polygons are arbitrary: order by shared vertices */
    for (bw_half h = begin; h < end; h++) {
        for (bw_half x = h; x < end; x++) {
            const bw_cell_edge *e = &c->edge[c->half[x].edge];
            if (e->vertex[0] != from && e->vertex[1] != from) continue;
            bw_cell_half swap = c->half[h];
            c->half[h] = c->half[x], c->half[x] = swap;
            break;
        }
        const bw_cell_edge *e = &c->edge[c->half[h].edge];
        c->half[h].origin = from;
        from = e->vertex[e->vertex[0] == from];
        c->half[h].next = h + 1 < end ? h + 1 : begin;
        link_radial(c, h, c->half[h].edge);
    }
    c->polygon[section] = (bw_cell_polygon){.value = k->plane.value, .axis = k->plane.axis, .carrier = k->tet, .half = begin,
                                            .cell = {k->cell, other}, .in_cell = {BW_NONE, BW_NONE}, .parent = BW_NONE,
                                            .kind = BW_IN_TET};
    return section;
}

/* Distributes the polygons of the cut cell over it (negative side) and the new cell (positive side). */
static void divide_cell(bw_cells *c, const cut *k, bw_cell other, bw_polygon section) {
    bw_polygon next, tail[2] = {section, section};
    bw_polygon p = c->cell[k->cell].first;
    c->cell[k->cell].first = c->cell[other].first = section;
    for (; p != BW_NONE; p = next) {
        next = bw_cells_next_in_cell(c, p, k->cell);
        int side = polygon_side(c, p) > 0, slot = c->polygon[p].cell[0] != k->cell;
        if (side) c->polygon[p].cell[slot] = other;
        c->polygon[p].in_cell[slot] = BW_NONE;
        bw_cell owner = side ? other : k->cell;
        c->polygon[tail[side]].in_cell[c->polygon[tail[side]].cell[0] != owner] = p;
        tail[side] = p;
    }
}

bw_status bw_cells_cut(bw_context *ctx, bw_cells *cells, bw_cell cell, bw_plane plane, bw_polygon *section) {
    cut k = {.cell = cell, .tet = cells->cell[cell].tet, .plane = plane};
    int found = 0;
    *section = BW_NONE;
    bw_status status = classify(ctx, cells, &k, &found);
    if (status == BW_OK && found == 3) {
        split_crossed_edges(cells, &k);
        split_crossed_polygons(cells, &k);
        bw_cell other = (bw_cell)cells->cell_count++;
        cells->cell[other] = (bw_cell_body){.tet = k.tet, .first = BW_NONE};
        *section = make_section(cells, &k, other);
        divide_cell(cells, &k, other, *section);
    } else if (status == BW_OK) {
        FOR_POLYGONS(cells, p, cell)
        if (polygon_side(cells, p) == 0) *section = p;
    }
    for (size_t i = 0; i < k.touched; i++) cells->sign[cells->touched[i]] = UNKNOWN;
    return status;
}

bw_transition bw_cells_transition(const bw_cells *cells, bw_polygon polygon, bw_cell from) {
    const bw_cell_polygon *p = &cells->polygon[polygon];
    if (p->kind == BW_IN_TET) return (bw_transition){{0, 0, 0}, 0};
    return bw_grid_map_across(cells->mesh, cells->map, p->carrier, cells->cell[from].tet);
}
