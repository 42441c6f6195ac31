/* Blocks: cells that no wall separates, laid out in one chart each (MC 4.1). */
#include "base/parallel.h"
#include "complex/build.h"
#include "mesh/walk.h"

/* ---- sets ---------------------------------------------------------------------------------------------------------- */

/* Disjoint sets of blocks, or of what is going to be blocks; a root is the lowest of its set, like the cells that number them. */
typedef struct {
    bw_block *parent;
    bw_transition *chart; /* from the chart of a block to that of its parent */
    uint8_t *twisted;     /* reached with two different charts */
} forest;

static bw_status forest_init(bw_build *b, forest *f, size_t n) {
    *f = (forest){bw_alloc(b->ctx, n, sizeof *f->parent), bw_alloc(b->ctx, n, sizeof *f->chart), bw_alloc(b->ctx, n, 1)};
    for (size_t i = 0; i < n && b->ctx->error.status == BW_OK; i++) f->parent[i] = (bw_block)i;
    return b->ctx->error.status;
}

static void forest_clear(bw_build *b, forest *f) { bw_free(b->ctx, f->parent), bw_free(b->ctx, f->chart), bw_free(b->ctx, f->twisted); }

/* The root of a block, which becomes its parent. */
static bw_block root_of(forest *f, bw_block x, bw_transition *chart) {
    bw_block root = x;
    *chart = (bw_transition){{0, 0, 0}, 0};
    for (; f->parent[root] != root; root = f->parent[root]) *chart = bw_transition_compose(&f->chart[root], chart);
    f->parent[x] = root, f->chart[x] = *chart;
    return root;
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

/* ---- finding ------------------------------------------------------------------------------------------------------- */

/* Cells with one chart that no wall separates are a set first: cell_block is the parent of each, no higher than itself. Most cells are joined thus,
 * for neighbouring tets mostly have the same chart. */
static bw_cell parent_of(const bw_block *parent, bw_cell x) { return __atomic_load_n(&parent[x], __ATOMIC_RELAXED); }

/* Makes `low` the parent of a root, unless another thread was faster. */
static bool take_root(bw_block *parent, bw_cell root, bw_cell low) {
    return __atomic_compare_exchange_n(&parent[root], &(bw_cell){root}, low, false, __ATOMIC_RELAXED, __ATOMIC_RELAXED);
}

static bw_cell set_of(bw_block *parent, bw_cell x) {
    for (bw_cell up = parent_of(parent, x); up != x;) {
        bw_cell next = parent_of(parent, up);
        if (next == up) return up;
        __atomic_store_n(&parent[x], next, __ATOMIC_RELAXED);
        x = next, up = parent_of(parent, x);
    }
    return x;
}

/* By several threads at a time. What is no root never is one again, and its parents only get lower: whoever loses a race tries again, and the sets and
 * their lowest cells come out the same in any order. */
static void unite(bw_block *parent, const bw_cell cell[2]) {
    bw_cell low, high = cell[0], other = cell[1];
    do {
        bw_cell a = set_of(parent, high), b = set_of(parent, other);
        if (a == b) return;
        low = other = a < b ? a : b, high = a < b ? b : a;
    } while (!take_root(parent, high, low));
}

/* Whether a polygon joins its cells; `facet` is between them, BW_NONE if they have one chart. */
static bool joins(const bw_cells *c, bw_polygon p, bw_facet *facet) {
    const bw_cell_polygon *q = &c->polygon[p];
    *facet = q->kind == BW_IN_FACET && !(q->flags & BW_WALL) && !bw_grid_map_same_chart(c->map, q->carrier) ? q->carrier : BW_NONE;
    return bw_cells_polygon_is_leaf(c, p) && !(q->flags & BW_WALL);
}

static bw_status unite_facets(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const bw_build *b = user;
    const bw_cells *c = b->cells;
    (void)range;
    for (size_t f = begin; f < end; f++)
        if (c->of_facet[f] == BW_NONE && bw_grid_map_same_chart(c->map, (bw_facet)f)) unite(b->complex->cell_block, c->mesh->facet_tet[f]);
    return bw_poll(ctx);
}

static bw_status unite_polygons(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const bw_build *b = user;
    const bw_cells *c = b->cells;
    bw_facet facet;
    (void)range;
    for (size_t p = begin; p < end; p++)
        if (joins(c, (bw_polygon)p, &facet) && facet == BW_NONE) unite(b->complex->cell_block, c->polygon[p].cell);
    return bw_poll(ctx);
}

static bw_status unite_charts(bw_build *b) {
    enum { PIECE = 16384 }; /* fewer items are not worth a thread */
    size_t facets = b->cells->mesh->facet_count, polygons = b->cells->polygon_count;
    for (size_t i = 0; i < b->cells->cell_count; i++) b->complex->cell_block[i] = (bw_block)i;
    bw_status status = bw_parallel(b->ctx, facets, bw_parallel_ranges(b->ctx, facets, PIECE), unite_facets, b);
    if (status != BW_OK) return status;
    return bw_parallel_pieces(b->ctx, polygons, PIECE, bw_parallel_ranges(b->ctx, polygons, PIECE), unite_polygons, b);
}

/* Numbers the charts by their lowest cells. */
static void number_charts(bw_complex *x) {
    for (size_t i = 0; i < x->cell_count; i++) {
        bw_cell parent = x->cell_block[i];
        x->cell_chart[i] = parent == (bw_cell)i ? (int32_t)x->chart_count++ : x->cell_chart[parent];
    }
}

/* Sets that lie beside each other in different charts are one block, laid out in the chart of its lowest cell. One that can be reached in
 * two different ways is a torus (or worse). */
static void join_charts(const bw_build *b, forest *f) {
    const bw_cells *c = b->cells;
    const int32_t *chart = b->complex->cell_chart;
    bw_transition across;
    bw_facet facet;
    for (size_t i = 0; i < c->mesh->facet_count; i++) {
        if (c->of_facet[i] != BW_NONE || bw_grid_map_same_chart(c->map, (bw_facet)i)) continue;
        const bw_tet *tet = c->mesh->facet_tet[i];
        across = bw_grid_map_across(c->mesh, c->map, (bw_facet)i, tet[1]);
        join(f, chart[tet[0]], chart[tet[1]], &across);
    }
    for (size_t p = 0; p < c->polygon_count; p++) {
        if (!joins(c, (bw_polygon)p, &facet) || facet == BW_NONE) continue;
        const bw_cell *cell = c->polygon[p].cell;
        across = bw_cells_transition(c, (bw_polygon)p, cell[1]);
        join(f, chart[cell[0]], chart[cell[1]], &across);
    }
}

/* Numbers the blocks that the sets of a forest are. */
static bw_status number_blocks(bw_build *b, forest *f, size_t n, bw_block **number) {
    bw_transition chart;
    *number = bw_alloc(b->ctx, n, sizeof **number);
    b->not_cuboid = bw_alloc(b->ctx, n, 1);
    for (size_t i = 0; i < n && b->ctx->error.status == BW_OK; i++) {
        bw_block root = root_of(f, (bw_block)i, &chart);
        (*number)[i] = root == (bw_block)i ? (bw_block)b->complex->block_count++ : (*number)[root];
        b->not_cuboid[(*number)[i]] |= f->twisted[i];
    }
    return b->ctx->error.status;
}

static bw_status lay_out(bw_build *b) {
    bw_complex *x = b->complex;
    forest f = {NULL, NULL, NULL};
    bw_block *number = NULL;
    x->cell_block = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_block);
    x->cell_chart = bw_alloc(b->ctx, x->cell_count, sizeof *x->cell_chart);
    bw_status status = b->ctx->error.status == BW_OK ? unite_charts(b) : b->ctx->error.status;
    if (status == BW_OK) number_charts(x);
    x->chart = bw_alloc(b->ctx, x->chart_count, sizeof *x->chart);
    if (status == BW_OK) status = forest_init(b, &f, x->chart_count);
    if (status == BW_OK) join_charts(b, &f);
    if (status == BW_OK) status = number_blocks(b, &f, x->chart_count, &number);
    for (size_t i = 0; i < x->chart_count && status == BW_OK; i++) root_of(&f, (bw_block)i, &x->chart[i]);
    for (size_t i = 0; i < x->cell_count && status == BW_OK; i++) x->cell_block[i] = number[x->cell_chart[i]];
    bw_free(b->ctx, number);
    forest_clear(b, &f);
    return status;
}

/* ---- joining ------------------------------------------------------------------------------------------------------- */

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
static bw_status relabel(bw_build *b, forest *f) {
    bw_complex *x = b->complex, *old = b->before;
    bw_transition chart;
    bw_block *number = NULL, *of_chart = bw_alloc(b->ctx, old->chart_count, sizeof *of_chart);
    bw_status status = of_chart ? number_blocks(b, f, old->block_count, &number) : b->ctx->error.status;
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
    forest f;
    bw_status status = forest_init(b, &f, b->before->block_count);
    if (status == BW_OK) join_across_gone_walls(b, &f);
    if (status == BW_OK) status = relabel(b, &f);
    forest_clear(b, &f);
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
