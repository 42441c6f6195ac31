/* Maps without any singularity: a box of cells whose opposite faces are identified.
 *
 * The box has cells[k] cells along axis k; 24 tets to a cell (its centre joined to its faces, which are split
 * from their centres into four), so that it conforms under every rotation. Points are lattice points in half
 * cells: x in [0, 2 cells[0]] and so on. Leaving the box at high x means entering it at low x, with (y, z)
 * turned by `quarters` quarter turns about the middle of the section and y moved by `slide` cells; leaving at
 * high y means entering at low y; z is the same if `closed`, else its two ends are the boundary. quarters 2
 * on a box that is not closed joins the two ends of z to one boundary component. slide other than 0 is for
 * quarters = 0 only: iso-surfaces of y then are spirals.
 */
#ifndef BW_TESTS_CORE_FLAT_KIT_H
#define BW_TESTS_CORE_FLAT_KIT_H

#include "kit/kit.h"

#include <math.h>
#include <string.h>

#include "models/models.h"

typedef struct {
    const char *name;
    int cells[3];
    int quarters, slide;
    bool closed;
} flat_shape;

/* Orientable flat manifolds, with boundary and without. */
static const flat_shape flat_shapes[] = {
    {"hollow torus, flat", {4, 3, 2}, 0, 0, false},   {"hollow torus, sliding", {4, 5, 2}, 0, 2, false},
    {"thick Klein bottle", {3, 4, 2}, 2, 0, false},   {"three-torus", {3, 4, 3}, 0, 0, true},
    {"three-torus, sliding", {3, 5, 3}, 0, 2, true},  {"half-turn manifold", {3, 4, 4}, 2, 0, true},
    {"quarter-turn manifold", {3, 4, 4}, 1, 0, true},
};
enum { FLAT_SHAPES = sizeof flat_shapes / sizeof *flat_shapes };

/* Lattice points in the box, and the rotation of (y, z) that led there: quarter turns. */
typedef struct {
    int at[3], turns;
} flat_place;

static inline void flat_turn(int turns, double *y, double *z) {
    for (; turns > 0; turns--) {
        double keep = *y;
        *y = -*z, *z = keep;
    }
}

static inline flat_place flat_locate(const flat_shape *s, const int point[3]) {
    flat_place p = {{point[0], point[1], point[2]}, 0};
    int n[3] = {2 * s->cells[0], 2 * s->cells[1], 2 * s->cells[2]};
    if (p.at[0] >= n[0]) {
        double y = p.at[1] - s->cells[1], z = p.at[2] - s->cells[2];
        flat_turn(p.turns = s->quarters, &y, &z);
        p.at[0] -= n[0];
        p.at[1] = (int)y + s->cells[1] + 2 * s->slide;
        p.at[2] = (int)z + s->cells[2];
    }
    p.at[1] = (p.at[1] + 2 * n[1]) % n[1];
    if (s->closed) p.at[2] = (p.at[2] + 2 * n[2]) % n[2];
    return p;
}

/* A displacement of each point of the box: a multiple of 2^-12 half cells, in its plane on the boundary. */
static inline void flat_noise(const flat_shape *s, const int at[3], double noise, uint64_t seed,
                              double d[3]) {
    kit_random random = {seed * 1000003u + (uint64_t)((at[0] * 1024 + at[1]) * 1024 + at[2])};
    for (int k = 0; k < 3; k++) d[k] = floor(kit_random_range(&random, -noise, noise) * 4096) / 4096;
    if (!s->closed && (at[2] == 0 || at[2] == 2 * s->cells[2])) d[2] = 0;
}

/* On a torus around the axis z, thick where the shape is; closed manifolds do not fit into space and overlap
 * there. */
static inline void flat_position(const flat_shape *s, const int at[3], double out[3]) {
    double a = 2 * 3.14159265358979 * at[0] / (2 * s->cells[0]),
           b = 2 * 3.14159265358979 * at[1] / (2 * s->cells[1]);
    double r = 1 + 0.5 * at[2] / s->cells[2];
    out[0] = (4 + r * cos(b)) * cos(a), out[1] = (4 + r * cos(b)) * sin(a), out[2] = r * sin(b);
}

typedef struct {
    const flat_shape *shape;
    bw_model *model;
    int32_t *number; /* of a lattice point; -1: not met yet */
    double noise, scale[3];
    uint64_t seed;
} flat_maker;

/* Corner `corner` of the newest tet is `point`, in the chart of the box continued beyond its ends. */
static inline void flat_corner(flat_maker *m, int corner, const int point[3]) {
    flat_place p = flat_locate(m->shape, point);
    int32_t *number = &m->number[(p.at[0] * 64 + p.at[1]) * 64 + p.at[2]];
    if (*number < 0) {
        flat_position(m->shape, p.at, m->model->position[m->model->vertex_count]);
        *number = (int32_t)m->model->vertex_count++;
    }
    double d[3], *parameter = m->model->parameter[m->model->tet_count][corner];
    flat_noise(m->shape, p.at, m->noise, m->seed, d);
    flat_turn(4 - p.turns, &d[1], &d[2]);
    for (int k = 0; k < 3; k++) parameter[k] = (point[k] + d[k]) * m->scale[k];
    m->model->tet[m->model->tet_count][corner] = *number;
}

static inline void flat_cell(flat_maker *m, const int low[3]) {
    static const int round[5][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
    int centre[3] = {low[0] + 1, low[1] + 1, low[2] + 1};
    for (int side = 0; side < 6; side++)
        for (int i = 0; i < 4; i++) {
            int axis = side / 2, u = (axis + 1) % 3, v = (axis + 2) % 3, high = side & 1, face[3],
                corner[2][3];
            memcpy(face, centre, sizeof face);
            face[axis] += high ? 1 : -1;
            for (int j = 0; j < 2; j++) {
                memcpy(corner[j], face, sizeof face);
                corner[j][u] += round[i + j][0], corner[j][v] += round[i + j][1];
            }
            flat_corner(m, 0, centre);
            flat_corner(m, 1, face);
            flat_corner(m, 2, corner[!high]);
            flat_corner(m, 3, corner[high]);
            m->model->tet_count++;
        }
}

/* Parameters are multiples of 2^-20: the map is seamless exactly. *model is given to bw_model_clear. */
static inline bw_status flat_make(bw_context *ctx, const flat_shape *shape, double noise, uint64_t seed,
                                  bw_model *model) {
    memset(model, 0, sizeof *model);
    size_t cells = (size_t)(shape->cells[0] * shape->cells[1] * shape->cells[2]);
    flat_maker m = {
        shape, model, bw_alloc(ctx, 64 * 64 * 64, sizeof *m.number), noise, {0.375, 0.3125, 0.3125}, seed};
    model->position = bw_alloc(ctx, 64 * cells, sizeof *model->position);
    model->tet = bw_alloc(ctx, 24 * cells, sizeof *model->tet);
    model->parameter = bw_alloc(ctx, 24 * cells, sizeof *model->parameter);
    if (ctx->error.status == BW_OK) {
        memset(m.number, -1, 64 * 64 * 64 * sizeof *m.number);
        for (int x = 0; x < shape->cells[0]; x++)
            for (int y = 0; y < shape->cells[1]; y++)
                for (int z = 0; z < shape->cells[2]; z++) flat_cell(&m, (int[3]){2 * x, 2 * y, 2 * z});
    }
    bw_free(ctx, m.number);
    return ctx->error.status;
}

#endif
