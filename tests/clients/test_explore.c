/* A run that explores can be asked for what it has: SIGUSR1 ends the search, and the job, with the best found, which is a result like any other. */
#include "clients/daemon.h"

#include <jansson.h>

/* Waits until a file has a word. */
static void wait_for(const char *path, const char *word) {
    for (int i = 0; i < 3000; i++) {
        char *text = kit_exists(path) ? kit_read_file(path, NULL) : NULL;
        bool there = text && strstr(text, word);
        free(text);
        if (there) return;
        daemon_nap();
    }
    fail_msg("%s never said \"%s\"", path, word);
}

static void a_search_asked_to_finish_ends_with_the_best_found(void **state) {
    (void)state;
    const char *input = kit_temp_path("bearing.hexex"), *out = kit_temp_path("out"), *log = kit_temp_path("run.log");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "bearing", "--size", "2", "-o", input, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    fflush(NULL);
    pid_t process = fork();
    assert_true(process >= 0);
    if (process == 0) {
        int fd = open(log, O_WRONLY | O_CREAT | O_TRUNC, 0600);
        dup2(fd, 1), dup2(fd, 2);
        execl(kit_program("blockwright"), "blockwright", "run", input, "--out", out, "--explore", "anneal", "--explore-work", "1000000000", "--explore-time", "3000",
              "--verbose", (char *)NULL);
        _exit(127);
    }
    wait_for(log, "blocks");
    int status = 0;
    kill(process, SIGUSR1);
    while (waitpid(process, &status, 0) < 0 && errno == EINTR) continue;
    assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
    json_t *report = json_load_file(kit_temp_path("out/report.json"), 0, NULL), *e = json_object_get(report, "exploration");
    assert_string_equal(json_string_value(json_object_get(e, "cut")), "finish");
    assert_true(json_number_value(json_object_get(e, "best")) <= json_number_value(json_object_get(e, "start")));
    json_decref(report);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_search_asked_to_finish_ends_with_the_best_found)};
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
