/* The C client and the sh client against a real daemon: what they bring home is what a local run makes, byte
 * for byte. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clients/daemon.h"

enum { WORDS = 24, ID_MAX = 65 };

static const char *part; /* the input all tests use */

/* Files whose bytes must not depend on where a job ran (report.json holds times). */
static const char *const results[] = {"traced.hexex", "blocks.json", "view.drc", NULL};
static const char *const hexes[] = {"hexmesh.msh", "hexmesh.bwh", "integer_grid.hexex", "blocks.json", NULL};

typedef enum { C_CLIENT, SH_CLIENT, CLIENTS } client;
static const char *const client_name[] = {"C", "sh"};

/* A call of one of the clients with `--server` of the daemon here. */
static kit_result call(client which, const char *const words[]) {
    const char *argv[WORDS + 6] = {0};
    int n = 0;
    if (which == SH_CLIENT) argv[n++] = "sh";
    argv[n++] = which == SH_CLIENT ? BW_SOURCE_DIR "/clients/sh/blockwright.sh" : kit_program("blockwright");
    for (int i = 0; words[i]; i++) {
        assert_true(i < WORDS);
        argv[n++] = words[i];
    }
    argv[n++] = "--server";
    argv[n++] = here.url;
    return kit_run(argv);
}

static kit_result call_well(client which, const char *const words[]) {
    kit_result r = call(which, words);
    if (r.exit != 0) fail_msg("%s client, %s: exit %d\n%s", client_name[which], words[0], r.exit, r.err);
    return r;
}

/* Takes the job id that a submission printed. */
static void take_id(kit_result *r, char id[ID_MAX]) {
    size_t n = strcspn(r->out, "\n");
    if (n == 0 || n >= ID_MAX || r->out[n] != '\n' || r->out[n + 1]) fail_msg("not one job id: '%s'", r->out);
    snprintf(id, ID_MAX, "%.*s", (int)n, r->out);
    kit_result_clear(r);
}

static void submit(client which, const char *file, char id[ID_MAX]) {
    kit_result r = call_well(which, (const char *[]){"submit", file, "--quiet", NULL});
    take_id(&r, id);
}

static void watch(client which, const char *id) {
    char line[ID_MAX + 16];
    kit_result r = call_well(which, (const char *[]){"watch", id, NULL});
    snprintf(line, sizeof line, "%s successful\n", id);
    assert_string_equal(r.out, line);
    kit_result_clear(&r);
}

static void run_here(const char *complex, const char *threads, const char *out) {
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", part, "--complex", complex,
                                            "--threads", threads, "--out", out, NULL});
    if (r.exit != 0) fail_msg("local run: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
}

static void expect_same(const char *const names[], const char *a, const char *b) {
    for (size_t i = 0; names[i]; i++) {
        char path_a[600], path_b[600];
        size_t size_a, size_b;
        snprintf(path_a, sizeof path_a, "%s/%s", a, names[i]);
        snprintf(path_b, sizeof path_b, "%s/%s", b, names[i]);
        char *bytes_a = kit_read_file(path_a, &size_a), *bytes_b = kit_read_file(path_b, &size_b);
        if (size_a != size_b || memcmp(bytes_a, bytes_b, size_a) != 0)
            fail_msg("%s and %s differ", path_a, path_b);
        free(bytes_a);
        free(bytes_b);
    }
}

static void expect_same_results(const char *a, const char *b) { expect_same(results, a, b); }

static void both_clients_bring_home_what_a_local_run_makes(void **state) {
    (void)state;
    run_here("mc", "1", kit_temp_path("local"));
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX];
        const char *out = kit_temp_path("%s-out", client_name[c]);
        submit(c, part, id);
        watch(c, id);
        kit_result r = call_well(c, (const char *[]){"fetch", id, "--out", out, NULL});
        kit_result_clear(&r);
        expect_same_results(kit_temp_path("local"), out);
        assert_true(kit_exists(kit_temp_path("%s-out/report.json", client_name[c])));
    }
}

static void the_number_of_threads_changes_nothing(void **state) {
    (void)state;
    run_here("mc", "1", kit_temp_path("one"));
    run_here("mc", "2", kit_temp_path("two"));
    expect_same_results(kit_temp_path("one"), kit_temp_path("two"));
}

static void options_reach_the_job(void **state) {
    (void)state;
    run_here("bc", "1", kit_temp_path("local-bc"));
    for (client c = 0; c < CLIENTS; c++) {
        const char *out = kit_temp_path("%s-bc", client_name[c]);
        kit_result r =
            call_well(c, (const char *[]){"submit", part, "--complex", "bc", "--out", out, "--quiet", NULL});
        kit_result_clear(&r);
        expect_same_results(kit_temp_path("local-bc"), out);
    }
}

static void a_hex_mesh_comes_home_as_a_local_run_makes_it(void **state) {
    (void)state;
#define HEXES "--quantize", "any", "--target-hexes", "100", "--subdivide", "2", "--route", "quality", "--smooth", "off", "--hex-formats", "msh,bwh", "--max-map-work", "300", "--tmesh"
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", part, HEXES, "--out", kit_temp_path("local-hexes"), NULL});
    if (r.exit != 0) fail_msg("local run: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
    for (client c = 0; c < CLIENTS; c++) {
        const char *out = kit_temp_path("%s-hexes", client_name[c]);
        r = call_well(c, (const char *[]){"submit", part, HEXES, "--out", out, "--quiet", NULL});
        kit_result_clear(&r);
        expect_same(hexes, kit_temp_path("local-hexes"), out);
        assert_false(kit_exists(kit_temp_path("%s-hexes/hexmesh.vtu", client_name[c])));
        assert_true(kit_exists(kit_temp_path("%s-hexes/tmesh.json", client_name[c])));
        r = call(c, (const char *[]){"submit", part, HEXES, "--max-hexes", "100", "--wait", "--quiet", NULL});
        if (r.exit != 4 || !strstr(r.err, "more than 100 ")) fail_msg("exit %d\n%s", r.exit, r.err);
        kit_result_clear(&r);
    }
#undef HEXES
}

/* A mesh of hexes is a job like any other; what is of the other kind than asked for fails. */
static void a_mesh_of_hexes_is_decomposed(void **state) {
    (void)state;
    static const char *const files[] = {"labels.txt", "walls.txt", "blocks.json", "hexmesh.msh", "traced.hexex", NULL};
    const char *input = BW_SOURCE_DIR "/api/examples/formats/hexes.vtu", *local = kit_temp_path("local-boxes");
#define BOXES "--kind", "hex", "--complex", "bc", "--hex-formats", "msh"
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "run", input, BOXES, "--out", local, NULL});
    if (r.exit != 0) fail_msg("local run: exit %d\n%s", r.exit, r.err);
    assert_non_null(strstr(r.out, "2 hexes, 12 tets made of them, 0 singular edges inside, 16 on the boundary"));
    kit_result_clear(&r);
    for (client c = 0; c < CLIENTS; c++) {
        const char *out = kit_temp_path("%s-boxes", client_name[c]);
        r = call_well(c, (const char *[]){"submit", input, BOXES, "--out", out, "--quiet", NULL});
        kit_result_clear(&r);
        expect_same(files, local, out);
        r = call(c, (const char *[]){"submit", part, "--kind", "hex", "--wait", "--quiet", NULL});
        if (r.exit != 3 || !strstr(r.err, "[other-kind]")) fail_msg("exit %d\n%s", r.exit, r.err);
        kit_result_clear(&r);
    }
#undef BOXES
}

/* A map with inverted tets fails with their places, and is repaired if that is asked for: the report says where. */
static void a_folded_map_is_refused_by_place_or_repaired(void **state) {
    (void)state;
    const char *folded = kit_temp_path("folded.hexex"), *local = kit_temp_path("local-folded");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "cylinder", "--size", "2", "--folds", "3",
                                            "--scramble", "blocks", "-o", folded, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    r = kit_run((const char *[]){kit_program("blockwright"), "run", folded, "--repair", "--out", local, "--quiet", NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    for (client c = 0; c < CLIENTS; c++) {
        const char *out = kit_temp_path("%s-folded", client_name[c]);
        r = call(c, (const char *[]){"submit", folded, "--wait", "--quiet", NULL});
        if (r.exit != 3 || !strstr(r.err, "[inverted]")) fail_msg("exit %d\n%s", r.exit, r.err);
        if (c == C_CLIENT) assert_non_null(strstr(r.err, " tets around ("));
        kit_result_clear(&r);
        r = call_well(c, (const char *[]){"submit", folded, "--repair", "--out", out, "--quiet", NULL});
        kit_result_clear(&r);
        expect_same_results(local, out);
        char *report = kit_read_file(kit_temp_path("%s-folded/report.json", client_name[c]), NULL);
        assert_non_null(strstr(report, "\"repaired\""));
        assert_non_null(strstr(report, "\"places\""));
        free(report);
    }
}

static void a_job_that_stops_early_has_nothing_to_fetch(void **state) {
    (void)state;
    for (client c = 0; c < CLIENTS; c++) {
        const char *out = kit_temp_path("%s-early", client_name[c]);
        kit_result r = call_well(
            c, (const char *[]){"submit", part, "--until", "sanitize", "--out", out, "--quiet", NULL});
        kit_result_clear(&r);
        assert_false(kit_exists(kit_temp_path("%s-early/traced.hexex", client_name[c])));
    }
}

static void an_option_the_daemon_refuses_is_exit_2(void **state) {
    (void)state;
    kit_result r = call(SH_CLIENT, (const char *[]){"submit", part, "--complex", "cm", NULL});
    assert_int_equal(r.exit, 2);
    assert_non_null(strstr(r.err, "complex"));
    kit_result_clear(&r);
}

static void names_survive_quotes_braces_and_backslashes(void **state) {
    (void)state;
    const char *name = "a \"quoted\", {braced} [one] \\ back: \xc3\xa9";
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX], line[300];
        kit_result r =
            call_well(c, (const char *[]){"submit", part, "--name", name, "--wait", "--quiet", NULL});
        take_id(&r, id);
        for (client lister = 0; lister < CLIENTS; lister++) {
            r = call_well(lister, (const char *[]){"ls", NULL});
            char *at = strstr(r.out, id);
            snprintf(line, sizeof line, "%.*s", at ? (int)strcspn(at, "\n") : 0, at ? at : "");
            if (!at || !strstr(line, "successful") || !strstr(line, name))
                fail_msg("%s client lists '%s'\n%s", client_name[lister], line, r.out);
            kit_result_clear(&r);
        }
    }
}

static void a_job_that_is_not_there_is_exit_3(void **state) {
    (void)state;
    const char *id = "0123456789abcdef01234567";
    const char *const calls[][5] = {
        {"watch", id, NULL}, {"fetch", id, "--out", NULL}, {"cancel", id, NULL}, {"finish", id, NULL}, {"retry", id, NULL}, {"rm", id, NULL}, {"pin", id, NULL}, {"unpin", id, NULL}, {"log", id, NULL}};
    for (client c = 0; c < CLIENTS; c++) {
        for (size_t i = 0; i < sizeof calls / sizeof *calls; i++) {
            const char *words[] = {calls[i][0], id, calls[i][2], calls[i][2] ? kit_temp_path("none") : NULL,
                                   NULL};
            kit_result r = call(c, words);
            if (r.exit != 3 || !strstr(r.err, "[no-such-job]"))
                fail_msg("%s client, %s: exit %d\n%s", client_name[c], words[0], r.exit, r.err);
            kit_result_clear(&r);
        }
    }
}

/* Whether the job is caught in the queue or has ended already is a matter of luck; what is said must fit. */
static void a_cancelled_job_is_exit_4(void **state) {
    (void)state;
    const char *big = kit_temp_path("big.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "cuboid", "--size", "16",
                                            "--noise", "0.5", "-o", big, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX];
        r = call_well(
            c, (const char *[]){"submit", big, c == C_CLIENT ? "--complex=mc" : "--quiet", "--quiet", NULL});
        take_id(&r, id);
        r = call(c, (const char *[]){"cancel", id, NULL});
        bool late = r.exit == 3 && strstr(r.err, "[job-finished]");
        if (!late && r.exit != 0) fail_msg("%s client, cancel: exit %d\n%s", client_name[c], r.exit, r.err);
        kit_result_clear(&r);
        r = call(c, (const char *[]){"watch", id, NULL});
        if (r.exit != (late ? 0 : 4))
            fail_msg("%s client: cancelled %s, yet watch ends with %d\n%s", client_name[c],
                     late ? "late" : "in time", r.exit, r.err);
        kit_result_clear(&r);
    }
}

static void a_failed_job_is_tried_again(void **state) {
    (void)state;
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX], waits[100], runs[100];
        kit_result r = call_well(c, (const char *[]){"submit", part, "--kind", "hex", "--quiet", NULL});
        take_id(&r, id);
        for (int tries = 0; tries < 2; tries++) {
            r = call(c, (const char *[]){"watch", id, NULL});
            assert_int_equal(r.exit, 3);
            kit_result_clear(&r);
            r = call_well(c, (const char *[]){"retry", id, NULL});
            snprintf(waits, sizeof waits, "%s queued\n", id);
            snprintf(runs, sizeof runs, "%s running\n", id);
            assert_true(!strcmp(r.out, waits) || !strcmp(r.out, runs));
            kit_result_clear(&r);
        }
    }
}

static void a_key_submits_once_and_an_ended_job_is_removed(void **state) {
    (void)state;
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX], again[ID_MAX], key[40], line[200];
        snprintf(key, sizeof key, "key-%d", (int)c);
        for (int i = 0; i < 2; i++) { /* the second time creates nothing */
            kit_result r = call_well(C_CLIENT, (const char *[]){"submit", part, "--quiet", "--until", "trace", "--tag", "first,sec ond",
                                                                "--priority", "5", "--idempotency-key", key, NULL});
            take_id(&r, i ? again : id);
        }
        assert_string_equal(id, again);
        kit_result r = call_well(C_CLIENT, (const char *[]){"ls", "--tag", "sec ond", NULL});
        assert_non_null(strstr(r.out, id));
        kit_result_clear(&r);
        r = call_well(C_CLIENT, (const char *[]){"ls", "--tag", "sec", NULL});
        assert_int_equal(r.out_size, 0);
        kit_result_clear(&r);
        r = call_well(c, (const char *[]){"watch", id, "--quiet", NULL});
        kit_result_clear(&r);
        r = call(c, (const char *[]){"retry", id, NULL});
        if (r.exit != 3 || !strstr(r.err, "[job-finished]")) fail_msg("%s client, retry: exit %d\n%s", client_name[c], r.exit, r.err);
        kit_result_clear(&r);
        r = call_well(c, (const char *[]){"rm", id, NULL});
        snprintf(line, sizeof line, "%s removed\n", id);
        assert_string_equal(r.out, line);
        kit_result_clear(&r);
        r = call(c, (const char *[]){"watch", id, NULL});
        if (r.exit != 3 || !strstr(r.err, "[job-gone]")) fail_msg("%s client, watch: exit %d\n%s", client_name[c], r.exit, r.err);
        kit_result_clear(&r);
    }
}

static char *job_text(const char *id) {
    char url[300];
    snprintf(url, sizeof url, "%s/v1/jobs/%s", here.url, id);
    kit_result r = kit_run((const char *[]){"curl", "-sS", url, NULL});
    assert_int_equal(r.exit, 0);
    free(r.err);
    return r.out;
}

static void limits_reach_the_job_and_end_it(void **state) {
    (void)state;
    static const char *const members[] = {"\"memory\": 268435456", "\"scratch\": 134217728", "\"cpu_seconds\": 77", "\"wall_seconds\": 99",
                                          "\"job_cpu_seconds\": 770", "\"job_wall_seconds\": 990"};
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX];
        kit_result r = call_well(c, (const char *[]){"submit", part, "--until", "sanitize", "--limit-memory", c == C_CLIENT ? "256M" : "268435456",
                                                     "--limit-scratch", "134217728", "--limit-cpu", "77", "--limit-wall", "99",
                                                     "--limit-job-cpu", "770", "--limit-job-wall", "990", "--wait", "--quiet", NULL});
        take_id(&r, id);
        char *job = job_text(id);
        for (size_t i = 0; i < sizeof members / sizeof *members; i++)
            if (!strstr(job, members[i])) fail_msg("%s client: no %s in %s", client_name[c], members[i], job);
        free(job);
        /* of another kind than what the cache has */
        r = call(c, (const char *[]){"submit", part, "--kind", "tet", "--until", "sanitize", "--limit-scratch", "100", "--wait", "--quiet", NULL});
        if (r.exit != 4 || !strstr(r.err, "[output-limit]")) fail_msg("%s client: exit %d\n%s", client_name[c], r.exit, r.err);
        kit_result_clear(&r);
    }
}

/* What a client says of a job, in one word; the daemon is asked as well. */
static void expect_pinned(client which, const char *command, const char *id, bool pinned) {
    char line[ID_MAX + 16];
    snprintf(line, sizeof line, "%s %s\n", id, pinned ? "pinned" : "unpinned");
    if (command) {
        kit_result r = call_well(which, (const char *[]){command, id, NULL});
        assert_string_equal(r.out, line);
        kit_result_clear(&r);
    }
    char *job = job_text(id);
    if (!strstr(job, pinned ? "\"pinned\": true" : "\"pinned\": false")) fail_msg("not %s%s", line, job);
    free(job);
}

static void a_job_is_pinned_and_unpinned(void **state) {
    (void)state;
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX];
        kit_result r = call_well(c, (const char *[]){"submit", part, "--until", "sanitize", "--pin", "--quiet", NULL});
        take_id(&r, id);
        expect_pinned(c, NULL, id, true);
        expect_pinned(c, "unpin", id, false);
        expect_pinned(c, "unpin", id, false);
        expect_pinned(c, "pin", id, true);
        expect_pinned(c, "pin", id, true);
        watch(c, id);
        r = call_well(c, (const char *[]){"rm", id, NULL}); /* a pin is no lock */
        kit_result_clear(&r);
    }
}

/* Asked before or while the search runs: the job is successful, with what was found until then. */
static void a_search_is_finished_by_either_client(void **state) {
    (void)state;
    const char *bearing = kit_temp_path("bearing.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "bearing", "--size", "2", "-o", bearing, NULL});
    assert_int_equal(r.exit, 0);
    kit_result_clear(&r);
    for (client c = 0; c < CLIENTS; c++) {
        char id[ID_MAX];
        r = call_well(c, (const char *[]){"submit", bearing, "--explore", "anneal", "--explore-work", "1000000000", "--explore-time", "3000",
                                          "--quiet", NULL});
        take_id(&r, id);
        r = call_well(c, (const char *[]){"finish", id, NULL});
        if (!strstr(r.out, "finishing")) fail_msg("%s client, finish: %s", client_name[c], r.out);
        kit_result_clear(&r);
        watch(c, id);
        r = call(c, (const char *[]){"finish", id, NULL});
        if (r.exit != 3 || !strstr(r.err, "[job-finished]")) fail_msg("%s client: exit %d\n%s", client_name[c], r.exit, r.err);
        kit_result_clear(&r);
    }
}

static void the_log_is_there(void **state) {
    (void)state;
    char id[ID_MAX];
    submit(C_CLIENT, part, id);
    watch(C_CLIENT, id);
    kit_result c = call_well(C_CLIENT, (const char *[]){"log", id, NULL});
    kit_result sh = call_well(SH_CLIENT, (const char *[]){"log", id, NULL});
    assert_string_equal(c.out, sh.out);
    kit_result_clear(&c);
    kit_result_clear(&sh);
}

/* From before it has begun, by one that is there at its end. */
static void the_log_is_followed_to_the_end(void **state) {
    (void)state;
    char id[ID_MAX];
    for (client c = 0; c < CLIENTS; c++) {
        submit(C_CLIENT, part, id);
        kit_result followed = call_well(c, (const char *[]){"log", id, "--follow", NULL});
        watch(C_CLIENT, id); /* has ended */
        kit_result whole = call_well(C_CLIENT, (const char *[]){"log", id, NULL});
        kit_result last = call_well(C_CLIENT, (const char *[]){"log", id, "--tail", "1", NULL});
        kit_result again = call_well(c, (const char *[]){"log", id, "--follow", NULL});
        assert_string_equal(followed.out, whole.out);
        assert_string_equal(again.out, whole.out);
        assert_true(last.out_size <= whole.out_size);
        assert_string_equal(last.out, whole.out + whole.out_size - last.out_size);
        kit_result_clear(&followed);
        kit_result_clear(&whole);
        kit_result_clear(&last);
        kit_result_clear(&again);
    }
}

static void a_job_outlives_a_kill_of_its_daemon(void **state) {
    (void)state;
    char id[ID_MAX];
    submit(C_CLIENT, part, id);
    daemon_kill(&here);
    daemon_start(&here);
    watch(C_CLIENT, id);
    watch(SH_CLIENT, id);
}

static int start(void **state) {
    part = kit_temp_path("part.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "cuboid", "--noise", "0.5",
                                            "--perturb", "1e-6", "--scramble", "cells", "-o", part, NULL});
    if (r.exit != 0) fail_msg("sample: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
    return daemon_begin(state);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(both_clients_bring_home_what_a_local_run_makes),
    cmocka_unit_test(the_number_of_threads_changes_nothing),
    cmocka_unit_test(options_reach_the_job),
    cmocka_unit_test(a_hex_mesh_comes_home_as_a_local_run_makes_it),
    cmocka_unit_test(a_mesh_of_hexes_is_decomposed),
    cmocka_unit_test(a_folded_map_is_refused_by_place_or_repaired),
    cmocka_unit_test(a_job_that_stops_early_has_nothing_to_fetch),
    cmocka_unit_test(an_option_the_daemon_refuses_is_exit_2),
    cmocka_unit_test(names_survive_quotes_braces_and_backslashes),
    cmocka_unit_test(a_job_that_is_not_there_is_exit_3),
    cmocka_unit_test(a_cancelled_job_is_exit_4),
    cmocka_unit_test(a_failed_job_is_tried_again),
    cmocka_unit_test(a_key_submits_once_and_an_ended_job_is_removed),
    cmocka_unit_test(limits_reach_the_job_and_end_it),
    cmocka_unit_test(a_job_is_pinned_and_unpinned),
    cmocka_unit_test(a_search_is_finished_by_either_client),
    cmocka_unit_test(the_log_is_there),
    cmocka_unit_test(the_log_is_followed_to_the_end),
    cmocka_unit_test(a_job_outlives_a_kill_of_its_daemon),
};
DAEMON_MAIN(tests, start)
