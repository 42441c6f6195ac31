/* The daemon with the real worker: the same bytes as `blockwright run`, after kills too, and bad inputs fail as input. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "daemon_kit.h"

enum { SAMPLES = 4 };

static kit_daemon d;
static char folder[64];
static const char *const names[SAMPLES] = {"ball", "torus", "l-shape", "plate"};
static const char *const files[] = {"traced.hexex", "blocks.json", "view.drc"};
static const char *const two_workers[] = {"--workers", "2", NULL};
static unsigned seed;

static void shell(const char *command) {
    if (system(command) != 0) fail_msg("%s", command);
}

static char *read_file(const char *name, size_t *size) {
    char path[200];
    snprintf(path, sizeof path, "%s/%s", folder, name);
    FILE *f = fopen(path, "rb");
    assert_non_null(f);
    fseek(f, 0, SEEK_END);
    *size = (size_t)ftell(f);
    rewind(f);
    char *data = calloc(*size + 1, 1);
    assert_int_equal(fread(data, 1, *size, f), *size);
    fclose(f);
    return data;
}

static int start(void **state) {
    (void)state;
    char command[400];
    const char *given = getenv("BW_TEST_SEED");
    seed = given ? (unsigned)strtoul(given, NULL, 10) : (unsigned)time(NULL);
    print_message("seed %u (set BW_TEST_SEED to repeat)\n", seed);
    srand(seed);
    snprintf(folder, sizeof folder, "/tmp/bw-real-XXXXXX");
    assert_non_null(mkdtemp(folder));
    for (int i = 0; i < SAMPLES; i++) {
        snprintf(command, sizeof command, "cd %s && %s/blockwright sample %s --size 2 --perturb 1e-6 --noise 0.3 -o %s.hexex "
                 ">/dev/null 2>&1 && %s/blockwright run %s.hexex --out %s >/dev/null 2>&1", folder, BW_BIN_DIR, names[i],
                 names[i], BW_BIN_DIR, names[i], names[i]);
        shell(command);
    }
    kit_start(&d, BW_BIN_DIR "/blockwright-worker", two_workers);
    return 0;
}

static int stop(void **state) {
    char command[100];
    (void)state;
    kit_remove(&d);
    snprintf(command, sizeof command, "rm -r %s", folder);
    return system(command);
}

static void submit_sample(int i, const char *options, char id[32]) {
    char name[80];
    size_t size;
    snprintf(name, sizeof name, "%s.hexex", names[i]);
    char *content = read_file(name, &size);
    kit_submit(&d, content, options, id);
    free(content);
}

static void expect_same_bytes(int i, const char *id) {
    json_t *job = kit_wait(&d, id, 120);
    if (strcmp(kit_text(job, "state"), "successful") != 0) fail_msg("%s: %s", names[i], json_dumps(job, 0));
    assert_string_equal(kit_text(job, "kind"), "tet");
    json_decref(job);
    for (size_t f = 0; f < sizeof files / sizeof *files; f++) {
        char name[80];
        size_t size;
        snprintf(name, sizeof name, "%s/%s", names[i], files[f]);
        char *local = read_file(name, &size);
        kit_reply r = kit_get(&d, "/v1/jobs/%s/results/%s", id, files[f]);
        assert_int_equal(r.status, 200);
        assert_int_equal(r.size, size);
        assert_memory_equal(r.body, local, size);
        kit_free(&r);
        free(local);
    }
}

static void a_job_tells_that_its_input_is_a_hex_mesh(void **state) {
    (void)state;
    static const char cube[] = "# vtk DataFile Version 3.0\ncube\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 8 double\n"
                               "0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1\nCELLS 1 9\n8 0 1 2 3 4 5 6 7\nCELL_TYPES 1\n12\n";
    char id[32];
    kit_submit(&d, cube, "{\"until\":\"sanitize\"}", id);
    json_t *job = kit_wait(&d, id, 60);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_string_equal(kit_text(job, "kind"), "hex");
    json_decref(job);
}

static void results_are_the_bytes_of_a_local_run(void **state) {
    (void)state;
    char ids[SAMPLES][32];
    for (int i = 0; i < SAMPLES; i++) submit_sample(i, NULL, ids[i]);
    for (int i = 0; i < SAMPLES; i++) {
        expect_same_bytes(i, ids[i]);
        kit_reply r = kit_get(&d, "/v1/jobs/%s/report", ids[i]);
        json_t *report = kit_json(&r), *raw = json_object_get(json_object_get(report, "complex"), "raw");
        assert_true(json_integer_value(json_object_get(raw, "blocks")) > 0);
        json_decref(report);
    }
}

/* Quantizing again takes the complex from the cache; only what depends on the quantization runs. */
static void another_quantization_reuses_the_complex(void **state) {
    (void)state;
    static const char *const wanted[] = {"{\"quantize\":\"positive\",\"scale\":0}", "{\"quantize\":\"any\",\"target_hexes\":500,\"scales\":[0,2]}"};
    for (int k = 0; k < 2; k++) {
        char id[32];
        size_t i;
        json_t *attempt;
        bool late = false; /* quantize and all stages after it */
        submit_sample(1, wanted[k], id);
        json_t *job = kit_wait(&d, id, 120);
        assert_string_equal(kit_text(job, "state"), "successful");
        json_array_foreach(json_object_get(job, "attempts"), i, attempt) {
            const char *stage = kit_text(attempt, "stage");
            late = late || !strcmp(stage, "quantize");
            if (k) assert_int_equal(json_is_true(json_object_get(attempt, "reused")), !late);
        }
        kit_reply r = kit_get(&d, "/v1/jobs/%s/report", id);
        json_t *report = kit_json(&r), *found = json_object_get(report, "quantization");
        assert_string_equal(kit_text(found, "range"), k ? "any" : "positive");
        assert_int_equal(json_array_size(json_object_get(found, "sweep")), k ? 2 : 0);
        json_decref(report);
        json_decref(job);
    }
}

/* Another tolerance makes another cache key, so that every stage runs again, under kills, and must give the same bytes. */
static void results_are_the_same_bytes_after_kills(void **state) {
    (void)state;
    char ids[SAMPLES][32];
    pid_t pids[4];
    int worker_kills = 0;
    for (int i = 0; i < SAMPLES; i++) submit_sample(i, "{\"tolerance\":0.0002}", ids[i]);
    for (int round = 0; round < 8; round++) {
        kit_sleep_ms(rand() % 100);
        size_t n = kit_workers(&d, pids, 4);
        if (n && worker_kills < 2) worker_kills += kill(pids[(size_t)rand() % n], SIGKILL) == 0;
        kit_sleep_ms(rand() % 40);
        kit_kill(&d, SIGKILL);
        kit_restart(&d, two_workers);
    }
    for (int i = 0; i < SAMPLES; i++) expect_same_bytes(i, ids[i]);
}

static void bad_inputs_fail_as_input_and_say_why(void **state) {
    (void)state;
    const struct {
        const char *content, *code;
    } cases[] = {{"", "empty-input"},
                 {"this is no mesh\n", "syntax"},
                 {"4000000000 4000000000\n0 0 0\n", NULL},
                 {"4 1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 2 9\n", NULL}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char id[32], type[80];
        kit_submit(&d, cases[i].content, NULL, id);
        json_t *job = kit_wait(&d, id, 30), *failure = json_object_get(job, "failure");
        assert_string_equal(kit_text(job, "state"), "failed");
        assert_string_equal(kit_text(failure, "class"), "input");
        assert_string_equal(kit_text(failure, "stage"), "sanitize");
        assert_true(strlen(kit_text(failure, "detail")) > 0);
        assert_int_equal(json_array_size(json_object_get(job, "attempts")), 1);
        snprintf(type, sizeof type, "/problems/%s", cases[i].code ? cases[i].code : "");
        if (cases[i].code) assert_string_equal(kit_text(failure, "type"), type);
        json_decref(job);
    }
}

/* Random bytes, also where a number or a line is expected: an input failure with a message that is JSON, never a crash. */
static void random_bytes_fail_as_input(void **state) {
    (void)state;
    for (int i = 0; i < 12; i++) {
        char content[700], id[32];
        size_t n = 0;
        if (i % 3 == 1) n = (size_t)sprintf(content, "4 1\n0 0 0\n");
        if (i % 3 == 2) n = (size_t)sprintf(content, "4 1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 1 2 3 ");
        while (n < sizeof content - 1) content[n++] = (char)(1 + rand() % 255);
        content[n] = '\0';
        kit_submit(&d, content, NULL, id);
        json_t *job = kit_wait(&d, id, 30), *failure = json_object_get(job, "failure");
        assert_string_equal(kit_text(failure, "class"), "input");
        assert_true(strlen(kit_text(failure, "detail")) > 0);
        json_decref(job);
    }
}

static void a_job_too_large_for_its_limits_fails_as_limit(void **state) {
    (void)state;
    char id[32];
    submit_sample(0, "{\"max_cells\":10}", id);
    json_t *job = kit_wait(&d, id, 60), *failure = json_object_get(job, "failure");
    assert_string_equal(kit_text(failure, "type"), "/problems/work-limit");
    json_decref(job);
    kit_kill(&d, SIGTERM);
    kit_restart(&d, (const char *const[]){"--stage-memory", "200K", NULL});
    submit_sample(0, "{\"tolerance\":0.0003}", id);
    job = kit_wait(&d, id, 60);
    failure = json_object_get(job, "failure");
    assert_string_equal(kit_text(failure, "type"), "/problems/memory-limit");
    assert_string_equal(kit_text(failure, "class"), "limit");
    json_decref(job);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(results_are_the_bytes_of_a_local_run),
        cmocka_unit_test(a_job_tells_that_its_input_is_a_hex_mesh),
        cmocka_unit_test(another_quantization_reuses_the_complex),
        cmocka_unit_test(results_are_the_same_bytes_after_kills),
        cmocka_unit_test(bad_inputs_fail_as_input_and_say_why),
        cmocka_unit_test(random_bytes_fail_as_input),
        cmocka_unit_test(a_job_too_large_for_its_limits_fails_as_limit),
    };
    return cmocka_run_group_tests(tests, start, stop);
}
