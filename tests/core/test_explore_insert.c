/* Serial insertion: whatever the order, the blocks that are counted are those of the complex that has these walls; moving a sheet is the same as
 * inserting all in the new order. */
#include "core/explore_kit.h"

static void the_space_of_every_model_is_consistent(void **state) {
    (void)state;
    for (int i = 0; i < EXPLORE_CASES; i++) {
        explorable e;
        explorable_open(&e, &explore_cases[i]);
        kit_expect_ok(&e.model.ctx, bw_space_check(&e.model.ctx, &e.space));
        print_message("%-14s blocks %zu patches %zu lines %zu sheets %zu crossings %zu (+ %zu open) links %zu components %zu variable %zu\n", explore_cases[i].model,
                      e.space.block_count, e.space.patch_count, e.space.line_count, e.space.sheet_count, e.space.crossings, e.space.crossings_open,
                      bw_space_links(&e.space), e.space.component_count, e.space.variable_patches);
        explorable_close(&e);
    }
}

static void blocks_counted_are_blocks_built(void **state) {
    (void)state;
    for (int i = 0; i < EXPLORE_CASES; i++) {
        explorable e;
        explorable_open(&e, &explore_cases[i]);
        kit_random random = kit_random_start((uint64_t)i);
        for (int round = 0; round < 12; round++) {
            if (round) explorable_shuffle(&e, &random);
            bw_serial_insert(&e.serial, e.order);
            bw_serial_walls(&e.serial, e.wall);
            assert_true(bw_regions_close(&e.regions, e.wall));
            size_t built = explorable_build(&e, e.wall);
            if (built != e.regions.count) fail_msg("%s, round %d: %zu blocks counted, %zu built", e.model.name, round, e.regions.count, built);
        }
        explorable_close(&e);
    }
}

static void moving_a_sheet_is_inserting_in_the_new_order(void **state) {
    (void)state;
    for (int i = 0; i < EXPLORE_CASES; i++) {
        explorable e;
        bw_serial again;
        explorable_open(&e, &explore_cases[i]);
        size_t n = e.space.sheet_count;
        kit_random random = kit_random_start(100 + (uint64_t)i);
        kit_expect_ok(&e.model.ctx, bw_serial_init(&e.model.ctx, &e.space, &again));
        bw_serial_insert(&e.serial, e.order);
        for (int round = 0; round < 300 && n > 1; round++) {
            bw_sheet sheet = (bw_sheet)kit_random_below(&random, n), other = (bw_sheet)kit_random_below(&random, n);
            if (round % 2 && other != sheet) bw_serial_move_before(&e.serial, sheet, other);
            else bw_serial_move_to(&e.serial, sheet, kit_random_below(&random, n));
            bw_serial_insert(&again, e.serial.order);
            assert_memory_equal(again.reached, e.serial.reached, e.space.sheet_begin[n]);
            assert_int_equal(again.hash, e.serial.hash);
            for (size_t p = 0; p < e.space.patch_count; p++) assert_int_equal(again.first[p] == BW_OPEN, e.serial.first[p] == BW_OPEN);
        }
        bw_serial_clear(&e.model.ctx, &again);
        explorable_close(&e);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_space_of_every_model_is_consistent),
        cmocka_unit_test(blocks_counted_are_blocks_built),
        cmocka_unit_test(moving_a_sheet_is_inserting_in_the_new_order),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
