/* Choice of fans and apexes: combinatorial, given which polygon corners are straight.
 *
 * A vertex of a cell is a candidate if every supporting plane through it is tiled by polygons that all have
 * it (else the cone over the others would be flat) and if each of these polygons, where it has more than
 * three vertices, can be fanned from it. Two cells that share a polygon may want different fans, so the
 * choice is greedy: cells with few candidates first, each taking the candidate that leaves the fewest tets. A
 * cell whose candidates were all ruled out then tries to win one back by moving the apex of one neighbour.
 * What is left is coned from inside.
 */
#include "format/tessellate_choose.h"

#include <string.h>

/* One cell, looked at closely. */
typedef struct {
    bw_cell cell;
    size_t polygons, vertices, uses;
    struct view_polygon {
        bw_polygon polygon;
        int32_t plane;     /* local number of its supporting plane */
        size_t begin, end; /* its vertices in `use` */
    } * polygon;
    bw_cvertex *vertex;
    int32_t *use;      /* local vertex numbers, polygon by polygon */
    bw_half *use_half; /* the half-edge that starts there */
    int32_t *plane_of; /* scratch: [vertex] polygons of the running plane that have it */
    uint8_t *bad;      /* [vertex] no candidate */
    int32_t *saved;    /* [vertex] triangles that a cone from it saves */
    int32_t *slot;     /* [complex vertex] */
    size_t polygon_room, vertex_room, use_room, half_room, plane_room, bad_room, saved_room;
    int32_t planes;
    int32_t triangles;
} view;

typedef struct {
    bw_context *ctx;
    bw_tessellation *t;
    const bw_cells *cells;
    view near, far;      /* the cell at hand, and a neighbour */
    int32_t *candidates; /* [cell] */
} chooser;

static void view_clear(bw_context *ctx, view *w) {
    bw_free(ctx, w->polygon), bw_free(ctx, w->vertex), bw_free(ctx, w->use), bw_free(ctx, w->use_half);
    bw_free(ctx, w->plane_of), bw_free(ctx, w->bad), bw_free(ctx, w->saved), bw_free(ctx, w->slot);
}

static bool same_plane(const bw_cells *cells, const bw_cell_polygon *a, const bw_cell_polygon *b) {
    if (a->kind != b->kind) return false;
    if (a->kind == BW_IN_FACET) return a->carrier == b->carrier;
    return a->axis == b->axis && cells->section[a->carrier] == cells->section[b->carrier];
}

static int32_t plane_number(const bw_cells *cells, view *w, bw_polygon p) {
    for (size_t i = 0; i < w->polygons; i++)
        if (same_plane(cells, &cells->polygon[w->polygon[i].polygon], &cells->polygon[p]))
            return w->polygon[i].plane;
    return w->planes++;
}

static int32_t local_vertex(view *w, bw_cvertex v) {
    size_t s = (size_t)w->slot[v];
    if (s >= w->vertices || w->vertex[s] != v) {
        s = w->vertices++;
        w->vertex[s] = v;
        w->slot[v] = (int32_t)s;
    }
    return (int32_t)s;
}

static bw_status view_room(bw_context *ctx, view *w, size_t polygons, size_t uses) {
    bw_status s = bw_reserve(ctx, &w->polygon, &w->polygon_room, polygons);
    if (s == BW_OK) s = bw_reserve(ctx, &w->use, &w->use_room, uses);
    if (s == BW_OK) s = bw_reserve(ctx, &w->use_half, &w->half_room, uses);
    if (s == BW_OK) s = bw_reserve(ctx, &w->vertex, &w->vertex_room, uses);
    if (s == BW_OK) s = bw_reserve(ctx, &w->plane_of, &w->plane_room, uses);
    if (s == BW_OK) s = bw_reserve(ctx, &w->bad, &w->bad_room, uses);
    if (s == BW_OK) s = bw_reserve(ctx, &w->saved, &w->saved_room, uses);
    return s;
}

static bw_status view_open(const chooser *c, view *w, bw_cell cell) {
    const bw_cells *cells = c->cells;
    size_t polygons = 0, uses = 0;
    for (bw_polygon p = bw_cells_first_in_cell(cells, cell); p != BW_NONE; p = bw_cells_next_in_cell(cells, p, cell))
        polygons++, uses += (size_t)c->t->size[p];
    bw_status status = view_room(c->ctx, w, polygons, uses);
    if (status != BW_OK) return status;
    w->cell = cell;
    w->polygons = w->vertices = w->uses = 0;
    w->planes = w->triangles = 0;
    for (bw_polygon p = bw_cells_first_in_cell(cells, cell); p != BW_NONE; p = bw_cells_next_in_cell(cells, p, cell)) {
        int32_t plane = plane_number(cells, w, p);
        struct view_polygon *x = &w->polygon[w->polygons++];
        *x = (struct view_polygon){.polygon = p, .plane = plane, .begin = w->uses};
        bw_half h = cells->polygon[p].half;
        do {
            w->use_half[w->uses] = h;
            w->use[w->uses++] = local_vertex(w, cells->half[h].origin);
            h = cells->half[h].next;
        } while (h != cells->polygon[p].half);
        x->end = w->uses;
        w->triangles += c->t->size[p] - 2;
    }
    return BW_OK;
}

/* Neither neighbour of the half-edge's origin is straight, so the fan from there has no flat triangle. */
static bool fan_is_good(const chooser *c, bw_half h) {
    return !c->t->straight[c->cells->half[h].next] && !c->t->straight[bw_cells_half_previous(c->cells, h)];
}

/* Whether a polygon can still be given triangles that all have the origin of one of its half-edges. */
static bool fan_is_free(const chooser *c, bw_polygon p, bw_half h) {
    bw_half fan = c->t->fan[p];
    if (c->t->size[p] == 3 || fan == BW_NONE || fan == h) return true;
    return c->t->size[p] == 4 && c->cells->half[c->cells->half[h].next].next == fan;
}

/* Sets bad[] and saved[] of all vertices of the cell, whatever the fans chosen so far. */
static void find_candidates(const chooser *c, view *w) {
    memset(w->bad, 0, w->vertices);
    memset(w->saved, 0, w->vertices * sizeof *w->saved);
    for (int32_t plane = 0; plane < w->planes; plane++) {
        memset(w->plane_of, 0, w->vertices * sizeof *w->plane_of);
        int32_t members = 0;
        for (size_t i = 0; i < w->polygons; i++) {
            if (w->polygon[i].plane != plane) continue;
            members++;
            for (size_t u = w->polygon[i].begin; u < w->polygon[i].end; u++) w->plane_of[w->use[u]]++;
        }
        if (members > 1)
            for (size_t v = 0; v < w->vertices; v++) w->bad[v] |= w->plane_of[v] && w->plane_of[v] < members;
    }
    for (size_t i = 0; i < w->polygons; i++) {
        int32_t n = c->t->size[w->polygon[i].polygon];
        for (size_t u = w->polygon[i].begin; u < w->polygon[i].end; u++) {
            w->saved[w->use[u]] += n - 2;
            if (n > 3 && !fan_is_good(c, w->use_half[u])) w->bad[w->use[u]] = 1;
        }
    }
}

/* Marks the candidates that fans chosen for other cells rule out. */
static void drop_taken(const chooser *c, view *w) {
    for (size_t i = 0; i < w->polygons; i++)
        for (size_t u = w->polygon[i].begin; u < w->polygon[i].end; u++)
            if (!fan_is_free(c, w->polygon[i].polygon, w->use_half[u])) w->bad[w->use[u]] = 1;
}

/* The candidate that saves most tets; the lowest-numbered of several. -1 if there is none. */
static int32_t best_candidate(const view *w) {
    int32_t best = -1;
    for (size_t v = 0; v < w->vertices; v++) {
        if (w->bad[v]) continue;
        if (best < 0 || w->saved[v] > w->saved[best] ||
            (w->saved[v] == w->saved[best] && w->vertex[v] < w->vertex[best]))
            best = (int32_t)v;
    }
    return best;
}

/* Makes a vertex the apex of the cell and fixes the fans that this needs. */
static void take(const chooser *c, const view *w, int32_t apex) {
    c->t->apex[w->cell] = w->vertex[apex];
    for (size_t i = 0; i < w->polygons; i++) {
        bw_polygon p = w->polygon[i].polygon;
        if (c->t->size[p] == 3 || c->t->fan[p] != BW_NONE) continue;
        for (size_t u = w->polygon[i].begin; u < w->polygon[i].end; u++)
            if (w->use[u] == apex) c->t->fan[p] = w->use_half[u];
    }
}

static bool has_vertex(const chooser *c, bw_polygon p, bw_cvertex v) {
    bw_half h = c->cells->polygon[p].half;
    do {
        if (c->cells->half[h].origin == v) return true;
        h = c->cells->half[h].next;
    } while (h != c->cells->polygon[p].half);
    return false;
}

/* Takes back the apex of a cell and the fans that only it needed. */
static void give_back(const chooser *c, bw_cell cell) {
    bw_cvertex apex = c->t->apex[cell];
    c->t->apex[cell] = BW_NONE;
    for (bw_polygon p = bw_cells_first_in_cell(c->cells, cell); p != BW_NONE;
         p = bw_cells_next_in_cell(c->cells, p, cell)) {
        if (c->t->fan[p] == BW_NONE || !has_vertex(c, p, apex)) continue;
        bw_cell other = bw_cells_across(c->cells, p, cell);
        if (other == BW_NONE || c->t->apex[other] == BW_NONE || !has_vertex(c, p, c->t->apex[other]))
            c->t->fan[p] = BW_NONE;
    }
}

static bw_status choose_free(chooser *c, bw_cell cell, bool *found) {
    bw_status status = view_open(c, &c->near, cell);
    if (status != BW_OK) return status;
    find_candidates(c, &c->near);
    drop_taken(c, &c->near);
    int32_t best = best_candidate(&c->near);
    *found = best >= 0;
    if (*found) take(c, &c->near, best);
    return BW_OK;
}

/* Tries to free a candidate of the cell in c->near by moving the apex of the one neighbour whose fan is in
 * its way. */
static bw_status win_back(chooser *c, int32_t candidate, bool *found) {
    view *w = &c->near;
    bw_cell blocker = BW_NONE;
    for (size_t i = 0; i < w->polygons; i++)
        for (size_t u = w->polygon[i].begin; u < w->polygon[i].end; u++) {
            if (w->use[u] != candidate || fan_is_free(c, w->polygon[i].polygon, w->use_half[u])) continue;
            bw_cell other = bw_cells_across(c->cells, w->polygon[i].polygon, w->cell);
            if (other == BW_NONE || other == w->cell || (blocker != BW_NONE && blocker != other))
                return BW_OK;
            blocker = other;
        }
    if (blocker == BW_NONE || c->t->apex[blocker] == BW_NONE) return BW_OK;
    bw_status status = view_open(c, &c->far, blocker);
    if (status != BW_OK) return status;
    bw_cvertex before = c->t->apex[blocker];
    find_candidates(c, &c->far);
    give_back(c, blocker);
    take(c, w, candidate);
    drop_taken(c, &c->far);
    int32_t best = best_candidate(&c->far);
    *found = best >= 0;
    if (!*found) {
        give_back(c, w->cell);
        best = c->far.slot[before];
    }
    take(c, &c->far, best);
    return BW_OK;
}

static bw_status choose_again(chooser *c, bw_cell cell) {
    bw_status status = view_open(c, &c->near, cell);
    if (status != BW_OK) return status;
    find_candidates(c, &c->near);
    drop_taken(c, &c->near); /* a neighbour that moved may have freed one */
    int32_t best = best_candidate(&c->near);
    if (best >= 0) {
        take(c, &c->near, best);
        return BW_OK;
    }
    find_candidates(c, &c->near);
    bool found = false;
    for (size_t v = 0; v < c->near.vertices && !found && status == BW_OK; v++)
        if (!c->near.bad[v]) status = win_back(c, (int32_t)v, &found);
    return status;
}

/* A cell of four triangles is a tet: coned from its lowest vertex it stays one, and no neighbour is
 * constrained. */
static bool choose_tet(const chooser *c, bw_cell cell) {
    const bw_cells *cells = c->cells;
    int polygons = 0;
    bw_cvertex lowest = INT32_MAX;
    for (bw_polygon p = bw_cells_first_in_cell(cells, cell); p != BW_NONE; p = bw_cells_next_in_cell(cells, p, cell)) {
        if (c->t->size[p] > 3 || ++polygons > 4) return false;
        for (int i = 0, h = cells->polygon[p].half; i < 3; i++, h = cells->half[h].next)
            if (cells->half[h].origin < lowest) lowest = cells->half[h].origin;
    }
    c->t->apex[cell] = lowest;
    return true;
}

static bw_status count_candidates(chooser *c, int32_t *most) {
    bw_status status = BW_OK;
    for (size_t i = 0; i < c->cells->cell_count && status == BW_OK; i++) {
        if (choose_tet(c, (bw_cell)i)) continue;
        status = view_open(c, &c->near, (bw_cell)i);
        if (status != BW_OK) break;
        find_candidates(c, &c->near);
        int32_t count = 0;
        for (size_t v = 0; v < c->near.vertices; v++) count += !c->near.bad[v];
        c->candidates[i] = count;
        if (count > *most) *most = count;
    }
    return status;
}

/* Cells with n candidates, n = 1, 2, ...; then what is left, a few times over. */
static bw_status choose_apexes(chooser *c) {
    enum { ROUNDS = 3 };
    int32_t most = 0;
    bw_status status = count_candidates(c, &most);
    for (int32_t n = 1; n <= most && status == BW_OK; n++)
        for (size_t i = 0; i < c->cells->cell_count && status == BW_OK; i++) {
            bool found = false;
            if (c->candidates[i] == n) status = choose_free(c, (bw_cell)i, &found);
        }
    for (int round = 0; round < ROUNDS && status == BW_OK; round++)
        for (size_t i = 0; i < c->cells->cell_count && status == BW_OK; i++)
            if (c->t->apex[i] == BW_NONE && c->candidates[i]) status = choose_again(c, (bw_cell)i);
    return status;
}

static void choose_other_fans(const chooser *c) {
    for (size_t p = 0; p < c->cells->polygon_count; p++) {
        if (c->t->size[p] <= 3 || c->t->fan[p] != BW_NONE) continue;
        bw_half first = c->cells->polygon[p].half, h = first, best = BW_NONE;
        do {
            if (fan_is_good(c, h) &&
                (best == BW_NONE || c->cells->half[h].origin < c->cells->half[best].origin))
                best = h;
            h = c->cells->half[h].next;
        } while (h != first);
        c->t->fan[p] = best;
    }
}

bw_status bw_tessellation_choose(bw_context *ctx, bw_tessellation *t) {
    chooser c = {.ctx = ctx, .t = t, .cells = t->cells};
    c.candidates = bw_alloc(ctx, t->cells->cell_count, sizeof *c.candidates);
    c.near.slot = bw_alloc(ctx, t->cells->vertex_count, sizeof *c.near.slot);
    c.far.slot = bw_alloc(ctx, t->cells->vertex_count, sizeof *c.far.slot);
    bw_status status = ctx->error.status;
    for (size_t p = 0; p < t->cells->polygon_count; p++) t->fan[p] = BW_NONE;
    for (size_t i = 0; i < t->cells->cell_count; i++) t->apex[i] = BW_NONE;
    if (status == BW_OK) status = choose_apexes(&c);
    if (status == BW_OK) choose_other_fans(&c);
    view_clear(ctx, &c.near), view_clear(ctx, &c.far);
    bw_free(ctx, c.candidates);
    return status;
}
