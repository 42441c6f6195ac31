/* Every kind of bad input ends with exit code 3 and names its fault, in place and through the daemon, which
 * lives on. */
#include <stdlib.h>
#include <string.h>

#include "clients/daemon.h"
#include "models/models.h"

enum { DAMAGED_AT = 5, LINE_BYTES = 200 * 1000 * 1000, NOISE_BYTES = 100000 };

/* A small valid model; `damage` (BW_DAMAGE_COUNT: none) is done to it. */
static void make_model(const char *path, bw_model_damage_kind damage) {
    bw_context ctx;
    bw_model model;
    bw_model_options o;
    bw_context_init(&ctx);
    bw_model_options_defaults(&o);
    kit_expect_ok(&ctx, bw_model_make(&ctx, "cuboid", &o, &model));
    if (damage != BW_DAMAGE_COUNT) kit_expect_ok(&ctx, bw_model_damage(&ctx, &model, damage, DAMAGED_AT));
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
}

static void make_empty(const char *path) {
    kit_write_text(path, "");
}

/* Cut at the end of a line in the middle: whatever is there is well formed. */
static void make_truncated(const char *path) {
    size_t size;
    make_model(path, BW_DAMAGE_COUNT);
    char *text = kit_read_file(path, &size);
    char *end = memchr(text + size / 2, '\n', size / 2);
    kit_write_file(path, text, (size_t)(end + 1 - text));
    free(text);
}

static void make_counts_too_large(const char *path) {
    kit_write_text(path, "2000000000\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1\n0 1 2 3  0 0 0  1 0 0  0 1 0  0 0 1\n");
}

static void make_noise(const char *path) {
    kit_random random = kit_random_start(1);
    unsigned char *bytes = malloc(NOISE_BYTES);
    for (size_t i = 0; i < NOISE_BYTES; i++) bytes[i] = (unsigned char)kit_random_below(&random, 256);
    bytes[0] = 0xff; /* not by chance a digit, which would be a count */
    kit_write_file(path, bytes, NOISE_BYTES);
    free(bytes);
}

static void make_long_line(const char *path) {
    char *line = malloc(LINE_BYTES);
    memset(line, '7', LINE_BYTES);
    kit_write_file(path, line, LINE_BYTES);
    free(line);
}

static void make_index(const char *path) {
    make_model(path, BW_DAMAGE_INDEX);
}
static void make_nan(const char *path) {
    make_model(path, BW_DAMAGE_NAN);
}
static void make_duplicate(const char *path) {
    make_model(path, BW_DAMAGE_DUPLICATE);
}
static void make_inverted(const char *path) {
    make_model(path, BW_DAMAGE_INVERT);
}
static void make_nonmanifold(const char *path) {
    make_model(path, BW_DAMAGE_NONMANIFOLD);
}
static void make_seam(const char *path) {
    make_model(path, BW_DAMAGE_SEAM);
}
static void make_tilt(const char *path) {
    make_model(path, BW_DAMAGE_TILT);
}

static const struct {
    const char *what;
    void (*make)(const char *path);
    bw_status status;
    bool elements; /* the elements at fault are listed */
} inputs[] = {
    {"an empty file", make_empty, BW_E_EMPTY, false},
    {"a truncated file", make_truncated, BW_E_TRUNCATED, false},
    {"counts larger than the file", make_counts_too_large, BW_E_COUNT, false},
    {"an index out of range", make_index, BW_E_INDEX, true},
    {"a parameter that is not a number", make_nan, BW_E_NUMBER, true},
    {"a tet listed twice", make_duplicate, BW_E_DUPLICATE, true},
    {"an inverted tet", make_inverted, BW_E_INVERTED, true},
    {"a facet shared by three tets", make_nonmanifold, BW_E_NONMANIFOLD, true},
    {"a map that is 1 % away from seamless", make_seam, BW_E_NOT_SEAMLESS, true},
    {"a boundary facet that is not aligned", make_tilt, BW_E_NOT_ALIGNED, true},
    {"random bytes", make_noise, BW_E_SYNTAX, false},
    {"a line of 200 MB", make_long_line, BW_E_LINE, false},
};
enum { INPUTS = sizeof inputs / sizeof *inputs };

static void expect_refused(size_t i, const kit_result *r) {
    char code[64];
    snprintf(code, sizeof code, "[%s]", bw_status_code(inputs[i].status));
    if (r->exit != 3 || !strstr(r->err, code))
        fail_msg("%s: exit %d, expected 3 and %s; standard error:\n%s", inputs[i].what, r->exit, code,
                 r->err);
    if (inputs[i].elements && !strstr(r->err, "\n  "))
        fail_msg("%s: no element is listed:\n%s", inputs[i].what, r->err);
}

static void bad_input_is_refused_in_place(void **state) {
    (void)state;
    for (size_t i = 0; i < INPUTS; i++) {
        const char *file = kit_temp_path("bad.hexex"), *out = kit_temp_path("out%zu", i);
        inputs[i].make(file);
        kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", file, "--out", out, NULL});
        expect_refused(i, &r);
        kit_result_clear(&r);
        char *report = kit_read_file(kit_temp_path("out%zu/report.json", i), NULL);
        if (!strstr(report, bw_status_code(inputs[i].status)))
            fail_msg("%s: report.json does not tell:\n%s", inputs[i].what, report);
        free(report);
    }
}

static void bad_input_is_refused_by_the_daemon(void **state) {
    (void)state;
    const char *file = kit_temp_path("bad.hexex");
    for (size_t i = 0; i < INPUTS; i++) {
        inputs[i].make(file);
        kit_result r = kit_run((const char *[]){kit_program("blockwright"), "submit", file, "--wait",
                                                "--quiet", "--server", here.url, NULL});
        expect_refused(i, &r);
        assert_true(daemon_lives(&here));
        kit_result_clear(&r);
    }
    make_model(file, BW_DAMAGE_COUNT);
    kit_result r = kit_run(
        (const char *[]){kit_program("blockwright"), "submit", file, "--wait", "--server", here.url, NULL});
    if (r.exit != 0) fail_msg("a good input after all the bad ones: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
}

static void the_sh_client_tells_the_same(void **state) {
    (void)state;
    const char *file = kit_temp_path("bad.hexex");
    for (size_t i = 0; i + 1 < INPUTS; i++) { /* all but the 200 MB */
        inputs[i].make(file);
        kit_result r = kit_run((const char *[]){"sh", BW_SOURCE_DIR "/clients/sh/blockwright.sh", "submit",
                                                file, "--wait", "--quiet", "--server", here.url, NULL});
        expect_refused(i, &r);
        kit_result_clear(&r);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(bad_input_is_refused_in_place),
    cmocka_unit_test(bad_input_is_refused_by_the_daemon),
    cmocka_unit_test(the_sh_client_tells_the_same),
};
DAEMON_MAIN(tests, daemon_begin)
