/* Blocks: cells that no wall separates, laid out in one chart each (MC 4.1). */
#include "complex/build.h"
#include "mesh/walk.h"

/* Visits the cells that no wall separates from `root`, gives them its block's number and carries their charts to that of `root`. A cell reached
 * with two different charts makes the block a torus (or worse): not_cuboid. */
static void lay_out_block(bw_build *b, bw_cell root, bw_block block, bw_cell *stack) {
    const bw_cells *c = b->cells;
    bw_complex *x = b->complex;
    size_t top = 0;
    stack[top++] = root;
    x->cell_block[root] = block;
    while (top) {
        bw_cell at = stack[--top];
        for (bw_polygon p = c->cell[at].first; p != BW_NONE; p = bw_cells_next_in_cell(c, p, at)) {
            const bw_cell_polygon *q = &c->polygon[p];
            if (q->flags & BW_WALL) continue;
            bw_cell to = bw_cells_across(c, p, at);
            bool reached = x->cell_block[to] != BW_NONE;
            if (reached && q->cell[0] == at) continue; /* compared from the other side */
            bw_transition chart = x->cell_chart[at];
            if (q->kind == BW_IN_FACET) {
                bw_transition back = bw_cells_transition(c, p, to);
                chart = bw_transition_compose(&chart, &back);
            }
            if (!reached) {
                x->cell_chart[to] = chart;
                x->cell_block[to] = block;
                stack[top++] = to;
            } else if (!bw_transition_equal(&chart, &x->cell_chart[to])) {
                b->not_cuboid[block] = 1;
            }
        }
    }
}

/* Blocks are numbered by their lowest cell. */
static bw_status lay_out(bw_build *b) {
    size_t cells = b->cells->cell_count, room = 0;
    bw_complex *x = b->complex;
    bw_cell *stack = bw_alloc(b->ctx, cells, sizeof *stack);
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < cells && status == BW_OK; i++) x->cell_block[i] = BW_NONE;
    for (size_t root = 0; root < cells && status == BW_OK; root++) {
        if (x->cell_block[root] != BW_NONE) continue;
        status = bw_reserve(b->ctx, &b->not_cuboid, &room, x->block_count + 1);
        if (status == BW_OK) lay_out_block(b, (bw_cell)root, (bw_block)x->block_count++, stack);
        if (status == BW_OK) status = bw_poll(b->ctx);
    }
    bw_free(b->ctx, stack);
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
    x->cell_count = b->cells->cell_count;
    x->cell_block = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_block);
    x->cell_chart = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_chart);
    bw_status status = b->ctx->error.status;
    if (status == BW_OK) status = lay_out(b);
    if (status != BW_OK) return status;
    x->block_extent = bw_alloc(b->ctx, x->block_count, sizeof *x->block_extent);
    b->low = bw_alloc(b->ctx, x->block_count, sizeof *b->low);
    b->high = bw_alloc(b->ctx, x->block_count, sizeof *b->high);
    status = b->ctx->error.status;
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
