#include "format/tessellate.h"

#include <math.h>
#include <string.h>

#include "format/tessellate_choose.h"

#define FOR_HALVES(cells, h, p)                                                                              \
    for (bw_half h = (cells)->polygon[p].half, h##_end = BW_NONE; h != h##_end;                              \
         h##_end = (cells)->polygon[p].half, h = (cells)->half[h].next)
#define FOR_POLYGONS(cells, p, c)                                                                            \
    for (bw_polygon p = bw_cells_first_in_cell((cells), c); p != BW_NONE; p = bw_cells_next_in_cell((cells), p, (c)))

/* ---- sizes, straight corners
 * ------------------------------------------------------------------------------------- */

static bw_status count_sizes(bw_tessellation *t) {
    for (size_t p = 0; p < t->cells->polygon_count; p++) {
        if (!bw_cells_polygon_is_leaf(t->cells, (bw_polygon)p)) continue;
        FOR_HALVES(t->cells, h, p) t->size[p]++;
        if (t->size[p] > t->largest) t->largest = t->size[p];
    }
    return BW_OK;
}

static bw_status sort_cells_by_tet(bw_context *ctx, bw_tessellation *t) {
    size_t tets = t->cells->mesh->tet_count, cells = t->cells->cell_count;
    t->tet_begin = bw_alloc(ctx, tets + 2, sizeof *t->tet_begin);
    t->tet_cell = bw_alloc(ctx, cells, sizeof *t->tet_cell);
    if (!t->tet_begin || !t->tet_cell) return ctx->error.status;
    for (size_t c = 0; c < cells; c++) t->tet_begin[bw_cells_tet(t->cells, (bw_cell)c) + 2]++;
    for (size_t i = 0; i < tets; i++) t->tet_begin[i + 2] += t->tet_begin[i + 1];
    for (size_t c = 0; c < cells; c++) t->tet_cell[t->tet_begin[bw_cells_tet(t->cells, (bw_cell)c) + 1]++] = (bw_cell)c;
    return BW_OK;
}

/* Two edges that meet, of the same carrier and in iso-planes of the same axes, are collinear; others may be too (a line along an axis lies
 * in two iso-planes of a facet, and only one is recorded), which the coordinates then tell. */
static bool same_line(const bw_cell_edge *a, const bw_cell_edge *b) {
    if (a->kind != b->kind || a->carrier != b->carrier) return false;
    return a->kind == BW_IN_EDGE || a->axis == b->axis;
}

static bw_status mark_straight(bw_context *ctx, bw_tessellation *t, bw_chart *chart, bw_polygon p) {
    const bw_cells *cells = t->cells;
    bw_half before = bw_cells_half_previous(cells, cells->polygon[p].half);
    FOR_HALVES(cells, h, p) {
        const bw_cell_edge *in = &cells->edge[cells->half[before].edge],
                           *out = &cells->edge[cells->half[h].edge];
        int32_t slot[3];
        bw_status status = bw_chart_add(ctx, chart, cells->half[before].origin, &slot[0]);
        if (status == BW_OK) status = bw_chart_add(ctx, chart, cells->half[h].origin, &slot[1]);
        if (status == BW_OK) status = bw_chart_add(ctx, chart, bw_cells_half_end(cells, h), &slot[2]);
        if (status != BW_OK) return status;
        t->straight[h] = same_line(in, out) || bw_chart_collinear(chart, slot);
        before = h;
    }
    return BW_OK;
}

static bw_status mark_all_straight(bw_context *ctx, bw_tessellation *t, bw_chart *chart) {
    for (size_t tet = 0; tet < t->cells->mesh->tet_count; tet++) {
        bw_status status = bw_chart_open(ctx, chart, &t->points, (bw_tet)tet);
        for (size_t i = t->tet_begin[tet]; i < t->tet_begin[tet + 1]; i++)
            FOR_POLYGONS(t->cells, p, t->tet_cell[i]) {
                if (t->size[p] == 3 || t->cells->polygon[p].cell[0] != t->tet_cell[i]) continue;
                if (status == BW_OK) status = mark_straight(ctx, t, chart, p);
            }
        if (status == BW_OK) status = bw_poll(ctx);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

/* ---- polygons
 * ---------------------------------------------------------------------------------------------------- */

/* Place in the ring (n entries) of the lowest vertex whose neighbours are true corners; -1 if there is none.
 */
static int ring_fan(const bw_cells *cells, const bw_half *ring, const bw_half *straight, int n) {
    int best = -1;
    for (int i = 0; i < n; i++) {
        if (straight[(i + 1) % n] || straight[(i + n - 1) % n]) continue;
        if (best < 0 || cells->half[ring[i]].origin < cells->half[ring[best]].origin) best = i;
    }
    return best;
}

static int clip_ear(const bw_cells *cells, bw_half *ring, bw_half *straight, int n, bw_cvertex triangle[3]) {
    int ear = 0; /* any true corner will do: were the rest one line, there would have been a fan */
    while (straight[ear]) ear++;
    for (int i = 0; i < 3; i++) triangle[i] = cells->half[ring[(ear + n - 1 + i) % n]].origin;
    straight[(ear + 1) % n] = straight[(ear + n - 1) % n] = 0; /* both angles shrink */
    size_t rest = (size_t)(n - 1 - ear);
    memmove(ring + ear, ring + ear + 1, rest * sizeof *ring);
    memmove(straight + ear, straight + ear + 1, rest * sizeof *straight);
    return n - 1;
}

static void triangles_with_ears(const bw_tessellation *t, bw_polygon polygon, bw_cvertex (*triangle)[3]) {
    bw_half *ring = t->ring, *straight = t->ring + t->largest;
    int n = 0, fan;
    FOR_HALVES(t->cells, h, polygon) {
        straight[n] = t->straight[h];
        ring[n++] = h;
    }
    while ((fan = ring_fan(t->cells, ring, straight, n)) < 0)
        n = clip_ear(t->cells, ring, straight, n, *triangle++);
    for (int i = 1; i + 1 < n; i++, triangle++)
        for (int k = 0; k < 3; k++)
            (*triangle)[k] = t->cells->half[ring[(fan + (k ? i + k - 1 : 0)) % n]].origin;
}

void bw_tessellation_triangles(const bw_tessellation *t, bw_polygon polygon, bw_cvertex (*triangle)[3]) {
    const bw_cell_half *half = t->cells->half;
    if (t->size[polygon] > 3 && t->fan[polygon] == BW_NONE) {
        triangles_with_ears(t, polygon, triangle);
        return;
    }
    bw_half first = t->size[polygon] > 3 ? t->fan[polygon] : t->cells->polygon[polygon].half;
    for (bw_half h = half[first].next; half[h].next != first; h = half[h].next, triangle++) {
        (*triangle)[0] = half[first].origin;
        (*triangle)[1] = half[h].origin;
        (*triangle)[2] = half[half[h].next].origin;
    }
}

/* ---- cells
 * ------------------------------------------------------------------------------------------------------- */

/* Lists all vertices of a cell in the open chart. */
static bw_status list_vertices(bw_context *ctx, const bw_tessellation *t, bw_chart *chart, bw_cell cell) {
    int32_t slot;
    FOR_POLYGONS(t->cells, p, cell)
    FOR_HALVES(t->cells, h, p) {
        bw_status status = bw_chart_add(ctx, chart, t->cells->half[h].origin, &slot);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

/* bw_tessellation_side, the cell's vertices being listed: the sign of the tet with the cell's vertex that is
 * farthest from the plane, as far as doubles tell; in a cell as thin as their error with any that is not in it. A polygon's two
 * cells are on opposite sides, so one answer serves both. */
static int side_of_cell(bw_tessellation *t, const bw_chart *chart, bw_cell cell, bw_polygon polygon) {
    const bw_cell_half *half = t->cells->half;
    int turn = t->cells->polygon[polygon].cell[0] == cell ? 1 : -1;
    if (t->side[polygon]) return turn * t->side[polygon];
    bw_half h = t->cells->polygon[polygon].half;
    while (t->straight[half[h].next]) h = half[h].next; /* any true corner turns the same way */
    int32_t slot[4] = {BW_NONE, chart->slot[half[h].origin], chart->slot[half[half[h].next].origin],
                       chart->slot[half[half[half[h].next].next].origin]};
    int32_t best = BW_NONE;
    double largest = -1;
    FOR_POLYGONS(t->cells, q, cell) {
        if (q == polygon) continue;
        FOR_HALVES(t->cells, x, q) {
            slot[0] = chart->slot[half[x].origin];
            double volume = fabs(bw_chart_volume(chart, slot));
            if (volume > largest) largest = volume, best = slot[0];
        }
    }
    slot[0] = best;
    int sign = bw_chart_sign(chart, slot);
    FOR_POLYGONS(t->cells, q, cell)
    FOR_HALVES(t->cells, x, q) {
        if (sign) break;
        slot[0] = chart->slot[half[x].origin];
        sign = bw_chart_sign(chart, slot);
    }
    t->side[polygon] = (int8_t)(turn * sign);
    return sign;
}

bw_status bw_tessellation_side(bw_context *ctx, bw_tessellation *t, bw_chart *chart, bw_polygon polygon,
                               int slot, int *side) {
    bw_cell cell = t->cells->polygon[polygon].cell[slot];
    bw_status status = BW_OK;
    if (!t->side[polygon]) {
        status = bw_chart_open(ctx, chart, &t->points, bw_cells_tet(t->cells, cell));
        if (status == BW_OK) status = list_vertices(ctx, t, chart, cell);
    }
    if (status == BW_OK) *side = side_of_cell(t, chart, cell, polygon);
    return status;
}

static bw_status triangles_room(bw_context *ctx, const bw_tessellation *t, bw_cell_tets *out) {
    return bw_reserve(ctx, &out->triangle, &out->triangle_room, (size_t)t->largest);
}

/* Whether a listed point sees all triangles of the cell from inside, as far as doubles can prove it. */
static bool is_inside(bw_tessellation *t, const bw_chart *chart, bw_cell cell, bw_point point,
                      bw_cvertex (*triangle)[3]) {
    FOR_POLYGONS(t->cells, p, cell) {
        bw_tessellation_triangles(t, p, triangle);
        int side = side_of_cell(t, chart, cell, p);
        for (int32_t i = 0; i < t->size[p] - 2; i++) {
            int32_t slot[4] = {chart->slot[point], chart->slot[triangle[i][0]], chart->slot[triangle[i][1]],
                               chart->slot[triangle[i][2]]};
            if (bw_chart_sign_filtered(chart, slot) != side) return false;
        }
    }
    return true;
}

/* Four vertices of the cell that are not in one plane: the first, the farthest from it, and so on. */
static bw_status spanning_mean(bw_context *ctx, const bw_chart *chart, bw_added_point *point) {
    int32_t slot[4] = {0};
    for (int i = 1; i < 4; i++) {
        double largest = -1;
        for (size_t v = 0; v < chart->count; v++) {
            double e[3][3], size = 0;
            for (int k = 0; k < 3; k++) {
                e[0][k] = chart->at[v][k] - chart->at[slot[0]][k];
                e[1][k] = chart->at[slot[1]][k] - chart->at[slot[0]][k];
            }
            for (int k = 0; k < 3; k++)
                e[2][k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
            for (int k = 0; k < 3; k++) size += i == 1 ? fabs(e[0][k]) : fabs(e[2][k]);
            int32_t with[4] = {slot[0], slot[1], slot[2], (int32_t)v};
            if (i == 3) size = fabs(bw_chart_volume(chart, with));
            if (size > largest) largest = size, slot[i] = (int32_t)v;
        }
    }
    for (int i = 0; i < 4; i++) point->mean[i] = chart->point[slot[i]];
    if (bw_chart_sign(chart, slot) == 0)
        return bw_fail(ctx, BW_E_CHECK, "a cell in tet %d is flat", (int)chart->tet);
    return BW_OK;
}

/* Adds a point strictly inside a cell: the coarsest grid point near the mean of its vertices that is proven
 * inside, for that one is written with the fewest digits; else the exact mean of four vertices. */
static bw_status add_inside(bw_context *ctx, bw_tessellation *t, bw_chart *chart, bw_cell cell,
                            bw_cell_tets *scratch) {
    bw_status status = bw_chart_open(ctx, chart, &t->points, bw_cells_tet(t->cells, cell));
    if (status == BW_OK) status = list_vertices(ctx, t, chart, cell);
    if (status == BW_OK) status = triangles_room(ctx, t, scratch);
    if (status != BW_OK) return status;
    size_t vertices = chart->count;
    double mean[3] = {0}, extent = 0;
    for (size_t v = 0; v < vertices; v++)
        for (int k = 0; k < 3; k++) {
            mean[k] += chart->at[v][k] / (double)vertices;
            extent = fmax(extent, fabs(chart->at[v][k] - chart->at[0][k]));
        }
    bw_added_point point = {.tet = chart->tet, .mean = {BW_NONE}};
    int32_t slot;
    status = bw_points_add(ctx, &t->points, &point, &t->apex[cell]);
    if (status != BW_OK) return status;
    bw_added_point *added = &t->points.added[t->points.added_count - 1];
    for (int bits = extent > 1 ? ilogb(extent) : 0; status == BW_OK && bits >= 0; bits -= 2) {
        for (int k = 0; k < 3;
             k++) /* a multiple of 2^bits in the chart itself, so that trailing zeros cancel */
            added->value[k] =
                (int64_t)rint(ldexp(mean[k] + (double)chart->origin[k], -bits)) * ((int64_t)1 << bits);
        chart->count = vertices;
        status = bw_chart_add(ctx, chart, t->apex[cell], &slot);
        if (status == BW_OK && is_inside(t, chart, cell, t->apex[cell], scratch->triangle)) return BW_OK;
    }
    chart->count = vertices;
    return status == BW_OK ? spanning_mean(ctx, chart, added) : status;
}

static bw_status add_all_inside(bw_context *ctx, bw_tessellation *t, bw_chart *chart) {
    bw_cell_tets scratch = {0};
    bw_status status = BW_OK;
    for (size_t i = 0; i < t->cells->cell_count && status == BW_OK; i++) {
        if (t->apex[t->tet_cell[i]] != BW_NONE) continue;
        t->inside++;
        status = add_inside(ctx, t, chart, t->tet_cell[i], &scratch);
    }
    bw_cell_tets_clear(ctx, &scratch);
    return status;
}

uint64_t bw_tessellation_count(const bw_tessellation *t) {
    uint64_t count = 0;
    for (size_t c = 0; c < t->cells->cell_count; c++) FOR_POLYGONS(t->cells, p, (bw_cell)c) {
            bool coned = true;
            FOR_HALVES(t->cells, h, p) coned = coned && t->cells->half[h].origin != t->apex[c];
            if (coned) count += (uint64_t)t->size[p] - 2;
        }
    return count;
}

static bool triangle_has(const bw_cvertex triangle[3], bw_point v) {
    return triangle[0] == v || triangle[1] == v || triangle[2] == v;
}

bw_status bw_tessellation_cell(bw_context *ctx, bw_tessellation *t, bw_chart *chart, bw_cell cell,
                               bw_cell_tets *out) {
    out->count = 0;
    int32_t apex, slot[4];
    bw_status status = list_vertices(ctx, t, chart, cell);
    if (status == BW_OK) status = bw_chart_add(ctx, chart, t->apex[cell], &apex);
    if (status == BW_OK) status = triangles_room(ctx, t, out);
    if (status != BW_OK) return status;
    FOR_POLYGONS(t->cells, p, cell) {
        size_t triangles = (size_t)t->size[p] - 2;
        bw_tessellation_triangles(t, p, out->triangle);
        if (t->cells->polygon[p].flags & BW_WALL)
            side_of_cell(t, chart, cell, p);                         /* while it is cheap: the view asks */
        if (triangle_has(out->triangle[0], t->apex[cell])) continue; /* then all of them do */
        status = bw_reserve(ctx, &out->tet, &out->room, out->count + triangles);
        if (status != BW_OK) return status;
        int side = side_of_cell(t, chart, cell, p);
        for (size_t i = 0; i < triangles; i++) {
            const bw_cvertex *v = out->triangle[i];
            bw_point *tet = out->tet[out->count++];
            tet[0] = t->apex[cell], tet[1] = v[0], tet[2] = v[side > 0 ? 1 : 2], tet[3] = v[side > 0 ? 2 : 1];
            for (int k = 0; k < 4; k++) slot[k] = chart->slot[tet[k]];
            if (bw_chart_sign(chart, slot) > 0) continue;
            bw_fail_element(ctx, "tet", t->cells->mesh->tet_id[chart->tet], NULL);
            return bw_fail(ctx, BW_E_CHECK, "cell %d was cut into a tet that is not positive", (int)cell);
        }
    }
    return BW_OK;
}

void bw_cell_tets_clear(bw_context *ctx, bw_cell_tets *tets) {
    bw_free(ctx, tets->tet), bw_free(ctx, tets->triangle);
    *tets = (bw_cell_tets){0};
}

/* ---- everything
 * -------------------------------------------------------------------------------------------------- */

bw_status bw_tessellate(bw_context *ctx, bw_tessellation *out, bw_cells *cells) {
    *out = (bw_tessellation){.cells = cells};
    bw_chart chart = {0};
    bw_status status = bw_cells_open_all(ctx, cells);
    if (status == BW_OK) status = bw_points_init(ctx, &out->points, cells);
    out->straight = bw_alloc(ctx, cells->half_count, sizeof *out->straight);
    out->size = bw_alloc(ctx, cells->polygon_count, sizeof *out->size);
    out->fan = bw_alloc(ctx, cells->polygon_count, sizeof *out->fan);
    out->apex = bw_alloc(ctx, cells->cell_count, sizeof *out->apex);
    out->side = bw_alloc(ctx, cells->polygon_count, sizeof *out->side);
    status = ctx->error.status;
    if (status == BW_OK) status = count_sizes(out);
    if (status == BW_OK && !(out->ring = bw_alloc(ctx, 2 * (size_t)out->largest, sizeof *out->ring)))
        status = ctx->error.status;
    if (status == BW_OK) status = sort_cells_by_tet(ctx, out);
    if (status == BW_OK) status = mark_all_straight(ctx, out, &chart);
    if (status == BW_OK) status = bw_tessellation_choose(ctx, out);
    if (status == BW_OK) status = add_all_inside(ctx, out, &chart);
    bw_chart_clear(ctx, &chart);
    return status;
}

void bw_tessellation_clear(bw_context *ctx, bw_tessellation *t) {
    bw_points_clear(ctx, &t->points);
    bw_free(ctx, t->straight), bw_free(ctx, t->size), bw_free(ctx, t->fan), bw_free(ctx, t->apex);
    bw_free(ctx, t->side), bw_free(ctx, t->tet_begin), bw_free(ctx, t->tet_cell), bw_free(ctx, t->ring);
    *t = (bw_tessellation){0};
}
