/* A Medit mesh with its file of parameters: in place and through a daemon, with both clients, the results are those of the same part in
 * one file, byte for byte; two files that do not belong together are refused with one code everywhere. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clients/daemon.h"
#include "core/input_kit.h"
#include "format/input.h"

enum { WORDS = 14 };

static const char *part, *mesh, *meshb, *parameters, *others; /* others: parameters of another map of the same mesh */

/* Files whose bytes must not depend on where a job ran, nor on the format (report.json holds times). */
static const char *const results[] = {"traced.hexex", "blocks.json", "view.drc"};

typedef enum { IN_PLACE, C_CLIENT, SH_CLIENT, WAYS } way;
static const char *const way_name[] = {"run", "C client", "sh client"};

/* Decomposes `input` with the side file `side` (NULL: none) into the folder `out`. */
static kit_result decompose(way how, const char *input, const char *side, const char *out) {
    const char *argv[WORDS] = {0};
    int n = 0;
    if (how == SH_CLIENT) argv[n++] = "sh";
    argv[n++] = how == SH_CLIENT ? BW_SOURCE_DIR "/clients/sh/blockwright.sh" : kit_program("blockwright");
    argv[n++] = how == IN_PLACE ? "run" : "submit";
    argv[n++] = input;
    if (side) argv[n++] = "--parameters", argv[n++] = side;
    argv[n++] = "--out", argv[n++] = out, argv[n++] = "--quiet";
    if (how != IN_PLACE) argv[n++] = "--server", argv[n++] = here.url;
    return kit_run(argv);
}

static void decompose_well(way how, const char *input, const char *side, const char *out) {
    kit_result r = decompose(how, input, side, out);
    if (r.exit != 0) fail_msg("%s: exit %d\n%s", way_name[how], r.exit, r.err);
    kit_result_clear(&r);
}

static bool same_bytes(const char *a, const char *b, const char *name) {
    char path_a[600], path_b[600];
    size_t size_a, size_b;
    snprintf(path_a, sizeof path_a, "%s/%s", a, name);
    snprintf(path_b, sizeof path_b, "%s/%s", b, name);
    char *bytes_a = kit_read_file(path_a, &size_a), *bytes_b = kit_read_file(path_b, &size_b);
    bool same = size_a == size_b && memcmp(bytes_a, bytes_b, size_a) == 0;
    free(bytes_a), free(bytes_b);
    return same;
}

static void expect_same_results(const char *a, const char *b) {
    for (size_t i = 0; i < sizeof results / sizeof *results; i++)
        if (!same_bytes(a, b, results[i])) fail_msg("%s of %s and %s differ", results[i], a, b);
}

static void two_files_give_the_bytes_of_one(void **state) {
    (void)state;
    const char *one = kit_temp_path("one");
    decompose_well(IN_PLACE, part, NULL, one);
    for (way how = 0; how < WAYS; how++) {
        const char *text = kit_temp_path("text%d", how), *binary = kit_temp_path("binary%d", how);
        decompose_well(how, mesh, parameters, text);
        expect_same_results(one, text);
        decompose_well(how, meshb, parameters, binary);
        expect_same_results(one, binary);
    }
}

/* The stages of the first map are in the daemon's cache already. */
static void another_map_of_the_same_mesh_is_another_job(void **state) {
    (void)state;
    const char *local = kit_temp_path("others"), *first = kit_temp_path("first"), *second = kit_temp_path("second");
    decompose_well(IN_PLACE, mesh, others, local);
    decompose_well(C_CLIENT, mesh, parameters, first);
    decompose_well(C_CLIENT, mesh, others, second);
    expect_same_results(local, second);
    assert_false(same_bytes(first, second, "traced.hexex"));
}

static void what_does_not_belong_together_is_refused(void **state) {
    (void)state;
    const struct {
        const char *input, *side, *says;
    } cases[] = {{mesh, NULL, "a side file with"},
                 {part, parameters, "belongs to a Medit mesh only; the input is hexex"},
                 {mesh, BW_SOURCE_DIR "/api/examples/formats/cube.parameters", "parameters of 6 tets, but the mesh has"}};
    for (way how = 0; how < WAYS; how++)
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
            kit_result r = decompose(how, cases[i].input, cases[i].side, kit_temp_path("none"));
            if (r.exit != 3 || !strstr(r.err, "[parameters-mismatch]") || !strstr(r.err, cases[i].says))
                fail_msg("%s, case %zu: exit %d\n%s", way_name[how], i, r.exit, r.err);
            kit_result_clear(&r);
        }
}

static void what_is_wrong_in_them_is_told_of_them(void **state) {
    (void)state;
    for (way how = 0; how < WAYS; how++) {
        kit_result r = decompose(how, mesh, part, kit_temp_path("none"));
        if (r.exit != 3 || !strstr(r.err, "[syntax]") || !strstr(r.err, "parameters: line 1"))
            fail_msg("%s: exit %d\n%s", way_name[how], r.exit, r.err);
        kit_result_clear(&r);
        r = decompose(how, mesh, kit_temp_path("nothing"), kit_temp_path("none"));
        if (r.exit != 5 || !strstr(r.err, "nothing")) fail_msg("%s: exit %d\n%s", way_name[how], r.exit, r.err);
        kit_result_clear(&r);
    }
}

static const char *write_bytes(const char *name, kit_bytes bytes) {
    const char *path = kit_temp_path("%s", name);
    kit_write_file(path, bytes.bytes, bytes.size);
    free(bytes.bytes);
    return path;
}

static int start(void **state) {
    bw_context ctx;
    bw_tet_mesh m;
    part = kit_temp_path("part.hexex");
    kit_result r = kit_run((const char *[]){kit_program("blockwright"), "sample", "l-shape", "--noise", "0.5", "--perturb",
                                            "1e-6", "--scramble", "cells", "-o", part, NULL});
    if (r.exit != 0) fail_msg("sample: exit %d\n%s", r.exit, r.err);
    kit_result_clear(&r);
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_input_read(&ctx, part, NULL, &m));
    mesh = write_bytes("part.mesh", write_medit(&m, (kit_medit){0}));
    meshb = write_bytes("part.meshb", write_medit(&m, (kit_medit){.binary = 3}));
    parameters = write_bytes("part.parameters", write_parameters(&m));
    for (size_t i = 0; i < 12 * m.tet_count; i++) m.parameter[i / 12][i % 12 / 3][i % 3] *= 2;
    others = write_bytes("other.parameters", write_parameters(&m));
    bw_tet_mesh_clear(&ctx, &m);
    return daemon_begin(state);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(two_files_give_the_bytes_of_one),
    cmocka_unit_test(another_map_of_the_same_mesh_is_another_job),
    cmocka_unit_test(what_does_not_belong_together_is_refused),
    cmocka_unit_test(what_is_wrong_in_them_is_told_of_them),
};
DAEMON_MAIN(tests, start)
