#include "quantize/differential.h"

#include <string.h>

#include "quantize/loops.h"
#include "quantize/tetpath.h"

typedef struct {
    int64_t distance;
    bw_node node;
} entry;

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *x;
    const bw_surface *surface;
    const bw_critical *critical;
    const int64_t *length;
    bw_differential *out;
    bw_tet_path path;
    size_t *begin;        /* [node + 1]: the uses that start at a node */
    bw_arc_use *use;
    int64_t *distance;    /* [node] from the nearest determined node; -1: not reached */
    bw_arc_use *arrival;  /* [node]: the last use on the way from there; BW_NONE at determined ones */
    bw_arc_use *tree;     /* [node]: the use by which it was reached first, the way back to a root */
    bw_critical_entity *stands; /* [node]: the cycle or closed region it may stand for, or BW_NONE */
    uint8_t *done;        /* [entity] */
    bw_arc_use *way;      /* scratch: a path of uses */
    size_t way_count, way_room;
    entry *heap;
    size_t heap_count, heap_room;
} builder;

/* ---- the graph of arcs ---- */

static bw_status push(builder *b, bw_node node, int64_t distance, bw_arc_use arrival) {
    if (b->distance[node] >= 0 && b->distance[node] <= distance) return BW_OK;
    if (bw_reserve(b->ctx, &b->heap, &b->heap_room, b->heap_count + 1)) return b->ctx->error.status;
    if (b->distance[node] < 0) b->tree[node] = arrival;
    b->distance[node] = distance, b->arrival[node] = arrival;
    size_t i = b->heap_count++;
    for (; i > 0 && b->heap[(i - 1) / 2].distance > distance; i = (i - 1) / 2) b->heap[i] = b->heap[(i - 1) / 2];
    b->heap[i] = (entry){distance, node};
    return BW_OK;
}

static entry pop(builder *b) {
    entry top = b->heap[0], last = b->heap[--b->heap_count];
    size_t i = 0;
    for (size_t child; (child = 2 * i + 1) < b->heap_count; i = child) {
        child += child + 1 < b->heap_count && b->heap[child + 1].distance < b->heap[child].distance;
        if (b->heap[child].distance >= last.distance) break;
        b->heap[i] = b->heap[child];
    }
    b->heap[i] = last;
    return top;
}

static void list_uses(builder *b) {
    size_t uses = 2 * b->x->arc_count;
    for (size_t u = 0; u < uses; u++) b->begin[bw_arc_use_start(b->x, (bw_arc_use)u) + 2]++;
    for (size_t n = 2; n < b->x->node_count + 2; n++) b->begin[n] += b->begin[n - 1];
    for (size_t u = 0; u < uses; u++) b->use[b->begin[bw_arc_use_start(b->x, (bw_arc_use)u) + 1]++] = (bw_arc_use)u;
}

/* Cycles of links, and regions without links and critical nodes: what touches nothing but itself. */
static void list_stands(builder *b) {
    const bw_complex *x = b->x;
    const bw_critical *c = b->critical;
    memset(b->stands, 0xff, x->node_count * sizeof *b->stands);
    for (size_t p = 0; p < x->patch_count; p++) {
        if (c->patch_region[p] == BW_NONE) continue;
        bw_critical_entity e = bw_critical_region_entity(c, c->patch_region[p]);
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4] && c->touch_begin[e + 1] - c->touch_begin[e] == 1; i++)
            b->stands[bw_arc_use_start(x, x->patch_chain[i])] = e;
    }
    for (size_t l = 0; l < c->link_count; l++)
        for (size_t i = c->link_begin[l]; i < c->link_begin[l + 1] && bw_critical_link_is_cycle(x, c, l); i++)
            b->stands[bw_arc_use_start(x, c->link_arc[i])] = bw_critical_link_entity(c, (int32_t)l);
}

/* ---- differences ---- */

/* The way from a determined node, in order: b->way. */
static bw_status trace_back(builder *b, bw_node node, const bw_arc_use *by) {
    b->way_count = 0;
    for (; by[node] != BW_NONE; node = bw_arc_use_start(b->x, by[node])) {
        if (bw_reserve(b->ctx, &b->way, &b->way_room, b->way_count + 1)) return b->ctx->error.status;
        b->way[b->way_count++] = by[node];
    }
    for (size_t i = 0; i < b->way_count / 2; i++) {
        bw_arc_use swap = b->way[i];
        b->way[i] = b->way[b->way_count - 1 - i], b->way[b->way_count - 1 - i] = swap;
    }
    return BW_OK;
}

/* Turns the end of the path to the entity that its last node stands for, and tells the directions across it. */
static bw_status turn_to_entity(builder *b, bw_node node, uint8_t *axes) {
    const bw_complex *x = b->x;
    const bw_critical *c = b->critical;
    bw_cvertex v = x->node_vertex[node];
    for (size_t a = 0; a < x->arc_count; a++) { /* an edge of the link at the node */
        if (c->arc_link[a] == BW_NONE || bw_critical_link_entity(c, c->arc_link[a]) != b->stands[node]) continue;
        for (size_t i = x->arc_edge_begin[a]; i < x->arc_edge_begin[a + 1]; i++) {
            const bw_cell_edge *e = &b->cells->edge[x->arc_edge[i]];
            if (e->vertex[0] != v && e->vertex[1] != v) continue;
            if (bw_tet_path_turn(&b->path, v, e->kind, e->carrier)) return b->ctx->error.status;
            *axes = (uint8_t)(7 ^ 1 << bw_cells_edge_axis(b->cells, x->arc_edge[i], b->path.tet[b->path.count - 1]));
            return BW_OK;
        }
    }
    for (size_t p = 0; p < x->patch_count; p++) { /* a polygon of the region at the node */
        if (c->patch_region[p] == BW_NONE || bw_critical_region_entity(c, c->patch_region[p]) != b->stands[node]) continue;
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1]; i++) {
            const bw_cell_polygon *q = &b->cells->polygon[x->patch_polygon[i]];
            bw_half h = q->half;
            do {
                if (b->cells->half[h].origin == v) {
                    bw_tet tet = bw_cells_tet(b->cells, q->cell[0]);
                    if (bw_tet_path_turn(&b->path, v, BW_IN_TET, tet)) return b->ctx->error.status;
                    *axes = (uint8_t)(1 << bw_cells_polygon_plane(b->cells, x->patch_polygon[i], tet).axis);
                    return BW_OK;
                }
                h = b->cells->half[h].next;
            } while (h != q->half);
        }
    }
    return bw_fail(b->ctx, BW_E_INTERNAL, "node %d stands for no link or region", node);
}

/* Follows b->way and records the difference of its ends. `turn`: the last node only stands for an entity. */
static bw_status record(builder *b, bw_node from, bw_node to, bool turn) {
    bw_differential *d = b->out;
    bw_difference n = {.from = from, .to = to, .axes = 7};
    b->path.count = 0;
    memset(b->path.vector, 0, sizeof b->path.vector);
    for (size_t i = 0; i < b->way_count; i++)
        if (bw_tet_path_follow(&b->path, b->way[i], b->length[b->way[i] >> 1])) return b->ctx->error.status;
    if (turn && turn_to_entity(b, to, &n.axes)) return b->ctx->error.status;
    memcpy(n.vector, b->path.vector, sizeof n.vector);
    size_t before = d->count ? d->tet_begin[d->count] : 0;
    if (bw_reserve(b->ctx, &d->difference, &d->difference_room, d->count + 1) || bw_reserve(b->ctx, &d->tet_begin, &d->begin_room, d->count + 2) ||
        bw_reserve(b->ctx, &d->tet, &d->tet_room, before + b->path.count))
        return b->ctx->error.status;
    memcpy(d->tet + before, b->path.tet, b->path.count * sizeof *d->tet);
    d->difference[d->count++] = n;
    d->tet_begin[d->count] = before + b->path.count;
    return BW_OK;
}

/* ---- the tree ---- */

static bw_status arrive(builder *b, bw_node n) {
    bool critical = b->critical->node[n] && b->arrival[n] != BW_NONE;
    bool stands = b->stands[n] != BW_NONE && !b->done[b->stands[n]];
    if (!critical && !stands) return BW_OK;
    if (stands) b->done[b->stands[n]] = 1;
    if (b->arrival[n] == BW_NONE) return BW_OK; /* the root itself */
    if (trace_back(b, n, b->arrival) || record(b, bw_arc_use_start(b->x, b->way[0]), n, !critical)) return b->ctx->error.status;
    if (critical) b->distance[n] = 0, b->arrival[n] = BW_NONE; /* determined: the next ways start here too */
    return BW_OK;
}

static bw_status grow(builder *b, bw_node root) {
    if (push(b, root, 0, BW_NONE)) return b->ctx->error.status;
    while (b->heap_count) {
        entry top = pop(b);
        if (top.distance != b->distance[top.node]) continue;
        if (arrive(b, top.node)) return b->ctx->error.status;
        for (size_t i = b->begin[top.node]; i < b->begin[top.node + 1]; i++) {
            bw_arc_use u = b->use[i];
            if (push(b, bw_arc_use_end(b->x, u), b->distance[top.node] + b->x->arc_length[u >> 1], u)) return b->ctx->error.status;
        }
    }
    return BW_OK;
}

/* A tet that holds a node. */
static bw_tet tet_at(const builder *b, bw_node n) {
    bw_arc_use u = b->use[b->begin[n]];
    size_t edge = u & 1 ? b->x->arc_edge_begin[(u >> 1) + 1] - 1 : b->x->arc_edge_begin[u >> 1];
    bw_half h = b->cells->edge[b->x->arc_edge[edge]].half;
    return bw_cells_tet(b->cells, b->cells->polygon[b->cells->half[h].polygon].cell[0]);
}

/* Roots: in every part of the mesh a critical node, else one that stands for something, else any. */
static bw_status grow_all(builder *b) {
    bw_differential *d = b->out;
    for (int wish = 0; wish < 3; wish++)
        for (size_t n = 0; n < b->x->node_count; n++) {
            if (b->distance[n] >= 0 || !(wish == 2 || (wish == 1 ? b->stands[n] != BW_NONE : b->critical->node[n]))) continue;
            if (bw_reserve(b->ctx, &d->root, &d->root_room, d->root_count + 1) ||
                bw_reserve(b->ctx, &d->root_tet, &d->root_tet_room, d->root_count + 1))
                return b->ctx->error.status;
            d->root[d->root_count] = (bw_node)n;
            d->root_tet[d->root_count++] = tet_at(b, (bw_node)n);
            if (grow(b, (bw_node)n)) return b->ctx->error.status;
        }
    return BW_OK;
}

/* ---- loops ---- */

static bw_status add_way(builder *b, bw_arc_use use) {
    if (bw_reserve(b->ctx, &b->way, &b->way_room, b->way_count + 1)) return b->ctx->error.status;
    b->way[b->way_count++] = use;
    return BW_OK;
}

/* From a root to the loop, around it, and back. */
static bw_status record_loop(builder *b, const bw_corridor *k, bw_node start) {
    if (trace_back(b, start, b->tree)) return b->ctx->error.status;
    size_t there = b->way_count;
    for (size_t i = k->path_count; i-- > 0;) /* a corridor lists its path from the end */
        if (add_way(b, k->path[i].use)) return b->ctx->error.status;
    for (size_t i = there; i-- > 0;)
        if (add_way(b, b->way[i] ^ 1)) return b->ctx->error.status;
    bw_node root = bw_arc_use_start(b->x, b->way[0]);
    return record(b, root, root, false);
}

static bw_status record_loops(builder *b, const bw_loops *loops) {
    bw_corridor k;
    bw_corridor_init(b->ctx, b->surface, &k);
    for (size_t i = 0; i < loops->volume.rank && b->ctx->error.status == BW_OK; i++) {
        bool exists;
        if (bw_loops_volume_corridor(b->ctx, loops, i, &k, &exists) || !exists) continue;
        int32_t point = (int32_t)b->surface->point_begin[k.block];
        if (bw_corridor_find(&k, &point, 1, &point, 1) == BW_OK) record_loop(b, &k, b->surface->point[point].node);
    }
    bw_corridor_clear(&k);
    return b->ctx->error.status;
}

bw_status bw_differential_init(bw_context *ctx, const bw_cells *cells, const bw_validity *validity, const int64_t *length, bw_differential *out) {
    const bw_surface *s = bw_validity_surface(validity);
    const bw_complex *x = s->complex;
    builder b = {.ctx = ctx, .cells = cells, .x = x, .surface = s, .critical = bw_validity_critical(validity), .length = length, .out = out};
    *out = (bw_differential){0};
    bw_tet_path_init(ctx, cells, x, &b.path);
    b.begin = bw_alloc(ctx, x->node_count + 2, sizeof *b.begin);
    b.use = bw_alloc(ctx, 2 * x->arc_count, sizeof *b.use);
    b.distance = bw_alloc(ctx, x->node_count, sizeof *b.distance);
    b.arrival = bw_alloc(ctx, x->node_count, sizeof *b.arrival);
    b.tree = bw_alloc(ctx, x->node_count, sizeof *b.tree);
    b.stands = bw_alloc(ctx, x->node_count, sizeof *b.stands);
    b.done = bw_alloc(ctx, x->node_count + b.critical->link_count + b.critical->region_count, 1);
    bw_status status = ctx->error.status;
    if (status == BW_OK) {
        memset(b.distance, 0xff, x->node_count * sizeof *b.distance);
        list_uses(&b), list_stands(&b);
        status = grow_all(&b);
    }
    if (status == BW_OK) status = record_loops(&b, bw_validity_loops(validity));
    bw_tet_path_clear(&b.path);
    void *blocks[] = {b.begin, b.use, b.distance, b.arrival, b.tree, b.stands, b.done, b.way, b.heap};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    if (status != BW_OK) bw_differential_clear(ctx, out);
    return status;
}

void bw_differential_clear(bw_context *ctx, bw_differential *d) {
    void *blocks[] = {d->difference, d->tet_begin, d->tet, d->root, d->root_tet};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    *d = (bw_differential){0};
}

/* ---- weights ---- */

/* 6 times the signed volume between four points, exact. */
static void volume(mpq_t out, const mpq_t point[4][3]) {
    mpq_t d[3][3], term;
    mpq_init(term);
    for (int i = 0; i < 9; i++) {
        mpq_init(d[i / 3][i % 3]);
        mpq_sub(d[i / 3][i % 3], point[i / 3 + 1][i % 3], point[0][i % 3]);
    }
    mpq_set_ui(out, 0, 1);
    for (int k = 0; k < 6; k++) { /* three even permutations, three odd ones */
        int i = k % 3, j = (k + (k < 3 ? 1 : 2)) % 3, l = 3 - i - j;
        mpq_mul(term, d[0][i], d[1][j]);
        mpq_mul(term, term, d[2][l]);
        if (k < 3) mpq_add(out, out, term);
        else mpq_sub(out, out, term);
    }
    for (int i = 0; i < 9; i++) mpq_clear(d[i / 3][i % 3]);
    mpq_clear(term);
}

void bw_differential_weights(const bw_cells *cells, const bw_complex *complex, bw_node node, bw_tet tet, double weight[4]) {
    mpq_t whole, part, at[3], point[4][3];
    mpq_inits(whole, part, at[0], at[1], at[2], NULL);
    bw_cells_parameter(cells, complex->node_vertex[node], tet, at);
    for (int i = 0; i < 12; i++) {
        mpq_init(point[i / 3][i % 3]);
        mpq_set_si(point[i / 3][i % 3], (long)cells->map->value[tet][i / 3][i % 3], 1);
    }
    volume(whole, (const mpq_t(*)[3])point);
    for (int c = 0; c < 4; c++) { /* a corner's share is the volume with the node in its place */
        for (int k = 0; k < 3; k++) mpq_swap(point[c][k], at[k]);
        volume(part, (const mpq_t(*)[3])point);
        for (int k = 0; k < 3; k++) mpq_swap(point[c][k], at[k]);
        mpq_div(part, part, whole);
        weight[c] = mpq_get_d(part);
    }
    for (int i = 0; i < 12; i++) mpq_clear(point[i / 3][i % 3]);
    mpq_clears(whole, part, at[0], at[1], at[2], NULL);
}
