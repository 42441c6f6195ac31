#include "solve/distortion.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "solve/foldover.h"

static double dot(const double *a, const double *b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double *a, const double *b, double *out) {
    for (int k = 0; k < 3; k++) out[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

double bw_det3(const double m[3][3]) {
    return m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) + m[0][1] * (m[1][2] * m[2][0] - m[1][0] * m[2][2]) +
           m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
}

double bw_inverse3(const double m[3][3], double out[3][3]) {
    double c[3][3], copy[3][3];
    memcpy(copy, m, sizeof copy);
    double det = bw_cofactors(copy, c);
    for (int i = 0; i < 9 && det != 0; i++) out[i / 3][i % 3] = c[i % 3][i / 3] / det;
    return det;
}

/* ---- singular values ---- */

/* x' = c x - s y, y' = s x + c y */
static void turn(double *x, double *y, double c, double s) {
    for (int r = 0; r < 3; r++) {
        double p = x[r], q = y[r];
        x[r] = c * p - s * q;
        y[r] = s * p + c * q;
    }
}

/* Cosine and sine of the Jacobi rotation for a diagonal difference and the entry beside it. */
static void jacobi(double difference, double beside, double *c, double *s) {
    double z = difference / (2 * beside), t = (z >= 0 ? 1 : -1) / (fabs(z) + sqrt(1 + z * z));
    *c = 1 / sqrt(1 + t * t);
    *s = *c * t;
}

/* One-sided Jacobi: turns columns until they are orthogonal. */
static void orthogonalize(double a[3][3], double v[3][3]) {
    enum { SWEEPS = 16 };
    for (int sweep = 0, changed = 1; sweep < SWEEPS && changed; sweep++) {
        changed = 0;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                double x = dot(a[p], a[p]), y = dot(a[q], a[q]), z = dot(a[p], a[q]), c, s;
                if (z == 0 || fabs(z) <= 2 * DBL_EPSILON * sqrt(x * y)) continue;
                jacobi(y - x, z, &c, &s);
                turn(a[p], a[q], c, s), turn(v[p], v[q], c, s);
                changed = 1;
            }
    }
}

/* b, normalized; any direction across a if there is none. */
static void direction_across(const double *a, const double *b, double *out) {
    double part = dot(a, b), norm, e[3] = {fabs(a[0]) < 0.6, fabs(a[0]) >= 0.6, 0};
    for (int k = 0; k < 3; k++) out[k] = b[k] - part * a[k];
    norm = sqrt(dot(out, out));
    if (!(norm > DBL_MIN)) {
        cross(a, e, out);
        norm = sqrt(dot(out, out));
    }
    for (int k = 0; k < 3; k++) out[k] /= norm;
}

void bw_svd3(const double matrix[3][3], double u[3][3], double s[3], double v[3][3]) {
    double a[3][3];
    for (int i = 0; i < 9; i++) a[i % 3][i / 3] = matrix[i / 3][i % 3], v[i / 3][i % 3] = i % 4 == 0;
    orthogonalize(a, v);
    for (int pass = 0; pass < 3; pass++)
        for (int c = 0; c < 2; c++)
            if (dot(a[c], a[c]) < dot(a[c + 1], a[c + 1])) turn(a[c], a[c + 1], 0, 1), turn(v[c], v[c + 1], 0, 1);
    double norm = sqrt(dot(a[0], a[0]));
    for (int k = 0; k < 3; k++) u[0][k] = norm > 0 ? a[0][k] / norm : k == 0;
    direction_across(u[0], a[1], u[1]);
    cross(u[0], u[1], u[2]);
    for (int c = 0; c < 3; c++) s[c] = dot(u[c], a[c]);
}

/* Eigenvalues l[c] and eigenvectors e[c] of a symmetric matrix, which is destroyed. */
static void eigen3(double m[3][3], double l[3], double e[3][3]) {
    enum { SWEEPS = 20 };
    for (int i = 0; i < 9; i++) e[i / 3][i % 3] = i % 4 == 0;
    for (int sweep = 0; sweep < SWEEPS; sweep++) {
        double beside = m[0][1] * m[0][1] + m[0][2] * m[0][2] + m[1][2] * m[1][2];
        if (beside <= 1e-30 * (m[0][0] * m[0][0] + m[1][1] * m[1][1] + m[2][2] * m[2][2])) break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                double c, s;
                if (m[p][q] == 0) continue;
                jacobi(m[q][q] - m[p][p], m[p][q], &c, &s);
                for (int k = 0; k < 3; k++) {
                    double x = m[k][p], y = m[k][q];
                    m[k][p] = c * x - s * y, m[k][q] = s * x + c * y;
                }
                turn(m[p], m[q], c, s), turn(e[p], e[q], c, s);
            }
    }
    for (int i = 0; i < 3; i++) l[i] = m[i][i];
}

/* ---- the energy ---- */

/* chi with two derivatives; without cancellation where d is negative. */
static void regularized(double d, double epsilon, double chi[3]) {
    double root = sqrt(epsilon * epsilon + d * d);
    chi[0] = d >= 0 ? 0.5 * (d + root) : 0.5 * epsilon * epsilon / (root - d);
    chi[1] = root > 0 ? chi[0] / root : 1;
    chi[2] = root > 0 ? epsilon * epsilon / (2 * root * root * root) : 0;
}

double bw_distortion(const double jacobian[3][3], double epsilon) {
    double copy[3][3];
    memcpy(copy, jacobian, sizeof copy);
    return bw_foldover(copy, epsilon, 1);
}

/* f = a g(D) + h(D): what its derivatives by the singular values need. */
typedef struct {
    double value;
    double g, g1; /* g and its derivative */
    double by_d;      /* a g' + h' */
    double by_dd;     /* a g'' + h'' */
} terms;

static terms terms_of(const double s[3], double epsilon) {
    double a = dot(s, s), d = s[0] * s[1] * s[2], chi[3];
    regularized(d, epsilon, chi);
    double third = cbrt(chi[0]), x = chi[0], g = 1 / (third * third), h = (d * d + 1) / x;
    double g1 = -2.0 / 3 * g / x * chi[1], g2 = 10.0 / 9 * g / (x * x) * chi[1] * chi[1] - 2.0 / 3 * g / x * chi[2];
    double h1 = 2 * d / x - h * chi[1] / x, h2 = 2 / x - 4 * d * chi[1] / (x * x) + h / x * (2 * chi[1] * chi[1] / x - chi[2]);
    return (terms){.value = a * g + h, .g = g, .g1 = g1, .by_d = a * g1 + h1, .by_dd = a * g2 + h2};
}

/* Adds eigenvalue * (mode as a vector of the corners) squared. */
static void add_mode(double eigenvalue, const double mode[3][3], const double slope[4][3], double hessian[12][12]) {
    double v[12];
    if (!(eigenvalue > 0)) return;
    for (int i = 0; i < 12; i++) v[i] = dot(mode[i % 3], slope[i / 3]);
    for (int i = 0; i < 12; i++)
        for (int k = 0; k <= i; k++) hessian[i][k] += eigenvalue * v[i] * v[k];
}

/* The three modes that change singular values only. */
static void add_scalings(const terms *f, const double s[3], const double by[3], double u[3][3], double v[3][3], const double slope[4][3],
                         double hessian[12][12]) {
    double m[3][3], l[3], e[3][3];
    for (int p = 0; p < 3; p++)
        for (int q = 0; q < 3; q++)
            m[p][q] = (p == q ? 2 * f->g : f->by_d * s[3 - p - q]) + 2 * f->g1 * (s[p] * by[q] + s[q] * by[p]) + f->by_dd * by[p] * by[q];
    eigen3(m, l, e);
    for (int n = 0; n < 3; n++) {
        double mode[3][3] = {{0}};
        for (int c = 0; c < 3; c++)
            for (int i = 0; i < 9; i++) mode[i / 3][i % 3] += e[n][c] * u[c][i / 3] * v[c][i % 3];
        add_mode(l[n], (const double(*)[3])mode, slope, hessian);
    }
}

/* The six modes in the planes of two singular vectors. */
static void add_turns(const terms *f, const double s[3], double u[3][3], double v[3][3], const double slope[4][3], double hessian[12][12]) {
    for (int k = 0; k < 3; k++)
        for (int sign = -1; sign <= 1; sign += 2) {
            int p = (k + 1) % 3, q = (k + 2) % 3;
            double mode[3][3];
            for (int i = 0; i < 9; i++) mode[i / 3][i % 3] = M_SQRT1_2 * (u[p][i / 3] * v[q][i % 3] + sign * u[q][i / 3] * v[p][i % 3]);
            add_mode(2 * f->g - sign * f->by_d * s[k], (const double(*)[3])mode, slope, hessian);
        }
}

double bw_distortion_expand(const double jacobian[3][3], const double slope[4][3], double epsilon, double gradient[12], double hessian[12][12]) {
    double u[3][3], s[3], v[3][3];
    bw_svd3(jacobian, u, s, v);
    terms f = terms_of(s, epsilon);
    double by[3] = {s[1] * s[2], s[0] * s[2], s[0] * s[1]}; /* of D by the singular values */
    for (int i = 0; i < 12; i++) {
        gradient[i] = 0;
        for (int c = 0; c < 3; c++) gradient[i] += (2 * s[c] * f.g + f.by_d * by[c]) * u[c][i % 3] * dot(v[c], slope[i / 3]);
        for (int k = 0; k <= i; k++) hessian[i][k] = 0;
    }
    add_scalings(&f, s, by, u, v, slope, hessian);
    add_turns(&f, s, u, v, slope, hessian);
    return f.value;
}
