#include "hex/corner_energy.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { CORNERS = 8 };

/* Of all corners; [axis][coordinate][corner] of the Jacobians' columns, which become the gradient with respect to them. */
typedef struct {
    double j[3][3][CORNERS], chi[CORNERS], root[CORNERS], value[CORNERS];
} corners;

static const double least_chi = 1e-250; /* nothing overflows above it */

/* Edge e of axis k goes from corner low[k][e] to the one with bit k set; it is a column of the Jacobian at both its ends. */
static const uint8_t low[3][4] = {{0, 2, 4, 6}, {0, 1, 4, 5}, {0, 1, 2, 3}};

static void fill(const double p[8][3], const double scale[3], corners *w) {
    for (int k = 0; k < 3; k++)
        for (int e = 0; e < 4; e++)
            for (int i = 0; i < 3; i++) {
                int a = low[k][e], b = a | 1 << k;
                w->j[k][i][a] = w->j[k][i][b] = (p[b][i] - p[a][i]) * scale[k];
            }
}

static void spread(const double scale[3], const corners *w, double slope[8][3]) {
    memset(slope, 0, 8 * sizeof *slope);
    for (int k = 0; k < 3; k++)
        for (int e = 0; e < 4; e++)
            for (int i = 0; i < 3; i++) {
                int a = low[k][e], b = a | 1 << k;
                double g = (w->j[k][i][a] + w->j[k][i][b]) * scale[k];
                slope[a][i] -= g, slope[b][i] += g;
            }
}

/* chi^(-1/3): a third of the exponent, and Newton's method. */
static inline void inverse_root(const double chi[CORNERS], double out[CORNERS]) {
    uint64_t bits[CORNERS];
    memcpy(bits, chi, sizeof bits);
    for (int c = 0; c < CORNERS; c++) bits[c] = (0x553ef0ffu - ((bits[c] >> 32) * 0xaaaaaaabu >> 33)) << 32;
    memcpy(out, bits, sizeof bits);
    for (int c = 0; c < CORNERS; c++) {
        double x = chi[c], r = out[c];
        for (int i = 0; i < 5; i++) r *= (4 - x * r * r * r) * (1.0 / 3);
        out[c] = r;
    }
}

static inline void measure(double epsilon, corners *w) {
    double square = epsilon * epsilon;
    for (int c = 0; c < CORNERS; c++) {
        double a0 = w->j[0][0][c], a1 = w->j[0][1][c], a2 = w->j[0][2][c], b0 = w->j[1][0][c], b1 = w->j[1][1][c], b2 = w->j[1][2][c];
        double c0 = w->j[2][0][c], c1 = w->j[2][1][c], c2 = w->j[2][2][c];
        double d = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0);
        double root = sqrt(square + d * d), sum = root + fabs(d), small = 0.5 * square / (sum > least_chi ? sum : least_chi);
        double chi = d >= 0 ? 0.5 * sum : small; /* (d + root) / 2, without cancellation */
        w->value[c] = chi > least_chi ? 0 : INFINITY;
        w->chi[c] = chi > least_chi ? chi : least_chi;
        w->root[c] = root > least_chi ? root : least_chi;
    }
}

double bw_corner_energy(const double corner[8][3], const double rest[3], double epsilon, double sharpness, double slope[8][3]) {
    corners w;
    double third[CORNERS], scale[3] = {1 / rest[0], 1 / rest[1], 1 / rest[2]}, sum = 0, sharp = sharpness / 64, on = sharpness > 0 ? 1 : 0;
    fill(corner, scale, &w);
    measure(epsilon, &w);
    inverse_root(w.chi, third);
    for (int c = 0; c < CORNERS; c++) {
        double a0 = w.j[0][0][c], a1 = w.j[0][1][c], a2 = w.j[0][2][c], b0 = w.j[1][0][c], b1 = w.j[1][1][c], b2 = w.j[1][2][c];
        double c0 = w.j[2][0][c], c1 = w.j[2][1][c], c2 = w.j[2][2][c];
        double x0 = b1 * c2 - b2 * c1, x1 = b2 * c0 - b0 * c2, x2 = b0 * c1 - b1 * c0; /* cofactors */
        double y0 = c1 * a2 - c2 * a1, y1 = c2 * a0 - c0 * a2, y2 = c0 * a1 - c1 * a0;
        double z0 = a1 * b2 - a2 * b1, z1 = a2 * b0 - a0 * b2, z2 = a0 * b1 - a1 * b0;
        double d = a0 * x0 + a1 * x1 + a2 * x2, la = a0 * a0 + a1 * a1 + a2 * a2, lb = b0 * b0 + b1 * b1 + b2 * b2, lc = c0 * c0 + c1 * c1 + c2 * c2;
        double norm = la + lb + lc, by_norm = third[c] * third[c], by_chi = by_norm * third[c], slope_d = 0.5 * (1 + d / w.root[c]);
        double second = (d * d + 1) * by_chi;
        double by_d = (-2.0 / 3.0 * norm * by_norm * slope_d + 2 * d - second * slope_d) * by_chi;
        double length = la * lb * lc, by_length = 1 / sqrt(length > least_chi ? length : least_chi), s = d * by_length;
        double t = 1 + sharp * (1 - s), t2 = t * t, t4 = t2 * t2, t8 = t4 * t4, t16 = t8 * t8, t32 = t16 * t16, t63 = t32 * t16 * t8 * t4 * t2 * t;
        double by_s = -sharpness * t63, over = by_s * s * by_length * by_length; /* by_s s / length^2 */
        double ga = 2 * by_norm - over * lb * lc, gb = 2 * by_norm - over * la * lc, gc = 2 * by_norm - over * la * lb;
        by_d += by_s * by_length;
        w.value[c] += norm * by_norm + second + on * t63 * t;
        w.j[0][0][c] = ga * a0 + by_d * x0, w.j[0][1][c] = ga * a1 + by_d * x1, w.j[0][2][c] = ga * a2 + by_d * x2;
        w.j[1][0][c] = gb * b0 + by_d * y0, w.j[1][1][c] = gb * b1 + by_d * y1, w.j[1][2][c] = gb * b2 + by_d * y2;
        w.j[2][0][c] = gc * c0 + by_d * z0, w.j[2][1][c] = gc * c1 + by_d * z1, w.j[2][2][c] = gc * c2 + by_d * z2;
    }
    for (int c = 0; c < CORNERS; c++) sum += w.value[c];
    spread(scale, &w, slope);
    return sum;
}
