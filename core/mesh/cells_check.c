/* The validator of the cell complex: see the invariants in cells.h. */
#include <string.h>

#include "base/parallel.h"
#include "mesh/cells.h"

enum { IN_RING = 1, IN_CYCLE = 2 };
enum { PIECE = 2048 }; /* items that a thread takes at a time: what was cut lies together, so their cost differs */
/* A cell, gathered from all over the memory once. Everything is in the order of its polygons. */
typedef struct {
    bw_polygon polygon;
    uint32_t begin; /* its corners, up to the next face's */
} face;

typedef struct {
    bw_cvertex vertex;
    bw_cedge edge;
    uint32_t number; /* of the vertex in the cell */
} corner;

/* A vertex in the chart of the cell's tet. */
typedef struct {
    int64_t floor[3];
    unsigned fractions;
} located;

/* An entry of a hash table, keyed by an edge or a vertex. */
typedef struct {
    int32_t key; /* and one; 0: free */
    uint32_t value;
} slot;

/* What one range of cells needs for itself. */
typedef struct {
    face *face;       /* [room + 1] */
    corner *corner;   /* [room] */
    located *at;      /* [room] */
    slot *table;      /* [4 * room], a power of two */
    size_t most;      /* corners of the largest cell that there was no room for: it was not looked at */
    size_t faces, corners, vertices;
    bool was_cut;
} scratch;

typedef struct {
    const bw_cells *c;
    uint8_t *half_seen; /* [half]: IN_RING, IN_CYCLE */
    uint32_t *begin;    /* [tet + 1]: the cells that cuts made in it, in `cut`; tet by tet, for neighbours share memory */
    bw_cell *cut;
    size_t room;
    scratch range[BW_PARALLEL_MOST];
} checker;

static bw_status violated(bw_context *ctx, const char *what, int64_t id) {
    return bw_fail(ctx, BW_E_CHECK, "cell complex: %s (%lld)", what, (long long)id);
}

/* ---- fetching ------------------------------------------------------------------------------------------------------ */

/* What is checked lies all over the memory, in chains: each item tells where the next is. So a bundle of chains is followed at once before it is looked
 * at, one step of each in turn, and the processor fetches them side by side. Nothing is decided here; a chain that is too long is left early. */
enum { BUNDLE = 16, CHAINS = 8 * BUNDLE, STEPS = 16 };

typedef enum { ALONG_RING, ALONG_CYCLE } along;

/* Chains of half-edges, whose first are on their way, until they close; and, of polygons, the edges or the vertices. */
static void fetch_halves(const bw_cells *c, const bw_half *first, size_t count, along way, bool edges) {
    bw_half at[CHAINS], head[CHAINS];
    memcpy(at, first, count * sizeof *at), memcpy(head, first, count * sizeof *head);
    for (int step = 0; step < STEPS && count; step++) {
        size_t open = 0;
        for (size_t i = 0; i < count; i++) {
            const bw_cell_half *h = &c->half[at[i]];
            if (way == ALONG_CYCLE && edges) __builtin_prefetch(&c->edge[h->edge]);
            if (way == ALONG_CYCLE && !edges) __builtin_prefetch(&c->vertex[h->origin]);
            bw_half next = way == ALONG_RING ? h->radial : h->next;
            if (next == head[i]) continue;
            __builtin_prefetch(&c->half[next]);
            at[open] = next, head[open++] = head[i];
        }
        count = open;
    }
}

/* A bundle of edges from e on. */
static void fetch_rings(const bw_cells *c, size_t e, size_t end) {
    bw_half first[BUNDLE];
    size_t count = 0;
    for (; e < end && count < BUNDLE; e++) {
        if (!bw_cells_edge_is_leaf(c, (bw_cedge)e)) continue;
        first[count++] = c->edge[e].half;
        __builtin_prefetch(&c->half[c->edge[e].half]);
    }
    fetch_halves(c, first, count, ALONG_RING, false);
}

static void fetch_polygons(const bw_cells *c, size_t p, size_t end) {
    bw_half first[BUNDLE];
    size_t count = 0;
    for (; p < end && count < BUNDLE; p++) {
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p)) continue;
        first[count++] = c->polygon[p].half;
        __builtin_prefetch(&c->half[c->polygon[p].half]);
    }
    fetch_halves(c, first, count, ALONG_CYCLE, true);
}

/* Opened cells: their lists, polygons, half-edges and vertices. */
static void fetch_cells(const bw_cells *c, const bw_cell *cell, size_t count) {
    bw_polygon at[BUNDLE];
    bw_cell of[BUNDLE];
    bw_half first[CHAINS];
    size_t halves = 0;
    for (size_t i = 0; i < count; i++) {
        at[i] = c->list[cell[i]], of[i] = cell[i];
        __builtin_prefetch(&c->polygon[at[i]]);
    }
    while (count && halves + count <= CHAINS) {
        size_t open = 0;
        for (size_t i = 0; i < count; i++) {
            const bw_cell_polygon *p = &c->polygon[at[i]];
            bool leaf = p->half != BW_NONE;
            bw_polygon next = p->in_cell[leaf && p->cell[0] != of[i]];
            if (leaf) first[halves++] = p->half, __builtin_prefetch(&c->half[p->half]);
            if (next == BW_NONE) continue;
            __builtin_prefetch(&c->polygon[next]);
            at[open] = next, of[open++] = of[i];
        }
        count = open;
    }
    fetch_halves(c, first, halves, ALONG_CYCLE, false);
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
    for (size_t e = begin; e < end && status == BW_OK; e++) {
        if ((e - begin) % BUNDLE == 0) fetch_rings(k->c, e, end);
        if (bw_cells_edge_is_leaf(k->c, (bw_cedge)e)) status = check_ring(ctx, k, (bw_cedge)e);
    }
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
    for (size_t p = begin; p < end && status == BW_OK; p++) {
        if ((p - begin) % BUNDLE == 0) fetch_polygons(k->c, p, end);
        if (bw_cells_polygon_is_leaf(k->c, (bw_polygon)p)) status = check_polygon(ctx, k, (bw_polygon)p);
    }
    return status;
}

/* Every facet of a tet that was opened is a polygon, and what the mesh's elements point to are they. */
static bw_status check_whole(bw_context *ctx, const bw_cells *c, bw_facet f) {
    const bw_tet *tet = c->mesh->facet_tet[f];
    bw_polygon p = c->of_facet[f];
    bool boundary = tet[1] == BW_NONE;
    if (p == BW_NONE && (boundary || bw_cells_is_open(c, tet[0]) || bw_cells_is_open(c, tet[1]))) return violated(ctx, "a facet is no polygon", f);
    if (p == BW_NONE) return BW_OK;
    if (c->polygon[p].kind != BW_IN_FACET || c->polygon[p].carrier != f) return violated(ctx, "a facet's polygon is another's", f);
    return boundary == ((c->polygon[p].flags & BW_BOUNDARY) != 0) ? BW_OK : violated(ctx, "a polygon is not marked as its facet", p);
}

static bw_status check_facets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const checker *k = user;
    bw_status status = BW_OK;
    (void)range;
    for (size_t f = begin; f < end && status == BW_OK; f++) status = check_whole(ctx, k->c, (bw_facet)f);
    return status;
}

/* ---- cells --------------------------------------------------------------------------------------------------------- */

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

/* Gathers faces and corners of a cell; what comes beyond `room` is only counted. */
static bw_status gather(bw_context *ctx, const bw_cells *c, scratch *s, size_t room, bw_cell cell) {
    s->faces = s->corners = 0;
    s->was_cut = false;
    for (bw_polygon p = bw_cells_first_in_cell(c, cell); p != BW_NONE; p = bw_cells_next_in_cell(c, p, cell)) {
        bw_status status = check_place(ctx, c, cell, p);
        if (status == BW_OK && s->faces == c->polygon_count) status = violated(ctx, "a cell's list of polygons does not end", cell);
        if (status != BW_OK) return status;
        __builtin_prefetch(&c->half[c->polygon[p].half]);
        s->was_cut = s->was_cut || c->polygon[p].kind == BW_IN_TET;
        if (s->faces < room) s->face[s->faces] = (face){p, 0};
        s->faces++;
    }
    for (size_t i = 0; i < s->faces && s->faces <= room; i++) {
        bw_half first = c->polygon[s->face[i].polygon].half, h = first;
        s->face[i].begin = (uint32_t)s->corners;
        do {
            if (s->corners < room) s->corner[s->corners] = (corner){c->half[h].origin, c->half[h].edge, 0};
            __builtin_prefetch(&c->vertex[c->half[h].origin]);
            s->corners++;
            h = c->half[h].next;
        } while (h != first);
    }
    if (s->corners < s->faces) s->corners = s->faces; /* there was no room for these */
    if (s->corners <= room) s->face[s->faces].begin = (uint32_t)s->corners;
    return BW_OK;
}

/* The entry of a key, or the free one that it may have. */
static slot *find(slot *table, size_t size, int32_t key) {
    size_t i = (size_t)((uint32_t)key * 0x9e3779b1u >> 7) & (size - 1);
    while (table[i].key && table[i].key != key + 1) i = (i + 1) & (size - 1);
    return &table[i];
}

/* A table for twice as many keys as the cell has corners. */
static size_t empty_table(scratch *s) {
    size_t size = 16;
    while (size < 2 * s->corners) size *= 2;
    memset(s->table, 0, size * sizeof *s->table);
    return size;
}

/* Every edge is in two of the cell's polygons. */
static bw_status check_closed(bw_context *ctx, scratch *s, bw_cell cell) {
    size_t size = empty_table(s), open = 0;
    for (size_t i = 0; i < s->corners; i++) {
        slot *edge = find(s->table, size, s->corner[i].edge);
        edge->key = s->corner[i].edge + 1;
        if (++edge->value > 2) return violated(ctx, "a cell has three polygons at an edge", cell);
        open += edge->value == 1 ? 1 : (size_t)-1;
    }
    return open ? violated(ctx, "a cell is open at an edge", cell) : BW_OK;
}

/* Numbers the vertices, and finds where they are if the cell lies at some plane. */
static void number_vertices(const bw_cells *c, scratch *s, bw_cell cell) {
    size_t size = empty_table(s);
    bw_tet tet = bw_cells_tet(c, cell);
    s->vertices = 0;
    for (size_t i = 0; i < s->corners; i++) {
        corner *x = &s->corner[i];
        slot *vertex = find(s->table, size, x->vertex);
        if (!vertex->key) {
            *vertex = (slot){x->vertex + 1, (uint32_t)s->vertices++};
            if (s->was_cut) s->at[vertex->value].fractions = bw_cells_locate(c, x->vertex, tet, s->at[vertex->value].floor);
        }
        x->number = vertex->value;
    }
}

static int side_of(const located *v, int axis, int64_t value) {
    if (v->floor[axis] != value) return v->floor[axis] < value ? -1 : 1;
    return v->fractions >> axis & 1;
}

/* Vertices of a cell against one of its iso-planes: all lie on the cell's side, cell[0] below, cell[1] above, and those of the
 * polygon in it. */
static bw_status check_convex(bw_context *ctx, const bw_cells *c, const scratch *s, bw_cell cell, const face *f) {
    const bw_cell_polygon *p = &c->polygon[f->polygon];
    int64_t value = c->section[p->carrier];
    int outside = p->cell[0] == cell ? 1 : -1;
    for (size_t i = 0; i < s->vertices; i++)
        if (side_of(&s->at[i], p->axis, value) == outside) return violated(ctx, "a cell's vertex lies beyond its plane", cell);
    for (uint32_t i = f->begin; i < f[1].begin; i++)
        if (side_of(&s->at[s->corner[i].number], p->axis, value)) return violated(ctx, "a polygon's vertex lies beside its plane", f->polygon);
    return BW_OK;
}

/* The cell's polygons close up: each of their edges is in exactly two of them; by Euler's formula they form a sphere if they
 * are connected, which two faces per edge and one ring per vertex give: V - E + F = 2. */
static bw_status check_cell(bw_context *ctx, const checker *k, scratch *s, bw_cell cell) {
    const bw_cells *c = k->c;
    bw_status status = gather(ctx, c, s, k->room, cell);
    if (status == BW_OK && s->corners > k->room) {
        if (s->corners > s->most) s->most = s->corners;
        return BW_OK;
    }
    if (status == BW_OK) status = check_closed(ctx, s, cell);
    if (status != BW_OK) return status;
    number_vertices(c, s, cell);
    if (s->vertices + s->faces != s->corners / 2 + 2) return violated(ctx, "a cell is not a ball", cell);
    for (const face *f = s->face; f < s->face + s->faces && status == BW_OK; f++)
        if (c->polygon[f->polygon].kind == BW_IN_TET) status = check_convex(ctx, c, s, cell, f);
    return status;
}

typedef struct {
    const checker *checker;
    scratch *scratch;
    size_t count;
    bw_cell cell[BUNDLE];
} bundle;

static bw_status check_bundle(bw_context *ctx, bundle *b) {
    bw_status status = BW_OK;
    fetch_cells(b->checker->c, b->cell, b->count);
    for (size_t i = 0; i < b->count && status == BW_OK; i++) status = check_cell(ctx, b->checker, b->scratch, b->cell[i]);
    b->count = 0;
    return status;
}

static bw_status add_to_bundle(bw_context *ctx, bundle *b, bw_cell cell) {
    if (!bw_cells_is_open(b->checker->c, cell)) return BW_OK;
    b->cell[b->count++] = cell;
    return b->count == BUNDLE ? check_bundle(ctx, b) : BW_OK;
}

static bw_status check_tets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    checker *k = user;
    bundle b = {.checker = k, .scratch = &k->range[range]};
    bw_status status = BW_OK;
    for (size_t t = begin; t < end && status == BW_OK; t++) {
        status = add_to_bundle(ctx, &b, (bw_cell)t);
        for (uint32_t i = k->begin[t]; i < k->begin[t + 1] && status == BW_OK; i++) status = add_to_bundle(ctx, &b, k->cut[i]);
    }
    return status == BW_OK ? check_bundle(ctx, &b) : status;
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

static void clear_room(bw_context *ctx, checker *k, int ranges) {
    for (scratch *s = k->range; s < k->range + ranges; s++) {
        bw_free(ctx, s->face), bw_free(ctx, s->corner), bw_free(ctx, s->at), bw_free(ctx, s->table);
        memset(s, 0, sizeof *s);
    }
}

static bw_status make_room(bw_context *ctx, checker *k, int ranges, size_t room) {
    clear_room(ctx, k, ranges);
    k->room = room;
    for (int i = 0; i < ranges; i++) {
        scratch *s = &k->range[i];
        *s = (scratch){.face = bw_alloc(ctx, room + 1, sizeof *s->face), .corner = bw_alloc(ctx, room, sizeof *s->corner),
                       .at = bw_alloc(ctx, room, sizeof *s->at), .table = bw_alloc(ctx, 4 * room, sizeof *s->table)};
    }
    return ctx->error.status;
}

/* Checks all cells; again from the start, should there be one that takes more room. */
static bw_status check_cells(bw_context *ctx, checker *k, int ranges) {
    size_t tets = k->c->mesh->tet_count, need = 1024;
    bw_status status = BW_OK;
    while (status == BW_OK && need > k->room) {
        size_t room = 1;
        while (room < need) room *= 2;
        status = make_room(ctx, k, ranges, room);
        if (status == BW_OK) status = bw_parallel_pieces(ctx, tets, PIECE, ranges, check_tets, k);
        for (int i = 0; i < ranges; i++)
            if (k->range[i].most > need) need = k->range[i].most;
    }
    return status;
}

static bw_status check_all(bw_context *ctx, checker *k, size_t count, bw_parallel_work *check) {
    return bw_parallel_pieces(ctx, count, PIECE, bw_parallel_ranges(ctx, count, PIECE), check, k);
}

bw_status bw_cells_check(bw_context *ctx, const bw_cells *cells) {
    checker k = {.c = cells, .half_seen = bw_alloc(ctx, cells->half_count, 1)};
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = check_all(ctx, &k, cells->edge_count, check_rings);
    if (status == BW_OK) status = check_all(ctx, &k, cells->polygon_count, check_polygons);
    bw_free(ctx, k.half_seen);
    if (status == BW_OK) status = check_all(ctx, &k, cells->mesh->facet_count, check_facets);
    if (status == BW_OK) status = sort_by_tet(ctx, &k);
    int ranges = bw_parallel_ranges(ctx, cells->mesh->tet_count, PIECE);
    if (status == BW_OK) status = check_cells(ctx, &k, ranges);
    bw_free(ctx, k.begin), bw_free(ctx, k.cut);
    clear_room(ctx, &k, ranges);
    return status;
}
