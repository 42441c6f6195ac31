/* Hex meshes made of blocks, for tests: boxes of a grid, and plans of quads swept upwards or around.
 *
 * Every mesh is positive, has blocks and ijk, and positions with all bits of a double in use. Charts of blocks are turned at random.
 */
#ifndef BW_TESTS_CORE_HEX_KIT_H
#define BW_TESTS_CORE_HEX_KIT_H

#include "kit/kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "exact/rotation.h"
#include "hex/skin.h"

/* A block under construction: (i, j, k) of a grid point -> a key that blocks share where they touch, and where it is. */
typedef struct {
    int32_t n[3];
    void (*point)(const void *user, int block, const int32_t at[3], int64_t key[4], double position[3]);
    const void *user;
} hex_kit_block;

typedef struct {
    int64_t key[4];
    double position[3];
    int32_t vertex;
    size_t slot; /* 8 * hex + corner */
} hex_kit_corner;

static inline int hex_kit_by_key(const void *a, const void *b) {
    const hex_kit_corner *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->key[i] != y->key[i]) return x->key[i] < y->key[i] ? -1 : 1;
    return (x->slot > y->slot) - (x->slot < y->slot);
}

/* One hex of a block, its chart turned by r. */
static inline void hex_kit_add(bw_hex_mesh *mesh, hex_kit_corner *corner, size_t h, const hex_kit_block *block, int b, const int32_t at[3],
                               bw_rotation r) {
    for (int i = 0; i < 3; i++) {
        int axis = bw_rotation_axis[r][i];
        mesh->ijk[h][i] = bw_rotation_sign[r][i] > 0 ? at[axis] : block->n[axis] - 1 - at[axis];
    }
    mesh->block[h] = b;
    for (int c = 0; c < 8; c++) {
        int32_t p[3];
        for (int i = 0; i < 3; i++) {
            int axis = bw_rotation_axis[r][i], bit = c >> i & 1;
            p[axis] = at[axis] + (bw_rotation_sign[r][i] > 0 ? bit : !bit);
        }
        hex_kit_corner *to = &corner[8 * h + (size_t)c];
        to->slot = 8 * h + (size_t)c;
        block->point(block->user, b, p, to->key, to->position);
    }
}

static inline void hex_kit_weld(bw_hex_mesh *mesh, hex_kit_corner *corner, kit_random *random, double jitter) {
    size_t n = 8 * mesh->hex_count;
    qsort(corner, n, sizeof *corner, hex_kit_by_key);
    for (size_t i = 0; i < n; i++) {
        bool fresh = !i || memcmp(corner[i].key, corner[i - 1].key, sizeof corner->key);
        if (fresh) {
            double *p = mesh->position[mesh->vertex_count++];
            for (int k = 0; k < 3; k++) p[k] = corner[i].position[k] + kit_random_range(random, -jitter, jitter);
        }
        mesh->hex[corner[i].slot / 8][corner[i].slot % 8] = (bw_hvertex)mesh->vertex_count - 1;
    }
}

static inline void hex_kit_hold(bw_context *ctx, bw_hex_mesh *mesh) {
    bw_hex_skin skin;
    kit_expect_ok(ctx, bw_hex_skin_init(ctx, mesh, &skin));
    uint8_t *edges = calloc(mesh->vertex_count, 1);
    memset(mesh->held, BW_HELD_NOT, mesh->vertex_count);
    for (size_t q = 0; q < skin.quad_count; q++)
        for (int i = 0; i < 4; i++) mesh->held[bw_hex_quad_vertex(mesh, &skin.quad[q], i)] = BW_HELD_SURFACE;
    for (size_t e = 0; e < skin.edge_count; e++)
        for (int i = 0; i < 2 && skin.edge[e].boundary; i++) {
            edges[skin.edge[e].vertex[i]]++;
            mesh->held[skin.edge[e].vertex[i]] = BW_HELD_CURVE;
        }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        if (edges[v] && edges[v] != 2) mesh->held[v] = BW_HELD_POINT;
    free(edges);
    bw_hex_skin_clear(ctx, &skin);
}

static inline void hex_kit_room(bw_context *ctx, bw_hex_mesh *mesh, size_t hexes, size_t vertices) {
    *mesh = (bw_hex_mesh){.hex_count = hexes, .subdivide = 1};
    mesh->position = bw_alloc(ctx, vertices, sizeof *mesh->position);
    mesh->held = bw_alloc(ctx, vertices, 1);
    mesh->carrier = bw_alloc(ctx, vertices, sizeof *mesh->carrier);
    mesh->hex = bw_alloc(ctx, hexes, sizeof *mesh->hex);
    mesh->block = bw_alloc(ctx, hexes, sizeof *mesh->block);
    mesh->ijk = bw_alloc(ctx, hexes, sizeof *mesh->ijk);
    assert_true(mesh->position && mesh->held && mesh->carrier && mesh->hex && mesh->block && mesh->ijk);
}

/* Glues blocks. random: turns their charts; jitter: vertices leave their place by up to that. Free with bw_hex_mesh_clear. */
static inline void hex_kit_make(bw_context *ctx, const hex_kit_block *block, int count, kit_random random, double jitter, bw_hex_mesh *mesh) {
    size_t hexes = 0, h = 0;
    for (int b = 0; b < count; b++) hexes += (size_t)block[b].n[0] * (size_t)block[b].n[1] * (size_t)block[b].n[2];
    hex_kit_room(ctx, mesh, hexes, 8 * hexes);
    hex_kit_corner *corner = calloc(8 * hexes, sizeof *corner);
    for (int b = 0; b < count; b++) {
        bw_rotation r = (bw_rotation)kit_random_below(&random, BW_ROTATIONS);
        int32_t at[3];
        for (at[2] = 0; at[2] < block[b].n[2]; at[2]++)
            for (at[1] = 0; at[1] < block[b].n[1]; at[1]++)
                for (at[0] = 0; at[0] < block[b].n[0]; at[0]++) hex_kit_add(mesh, corner, h++, &block[b], b, at, r);
    }
    hex_kit_weld(mesh, corner, &random, jitter);
    free(corner);
    hex_kit_hold(ctx, mesh);
}

/* ---- boxes of the integer grid ------------------------------------------------------------------------------------- */

typedef struct {
    int32_t low[3], high[3];
} hex_kit_box;

static inline void hex_kit_box_point(const void *user, int block, const int32_t at[3], int64_t key[4], double position[3]) {
    const hex_kit_box *box = (const hex_kit_box *)user + block;
    key[3] = 0;
    for (int k = 0; k < 3; k++) key[2 - k] = box->low[k] + at[k], position[k] = 0.7 * (box->low[k] + at[k]) - 1.0 / 3;
}

static inline void hex_kit_boxes(bw_context *ctx, const hex_kit_box *box, int count, uint64_t stream, bw_hex_mesh *mesh) {
    hex_kit_block *block = calloc((size_t)count, sizeof *block);
    for (int b = 0; b < count; b++) {
        block[b] = (hex_kit_block){.point = hex_kit_box_point, .user = box};
        for (int k = 0; k < 3; k++) block[b].n[k] = box[b].high[k] - box[b].low[k];
    }
    hex_kit_make(ctx, block, count, kit_random_start(stream), 0.1, mesh);
    free(block);
}

/* One block of n^3 hexes without any search: for large ones. */
static inline void hex_kit_cube(bw_context *ctx, int32_t n, bw_hex_mesh *mesh) {
    size_t m = (size_t)n + 1;
    hex_kit_room(ctx, mesh, (size_t)n * (size_t)n * (size_t)n, m * m * m);
    mesh->vertex_count = m * m * m;
    for (size_t v = 0; v < m * m * m; v++) {
        double at[3] = {(double)(v % m), (double)(v / m % m), (double)(v / m / m)};
        bool outside = false;
        for (int k = 0; k < 3; k++) {
            mesh->position[v][k] = (at[k] + 0.1 * sin(at[(k + 1) % 3])) / n;
            outside |= at[k] == 0 || at[k] == n;
        }
        mesh->held[v] = outside ? BW_HELD_SURFACE : BW_HELD_NOT;
    }
    for (size_t h = 0; h < mesh->hex_count; h++) {
        size_t s = (size_t)n, at[3] = {h % s, h / s % s, h / s / s};
        for (size_t c = 0; c < 8; c++)
            mesh->hex[h][c] = (bw_hvertex)(at[0] + (c & 1) + m * (at[1] + (c >> 1 & 1) + m * (at[2] + (c >> 2 & 1))));
        for (int k = 0; k < 3; k++) mesh->ijk[h][k] = (int32_t)at[k];
    }
}

/* ---- plans of quads, swept ----------------------------------------------------------------------------------------- */

typedef struct {
    int quads;
    const double (*at)[2];
    const int (*quad)[4]; /* counter-clockwise */
    int32_t n, layers;    /* edges of quads in hexes; hexes upwards or around */
    bool around;          /* swept around the second axis, once */
} hex_kit_plan;

static inline void hex_kit_plan_point(const void *user, int block, const int32_t at[3], int64_t key[4], double position[3]) {
    const hex_kit_plan *plan = user;
    const int *quad = plan->quad[block], n = plan->n;
    int i = at[0], j = at[1];
    double s = (double)i / n, t = (double)j / n, p[2];
    for (int k = 0; k < 2; k++)
        p[k] = (1 - s) * (1 - t) * plan->at[quad[0]][k] + s * (1 - t) * plan->at[quad[1]][k] + s * t * plan->at[quad[2]][k] +
               (1 - s) * t * plan->at[quad[3]][k];
    int32_t layer = plan->around ? at[2] % plan->layers : at[2];
    int a = -1, b = -1, k = 0; /* on the edge from a to b, k steps from a */
    if (j == 0) a = quad[0], b = quad[1], k = i;
    else if (j == n) a = quad[3], b = quad[2], k = i;
    else if (i == 0) a = quad[0], b = quad[3], k = j;
    else if (i == n) a = quad[1], b = quad[2], k = j;
    if (a < 0) key[0] = 1000 + block, key[1] = i, key[2] = j;
    else if (k == 0 || k == n) key[0] = k ? b : a, key[1] = 0, key[2] = 0;
    else key[0] = a < b ? a : b, key[1] = a < b ? b : a, key[2] = a < b ? k : n - k;
    key[3] = layer;
    double turn = 2 * 3.14159265358979323846 * layer / plan->layers;
    position[0] = plan->around ? (4 + p[0]) * cos(turn) : p[0];
    position[1] = p[1];
    position[2] = plan->around ? (4 + p[0]) * sin(turn) : (double)layer / plan->layers;
}

static inline void hex_kit_sweep(bw_context *ctx, const hex_kit_plan *plan, uint64_t stream, bw_hex_mesh *mesh) {
    hex_kit_block *block = calloc((size_t)plan->quads, sizeof *block);
    for (int b = 0; b < plan->quads; b++)
        block[b] = (hex_kit_block){.n = {plan->n, plan->n, plan->layers}, .point = hex_kit_plan_point, .user = plan};
    hex_kit_make(ctx, block, plan->quads, kit_random_start(stream), 1e-3, mesh);
    free(block);
}

/* A square inside a square: four edges of valence 3. */
static const double hex_kit_o_at[8][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-.4, -.4}, {.4, -.4}, {.4, .4}, {-.4, .4}};
static const int hex_kit_o_quad[5][4] = {{4, 5, 6, 7}, {0, 1, 5, 4}, {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};
/* Five quads around a point. */
static const double hex_kit_five_at[11][2] = {{0, 0},          {1, 0},         {.9, .7},      {.31, .95},     {-.4, 1},     {-.81, .59},
                                              {-1.1, 0},       {-.81, -.59},   {-.4, -1},     {.31, -.95},    {.9, -.7}};
static const int hex_kit_five_quad[5][4] = {{0, 1, 2, 3}, {0, 3, 4, 5}, {0, 5, 6, 7}, {0, 7, 8, 9}, {0, 9, 10, 1}};

enum { HEX_KIT_GRID, HEX_KIT_O_GRID, HEX_KIT_FIVE, HEX_KIT_TORUS, HEX_KIT_TEE, HEX_KIT_RING, HEX_KIT_COUNT };

static const char *const hex_kit_names[HEX_KIT_COUNT] = {"grid", "o-grid", "five", "torus", "tee", "ring"};

/* grid: 2 x 2 x 1 blocks; o-grid, five: swept upwards; torus: the O-grid swept around, every block meets itself; tee: one block on top of two; ring: one
 * block, swept around a single quad. */
static inline void hex_kit_sample(bw_context *ctx, int which, bw_hex_mesh *mesh) {
    static const hex_kit_box grid[] = {{{0, 0, 0}, {2, 3, 4}}, {{2, 0, 0}, {5, 3, 4}}, {{0, 3, 0}, {2, 4, 4}}, {{2, 3, 0}, {5, 4, 4}}};
    static const hex_kit_box tee[] = {{{0, 0, 0}, {2, 3, 2}}, {{2, 0, 0}, {5, 3, 2}}, {{0, 0, 2}, {5, 3, 4}}};
    hex_kit_plan o = {5, hex_kit_o_at, hex_kit_o_quad, 3, 4, false}, five = {5, hex_kit_five_at, hex_kit_five_quad, 2, 3, false};
    hex_kit_plan torus = {5, hex_kit_o_at, hex_kit_o_quad, 2, 12, true}, ring = {1, hex_kit_o_at, hex_kit_o_quad, 3, 16, true};
    if (which == HEX_KIT_GRID) hex_kit_boxes(ctx, grid, 4, 1, mesh);
    else if (which == HEX_KIT_O_GRID) hex_kit_sweep(ctx, &o, 2, mesh);
    else if (which == HEX_KIT_FIVE) hex_kit_sweep(ctx, &five, 3, mesh);
    else if (which == HEX_KIT_TORUS) hex_kit_sweep(ctx, &torus, 4, mesh);
    else if (which == HEX_KIT_TEE) hex_kit_boxes(ctx, tee, 3, 5, mesh);
    else hex_kit_sweep(ctx, &ring, 6, mesh);
}

#endif
