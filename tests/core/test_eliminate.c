/* Homogeneous integer equations: the unknowns that are left reach all integer solutions, also where no factor is 1. */
#include "kit/kit.h"

#include <stdlib.h>

#include "quantize/eliminate.h"

enum { UNKNOWNS = 4, SPAN = 6, EXTRA_MAX = 40 };

static uint64_t seed;

static int draw(int low, int high) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return low + (int)((seed >> 33) % (uint64_t)(high - low + 1));
}

/* Runs the steps backwards from a choice of the unknowns that no step implies. */
static void complete(const bw_elimination *e, int64_t *x) {
    for (size_t k = e->step_count; k-- > 0;) {
        const bw_eliminate_step *s = &e->step[k];
        x[s->unknown] = 0;
        for (size_t i = s->begin; i < s->end; i++) x[s->unknown] += e->term[i].factor * x[e->term[i].unknown];
    }
}

/* Runs them forwards from a solution: extra unknowns get the value that makes their step hold. */
static bool invert(const bw_elimination *e, int64_t *x) {
    size_t known = UNKNOWNS;
    for (size_t k = 0; k < e->step_count; k++) {
        const bw_eliminate_step *s = &e->step[k];
        int64_t sum = 0;
        for (size_t i = s->begin; i < s->end; i++)
            if ((size_t)e->term[i].unknown < known) sum += e->term[i].factor * x[e->term[i].unknown];
        if (s->end > s->begin && (size_t)e->term[s->end - 1].unknown == known) x[known++] = x[s->unknown] - sum;
        else if (sum != x[s->unknown]) return false;
    }
    return true;
}

static void solutions_are_reached_and_only_they(void **state) {
    (void)state;
    seed = 5;
    print_message("seed %d\n", (int)seed);
    size_t solutions = 0, extras = 0;
    for (int test = 0; test < 300; test++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_eliminate_term term[3 * UNKNOWNS];
        size_t begin[4] = {0}, rows = (size_t)draw(1, 3);
        int64_t factor[3][UNKNOWNS] = {{0}}, size[UNKNOWNS] = {1, 2, 3, 4};
        for (size_t r = 0; r < rows; r++) {
            begin[r + 1] = begin[r];
            for (int u = 0; u < UNKNOWNS; u++)
                if ((factor[r][u] = draw(-6, 6))) term[begin[r + 1]++] = (bw_eliminate_term){u, factor[r][u]};
        }
        bw_eliminate_input in = {rows, UNKNOWNS, begin, term, size};
        bw_elimination e;
        kit_expect_ok(&ctx, bw_eliminate(&ctx, &in, &e));
        assert_true(e.count <= EXTRA_MAX);
        extras += e.count > UNKNOWNS;
        for (int i = 0; i < 20; i++) { /* only solutions are reached */
            int64_t x[EXTRA_MAX];
            for (size_t u = 0; u < e.count; u++) x[u] = draw(-9, 9);
            complete(&e, x);
            for (size_t r = 0; r < rows; r++) {
                int64_t sum = 0;
                for (int u = 0; u < UNKNOWNS; u++) sum += factor[r][u] * x[u];
                assert_int_equal(sum, 0);
            }
        }
        int64_t x[EXTRA_MAX];
        for (int code = 0; code < (2 * SPAN + 1) * (2 * SPAN + 1) * (2 * SPAN + 1) * (2 * SPAN + 1); code++) { /* all of them are */
            int rest = code;
            bool solves = true;
            for (int u = 0; u < UNKNOWNS; u++) x[u] = rest % (2 * SPAN + 1) - SPAN, rest /= 2 * SPAN + 1;
            for (size_t r = 0; r < rows && solves; r++) {
                int64_t sum = 0;
                for (int u = 0; u < UNKNOWNS; u++) sum += factor[r][u] * x[u];
                solves = sum == 0;
            }
            if (!solves) continue;
            int64_t again[EXTRA_MAX];
            assert_true(invert(&e, x));
            for (size_t u = 0; u < e.count; u++) again[u] = x[u];
            complete(&e, again);
            for (size_t u = 0; u < e.count; u++) assert_int_equal(again[u], x[u]);
            solutions++;
        }
        bw_elimination_clear(&ctx, &e);
        assert_int_equal(ctx.memory.used, 0);
    }
    assert_true(solutions > 1000 && extras > 50);
}

/* x1 = f x0, x2 = f x1: whichever is put into the other, f^2 is beyond the range; and for the second f beyond 64 bits. */
static void factors_beyond_the_range_are_refused(void **state) {
    (void)state;
    for (int power = 21; power <= 40; power += 19) {
        bw_context ctx;
        bw_elimination out;
        int64_t f = (int64_t)1 << power, size[] = {1, 1, 1};
        bw_eliminate_term term[] = {{0, -f}, {1, 1}, {1, -f}, {2, 1}};
        size_t begin[] = {0, 2, 4};
        bw_context_init(&ctx);
        assert_int_equal(bw_eliminate(&ctx, &(bw_eliminate_input){2, 3, begin, term, size}, &out), BW_E_RANGE);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(solutions_are_reached_and_only_they),
    cmocka_unit_test(factors_beyond_the_range_are_refused),
};
KIT_MAIN(tests)
