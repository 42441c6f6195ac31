/* Memory among stages: what may start beside what. */
#include "kit/kit.h"

#include <string.h>

#include "server/worker/admission.h"

static bool start(bw_admission *a, const char *job, uint64_t need, int64_t now) {
    bool may = bw_admission_ask(a, job, need, now);
    if (may) bw_admission_take(a, need);
    return may;
}

static void needs_add_up_to_no_more_than_the_memory(void **state) {
    (void)state;
    bw_admission a = {.memory = 100};
    assert_true(start(&a, "a", 60, 0));
    assert_true(start(&a, "b", 40, 0));
    assert_false(start(&a, "c", 1, 0));
    bw_admission_give(&a, 40);
    assert_true(start(&a, "c", 1, 0));
    assert_int_equal(a.taken, 61);
}

static void one_that_needs_more_than_all_runs_alone(void **state) {
    (void)state;
    bw_admission a = {.memory = 100};
    assert_true(start(&a, "big", 1000, 0));
    assert_false(start(&a, "small", 1, 0));
    bw_admission_give(&a, 1000);
    assert_true(start(&a, "small", 1, 0));
    assert_false(start(&a, "big", 1000, 0));
}

static void who_waits_is_passed_for_a_while_only(void **state) {
    (void)state;
    bw_admission a = {.memory = 100};
    assert_true(start(&a, "first", 60, 0));
    assert_false(start(&a, "big", 80, 0));
    assert_true(start(&a, "small", 10, 20000));  /* passes */
    assert_false(start(&a, "small2", 10, 30000)); /* not any more */
    bw_admission_give(&a, 60);
    assert_false(start(&a, "small2", 10, 31000));
    assert_true(start(&a, "big", 80, 31000));
    assert_true(start(&a, "small2", 10, 31000));
}

static void who_does_not_wait_any_more_holds_nobody(void **state) {
    (void)state;
    bw_admission a = {.memory = 100};
    assert_true(start(&a, "first", 60, 0));
    bw_admission_begin(&a);
    assert_false(start(&a, "big", 80, 0));
    bw_admission_end(&a, true);
    bw_admission_begin(&a); /* cancelled: it is not asked for */
    assert_false(start(&a, "small", 10, 40000));
    bw_admission_end(&a, false); /* not all were looked at, so it may wait still */
    assert_false(start(&a, "small", 10, 40000));
    bw_admission_begin(&a);
    bw_admission_end(&a, true);
    assert_true(start(&a, "small", 10, 40000));
}

static void compact_formats_need_more_memory_a_byte(void **state) {
    (void)state;
    static const char *const starts[] = {"8\n0 0 0\n", "MeshVersionFormatted 2\n", "# vtk DataFile Version 2.0\nx\nBINARY\n",
                                         "<VTKFile type=\"UnstructuredGrid\" compressor=\"vtkZLibDataCompressor\">"};
    uint64_t before = 0;
    for (size_t i = 0; i < 4; i++) {
        uint64_t need = bw_need_of_input(starts[i], strlen(starts[i]), 1000000);
        assert_true(need > before);
        before = need;
    }
    assert_true(bw_need_of_input("", 0, 0) > 0);
    assert_true(bw_machine_memory() > (uint64_t)100 << 20);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(needs_add_up_to_no_more_than_the_memory),
    cmocka_unit_test(one_that_needs_more_than_all_runs_alone),
    cmocka_unit_test(who_waits_is_passed_for_a_while_only),
    cmocka_unit_test(who_does_not_wait_any_more_holds_nobody),
    cmocka_unit_test(compact_formats_need_more_memory_a_byte),
};
KIT_MAIN(tests)
