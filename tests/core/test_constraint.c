/* Pooled linear constraints: what is added can be evaluated, in one normal form. */
#include "kit/kit.h"

#include "quantize/constraint.h"

static void terms_are_sorted_summed_up_and_free_of_zeros(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_constraint_list list = {0};
    bw_term terms[] = {{7, 1}, {2, 3}, {7, -2}, {5, 4}, {5, -4}};
    assert_int_equal(bw_constraint_add(&ctx, &list, BW_RULE_LINK, BW_AT_LEAST, terms, 5, 1), BW_OK);
    assert_int_equal(list.count, 1);
    assert_int_equal(list.begin[1], 2);
    assert_int_equal(list.term[0].arc, 2);
    assert_int_equal(list.term[0].factor, 3);
    assert_int_equal(list.term[1].arc, 7);
    assert_int_equal(list.term[1].factor, -1);
    bw_constraint_clear(&ctx, &list);
    assert_int_equal(ctx.memory.used, 0);
}

static void constraints_hold_exactly_from_their_bound_on(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_constraint_list list = {0}, copy = {0};
    bw_term sum[] = {{0, 1}, {1, 1}}, difference[] = {{0, 1}, {1, -1}}, *nothing = NULL;
    assert_int_equal(bw_constraint_add(&ctx, &list, BW_RULE_EXTENT, BW_AT_LEAST, sum, 2, 3), BW_OK);
    assert_int_equal(bw_constraint_add(&ctx, &list, BW_RULE_RECTANGLE, BW_EQUAL, difference, 2, 1), BW_OK);
    assert_int_equal(bw_constraint_add(&ctx, &list, BW_RULE_LINK, BW_AT_LEAST, nothing, 0, 0), BW_OK);
    assert_int_equal(bw_constraint_first_broken(&list, (const int64_t[]){2, 1}), 3);
    assert_int_equal(bw_constraint_first_broken(&list, (const int64_t[]){1, 1}), 0);
    assert_int_equal(bw_constraint_first_broken(&list, (const int64_t[]){3, 1}), 1);
    assert_int_equal(bw_constraint_value(&list, 1, (const int64_t[]){3, 1}), 2);
    assert_int_equal(bw_constraint_copy(&ctx, &copy, &list, 1), BW_OK);
    assert_true(bw_constraint_holds(&copy, 0, (const int64_t[]){5, 4}));
    assert_false(bw_constraint_holds(&copy, 0, (const int64_t[]){4, 5}));
    assert_int_equal(copy.rule[0], BW_RULE_RECTANGLE);
    bw_constraint_clear(&ctx, &list);
    bw_constraint_clear(&ctx, &copy);
    assert_int_equal(ctx.memory.used, 0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(terms_are_sorted_summed_up_and_free_of_zeros),
    cmocka_unit_test(constraints_hold_exactly_from_their_bound_on),
};
KIT_MAIN(tests)
