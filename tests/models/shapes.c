/* The shapes: which blocks, where, and how many of them the base complex has.
 *
 * A shape is made of boxes of a lattice, or of prisms over plane quads with straight and circular edges,
 * possibly bent by a warp from this pseudo-space to space. The numbers in the table are counted by reasoning,
 * which is written at each shape; tests compare them with what is counted on the layout and on the tets.
 */
#include "models/shapes.h"

#include <math.h>
#include <string.h>

#include "models/build.h"

static const double pi = 3.14159265358979323846;

/* --- boxes of a lattice --- */

/* The box between the lattice planes i, j, k and their successors. */
static void box(bw_layout *l, const double *x, const double *y, const double *z, int i, int j, int k) {
    int64_t key[8];
    double point[8][3];
    for (int c = 0; c < 8; c++) {
        int a = i + (c & 1), b = j + (c >> 1 & 1), d = k + (c >> 2);
        key[c] = a + 64 * b + 4096 * d;
        point[c][0] = x[a], point[c][1] = y[b], point[c][2] = z[d];
    }
    bw_layout_block_add(l, key, (const double(*)[3])point, 0);
}

static void cuboid(bw_layout *l, int count) {
    static const double x[] = {0, 2.3}, y[] = {0, 1.4}, z[] = {0, 1};
    (void)count;
    box(l, x, y, z, 0, 0, 0);
    bw_declare(l, 1, 1, 0);
}

/* The reentrant edge sends two walls: three blocks. */
static void l_shape(bw_layout *l, int count) {
    static const double x[] = {0, 1.1, 2.7}, y[] = {0, 1.3, 2.4}, z[] = {0, 0.9};
    (void)count;
    box(l, x, y, z, 0, 0, 0);
    box(l, x, y, z, 1, 0, 0);
    box(l, x, y, z, 0, 1, 0);
    bw_declare(l, 3, 1, 0);
}

/* The twelve edges of the middle are reentrant and wall off all six arms. */
static void plus(bw_layout *l, int count) {
    static const double x[] = {0, 1.2, 2.2, 3.1}, y[] = {0, 0.9, 2.2, 3.4}, z[] = {0, 1, 1.9, 3};
    (void)count;
    box(l, x, y, z, 1, 1, 1);
    for (int side = 0; side <= 2; side += 2) {
        box(l, x, y, z, side, 1, 1);
        box(l, x, y, z, 1, side, 1);
        box(l, x, y, z, 1, 1, side);
    }
    bw_declare(l, 7, 1, 0);
}

/* --- round ones --- */

/* Sends the square or cube |p| <= 1 to the disk or ball of radius data[2]; the core |p| <= data[1] stays as
 * it is. */
static void warp_round(const double data[8], int tag, const double p[3], double out[3]) {
    int dimensions = (int)data[0];
    double core = data[1], most = 0, norm = 0, direction[3];
    (void)tag;
    memcpy(out, p, 3 * sizeof *out);
    for (int i = 0; i < dimensions; i++) most = fmax(most, fabs(p[i]));
    if (most <= core) return;
    for (int i = 0; i < dimensions; i++) {
        direction[i] = tan(p[i] / most * pi / 4);
        norm += direction[i] * direction[i];
    }
    double w = (most - core) / (1 - core);
    for (int i = 0; i < dimensions; i++)
        out[i] = (1 - w) * core * p[i] / most + w * data[2] * direction[i] / sqrt(norm);
}

/* Inner square and four blocks around it; the four edges of the inner square are singular (three blocks
 * around each), their walls are all the faces between the blocks. */
static void cylinder(bw_layout *l, int count) {
    static const double level[] = {0, 1.9}, core = 0.45;
    static const int u[] = {-1, 1, 1, -1}, v[] = {-1, -1, 1, 1};
    bw_spot inner[4], outer[4];
    (void)count;
    for (int i = 0; i < 4; i++) {
        inner[i] = (bw_spot){i, core * u[i], core * v[i]};
        outer[i] = (bw_spot){4 + i, u[i], v[i]};
    }
    l->warp = warp_round;
    memcpy(l->data, (double[8]){2, core, 1}, sizeof l->data);
    bw_prism(l, 2, inner, level, 0);
    bw_prism_ring(l, 2, outer, inner, level, 0);
    bw_declare(l, 5, 1, 4);
}

/* A cube and a block on each of its faces: its twelve edges and the eight diagonals from its corners are
 * inside; those with three blocks around, that is all twenty, are singular. */
static void ball(bw_layout *l, int count) {
    static const double core = 0.4;
    (void)count;
    l->warp = warp_round;
    memcpy(l->data, (double[8]){3, core, 1}, sizeof l->data);
    for (int block = 0; block < 7; block++) {
        int axis = block / 2, side = block & 1, first = (axis + (side ? 1 : 2)) % 3,
            second = (axis + (side ? 2 : 1)) % 3;
        int64_t key[8];
        double point[8][3];
        for (int c = 0; c < 8; c++) {
            int cube = block == 6 ? c : (c & 1) << first | (c >> 1 & 1) << second | side << axis;
            bool far = block < 6 && c >> 2;
            key[c] = cube + (far ? 8 : 0);
            for (int i = 0; i < 3; i++) point[c][i] = (cube >> i & 1 ? 1 : -1) * (far ? 1 : core);
        }
        bw_layout_block_add(l, key, (const double(*)[3])point, 0);
    }
    bw_declare(l, 7, 1, 20);
}

/* --- rings --- */

enum { SECTIONS = 6 };

/* (x, y) across, z along in sections; the section turns by data[1] quarter turns on the way round radius
 * data[0]. */
static void warp_ring(const double data[8], int tag, const double p[3], double out[3]) {
    double angle = p[2] * 2 * pi / SECTIONS, turn = angle * data[1] / 4;
    double x = p[0] * cos(turn) - p[1] * sin(turn), y = p[0] * sin(turn) + p[1] * cos(turn);
    (void)tag;
    out[0] = (data[0] + y) * cos(angle);
    out[1] = (data[0] + y) * sin(angle);
    out[2] = x;
}

/* Nothing but the boundary's edges is singular: no wall at all, one block, and still one when it has been
 * split. */
static void torus(bw_layout *l, int quarters, double height) {
    static const int u[] = {-1, 1, 1, -1}, v[] = {-1, -1, 1, 1};
    static const double level[] = {0, 1, 2, 3, 4, 5, 6};
    bw_spot quad[4];
    l->warp = warp_ring;
    memcpy(l->data, (double[8]){2.2, quarters}, sizeof l->data);
    for (int i = 0; i < 4; i++) quad[i] = (bw_spot){i, u[i] * height, v[i] * 0.7};
    for (int i = 0; i < 4; i++)
        bw_layout_alias(l, bw_spot_key(&quad[i], SECTIONS), bw_spot_key(&quad[(i + quarters) % 4], 0));
    for (int i = 0; i < SECTIONS; i++) bw_prism(l, 2, quad, level, i);
    bw_declare(l, 1, 0, 0);
}

static void torus_straight(bw_layout *l, int count) {
    (void)count;
    torus(l, 0, 0.9);
}

static void torus_quarter(bw_layout *l, int count) {
    (void)count;
    torus(l, 1, 0.7);
}

static void torus_half(bw_layout *l, int count) {
    (void)count;
    torus(l, 2, 0.9);
}

/* The four inner edges of the tube are reentrant and send two walls each, which cut its section into eight;
 * every block is a ring of its own. */
static void hollow_torus(bw_layout *l, int count) {
    static const double x[] = {-1.1, -0.5, 0.4, 1.1}, y[] = {-1, -0.4, 0.5, 1},
                        level[] = {0, 1, 2, 3, 4, 5, 6};
    (void)count;
    l->warp = warp_ring;
    memcpy(l->data, (double[8]){2.6}, sizeof l->data);
    for (int i = 0; i < 16; i++) {
        bw_spot s = {i, 0, 0};
        bw_layout_alias(l, bw_spot_key(&s, SECTIONS), bw_spot_key(&s, 0));
    }
    for (int cell = 0; cell < 9; cell++) {
        int a = cell % 3, b = cell / 3;
        if (cell == 4) continue;
        bw_spot quad[4] = {{a + 4 * b, x[a], y[b]},
                           {a + 1 + 4 * b, x[a + 1], y[b]},
                           {a + 1 + 4 * (b + 1), x[a + 1], y[b + 1]},
                           {a + 4 * (b + 1), x[a], y[b + 1]}};
        for (int i = 0; i < SECTIONS; i++) bw_prism(l, 2, quad, level, i);
    }
    bw_declare(l, 8, 0, 0);
}

/* --- the list --- */

static const struct {
    bw_model_info info;
    void (*make)(bw_layout *layout, int count);
} table[] = {
    {{"cuboid", "a box", 1, 1, 0}, cuboid},
    {{"l-shape", "three boxes around a reentrant edge", 3, 1, 0}, l_shape},
    {{"plus", "a box with an arm on each face", 7, 1, 0}, plus},
    {{"cylinder", "an O-grid: square core and four blocks around it", 5, 1, 4}, cylinder},
    {{"ball", "a cube and a block on each of its faces", 7, 1, 20}, ball},
    {{"torus", "a ring of square section", 1, 0, 0}, torus_straight},
    {{"torus-quarter", "a ring whose section makes a quarter turn on the way round", 1, 0, 0}, torus_quarter},
    {{"torus-half", "a ring whose section makes a half turn on the way round", 1, 0, 0}, torus_half},
    {{"hollow-torus", "a ring of square tube", 8, 0, 0}, hollow_torus},
    {{"tee", "a round pipe with a branch", 9, -1, 4}, bw_shape_tee},
    {{"plate", "a plate with drilled holes", 21, -1, 8}, bw_shape_plate},
    {{"bearing", "a base with two eared bolt holes and an eye with a boss", 24, -2, 0}, bw_shape_bearing},
    {{"part", "a bracket: flange with two bolt holes, eye with a boss", 36, -2, 8}, bw_shape_part},
};
enum { SHAPES = sizeof table / sizeof *table };

const bw_model_info *bw_model_list(size_t *count) {
    static bw_model_info info[SHAPES];
    for (size_t i = 0; i < SHAPES; i++) info[i] = table[i].info;
    *count = SHAPES;
    return info;
}

bw_status bw_shape_make(const char *name, int count, bw_layout *l) {
    for (size_t i = 0; i < SHAPES; i++) {
        if (strcmp(table[i].info.name, name)) continue;
        table[i].make(l, count);
        return l->ctx->error.status;
    }
    return bw_fail(l->ctx, BW_E_USAGE, "there is no sample model named \"%.40s\"", name);
}
