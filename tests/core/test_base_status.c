/* The list of statuses is consistent: its words are distinct, and class, exit code and HTTP status fit each other. */
#include "kit/kit.h"

#include <string.h>

#include "base/status.h"

static void every_code_is_a_distinct_word_that_leads_back(void **state) {
    (void)state;
    for (int s = 0; s < BW_STATUS_COUNT; s++) {
        const char *code = bw_status_code((bw_status)s);
        assert_true(*code && strspn(code, "abcdefghijklmnopqrstuvwxyz-") == strlen(code));
        assert_true(*bw_status_text((bw_status)s));
        assert_int_equal(bw_status_from_code(code), s);
    }
    assert_int_equal(bw_status_from_code("no such word"), BW_E_INTERNAL);
}

static void class_exit_code_and_http_status_fit_each_other(void **state) {
    (void)state;
    assert_int_equal(bw_status_exit(BW_OK), 0);
    for (int i = BW_OK + 1; i < BW_STATUS_COUNT; i++) {
        bw_status s = (bw_status)i;
        bw_class class_ = bw_status_class(s);
        int exit = bw_status_exit(s), http = bw_status_http(s);
        assert_int_not_equal(class_, BW_CLASS_NONE);
        if (s == BW_E_USAGE) assert_int_equal(exit, 2);
        else assert_int_equal(exit, class_ == BW_CLASS_INPUT ? 3 : class_ == BW_CLASS_LIMIT ? 4 : 5);
        bool ours = class_ == BW_CLASS_ALGORITHM || class_ == BW_CLASS_SYSTEM;
        assert_true(ours ? http >= 500 && http < 600 : http >= 400 && http < 500);
    }
}

static void numbers_that_are_no_status_are_internal_errors(void **state) {
    (void)state;
    assert_string_equal(bw_status_code((bw_status)-1), "internal");
    assert_string_equal(bw_status_code((bw_status)1000), "internal");
    assert_string_equal(bw_class_name((bw_class)99), "system");
    assert_string_equal(bw_class_name(BW_CLASS_INPUT), "input");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_code_is_a_distinct_word_that_leads_back),
    cmocka_unit_test(class_exit_code_and_http_status_fit_each_other),
    cmocka_unit_test(numbers_that_are_no_status_are_internal_errors),
};
KIT_MAIN(tests)
