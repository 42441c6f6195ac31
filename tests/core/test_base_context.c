/* The job's context keeps its books: bytes, the first error, elements, cancellation. */
#include "kit/kit.h"

#include <stdio.h>
#include <string.h>

#include "base/context.h"

static void bytes_in_use_peak_and_limit_are_exact(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.memory.limit = 1000;
    char *a = bw_alloc(&ctx, 100, 4), *b = bw_alloc(&ctx, 600, 1);
    assert_non_null(a);
    assert_non_null(b);
    assert_int_equal(ctx.memory.used, 1000);
    for (int i = 0; i < 400; i++) assert_int_equal(a[i], 0);
    assert_null(bw_alloc(&ctx, 1, 1));
    assert_int_equal(ctx.error.status, BW_E_MEMORY);
    b = bw_resize(&ctx, b, 100, 1);
    assert_int_equal(ctx.memory.used, 500);
    assert_int_equal(ctx.memory.peak, 1000);
    b[99] = 7;
    b = bw_resize(&ctx, b, 200, 1);
    assert_true(b[99] == 7 && b[100] == 0 && b[199] == 0);
    bw_free(&ctx, a);
    bw_free(&ctx, b);
    bw_free(&ctx, NULL);
    assert_int_equal(ctx.memory.used, 0);
}

static void sizes_that_overflow_are_refused(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    assert_null(bw_alloc(&ctx, SIZE_MAX / 2, 3));
    assert_int_equal(ctx.error.status, BW_E_MEMORY);
    assert_null(bw_alloc(&ctx, SIZE_MAX, 1));
    assert_int_equal(ctx.memory.used, 0);
}

static void a_block_of_nothing_is_a_block(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    void *none = bw_alloc(&ctx, 0, 8);
    assert_non_null(none);
    assert_int_equal(ctx.memory.used, 0);
    bw_free(&ctx, none);
}

static void a_refused_resize_leaves_the_block_alone(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    char *a = bw_alloc(&ctx, 10, 1);
    a[9] = 42;
    ctx.memory.fail_at = ctx.memory.calls + 1;
    assert_null(bw_resize(&ctx, a, 1000, 1));
    assert_int_equal(a[9], 42);
    assert_int_equal(ctx.memory.used, 10);
    bw_free(&ctx, a);
    assert_int_equal(ctx.memory.used, 0);
}

static void a_growing_array_keeps_its_items(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    int *items = NULL;
    size_t capacity = 0;
    for (size_t i = 0; i < 10000; i++) {
        kit_expect_ok(&ctx, bw_reserve(&ctx, &items, &capacity, i + 1));
        items[i] = (int)i;
    }
    for (size_t i = 0; i < 10000; i++) assert_int_equal(items[i], i);
    assert_true(ctx.memory.calls == 0 || ctx.memory.calls < 40);
    ctx.memory.limit = ctx.memory.used;
    kit_expect_status(&ctx, bw_reserve(&ctx, &items, &capacity, capacity + 1), BW_E_MEMORY);
    assert_int_equal(items[9999], 9999);
    bw_free(&ctx, items);
    assert_int_equal(ctx.memory.used, 0);
}

static void blocks_of_any_size_keep_their_bytes_and_grow_by_zeros(void **state) {
    (void)state;
    enum { STEP = 61 }; /* one byte in so many is looked at */
    bw_context ctx;
    bw_context_init(&ctx);
    kit_random random = kit_random_start(7);
    uint8_t *block = NULL;
    size_t size = 0;
    for (int i = 0; i < 60; i++) {
        size_t next = 1 + (size_t)kit_random_below(&random, i % 3 ? (uint64_t)24 << 20 : (uint64_t)5 << 20);
        if (i % 5 == 4) next = size + 1 + (size_t)kit_random_below(&random, 3000);
        block = bw_resize(&ctx, block, next, 1);
        assert_non_null(block);
        assert_int_equal(ctx.memory.used, next);
        for (size_t at = 0; at < next; at += STEP) {
            if (block[at] != (at < size ? (uint8_t)(at / STEP) | 1 : 0)) fail_msg("step %d: byte %zu of %zu, before %zu", i, at, next, size);
            block[at] = (uint8_t)(at / STEP) | 1;
        }
        for (size_t at = size; at < next; at++) block[at] = at % STEP ? 0xee : (uint8_t)(at / STEP) | 1;
        size = next;
    }
    bw_free(&ctx, block);
    assert_int_equal(ctx.memory.used, 0);
}

static void the_first_error_wins(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    assert_int_equal(bw_fail(&ctx, BW_E_INDEX, "vertex %d", 7), BW_E_INDEX);
    assert_int_equal(bw_fail(&ctx, BW_E_IO, "later"), BW_E_INDEX);
    assert_string_equal(ctx.error.message, "vertex 7");
    assert_int_equal(bw_poll(&ctx), BW_E_INDEX);
}

static void a_message_too_long_is_cut_and_ends(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_fail(&ctx, BW_E_INTERNAL, "%0900d", 1);
    assert_int_equal(strlen(ctx.error.message), sizeof ctx.error.message - 1);
}

static void elements_beyond_those_kept_are_counted(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    const double where[3] = {1, 2, 3};
    for (int i = 0; i < BW_ELEMENTS_KEPT + 10; i++) bw_fail_element(&ctx, "tet", i, i % 2 ? where : NULL);
    assert_int_equal(ctx.error.element_count, BW_ELEMENTS_KEPT + 10);
    for (int i = 0; i < BW_ELEMENTS_KEPT; i++) {
        assert_int_equal(ctx.error.elements[i].id, i);
        assert_string_equal(ctx.error.elements[i].kind, "tet");
        assert_int_equal(ctx.error.elements[i].has_position, i % 2);
    }
    assert_true(ctx.error.elements[1].position[2] == 3);
}

static double reported = -1;
static char logged[64];
static void on_progress(void *user, const char *stage, double fraction) {
    assert_string_equal(stage, user);
    reported = fraction;
}
static void on_log(void *user, const char *line) { (void)user, snprintf(logged, sizeof logged, "%s", line); }

static void callbacks_get_what_is_said(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_progress(&ctx, 0.5); /* none set: nothing happens */
    bw_log(&ctx, "x");
    ctx.progress = on_progress, ctx.log = on_log, ctx.stage = "trace", ctx.user = (char[]){"trace"};
    bw_progress(&ctx, 0.25);
    assert_true(reported == 0.25);
    bw_progress(&ctx, 7);
    assert_true(reported == 1);
    bw_log(&ctx, "%d cells", 12);
    assert_string_equal(logged, "12 cells");
}

static void cancellation_is_noticed_by_poll(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    volatile sig_atomic_t cancel = 0;
    ctx.cancel = &cancel;
    assert_int_equal(bw_poll(&ctx), BW_OK);
    cancel = 1;
    kit_expect_status(&ctx, bw_poll(&ctx), BW_E_CANCELLED);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(bytes_in_use_peak_and_limit_are_exact),
    cmocka_unit_test(sizes_that_overflow_are_refused),
    cmocka_unit_test(a_block_of_nothing_is_a_block),
    cmocka_unit_test(a_refused_resize_leaves_the_block_alone),
    cmocka_unit_test(a_growing_array_keeps_its_items),
    cmocka_unit_test(blocks_of_any_size_keep_their_bytes_and_grow_by_zeros),
    cmocka_unit_test(the_first_error_wins),
    cmocka_unit_test(a_message_too_long_is_cut_and_ends),
    cmocka_unit_test(elements_beyond_those_kept_are_counted),
    cmocka_unit_test(callbacks_get_what_is_said),
    cmocka_unit_test(cancellation_is_noticed_by_poll),
};
KIT_MAIN(tests)
