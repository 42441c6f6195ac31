/* `blockwright capabilities` against a real daemon: the table says what the daemon's document says. */
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clients/daemon.h"

static kit_result capabilities(const char *option) {
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "capabilities", "--server", here.url, option, NULL});
    if (r.exit != 0) fail_msg("exit %d\n%s", r.exit, r.err);
    assert_int_equal(r.err_size, 0);
    return r;
}

static json_t *document(void) {
    kit_result r = capabilities("--json");
    json_t *all = json_loads(r.out, 0, NULL);
    if (!all) fail_msg("no JSON: %s", r.out);
    kit_result_clear(&r);
    return all;
}

/* The line that begins with two blanks and the word, to be freed; there must be exactly one in the text. */
static char *line_of(const char *text, const char *word) {
    char start[80];
    int n = snprintf(start, sizeof start, "\n  %s ", word);
    const char *at = strstr(text, start);
    if (!at || strstr(at + n, start)) fail_msg("not one line '%s' in\n%s", word, text);
    return strndup(at + 1, strcspn(at + 1, "\n"));
}

static void the_document_is_the_daemons(void **state) {
    (void)state;
    char url[200];
    snprintf(url, sizeof url, "%s/v1/capabilities", here.url);
    kit_result r = kit_run((const char *[]){"curl", "-sS", url, NULL});
    json_t *told = document(), *there = json_loads(r.out, 0, NULL);
    assert_non_null(there);
    assert_true(json_equal(told, there));
    json_decref(told);
    json_decref(there);
    kit_result_clear(&r);
}

static void every_option_is_a_line_with_all_its_words_and_its_default(void **state) {
    (void)state;
    json_t *all = document(), *schema, *word;
    kit_result r = capabilities(NULL);
    const char *name;
    size_t count = 0, i;
    *strstr(r.out, "\nInput formats") = 0;
    json_object_foreach(json_object_get(all, "options"), name, schema) {
        const json_t *fallback = json_object_get(schema, "default"), *high = json_object_get(schema, "maximum");
        char *line = line_of(r.out, name), text[80] = "";
        json_array_foreach(json_object_get(schema, "enum"), i, word) {
            if (!strstr(line, json_string_value(word))) fail_msg("no %s in '%s'", json_string_value(word), line);
        }
        if (json_is_integer(high)) snprintf(text, sizeof text, " to %" JSON_INTEGER_FORMAT ";", json_integer_value(high));
        if (!strstr(line, text)) fail_msg("no '%s' in '%s'", text, line);
        if (json_is_string(fallback)) snprintf(text, sizeof text, "default %s", json_string_value(fallback));
        else if (json_is_integer(fallback)) snprintf(text, sizeof text, "default %" JSON_INTEGER_FORMAT, json_integer_value(fallback));
        else snprintf(text, sizeof text, "default ");
        if (!strstr(line, text)) fail_msg("no '%s' in '%s'", text, line);
        free(line);
        count++;
    }
    assert_true(count > 20);
    kit_result_clear(&r);
    json_decref(all);
}

static void stages_come_in_their_order(void **state) {
    (void)state;
    json_t *all = document(), *stage;
    kit_result r = capabilities(NULL);
    const char *at = r.out;
    size_t i;
    json_array_foreach(json_object_get(all, "stages"), i, stage) {
        char line[80];
        snprintf(line, sizeof line, "\n%s, version %d\n", json_string_value(json_object_get(stage, "name")),
                 (int)json_integer_value(json_object_get(stage, "version")));
        at = strstr(at, line);
        if (!at) fail_msg("no '%s' where it belongs in\n%s", line + 1, r.out);
    }
    assert_true(i > 0);
    kit_result_clear(&r);
    json_decref(all);
}

static void limits_are_those_that_are_set(void **state) {
    (void)state;
    kit_result r = capabilities(NULL);
    char *jobs = line_of(r.out, "jobs of an owner that wait or run"), *running = line_of(r.out, "stages of an owner at the same time"),
         *wall = line_of(r.out, "time of a stage");
    assert_non_null(strstr(jobs, " 1717"));
    assert_non_null(strstr(running, " unlimited"));
    assert_non_null(strstr(wall, " 321 s"));
    free(jobs);
    free(running);
    free(wall);
    kit_result_clear(&r);
}

static int start(void **state) {
    setenv("BLOCKWRIGHT_OWNER_JOBS", "1717", 1);
    setenv("BLOCKWRIGHT_STAGE_WALL_SECONDS", "321", 1);
    return daemon_begin(state);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(the_document_is_the_daemons),
    cmocka_unit_test(every_option_is_a_line_with_all_its_words_and_its_default),
    cmocka_unit_test(stages_come_in_their_order),
    cmocka_unit_test(limits_are_those_that_are_set),
};
DAEMON_MAIN(tests, start)
