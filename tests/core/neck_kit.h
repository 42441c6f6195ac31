/* A ring with a neck that only one singular curve is at, on each side: collapsing it brings no two critical curves together.
 *
 * A plane figure of five rectangles, extruded along z. T is the neck, a tube: its left and right ends are one. R lies at its end, with a square C in the corner
 * between R's right side and its left one: so five corners meet in s, two of T, two of R and one of C. The same at the other end, s'.
 *
 *        +-----+--------+
 *        |     |        |        C2's left side is R2's right side, C2's lower side (from s on) is R2's left side (from s on).
 *        | R2  |   C2   |
 *        |     |        |
 *        s-----s--------+
 *        |  T  |
 *        s'----s'-------+
 *        |     |        |
 *        | R1  |   C1   |        C1's left side is R1's right side, C1's upper side (from s' on) is R1's left side (from s' on).
 *        |     |        |
 *        +-----+--------+
 *
 * Where the neck has no width, what is left of T is a sheet that joins the two others.
 */
#ifndef BW_TESTS_CORE_NECK_KIT_H
#define BW_TESTS_CORE_NECK_KIT_H

#include "core/validity_kit.h"

enum { NECK_T, NECK_R2, NECK_C2, NECK_R1, NECK_C1, NECK_PARTS };
enum { NECK_WIDTH = 4, NECK_LENGTH = 2, NECK_SIDE = 3, NECK_HEIGHT = 2 }; /* in cells: of T, of T, of C, along z */

/* Lattice points in half cells; every part has its own chart and 2^12 numbers for its points. */
typedef struct {
    bw_model *model;
    int32_t *same;   /* [point] union-find */
    int32_t *number; /* [root]; -1: not met yet */
} neck_maker;

static inline void neck_size(int part, int size[3]) {
    size[0] = part == NECK_C1 || part == NECK_C2 ? NECK_SIDE : NECK_WIDTH;
    size[1] = part == NECK_T ? NECK_LENGTH : NECK_SIDE;
    size[2] = NECK_HEIGHT;
}

static inline int32_t neck_point(int part, int x, int y, int z) { return ((part * 16 + x) * 16 + y) * 16 + z; }

static inline int32_t neck_root(const neck_maker *m, int32_t p) {
    while (m->same[p] != p) p = m->same[p];
    return p;
}

static inline void neck_glue(neck_maker *m, int part, int x, int y, int other, int u, int v) {
    for (int z = 0; z <= 2 * NECK_HEIGHT; z++) {
        int32_t a = neck_root(m, neck_point(part, x, y, z)), b = neck_root(m, neck_point(other, u, v, z));
        m->same[a > b ? a : b] = a > b ? b : a;
    }
}

static inline void neck_glue_all(neck_maker *m) {
    const int width = 2 * NECK_WIDTH, length = 2 * NECK_LENGTH, side = 2 * NECK_SIDE;
    for (int y = 0; y <= length; y++) neck_glue(m, NECK_T, 0, y, NECK_T, width, y);
    for (int x = 0; x <= width; x++) neck_glue(m, NECK_T, x, length, NECK_R2, x, 0), neck_glue(m, NECK_T, x, 0, NECK_R1, x, side);
    for (int i = 0; i <= side; i++) {
        neck_glue(m, NECK_C2, 0, i, NECK_R2, width, i), neck_glue(m, NECK_C2, i, 0, NECK_R2, 0, i);
        neck_glue(m, NECK_C1, 0, i, NECK_R1, width, i), neck_glue(m, NECK_C1, i, side, NECK_R1, 0, side - i);
    }
}

static inline void neck_corner(neck_maker *m, int part, int corner, const int at[3]) {
    bw_model *o = m->model;
    int32_t root = neck_root(m, neck_point(part, at[0], at[1], at[2]));
    if (m->number[root] < 0) {
        double *position = o->position[o->vertex_count];
        for (int k = 0; k < 3; k++) position[k] = at[k] + (k == 0 ? 20.0 * part : 0); /* parts overlap in space; nobody looks at that */
        m->number[root] = (int32_t)o->vertex_count++;
    }
    for (int k = 0; k < 3; k++) o->parameter[o->tet_count][corner][k] = 0.375 * at[k];
    o->tet[o->tet_count][corner] = m->number[root];
}

/* 24 tets: the centre joined to the faces, which are split from their centres. */
static inline void neck_cell(neck_maker *m, int part, const int centre[3]) {
    static const int round[5][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
    for (int i = 0; i < 24; i++) {
        int axis = i / 8, high = i / 4 % 2, face[3], corner[2][3];
        memcpy(face, centre, sizeof face);
        face[axis] += high ? 1 : -1;
        for (int j = 0; j < 2; j++) {
            memcpy(corner[j], face, sizeof face);
            corner[j][(axis + 1) % 3] += round[i % 4 + j][0], corner[j][(axis + 2) % 3] += round[i % 4 + j][1];
        }
        neck_corner(m, part, 0, centre);
        neck_corner(m, part, 1, face);
        neck_corner(m, part, 2, corner[!high]);
        neck_corner(m, part, 3, corner[high]);
        m->model->tet_count++;
    }
}

static inline void neck_make(bw_context *ctx, bw_model *model) {
    enum { POINTS = 16 * 16 * 16 * NECK_PARTS };
    memset(model, 0, sizeof *model);
    neck_maker m = {model, bw_alloc(ctx, POINTS, sizeof *m.same), bw_alloc(ctx, POINTS, sizeof *m.number)};
    model->position = bw_alloc(ctx, POINTS, sizeof *model->position);
    model->tet = bw_alloc(ctx, 24 * POINTS / 8, sizeof *model->tet);
    model->parameter = bw_alloc(ctx, 24 * POINTS / 8, sizeof *model->parameter);
    assert_int_equal(ctx->error.status, BW_OK);
    for (int32_t p = 0; p < POINTS; p++) m.same[p] = p, m.number[p] = -1;
    neck_glue_all(&m);
    for (int part = 0; part < NECK_PARTS; part++) {
        int size[3], at[3];
        neck_size(part, size);
        for (at[0] = 1; at[0] < 2 * size[0]; at[0] += 2)
            for (at[1] = 1; at[1] < 2 * size[1]; at[1] += 2)
                for (at[2] = 1; at[2] < 2 * size[2]; at[2] += 2) neck_cell(&m, part, at);
    }
    bw_free(ctx, m.same), bw_free(ctx, m.number);
}

static inline void quantizable_open_neck(quantizable *q) {
    bw_model model;
    memset(q, 0, sizeof *q);
    bw_context_init(&q->ctx);
    snprintf(q->name, sizeof q->name, "neck");
    neck_make(&q->ctx, &model);
    quantizable_take(q, &model);
    quantizable_build(q, BW_COMPLEX_MC, BW_REDUCE_NONE);
}

#endif
