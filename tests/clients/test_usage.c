/* The command line is understood or refused with exit code 2 and a hint; its help teaches. */
#include <stdio.h>
#include <string.h>

#include "kit/kit.h"

enum { WORDS = 10 };

static kit_result blockwright(const char *const words[]) {
    const char *argv[WORDS + 2] = {kit_program("blockwright")};
    for (int i = 0; i < WORDS && words[i]; i++) argv[i + 1] = words[i];
    return kit_run(argv);
}

static const struct {
    const char *words[WORDS];
    const char *says; /* on standard error */
} mistakes[] = {
    {{NULL}, "Usage: blockwright"},
    {{"rum"}, "did you mean 'run'?"},
    {{"frobnicate"}, "there is no command 'frobnicate'"},
    {{"help", "frobnicate"}, "there is no command 'frobnicate'"},
    {{"--frobnicate"}, "unknown option '--frobnicate'"},
    {{"run"}, "something is missing"},
    {{"run", "a", "b", "--out", "d"}, "'b' is one word too many"},
    {{"run", "a"}, "--out DIR"},
    {{"run", "a", "--out"}, "--out needs a value"},
    {{"run", "a", "--out", "d", "--theads", "2"}, "did you mean '--threads'?"},
    {{"run", "a", "--out", "d", "-x"}, "unknown option '-x'"},
    {{"run", "a", "--out", "d", "--threads", "0"}, "--threads takes a whole number"},
    {{"run", "a", "--out", "d", "--threads", "2x"}, "--threads takes a whole number"},
    {{"run", "a", "--out", "d", "--threads="}, "--threads takes a whole number"},
    {{"run", "a", "--out", "d", "--tolerance", "nan"}, "--tolerance takes a number"},
    {{"run", "a", "--out", "d", "--memory", "4Q"}, "--memory takes a number of bytes"},
    {{"run", "a", "--out", "d", "--memory", "-1"}, "--memory takes a number of bytes"},
    {{"run", "a", "--out", "d", "--memory", "99999999999T"}, "--memory takes a number of bytes"},
    {{"run", "a", "--out", "d", "--complex", "m"}, "--complex is one of mc|bc|serial, not 'm'"},
    {{"run", "a", "--out", "d", "--complex", "mc|bc"}, "--complex is one of mc|bc|serial"},
    {{"run", "a", "--out", "d", "--tolerance", "0.5"}, "tolerance is a number"},
    {{"run", "a", "--out", "d", "--until", "lunch"}, "--until is one of sanitize"},
    {{"run", "a", "--out", "d", "--quiet=yes"}, "--quiet takes no value"},
    {{"run", "a", "--out", "d", "--quantize", "foo"}, "--quantize is one of none|positive|nonnegative|any, not 'foo'"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--scale", "-1"}, "--scale takes a number from"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--scale", "nan"}, "--scale takes a number from"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--target-hexes", "0"}, "--target-hexes takes a whole number from 1"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--scales", "1,nan"}, "--scales wants numbers"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--scales", "1,-1"}, "option scales is a list"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--hex-formats", "vtu,stl"}, "option hex_formats is a list"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--hex-formats", "vtu,"}, "option hex_formats is a list"},
    {{"run", "a", "--out", "d", "--bwh-bits", "25"}, "--bwh-bits takes a whole number from 1 to 24"},
    {{"run", "a", "--out", "d", "--kind", "quad"}, "--kind is one of auto|tet|hex, not 'quad'"},
    {{"run", "a", "--out", "d", "--quantize", "any", "--scale", "2", "--coarsest"}, "only one of --scale"},
    {{"run", "a", "--out", "d", "--scale", "2"}, "wants --quantize positive, nonnegative or any"},
    {{"run", "a", "--out", "d", "--smooth", "off"}, "wants --quantize positive, nonnegative or any"},
    {{"run", "a", "--out", "d", "--quantize", "none", "--rounding"}, "wants --quantize positive, nonnegative or any"},
    {{"sample"}, "which sample?"},
    {{"sample", "teapot"}, "there is no sample 'teapot'"},
    {{"sample", "cuboid", "--size", "0"}, "--size takes a whole number"},
    {{"sample", "cuboid", "--scramble", "all"}, "--scramble is one of"},
    {{"submit"}, "something is missing"},
    {{"submit", "a", "--until", "lunch"}, "--until is one of"},
    {{"watch", "../jobs"}, "is not a job id"},
    {{"fetch", "0123"}, "--out DIR"},
    {{"cancel"}, "something is missing"},
    {{"finish"}, "something is missing"},
    {{"submit", "a", "--priority", "101"}, "--priority takes a whole number from -100 to 100"},
    {{"submit", "a", "--idempotency-key", "a b"}, "visible ASCII"},
    {{"retry"}, "something is missing"},
    {{"rm", "../jobs"}, "is not a job id"},
    {{"submit", "a", "--limit-memory", "0"}, "--limit-memory takes a number of bytes"},
    {{"submit", "a", "--limit-scratch", "1Q"}, "--limit-scratch takes a number of bytes"},
    {{"submit", "a", "--limit-cpu", "0"}, "--limit-cpu takes a whole number from 1"},
    {{"submit", "a", "--limit-wall", "1.5"}, "--limit-wall takes a whole number from 1"},
    {{"submit", "a", "--limit-job-wall", "0"}, "--limit-job-wall takes a whole number from 1"},
    {{"pin"}, "something is missing"},
    {{"unpin", "../jobs"}, "is not a job id"},
    {{"submit", "a", "--pinn"}, "did you mean '--pin'?"},
    {{"ls", "x"}, "one word too many"},
    {{"capabilities", "x"}, "one word too many"},
    {{"capabilities", "--jsn"}, "did you mean '--json'?"},
    {{"ls", "--state", "asleep"}, "--state is one of"},
};

static void a_mistaken_command_line_ends_with_2_and_says_why(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof mistakes / sizeof *mistakes; i++) {
        kit_result r = blockwright(mistakes[i].words);
        if (r.exit != 2 || !strstr(r.err, mistakes[i].says) || r.out_size)
            fail_msg("mistake %zu (%s ...): exit %d, expected '%s', standard error:\n%s", i,
                     mistakes[i].words[0] ? mistakes[i].words[0] : "", r.exit, mistakes[i].says, r.err);
        if (!strstr(r.err, "help")) fail_msg("mistake %zu does not lead to the help:\n%s", i, r.err);
        kit_result_clear(&r);
    }
}

static const char *const commands[] = {"run",   "sample", "show", "submit", "watch",
                                       "fetch", "finish", "cancel", "retry", "rm", "pin", "unpin", "ls", "log", "capabilities"};

static void every_command_explains_itself_with_examples(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) {
        kit_result by_name = blockwright((const char *[]){"help", commands[i], NULL});
        kit_result by_option = blockwright((const char *[]){commands[i], "--help", NULL});
        assert_int_equal(by_name.exit, 0);
        assert_int_equal(by_option.exit, 0);
        assert_string_equal(by_name.out, by_option.out);
        assert_int_equal(by_name.err_size, 0);
        if (!strstr(by_name.out, "Examples:\n  blockwright ") || !strstr(by_name.out, "Exit codes:"))
            fail_msg("the help of %s lacks examples or exit codes:\n%s", commands[i], by_name.out);
        kit_result_clear(&by_name);
        kit_result_clear(&by_option);
    }
}

static void the_help_lists_every_command(void **state) {
    (void)state;
    kit_result r = blockwright((const char *[]){"--help", NULL});
    assert_int_equal(r.exit, 0);
    for (size_t i = 0; i < sizeof commands / sizeof *commands; i++) {
        char line[32];
        snprintf(line, sizeof line, "\n  %-12s ", commands[i]);
        if (!strstr(r.out, line)) fail_msg("the help does not list %s:\n%s", commands[i], r.out);
    }
    kit_result_clear(&r);
}

static void the_version_is_printed(void **state) {
    (void)state;
    kit_result r = blockwright((const char *[]){"--version", NULL});
    int major, minor, patch;
    assert_int_equal(r.exit, 0);
    assert_int_equal(sscanf(r.out, "blockwright %d.%d.%d", &major, &minor, &patch), 3);
    kit_result_clear(&r);
}

static void a_daemon_that_is_not_there_is_exit_5(void **state) {
    (void)state;
    const char *file = kit_temp_path("any.txt");
    kit_write_text(file, "any\n");
    const char *const calls[][4] = {
        {"submit", file, "--server=http://127.0.0.1:1", NULL},
        {"watch", "0123456789abcdef01234567", "--server=http://127.0.0.1:1", NULL},
        {"ls", "--server=http://127.0.0.1:1/", NULL},
        {"capabilities", "--server=http://127.0.0.1:1", NULL}};
    for (size_t i = 0; i < sizeof calls / sizeof *calls; i++) {
        kit_result r = blockwright(calls[i]);
        assert_int_equal(r.exit, 5);
        assert_non_null(strstr(r.err, "http://127.0.0.1:1 does not answer"));
        kit_result_clear(&r);
    }
}

static void results_that_cannot_be_written_to_are_not_success(void **state) {
    (void)state;
    if (!kit_exists("/dev/full")) kit_skip("/dev/full is not here");
    char line[512];
    snprintf(line, sizeof line, "'%s' --help >/dev/full", kit_program("blockwright"));
    kit_result r = kit_run((const char *[]){"sh", "-c", line, NULL});
    assert_int_equal(r.exit, 5);
    kit_result_clear(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_mistaken_command_line_ends_with_2_and_says_why),
        cmocka_unit_test(every_command_explains_itself_with_examples),
        cmocka_unit_test(the_help_lists_every_command),
        cmocka_unit_test(the_version_is_printed),
        cmocka_unit_test(a_daemon_that_is_not_there_is_exit_5),
        cmocka_unit_test(results_that_cannot_be_written_to_are_not_success),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
