/* Work by ranges or pieces covers every item once, and fails as one thread would. */
#include "kit/kit.h"

#include <stdio.h>
#include <string.h>

#include "base/parallel.h"

enum { ITEMS = 10007 };

typedef struct {
    unsigned char done[ITEMS];
    size_t bad[2]; /* items that fail */
} work;

static bw_status visit(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    work *w = user;
    (void)range;
    for (size_t i = begin; i < end; i++) {
        w->done[i]++;
        if (i == w->bad[0] || i == w->bad[1]) return bw_fail(ctx, BW_E_CHECK, "item %zu", i);
    }
    return BW_OK;
}

static void every_item_is_visited_once(void **state) {
    (void)state;
    for (int threads = 1; threads <= 9; threads += 4) {
        bw_context ctx;
        bw_context_init(&ctx);
        ctx.threads = threads;
        static work w;
        memset(&w, 0, sizeof w);
        w.bad[0] = w.bad[1] = ITEMS;
        kit_expect_ok(&ctx, bw_parallel(&ctx, ITEMS, bw_parallel_ranges(&ctx, ITEMS, 100), visit, &w));
        kit_expect_ok(&ctx, bw_parallel_pieces(&ctx, ITEMS, 64, bw_parallel_ranges(&ctx, ITEMS, 100), visit, &w));
        for (size_t i = 0; i < ITEMS; i++) assert_int_equal(w.done[i], 2);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void the_failure_of_the_lowest_item_is_reported(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    for (int round = 0; round < 50; round++) {
        static work w;
        memset(&w, 0, sizeof w);
        for (int i = 0; i < 2; i++) w.bad[i] = kit_random_below(&random, ITEMS);
        char expected[40];
        snprintf(expected, sizeof expected, "item %zu", w.bad[0] < w.bad[1] ? w.bad[0] : w.bad[1]);
        for (size_t piece = 0; piece < 200; piece += 99) {
            bw_context ctx;
            bw_context_init(&ctx);
            ctx.threads = 1 + round % 8;
            int ranges = bw_parallel_ranges(&ctx, ITEMS, 1);
            bw_status status = piece ? bw_parallel_pieces(&ctx, ITEMS, piece, ranges, visit, &w) : bw_parallel(&ctx, ITEMS, ranges, visit, &w);
            kit_expect_status(&ctx, status, BW_E_CHECK);
            assert_string_equal(ctx.error.message, expected);
            assert_int_equal(ctx.memory.used, 0);
        }
    }
}

static void few_items_get_few_ranges(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.threads = 1000;
    assert_int_equal(bw_parallel_ranges(&ctx, 10, 100), 1);
    assert_int_equal(bw_parallel_ranges(&ctx, 300, 100), 3);
    assert_int_equal(bw_parallel_ranges(&ctx, 1000000, 1), BW_PARALLEL_MOST);
    static work w;
    memset(&w, 0, sizeof w);
    kit_expect_ok(&ctx, bw_parallel(&ctx, 0, 1, visit, &w));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_item_is_visited_once),
        cmocka_unit_test(the_failure_of_the_lowest_item_is_reported),
        cmocka_unit_test(few_items_get_few_ranges),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
