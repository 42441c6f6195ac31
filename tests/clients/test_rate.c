/* With a daemon that wants to be asked once a second: the command line waits and goes on. */
#include "clients/daemon.h"

static int setup(void **state) {
    setenv("BLOCKWRIGHT_OWNER_RATE", "1", 1);
    return daemon_begin(state);
}

/* Asks until that is too often, which must be before long: ten at once are allowed. */
static void exhaust(void) {
    char url[200], status[8] = "";
    snprintf(url, sizeof url, "%s/v1/jobs", here.url);
    for (int i = 0; i < 200 && strcmp(status, "429") != 0; i++) {
        kit_result r = kit_run((const char *[]){"curl", "-sS", "-o", kit_temp_path("answer"), "-w", "%{http_code}", url, NULL});
        snprintf(status, sizeof status, "%.7s", r.out);
        kit_result_clear(&r);
    }
    assert_string_equal(status, "429");
    char *answer = kit_read_file(kit_temp_path("answer"), NULL);
    assert_non_null(strstr(answer, "/problems/too-many-requests"));
    free(answer);
}

static void expect_done(const char *const *words) {
    kit_result r = kit_run(words);
    if (r.exit != 0) fail_msg("%s %s: exit %d\n%s", words[1], words[2] ? words[2] : "", r.exit, r.err);
    kit_result_clear(&r);
}

static const char *const shell = BW_SOURCE_DIR "/clients/sh/blockwright.sh";

/* Every kind of request is among the first that are refused: HEAD, PUT, POST, GET, a stream, a download. */
static void a_job_goes_its_way_from_upload_to_results(void **state) {
    (void)state;
    const char *part = kit_temp_path("part.hexex"), *program = kit_program("blockwright");
    expect_done((const char *[]){program, "sample", "cuboid", "-o", part, NULL});
    exhaust();
    expect_done((const char *[]){program, "submit", part, "--server", here.url, "--complex", "bc", "--out", kit_temp_path("result"), NULL});
    assert_true(kit_exists(kit_temp_path("result/report.json")));
    assert_true(kit_exists(kit_temp_path("result/blocks.json")));
    expect_done((const char *[]){"sh", shell, "submit", part, "--server", here.url, "--complex", "mc", "--out", kit_temp_path("by_shell"), NULL});
    assert_true(kit_exists(kit_temp_path("by_shell/report.json")));
    assert_true(kit_exists(kit_temp_path("by_shell/blocks.json")));
}

/* More bytes than fit into the buffers on the way: they are sent again from the first one. */
static void a_large_upload_is_not_begun_in_vain_twice(void **state) {
    (void)state;
    const char *file = kit_temp_path("large.hexex");
    FILE *f = fopen(file, "wb");
    assert_non_null(f);
    for (int i = 0; i < 300000; i++) fprintf(f, "%09d\n", i);
    assert_int_equal(fclose(f), 0);
    exhaust();
    expect_done((const char *[]){kit_program("blockwright"), "submit", file, "--server", here.url, NULL});
}

static void commands_wait_for_their_turn(void **state) {
    (void)state;
    exhaust();
    for (int i = 0; i < 3; i++) expect_done((const char *[]){kit_program("blockwright"), "ls", "--server", here.url, NULL});
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_job_goes_its_way_from_upload_to_results),
    cmocka_unit_test(a_large_upload_is_not_begun_in_vain_twice),
    cmocka_unit_test(commands_wait_for_their_turn),
};

DAEMON_MAIN(tests, setup)
