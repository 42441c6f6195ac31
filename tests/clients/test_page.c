/* The page for browsers: what it finds in a mesh is what the core finds, and a real browser shows jobs, their reports and their meshes. */
#include "clients/daemon.h"
#include "core/hex_kit.h"

#include "format/hex_bwh.h"
#include "hex/quality.h"
#include "hex/skin.h"

static void write_bwh(bw_context *ctx, const bw_hex_mesh *mesh, const char *path, size_t *quads) {
    uint64_t bytes;
    bw_hex_skin skin;
    kit_expect_ok(ctx, bw_hex_skin_init(ctx, mesh, &skin));
    kit_expect_ok(ctx, bw_hex_write_bwh(ctx, mesh, &skin, path, &bytes));
    *quads = skin.quad_count;
    bw_hex_skin_clear(ctx, &skin);
}

static void need(const char *program) {
    kit_result r = kit_run((const char *const[]){program, "--version", NULL});
    bool there = r.exit == 0;
    kit_result_clear(&r);
    if (!there) kit_skip("%s is not installed", program);
}

/* Compares a line of skin_test.mjs with the core. */
static char *check_line(bw_context *ctx, const bw_hex_mesh *mesh, size_t quads, char *line) {
    bw_hex_quality q;
    kit_expect_ok(ctx, bw_hex_measure(ctx, mesh, &q));
    assert_int_equal(strtoull(line, &line, 10), quads);
    for (int k = 0; k < 3; k++) {
        size_t behind = 0; /* the first layer of every block */
        for (size_t h = 0; h < mesh->hex_count; h++) behind += mesh->ijk[h][k] > 0;
        assert_int_equal(strtoull(line, &line, 10), behind);
    }
    assert_float_equal(strtod(line, &line), q.scaled_jacobian.min, 0);
    for (int i = 0; i < BW_HEX_BINS; i++) assert_int_equal(strtoull(line, &line, 10), q.histogram[i]);
    for (int i = 0; i < BW_HEX_VALENCES; i++) assert_int_equal(strtoull(line, &line, 10), i == 4 ? 0 : q.inner[i]); /* the page looks for irregular ones */
    for (int i = 0; i < BW_HEX_VALENCES; i++) assert_int_equal(strtoull(line, &line, 10), i == 2 ? 0 : q.boundary[i]);
    assert_int_equal(*line, '\n');
    return line + 1;
}

static void skin_layers_quality_and_irregular_edges_are_those_of_the_core(void **state) {
    (void)state;
    const char *argv[HEX_KIT_COUNT + 3] = {"node", BW_SOURCE_DIR "/tests/clients/page/skin_test.mjs"};
    bw_context ctx;
    bw_hex_mesh mesh[HEX_KIT_COUNT];
    size_t quads[HEX_KIT_COUNT];
    need("node");
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        hex_kit_sample(&ctx, i, &mesh[i]);
        argv[2 + i] = strdup(kit_temp_path("%s.bwh", hex_kit_names[i]));
        write_bwh(&ctx, &mesh[i], argv[2 + i], &quads[i]);
    }
    kit_result r = kit_run(argv);
    if (r.exit) fail_msg("node: exit %d: %s", r.exit, r.err);
    char *line = r.out;
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        line = check_line(&ctx, &mesh[i], quads[i], line);
        free((void *)argv[2 + i]);
        bw_hex_mesh_clear(&ctx, &mesh[i]);
    }
    kit_result_clear(&r);
    assert_int_equal(ctx.memory.used, 0);
}

static void numbers_and_reports_are_told_as_people_read_them(void **state) {
    (void)state;
    need("node");
    kit_result r = kit_run((const char *const[]){"node", BW_SOURCE_DIR "/tests/clients/page/text_test.mjs", NULL});
    if (r.exit) fail_msg("node: exit %d: %s", r.exit, r.err);
    kit_result_clear(&r);
}

/* Runs the program, which has to end with `exit`, and gives the first word that it prints. */
static char *run(int exit, const char *const argv[]) {
    kit_result r = kit_run(argv);
    if (r.exit != exit) fail_msg("%s: exit %d: %s", argv[1], r.exit, r.err);
    char *word = strndup(r.out, strcspn(r.out, " \n"));
    kit_result_clear(&r);
    return word;
}

typedef struct {
    char *cube, *search[2], *refused; /* ids */
} page_jobs;

/* A job of 3 x 3 x 3 hexes; two of hexahedra whose search has no end; one of tets that is to be of hexes. */
static void make_jobs(page_jobs *jobs) {
    const char *program = kit_program("blockwright"), *cube = kit_temp_path("cube.hexex"), *part = kit_temp_path("bearing.hexex"), *hexes = kit_temp_path("hexes");
    free(run(0, (const char *const[]){program, "sample", "cuboid", "--size", "3", "-o", cube, NULL}));
    free(run(0, (const char *const[]){program, "sample", "bearing", "--size", "1", "-o", part, NULL}));
    free(run(0, (const char *const[]){program, "run", part, "--out", hexes, "--quantize", "positive", "--coarsest", "--route", "guaranteed", "--quiet", NULL}));
    jobs->cube = run(0, (const char *const[]){program, "submit", cube, "--server", here.url, "--quantize", "positive", "--coarsest", "--subdivide", "3", "--wait", "--quiet", NULL});
    jobs->refused = run(3, (const char *const[]){program, "submit", part, "--server", here.url, "--kind", "hex", "--wait", "--quiet", NULL});
    for (int i = 0; i < 2; i++)
        jobs->search[i] = run(0, (const char *const[]){program, "submit", kit_temp_path("hexes/hexmesh.mesh"), "--server", here.url, "--kind", "hex", "--explore", "anneal", "--explore-work",
                                                       "1000000000", "--explore-time", "3600", "--seed", i ? "2" : "1", "--quiet", NULL});
}

static void clear_jobs(page_jobs *jobs) {
    free(jobs->cube), free(jobs->search[0]), free(jobs->search[1]), free(jobs->refused);
}

static void a_browser_shows_jobs_their_reports_and_meshes(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    size_t size, quads;
    need("node");
    need("chromium");
    char *folder = strdup(kit_temp_dir()), *large = strdup(kit_temp_path("large.bwh")), *damaged = strdup(kit_temp_path("damaged.bwh"));
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, 100, &mesh);
    write_bwh(&ctx, &mesh, large, &quads);
    bw_hex_mesh_clear(&ctx, &mesh);
    char *bytes = kit_read_file(large, &size);
    kit_write_file(damaged, bytes, size / 2);
    free(bytes);
    page_jobs jobs;
    make_jobs(&jobs);
    kit_result r = kit_run((const char *const[]){"node", BW_SOURCE_DIR "/tests/clients/page/page_test.mjs", "chromium", folder, here.url, damaged, large, jobs.cube, jobs.search[0],
                                                 jobs.search[1], jobs.refused, NULL});
    printf("%s", r.out);
    if (r.exit) fail_msg("the page: exit %d: %s", r.exit, r.err);
    kit_result_clear(&r);
    clear_jobs(&jobs);
    free(folder), free(large), free(damaged);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(numbers_and_reports_are_told_as_people_read_them),
    cmocka_unit_test(skin_layers_quality_and_irregular_edges_are_those_of_the_core),
    cmocka_unit_test_setup_teardown(a_browser_shows_jobs_their_reports_and_meshes, daemon_begin, daemon_end),
};
KIT_MAIN(tests)
