#include "hex/locate.h"

#include <math.h>
#include <string.h>

#include "exact/det.h"

/* What holds a point in the interior of a simplex. */
static bw_hold hold_of(const bw_locator *l, bw_carrier kind, int32_t simplex) {
    const bw_carriers *c = &l->carriers;
    bw_tet within = kind == BW_IN_VERTEX  ? c->vertex_tet[simplex]
                    : kind == BW_IN_EDGE  ? c->edge_tet[simplex]
                    : kind == BW_IN_FACET ? l->cells->mesh->facet_tet[simplex][0]
                                          : simplex;
    return bw_carriers_hold(c, kind, simplex, within);
}

/* ---- tets of blocks ------------------------------------------------------------------------------------------------ */

static bool same_place(const bw_complex *x, bw_cell a, bw_cell b) {
    return x->cell_block[a] == x->cell_block[b] && bw_transition_equal(bw_complex_chart(x, a), bw_complex_chart(x, b));
}

static void corners_of(const bw_locator *l, const bw_block_tet *t, double out[4][3]) {
    for (int i = 0; i < 4; i++) {
        int64_t at[3];
        bw_transition_apply(&l->complex->chart[t->chart], l->cells->map->value[t->tet][i], at);
        for (int k = 0; k < 3; k++) out[i][k] = (double)at[k];
    }
}

static bw_span span_of(const double *point, size_t count, size_t size) {
    bw_span s = {{0, 0, 0}, {0, 0, 0}};
    for (size_t k = 0; k < size; k++) {
        s.low[k] = s.high[k] = point[k];
        for (size_t i = 1; i < count; i++) s.low[k] = fmin(s.low[k], point[size * i + k]), s.high[k] = fmax(s.high[k], point[size * i + k]);
    }
    return s;
}

static bw_status list_tets(bw_context *ctx, bw_locator *l) {
    const bw_cells *c = l->cells;
    int32_t *block = bw_alloc(ctx, c->cell_count, sizeof *block);
    l->tet = bw_alloc(ctx, c->cell_count, sizeof *l->tet);
    l->tet_span = bw_alloc(ctx, c->cell_count, sizeof *l->tet_span);
    bw_status status = ctx->error.status;
    for (bw_cell cell = 0; cell < (bw_cell)c->cell_count && status == BW_OK; cell++) {
        bw_tet tet = bw_cells_tet(c, cell); /* also the number of its first cell */
        if (cell != tet && same_place(l->complex, cell, tet)) continue;
        double corner[4][3];
        l->tet[l->tet_count] = (bw_block_tet){tet, l->complex->cell_chart[cell]};
        corners_of(l, &l->tet[l->tet_count], corner);
        l->tet_span[l->tet_count] = span_of(corner[0], 4, 3);
        block[l->tet_count++] = l->complex->cell_block[cell];
    }
    if (status == BW_OK) status = bw_boxtree_init(ctx, l->tet_span, block, l->tet_count, l->complex->block_count, &l->tets);
    bw_free(ctx, block);
    return status;
}

/* Weights that are not quite a point of a simplex become the nearest that are. */
static void repair_weights(double *w, int n) {
    double sum = 0;
    for (int i = 0; i < n; i++) w[i] = w[i] > 0 ? w[i] : 0, sum += w[i];
    for (int i = 0; i < n; i++) w[i] = sum > 0 ? w[i] / sum : 1.0 / n;
}

/* The least of a point's four weights in a tet: negative if it is outside. */
static double weights_in_tet(const bw_locator *l, const bw_block_tet *t, const double p[3], double w[4]) {
    double c[4][3], sum = 0, least = INFINITY;
    corners_of(l, t, c);
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) c[i][k] -= p[k];
    w[0] = bw_det3_rounded(c[1], c[2], c[3]), w[1] = -bw_det3_rounded(c[0], c[2], c[3]), w[2] = bw_det3_rounded(c[0], c[1], c[3]), w[3] = -bw_det3_rounded(c[0], c[1], c[2]);
    for (int i = 0; i < 4; i++) sum += w[i];
    for (int i = 0; i < 4; i++) least = fmin(least, w[i] /= sum);
    return least;
}

/* How far to look around a point: first as far as rounding goes, in the end everywhere. */
static const double slacks[] = {1, 0x1p10, 0x1p20, INFINITY};
enum { SLACKS = sizeof slacks / sizeof *slacks };
#define NEAR (-0x1p-20) /* a weight that far outside may be rounding: look no further */

void bw_locate_in_block(const bw_locator *l, bw_block block, const double p[3], double position[3], bw_hold *hold) {
    double best = -INFINITY, weight[4] = {0}, w[4];
    bw_tet tet = BW_NONE;
    for (int s = 0; s < SLACKS && best < NEAR; s++) {
        bw_boxtree_walk walk;
        bw_boxtree_start(&l->tets, block, p, slacks[s], &walk);
        for (int32_t i; best < 0 && (i = bw_boxtree_next(&l->tets, &walk)) != BW_NONE;) {
            double least = weights_in_tet(l, &l->tet[i], p, w);
            if (least <= best) continue;
            best = least, tet = l->tet[i].tet;
            memcpy(weight, w, sizeof w);
        }
    }
    repair_weights(weight, 4);
    for (int k = 0; k < 3; k++) {
        position[k] = 0;
        for (int i = 0; i < 4; i++) position[k] += weight[i] * l->cells->mesh->position[l->cells->mesh->tet[tet][i]][k];
    }
    *hold = (bw_hold){tet, BW_HELD_NOT};
}

/* ---- triangles of patches ------------------------------------------------------------------------------------------ */

/* A vertex of the cell complex in the chart of a block, to half a grid unit. */
static void vertex_in_block(const bw_locator *l, bw_cvertex v, bw_cell cell, double out[3]) {
    const bw_transition *chart = bw_complex_chart(l->complex, cell);
    int64_t at[3];
    unsigned fraction = bw_cells_locate(l->cells, v, bw_cells_tet(l->cells, cell), at);
    for (int i = 0; i < 3; i++) {
        int k = bw_rotation_axis[chart->rotation][i];
        out[i] = (double)chart->shift[i] + bw_rotation_sign[chart->rotation][i] * ((double)at[k] + 0.5 * (fraction >> k & 1));
    }
}

static void in_frame(const bw_transition *frame, const double x[3], double uv[2]) {
    for (int k = 0; k < 2; k++) {
        int8_t i = bw_rotation_image[frame->rotation][k];
        uv[k] = bw_rotation_sign[frame->rotation][i] * (x[i] - (double)frame->shift[i]);
    }
}

/* Whether a polygon of a patch, seen in the chart of its cell[slot], is where the patch is in the chart of its first block. */
static bool is_in_place(const bw_locator *l, bw_patch p, bw_polygon polygon, int slot) {
    const bw_complex *x = l->complex;
    bw_cell cell = l->cells->polygon[polygon].cell[slot];
    if (cell == BW_NONE || x->cell_block[cell] != x->patch_block[p][0]) return false;
    int normal = x->patch_side[p][0] >> 1;
    bw_half h = l->cells->polygon[polygon].half, head = h;
    do {
        double at[3];
        vertex_in_block(l, l->cells->half[h].origin, cell, at);
        for (int i = 0; i < 3; i++) {
            double extent = i == normal ? 0 : (double)x->patch_extent[p][(i + 2 - normal) % 3], low = (double)x->patch_low[p][i];
            if (at[i] < low || at[i] > low + extent) return false;
        }
        h = l->cells->half[h].next;
    } while (h != head);
    return true;
}

static bw_status add_triangle(bw_context *ctx, bw_locator *l, size_t *room, size_t *span_room, const bw_patch_triangle *t) {
    bw_status status = bw_reserve(ctx, &l->triangle, room, l->triangle_count + 1);
    if (status == BW_OK) status = bw_reserve(ctx, &l->triangle_span, span_room, l->triangle_count + 1);
    if (status != BW_OK) return status;
    l->triangle_span[l->triangle_count] = span_of(t->uv[0], 3, 2);
    l->triangle[l->triangle_count++] = *t;
    return BW_OK;
}

static bw_status add_facet(bw_context *ctx, bw_locator *l, size_t room[2], bw_patch p, bw_cell cell, bw_facet facet) {
    const bw_tet_mesh *mesh = l->cells->mesh;
    bw_tet tet = bw_cells_tet(l->cells, cell);
    bw_patch_triangle t = {.carrier = facet, .kind = BW_IN_FACET};
    for (int i = 0; i < 3; i++) {
        int64_t at[3];
        bw_transition_apply(bw_complex_chart(l->complex, cell), l->cells->map->value[tet][bw_tet_corner(mesh, tet, mesh->facet[facet][i])], at);
        in_frame(&l->map->real[p][0], (double[3]){(double)at[0], (double)at[1], (double)at[2]}, t.uv[i]);
        t.corner[i] = mesh->facet[facet][i];
    }
    return add_triangle(ctx, l, &room[0], &room[1], &t);
}

static bw_status add_fan(bw_context *ctx, bw_locator *l, size_t room[2], bw_patch p, bw_cell cell, bw_polygon polygon) {
    const bw_cell_half *half = l->cells->half;
    bw_half head = l->cells->polygon[polygon].half;
    bw_status status = BW_OK;
    for (bw_half h = half[head].next; half[h].next != head && status == BW_OK; h = half[h].next) {
        bw_patch_triangle t = {.corner = {half[head].origin, half[h].origin, half[half[h].next].origin}, .kind = BW_IN_TET,
                               .carrier = bw_cells_tet(l->cells, cell)};
        for (int i = 0; i < 3; i++) {
            double at[3];
            vertex_in_block(l, t.corner[i], cell, at);
            in_frame(&l->map->real[p][0], at, t.uv[i]);
        }
        status = add_triangle(ctx, l, &room[0], &room[1], &t);
    }
    return status;
}

static bw_status list_triangles(bw_context *ctx, bw_locator *l) {
    const bw_complex *x = l->complex;
    size_t room[2] = {0, 0}, *end = bw_alloc(ctx, x->patch_count, sizeof *end);
    bw_status status = ctx->error.status;
    for (bw_patch p = 0; p < (bw_patch)x->patch_count && status == BW_OK; p++) {
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1] && status == BW_OK; i++) {
            bw_polygon polygon = x->patch_polygon[i];
            const bw_cell_polygon *q = &l->cells->polygon[polygon];
            bw_cell cell = q->cell[!is_in_place(l, p, polygon, 0)];
            if (cell == BW_NONE) return bw_free(ctx, end), bw_fail(ctx, BW_E_CHECK, "a polygon of patch %d is not in its side", p);
            status = q->kind == BW_IN_FACET ? add_facet(ctx, l, room, p, cell, q->carrier) : add_fan(ctx, l, room, p, cell, polygon);
        }
        end[p] = l->triangle_count;
    }
    int32_t *patch = bw_alloc(ctx, l->triangle_count, sizeof *patch);
    if (status == BW_OK) status = ctx->error.status;
    for (size_t p = 0, i = 0; p < x->patch_count && status == BW_OK; p++)
        for (; i < end[p]; i++) patch[i] = (int32_t)p;
    if (status == BW_OK) status = bw_boxtree_init(ctx, l->triangle_span, patch, l->triangle_count, x->patch_count, &l->triangles);
    bw_free(ctx, end), bw_free(ctx, patch);
    return status;
}

static double weights_in_triangle(const bw_patch_triangle *t, const double p[2], double w[3]) {
    double c[3][2], sum = 0, least = INFINITY;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 2; k++) c[i][k] = t->uv[i][k] - p[k];
    for (int i = 0; i < 3; i++) {
        const double *a = c[(i + 1) % 3], *b = c[(i + 2) % 3];
        sum += w[i] = a[0] * b[1] - a[1] * b[0];
    }
    if (sum == 0) return -INFINITY; /* three vertices of a polygon on one line */
    for (int i = 0; i < 3; i++) least = fmin(least, w[i] /= sum);
    return least;
}

void bw_locate_in_patch(const bw_locator *l, bw_patch patch, const double p[2], double position[3], bw_hold *hold) {
    double best = -INFINITY, weight[3] = {0}, w[3];
    const bw_patch_triangle *t = NULL;
    for (int s = 0; s < SLACKS && best < NEAR; s++) {
        bw_boxtree_walk walk;
        bw_boxtree_start(&l->triangles, patch, (double[3]){p[0], p[1], 0}, slacks[s], &walk);
        for (int32_t i; best < 0 && (i = bw_boxtree_next(&l->triangles, &walk)) != BW_NONE;) {
            double least = weights_in_triangle(&l->triangle[i], p, w);
            if (least <= best) continue;
            best = least, t = &l->triangle[i];
            memcpy(weight, w, sizeof w);
        }
    }
    repair_weights(weight, 3);
    memset(position, 0, 3 * sizeof *position);
    for (int i = 0; i < 3; i++) {
        double at[3];
        if (t->kind == BW_IN_FACET) memcpy(at, l->cells->mesh->position[t->corner[i]], sizeof at);
        else bw_cells_position(l->cells, t->corner[i], at);
        for (int k = 0; k < 3; k++) position[k] += weight[i] * at[k];
    }
    *hold = hold_of(l, (bw_carrier)t->kind, t->carrier);
}

/* ---- arcs and nodes ------------------------------------------------------------------------------------------------ */

void bw_locate_node(const bw_locator *l, bw_node node, double position[3], bw_hold *hold) {
    bw_cvertex v = l->complex->node_vertex[node];
    bw_cells_position(l->cells, v, position);
    *hold = hold_of(l, (bw_carrier)l->cells->vertex[v].kind, l->cells->vertex[v].carrier);
}

/* Length of an edge of an arc in the map, to a grid unit. */
static double length_of(const bw_locator *l, bw_cedge e) {
    const bw_cells *c = l->cells;
    bw_cell cell = c->polygon[c->half[c->edge[e].half].polygon].cell[0];
    double a[3], b[3], sum = 0;
    vertex_in_block(l, c->edge[e].vertex[0], cell, a), vertex_in_block(l, c->edge[e].vertex[1], cell, b);
    for (int k = 0; k < 3; k++) sum += fabs(a[k] - b[k]);
    return sum;
}

void bw_locate_on_arc(const bw_locator *l, bw_arc arc, size_t parts, double (*position)[3], bw_hold *hold) {
    const bw_cells *c = l->cells;
    const bw_complex *x = l->complex;
    size_t begin = x->arc_edge_begin[arc], end = x->arc_edge_begin[arc + 1], next = 1;
    double total = 0, passed = 0;
    for (size_t i = begin; i < end; i++) total += length_of(l, x->arc_edge[i]);
    bw_cvertex from = x->node_vertex[x->arc_node[arc][0]];
    for (size_t i = begin; i < end; i++) {
        const bw_cell_edge *e = &c->edge[x->arc_edge[i]];
        bw_cvertex to = e->vertex[e->vertex[0] == from];
        double length = length_of(l, x->arc_edge[i]), a[3], b[3];
        bw_cells_position(c, from, a), bw_cells_position(c, to, b);
        for (; next < parts; next++) {
            double s = length > 0 ? (total * (double)next / (double)parts - passed) / length : INFINITY;
            if (s > 1 && i + 1 < end) break;
            s = s > 1 ? 1 : s;
            for (int k = 0; k < 3; k++) position[next - 1][k] = (1 - s) * a[k] + s * b[k];
            hold[next - 1] = hold_of(l, (bw_carrier)e->kind, e->carrier);
        }
        passed += length;
        from = to;
    }
}

/* ---- everything ---------------------------------------------------------------------------------------------------- */

bw_status bw_locator_init(bw_context *ctx, const bw_blockwise *map, bw_locator *l) {
    *l = (bw_locator){.map = map, .cells = map->atlas->cells, .complex = map->atlas->complex};
    bw_status status = bw_carriers_init(ctx, l->cells->mesh, l->cells->map, &l->carriers);
    if (status == BW_OK) status = list_tets(ctx, l);
    if (status == BW_OK) status = list_triangles(ctx, l);
    if (status != BW_OK) bw_locator_clear(ctx, l);
    return status;
}

bw_status bw_locator_init_blocks(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_locator *l) {
    *l = (bw_locator){.cells = cells, .complex = complex};
    bw_status status = list_tets(ctx, l);
    if (status != BW_OK) bw_locator_clear(ctx, l);
    return status;
}

void bw_locator_clear(bw_context *ctx, bw_locator *l) {
    bw_boxtree_clear(ctx, &l->tets), bw_boxtree_clear(ctx, &l->triangles);
    bw_carriers_clear(ctx, &l->carriers);
    bw_free(ctx, l->tet), bw_free(ctx, l->triangle), bw_free(ctx, l->tet_span), bw_free(ctx, l->triangle_span);
    memset(l, 0, sizeof *l);
}
