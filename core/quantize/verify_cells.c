/* Verifier, 4: cutting and gluing (verify_cells.h). */
#include "quantize/verify_cells.h"

#include <stdlib.h>
#include <string.h>

#include "base/forest.h"

/* What is worth its time: less where the proof does not need it (bw_verifier.positive). */
enum { PLANES_MOST = 1 << 18, POINTS_MOST = 1 << 21, POSITIVE_LESS = 6 };

static size_t planes_most(const bw_verifier *v) { return (size_t)PLANES_MOST >> (v->positive ? POSITIVE_LESS : 0); }
static size_t points_most(const bw_verifier *v) { return (size_t)POINTS_MOST >> (v->positive ? POSITIVE_LESS : 0); }

/* ---- planes ---- */

/* A plane of a block: slot is 3 * block + axis. */
typedef struct {
    int64_t at;
    int32_t slot;
} cut;

typedef struct {
    bw_verifier *v;
    cut *item;        /* in the order they were found */
    size_t count, room;
    int32_t *table;   /* open addressing: item + 1, 0 is free */
    size_t size;      /* a power of two */
    size_t *use_begin; /* [block + 1]: contacts of a block, as 2 * contact + end */
    int32_t *use;
} cuts;

static size_t hash(const cut *c, size_t size) {
    uint64_t h = ((uint64_t)c->at * 0x9e3779b97f4a7c15u) ^ ((uint64_t)(uint32_t)c->slot * 0xc2b2ae3d27d4eb4fu);
    return (size_t)((h ^ h >> 29) * 0xbf58476d1ce4e5b9u >> 20) & (size - 1);
}

static bw_status grow_table(cuts *c) {
    size_t size = c->size ? 2 * c->size : 1024;
    int32_t *table = bw_alloc(c->v->ctx, size, sizeof *table);
    if (!table) return c->v->ctx->error.status;
    for (size_t i = 0; i < c->count; i++) {
        size_t h = hash(&c->item[i], size);
        while (table[h]) h = (h + 1) & (size - 1);
        table[h] = (int32_t)i + 1;
    }
    bw_free(c->v->ctx, c->table);
    c->table = table, c->size = size;
    return BW_OK;
}

static bw_status add_cut(cuts *c, cut item) {
    bw_status status = 2 * c->count >= c->size ? grow_table(c) : BW_OK;
    if (status != BW_OK) return status;
    size_t h = hash(&item, c->size);
    for (; c->table[h]; h = (h + 1) & (c->size - 1)) {
        const cut *o = &c->item[c->table[h] - 1];
        if (o->at == item.at && o->slot == item.slot) return BW_OK;
    }
    if (c->count >= planes_most(c->v)) {
        c->v->too_fine = true;
        return BW_OK;
    }
    status = bw_reserve(c->v->ctx, &c->item, &c->room, c->count + 1);
    if (status != BW_OK) return status;
    c->item[c->count++] = item;
    c->table[h] = (int32_t)c->count;
    return BW_OK;
}

/* Carries a plane of one block of a contact to the other. */
static bw_status carry_cut(cuts *c, const bw_contact *contact, int end, cut item) {
    int axis = item.slot % 3;
    const bw_transition *t = &contact->chart;
    int there = end ? bw_rotation_axis[t->rotation][axis] : bw_rotation_image[t->rotation][axis];
    int lateral = end ? there : axis; /* in the chart of block[0] */
    if (lateral == contact->side[0] >> 1) return BW_OK;
    int image = bw_rotation_image[t->rotation][lateral];
    int64_t sign = bw_rotation_sign[t->rotation][image], shift = t->shift[image];
    int64_t home = end ? sign * (item.at - shift) : item.at;
    if (home < contact->low[lateral] || home > contact->high[lateral]) return BW_OK;
    int64_t at = end ? home : sign * item.at + shift;
    return add_cut(c, (cut){at, 3 * contact->block[!end] + there});
}

static bw_status list_uses(cuts *c) {
    const bw_verifier *v = c->v;
    size_t blocks = v->x->block_count;
    c->use_begin = bw_alloc(v->ctx, blocks + 2, sizeof *c->use_begin);
    c->use = bw_alloc(v->ctx, 2 * v->contact_count, sizeof *c->use);
    if (v->ctx->error.status != BW_OK) return v->ctx->error.status;
    for (size_t i = 0; i < 2 * v->contact_count; i++)
        if (v->contact[i / 2].block[1] != BW_NONE) c->use_begin[v->contact[i / 2].block[i & 1] + 2]++;
    for (size_t b = 2; b < blocks + 2; b++) c->use_begin[b] += c->use_begin[b - 1];
    for (size_t i = 0; i < 2 * v->contact_count; i++)
        if (v->contact[i / 2].block[1] != BW_NONE) c->use[c->use_begin[v->contact[i / 2].block[i & 1] + 1]++] = (int32_t)i;
    return BW_OK;
}

static int compare_cuts(const void *a, const void *b) {
    const cut *x = a, *y = b;
    if (x->slot != y->slot) return x->slot < y->slot ? -1 : 1;
    return (x->at > y->at) - (x->at < y->at);
}

/* Planes through the critical nodes on the surfaces of blocks. */
static bw_status add_nodes(cuts *c) {
    const bw_verifier *v = c->v;
    bw_status status = BW_OK;
    for (size_t b = 0; b < v->x->block_count; b++)
        for (size_t i = v->place_begin[b]; i < v->place_begin[b + 1] && status == BW_OK; i++) {
            if (!v->node_critical[v->place[i].node]) continue;
            for (size_t k = 0; k < 3 && status == BW_OK; k++) {
                int64_t at = v->place[i].at[k].q;
                if (at >= 0 && at <= v->extent[b][k]) status = add_cut(c, (cut){at, (int32_t)(3 * b + k)});
            }
        }
    return status;
}

static bw_status find_planes(bw_cell_grid *g) {
    bw_verifier *v = g->v;
    size_t slots = 3 * v->x->block_count;
    cuts c = {.v = v};
    bw_status status = list_uses(&c);
    for (size_t s = 0; s < slots && status == BW_OK; s++) {
        status = add_cut(&c, (cut){0, (int32_t)s});
        if (status == BW_OK) status = add_cut(&c, (cut){v->extent[s / 3][s % 3], (int32_t)s});
    }
    for (size_t i = 0; i < v->contact_count && status == BW_OK; i++)
        for (int32_t k = 0; k < 3 && status == BW_OK; k++) {
            int32_t slot = 3 * v->contact[i].block[0] + k;
            status = add_cut(&c, (cut){v->contact[i].low[k], slot});
            if (status == BW_OK) status = add_cut(&c, (cut){v->contact[i].high[k], slot});
        }
    if (status == BW_OK) status = add_nodes(&c);
    for (size_t i = 0; i < c.count && status == BW_OK && !v->too_fine; i++) {
        size_t block = (size_t)c.item[i].slot / 3;
        for (size_t k = c.use_begin[block]; k < c.use_begin[block + 1] && status == BW_OK; k++)
            status = carry_cut(&c, &v->contact[c.use[k] / 2], c.use[k] & 1, c.item[i]);
        if (i % 4096 == 0 && status == BW_OK) status = bw_poll(v->ctx);
    }
    g->plane_begin = bw_alloc(v->ctx, slots + 1, sizeof *g->plane_begin);
    g->plane = bw_alloc(v->ctx, c.count, sizeof *g->plane);
    if (status == BW_OK) status = v->ctx->error.status;
    if (status == BW_OK && !v->too_fine) {
        qsort(c.item, c.count, sizeof *c.item, compare_cuts);
        for (size_t i = 0; i < c.count; i++) {
            g->plane[i] = c.item[i].at;
            g->plane_begin[c.item[i].slot + 1] = i + 1;
        }
    }
    bw_free(v->ctx, c.item), bw_free(v->ctx, c.table), bw_free(v->ctx, c.use_begin), bw_free(v->ctx, c.use);
    return status;
}

int bw_grid_find_plane(const bw_cell_grid *g, size_t block, int axis, int64_t at) {
    const int64_t *plane = bw_grid_plane(g, block, axis);
    size_t low = 0, high = bw_grid_planes(g, block, axis);
    while (low < high) {
        size_t mid = (low + high) / 2;
        if (plane[mid] < at) low = mid + 1;
        else high = mid;
    }
    return low < bw_grid_planes(g, block, axis) && plane[low] == at ? (int)low : BW_NONE;
}

/* ---- elements ---- */

static size_t number(const size_t n[3], const int at[3]) {
    return ((size_t)at[2] * n[1] + (size_t)at[1]) * n[0] + (size_t)at[0];
}

size_t bw_grid_point(const bw_cell_grid *g, size_t block, const int at[3]) {
    size_t n[3] = {bw_grid_planes(g, block, 0), bw_grid_planes(g, block, 1), 0};
    return g->point_base[block] + number(n, at);
}

size_t bw_grid_edge(const bw_cell_grid *g, size_t block, int axis, const int at[3]) {
    size_t n[3] = {bw_grid_planes(g, block, 0), bw_grid_planes(g, block, 1), bw_grid_planes(g, block, 2)};
    n[axis]--;
    return g->edge_base[3 * block + (size_t)axis] + number(n, at);
}

size_t bw_grid_square(const bw_cell_grid *g, size_t block, int axis, const int at[3]) {
    size_t n[3] = {bw_grid_planes(g, block, 0), bw_grid_planes(g, block, 1), bw_grid_planes(g, block, 2)};
    n[(axis + 1) % 3]--, n[(axis + 2) % 3]--;
    return g->square_base[3 * block + (size_t)axis] + number(n, at);
}

static bw_status count_elements(bw_cell_grid *g) {
    bw_verifier *v = g->v;
    size_t blocks = v->x->block_count;
    g->point_base = bw_alloc(v->ctx, blocks + 1, sizeof *g->point_base);
    g->edge_base = bw_alloc(v->ctx, 3 * blocks + 1, sizeof *g->edge_base);
    g->square_base = bw_alloc(v->ctx, 3 * blocks + 1, sizeof *g->square_base);
    g->cube_base = bw_alloc(v->ctx, blocks + 1, sizeof *g->cube_base);
    if (v->ctx->error.status != BW_OK) return v->ctx->error.status;
    for (size_t b = 0; b < blocks; b++) {
        size_t n[3], most = points_most(v);
        for (int k = 0; k < 3; k++) n[k] = bw_grid_planes(g, b, k), most /= n[k];
        v->too_fine = v->too_fine || !most || g->points > points_most(v);
        if (v->too_fine) return BW_OK;
        g->point_base[b] = g->points, g->points += n[0] * n[1] * n[2];
        g->cube_base[b] = g->cubes, g->cubes += (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
        for (size_t k = 0; k < 3; k++) {
            g->edge_base[3 * b + k] = g->edges, g->edges += (n[k] - 1) * n[(k + 1) % 3] * n[(k + 2) % 3];
            g->square_base[3 * b + k] = g->squares, g->squares += n[k] * (n[(k + 1) % 3] - 1) * (n[(k + 2) % 3] - 1);
        }
    }
    g->point_base[blocks] = g->points, g->edge_base[3 * blocks] = g->edges, g->square_base[3 * blocks] = g->squares;
    g->cube_base[blocks] = g->cubes;
    return BW_OK;
}

/* ---- gluing ---- */

static int32_t root_of(int32_t *parent, size_t e) { return bw_forest_root(parent, (int32_t)e); }
static void join(int32_t *parent, size_t a, size_t b) { bw_forest_join(parent, (int32_t)a, (int32_t)b); }

bw_status bw_grid_contact_open(const bw_cell_grid *g, const bw_contact *c, bw_grid_contact *out) {
    size_t a = (size_t)c->block[0], b = (size_t)c->block[1];
    out->normal[0] = c->side[0] >> 1;
    out->level[0] = c->side[0] & 1 ? (int)bw_grid_planes(g, a, out->normal[0]) - 1 : 0;
    for (int i = 0; i < 2; i++) {
        int k = out->axis[i] = (out->normal[0] + 1 + i) % 3;
        out->first[i] = bw_grid_find_plane(g, a, k, c->low[k]), out->last[i] = bw_grid_find_plane(g, a, k, c->high[k]);
        if (out->first[i] < 0 || out->last[i] < 0) return bw_fail(g->v->ctx, BW_E_CHECK, "a contact of block %zu ends between its planes", a);
    }
    if (c->block[1] == BW_NONE) return BW_OK;
    out->normal[1] = c->side[1] >> 1;
    out->level[1] = c->side[1] & 1 ? (int)bw_grid_planes(g, b, out->normal[1]) - 1 : 0;
    for (int i = 0; i < 2; i++) {
        int k = out->axis[i], to = out->to[i] = bw_rotation_image[c->chart.rotation][k], sign = bw_rotation_sign[c->chart.rotation][to];
        out->turned[i] = sign < 0;
        out->start[i] = bw_grid_find_plane(g, b, to, sign * c->low[k] + c->chart.shift[to]);
        int end = bw_grid_find_plane(g, b, to, sign * c->high[k] + c->chart.shift[to]);
        if (out->start[i] < 0 || end < 0 || sign * (end - out->start[i]) != out->last[i] - out->first[i])
            return bw_fail(g->v->ctx, BW_E_CHECK, "blocks %zu and %zu are cut differently where they touch", a, b);
    }
    return BW_OK;
}

/* The planes of the second block for those of the first; of the interval that begins there if `interval`. */
static int opposite(const bw_grid_contact *c, int i, int plane, bool interval) {
    int d = plane - c->first[i];
    return c->turned[i] ? c->start[i] - d - interval : c->start[i] + d;
}

static void places_of(const bw_grid_contact *c, int i, int j, bool along, bool across, int here[3], int there[3]) {
    bw_grid_contact_at(c, i, j, here);
    there[c->normal[1]] = c->level[1];
    there[c->to[0]] = opposite(c, 0, i, along), there[c->to[1]] = opposite(c, 1, j, across);
}

/* Bit of a square's corner that belongs to a lateral axis. */
static int bit_of(int normal, int axis) { return axis == (normal + 1) % 3 ? 0 : 1; }

static void glue_squares(bw_cell_grid *g, const bw_contact *contact, const bw_grid_contact *c) {
    size_t a = (size_t)contact->block[0], b = (size_t)contact->block[1];
    int bit[2][2] = {{bit_of(c->normal[0], c->axis[0]), bit_of(c->normal[0], c->axis[1])},
                     {bit_of(c->normal[1], c->to[0]), bit_of(c->normal[1], c->to[1])}};
    for (int i = c->first[0]; i < c->last[0]; i++)
        for (int j = c->first[1]; j < c->last[1]; j++) {
            int here[3], there[3];
            places_of(c, i, j, true, true, here, there);
            size_t s = bw_grid_square(g, a, c->normal[0], here), t = bw_grid_square(g, b, c->normal[1], there);
            join(g->square, s, t);
            for (int k = 0; k < 4; k++) {
                int l = k >> 1, m = k & 1; /* high along the first axis; along the second */
                int from = l << bit[0][0] | m << bit[0][1], to = (l ^ c->turned[0]) << bit[1][0] | (m ^ c->turned[1]) << bit[1][1];
                join(g->corner, 4 * s + (size_t)from, 4 * t + (size_t)to);
                /* the rim along contact axis l, at the low or high (m) end of the other */
                from = 2 * bit[0][l] + m, to = 2 * bit[1][l] + (m ^ c->turned[!l]);
                join(g->rim, 4 * s + (size_t)from, 4 * t + (size_t)to);
            }
        }
}

static bw_status glue(bw_cell_grid *g, const bw_contact *contact) {
    bw_grid_contact c;
    bw_status status = bw_grid_contact_open(g, contact, &c);
    if (status != BW_OK) return status;
    size_t a = (size_t)contact->block[0], b = (size_t)contact->block[1];
    int here[3], there[3];
    for (int i = c.first[0]; i <= c.last[0]; i++)
        for (int j = c.first[1]; j <= c.last[1]; j++) {
            places_of(&c, i, j, false, false, here, there);
            join(g->point, bw_grid_point(g, a, here), bw_grid_point(g, b, there));
            if (i < c.last[0]) {
                places_of(&c, i, j, true, false, here, there);
                join(g->edge, bw_grid_edge(g, a, c.axis[0], here), bw_grid_edge(g, b, c.to[0], there));
            }
            if (j < c.last[1]) {
                places_of(&c, i, j, false, true, here, there);
                join(g->edge, bw_grid_edge(g, a, c.axis[1], here), bw_grid_edge(g, b, c.to[1], there));
            }
        }
    glue_squares(g, contact, &c);
    return bw_poll(g->v->ctx);
}

/* The three squares at each corner, the two at each edge of a cube hang together. */
static void glue_cube(bw_cell_grid *g, size_t block, const int at[3]) {
    size_t face[6];
    for (int s = 0; s < 6; s++) {
        int there[3] = {at[0], at[1], at[2]};
        there[s >> 1] += s & 1;
        face[s] = bw_grid_square(g, block, s >> 1, there);
    }
    for (int c = 0; c < 8; c++) {
        size_t corner[3];
        for (int k = 0; k < 3; k++) {
            int bits = (c >> (k + 1) % 3 & 1) | (c >> (k + 2) % 3 & 1) << 1;
            corner[k] = 4 * face[2 * k + (c >> k & 1)] + (size_t)bits;
        }
        join(g->corner, corner[0], corner[1]), join(g->corner, corner[0], corner[2]);
    }
    for (int e = 0; e < 12; e++) { /* along axis k, at ends h of the next axis and i of the next but one */
        int k = e / 4, h = e & 1, i = e >> 1 & 1, u = (k + 1) % 3, w = (k + 2) % 3;
        size_t rim[2] = {4 * face[2 * u + h] + (size_t)(2 * bit_of(u, k) + i), 4 * face[2 * w + i] + (size_t)(2 * bit_of(w, k) + h)};
        join(g->rim, rim[0], rim[1]);
    }
}

static void glue_cubes(bw_cell_grid *g) {
    for (size_t b = 0; b < g->v->x->block_count; b++) {
        int n[3] = {(int)bw_grid_planes(g, b, 0) - 1, (int)bw_grid_planes(g, b, 1) - 1, (int)bw_grid_planes(g, b, 2) - 1};
        for (int z = 0; z < n[2]; z++)
            for (int y = 0; y < n[1]; y++)
                for (int x = 0; x < n[0]; x++) glue_cube(g, b, (int[3]){x, y, z});
    }
}

static int32_t *singletons(bw_context *ctx, size_t count) {
    int32_t *parent = bw_alloc(ctx, count, sizeof *parent);
    for (size_t i = 0; parent && i < count; i++) parent[i] = (int32_t)i;
    return parent;
}

bw_status bw_grid_open(bw_verifier *v, bw_cell_grid *g) {
    *g = (bw_cell_grid){.v = v};
    bw_status status = find_planes(g);
    if (status == BW_OK && !v->too_fine) status = count_elements(g);
    if (status != BW_OK || v->too_fine) return status;
    g->point = singletons(v->ctx, g->points);
    g->edge = singletons(v->ctx, g->edges);
    g->square = singletons(v->ctx, g->squares);
    g->corner = singletons(v->ctx, 4 * g->squares);
    g->rim = singletons(v->ctx, 4 * g->squares);
    status = v->ctx->error.status;
    for (size_t i = 0; i < v->contact_count && status == BW_OK; i++)
        if (v->contact[i].block[1] != BW_NONE) status = glue(g, &v->contact[i]);
    if (status != BW_OK) return status;
    glue_cubes(g);
    for (size_t i = 0; i < g->points; i++) g->point[i] = root_of(g->point, i);
    for (size_t i = 0; i < g->edges; i++) g->edge[i] = root_of(g->edge, i);
    for (size_t i = 0; i < g->squares; i++) g->square[i] = root_of(g->square, i);
    for (size_t i = 0; i < 4 * g->squares; i++) g->corner[i] = root_of(g->corner, i), g->rim[i] = root_of(g->rim, i);
    return BW_OK;
}

void bw_grid_close(bw_cell_grid *g) {
    void *blocks[] = {g->plane_begin, g->plane, g->point_base, g->edge_base, g->square_base, g->cube_base,
                      g->point, g->edge, g->square, g->corner, g->rim};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(g->v->ctx, blocks[i]);
}
