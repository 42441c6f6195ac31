/* Exact integer solutions next to a given point (solve/echelon.h). */
#include "kit/kit.h"

#include <gmp.h>
#include <stdlib.h>
#include <string.h>

#include "solve/echelon.h"

enum { ROWS = 60, COLUMNS = 80, PRIME = 2147483629 };

/* A dense matrix and its sparse form. */
typedef struct {
    size_t rows, columns;
    int64_t dense[ROWS][COLUMNS];
    size_t start[ROWS + 1];
    int32_t column[ROWS * COLUMNS];
    int64_t coefficient[ROWS * COLUMNS];
    int64_t estimate[COLUMNS], x[COLUMNS];
    bw_echelon_report report;
} problem;

static bw_equations sparse(problem *p) {
    size_t n = 0;
    for (size_t r = 0; r < p->rows; r++) {
        p->start[r] = n;
        for (size_t c = 0; c < p->columns; c++)
            if (p->dense[r][c]) p->column[n] = (int32_t)c, p->coefficient[n++] = p->dense[r][c];
    }
    p->start[p->rows] = n;
    return (bw_equations){p->rows, p->columns, p->start, p->column, p->coefficient};
}

static bw_status solve(bw_context *ctx, problem *p, int64_t max_divisor) {
    bw_equations e = sparse(p);
    return bw_echelon_solve(ctx, &e, p->estimate, max_divisor, INT64_MAX / 4, p->x, &p->report);
}

static void check_solution(const problem *p) {
    for (size_t r = 0; r < p->rows; r++) {
        __int128 sum = 0;
        for (size_t c = 0; c < p->columns; c++) sum += (__int128)p->dense[r][c] * p->x[c];
        assert_true(sum == 0);
    }
}

static int64_t power(int64_t x, int64_t n) {
    int64_t result = 1;
    for (; n; n >>= 1, x = x * x % PRIME)
        if (n & 1) result = result * x % PRIME;
    return result;
}

/* Rank modulo a prime: at most the rank, and equal to it but for bad luck that the seeds below do not have.
 */
static size_t rank_mod_prime(const problem *p) {
    static int64_t m[ROWS][COLUMNS];
    size_t rank = 0;
    for (size_t r = 0; r < p->rows; r++)
        for (size_t c = 0; c < p->columns; c++) m[r][c] = (p->dense[r][c] % PRIME + PRIME) % PRIME;
    for (size_t c = 0; c < p->columns && rank < p->rows; c++) {
        size_t pivot = rank;
        while (pivot < p->rows && !m[pivot][c]) pivot++;
        if (pivot == p->rows) continue;
        for (size_t k = 0; k < p->columns; k++) {
            int64_t swap = m[pivot][k];
            m[pivot][k] = m[rank][k], m[rank][k] = swap;
        }
        int64_t inverse = power(m[rank][c], PRIME - 2);
        for (size_t r = rank + 1; r < p->rows; r++) {
            int64_t f = m[r][c] * inverse % PRIME;
            for (size_t k = c; f && k < p->columns; k++)
                m[r][k] = (m[r][k] + (PRIME - f) * m[rank][k]) % PRIME;
        }
        rank++;
    }
    return rank;
}

/* A few factors of -2..2 a row, as cuts give, and rows that depend on others. */
static void fill(problem *p, kit_random *random) {
    memset(p, 0, sizeof *p);
    p->rows = 1 + kit_random_below(random, ROWS - 1);
    p->columns = 1 + kit_random_below(random, COLUMNS - 1);
    for (size_t r = 0; r < p->rows; r++) {
        if (r > 2 && kit_random_below(random, 4) == 0) {
            size_t a = kit_random_below(random, r), b = kit_random_below(random, r);
            for (size_t c = 0; c < p->columns; c++) p->dense[r][c] = p->dense[a][c] - p->dense[b][c];
            continue;
        }
        for (int i = 0; i < 4; i++)
            p->dense[r][kit_random_below(random, p->columns)] = (int64_t)kit_random_below(random, 5) - 2;
    }
    for (size_t c = 0; c < p->columns; c++)
        p->estimate[c] = (int64_t)(kit_random_next(random) >> 20) - ((int64_t)1 << 43);
}

static void solutions_are_exact_and_ranks_right(void **state) {
    static problem p;
    kit_random random = kit_random_start(1);
    int solved = 0;
    (void)state;
    for (int i = 0; i < 400; i++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fill(&p, &random);
        bw_status status = solve(&ctx, &p, (int64_t)1 << 40);
        assert_int_equal(ctx.memory.used, 0);
        if (status == BW_E_RANGE) continue; /* dense random systems may divide by anything */
        kit_expect_ok(&ctx, status);
        check_solution(&p);
        assert_int_equal(p.report.rank, rank_mod_prime(&p));
        solved++;
    }
    print_message("%d of 400 solved\n", solved);
    assert_true(solved > 200);
}

/* Free unknowns stay within half a divisor: those, at least columns - rank, are the unknowns that moved by no
 * more. */
static void free_unknowns_move_by_at_most_half_a_divisor(void **state) {
    static problem p;
    kit_random random = kit_random_start(2);
    (void)state;
    for (int i = 0; i < 200; i++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fill(&p, &random);
        if (solve(&ctx, &p, (int64_t)1 << 40)) continue;
        size_t near = 0;
        for (size_t c = 0; c < p.columns; c++) near += 2 * llabs(p.x[c] - p.estimate[c]) <= p.report.divisor;
        assert_true(near >= p.columns - p.report.rank);
        assert_true(p.report.free <= p.columns - p.report.rank);
    }
}

static void a_solution_is_returned_as_it_is_if_nothing_divides(void **state) {
    static problem p;
    kit_random random = kit_random_start(3);
    int same = 0;
    (void)state;
    for (int i = 0; i < 200; i++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fill(&p, &random);
        if (solve(&ctx, &p, (int64_t)1 << 40)) continue;
        memcpy(p.estimate, p.x, sizeof p.x);
        kit_expect_ok(&ctx, solve(&ctx, &p, (int64_t)1 << 40));
        assert_memory_equal(p.x, p.estimate,
                            p.columns * sizeof *p.x); /* free ones are multiples of their divisors already */
        same++;
    }
    assert_true(same > 100);
}

static void coprime_factors_make_both_unknowns_divisible(void **state) {
    static problem p;
    bw_context ctx;
    (void)state;
    bw_context_init(&ctx);
    p = (problem){.rows = 1, .columns = 2, .dense = {{2, 3}}, .estimate = {301, -199}};
    kit_expect_ok(&ctx, solve(&ctx, &p, 100));
    check_solution(&p);
    assert_int_equal(p.x[0] % 3, 0);
    assert_int_equal(p.x[1] % 2, 0);
    assert_true(llabs(p.x[0] - 301) <= 3 && llabs(p.x[1] + 199) <= 2);
}

static void a_half_implies_the_whole_and_not_the_other_way_round(void **state) {
    static problem p;
    bw_context ctx;
    (void)state;
    bw_context_init(&ctx);
    p = (problem){.rows = 1, .columns = 2, .dense = {{2, -1}}, .estimate = {7, 15}};
    kit_expect_ok(&ctx, solve(&ctx, &p, 1));
    assert_int_equal(p.x[0], 7);
    assert_int_equal(p.x[1], 14);
    assert_int_equal(p.report.divisor, 1);
}

static void divisors_and_values_beyond_the_limit_are_refused(void **state) {
    static problem p;
    bw_context ctx;
    (void)state;
    bw_context_init(&ctx);
    p = (problem){.rows = 1, .columns = 2, .dense = {{1000003, 1000033}}, .estimate = {5, 5}};
    kit_expect_status(&ctx, solve(&ctx, &p, 1000), BW_E_RANGE);
    bw_context_init(&ctx);
    p = (problem){.rows = 3, .columns = 4, .estimate = {1, 1, 1, 1}};
    for (size_t r = 0; r < 3; r++)
        p.dense[r][r] = -1, p.dense[r][r + 1] = (int64_t)1 << 40; /* x0 = 2^120 x3 */
    p.dense[0][0] = 1;
    kit_expect_status(&ctx, solve(&ctx, &p, 1000), BW_E_RANGE);
    assert_int_equal(ctx.memory.used, 0);
}

/* Numbers on the way may be of any size: rows whose elimination passes 64 bits by far, with zero as the only
 * solution. */
static void intermediate_numbers_may_exceed_64_bits(void **state) {
    static problem p;
    kit_random random = kit_random_start(4);
    bw_context ctx;
    (void)state;
    bw_context_init(&ctx);
    p = (problem){.rows = 24, .columns = 24};
    for (size_t r = 0; r < 24; r++)
        for (size_t c = 0; c < 24; c++) p.dense[r][c] = (int64_t)kit_random_below(&random, 2000001) - 1000000;
    for (size_t c = 0; c < 24; c++) p.estimate[c] = 12345;
    kit_expect_ok(&ctx, solve(&ctx, &p, 1));
    assert_int_equal(p.report.rank, 24);
    for (size_t c = 0; c < 24; c++) assert_int_equal(p.x[c], 0);
}

/* Chains of thousands of unknowns, as features give: no fill, no quadratic search. */
static void long_chains_are_solved(void **state) {
    enum { N = 50000 };
    size_t *start = malloc((N + 1) * sizeof *start);
    int32_t *column = malloc(2 * N * sizeof *column);
    int64_t *coefficient = malloc(2 * N * sizeof *coefficient),
            *estimate = malloc((N + 1) * sizeof *estimate);
    int64_t *x = malloc((N + 1) * sizeof *x);
    bw_context ctx;
    bw_echelon_report report;
    (void)state;
    bw_context_init(&ctx);
    for (size_t r = 0; r < N; r++) {
        start[r] = 2 * r;
        column[2 * r] = (int32_t)r, column[2 * r + 1] = (int32_t)r + 1;
        coefficient[2 * r] = 1, coefficient[2 * r + 1] = -1;
    }
    start[N] = 2 * N;
    for (int64_t c = 0; c <= N; c++) estimate[c] = 1000000 + c % 3;
    bw_equations e = {N, N + 1, start, column, coefficient};
    kit_expect_ok(&ctx, bw_echelon_solve(&ctx, &e, estimate, 1, INT64_MAX / 4, x, &report));
    assert_int_equal(report.rank, N);
    for (size_t c = 1; c <= N; c++) assert_int_equal(x[c], x[0]);
    assert_true(x[0] >= 1000000 && x[0] <= 1000002);
    free(start), free(column), free(coefficient), free(estimate), free(x);
}

static bw_status solve_small(bw_context *ctx, void *user) {
    problem *p = user;
    return solve(ctx, p, (int64_t)1 << 40);
}

static void every_failing_allocation_is_reported(void **state) {
    static problem p;
    (void)state;
    p = (problem){.rows = 12, .columns = 20};
    for (size_t r = 0; r < 12; r++)
        for (size_t i = 0; i < 4; i++) p.dense[r][(5 * r + 7 * i) % 20] = i % 2 ? -1 : 1;
    for (size_t c = 0; c < 20; c++) p.estimate[c] = (int64_t)(1000 * c);
    size_t runs = kit_fail_each_allocation(solve_small, &p);
    print_message("%zu allocations\n", runs - 1);
    assert_true(runs > 20);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(solutions_are_exact_and_ranks_right),
        cmocka_unit_test(free_unknowns_move_by_at_most_half_a_divisor),
        cmocka_unit_test(a_solution_is_returned_as_it_is_if_nothing_divides),
        cmocka_unit_test(coprime_factors_make_both_unknowns_divisible),
        cmocka_unit_test(a_half_implies_the_whole_and_not_the_other_way_round),
        cmocka_unit_test(divisors_and_values_beyond_the_limit_are_refused),
        cmocka_unit_test(intermediate_numbers_may_exceed_64_bits),
        cmocka_unit_test(long_chains_are_solved),
        cmocka_unit_test(every_failing_allocation_is_reported),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
