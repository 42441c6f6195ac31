/* Integer programs: the optimum is that of complete enumeration, of another solver, and comes out the same each time. */
#include "kit/kit.h"

#include <Cbc_C_Interface.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "solve/program.h"

enum { COLUMNS_MAX = 24, ROWS_MAX = 24 };

typedef struct {
    int columns, rows, low, high;
    double cost[COLUMNS_MAX], factor[ROWS_MAX][COLUMNS_MAX], lower[ROWS_MAX];
} sample;

static uint64_t seed;

static int draw(int low, int high) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return low + (int)((seed >> 33) % (uint64_t)(high - low + 1));
}

static void draw_sample(sample *s, int columns, int rows, int span) {
    *s = (sample){.columns = columns, .rows = rows, .low = -span, .high = span};
    for (int c = 0; c < columns; c++) s->cost[c] = draw(-9, 9);
    for (int r = 0; r < rows; r++) {
        for (int c = 0; c < columns; c++) s->factor[r][c] = draw(0, 2) ? 0 : draw(-5, 5);
        s->lower[r] = draw(-9, 3);
    }
}

typedef struct {
    int columns;
    double best[COLUMNS_MAX];
} keeper;

/* Keeps integral solutions; adds nothing. */
static bw_status keep(void *user, bw_program *program, const double *x, double value, bool integral, double *cutoff) {
    keeper *k = user;
    (void)program;
    if (!integral || value >= *cutoff) return BW_OK;
    memcpy(k->best, x, (size_t)k->columns * sizeof *x);
    *cutoff = value;
    return BW_OK;
}

static bw_program *make_program(bw_context *ctx, const sample *s) {
    bw_program *p;
    int columns[COLUMNS_MAX];
    assert_int_equal(bw_program_new(ctx, &p), BW_OK);
    for (int c = 0; c < s->columns; c++) {
        columns[c] = c;
        assert_int_equal(bw_program_add_column(ctx, p, s->low, s->high, s->cost[c], true), BW_OK);
    }
    for (int r = 0; r < s->rows; r++)
        assert_int_equal(bw_program_add_row(ctx, p, (size_t)s->columns, columns, s->factor[r], s->lower[r], BW_PROGRAM_INFINITY), BW_OK);
    return p;
}

static bw_branch_result branch(const sample *s, double seconds, uint64_t nodes, double *best) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_program *p = make_program(&ctx, s);
    keeper kept = {s->columns, {0}};
    bw_branch_options how = {keep, &kept, BW_PROGRAM_INFINITY, 1, seconds, nodes};
    bw_branch_result result;
    assert_int_equal(bw_program_branch(&ctx, p, &how, &result), BW_OK);
    bw_program_free(&ctx, p);
    assert_int_equal(ctx.memory.used, 0);
    if (best) memcpy(best, kept.best, sizeof kept.best);
    return result;
}

static double enumerate(const sample *s) {
    int x[COLUMNS_MAX];
    double best = BW_PROGRAM_INFINITY;
    for (int c = 0; c < s->columns; c++) x[c] = s->low;
    for (;;) {
        double value = 0;
        bool good = true;
        for (int c = 0; c < s->columns; c++) value += s->cost[c] * x[c];
        for (int r = 0; r < s->rows && good; r++) {
            double sum = 0;
            for (int c = 0; c < s->columns; c++) sum += s->factor[r][c] * x[c];
            good = sum >= s->lower[r];
        }
        if (good && value < best) best = value;
        int c = 0;
        while (c < s->columns && x[c] == s->high) x[c++] = s->low;
        if (c == s->columns) return best;
        x[c]++;
    }
}

static void optima_are_those_of_enumeration(void **state) {
    (void)state;
    seed = 1;
    print_message("seed %d\n", (int)seed);
    int infeasible = 0;
    for (int i = 0; i < 200; i++) {
        sample s;
        draw_sample(&s, 5, draw(2, 6), 3);
        double expected = enumerate(&s);
        bw_branch_result found = branch(&s, 100, 1000000, NULL);
        assert_true(found.exhausted);
        infeasible += expected >= BW_PROGRAM_INFINITY;
        if (fabs(found.cutoff - expected) > 1e-5) fail_msg("case %d: %g, expected %g", i, found.cutoff, expected);
    }
    assert_true(infeasible > 0 && infeasible < 100);
}

static double solve_with_cbc(const sample *s) {
    Cbc_Model *model = Cbc_newModel();
    int columns[COLUMNS_MAX];
    Cbc_setParameter(model, "log", "0");
    for (int c = 0; c < s->columns; c++) {
        columns[c] = c;
        Cbc_addCol(model, "", s->low, s->high, s->cost[c], 1, 0, NULL, NULL);
    }
    for (int r = 0; r < s->rows; r++) Cbc_addRow(model, "", s->columns, columns, s->factor[r], 'G', s->lower[r]);
    Cbc_solve(model);
    double value = Cbc_isProvenOptimal(model) ? Cbc_getObjValue(model) : BW_PROGRAM_INFINITY;
    Cbc_deleteModel(model);
    return value;
}

static void optima_are_those_of_another_solver(void **state) {
    (void)state;
    seed = 2;
    print_message("seed %d\n", (int)seed);
    for (int i = 0; i < 12; i++) {
        sample s;
        draw_sample(&s, 20, 14, 20);
        double expected = solve_with_cbc(&s), best[COLUMNS_MAX];
        bw_branch_result found = branch(&s, 100, 1000000, best);
        if (fabs(found.cutoff - expected) > 1e-5) fail_msg("case %d: %g, expected %g", i, found.cutoff, expected);
        for (int r = 0; r < s.rows && expected < BW_PROGRAM_INFINITY; r++) {
            double sum = 0;
            for (int c = 0; c < s.columns; c++) sum += s.factor[r][c] * round(best[c]);
            assert_true(sum >= s.lower[r]);
        }
    }
}

static void the_same_program_gives_the_same_solution(void **state) {
    (void)state;
    seed = 3;
    for (int i = 0; i < 5; i++) {
        sample s;
        double first[COLUMNS_MAX], second[COLUMNS_MAX];
        draw_sample(&s, 20, 14, 20);
        bw_branch_result a = branch(&s, 100, 1000000, first), b = branch(&s, 100, 1000000, second);
        assert_int_equal(a.nodes, b.nodes);
        assert_memory_equal(first, second, sizeof first);
    }
}

static void a_search_that_is_stopped_gives_a_bound(void **state) {
    (void)state;
    seed = 4;
    int stopped = 0;
    for (int i = 0; i < 10; i++) {
        sample s;
        draw_sample(&s, 20, 14, 20);
        bw_branch_result full = branch(&s, 100, 1000000, NULL), part = branch(&s, 100, 4, NULL), none = branch(&s, 0, 1000000, NULL);
        assert_true(part.nodes <= 4);
        assert_true(part.bound <= full.cutoff + 1e-6);
        assert_true(none.bound <= full.cutoff + 1e-6);
        assert_true(part.cutoff >= full.cutoff - 1e-6);
        stopped += !part.exhausted;
    }
    assert_true(stopped > 0);
}

static void an_unbounded_program_is_refused(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_program *p;
    keeper kept = {1, {0}};
    bw_branch_options how = {keep, &kept, BW_PROGRAM_INFINITY, 0, 10, 1000};
    bw_branch_result result;
    assert_int_equal(bw_program_new(&ctx, &p), BW_OK);
    assert_int_equal(bw_program_add_column(&ctx, p, -BW_PROGRAM_INFINITY, 5, 1, true), BW_OK);
    assert_int_equal(bw_program_branch(&ctx, p, &how, &result), BW_E_ALGORITHM);
    bw_program_free(&ctx, p);
}

/* The circle of radius 2.5 by tangents at its integral points only: x + 2 y is largest at (1, 2). */
static bw_status stay_in_circle(void *user, bw_program *program, const double *x, double value, bool integral, double *cutoff) {
    bw_context *ctx = user;
    static const int columns[] = {0, 1};
    if (x[0] * x[0] + x[1] * x[1] > 6.2500001)
        return bw_program_add_row(ctx, program, 2, columns, x, -BW_PROGRAM_INFINITY, 2.5 * hypot(x[0], x[1]));
    if (integral) *cutoff = fmin(*cutoff, value);
    return BW_OK;
}

static void rows_may_be_added_while_branching(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_program *p;
    bw_branch_options how = {stay_in_circle, &ctx, BW_PROGRAM_INFINITY, 0, 10, 10000};
    bw_branch_result result;
    assert_int_equal(bw_program_new(&ctx, &p), BW_OK);
    assert_int_equal(bw_program_add_column(&ctx, p, -9, 9, -1, true), BW_OK);
    assert_int_equal(bw_program_add_column(&ctx, p, -9, 9, -2, true), BW_OK);
    assert_int_equal(bw_program_branch(&ctx, p, &how, &result), BW_OK);
    assert_true(result.exhausted);
    assert_true(fabs(result.cutoff + 5) < 1e-6);
    double lower, upper;
    bw_program_get_bounds(p, 0, &lower, &upper);
    assert_true(lower == -9 && upper == 9);
    bw_program_free(&ctx, p);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(optima_are_those_of_enumeration),
    cmocka_unit_test(optima_are_those_of_another_solver),
    cmocka_unit_test(the_same_program_gives_the_same_solution),
    cmocka_unit_test(a_search_that_is_stopped_gives_a_bound),
    cmocka_unit_test(an_unbounded_program_is_refused),
    cmocka_unit_test(rows_may_be_added_while_branching),
};
KIT_MAIN(tests)
