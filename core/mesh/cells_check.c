/* The validator of the cell complex: see the invariants in cells.h. */
#include "base/parallel.h"
#include "mesh/cells.h"

enum { IN_RING = 1, IN_CYCLE = 2 };
enum { BATCH = 256 }; /* vertices of a cell that are located at a time: all of them, but for very large cells */

/* Vertices of the cell at hand with the numbers first .. first + count - 1, in the chart of its tet. */
typedef struct {
    struct located {
        int64_t floor[3];
        unsigned fractions;
    } vertex[BATCH];
    uint32_t first, count;
} batch;

/* What one range of cells needs for itself. Vertices are counted through all cells of the range; the cell at hand has those
 * numbered visited + 1 .. visited + count. */
typedef struct {
    bw_cell *edge_seen;    /* [edge]: 1 + the last cell that it was seen in once; negative: twice */
    uint32_t *vertex_seen; /* [vertex]: its number when it was seen last */
    uint32_t visited, count;
    size_t edges, closed; /* edges of the cell; those seen twice */
} scratch;

typedef struct {
    const bw_cells *c;
    uint8_t *half_seen; /* [half]: IN_RING, IN_CYCLE */
    uint32_t *begin;    /* [tet + 1]: the cells that cuts made in it, in `cut`; tet by tet, for neighbours share memory */
    bw_cell *cut;
    scratch range[BW_PARALLEL_MOST];
} checker;

static bw_status violated(bw_context *ctx, const char *what, int64_t id) {
    return bw_fail(ctx, BW_E_CHECK, "cell complex: %s (%lld)", what, (long long)id);
}

/* ---- edges and polygons -------------------------------------------------------------------------------------------- */

static bw_status check_ring(bw_context *ctx, const checker *k, bw_cedge e) {
    const bw_cells *c = k->c;
    bw_half head = c->edge[e].half, h = head;
    do {
        if (c->half[h].edge != e) return violated(ctx, "a radial ring holds another edge's half-edge", h);
        if (k->half_seen[h]) return violated(ctx, "a radial ring does not close", e);
        k->half_seen[h] = IN_RING;
        h = c->half[h].radial;
    } while (h != head);
    return BW_OK;
}

static bw_status check_rings(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker *k = user;
    bw_status status = BW_OK;
    (void)range;
    for (size_t e = begin; e < end && status == BW_OK; e++)
        if (bw_cells_edge_is_leaf(k->c, (bw_cedge)e)) status = check_ring(ctx, k, (bw_cedge)e);
    return status;
}

static bw_status check_half(bw_context *ctx, const checker *k, bw_half h, bw_polygon p) {
    const bw_cell_half *x = &k->c->half[h];
    const bw_cell_edge *e = &k->c->edge[x->edge];
    bw_cvertex end = bw_cells_half_end(k->c, h);
    if (x->polygon != p) return violated(ctx, "a half-edge names another polygon", h);
    if (!bw_cells_edge_is_leaf(k->c, x->edge)) return violated(ctx, "a half-edge lies on an edge that was split", h);
    if (!((e->vertex[0] == x->origin && e->vertex[1] == end) || (e->vertex[1] == x->origin && e->vertex[0] == end)))
        return violated(ctx, "a half-edge and its edge have different ends", h);
    if (k->half_seen[h] & IN_CYCLE) return violated(ctx, "a polygon's cycle does not close", p);
    return k->half_seen[h] & IN_RING ? BW_OK : violated(ctx, "a half-edge is missing from its radial ring", h);
}

/* A tet that is not opened has no list of polygons: those that name it are looked at from their side. */
static bw_status check_unopened(bw_context *ctx, const bw_cells *c, bw_polygon p) {
    for (int i = 0; i < 2; i++) {
        bw_cell cell = c->polygon[p].cell[i];
        if (cell == BW_NONE || bw_cells_is_open(c, cell)) continue;
        if ((size_t)cell >= c->mesh->tet_count || c->polygon[p].kind != BW_IN_FACET || c->mesh->facet_tet[c->polygon[p].carrier][i] != cell)
            return violated(ctx, "a polygon names a cell without polygons", p);
    }
    return BW_OK;
}

static bw_status check_polygon(bw_context *ctx, const checker *k, bw_polygon p) {
    const bw_cells *c = k->c;
    size_t n = 0;
    bw_half h = c->polygon[p].half;
    do {
        bw_status status = check_half(ctx, k, h, p);
        if (status != BW_OK) return status;
        k->half_seen[h] |= IN_CYCLE;
        n++;
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    if (n < 3) return violated(ctx, "a polygon has fewer than three vertices", p);
    if (c->polygon[p].cell[0] == BW_NONE) return violated(ctx, "a polygon has no first cell", p);
    return check_unopened(ctx, c, p);
}

static bw_status check_polygons(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker *k = user;
    bw_status status = BW_OK;
    (void)range;
    for (size_t p = begin; p < end && status == BW_OK; p++)
        if (bw_cells_polygon_is_leaf(k->c, (bw_polygon)p)) status = check_polygon(ctx, k, (bw_polygon)p);
    return status;
}

/* ---- cells --------------------------------------------------------------------------------------------------------- */

#define FOR_POLYGONS(c, p, cell_)                                                                                     \
    for (bw_polygon p = (c)->first[cell_]; p != BW_NONE; p = bw_cells_next_in_cell((c), p, (cell_)))

static bw_status check_place(bw_context *ctx, const bw_cells *c, bw_cell cell, bw_polygon polygon) {
    const bw_cell_polygon *p = &c->polygon[polygon];
    bw_tet tet = bw_cells_tet(c, cell);
    if (!bw_cells_polygon_is_leaf(c, polygon)) return violated(ctx, "a cell lists a polygon that was split", cell);
    if (p->cell[0] != cell && p->cell[1] != cell) return violated(ctx, "a cell lists a polygon that does not name it", cell);
    if (p->kind == BW_IN_TET ? bw_cells_tet(c, p->cell[0]) != tet || bw_cells_tet(c, p->cell[1]) != tet
                             : c->mesh->facet_tet[p->carrier][0] != tet && c->mesh->facet_tet[p->carrier][1] != tet)
        return violated(ctx, "a cell and its polygon lie in different tets", cell);
    return BW_OK;
}

/* Notes the edges and vertices of a polygon of the cell. */
static bw_status visit_polygon(bw_context *ctx, const bw_cells *c, scratch *s, bw_cell cell, bw_polygon p) {
    bw_half h = c->polygon[p].half;
    do {
        bw_cell *seen = &s->edge_seen[c->half[h].edge];
        uint32_t *vertex = &s->vertex_seen[c->half[h].origin];
        if (*seen == -(cell + 1)) return violated(ctx, "a cell has three polygons at an edge", cell);
        if (*seen == cell + 1) *seen = -(cell + 1), s->closed++;
        else *seen = cell + 1, s->edges++;
        if (*vertex <= s->visited) *vertex = s->visited + ++s->count;
        h = c->half[h].next;
    } while (h != c->polygon[p].half);
    return BW_OK;
}

static void locate(const bw_cells *c, const scratch *s, bw_cell cell, batch *at) {
    FOR_POLYGONS(c, p, cell) {
        bw_half h = c->polygon[p].half;
        do {
            bw_cvertex v = c->half[h].origin;
            uint32_t i = s->vertex_seen[v] - at->first;
            h = c->half[h].next;
            if (i > at->count || i >= BATCH) continue;
            if (i == at->count) at->vertex[at->count++].fractions = bw_cells_locate(c, v, bw_cells_tet(c, cell), at->vertex[i].floor);
        } while (h != c->polygon[p].half);
    }
}

static int side_of(const struct located *v, int axis, int64_t value) {
    if (v->floor[axis] != value) return v->floor[axis] < value ? -1 : 1;
    return v->fractions >> axis & 1;
}

/* Vertices of a cell against one of its iso-planes: all lie on the cell's side, cell[0] below, cell[1] above, and those of the
 * polygon in it. */
static bw_status check_convex(bw_context *ctx, const bw_cells *c, const scratch *s, bw_cell cell, bw_polygon polygon, const batch *at) {
    const bw_cell_polygon *p = &c->polygon[polygon];
    int64_t value = c->section[p->carrier];
    int outside = p->cell[0] == cell ? 1 : -1;
    for (uint32_t i = 0; i < at->count; i++)
        if (side_of(&at->vertex[i], p->axis, value) == outside)
            return violated(ctx, "a cell's vertex lies beyond its plane", cell);
    bw_half h = p->half;
    do {
        uint32_t i = s->vertex_seen[c->half[h].origin] - at->first;
        if (i < at->count && side_of(&at->vertex[i], p->axis, value))
            return violated(ctx, "a polygon's vertex lies beside its plane", polygon);
        h = c->half[h].next;
    } while (h != p->half);
    return BW_OK;
}

/* Every facet of a tet that was opened is a polygon, and what the mesh's elements point to are they. */
static bw_status check_whole(bw_context *ctx, const bw_cells *c, bw_tet tet) {
    for (int i = 0; i < 4; i++) {
        bw_facet f = c->mesh->tet_facet[tet][i];
        bw_polygon p = c->of_facet[f];
        bool boundary = c->mesh->facet_tet[f][1] == BW_NONE;
        if (p == BW_NONE && (boundary || bw_cells_is_open(c, tet))) return violated(ctx, "a facet is no polygon", f);
        if (p == BW_NONE) continue;
        if (c->polygon[p].kind != BW_IN_FACET || c->polygon[p].carrier != f)
            return violated(ctx, "a facet's polygon is another's", f);
        if (boundary != ((c->polygon[p].flags & BW_BOUNDARY) != 0)) return violated(ctx, "a polygon is not marked as its facet", p);
    }
    return BW_OK;
}

/* The cell's polygons close up: each of their edges is in exactly two of them; by Euler's formula they form a sphere if they
 * are connected, which two faces per edge and one ring per vertex give: V - E + F = 2. */
static bw_status check_cell(bw_context *ctx, const bw_cells *c, scratch *s, bw_cell cell) {
    bw_status status = BW_OK;
    size_t polygons = 0;
    bool was_cut = false;
    s->visited += s->count;
    s->count = 0;
    s->edges = s->closed = 0;
    for (bw_polygon p = c->first[cell]; p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell)) {
        status = check_place(ctx, c, cell, p);
        if (status == BW_OK) status = visit_polygon(ctx, c, s, cell, p);
        was_cut = was_cut || c->polygon[p].kind == BW_IN_TET;
        polygons++;
    }
    if (status == BW_OK && s->closed != s->edges) status = violated(ctx, "a cell is open at an edge", cell);
    if (status == BW_OK && s->count + polygons != s->edges + 2) status = violated(ctx, "a cell is not a ball", cell);
    for (uint32_t done = 0; was_cut && done < s->count && status == BW_OK; done += BATCH) {
        batch at;
        at.first = s->visited + 1 + done, at.count = 0;
        locate(c, s, cell, &at);
        for (bw_polygon p = c->first[cell]; p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell))
            if (c->polygon[p].kind == BW_IN_TET) status = check_convex(ctx, c, s, cell, p, &at);
    }
    return status;
}

static bw_status check_tets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    checker *k = user;
    bw_status status = BW_OK;
    for (size_t t = begin; t < end && status == BW_OK; t++) {
        status = check_whole(ctx, k->c, (bw_tet)t);
        if (status == BW_OK && bw_cells_is_open(k->c, (bw_cell)t)) status = check_cell(ctx, k->c, &k->range[range], (bw_cell)t);
        for (uint32_t i = k->begin[t]; i < k->begin[t + 1] && status == BW_OK; i++)
            if (bw_cells_is_open(k->c, k->cut[i])) status = check_cell(ctx, k->c, &k->range[range], k->cut[i]);
    }
    return status;
}

static bw_status sort_by_tet(bw_context *ctx, checker *k) {
    const bw_cells *c = k->c;
    size_t tets = c->mesh->tet_count, cuts = c->cell_count - tets;
    k->begin = bw_alloc(ctx, tets + 2, sizeof *k->begin);
    k->cut = bw_alloc(ctx, cuts, sizeof *k->cut);
    if (!k->begin || !k->cut) return ctx->error.status;
    for (size_t i = 0; i < cuts; i++) {
        if (c->cut_from[i] < 0 || (size_t)c->cut_from[i] >= tets) return violated(ctx, "a cell lies in no tet", (int64_t)(tets + i));
        k->begin[c->cut_from[i] + 2]++;
    }
    for (size_t t = 2; t < tets + 2; t++) k->begin[t] += k->begin[t - 1];
    for (size_t i = 0; i < cuts; i++) k->cut[k->begin[c->cut_from[i] + 1]++] = (bw_cell)(tets + i);
    return BW_OK;
}

bw_status bw_cells_check(bw_context *ctx, const bw_cells *cells) {
    enum { LEAST = 2048 }; /* fewer items are not worth a thread */
    checker k = {.c = cells, .half_seen = bw_alloc(ctx, cells->half_count, 1)};
    bw_status status = ctx->error.status;
    if (status == BW_OK)
        status = bw_parallel(ctx, cells->edge_count, bw_parallel_ranges(ctx, cells->edge_count, LEAST), check_rings, &k);
    if (status == BW_OK)
        status = bw_parallel(ctx, cells->polygon_count, bw_parallel_ranges(ctx, cells->polygon_count, LEAST), check_polygons, &k);
    bw_free(ctx, k.half_seen);
    if (status == BW_OK) status = sort_by_tet(ctx, &k);
    int ranges = bw_parallel_ranges(ctx, cells->mesh->tet_count, LEAST);
    for (int i = 0; i < ranges && status == BW_OK; i++) {
        k.range[i].edge_seen = bw_alloc(ctx, cells->edge_count, sizeof *k.range[i].edge_seen);
        k.range[i].vertex_seen = bw_alloc(ctx, cells->vertex_count, sizeof *k.range[i].vertex_seen);
        status = ctx->error.status;
    }
    if (status == BW_OK) status = bw_parallel(ctx, cells->mesh->tet_count, ranges, check_tets, &k);
    bw_free(ctx, k.begin), bw_free(ctx, k.cut);
    for (int i = 0; i < ranges; i++) bw_free(ctx, k.range[i].edge_seen), bw_free(ctx, k.range[i].vertex_seen);
    return status;
}
