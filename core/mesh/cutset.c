#include "mesh/cutset.h"

#include <stdlib.h>
#include <string.h>

#include "base/forest.h"

typedef struct {
    bw_context *ctx;
    const bw_tet_mesh *mesh;
    const bw_hinges *hinges;
    const bw_seams *seams;
    const int64_t (*value)[4][3];
    bw_cutset *cut;
    int32_t *queue;      /* of tets, facets or hinges; long enough for any of them, each at most once */
    uint8_t *seen;       /* [tet] */
    bw_rotation *across; /* [facet] rotation between the combed charts, from facet_tet[0] to facet_tet[1] */
} cutter;

void bw_cutset_clear(bw_context *ctx, bw_cutset *cut) {
    bw_free(ctx, cut->comb);
    bw_free(ctx, cut->shift);
    bw_free(ctx, cut->chart);
    bw_free(ctx, cut->side);
    bw_free(ctx, cut->cut_sheet);
    bw_free(ctx, cut->align_sheet);
    bw_free(ctx, cut->align_axis);
    bw_free(ctx, cut->rotation);
    bw_free(ctx, cut->cut_count);
    memset(cut, 0, sizeof *cut);
}

static bw_rotation across(const cutter *w, bw_facet f, bw_tet from) {
    bw_rotation r = w->seams->rotation[f];
    return w->mesh->facet_tet[f][0] == from ? r : bw_rotation_inverse(r);
}

/* Shift of the next tet's chart so that its facet meets the combed one: the mean over the corners. Zero,
 * relative to a neighbour with an equal chart, if that is within the defect of the input: charts the input
 * meant to be one stay one. */
static bw_status comb_shift(cutter *w, bw_facet f, bw_tet from, bw_tet to) {
    int64_t low[3], high[3], sum[3] = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        int64_t a[3], b[3];
        bw_vertex v = w->mesh->facet[f][i];
        bw_cutset_combed(w->cut, from, w->value[from][bw_tet_corner(w->mesh, from, v)], a);
        bw_rotate(w->cut->comb[to], w->value[to][bw_tet_corner(w->mesh, to, v)], b);
        for (int k = 0; k < 3; k++) {
            int64_t d = a[k] - b[k] - w->cut->shift[from][k];
            sum[k] += d;
            if (i == 0 || d < low[k]) low[k] = d;
            if (i == 0 || d > high[k]) high[k] = d;
        }
    }
    bool same = w->cut->comb[from] == w->cut->comb[to];
    for (int k = 0; k < 3; k++) same = same && low[k] <= w->seams->defect && high[k] >= -w->seams->defect;
    w->cut->chart[to] = same ? w->cut->chart[from] : (int32_t)w->cut->charts++;
    for (int k = 0; k < 3; k++) w->cut->shift[to][k] = w->cut->shift[from][k] + (same ? 0 : sum[k] / 3);
    for (int k = 0; k < 3; k++)
        if (llabs(w->cut->shift[to][k]) > BW_COMBED_MAX)
            return bw_fail(w->ctx, BW_E_RANGE, "the charts, put side by side, span more than the exact grid");
    return BW_OK;
}

/* Breadth first from the lowest tet of every component, so that trees are shallow and rounding does not add
 * up along them. */
static bw_status comb_charts(cutter *w) {
    const bw_tet_mesh *mesh = w->mesh;
    for (size_t f = 0; f < mesh->facet_count; f++) w->cut->side[f] = mesh->facet_tet[f][1] != BW_NONE;
    for (size_t root = 0; root < mesh->tet_count; root++) {
        size_t head = 0, tail = 0;
        if (w->seen[root]) continue;
        w->seen[root] = 1;
        w->cut->chart[root] = (int32_t)w->cut->charts++;
        w->queue[tail++] = (int32_t)root;
        while (head < tail) {
            bw_tet t = w->queue[head++];
            for (int i = 0; i < 4; i++) {
                bw_facet f = mesh->tet_facet[t][i];
                bw_tet next = bw_tet_across(mesh, f, t);
                if (next == BW_NONE || w->seen[next]) continue;
                w->seen[next] = 1;
                w->cut->side[f] = 0;
                w->cut->comb[next] =
                    bw_rotation_compose(w->cut->comb[t], bw_rotation_inverse(across(w, f, t)));
                if (comb_shift(w, f, t, next)) return w->ctx->error.status;
                w->queue[tail++] = next;
            }
        }
    }
    return BW_OK;
}

/* Rotations between combed charts; the identity across everything that is not cut. */
static void comb_transitions(cutter *w) {
    for (size_t f = 0; f < w->mesh->facet_count; f++) {
        const bw_tet *t = w->mesh->facet_tet[f];
        if (!w->cut->side[f]) continue;
        bw_rotation r = bw_rotation_compose(w->seams->rotation[f], bw_rotation_inverse(w->cut->comb[t[0]]));
        w->across[f] = bw_rotation_compose(w->cut->comb[t[1]], r);
    }
}

static void count_cut(cutter *w, bw_facet f, int change) {
    for (int i = 0; i < 3; i++) w->cut->cut_count[w->hinges->of_facet[f][i]] += change;
}

static bool is_plain(const cutter *w, bw_hinge h) {
    return !w->hinges->ring[h].open && bw_seams_regular(w->seams, w->hinges, h);
}

static bw_facet only_cut_facet(const cutter *w, bw_hinge h) {
    for (int32_t i = w->hinges->ring[h].begin; i < w->hinges->ring[h].end; i++)
        if (w->cut->side[w->hinges->exit[i]]) return w->hinges->exit[i];
    return BW_NONE;
}

/* Takes facets out of the cut that are alone at a regular interior hinge, until there are none. */
static bw_status shrink(cutter *w) {
    size_t head = 0, tail = 0;
    for (size_t f = 0; f < w->mesh->facet_count; f++)
        if (w->cut->side[f]) count_cut(w, (bw_facet)f, 1);
    for (size_t h = 0; h < w->hinges->count; h++)
        if (w->cut->cut_count[h] == 1 && is_plain(w, (bw_hinge)h)) w->queue[tail++] = (int32_t)h;
    while (head < tail) {
        bw_hinge h = w->queue[head++];
        bw_facet f = w->cut->cut_count[h] == 1 ? only_cut_facet(w, h) : BW_NONE;
        if (f == BW_NONE) continue;
        if (w->across[f])
            return bw_fail(w->ctx, BW_E_INTERNAL, "rotations around a regular edge do not compose to none");
        w->cut->side[f] = 0;
        count_cut(w, f, -1);
        for (int i = 0; i < 3; i++) {
            bw_hinge g = w->hinges->of_facet[f][i];
            if (w->cut->cut_count[g] == 1 && is_plain(w, g)) w->queue[tail++] = g;
        }
    }
    return BW_OK;
}

/* The other cut facet of a hinge with two of them, and whether a walk around the hinge crosses both in the
 * direction facet_tet[0] to facet_tet[1], or both in the other. */
static bw_facet partner(const cutter *w, bw_hinge h, bw_facet f, bool *alike) {
    bool forward[2] = {false, false};
    bw_facet other = BW_NONE;
    for (int32_t i = w->hinges->ring[h].begin; i < w->hinges->ring[h].end; i++) {
        bw_facet g = w->hinges->exit[i];
        if (!w->cut->side[g]) continue;
        forward[g == f] = w->mesh->facet_tet[g][0] == w->hinges->tet[i];
        if (g != f) other = g;
    }
    *alike = forward[0] == forward[1];
    return other;
}

/* A sheet grows from facet to facet; a walk around the hinge between two of its facets crosses it once
 * forward and once back. */
static void grow_cut_sheet(cutter *w, bw_facet first, int32_t sheet) {
    size_t head = 0, tail = 0;
    w->queue[tail++] = first;
    w->cut->cut_sheet[first] = sheet;
    w->cut->rotation[sheet] = w->across[first];
    while (head < tail) {
        bw_facet f = w->queue[head++];
        for (int i = 0; i < 3; i++) {
            bool alike;
            bw_hinge h = w->hinges->of_facet[f][i];
            if (w->cut->cut_count[h] != 2 || !is_plain(w, h)) continue;
            bw_facet g = partner(w, h, f, &alike);
            if (g == BW_NONE || w->cut->cut_sheet[g] != BW_NONE) continue;
            int8_t side = (int8_t)(alike ? -w->cut->side[f] : w->cut->side[f]);
            bw_rotation r = side > 0 ? w->across[g] : bw_rotation_inverse(w->across[g]);
            if (r != w->cut->rotation[sheet]) continue;
            w->cut->side[g] = side;
            w->cut->cut_sheet[g] = sheet;
            w->queue[tail++] = g;
        }
    }
}

static bw_status find_cut_sheets(cutter *w) {
    size_t room = 0, sheets = 0;
    for (size_t f = 0; f < w->mesh->facet_count; f++) w->cut->cut_sheet[f] = BW_NONE;
    for (size_t f = 0; f < w->mesh->facet_count; f++) {
        w->cut->cut_facets += w->cut->side[f] != 0;
        if (!w->cut->side[f] || w->cut->cut_sheet[f] != BW_NONE) continue;
        if (bw_reserve(w->ctx, &w->cut->rotation, &room, sheets + 1)) return w->ctx->error.status;
        grow_cut_sheet(w, (bw_facet)f, (int32_t)sheets++);
    }
    w->cut->cut_sheets = sheets;
    return BW_OK;
}

/* Joins the aligned facets of every hinge without cut facets: they see one chart, so equal axes mean equal
 * constants. */
static void grow_align_sheet(cutter *w, bw_facet first, int32_t sheet) {
    size_t head = 0, tail = 0;
    w->queue[tail++] = first;
    w->cut->align_sheet[first] = sheet;
    while (head < tail) {
        bw_facet f = w->queue[head++];
        for (int i = 0; i < 3; i++) {
            bw_hinge h = w->hinges->of_facet[f][i];
            const bw_ring *ring = &w->hinges->ring[h];
            if (w->cut->cut_count[h]) continue;
            for (int32_t j = ring->begin; j <= ring->end; j++) {
                bw_facet g = j < ring->end ? w->hinges->exit[j] : ring->entry;
                if (w->cut->align_axis[g] != w->cut->align_axis[f] || w->cut->align_sheet[g] != BW_NONE)
                    continue;
                w->cut->align_sheet[g] = sheet;
                w->queue[tail++] = g;
            }
        }
    }
}

static void find_align_sheets(cutter *w) {
    for (size_t f = 0; f < w->mesh->facet_count; f++) {
        int8_t axis = w->seams->align[f];
        w->cut->align_axis[f] = -1;
        w->cut->align_sheet[f] = BW_NONE;
        if (axis < 0) continue;
        bw_rotation r = w->cut->comb[w->mesh->facet_tet[f][0]];
        for (int8_t k = 0; k < 3; k++)
            if (bw_rotation_axis[r][k] == axis) w->cut->align_axis[f] = k;
    }
    for (size_t f = 0; f < w->mesh->facet_count; f++)
        if (w->cut->align_axis[f] >= 0 && w->cut->align_sheet[f] == BW_NONE)
            grow_align_sheet(w, (bw_facet)f, (int32_t)w->cut->align_sheets++);
}

static bool is_cut_edge(const cutter *w, bw_hinge h) {
    const bw_ring *ring = &w->hinges->ring[h];
    int cuts = w->cut->cut_count[h];
    if (!bw_seams_regular(w->seams, w->hinges, h) || w->seams->line[h] >= 0) return true;
    return ring->open ? cuts > 0 : cuts == 1 || cuts > 2;
}

/* Branches are cut edges joined at vertices that are no nodes (MC 6.2.1). */
static bw_status count_branches(cutter *w) {
    size_t n = w->mesh->vertex_count;
    int32_t *degree = bw_alloc(w->ctx, n, sizeof *degree),
            *parent = bw_alloc(w->ctx, w->hinges->count, sizeof *parent);
    int32_t *last = bw_alloc(w->ctx, n, sizeof *last);
    uint8_t *kind = bw_alloc(w->ctx, n, 1); /* 1: on the boundary; 2: on an interior cut edge */
    bw_status status = w->ctx->error.status;
    if (status) goto out;
    for (size_t h = 0; h < w->hinges->count; h++) {
        const bw_ring *ring = &w->hinges->ring[h];
        bool cut = is_cut_edge(w, (bw_hinge)h);
        parent[h] = cut ? (int32_t)h : BW_NONE;
        w->cut->cut_edges += cut;
        for (int i = 0; i < 2; i++) {
            bw_vertex v = w->mesh->edge[ring->edge][i];
            degree[v] += cut;
            kind[v] |= (uint8_t)((ring->open ? 1 : 0) | (cut && !ring->open ? 2 : 0));
        }
    }
    for (size_t v = 0; v < n; v++) {
        bool node = degree[v] && (degree[v] != 2 || kind[v] == 3);
        w->cut->nodes += node;
        last[v] = node ? -2 : BW_NONE;
    }
    w->cut->branches = w->cut->cut_edges;
    for (size_t h = 0; h < w->hinges->count; h++)
        for (int i = 0; i < 2 && parent[h] != BW_NONE; i++) {
            bw_vertex v = w->mesh->edge[w->hinges->ring[h].edge][i];
            if (last[v] >= 0)
                w->cut->branches -= bw_forest_join(parent, last[v], (int32_t)h);
            else if (last[v] == BW_NONE)
                last[v] = (int32_t)h;
        }
out:
    bw_free(w->ctx, degree);
    bw_free(w->ctx, parent);
    bw_free(w->ctx, last);
    bw_free(w->ctx, kind);
    return status;
}

bw_status bw_cutset_init(bw_context *ctx, bw_cutset *cut, const bw_tet_mesh *mesh, const bw_hinges *hinges,
                         const bw_seams *seams, const int64_t (*value)[4][3]) {
    cutter w = {.ctx = ctx, .mesh = mesh, .hinges = hinges, .seams = seams, .value = value, .cut = cut};
    size_t longest = hinges->count;
    *cut = (bw_cutset){0};
    if (mesh->facet_count > longest) longest = mesh->facet_count;
    if (mesh->tet_count > longest) longest = mesh->tet_count;
    w.queue = bw_alloc(ctx, longest, sizeof *w.queue);
    w.seen = bw_alloc(ctx, mesh->tet_count, 1);
    w.across = bw_alloc(ctx, mesh->facet_count, sizeof *w.across);
    cut->comb = bw_alloc(ctx, mesh->tet_count, sizeof *cut->comb);
    cut->shift = bw_alloc(ctx, mesh->tet_count, sizeof *cut->shift);
    cut->chart = bw_alloc(ctx, mesh->tet_count, sizeof *cut->chart);
    cut->side = bw_alloc(ctx, mesh->facet_count, sizeof *cut->side);
    cut->cut_sheet = bw_alloc(ctx, mesh->facet_count, sizeof *cut->cut_sheet);
    cut->align_sheet = bw_alloc(ctx, mesh->facet_count, sizeof *cut->align_sheet);
    cut->align_axis = bw_alloc(ctx, mesh->facet_count, sizeof *cut->align_axis);
    cut->cut_count = bw_alloc(ctx, hinges->count, sizeof *cut->cut_count);
    if (ctx->error.status) goto out;
    if (comb_charts(&w)) goto out;
    comb_transitions(&w);
    if (shrink(&w) || find_cut_sheets(&w)) goto out;
    find_align_sheets(&w);
    count_branches(&w);
out:
    bw_free(ctx, w.queue);
    bw_free(ctx, w.seen);
    bw_free(ctx, w.across);
    return ctx->error.status;
}
