/* Blocks: cells that no wall separates, laid out in one chart each (MC 4.1). */
#include <string.h>

#include "complex/build.h"
#include "mesh/walk.h"

static bw_cell find(bw_cell *parent, bw_cell x) {
    while (parent[x] != x) x = parent[x] = parent[parent[x]];
    return x;
}

/* Connected cells share a number; blocks are numbered by their lowest cell. */
static bw_status number_blocks(bw_build *b) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    bw_cell *parent = x->cell_block = bw_alloc(b->ctx, c->cell_count, sizeof *parent);
    if (!parent) return b->ctx->error.status;
    x->cell_count = c->cell_count;
    for (size_t i = 0; i < c->cell_count; i++) parent[i] = (bw_cell)i;
    for (size_t p = 0; p < c->polygon_count; p++) {
        const bw_cell_polygon *q = &c->polygon[p];
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p) || q->flags & BW_WALL) continue;
        bw_cell m = find(parent, q->cell[0]), n = find(parent, q->cell[1]);
        if (m < n) parent[n] = m;
        else parent[m] = n;
    }
    for (size_t i = 0; i < c->cell_count; i++) parent[i] = find(parent, (bw_cell)i);
    for (size_t i = 0; i < c->cell_count; i++) /* a root comes before its members, and holds its block's number from then on */
        parent[i] = parent[i] == (bw_cell)i ? (bw_block)x->block_count++ : parent[parent[i]];
    return BW_OK;
}

/* Carries every cell's chart to that of its block's first cell. A cell reached with two different charts makes the
 * block a torus (or worse): not_cuboid. */
static bw_status lay_out(bw_build *b) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    bw_cell *stack = bw_alloc(b->ctx, c->cell_count, sizeof *stack);
    uint8_t *reached = bw_alloc(b->ctx, c->cell_count, 1);
    bw_status status = b->ctx->error.status;
    for (size_t root = 0; root < c->cell_count && status == BW_OK; root++) {
        if (reached[root]) continue;
        size_t top = 0;
        stack[top++] = (bw_cell)root;
        reached[root] = 1;
        while (top) {
            bw_cell at = stack[--top];
            for (bw_polygon p = c->cell[at].first; p != BW_NONE; p = bw_cells_next_in_cell(c, p, at)) {
                if (c->polygon[p].flags & BW_WALL) continue;
                bw_cell to = bw_cells_across(c, p, at);
                bw_transition back = bw_cells_transition(c, p, to);
                bw_transition chart = bw_transition_compose(&x->cell_chart[at], &back);
                if (!reached[to]) {
                    x->cell_chart[to] = chart;
                    reached[to] = 1;
                    stack[top++] = to;
                } else if (chart.rotation != x->cell_chart[to].rotation ||
                           memcmp(chart.shift, x->cell_chart[to].shift, sizeof chart.shift)) {
                    b->not_cuboid[x->cell_block[at]] = 1;
                }
            }
        }
        status = bw_poll(b->ctx);
    }
    bw_free(b->ctx, stack);
    bw_free(b->ctx, reached);
    return status;
}

/* Whether the first cell of a wall polygon lies below its plane (smaller coordinates), in the chart of that cell's tet. */
static bool first_cell_is_below(const bw_cells *c, bw_polygon p) {
    const bw_cell_polygon *q = &c->polygon[p];
    if (q->kind == BW_IN_TET) return true;
    bw_tet home = c->mesh->facet_tet[q->carrier][0];
    for (int i = 0; i < 4; i++)
        if (c->mesh->tet_facet[home][i] == q->carrier) return c->map->value[home][i][q->axis] < q->value;
    return true;
}

int bw_build_side(const bw_build *b, bw_polygon polygon, int slot, int64_t *value) {
    const bw_cells *c = b->cells;
    bw_cell cell = c->polygon[polygon].cell[slot], first = c->polygon[polygon].cell[0];
    bool below = first_cell_is_below(c, polygon);
    bw_plane home = bw_cells_polygon_plane(c, polygon, c->cell[first].tet), plane = home;
    if (slot == 1) {
        below = !below;
        bw_transition t = bw_cells_transition(c, polygon, first);
        plane = bw_transition_plane(&t, home);
        below ^= bw_rotation_sign[t.rotation][plane.axis] < 0;
    }
    const bw_transition *chart = &b->complex->cell_chart[cell];
    bw_plane local = bw_transition_plane(chart, plane);
    below ^= bw_rotation_sign[chart->rotation][local.axis] < 0;
    *value = local.value;
    return 2 * local.axis + below; /* a block below a plane has it at its high end */
}

/* The boxes of all blocks: every wall polygon of a cuboid lies in one of six planes. */
static void find_boxes(bw_build *b) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    for (size_t i = 0; i < x->block_count; i++)
        for (int k = 0; k < 3; k++) b->low[i][k] = INT64_MAX, b->high[i][k] = INT64_MIN;
    for (size_t p = 0; p < c->polygon_count; p++) {
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p) || !(c->polygon[p].flags & BW_WALL)) continue;
        for (int slot = 0; slot < 2 && c->polygon[p].cell[slot] != BW_NONE; slot++) {
            bw_block block = x->cell_block[c->polygon[p].cell[slot]];
            int64_t value, *end;
            int side = bw_build_side(b, (bw_polygon)p, slot, &value);
            end = side & 1 ? &b->high[block][side >> 1] : &b->low[block][side >> 1];
            if (*end != INT64_MAX && *end != INT64_MIN && *end != value) b->not_cuboid[block] = 1;
            *end = value;
        }
    }
    for (size_t i = 0; i < x->block_count; i++)
        for (int k = 0; k < 3; k++)
            if (b->low[i][k] >= b->high[i][k]) b->not_cuboid[i] = 1; /* no walls on a side leave MAX and MIN */
}

bw_status bw_build_blocks(bw_build *b) {
    bw_complex *x = b->complex;
    bw_status status = number_blocks(b);
    if (status != BW_OK) return status;
    x->cell_chart = bw_alloc(b->ctx, b->cells->cell_count, sizeof *x->cell_chart);
    x->block_extent = bw_alloc(b->ctx, x->block_count, sizeof *x->block_extent);
    b->low = bw_alloc(b->ctx, x->block_count, sizeof *b->low);
    b->high = bw_alloc(b->ctx, x->block_count, sizeof *b->high);
    b->not_cuboid = bw_alloc(b->ctx, x->block_count, 1);
    status = b->ctx->error.status;
    if (status == BW_OK) status = lay_out(b);
    if (status != BW_OK) return status;
    find_boxes(b);
    for (size_t i = 0; i < x->block_count; i++)
        for (int k = 0; k < 3 && !b->not_cuboid[i]; k++) x->block_extent[i][k] = b->high[i][k] - b->low[i][k];
    for (size_t i = 0; i < b->cells->cell_count; i++) { /* the low corner becomes the origin */
        bw_block block = x->cell_block[i];
        for (int k = 0; k < 3 && !b->not_cuboid[block]; k++) x->cell_chart[i].shift[k] -= b->low[block][k];
    }
    return BW_OK;
}

void bw_build_locate(const bw_build *b, bw_cvertex vertex, bw_cell cell, int64_t out[3], bool exact[3]) {
    const bw_transition *chart = &b->complex->cell_chart[cell];
    for (int k = 0; k < 3; k++) {
        int axis = bw_rotation_axis[chart->rotation][k];
        bool fraction;
        int64_t x = bw_cells_floor(b->cells, vertex, b->cells->cell[cell].tet, axis, &fraction);
        exact[k] = !fraction;
        out[k] = chart->shift[k] + (bw_rotation_sign[chart->rotation][k] > 0 ? x : -x - fraction);
    }
}
