/* Blocks: cells that no wall separates, laid out in one chart each (MC 4.1). */
#include "complex/build.h"
#include "mesh/walk.h"

/* A flood through the cells of one block after the other. Neighbouring tets mostly have the same chart, so cells share theirs. */
typedef struct {
    bw_build *b;
    bw_cell *stack;
    size_t count, room, chart_room, block_room;
    uint8_t *done; /* [cell]: all its neighbours were looked at */
} flood;

static bw_status new_chart(flood *f, const bw_transition *chart, bw_cell cell) {
    bw_complex *x = f->b->complex;
    bw_status status = bw_reserve(f->b->ctx, &x->chart, &f->chart_room, x->chart_count + 1);
    if (status != BW_OK) return status;
    x->cell_chart[cell] = (int32_t)x->chart_count;
    x->chart[x->chart_count++] = *chart;
    return BW_OK;
}

static bw_status enter(flood *f, bw_cell cell, bw_block block) {
    bw_status status = bw_reserve(f->b->ctx, &f->stack, &f->room, f->count + 1);
    if (status != BW_OK) return status;
    f->b->complex->cell_block[cell] = block;
    f->stack[f->count++] = cell;
    return BW_OK;
}

/* From a cell to its neighbour, unless that had its turn; `facet` is between them, BW_NONE if they are in one tet. A block in which a cell can
 * have two different charts is a torus (or worse): not_cuboid. */
static bw_status reach(flood *f, bw_cell from, bw_cell to, bw_facet facet) {
    const bw_cells *c = f->b->cells;
    bw_complex *x = f->b->complex;
    if (f->done[to]) return BW_OK;
    bw_block block = x->cell_block[from];
    bool known = x->cell_block[to] != BW_NONE;
    bw_status status = known ? BW_OK : enter(f, to, block);
    if (status != BW_OK) return status;
    bw_transition chart = *bw_complex_chart(x, from);
    if (facet != BW_NONE && bw_grid_map_same_chart(c->map, facet)) facet = BW_NONE;
    if (facet != BW_NONE) {
        bw_transition back = bw_grid_map_across(c->mesh, c->map, facet, bw_cells_tet(c, to));
        chart = bw_transition_compose(&chart, &back);
    }
    if (!known && facet != BW_NONE) return new_chart(f, &chart, to);
    if (!known) x->cell_chart[to] = x->cell_chart[from];
    else if ((facet != BW_NONE || x->cell_chart[to] != x->cell_chart[from]) && !bw_transition_equal(&chart, bw_complex_chart(x, to)))
        f->b->not_cuboid[block] = 1;
    return BW_OK;
}

/* To all neighbours across the leaves of a facet's polygon that are no walls. */
static bw_status reach_across_parts(flood *f, bw_cell from, bw_polygon p) {
    const bw_cells *c = f->b->cells;
    bw_status status = BW_OK;
    if (bw_cells_polygon_is_leaf(c, p))
        return c->polygon[p].flags & BW_WALL ? BW_OK : reach(f, from, bw_cells_across(c, p, from), c->polygon[p].carrier);
    for (int i = 0; i < 2 && status == BW_OK; i++) status = reach_across_parts(f, from, bw_cells_polygon_part(c, p, i));
    return status;
}

static bw_status reach_from(flood *f, bw_cell cell) {
    const bw_cells *c = f->b->cells;
    bw_status status = BW_OK;
    for (bw_polygon p = c->first[cell]; p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell)) {
        const bw_cell_polygon *q = &c->polygon[p];
        if (!(q->flags & BW_WALL)) status = reach(f, cell, bw_cells_across(c, p, cell), q->kind == BW_IN_FACET ? q->carrier : BW_NONE);
    }
    for (int i = 0; i < 4 && !bw_cells_is_open(c, cell) && status == BW_OK; i++) {
        bw_facet facet = c->mesh->tet_facet[cell][i];
        bw_polygon p = c->of_facet[facet];
        if (p == BW_NONE) status = reach(f, cell, bw_tet_across(c->mesh, facet, cell), facet);
        else status = reach_across_parts(f, cell, p);
    }
    f->done[cell] = 1;
    return status;
}

static bw_status flood_block(flood *f, bw_cell lowest) {
    const bw_transition identity = {{0, 0, 0}, 0};
    bw_build *b = f->b;
    bw_block block = (bw_block)b->complex->block_count++;
    bw_status status = bw_reserve(b->ctx, &b->not_cuboid, &f->block_room, b->complex->block_count);
    if (status == BW_OK) status = new_chart(f, &identity, lowest);
    if (status == BW_OK) status = enter(f, lowest, block);
    for (size_t steps = 1; f->count && status == BW_OK; steps++) {
        status = reach_from(f, f->stack[--f->count]);
        if (steps % 65536 == 0 && status == BW_OK) status = bw_poll(b->ctx);
    }
    return status;
}

/* Cells that no wall separates are one block; blocks are numbered by their lowest cells, whose charts they have. */
static bw_status lay_out(bw_build *b) {
    bw_complex *x = b->complex;
    flood f = {.b = b, .done = bw_alloc(b->ctx, x->cell_count, 1)};
    x->cell_block = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_block);
    x->cell_chart = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_chart);
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < x->cell_count && status == BW_OK; i++) x->cell_block[i] = BW_NONE;
    for (size_t i = 0; i < x->cell_count && status == BW_OK; i++)
        if (x->cell_block[i] == BW_NONE) status = flood_block(&f, (bw_cell)i);
    if (status == BW_OK) status = bw_trim(b->ctx, &x->chart, &f.chart_room, x->chart_count);
    bw_free(b->ctx, f.stack), bw_free(b->ctx, f.done);
    return status;
}

/* ---- joining ------------------------------------------------------------------------------------------------------- */

/* Disjoint sets of blocks; a root is the lowest of its set, like the cells that number them. */
typedef struct {
    bw_block *parent;
    bw_transition *chart; /* from the chart of a block to that of its parent */
    uint8_t *twisted;     /* reached with two different charts */
} forest;

static bw_block root_of(const forest *f, bw_block x, bw_transition *chart) {
    *chart = (bw_transition){{0, 0, 0}, 0};
    for (; f->parent[x] != x; x = f->parent[x]) *chart = bw_transition_compose(&f->chart[x], chart);
    return x;
}

/* Joins blocks a and b; `across` leads from the chart of b to that of a. */
static void join(forest *f, bw_block a, bw_block b, const bw_transition *across) {
    bw_transition up[2];
    bw_block root[2] = {root_of(f, a, &up[0]), root_of(f, b, &up[1])};
    bw_transition direct = bw_transition_compose(&up[0], across); /* from the chart of b to that of a's root */
    if (root[0] == root[1]) {
        if (!bw_transition_equal(&direct, &up[1])) f->twisted[root[0]] = 1;
        return;
    }
    bw_transition back = bw_transition_inverse(&up[1]);
    direct = bw_transition_compose(&direct, &back);
    int low = root[0] < root[1] ? 0 : 1;
    f->parent[root[!low]] = root[low];
    f->chart[root[!low]] = low == 0 ? direct : bw_transition_inverse(&direct);
    f->twisted[root[low]] |= f->twisted[root[!low]];
}

static void join_across_gone_walls(const bw_build *b, forest *f) {
    const bw_complex *old = b->before;
    for (size_t p = 0; p < old->patch_count; p++) {
        bw_polygon first = old->patch_polygon[old->patch_polygon_begin[p]];
        if (b->cells->polygon[first].flags & BW_WALL) continue;
        bw_transition across = bw_complex_across(b->cells, old, (bw_patch)p);
        join(f, old->patch_block[p][0], old->patch_block[p][1], &across);
    }
}

/* Takes cells and charts over from the complex before, with the numbers of the joined blocks. */
static bw_status relabel(bw_build *b, const forest *f) {
    bw_complex *x = b->complex, *old = b->before;
    bw_transition chart;
    bw_block *number = bw_alloc(b->ctx, old->block_count, sizeof *number), *of_chart = bw_alloc(b->ctx, old->chart_count, sizeof *of_chart);
    b->not_cuboid = bw_alloc(b->ctx, old->block_count, 1);
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < old->block_count && status == BW_OK; i++) {
        bw_block root = root_of(f, (bw_block)i, &chart);
        number[i] = root == (bw_block)i ? (bw_block)x->block_count++ : number[root];
        b->not_cuboid[number[i]] |= f->twisted[i];
    }
    for (size_t i = 0; i < old->cell_count && status == BW_OK; i++) {
        of_chart[old->cell_chart[i]] = old->cell_block[i];
        old->cell_block[i] = number[old->cell_block[i]];
    }
    for (size_t i = 0; i < old->chart_count && status == BW_OK; i++) {
        root_of(f, of_chart[i], &chart);
        old->chart[i] = bw_transition_compose(&chart, &old->chart[i]);
    }
    x->cell_block = old->cell_block, x->cell_chart = old->cell_chart, x->chart = old->chart, x->chart_count = old->chart_count;
    old->cell_block = NULL, old->cell_chart = NULL, old->chart = NULL;
    bw_free(b->ctx, number), bw_free(b->ctx, of_chart);
    return status;
}

/* The blocks of the complex before, joined where walls were taken away. */
static bw_status join_blocks(bw_build *b) {
    size_t n = b->before->block_count;
    forest f = {bw_alloc(b->ctx, n, sizeof *f.parent), bw_alloc(b->ctx, n, sizeof *f.chart), bw_alloc(b->ctx, n, 1)};
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < n && status == BW_OK; i++) f.parent[i] = (bw_block)i;
    if (status == BW_OK) join_across_gone_walls(b, &f);
    if (status == BW_OK) status = relabel(b, &f);
    bw_free(b->ctx, f.parent), bw_free(b->ctx, f.chart), bw_free(b->ctx, f.twisted);
    return status;
}

/* ---- boxes --------------------------------------------------------------------------------------------------------- */

/* Whether the first cell of a wall polygon lies below its plane (smaller coordinates), in the chart of that cell's tet. */
static bool first_cell_is_below(const bw_cells *c, bw_polygon p) {
    const bw_cell_polygon *q = &c->polygon[p];
    if (q->kind == BW_IN_TET) return true;
    bw_tet home = c->mesh->facet_tet[q->carrier][0];
    for (int i = 0; i < 4; i++)
        if (c->mesh->tet_facet[home][i] == q->carrier) return c->map->value[home][i][q->axis] < c->map->value[home][(i + 1) % 4][q->axis];
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
    const bw_transition *chart = bw_complex_chart(b->complex, cell);
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

/* The low corners of the boxes become the origins of the blocks' charts. */
static bw_status move_to_origin(bw_build *b) {
    bw_complex *x = b->complex;
    bw_block *block = bw_alloc(b->ctx, x->chart_count, sizeof *block);
    if (!block) return b->ctx->error.status;
    for (size_t i = 0; i < x->cell_count; i++) block[x->cell_chart[i]] = x->cell_block[i];
    for (size_t i = 0; i < x->chart_count; i++)
        for (int k = 0; k < 3 && !b->not_cuboid[block[i]]; k++) x->chart[i].shift[k] -= b->low[block[i]][k];
    bw_free(b->ctx, block);
    return BW_OK;
}

bw_status bw_build_blocks(bw_build *b) {
    bw_complex *x = b->complex;
    x->cell_count = b->cells->cell_count;
    bw_status status = b->before ? join_blocks(b) : lay_out(b);
    if (status != BW_OK) return status;
    x->block_extent = bw_alloc(b->ctx, x->block_count, sizeof *x->block_extent);
    b->low = bw_alloc(b->ctx, x->block_count, sizeof *b->low);
    b->high = bw_alloc(b->ctx, x->block_count, sizeof *b->high);
    status = b->ctx->error.status;
    if (status != BW_OK) return status;
    find_boxes(b);
    for (size_t i = 0; i < x->block_count; i++)
        for (int k = 0; k < 3 && !b->not_cuboid[i]; k++) x->block_extent[i][k] = b->high[i][k] - b->low[i][k];
    return move_to_origin(b);
}

void bw_build_locate(const bw_build *b, bw_cvertex vertex, bw_cell cell, int64_t out[3], bool exact[3]) {
    const bw_transition *chart = bw_complex_chart(b->complex, cell);
    for (int k = 0; k < 3; k++) {
        int axis = bw_rotation_axis[chart->rotation][k];
        bool fraction;
        int64_t x = bw_cells_floor(b->cells, vertex, bw_cells_tet(b->cells, cell), axis, &fraction);
        exact[k] = !fraction;
        out[k] = chart->shift[k] + (bw_rotation_sign[chart->rotation][k] > 0 ? x : -x - fraction);
    }
}
