/* Which limit of time counts: the stage's, or what is left of the job's. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include <cmocka.h>

#include "server/limits.h"

static const bw_config config = {.stage_memory = 1000, .stage_scratch = 5000, .stage_output = 3000, .stage_cpu_seconds = 60, .stage_wall_seconds = 100};
static const bw_spent nothing;

static void expect(const bw_time_limit *l, const char *what, uint64_t allowed, int64_t left_ms) {
    assert_string_equal(l->what, what);
    assert_int_equal(l->allowed, allowed);
    assert_int_equal(l->left_ms, left_ms);
}

static void without_a_limit_of_the_job_every_stage_has_its_own(void **state) {
    (void)state;
    const bw_spent much = {INT64_MAX / 2, INT64_MAX / 2};
    bw_stage_limits l = bw_stage_limits_of(&config, NULL, &nothing);
    expect(&l.cpu, "cpu_seconds", 60, 60000);
    expect(&l.wall, "wall_seconds", 100, 100000);
    l = bw_stage_limits_of(&config, "{\"wall_seconds\":7}", &much);
    expect(&l.cpu, "cpu_seconds", 60, 60000);
    expect(&l.wall, "wall_seconds", 7, 7000);
}

static void the_lesser_of_the_stages_and_of_what_is_left_counts(void **state) {
    (void)state;
    static const struct {
        int64_t spent_ms;
        const char *what;
        uint64_t allowed;
        int64_t left_ms;
    } cases[] = {{0, "wall_seconds", 100, 100000}, {200000, "wall_seconds", 100, 100000}, {200001, "job_wall_seconds", 300, 99999},
                 {299999, "job_wall_seconds", 300, 1}, {300000, "job_wall_seconds", 300, 0}, {900000, "job_wall_seconds", 300, 0}};
    bw_config c = config;
    c.job_wall_seconds = 300;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        bw_stage_limits l = bw_stage_limits_of(&c, NULL, &(bw_spent){.wall_ms = cases[i].spent_ms, .cpu_ms = 1000000});
        expect(&l.wall, cases[i].what, cases[i].allowed, cases[i].left_ms);
        expect(&l.cpu, "cpu_seconds", 60, 60000);
    }
}

static void a_job_may_ask_for_less_in_all_and_not_for_more(void **state) {
    (void)state;
    bw_config c = config;
    bw_stage_limits l = bw_stage_limits_of(&c, "{\"job_cpu_seconds\":20}", &(bw_spent){.cpu_ms = 500});
    expect(&l.cpu, "job_cpu_seconds", 20, 19500);
    c.job_cpu_seconds = 10;
    l = bw_stage_limits_of(&c, "{\"job_cpu_seconds\":20}", &(bw_spent){.cpu_ms = 500});
    expect(&l.cpu, "job_cpu_seconds", 10, 9500);
    l = bw_stage_limits_of(&c, "{\"job_cpu_seconds\":9223372036854775807}", &nothing);
    expect(&l.cpu, "job_cpu_seconds", 10, 10000);
    c.job_cpu_seconds = 0;
    l = bw_stage_limits_of(&c, "{\"job_cpu_seconds\":9223372036854775807}", &nothing);
    expect(&l.cpu, "cpu_seconds", 60, 60000);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(without_a_limit_of_the_job_every_stage_has_its_own),
        cmocka_unit_test(the_lesser_of_the_stages_and_of_what_is_left_counts),
        cmocka_unit_test(a_job_may_ask_for_less_in_all_and_not_for_more),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
