/* Both clients against a daemon that wants access tokens. */
#include <stdlib.h>
#include <string.h>

#include "clients/daemon.h"

static const char *part, *token_file;

/* `submit part` by the C client (0) or the sh client (1), with a token file if there is one. */
static kit_result submit(int which, const char *file) {
    const char *argv[10] = {0};
    int n = 0;
    if (which) argv[n++] = "sh";
    argv[n++] = which ? BW_SOURCE_DIR "/clients/sh/blockwright.sh" : kit_program("blockwright");
    for (const char *const *word = (const char *const[]){"submit", part, "--quiet", "--server", here.url, NULL}; *word; word++) argv[n++] = *word;
    if (file) argv[n++] = "--token-file", argv[n++] = file;
    return kit_run(argv);
}

static void expect(int which, const char *file, int code, const char *words) {
    kit_result r = submit(which, file);
    if (r.exit != code || !strstr(r.err, words)) fail_msg("%s client: exit %d\n%s", which ? "sh" : "C", r.exit, r.err);
    if (code != 0) assert_null(strstr(r.err, "not as a Blockwright daemon does"));
    kit_result_clear(&r);
}

/* The first request of an upload is a HEAD, and answers to that have no words. */
static void an_upload_without_a_good_token_is_told_so(void **state) {
    (void)state;
    for (int which = 0; which < 2; which++) {
        expect(which, NULL, 3, "wants an access token");
        setenv("BLOCKWRIGHT_TOKEN", "bwt_wrong", 1);
        expect(which, NULL, 3, "the access token is not valid");
        unsetenv("BLOCKWRIGHT_TOKEN");
    }
}

static void a_token_is_taken_from_a_file_or_the_environment(void **state) {
    (void)state;
    char *token = kit_read_file(token_file, NULL);
    token[strcspn(token, "\n")] = 0;
    for (int which = 0; which < 2; which++) {
        expect(which, token_file, 0, "");
        setenv("BLOCKWRIGHT_TOKEN", token, 1);
        expect(which, NULL, 0, "");
        unsetenv("BLOCKWRIGHT_TOKEN");
    }
    free(token);
}

static int start(void **state) {
    unsetenv("BLOCKWRIGHT_TOKEN");
    part = kit_temp_path("part.hexex");
    token_file = kit_temp_path("token");
    kit_result made = kit_run((const char *[]){kit_program("blockwright"), "sample", "cuboid", "-o", part, NULL});
    assert_int_equal(made.exit, 0);
    kit_result_clear(&made);
    daemon_begin(state);
    kit_result r = kit_run((const char *[]){kit_program("blockwrightd"), "token", "create", "--data", here.data, "--owner", "anna", NULL});
    assert_int_equal(r.exit, 0);
    kit_write_file(token_file, r.out, r.out_size);
    kit_result_clear(&r);
    return 0;
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(an_upload_without_a_good_token_is_told_so),
    cmocka_unit_test(a_token_is_taken_from_a_file_or_the_environment),
};
DAEMON_MAIN(tests, start)
