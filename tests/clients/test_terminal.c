/* Progress is one redrawn line on a terminal and plain lines elsewhere; an interrupt cancels a run. */
#include <errno.h>
#include <pty.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "kit/kit.h"

enum { TEXT_MAX = 1 << 20 };

static const char *small, *large;

static void sample(const char *path, const char *size) {
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "ball", "--noise", "0.5",
                                            "--size", size, "-o", path, NULL});
    if (r.exit != 0) fail_msg("sample: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
}

/* Runs `blockwright run` on `input` with a terminal; returns all it showed. free() it. */
static char *run_on_terminal(const char *input, const char *out, int *exit_code) {
    const char *program = kit_program("blockwright");
    int terminal, status;
    size_t used = 0;
    char *text = malloc(TEXT_MAX);
    fflush(NULL);
    pid_t child = forkpty(&terminal, NULL, NULL, &(struct winsize){.ws_row = 24, .ws_col = 100});
    if (child < 0) fail_msg("forkpty failed: %s", strerror(errno));
    if (child == 0) {
        setenv("TERM", "xterm", 1);
        execl(program, program, "run", input, "--out", out, (char *)NULL);
        _exit(127);
    }
    for (ssize_t n; used < TEXT_MAX - 1; used += (size_t)n) /* the end of the child shows as EIO */
        if ((n = read(terminal, text + used, TEXT_MAX - 1 - used)) <= 0) break;
    text[used] = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
    close(terminal);
    *exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return text;
}

static void on_a_terminal_one_line_is_redrawn_and_then_gone(void **state) {
    (void)state;
    int exit_code;
    char *text = run_on_terminal(small, kit_temp_path("tty"), &exit_code);
    assert_int_equal(exit_code, 0);
    assert_non_null(strstr(text, "\r\033[Ksanitize "));
    assert_non_null(strstr(text, " %  "));
    assert_null(strstr(text, " s] sanitize"));
    /* What follows the last redrawing is the summary, on a clean line. */
    const char *last = text;
    for (const char *at = text; (at = strstr(at, "\r\033[K")); at++) last = at;
    assert_memory_equal(last, "\r\033[Kinput ", 10);
    free(text);
}

static void elsewhere_each_stage_is_one_plain_line(void **state) {
    (void)state;
    static const char *const stages[] = {"sanitize", "trace", "build", "encode"};
    const char *out = kit_temp_path("plain");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", small, "--out", out, NULL});
    assert_int_equal(r.exit, 0);
    assert_null(strchr(r.err, '\r'));
    assert_null(strchr(r.err, '\033'));
    const char *at = r.err;
    for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
        char line[64];
        snprintf(line, sizeof line, " s] %s\n", stages[i]);
        at = strstr(at, line);
        if (!at) fail_msg("no line for %s, or out of order:\n%s", stages[i], r.err);
        at += strlen(line);
    }
    assert_int_equal(*at, 0);
    kit_result_clear(&r);
}

static void quiet_says_nothing_at_all(void **state) {
    (void)state;
    const char *out = kit_temp_path("quiet");
    kit_result r =
        kit_run((const char *[]){kit_program("blockwright"), "run", small, "--out", out, "--quiet", NULL});
    assert_int_equal(r.exit, 0);
    assert_int_equal(r.out_size, 0);
    assert_int_equal(r.err_size, 0);
    kit_result_clear(&r);
}

static void the_summary_tells_the_counts_and_the_files(void **state) {
    (void)state;
    static const char *const says[] = {
        " vertices, ",      " tets, ",           " singular edges",  "parameters moved by at most ",
        " blocks, ",        " patches, ",        "\nsanitize ",      "\nencode ",
        "\n  report.json ", "\n  traced.hexex ", "\n  blocks.json ", "\n  view.drc "};
    const char *out = kit_temp_path("summary");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", small, "--out", out, NULL});
    kit_result again = kit_run((const char *[]){kit_program("blockwright"), "show", out, NULL});
    assert_int_equal(r.exit, 0);
    for (size_t i = 0; i < sizeof says / sizeof *says; i++)
        if (!strstr(r.out, says[i])) fail_msg("the summary lacks '%s':\n%s", says[i], r.out);
    assert_int_equal(again.exit, 0);
    assert_string_equal(r.out, again.out);
    kit_result_clear(&r);
    kit_result_clear(&again);
}

/* The interrupt comes when the first stage has been announced. A machine so fast that the run ends first is
 * believed only if the results are there. */
static void an_interrupt_cancels_the_run(void **state) {
    (void)state;
    const char *program = kit_program("blockwright"), *out = kit_temp_path("cancelled");
    int pipe_end[2], status;
    char text[4096];
    size_t used = 0;
    assert_int_equal(pipe(pipe_end), 0);
    fflush(NULL);
    pid_t child = fork();
    if (child == 0) {
        dup2(pipe_end[1], 2);
        close(pipe_end[0]);
        execl(program, program, "run", large, "--out", out, (char *)NULL);
        _exit(127);
    }
    close(pipe_end[1]);
    bool sent = false;
    for (ssize_t n; used < sizeof text - 1; used += (size_t)n) {
        if ((n = read(pipe_end[0], text + used, sizeof text - 1 - used)) <= 0) break;
        if (!sent) kill(child, SIGINT);
        sent = true;
    }
    text[used] = 0;
    close(pipe_end[0]);
    while (waitpid(child, &status, 0) < 0 && errno == EINTR) continue;
    assert_true(sent);
    assert_true(WIFEXITED(status));
    if (WEXITSTATUS(status) == 0) {
        assert_true(kit_exists(kit_temp_path("cancelled/traced.hexex")));
    } else {
        assert_int_equal(WEXITSTATUS(status), 4);
        assert_non_null(strstr(text, "[cancelled]"));
    }
}

static int start(void **state) {
    (void)state;
    small = kit_temp_path("small.hexex");
    large = kit_temp_path("large.hexex");
    sample(small, "2");
    sample(large, "7");
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(on_a_terminal_one_line_is_redrawn_and_then_gone),
        cmocka_unit_test(elsewhere_each_stage_is_one_plain_line),
        cmocka_unit_test(quiet_says_nothing_at_all),
        cmocka_unit_test(the_summary_tells_the_counts_and_the_files),
        cmocka_unit_test(an_interrupt_cancels_the_run),
    };
    return kit_exit(cmocka_run_group_tests(tests, start, NULL), sizeof tests / sizeof *tests);
}
