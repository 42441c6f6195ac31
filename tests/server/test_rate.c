/* How often an owner may ask: over any time no more than the rate and a burst, never less than the rate, and nobody pays for another. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include <cmocka.h>

#include "server/http/rate.h"

enum { SECOND = 1000000 };

static void over_any_time_it_is_the_rate_and_a_burst(void **state) {
    (void)state;
    for (int rate = 1; rate <= 10000; rate *= 10) {
        bw_rates *r = bw_rates_open();
        int64_t now = 77, taken = 0, each = SECOND / rate;
        srand((unsigned)rate);
        for (int i = 0; i < 100000; i++) {
            taken += bw_rates_ask(r, "ann", rate, now) == 0;
            assert_in_range(taken, 1, (now - 77) / each + (int64_t)BW_RATE_BURST_SECONDS * rate);
            now += rand() % (2 * each); /* on the average at the rate */
        }
        assert_in_range(taken, 90000, 100000);
        bw_rates_close(r);
    }
}

static void who_asks_no_faster_is_never_refused(void **state) {
    (void)state;
    bw_rates *r = bw_rates_open();
    for (int64_t i = 0; i < 10000; i++) assert_int_equal(bw_rates_ask(r, "ann", 100, i * SECOND / 100), 0);
    bw_rates_close(r);
}

static void a_refusal_says_when_and_costs_nothing(void **state) {
    (void)state;
    bw_rates *r = bw_rates_open();
    int64_t now = 5 * SECOND, wait;
    for (int i = 0; i < 10 * BW_RATE_BURST_SECONDS; i++) assert_int_equal(bw_rates_ask(r, "ann", 10, now), 0);
    for (int i = 0; i < 1000; i++) assert_int_equal(bw_rates_ask(r, "ann", 10, now), SECOND / 10);
    for (int i = 0; i < 100; i++) {
        assert_true((wait = bw_rates_ask(r, "ann", 10, now)) > 0);
        assert_true(bw_rates_ask(r, "ann", 10, now + wait - 1) == 1);
        assert_int_equal(bw_rates_ask(r, "ann", 10, now += wait), 0);
    }
    bw_rates_close(r);
}

static void owners_do_not_pay_for_each_other_and_are_forgotten(void **state) {
    (void)state;
    bw_rates *r = bw_rates_open();
    char name[20];
    while (bw_rates_ask(r, "greedy", 1, 0) == 0) continue;
    for (int i = 0; i < 5000; i++) {
        snprintf(name, sizeof name, "owner%d", i);
        assert_int_equal(bw_rates_ask(r, name, 1, 0), 0);
    }
    assert_true(bw_rates_ask(r, "greedy", 1, 0) > 0);
    assert_int_equal(bw_rates_known(r), 5001);
    for (int i = 0; i < 5000; i++) { /* a day later others come */
        snprintf(name, sizeof name, "later%d", i);
        assert_int_equal(bw_rates_ask(r, name, 1, INT64_C(86400) * SECOND), 0);
    }
    assert_int_equal(bw_rates_known(r), 5000);
    bw_rates_close(r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(over_any_time_it_is_the_rate_and_a_burst),
        cmocka_unit_test(who_asks_no_faster_is_never_refused),
        cmocka_unit_test(a_refusal_says_when_and_costs_nothing),
        cmocka_unit_test(owners_do_not_pay_for_each_other_and_are_forgotten),
    };
    return cmocka_run_group_tests_name("rate", tests, NULL, NULL);
}
