/* Blocks: cells that no wall separates, laid out in one chart each (MC 4.1). */
#include "complex/build.h"
#include "mesh/walk.h"

/* Disjoint sets of cells; a root is the lowest cell of its set. chart[i] leads from the chart of cell i to that of its parent. */
typedef struct {
    bw_cell *parent;
    bw_transition *chart;
    uint8_t *twisted; /* [cell]: reached with two different charts */
} forest;

/* The root of a cell, which becomes its parent; *chart leads to the root's chart. */
static bw_cell find(forest *f, bw_cell x, bw_transition *chart) {
    bw_cell root = x;
    *chart = (bw_transition){{0, 0, 0}, 0};
    for (; f->parent[root] != root; root = f->parent[root]) *chart = bw_transition_compose(&f->chart[root], chart);
    bw_transition rest = *chart;
    for (bw_cell next; f->parent[x] != root && x != root; x = next) {
        bw_transition back = bw_transition_inverse(&f->chart[x]);
        next = f->parent[x];
        f->parent[x] = root;
        f->chart[x] = rest;
        rest = bw_transition_compose(&rest, &back);
    }
    return root;
}

/* Joins two cells that no wall separates. `across` leads from the chart of b to that of a. */
static void join(forest *f, bw_cell a, bw_cell b, const bw_transition *across) {
    bw_transition up[2], direct;
    bw_cell root[2] = {find(f, a, &up[0]), find(f, b, &up[1])};
    direct = bw_transition_compose(&up[0], across); /* from the chart of b to that of a's root */
    if (root[0] == root[1]) {
        if (!bw_transition_equal(&direct, &up[1])) f->twisted[a] = 1;
        return;
    }
    bw_transition back = bw_transition_inverse(&up[1]);
    direct = bw_transition_compose(&direct, &back);
    int low = root[0] < root[1] ? 0 : 1;
    f->parent[root[!low]] = root[low];
    f->chart[root[!low]] = low == 0 ? direct : bw_transition_inverse(&direct);
}

/* Numbers the blocks by their lowest cells, and carries every cell's chart to that of the lowest. */
static bw_status number_blocks(bw_build *b, const forest *f) {
    bw_complex *x = b->complex;
    for (size_t i = 0; i < x->cell_count; i++) {
        bw_cell parent = f->parent[i]; /* lower, and done */
        x->cell_block[i] = parent == (bw_cell)i ? (bw_block)x->block_count++ : x->cell_block[parent];
        if (parent != (bw_cell)i) f->chart[i] = bw_transition_compose(&f->chart[parent], &f->chart[i]);
    }
    b->not_cuboid = bw_alloc(b->ctx, x->block_count, 1);
    if (!b->not_cuboid) return b->ctx->error.status;
    for (size_t i = 0; i < x->cell_count; i++) b->not_cuboid[x->cell_block[i]] |= f->twisted[i];
    return BW_OK;
}

/* Cells that no wall separates are one block; if they give some cell two different charts it is a torus (or worse): not_cuboid. */
static bw_status lay_out(bw_build *b) {
    const bw_cells *c = b->cells;
    forest f = {bw_alloc(b->ctx, c->cell_count, sizeof *f.parent), b->complex->cell_chart, bw_alloc(b->ctx, c->cell_count, 1)};
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < c->cell_count && status == BW_OK; i++) f.parent[i] = (bw_cell)i;
    for (size_t i = 0; i < c->mesh->facet_count && status == BW_OK; i++) {
        if (c->of_facet[i] != BW_NONE) continue;
        const bw_tet *side = c->mesh->facet_tet[i];
        bw_transition across = bw_grid_map_across(c->mesh, c->map, (bw_facet)i, side[1]);
        join(&f, side[0], side[1], &across);
        if (i % 65536 == 0) status = bw_poll(b->ctx);
    }
    for (size_t p = 0; p < c->polygon_count && status == BW_OK; p++) {
        const bw_cell_polygon *q = &c->polygon[p];
        if (!bw_cells_polygon_is_leaf(c, (bw_polygon)p) || q->flags & BW_WALL) continue;
        bw_transition across = bw_cells_transition(c, (bw_polygon)p, q->cell[1]);
        join(&f, q->cell[0], q->cell[1], &across);
        if (p % 65536 == 0) status = bw_poll(b->ctx);
    }
    if (status == BW_OK) status = number_blocks(b, &f);
    bw_free(b->ctx, f.parent), bw_free(b->ctx, f.twisted);
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

/* Side 0..5 of the block of polygon->cell[slot] in which a wall polygon lies, and the plane's value in the block's chart. */
static int find_side(const bw_build *b, bw_polygon polygon, int slot, int64_t *value) {
    const bw_cells *c = b->cells;
    bw_cell cell = c->polygon[polygon].cell[slot], first = c->polygon[polygon].cell[0];
    bool below = first_cell_is_below(c, polygon);
    bw_plane home = bw_cells_polygon_plane(c, polygon, bw_cells_tet(c, first)), plane = home;
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
            int side = find_side(b, (bw_polygon)p, slot, &value);
            b->polygon_side[p][slot] = (uint8_t)side;
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
        int64_t x = bw_cells_floor(b->cells, vertex, bw_cells_tet(b->cells, cell), axis, &fraction);
        exact[k] = !fraction;
        out[k] = chart->shift[k] + (bw_rotation_sign[chart->rotation][k] > 0 ? x : -x - fraction);
    }
}
