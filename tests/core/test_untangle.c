/* The energy of a tet has the derivatives that it says, and untangling makes tets positive, from any start and always in the same way.
 */
#include "kit/kit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "solve/distortion.h"
#include "solve/lbfgs.h"
#include "solve/untangle.h"

/* ---- L-BFGS ---- */

enum { N = 40 };

static double bowl(void *user, const double *x, double *gradient) {
    const double *at = user;
    double sum = 1;
    for (int i = 0; i < N; i++) {
        double weight = pow(10, 3.0 * i / N), d = x[i] - at[i];
        gradient[i] = 2 * weight * d;
        sum += weight * d * d;
    }
    return sum;
}

static void a_quadratic_bowl_is_minimized(void **state) {
    kit_random random = kit_random_start(1);
    bw_context ctx;
    double at[N], x[N];
    bw_lbfgs_report report;
    (void)state;
    bw_context_init(&ctx);
    for (int i = 0; i < N; i++)
        at[i] = kit_random_range(&random, -3, 3), x[i] = kit_random_range(&random, -30, 30);
    kit_expect_ok(&ctx, bw_lbfgs(&ctx, N, x, bowl, at, &(bw_lbfgs_options){500, 0.1, 0}, &report));
    for (int i = 0; i < N; i++) assert_true(fabs(x[i] - at[i]) < 1e-5);
    assert_true(report.after < 1 + 1e-9 && report.before > report.after && report.iterations < 500);
}

/* Minimum at x = sqrt(2), infinite at 0 and below. */
static double barrier(void *user, const double *x, double *gradient) {
    (void)user;
    if (x[0] <= 0) return INFINITY;
    gradient[0] = 1 - 2 / (x[0] * x[0]);
    return x[0] + 2 / x[0];
}

static void a_barrier_is_never_crossed(void **state) {
    (void)state;
    for (int i = -12; i < 12; i++) {
        bw_context ctx;
        bw_lbfgs_report report;
        double x = pow(10, 0.5 * i);
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, bw_lbfgs(&ctx, 1, &x, barrier, NULL, &(bw_lbfgs_options){300, 100, 0}, &report));
        assert_true(fabs(x - sqrt(2)) < 1e-5);
    }
}

/* ---- one tet ---- */

static void random_matrix(kit_random *random, double m[3][3]) {
    for (int i = 0; i < 9; i++) m[i / 3][i % 3] = kit_random_range(random, -2, 2);
}

static void singular_values_give_the_matrix_back(void **state) {
    kit_random random = kit_random_start(5);
    (void)state;
    for (int run = 0; run < 300; run++) {
        double m[3][3], u[3][3], s[3], v[3][3];
        random_matrix(&random, m);
        for (int k = 0; k < 3 && run % 3 == 1; k++) m[k][1] = m[k][0];
        for (int i = 0; i < 9 && run % 50 == 2; i++) m[i / 3][i % 3] = 0;
        bw_svd3((const double(*)[3])m, u, s, v);
        assert_true(fabs(bw_det3((const double(*)[3])u) - 1) < 1e-12 && fabs(bw_det3((const double(*)[3])v) - 1) < 1e-12);
        assert_true(s[0] >= s[1] && s[1] >= fabs(s[2]) - 1e-14);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                assert_true(fabs(m[a][b] - u[0][a] * s[0] * v[0][b] - u[1][a] * s[1] * v[1][b] - u[2][a] * s[2] * v[2][b]) < 1e-12);
    }
}

static void set_jacobian(const double *corner, const double slope[4][3], double out[3][3]) {
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            out[a][b] = 0;
            for (int i = 0; i < 4; i++) out[a][b] += corner[3 * i + a] * slope[i][b];
        }
}

/* By differences; the Hessian is that of the energy where it has no negative eigenvalue, as at the minimum. */
static void derivatives_are_those_of_the_energy(void **state) {
    const double step = 1e-5;
    kit_random random = kit_random_start(6);
    (void)state;
    for (int run = 0; run < 200; run++) {
        double corner[12], slope[4][3], j[3][3], g[12], h[12][12], plus[12], minus[12], unused[12][12];
        double epsilon = run % 2 ? 0.3 : 1;
        bool minimum = run % 4 == 0;
        for (int i = 0; i < 12; i++) corner[i] = kit_random_range(&random, -1, 1), slope[i / 3][i % 3] = kit_random_range(&random, -1, 1);
        if (minimum) { /* the identity */
            for (int i = 0; i < 12; i++) corner[i] = i > 2 && i % 4 == 3, slope[i / 3][i % 3] = corner[i] - (i < 3);
            for (int i = 3; i < 12; i++) corner[i] = slope[i / 3][i % 3] = (i - 3) % 4 == 0;
        }
        set_jacobian(corner, (const double(*)[3])slope, j);
        if (minimum) epsilon = 0;
        double f = bw_distortion_expand((const double(*)[3])j, (const double(*)[3])slope, epsilon, g, h);
        assert_true(fabs(f - bw_distortion((const double(*)[3])j, epsilon)) < 1e-9 * f);
        if (minimum) assert_true(fabs(f - 5) < 1e-12);
        for (int i = 0; i < 12; i++) {
            double at = corner[i], value[2];
            corner[i] = at + step, set_jacobian(corner, (const double(*)[3])slope, j);
            value[0] = bw_distortion_expand((const double(*)[3])j, (const double(*)[3])slope, epsilon, plus, unused);
            corner[i] = at - step, set_jacobian(corner, (const double(*)[3])slope, j);
            value[1] = bw_distortion_expand((const double(*)[3])j, (const double(*)[3])slope, epsilon, minus, unused);
            corner[i] = at;
            assert_true(fabs((value[0] - value[1]) / (2 * step) - g[i]) < 1e-4 * (1 + fabs(g[i]) + f));
            for (int k = 0; k <= i && minimum; k++) assert_true(fabs((plus[k] - minus[k]) / (2 * step) - h[i][k]) < 1e-5);
        }
    }
}

static void a_flat_tet_is_infinitely_bad(void **state) {
    const double flat[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 0}}, inverted[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, -1}};
    (void)state;
    assert_true(isinf(bw_distortion(flat, 0)) && isinf(bw_distortion(inverted, 0)));
    assert_true(bw_distortion(inverted, 0.1) > bw_distortion(flat, 0.1) && isfinite(bw_distortion(inverted, 0.1)));
}

/* ---- untangling ---- */

enum { SIDE = 5, POINTS = SIDE * SIDE * SIDE, TETS = 6 * (SIDE - 1) * (SIDE - 1) * (SIDE - 1) };

typedef struct {
    bw_untangle_tet tet[TETS];
    double x[3 * POINTS];
    size_t variables;
} block;

static bool inner(const int at[3]) {
    for (int k = 0; k < 3; k++)
        if (at[k] == 0 || at[k] == SIDE - 1) return false;
    return true;
}

/* A block of unit cubes, six tets each. Vertices inside are free; every variable is an offset, some with a
 * negative sign. */
static void make_block(block *b) {
    static const int path[6][4] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                   {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
    int32_t variable[POINTS];
    size_t n = 0;
    memset(b, 0, sizeof *b);
    for (int p = 0; p < POINTS; p++) {
        int at[3] = {p % SIDE, p / SIDE % SIDE, p / SIDE / SIDE};
        variable[p] = inner(at) ? (int32_t)b->variables : -1;
        if (inner(at)) b->variables += 3;
    }
    for (int c = 0; c < POINTS; c++) {
        int low[3] = {c % SIDE, c / SIDE % SIDE, c / SIDE / SIDE};
        if (low[0] == SIDE - 1 || low[1] == SIDE - 1 || low[2] == SIDE - 1) continue;
        for (int t = 0; t < 6; t++) {
            bw_untangle_tet *tet = &b->tet[n++];
            double e[3][3];
            for (int i = 0; i < 4; i++) {
                int corner = path[t][i],
                    at[3] = {low[0] + (corner & 1), low[1] + (corner >> 1 & 1), low[2] + (corner >> 2)};
                int p = at[0] + SIDE * at[1] + SIDE * SIDE * at[2];
                for (int k = 0; k < 3; k++) {
                    tet->at[i][k] = at[k];
                    tet->variable[i][k] = variable[p] < 0 ? -1 : variable[p] + k;
                    tet->sign[i][k] = k == 1 ? -1 : 1;
                }
            }
            for (int i = 0; i < 3; i++)
                for (int k = 0; k < 3; k++) e[k][i] = tet->at[i + 1][k] - tet->at[0][k];
            for (int i = 0; i < 3;
                 i++) /* the edges are a triangular matrix of ones up to order: its inverse by cofactors */
                for (int k = 0; k < 3; k++) {
                    int i1 = (i + 1) % 3, i2 = (i + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
                    tet->rest[k][i] = e[i1][k1] * e[i2][k2] - e[i1][k2] * e[i2][k1];
                }
        }
    }
    assert_int_equal(n, TETS);
}

static void a_regular_block_stays_as_it_is(void **state) {
    bw_context ctx;
    bw_untangle_report report;
    block *b = malloc(sizeof *b);
    (void)state;
    bw_context_init(&ctx);
    make_block(b);
    for (size_t t = 0; t < TETS; t++) assert_true(fabs(bw_untangle_volume(&b->tet[t], b->x) - 1) < 1e-12);
    kit_expect_ok(&ctx, bw_untangle(&ctx, b->tet, TETS, b->variables, b->x, &report));
    assert_int_equal(report.rounds, 0);
    for (size_t v = 0; v < b->variables; v++) assert_true(fabs(b->x[v]) < 1e-6);
    free(b);
}

static void a_tangled_block_is_untangled_from_any_start(void **state) {
    kit_random random = kit_random_start(2);
    block *b = malloc(sizeof *b), *again = malloc(sizeof *b);
    (void)state;
    for (int run = 0; run < 12; run++) {
        bw_context ctx;
        bw_untangle_report report, other;
        double reach = run % 4 == 3 ? 0 : 3; /* 0: all in one point */
        bw_context_init(&ctx);
        make_block(b);
        for (size_t v = 0; v < b->variables; v++) b->x[v] = kit_random_range(&random, -reach, reach);
        for (size_t t = 0; t < TETS && reach == 0; t++) /* the variables' corners all go to the middle */
            for (int i = 0; i < 12; i++)
                if (b->tet[t].variable[i / 3][i % 3] >= 0) b->tet[t].at[i / 3][i % 3] = 0.5 * (SIDE - 1);
        memcpy(again, b, sizeof *b);
        kit_expect_ok(&ctx, bw_untangle(&ctx, b->tet, TETS, b->variables, b->x, &report));
        assert_true(report.smallest > 0.5);
        for (size_t t = 0; t < TETS; t++)
            assert_true(bw_untangle_volume(&b->tet[t], b->x) >= report.smallest);
        kit_expect_ok(&ctx, bw_untangle(&ctx, again->tet, TETS, again->variables, again->x, &other));
        assert_memory_equal(again->x, b->x, sizeof b->x);
        assert_int_equal(ctx.memory.used, 0);
    }
    free(b), free(again);
}

/* Two corners held on the wrong sides of each other: there is no solution, and that is said. */
static void what_has_no_solution_is_not_called_solved(void **state) {
    bw_context ctx;
    bw_untangle_report report;
    block *b = malloc(sizeof *b);
    (void)state;
    bw_context_init(&ctx);
    make_block(b);
    for (size_t t = 0; t < TETS; t++)
        for (int i = 0; i < 4; i++)
            if (b->tet[t].variable[i][0] < 0 && b->tet[t].at[i][0] == 0 && b->tet[t].at[i][1] == 1 &&
                b->tet[t].at[i][2] == 1)
                b->tet[t].at[i][1] = 2.5;
    kit_expect_ok(&ctx, bw_untangle(&ctx, b->tet, TETS, b->variables, b->x, &report));
    assert_true(report.smallest <= 0);
    free(b);
}

static void a_job_that_is_cancelled_stops(void **state) {
    static const volatile sig_atomic_t yes = 1;
    bw_context ctx;
    bw_untangle_report report;
    block *b = malloc(sizeof *b);
    (void)state;
    bw_context_init(&ctx);
    make_block(b);
    b->x[0] = 3;
    ctx.cancel = &yes;
    kit_expect_status(&ctx, bw_untangle(&ctx, b->tet, TETS, b->variables, b->x, &report), BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, 0);
    free(b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_quadratic_bowl_is_minimized),
        cmocka_unit_test(a_barrier_is_never_crossed),
        cmocka_unit_test(singular_values_give_the_matrix_back),
        cmocka_unit_test(derivatives_are_those_of_the_energy),
        cmocka_unit_test(a_flat_tet_is_infinitely_bad),
        cmocka_unit_test(a_regular_block_stays_as_it_is),
        cmocka_unit_test(a_tangled_block_is_untangled_from_any_start),
        cmocka_unit_test(what_has_no_solution_is_not_called_solved),
        cmocka_unit_test(a_job_that_is_cancelled_stops),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
