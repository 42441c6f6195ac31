#include "mesh/cells.h"

#include <string.h>

#include "mesh/cells_geometry.h"

enum { UNKNOWN = 2 };
enum { BELOW = 1, ABOVE = 2 }; /* sides of a plane on which something has vertices */

struct bw_cut_corner {
    bw_half half;
    bw_cvertex origin;
    int sign; /* of the origin */
};

struct bw_cut_face {
    bw_polygon polygon;
    uint32_t begin; /* its corners, up to the next face's */
    unsigned sides;
    bw_polygon part; /* if it was split: the part below the plane; the other has the number before or after it */
};

typedef struct bw_cut_corner corner;
typedef struct bw_cut_face face;

/* ---- storage ------------------------------------------------------------------------------------------------------- */

void bw_cells_clear(bw_context *ctx, bw_cells *cells) {
    bw_free(ctx, cells->vertex), bw_free(ctx, cells->edge), bw_free(ctx, cells->half);
    bw_free(ctx, cells->polygon), bw_free(ctx, cells->list), bw_free(ctx, cells->cut_from);
    bw_free(ctx, cells->section), bw_free(ctx, cells->distance), bw_free(ctx, cells->of_edge), bw_free(ctx, cells->of_facet);
    bw_free(ctx, cells->sign), bw_free(ctx, cells->face), bw_free(ctx, cells->corner);
    memset(cells, 0, sizeof *cells);
}

bw_status bw_cells_trim(bw_context *ctx, bw_cells *c) {
    bw_status s = bw_trim(ctx, &c->vertex, &c->vertex_room, c->vertex_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->edge, &c->edge_room, c->edge_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->half, &c->half_room, c->half_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->polygon, &c->polygon_room, c->polygon_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->list, &c->cell_room, c->cell_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->cut_from, &c->cut_room, c->cell_count - c->mesh->tet_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->section, &c->section_room, c->cell_count - c->mesh->tet_count);
    if (s == BW_OK) s = bw_trim(ctx, &c->distance, &c->distance_room, c->distance_count);
    bw_free(ctx, c->sign), bw_free(ctx, c->face), bw_free(ctx, c->corner);
    c->sign = NULL, c->face = NULL, c->corner = NULL;
    c->sign_room = c->face_room = c->corner_room = 0;
    return s;
}

/* Room for a sign of every vertex there is room for. */
static bw_status make_room_for_signs(bw_context *ctx, bw_cells *c) {
    size_t before = c->sign_room;
    bw_status s = bw_reserve(ctx, &c->sign, &c->sign_room, c->vertex_room);
    if (s == BW_OK && c->sign_room > before) memset(c->sign + before, UNKNOWN, c->sign_room - before);
    return s;
}

/* Room for what one cut of a cell adds, but for half-edges in polygons that only touch it. */
static bw_status make_room(bw_context *ctx, bw_cells *c, size_t polygons, size_t halves) {
    bw_status s = bw_reserve(ctx, &c->vertex, &c->vertex_room, c->vertex_count + halves);
    if (s == BW_OK) s = bw_reserve(ctx, &c->edge, &c->edge_room, c->edge_count + 2 * halves + polygons);
    if (s == BW_OK) s = bw_reserve(ctx, &c->half, &c->half_room, c->half_count + 4 * polygons + 2 * halves);
    if (s == BW_OK) s = bw_reserve(ctx, &c->polygon, &c->polygon_room, c->polygon_count + 2 * polygons + 1);
    if (s == BW_OK) s = bw_reserve(ctx, &c->list, &c->cell_room, c->cell_count + 1);
    if (s == BW_OK) s = bw_reserve(ctx, &c->cut_from, &c->cut_room, c->cell_count + 1 - c->mesh->tet_count);
    if (s == BW_OK) s = bw_reserve(ctx, &c->section, &c->section_room, c->cell_count + 1 - c->mesh->tet_count);
    if (s == BW_OK) s = make_room_for_signs(ctx, c);
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

/* ---- the uncut complex --------------------------------------------------------------------------------------------- */

/* The complex edge of a whole mesh edge between vertices a and b, made if there is none yet. */
static bw_status edge_of(bw_context *ctx, bw_cells *c, bw_edge edge, bw_vertex a, bw_vertex b, bw_cedge *out) {
    *out = c->of_edge[edge];
    if (*out != BW_NONE) return BW_OK;
    bw_status status = bw_reserve(ctx, &c->edge, &c->edge_room, c->edge_count + 1);
    if (status != BW_OK) return status;
    *out = c->of_edge[edge] = (bw_cedge)c->edge_count++;
    c->edge[*out] = (bw_cell_edge){.carrier = edge, .vertex = {a < b ? a : b, a < b ? b : a},
                                   .half = BW_NONE, .child = BW_NONE, .kind = BW_IN_EDGE};
    return BW_OK;
}

/* Half-edges of a new polygon from vertex `from` along an edge, or along its parts if it was split; they get consecutive numbers. */
static bw_status add_halves(bw_context *ctx, bw_cells *c, bw_polygon p, bw_cvertex from, bw_cedge e) {
    bw_status status = BW_OK;
    if (c->edge[e].child != BW_NONE) {
        int first = c->edge[e].vertex[0] != from;
        status = add_halves(ctx, c, p, from, bw_cells_edge_part(c, e, first));
        if (status == BW_OK)
            status = add_halves(ctx, c, p, c->edge[bw_cells_edge_part(c, e, 0)].vertex[1], bw_cells_edge_part(c, e, !first));
        return status;
    }
    status = bw_reserve(ctx, &c->half, &c->half_room, c->half_count + 1);
    if (status != BW_OK) return status;
    bw_half h = (bw_half)c->half_count++;
    c->half[h] = (bw_cell_half){.origin = from, .polygon = p, .next = h + 1};
    link_radial(c, h, e);
    return BW_OK;
}

/* The corners of a tet at its facet i, by ascending vertices: the order of bw_tet_mesh.facet. */
static void corners_of_facet(const bw_tet_mesh *mesh, bw_tet t, int i, int at[3]) {
    const bw_vertex *v = mesh->tet[t];
    for (int n = 0, k = 0; k < 4; k++) {
        if (k == i) continue;
        int j = n++;
        for (; j > 0 && v[k] < v[at[j - 1]]; j--) at[j] = at[j - 1];
        at[j] = k;
    }
}

/* A facet as a polygon, as one of its tets sees it: what the other knows of it is the same, but for the chart. */
static bw_cell_polygon uncut_facet(const bw_cells *c, bw_facet f, bw_tet t, const int at[3]) {
    const bw_tet *tet = c->mesh->facet_tet[f];
    bw_cell_polygon p = {.axis = -1, .carrier = f, .half = (bw_half)c->half_count, .burnt = BW_NONE,
                         .cell = {tet[0], tet[1]}, .in_cell = {BW_NONE, BW_NONE},
                         .kind = BW_IN_FACET, .flags = tet[1] == BW_NONE ? BW_WALL | BW_BOUNDARY : 0};
    const int64_t(*x)[3] = (const int64_t(*)[3])c->map->value[t];
    for (int8_t k = 0; k < 3; k++)
        if (x[at[0]][k] == x[at[1]][k] && x[at[0]][k] == x[at[2]][k]) p.axis = k;
    if (p.axis >= 0 && t != tet[0]) p.axis = bw_rotation_image[bw_rotation_inverse(bw_grid_map_rotation(c->map, f))][p.axis];
    return p;
}

/* The polygon of facet i of a tet, made if there is none yet. */
static bw_status polygon_of(bw_context *ctx, bw_cells *c, bw_tet t, int i, bw_polygon *out) {
    const bw_tet_mesh *mesh = c->mesh;
    bw_facet f = mesh->tet_facet[t][i];
    *out = c->of_facet[f];
    if (*out != BW_NONE) return BW_OK;
    bw_status status = bw_reserve(ctx, &c->polygon, &c->polygon_room, c->polygon_count + 1);
    if (status != BW_OK) return status;
    int at[3];
    corners_of_facet(mesh, t, i, at);
    *out = c->of_facet[f] = (bw_polygon)c->polygon_count++;
    c->polygon[*out] = uncut_facet(c, f, t, at);
    for (int k = 0; k < 3 && status == BW_OK; k++) {
        int a = at[k], b = at[(k + 1) % 3];
        bw_cedge e;
        status = edge_of(ctx, c, mesh->tet_edge[t][bw_tet_edge_of[a][b]], mesh->tet[t][a], mesh->tet[t][b], &e);
        if (status == BW_OK) status = add_halves(ctx, c, *out, mesh->tet[t][a], e);
    }
    if (status == BW_OK) c->half[c->half_count - 1].next = c->polygon[*out].half;
    return status;
}

bw_status bw_cells_polygon_of(bw_context *ctx, bw_cells *c, bw_facet f, bw_polygon *out) {
    bw_tet t = c->mesh->facet_tet[f][0];
    int i = 0;
    while (c->mesh->tet_facet[t][i] != f) i++;
    return polygon_of(ctx, c, t, i, out);
}

/* Appends the leaves of a facet's polygon to the list of a tet: after polygon `last`, or as the first if that is BW_NONE. */
static void append_leaves(bw_cells *c, bw_tet t, bw_polygon p, bw_polygon *last) {
    if (!bw_cells_polygon_is_leaf(c, p)) {
        for (int i = 0; i < 2; i++) append_leaves(c, t, bw_cells_polygon_part(c, p, i), last);
        return;
    }
    c->polygon[p].in_cell[c->polygon[p].cell[0] != t] = BW_NONE;
    if (*last == BW_NONE) c->list[t] = p;
    else c->polygon[*last].in_cell[c->polygon[*last].cell[0] != t] = p;
    *last = p;
}

bw_status bw_cells_open(bw_context *ctx, bw_cells *cells, bw_tet tet) {
    if (bw_cells_is_open(cells, tet)) return BW_OK;
    bw_polygon polygon[4], last = BW_NONE;
    for (int i = 0; i < 4; i++) {
        bw_status status = polygon_of(ctx, cells, tet, i, &polygon[i]);
        if (status != BW_OK) return status;
    }
    for (int i = 0; i < 4; i++) append_leaves(cells, tet, polygon[i], &last);
    return BW_OK;
}

bw_status bw_cells_open_all(bw_context *ctx, bw_cells *cells) {
    bw_status status = BW_OK;
    for (size_t t = 0; t < cells->mesh->tet_count && status == BW_OK; t++) status = bw_cells_open(ctx, cells, (bw_tet)t);
    return status;
}

static int32_t *alloc_none(bw_context *ctx, size_t count) {
    int32_t *list = bw_alloc(ctx, count, sizeof *list);
    if (list) memset(list, 0xff, count * sizeof *list); /* BW_NONE */
    return list;
}

bw_status bw_cells_init(bw_context *ctx, bw_cells *cells, const bw_tet_mesh *mesh, const bw_grid_map *map) {
    memset(cells, 0, sizeof *cells);
    cells->mesh = mesh, cells->map = map;
    if (mesh->facet_count > INT32_MAX / 16) return bw_fail(ctx, BW_E_LIMIT, "the mesh has more facets than can be cut");
    cells->vertex_count = cells->vertex_room = mesh->vertex_count;
    cells->cell_count = cells->cell_room = mesh->tet_count;
    cells->vertex = bw_alloc(ctx, mesh->vertex_count, sizeof *cells->vertex);
    cells->list = alloc_none(ctx, mesh->tet_count);
    cells->of_edge = alloc_none(ctx, mesh->edge_count);
    cells->of_facet = alloc_none(ctx, mesh->facet_count);
    bw_status status = ctx->error.status;
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        cells->vertex[v] = (bw_cell_vertex){.kind = BW_IN_VERTEX, .carrier = (int32_t)v};
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) {
        bw_polygon boundary;
        if (mesh->facet_tet[f][1] == BW_NONE) status = bw_cells_polygon_of(ctx, cells, (bw_facet)f, &boundary);
    }
    return status;
}

/* ---- splitting ----------------------------------------------------------------------------------------------------- */

/* Splits an edge at a new vertex; every polygon around it gets the vertex. */
static bw_status split_edge(bw_context *ctx, bw_cells *c, bw_cedge e, const bw_cell_vertex *at) {
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
        bw_status status = bw_reserve(ctx, &c->half, &c->half_room, c->half_count + 1);
        if (status != BW_OK) return status;
        bw_half following = c->half[h].radial, h2 = (bw_half)c->half_count++;
        bool forward = c->half[h].origin == c->edge[e].vertex[0];
        c->half[h2] = (bw_cell_half){.origin = v, .polygon = c->half[h].polygon, .next = c->half[h].next};
        c->half[h].next = h2;
        link_radial(c, h, child + !forward);
        link_radial(c, h2, child + forward);
        h = following;
    } while (h != head);
    c->edge[e].half = BW_NONE;
    return BW_OK;
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

/* Splits a polygon by a new edge between the origins of two of its half-edges: its first part is the side after h[0]. In the list of the cell
 * across, the parts follow each other and lead on where the polygon did; that of `cell`, which is being cut, is made anew afterwards. */
static bw_polygon split_polygon(bw_cells *c, bw_cell cell, bw_polygon p, const bw_half h[2], const bw_cell_edge *line) {
    bw_cedge e = (bw_cedge)c->edge_count++;
    c->edge[e] = *line;
    c->edge[e].vertex[0] = c->half[h[0]].origin, c->edge[e].vertex[1] = c->half[h[1]].origin;
    bw_half last[2] = {bw_cells_half_previous(c, h[1]), bw_cells_half_previous(c, h[0])};
    bw_polygon part = (bw_polygon)c->polygon_count;
    c->polygon_count += 2;
    for (int i = 0; i < 2; i++) {
        c->polygon[part + i] = c->polygon[p];
        close_cycle(c, part + i, h[i], last[i], c->edge[e].vertex[!i], e);
    }
    c->polygon[part].in_cell[c->polygon[p].cell[0] == cell] = part + 1;
    c->polygon[p].half = BW_NONE;
    c->polygon[p].in_cell[0] = part;
    return part;
}

/* ---- cutting ------------------------------------------------------------------------------------------------------- */

typedef struct {
    bw_cell cell;
    bw_tet tet;
    bw_plane plane;
    size_t faces, corners; /* in the scratch arrays; face[faces] ends the last one */
    unsigned sides;        /* of the cell */
} cut;

static unsigned side_of(int sign) { return sign < 0 ? BELOW : sign > 0 ? ABOVE : 0; }

/* The three steps of looking at a cell. Each touches memory all over the place and tells the processor what the next will need. */
static bw_status collect_faces(bw_context *ctx, bw_cells *c, cut *k) {
    bw_polygon p = bw_cells_first_in_cell(c, k->cell);
    for (;; p = bw_cells_next_in_cell(c, p, k->cell), k->faces++) {
        bw_status status = bw_reserve(ctx, &c->face, &c->face_room, k->faces + 1);
        if (status != BW_OK) return status;
        c->face[k->faces] = (face){.polygon = p, .part = BW_NONE};
        if (p == BW_NONE) return BW_OK;
        __builtin_prefetch(&c->half[c->polygon[p].half]);
    }
}

static bw_status collect_corners(bw_context *ctx, bw_cells *c, cut *k) {
    for (face *f = c->face; f < c->face + k->faces; f++) {
        f->begin = (uint32_t)k->corners;
        bw_half first = c->polygon[f->polygon].half, h = first;
        do {
            bw_status status = bw_reserve(ctx, &c->corner, &c->corner_room, k->corners + 1);
            if (status != BW_OK) return status;
            bw_cvertex v = c->half[h].origin;
            c->corner[k->corners++] = (corner){h, v, 0};
            __builtin_prefetch(&c->sign[v]);
            __builtin_prefetch(&c->vertex[v]);
            h = c->half[h].next;
        } while (h != first);
    }
    c->face[k->faces].begin = (uint32_t)k->corners;
    return BW_OK;
}

static void classify(bw_cells *c, cut *k) {
    for (face *f = c->face; f < c->face + k->faces; k->sides |= f->sides, f++)
        for (corner *x = c->corner + f->begin; x < c->corner + f[1].begin; x++) {
            if (c->sign[x->origin] == UNKNOWN) c->sign[x->origin] = (int8_t)bw_cells_side(c, x->origin, k->tet, k->plane);
            x->sign = c->sign[x->origin];
            f->sides |= side_of(x->sign);
        }
}

/* The corner after corner i of a face. */
static const corner *after(const bw_cells *c, const face *f, uint32_t i) { return &c->corner[i + 1 < f[1].begin ? i + 1 : f->begin]; }

static bw_status split_crossed_edges(bw_context *ctx, bw_cells *c, const cut *k) {
    bw_status status = BW_OK;
    for (const face *f = c->face; f < c->face + k->faces; f++)
        for (uint32_t i = f->begin; i < f[1].begin && f->sides == (BELOW | ABOVE) && status == BW_OK; i++) {
            bw_half h = c->corner[i].half;
            if (c->corner[i].sign * after(c, f, i)->sign >= 0) continue;
            if (c->sign[bw_cells_half_end(c, h)] == 0) continue; /* was split from its other polygon */
            bw_cell_vertex at = bw_cells_crossing(c, c->half[h].edge, k->tet, k->plane);
            c->sign[c->vertex_count] = 0;
            status = split_edge(ctx, c, c->half[h].edge, &at);
        }
    return status;
}

/* The edge that the cut leaves in a polygon: it lies where the polygon lies, in one more plane. */
static bw_cell_edge section_line(const bw_cells *c, const cut *k, bw_polygon p) {
    bw_cell_edge line = {.kind = c->polygon[p].kind, .half = BW_NONE, .child = BW_NONE};
    int sign;
    if (line.kind == BW_IN_TET) {
        line.carrier = k->tet;
        line.axis = (int8_t)(3 - c->polygon[p].axis - k->plane.axis);
    } else {
        line.carrier = c->polygon[p].carrier;
        line.axis = bw_cells_plane_at_home(c, line.carrier, k->tet, k->plane, &sign).axis;
    }
    return line;
}

static void split_crossed_polygons(bw_cells *c, const cut *k) {
    for (face *f = c->face; f < c->face + k->faces; f++) {
        if (f->sides != (BELOW | ABOVE)) continue;
        bw_half zero[2] = {BW_NONE, BW_NONE};
        int zeros = 0, first_side = 0; /* sign of what follows zero[0] */
        for (uint32_t i = f->begin; i < f[1].begin && zeros < 2; i++) {
            int sign = c->corner[i].sign, next = after(c, f, i)->sign;
            if (sign == 0) zero[zeros++] = c->corner[i].half;
            else if (sign * next < 0) zero[zeros++] = c->half[c->corner[i].half].next;
            if (zeros == 1 && first_side == 0) first_side = next;
        }
        bw_cell_edge line = section_line(c, k, f->polygon);
        bw_polygon part = split_polygon(c, k->cell, f->polygon, zero, &line);
        f->part = first_side < 0 ? part : part + 1;
    }
}

/* The half-edges of the section: the edges in the plane, each taken once from its polygon below. */
static void collect_section(bw_cells *c, const cut *k, bw_polygon section) {
    for (const face *f = c->face; f < c->face + k->faces; f++) {
        if (f->part != BW_NONE) { /* its last half-edge, before the first, is the new one */
            bw_half h = bw_cells_half_previous(c, c->polygon[f->part].half);
            c->half[c->half_count++] = (bw_cell_half){.origin = c->half[h].origin, .edge = c->half[h].edge, .polygon = section};
        }
        for (uint32_t i = f->begin; i < f[1].begin && f->sides == BELOW; i++) {
            bw_half h = c->corner[i].half;
            if (c->corner[i].sign == 0 && after(c, f, i)->sign == 0)
                c->half[c->half_count++] = (bw_cell_half){.origin = c->half[h].origin, .edge = c->half[h].edge, .polygon = section};
        }
    }
}

/* Makes the polygon in the plane. The polygons around it have arbitrary orientations: its half-edges are put in order by shared vertices. */
static bw_polygon make_section(bw_cells *c, const cut *k, bw_cell other) {
    bw_polygon section = (bw_polygon)c->polygon_count++;
    int32_t cut_index = other - (bw_cell)c->mesh->tet_count;
    bw_half begin = (bw_half)c->half_count;
    collect_section(c, k, section);
    bw_half end = (bw_half)c->half_count;
    bw_cvertex from = c->half[begin].origin;
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
    c->polygon[section] = (bw_cell_polygon){.axis = k->plane.axis, .carrier = cut_index, .half = begin,
                                            .cell = {k->cell, other}, .in_cell = {BW_NONE, BW_NONE}, .burnt = BW_NONE,
                                            .kind = BW_IN_TET};
    c->section[cut_index] = k->plane.value;
    return section;
}

/* Appends a polygon of the cut cell to the list of its half below or above. */
static void hand_over(bw_cells *c, const cut *k, bw_cell other, bw_polygon p, bool above, bw_polygon tail[2]) {
    int slot = c->polygon[p].cell[0] != k->cell;
    bw_cell owner = above ? other : k->cell;
    c->polygon[p].cell[slot] = owner;
    c->polygon[p].in_cell[slot] = BW_NONE;
    c->polygon[tail[above]].in_cell[c->polygon[tail[above]].cell[0] != owner] = p;
    tail[above] = p;
}

/* Distributes the polygons of the cut cell over it (below) and the new cell (above). */
static void divide_cell(bw_cells *c, const cut *k, bw_cell other, bw_polygon section) {
    bw_polygon tail[2] = {section, section};
    c->list[k->cell] = c->list[other] = section;
    for (const face *f = c->face; f < c->face + k->faces; f++) {
        if (f->part == BW_NONE) {
            hand_over(c, k, other, f->polygon, f->sides == ABOVE, tail);
            continue;
        }
        bw_polygon part = bw_cells_polygon_part(c, f->polygon, 0);
        for (bw_polygon p = part; p <= part + 1; p++) hand_over(c, k, other, p, p != f->part, tail);
    }
}

bw_status bw_cells_cut(bw_context *ctx, bw_cells *cells, bw_cell cell, bw_plane plane, bw_polygon *section) {
    cut k = {.cell = cell, .tet = bw_cells_tet(cells, cell), .plane = plane};
    size_t vertices = cells->vertex_count;
    *section = BW_NONE;
    bw_status status = cells->sign_room < vertices ? make_room_for_signs(ctx, cells) : BW_OK;
    if (status == BW_OK && !bw_cells_is_open(cells, cell)) status = bw_cells_open(ctx, cells, cell);
    if (status == BW_OK) status = collect_faces(ctx, cells, &k);
    if (status == BW_OK) status = collect_corners(ctx, cells, &k);
    if (status == BW_OK) classify(cells, &k);
    if (status == BW_OK && k.sides == (BELOW | ABOVE)) {
        status = make_room(ctx, cells, k.faces, k.corners);
        if (status == BW_OK) status = split_crossed_edges(ctx, cells, &k);
        if (status == BW_OK) status = make_room(ctx, cells, k.faces, k.corners);
        if (status == BW_OK) {
            split_crossed_polygons(cells, &k);
            bw_cell other = (bw_cell)cells->cell_count++;
            cells->cut_from[(size_t)other - cells->mesh->tet_count] = k.tet;
            *section = make_section(cells, &k, other);
            divide_cell(cells, &k, other, *section);
        }
    } else if (status == BW_OK) {
        for (size_t i = 0; i < k.faces; i++)
            if (!cells->face[i].sides) *section = cells->face[i].polygon;
    }
    for (size_t i = 0; i < k.corners; i++) cells->sign[cells->corner[i].origin] = UNKNOWN;
    for (size_t v = vertices; v < cells->vertex_count; v++) cells->sign[v] = UNKNOWN;
    return status;
}

bw_transition bw_cells_transition(const bw_cells *cells, bw_polygon polygon, bw_cell from) {
    const bw_cell_polygon *p = &cells->polygon[polygon];
    if (p->kind == BW_IN_TET) return (bw_transition){{0, 0, 0}, 0};
    return bw_grid_map_across(cells->mesh, cells->map, p->carrier, bw_cells_tet(cells, from));
}
