/* A round pipe along x with a branch along z, as a thickened quad layout of its surface.
 *
 * The main pipe is unrolled to (X, T): X in -3..3 along it, T in -4..4 around it (0 on top); the branch
 * leaves from the square |X|, |T| < 1, whose border is bent to the curve in which the two cylinders meet. The
 * branch is (P, Z): P in 0..8 around it, Z in 0..1 from that curve upwards. The third coordinate is the depth
 * in the pipe's wall, 0..1 from inside.
 *
 *        T
 *     +--+--+--+  7 = -1
 *     |  |  |  |
 *     +--+--+--+  5 = -3
 *     |  |  |  |
 *     +--+--+--+  3
 *     |  |  |  |
 *     +--+--+--+  1
 *     |  |()|  |
 *     +--+--+--+ -1
 *    -3 -1  1  3   X
 *
 * Around each corner of the square there are five quads, three of the main pipe and two of the branch: four
 * singular curves through the wall, and nothing else is singular inside. Walls: from each corner along +-X to
 * the pipe's end, around the pipe (the lines X = +-1 join the corners all the way round), along the curve
 * between main pipe and branch, and up the branch; the lines T = 3 and T = 5 carry none. Blocks: main pipe
 * 2 left (top, rest), 1 in the middle, 2 right; branch 4: nine.
 */
#include <math.h>
#include <string.h>

#include "models/shapes.h"

static const double pi = 3.14159265358979323846;

enum { MAIN, BRANCH };

/* data: radii of main pipe and branch inside, thickness, unit of X, height of the branch */
static void warp_tee(const double data[8], int tag, const double p[3], double out[3]) {
    double main = data[0] + data[2] * p[2], branch = data[1] + data[2] * p[2];
    if (tag == BRANCH) {
        double angle = p[0] * pi / 4, y = branch * sin(angle), foot = sqrt(main * main - y * y);
        out[0] = branch * cos(angle);
        out[1] = y;
        out[2] = foot + p[1] * (data[4] - foot);
        return;
    }
    double x = p[0], t = p[1] > 4 ? p[1] - 8 : p[1], most = fmax(fabs(x), fabs(t));
    double along = x * data[3], angle = t * pi / 4, fade = 1 - (most - 1) / 1.6;
    if (fade > 0) {
        double qx = x / most, qt = t / most, c = tan(qx * pi / 4), s = tan(qt * pi / 4), norm = hypot(c, s);
        along += fade * (branch * c / norm - qx * data[3]);
        angle += fade * (asin(branch * s / norm / main) - qt * pi / 4);
    }
    out[0] = along;
    out[1] = main * sin(angle);
    out[2] = main * cos(angle);
}

/* A block over a quad of the surface: corner nodes in the order (0,0) (1,0) (0,1) (1,1), and its rectangle.
 */
static void wall_block(bw_layout *l, const int64_t node[4], double u0, double u1, double v0, double v1,
                       int tag) {
    int64_t key[8];
    double point[8][3];
    for (int c = 0; c < 8; c++) {
        key[c] = 2 * node[c & 3] + (c >> 2);
        point[c][0] = c & 1 ? u1 : u0;
        point[c][1] = c & 2 ? v1 : v0;
        point[c][2] = c >> 2;
    }
    bw_layout_block_add(l, key, (const double(*)[3])point, tag);
}

static int64_t main_node(int i, int j) {
    return i + 4 * (j % 4);
}

void bw_shape_tee(bw_layout *l, int count) {
    static const double x[] = {-3, -1, 1, 3}, t[] = {-1, 1, 3, 5, 7};
    static const int64_t corner[4][2] = {{2, 1}, {1, 1}, {1, 0}, {2, 0}}; /* of the square, from P = 1 on */
    (void)count;
    l->warp = warp_tee;
    memcpy(l->data, (double[8]){0.95, 0.6, 0.4, 0.95, 2.6}, sizeof l->data);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 4; j++) {
            if (i == 1 && j == 0) continue;
            int64_t node[4] = {main_node(i, j), main_node(i + 1, j), main_node(i, j + 1),
                               main_node(i + 1, j + 1)};
            wall_block(l, node, x[i], x[i + 1], t[j], t[j + 1], MAIN);
        }
    for (int k = 0; k < 4; k++) {
        const int64_t *a = corner[k], *b = corner[(k + 1) % 4];
        int64_t node[4] = {main_node((int)a[0], (int)a[1]), main_node((int)b[0], (int)b[1]), 16 + k,
                           16 + (k + 1) % 4};
        wall_block(l, node, 2 * k + 1, 2 * k + 3, 0, 1, BRANCH);
    }
    bw_declare(l, 9, -1, 4);
}
