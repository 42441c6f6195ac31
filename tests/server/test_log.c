/* The log (server/log.h): what its lines look like, read back by jansson and by hand. */
#include "kit/kit.h"

#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/log.h"

/* Runs `say` with stderr in a file; returns what was written, with the last newline cut off. */
static char *caught(void (*say)(void)) {
    const char *path = kit_temp_path("log");
    int kept = dup(2);
    assert_non_null(freopen(path, "w", stderr));
    say();
    dup2(kept, 2);
    close(kept);
    size_t size;
    char *text = kit_read_file(path, &size);
    if (size) {
        assert_int_equal(text[size - 1], '\n');
        text[size - 1] = '\0';
    }
    return text;
}

static json_t *caught_json(void (*say)(void)) {
    char *text = caught(say);
    json_error_t error;
    json_t *line = json_loads(text, JSON_REJECT_DUPLICATES, &error);
    if (!line) fail_msg("%s: %s", error.text, text);
    free(text);
    return line;
}

static const char *text_of(json_t *line, const char *name) {
    const char *text = json_string_value(json_object_get(line, name));
    if (!text) fail_msg("no string %s", name);
    return text;
}

static void say_numbers(void) {
    bw_event(BW_INFO, "a.b", "job=%s n=%d big=%lld size=%zu code=%u name=\"%s\" ratio=%.2f", "123456", -7, 1234567890123LL, (size_t)9, 4u,
             "two words", 0.5);
}

static void a_line_is_logfmt_at_first(void **state) {
    (void)state;
    char *text = caught(say_numbers);
    assert_true(strncmp(text, "time=", 5) == 0);
    assert_non_null(strstr(text, " level=info event=a.b job=123456 n=-7 big=1234567890123 size=9 code=4 name=\"two words\" ratio=0.50"));
    free(text);
}

static void members_are_numbers_where_the_format_has_numbers(void **state) {
    (void)state;
    bw_log_configure(BW_INFO, BW_LOG_JSON);
    json_t *line = caught_json(say_numbers);
    assert_string_equal(text_of(line, "level"), "info");
    assert_string_equal(text_of(line, "event"), "a.b");
    assert_string_equal(text_of(line, "job"), "123456"); /* digits, and yet a word */
    assert_int_equal(json_integer_value(json_object_get(line, "n")), -7);
    assert_int_equal(json_integer_value(json_object_get(line, "big")), 1234567890123LL);
    assert_int_equal(json_integer_value(json_object_get(line, "size")), 9);
    assert_int_equal(json_integer_value(json_object_get(line, "code")), 4);
    assert_string_equal(text_of(line, "name"), "two words");
    assert_string_equal(text_of(line, "ratio"), "0.50");
    assert_int_equal(json_object_size(line), 10);
    json_decref(line);
}

static const char hostile[] = "a \"b\" c\\d\ne=f\tg\x7f \xc3\xa9 \xff\xc3 }{";
static void say_hostile(void) {
    char quoted[200];
    bw_event(BW_WARN, "x.y", "before=%d text=%s after=%s", 1, bw_quoted(hostile, quoted, sizeof quoted), "end");
}

static void hostile_text_comes_back_as_it_was_and_forges_nothing(void **state) {
    (void)state;
    bw_log_configure(BW_INFO, BW_LOG_JSON);
    json_t *line = caught_json(say_hostile);
    assert_string_equal(text_of(line, "text"), "a \"b\" c\\d\ne=f\tg\x7f \xc3\xa9 \xef\xbf\xbd\xef\xbf\xbd }{");
    assert_string_equal(text_of(line, "after"), "end");
    assert_int_equal(json_object_size(line), 6);
    json_decref(line);
    bw_log_configure(BW_INFO, BW_LOGFMT);
    char *text = caught(say_hostile);
    assert_null(strchr(text, '\n'));
    free(text);
}

static size_t long_size;
static void say_long(void) {
    char *raw = calloc(1, long_size + 1), *quoted = malloc(long_size + 20);
    for (size_t i = 0; i < long_size; i++) raw[i] = "ab\"\\\n"[i % 5];
    bw_event(BW_WARN, "x.y", "text=%s n=%d", bw_quoted(raw, quoted, long_size + 20), 5);
    free(raw);
    free(quoted);
}

static void a_line_that_is_cut_is_still_json_whatever_its_length(void **state) {
    (void)state;
    bw_log_configure(BW_INFO, BW_LOG_JSON);
    for (long_size = 700; long_size < 2200; long_size += long_size < 1900 ? 37 : 1) json_decref(caught_json(say_long));
}

static void say_all_levels(void) {
    bw_event(BW_DEBUG, "e.debug", "%s", "");
    bw_event(BW_INFO, "e.info", "%s", "");
    bw_event(BW_WARN, "e.warn", "%s", "");
    bw_event(BW_ERROR, "e.error", "%s", "");
}

static void levels_below_the_least_are_not_logged(void **state) {
    (void)state;
    for (int least = BW_DEBUG; least <= BW_ERROR; least++) {
        bw_log_configure((bw_level)least, BW_LOGFMT);
        char *text = caught(say_all_levels);
        static const char *const events[] = {"e.debug", "e.info", "e.warn", "e.error"};
        for (int level = BW_DEBUG; level <= BW_ERROR; level++)
            assert_int_equal(strstr(text, events[level]) != NULL, level >= least);
        free(text);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_line_is_logfmt_at_first),
    cmocka_unit_test(members_are_numbers_where_the_format_has_numbers),
    cmocka_unit_test(hostile_text_comes_back_as_it_was_and_forges_nothing),
    cmocka_unit_test(a_line_that_is_cut_is_still_json_whatever_its_length),
    cmocka_unit_test(levels_below_the_least_are_not_logged),
};
KIT_MAIN(tests)
