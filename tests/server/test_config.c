/* Configuration (server/config.h): the table, where values come from, and what is said about mistakes. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/config.h"

enum { WORDS_MOST = 24 };
static bw_config config;
static char error[BW_CONFIG_ERROR];
static bw_ask ask;

/* Loads from a command line of words with blanks between them; "DATA" stands for the test's folder. */
static bool load(const char *line) {
    static char copy[4000];
    char *argv[WORDS_MOST + 1] = {"blockwrightd", "--data", (char *)kit_temp_dir(), "--worker", "/bin/true"}, *rest = copy;
    int argc = 5;
    snprintf(copy, sizeof copy, "%s", line);
    for (char *word; argc < WORDS_MOST && (word = strsep(&rest, " "));)
        if (*word) argv[argc++] = word;
    error[0] = '\0';
    return bw_config_load(&config, &argc, argv, false, &ask, error);
}

static const char *file(const char *text) {
    static int n;
    const char *path = kit_temp_path("file%d.conf", n++);
    kit_write_text(path, text);
    return path;
}

static bool load_file(const char *text) {
    char line[1000];
    snprintf(line, sizeof line, "--config %s", file(text));
    return load(line);
}

static void expect_error(bool good, const char *part) {
    assert_false(good);
    if (!strstr(error, part)) fail_msg("'%s' is not in: %s", part, error);
}

static const char *value_of(const char *name) {
    static char text[BW_VALUE_TEXT];
    int i = bw_setting_find(name, strlen(name));
    assert_true(i >= 0);
    return bw_setting_text(&bw_settings[i], &config, text);
}

/* ---- the table ---- */

static void every_row_is_complete_and_no_name_or_field_occurs_twice(void **state) {
    (void)state;
    for (size_t i = 0; i < bw_setting_count; i++) {
        const bw_setting *s = &bw_settings[i];
        assert_true(strlen(s->name) < 60 && strspn(s->name, "abcdefghijklmnopqrstuvwxyz-") == strlen(s->name));
        assert_true(*s->help && *s->value);
        assert_true(s->offset + s->room <= sizeof config);
        assert_true(s->type != BW_SETTING_CHOICE || s->choices);
        assert_true(s->type != BW_SETTING_DURATION || s->unit_ms == 1 || s->unit_ms == 1000);
        assert_true(!s->reloadable || (s->type != BW_SETTING_PATH && s->type != BW_SETTING_ADDRESS));
        for (size_t j = 0; j < i; j++)
            assert_true(strcmp(s->name, bw_settings[j].name) != 0 && s->offset != bw_settings[j].offset);
    }
}

static void every_default_is_a_value_of_its_setting_and_is_in_effect(void **state) {
    (void)state;
    char text[BW_VALUE_TEXT], why[400];
    static bw_config other;
    assert_true(load(""));
    for (size_t i = 0; i < bw_setting_count; i++) {
        const char *standard = bw_setting_default(&bw_settings[i], text);
        if (!*standard || config.origins[i].source != BW_FROM_DEFAULT) continue;
        if (!bw_setting_parse(&bw_settings[i], &other, standard, why, sizeof why)) fail_msg("%s: %s", bw_settings[i].name, why);
        char again[BW_VALUE_TEXT];
        assert_string_equal(bw_setting_text(&bw_settings[i], &other, again), value_of(bw_settings[i].name));
    }
}

static void the_help_tells_of_every_setting(void **state) {
    (void)state;
    char *text = NULL, flag[80];
    size_t size;
    FILE *f = open_memstream(&text, &size);
    bw_config_print_help(f);
    fclose(f);
    for (size_t i = 0; i < bw_setting_count; i++) {
        snprintf(flag, sizeof flag, "--%s %s", bw_settings[i].name, bw_settings[i].value);
        assert_non_null(strstr(text, flag));
    }
    assert_null(strstr(text, "default\n    --")); /* of a setting that is empty by default */
    for (char *line = text, *end; (end = strchr(line, '\n')); line = end + 1) assert_true(end - line <= 118 && end[-1] != ' ');
    free(text);
}

/* ---- sources ---- */

static void flags_win_over_the_environment_and_that_over_the_file(void **state) {
    (void)state;
    const char *path = file("workers = 2\nmax-upload = 2M\nstage-memory = 2M\n");
    char line[600];
    int upload = bw_setting_find("max-upload", 10), memory = bw_setting_find("stage-memory", 12);
    setenv("BLOCKWRIGHT_WORKERS", "3", 1);
    setenv("BLOCKWRIGHT_MAX_UPLOAD", "3M", 1);
    snprintf(line, sizeof line, "--config %s --workers 4", path);
    bool good = load(line);
    unsetenv("BLOCKWRIGHT_WORKERS");
    unsetenv("BLOCKWRIGHT_MAX_UPLOAD");
    assert_true(good);
    assert_int_equal(config.workers, 4);
    assert_int_equal(config.max_upload, 3 << 20);
    assert_int_equal(config.stage_memory, 2 << 20);
    assert_int_equal(config.origins[upload].source, BW_FROM_ENVIRONMENT);
    assert_int_equal(config.origins[memory].source, BW_FROM_FILE);
    assert_int_equal(config.origins[memory].line, 3);
}

static void the_environment_can_name_the_file_and_a_flag_names_another(void **state) {
    (void)state;
    char line[600];
    setenv("BLOCKWRIGHT_CONFIG", file("workers = 7\n"), 1);
    assert_true(load(""));
    assert_int_equal(config.workers, 7);
    snprintf(line, sizeof line, "--config=%s", file("workers = 8\n"));
    assert_true(load(line));
    assert_int_equal(config.workers, 8);
    unsetenv("BLOCKWRIGHT_CONFIG");
}

static void the_last_of_equal_flags_counts_and_both_spellings_are_understood(void **state) {
    (void)state;
    assert_true(load("--workers 3 --workers=5"));
    assert_int_equal(config.workers, 5);
}

static void comments_blanks_quotes_and_crlf_are_understood_in_the_file(void **state) {
    (void)state;
    assert_true(load_file("# all of it\n\n  workers=3# no comment without a blank before it? no: a number cannot have it\n") == false);
    assert_true(load_file("# all of it\r\n\r\n  workers=3 # three\r\n\tmax-upload\t=\t\"5M\"  # five\r\nstage-cpu-seconds = 90"));
    assert_int_equal(config.workers, 3);
    assert_int_equal(config.max_upload, 5 << 20);
    assert_int_equal(config.stage_cpu_seconds, 90);
}

static void units_are_understood(void **state) {
    (void)state;
    assert_true(load("--max-upload 1500 --stage-memory 3K --stage-output 2T --stage-cpu-seconds 2m --stage-wall-seconds 1d"));
    assert_int_equal(config.max_upload, 1500);
    assert_int_equal(config.stage_memory, 3072);
    assert_true(config.stage_output == (uint64_t)2 << 40);
    assert_int_equal(config.stage_cpu_seconds, 120);
    assert_int_equal(config.stage_wall_seconds, 86400);
    assert_true(load("--job-wall-seconds 1d --job-cpu-seconds 0"));
    assert_int_equal(config.job_wall_seconds, 86400);
    assert_string_equal(value_of("job-wall-seconds"), "1d");
    assert_string_equal(value_of("job-cpu-seconds"), "0s");
    assert_true(load("--stop-grace 1500ms"));
    assert_int_equal(config.stop_grace_ms, 1500);
    assert_string_equal(value_of("stop-grace"), "1500ms");
}

static void what_is_printed_is_a_file_that_gives_the_same_again(void **state) {
    (void)state;
    char *first = NULL, *second = NULL, line[900], data[300];
    size_t size;
    snprintf(data, sizeof data, "%s/a \"folder\" with \\ and # in it", kit_temp_dir());
    char *argv[] = {"blockwrightd", "--data", data, "--worker", "/bin/true", "--listen", "[::1]:0", "--stop-grace", "90s", "--max-upload",
                    "1025", "--log-level", "warn", NULL};
    int argc = 13;
    assert_true(bw_config_load(&config, &argc, argv, false, &ask, error));
    FILE *f = open_memstream(&first, &size);
    bw_config_print(&config, f);
    fclose(f);
    snprintf(line, sizeof line, "--config=%s", file(first));
    char *again[] = {"blockwrightd", line, NULL};
    argc = 2;
    if (!bw_config_load(&config, &argc, again, false, &ask, error)) fail_msg("%s in\n%s", error, first);
    assert_string_equal(config.data, data);
    f = open_memstream(&second, &size);
    bw_config_print(&config, f);
    fclose(f);
    for (char *a = first, *b = strchr(second, '\n') + 1; *a; a = strchr(a, '\n') + 1, b = strchr(b, '\n') + 1) /* b begins with # config */
        assert_memory_equal(a, b, (size_t)(strstr(a, "  # ") - a));
    free(first);
    free(second);
}

static void a_subcommand_gets_the_words_that_are_no_settings(void **state) {
    (void)state;
    char *argv[] = {"token", "create", "--worker", "/bin/true", "--owner", "anna", "--data=/tmp", "--help-me", NULL};
    int argc = 8;
    assert_true(bw_config_load(&config, &argc, argv, true, &ask, error));
    assert_int_equal(argc, 5);
    assert_string_equal(argv[1], "create");
    assert_string_equal(argv[2], "--owner");
    assert_string_equal(argv[3], "anna");
    assert_string_equal(argv[4], "--help-me");
    assert_null(argv[5]);
    assert_string_equal(config.data, "/tmp");
}

/* ---- mistakes ---- */

static void mistakes_on_the_command_line_name_the_flag(void **state) {
    (void)state;
    expect_error(load("--max-upload 1Q"), "--max-upload: '1Q'");
    expect_error(load("--workers"), "--workers: the value is missing");
    expect_error(load("--workers 0"), "--workers: '0' is not between 1 and 256");
    expect_error(load("--workers -1"), "'-1' is not a number");
    expect_error(load("--workers 99999999999999999999"), "is not a number");
    expect_error(load("--stage-memory 99999999999999T"), "is not a size");
    expect_error(load("--stage-cpu-seconds 500ms"), "whole number of seconds");
    expect_error(load("--stop-grace 3 weeks"), "'weeks' is not an option");
    expect_error(load("--listen 0.0.0.0:80"), "refusing to listen");
    expect_error(load("--listen [::]:80"), "refusing to listen");
    expect_error(load("--tls-cert a.pem"), "go together");
    expect_error(load("--tls-key a.pem"), "go together");
    expect_error(load("--behind-proxy somewhere"), "is no list");
    expect_error(load("--behind-proxy 10.0.0.1/8"), "is no list");
    expect_error(load("--behind-proxy 10.0.0.0/33"), "is no list");
    expect_error(load("--host-names a/b"), "is no list of names");
    expect_error(load("--log-format xml"), "is none of: logfmt json");
    expect_error(load("--colour"), "'--colour' is not an option");
}

static void the_nearest_known_name_is_named(void **state) {
    (void)state;
    expect_error(load("--max-uplod 1M"), "did you mean --max-upload?");
    expect_error(load("--stage_memory 1M"), "did you mean --stage-memory?");
    expect_error(load_file("stagememory = 1M\n"), "did you mean stage-memory?");
    assert_false(load("--completely-different 1"));
    assert_null(strstr(error, "did you mean"));
}

static void mistakes_in_the_file_name_file_and_line(void **state) {
    (void)state;
    expect_error(load_file("workers = 2\n\nmax-upload = 1Q\n"), ".conf:3: max-upload: '1Q'");
    expect_error(load_file("workers = 2\nworkers = 3\n"), ".conf:2: workers was already set on line 1");
    expect_error(load_file("workers 2\n"), ".conf:1: 'workers 2' is not \"name = value\"");
    expect_error(load_file("= 2\n"), ".conf:1:");
    expect_error(load_file("workers =\n"), ".conf:1: workers: '' is not a number");
    expect_error(load_file("data = \"/tmp\n"), ".conf:1: data: the quotes do not fit");
    expect_error(load_file("data = \"/tmp\" x\n"), ".conf:1: data: the quotes do not fit");
    expect_error(load_file("config = other\n"), "a file cannot name another one");
    expect_error(load("--config /no/such/file"), "cannot read the configuration file '/no/such/file'");
    const char *path = kit_temp_path("zero.conf");
    kit_write_file(path, "workers = 2\n\0\nworkers = 3\n", 26);
    char line[400];
    snprintf(line, sizeof line, "--config %s", path);
    expect_error(load(line), ":2: the line is too long, or has a zero byte in it");
}

static void a_value_that_is_overridden_is_checked_all_the_same(void **state) {
    (void)state;
    char line[600];
    snprintf(line, sizeof line, "--workers 2 --config %s", file("workers = many\n"));
    expect_error(load(line), ".conf:1: workers: 'many'");
}

static void mistakes_in_the_environment_name_the_variable(void **state) {
    (void)state;
    setenv("BLOCKWRIGHT_STAGE_MEMORY", "lots", 1);
    bool good = load("");
    unsetenv("BLOCKWRIGHT_STAGE_MEMORY");
    expect_error(good, "BLOCKWRIGHT_STAGE_MEMORY: 'lots'");
}

static void variables_that_belong_to_nothing_are_found(void **state) {
    (void)state;
    setenv("BLOCKWRIGHT_STAGE_MEMROY", "1G", 1);
    setenv("BLOCKWRIGHT_SERVER", "http://somewhere", 1); /* the clients' */
    setenv("BLOCKWRIGHT_WORKERS", "1", 1);
    assert_true(load(""));
    assert_string_equal(bw_config_stray_variable(0), "BLOCKWRIGHT_STAGE_MEMROY=1G");
    assert_null(bw_config_stray_variable(1));
    unsetenv("BLOCKWRIGHT_STAGE_MEMROY");
    unsetenv("BLOCKWRIGHT_SERVER");
    unsetenv("BLOCKWRIGHT_WORKERS");
}

static void damaged_files_are_refused_or_understood_but_never_crash(void **state) {
    (void)state;
    static const char whole[] = "workers = 2 # two\nmax-upload = \"1M\"\ndata = \"/tmp/\\\"x\\\\\"\nlog-level = warn\n";
    kit_random random = kit_random_start(7);
    for (int round = 0; round < 500; round++) {
        char text[sizeof whole];
        memcpy(text, whole, sizeof text);
        for (int i = 0; i < 3; i++) text[kit_random_below(&random, sizeof whole - 1)] = (char)kit_random_below(&random, 256);
        const char *path = kit_temp_path("damaged.conf");
        char line[400];
        kit_write_file(path, text, kit_random_below(&random, sizeof whole));
        snprintf(line, sizeof line, "--config %s", path);
        if (!load(line)) assert_true(*error);
        else assert_true(config.workers >= 1);
    }
}

/* ---- reload ---- */

static int applied, refused;
static void tell(const bw_setting *setting, const char *value, bool good) {
    (void)setting, (void)value;
    applied += good;
    refused += !good;
}

static void a_reload_takes_over_what_is_reloadable_and_nothing_else(void **state) {
    (void)state;
    static bw_config live;
    assert_true(load("--workers 2 --max-upload 1M"));
    live = config;
    assert_true(load("--workers 3 --max-upload 2M --log-level error --listen 127.0.0.1:99"));
    applied = refused = 0;
    bw_config_reload(&live, &config, tell);
    assert_int_equal(applied, 2);
    assert_int_equal(refused, 2);
    assert_int_equal(live.workers, 2);
    assert_int_equal(live.max_upload, 2 << 20);
    assert_int_equal(live.log_level, 3);
    applied = refused = 0;
    live.workers = 3;
    live.listen = config.listen;
    bw_config_reload(&live, &config, tell);
    assert_int_equal(applied + refused, 0);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_row_is_complete_and_no_name_or_field_occurs_twice),
    cmocka_unit_test(every_default_is_a_value_of_its_setting_and_is_in_effect),
    cmocka_unit_test(the_help_tells_of_every_setting),
    cmocka_unit_test(flags_win_over_the_environment_and_that_over_the_file),
    cmocka_unit_test(the_environment_can_name_the_file_and_a_flag_names_another),
    cmocka_unit_test(the_last_of_equal_flags_counts_and_both_spellings_are_understood),
    cmocka_unit_test(comments_blanks_quotes_and_crlf_are_understood_in_the_file),
    cmocka_unit_test(units_are_understood),
    cmocka_unit_test(what_is_printed_is_a_file_that_gives_the_same_again),
    cmocka_unit_test(a_subcommand_gets_the_words_that_are_no_settings),
    cmocka_unit_test(mistakes_on_the_command_line_name_the_flag),
    cmocka_unit_test(the_nearest_known_name_is_named),
    cmocka_unit_test(mistakes_in_the_file_name_file_and_line),
    cmocka_unit_test(a_value_that_is_overridden_is_checked_all_the_same),
    cmocka_unit_test(mistakes_in_the_environment_name_the_variable),
    cmocka_unit_test(variables_that_belong_to_nothing_are_found),
    cmocka_unit_test(damaged_files_are_refused_or_understood_but_never_crash),
    cmocka_unit_test(a_reload_takes_over_what_is_reloadable_and_nothing_else),
};
KIT_MAIN(tests)
