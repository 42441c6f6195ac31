/* Plane figures extruded, and the machine parts made of them. */
#include <math.h>
#include <string.h>

#include "models/shapes.h"

static const double pi = 3.14159265358979323846;

int64_t bw_spot_key(const bw_spot *spot, int layer) {
    return 8 * spot->key + layer;
}

void bw_prism(bw_layout *l, int axis, const bw_spot quad[4], const double *level, int layer) {
    static const int around[4] = {0, 1, 3, 2};
    int64_t key[8];
    double point[8][3];
    for (int c = 0; c < 8; c++) {
        const bw_spot *s = &quad[around[c & 3]];
        key[c] = bw_spot_key(s, layer + (c >> 2));
        point[c][(axis + 1) % 3] = s->u;
        point[c][(axis + 2) % 3] = s->v;
        point[c][axis] = level[layer + (c >> 2)];
    }
    bw_layout_block_add(l, key, (const double(*)[3])point, 0);
}

void bw_prism_arc(bw_layout *l, int axis, const bw_spot *a, const bw_spot *b, const double *level, int layer,
                  double u, double v) {
    double centre[3];
    centre[axis] = level[layer];
    centre[(axis + 1) % 3] = u;
    centre[(axis + 2) % 3] = v;
    bw_layout_arc(l, bw_spot_key(a, layer), bw_spot_key(b, layer), centre, axis);
}

void bw_prism_ring(bw_layout *l, int axis, const bw_spot outer[4], const bw_spot inner[4],
                   const double *level, int layer) {
    for (int i = 0; i < 4; i++) {
        int next = (i + 1) % 4;
        bw_spot quad[4] = {outer[i], outer[next], inner[next], inner[i]};
        bw_prism(l, axis, quad, level, layer);
    }
}

void bw_circle(double u, double v, double radius, double start, int64_t key, bw_spot out[4]) {
    for (int i = 0; i < 4; i++)
        out[i] =
            (bw_spot){key + i, u + radius * cos(start + i * pi / 2), v + radius * sin(start + i * pi / 2)};
}

void bw_circle_arcs(bw_layout *l, int axis, const bw_spot spot[4], const double *level, int layer, double u,
                    double v) {
    for (int i = 0; i < 4; i++) bw_prism_arc(l, axis, &spot[i], &spot[(i + 1) % 4], level, layer, u, v);
}

/* --- plates --- */

static bw_spot lattice_spot(const double *x, const double *y, int i, int j) {
    return (bw_spot){i + 64 * j, x[i], y[j]};
}

static void lattice_quad(const double *x, const double *y, int i, int j, bw_spot quad[4]) {
    quad[0] = lattice_spot(x, y, i, j);
    quad[1] = lattice_spot(x, y, i + 1, j);
    quad[2] = lattice_spot(x, y, i + 1, j + 1);
    quad[3] = lattice_spot(x, y, i, j + 1);
}

/* A lattice cell of the plate with a round hole in its middle. */
static void drilled_cell(bw_layout *l, const double *x, const double *y, const double *level, int i, int j,
                         double radius) {
    bw_spot outer[4], inner[4];
    double u = (x[i] + x[i + 1]) / 2, v = (y[j] + y[j + 1]) / 2;
    lattice_quad(x, y, i, j, outer);
    bw_circle(u, v, radius, -3 * pi / 4, 8192 + 4 * (i + 64 * j), inner);
    bw_prism_ring(l, 2, outer, inner, level, 0);
    for (int layer = 0; layer < 2; layer++) bw_circle_arcs(l, 2, inner, level, layer, u, v);
}

/* A row of holes h = 0, 1, ... in cells (2h + 1, 1) of a lattice of 2n + 1 by 3. The corners of a drilled
 * cell are singular (five blocks around), so all lattice lines are walls: 3 (2n + 1) cells, of which n become
 * four blocks each. */
void bw_shape_plate(bw_layout *l, int count) {
    enum { MOST = 16 };
    static const double y[] = {0, 0.55, 1.75, 2.4}, level[] = {0, 0.5};
    double x[2 * MOST + 2] = {0, 0.6};
    int holes = count ? count : 2;
    for (int h = 0; h < holes; h++) {
        x[2 * h + 2] = x[2 * h + 1] + 1.2;
        x[2 * h + 3] = x[2 * h + 2] + 0.6;
    }
    for (int i = 0; i <= 2 * holes; i++)
        for (int j = 0; j < 3; j++) {
            bw_spot quad[4];
            lattice_quad(x, y, i, j, quad);
            if (i % 2 && j == 1)
                drilled_cell(l, x, y, level, i, j, 0.3);
            else
                bw_prism(l, 2, quad, level, 0);
        }
    bw_declare(l, 9 * holes + 3, 1 - holes, 4 * holes);
}

/* --- eyes --- */

/* A neck from the edge A-B to a round eye with concentric rings, extruded along axis. `heading` is the
 * direction from the edge to the eye in (u, v); A is to the right of it. Ring radii descend; the last is the
 * bore. */
typedef struct {
    int axis, layer, rings;
    double u, v, heading, radius[4];
    const double *level;
    bw_spot a, b;
    int64_t key;
} eye;

static void eye_circle(const eye *e, int ring, bw_spot out[4]) {
    bw_circle(e->u, e->v, e->radius[ring], e->heading + pi / 4, e->key + 4 * ring, out);
}

static void eye_ring(bw_layout *l, const eye *e, int ring, int layer) {
    bw_spot outer[4], inner[4];
    eye_circle(e, ring, outer);
    eye_circle(e, ring + 1, inner);
    bw_prism_ring(l, e->axis, outer, inner, e->level, layer);
    for (int side = 0; side < 2; side++) {
        bw_circle_arcs(l, e->axis, outer, e->level, layer + side, e->u, e->v);
        bw_circle_arcs(l, e->axis, inner, e->level, layer + side, e->u, e->v);
    }
}

static void add_eye(bw_layout *l, const eye *e) {
    bw_spot outer[4];
    eye_circle(e, 0, outer);
    bw_spot neck[4] = {e->a, outer[2], outer[1], e->b};
    bw_prism(l, e->axis, neck, e->level, e->layer);
    for (int ring = 0; ring < e->rings; ring++) eye_ring(l, e, ring, e->layer);
}

/* An eye standing on the cell (i, j) of a base plate whose top is at z; its bore runs along y, with a boss on
 * each side.
 *
 * Walls: the foot of the neck is reentrant and walled off, and so is the neck from the eye, whose two corners
 * there are reentrant: they send radial walls through the rings, which cut each ring in two. The boss's
 * circles wall off the inner ring and the bosses. Blocks: neck, outer ring 2, inner ring 2, bosses 2 + 2:
 * nine. */
static void standing_eye(bw_layout *l, const double *x, const double *y, double z, int i, int j) {
    const double level[] = {y[j] - 0.38, y[j], y[j + 1], y[j + 1] + 0.38};
    eye e = {.axis = 1,
             .layer = 1,
             .rings = 2,
             .u = z + 1.75,
             .v = (x[i] + x[i + 1]) / 2,
             .radius = {1.1, 0.8, 0.5},
             .level = level,
             .a = {1 << 20, z, x[i]},
             .b = {(1 << 20) + 1, z, x[i + 1]},
             .key = (1 << 20) + 2};
    for (int side = 0; side < 2; side++) {
        bw_spot a = lattice_spot(x, y, i, j + side), b = lattice_spot(x, y, i + 1, j + side);
        bw_layout_alias(l, bw_spot_key(&e.a, 1 + side), bw_spot_key(&a, 1));
        bw_layout_alias(l, bw_spot_key(&e.b, 1 + side), bw_spot_key(&b, 1));
    }
    add_eye(l, &e);
    eye_ring(l, &e, 1, 0);
    eye_ring(l, &e, 1, 2);
}

/* The flange is a plate of 7 by 3 cells with two drilled ones: as above, 19 + 8 blocks; lines 3 and 4 are
 * walls below the eye's foot. */
void bw_shape_part(bw_layout *l, int count) {
    static const double x[] = {0, 0.6, 1.8, 2.6, 4.6, 5.4, 6.6, 7.2}, y[] = {0, 0.8, 2, 2.8},
                        level[] = {0, 0.6};
    (void)count;
    for (int i = 0; i < 7; i++)
        for (int j = 0; j < 3; j++) {
            bw_spot quad[4];
            lattice_quad(x, y, i, j, quad);
            if ((i == 1 || i == 5) && j == 1)
                drilled_cell(l, x, y, level, i, j, 0.34);
            else
                bw_prism(l, 2, quad, level, 0);
        }
    standing_eye(l, x, y, level[1], 3, 1);
    bw_declare(l, 27 + 9, -2, 8);
}

/* A base of 3 by 3 cells, all lines of which are walls (below the eye, and on from the ears' corners); two
 * lying eyes of a neck and a ring cut in two: three blocks each; the standing eye of nine. */
void bw_shape_bearing(bw_layout *l, int count) {
    static const double x[] = {0, 0.9, 2.9, 3.8}, y[] = {0, 0.8, 2.1, 2.9}, level[] = {0, 0.6};
    (void)count;
    for (int cell = 0; cell < 9; cell++) {
        bw_spot quad[4];
        lattice_quad(x, y, cell % 3, cell / 3, quad);
        bw_prism(l, 2, quad, level, 0);
    }
    for (int side = 0; side < 2; side++) {
        eye e = {.axis = 2, .rings = 1, .radius = {0.85, 0.4}, .level = level, .key = 8192 + 64 * side};
        e.u = side ? x[3] + 1.05 : x[0] - 1.05;
        e.v = (y[1] + y[2]) / 2;
        e.heading = side ? 0 : pi;
        e.a = lattice_spot(x, y, side ? 3 : 0, side ? 1 : 2);
        e.b = lattice_spot(x, y, side ? 3 : 0, side ? 2 : 1);
        add_eye(l, &e);
    }
    standing_eye(l, x, y, level[1], 1, 1);
    bw_declare(l, 9 + 2 * 3 + 9, -2, 0);
}
