/* Damaged maps through all stages: sample models and the files of the shared data, some of whose vertices are
 * moved so that tets around them are inverted. What comes out passes the check of traced meshes, and a
 * checker of somebody else's where there is one.
 */
#include "core/fold_kit.h"

#include <jansson.h>
#include <stdio.h>

#include "blockwright.h"
#include "core/traced_check.h"
#include "format/hexex.h"
#include "format/hexex_write.h"

enum { FOLDS = 6, FILES = 8 };

/* A wall checker that may come with the shared data. */
static bool check_by_other(const char *traced) {
    char path[1100];
    size_t count;
    const char *tools = BW_SHARED_DIR "/tools";
    if (!kit_exists(tools)) return false;
    char **names = kit_names(tools, "_walls.py", &count);
    if (count) {
        snprintf(path, sizeof path, "%s/%s", tools, names[0]);
        setenv("XDG_CACHE_HOME", kit_temp_dir(), 1);
        kit_result result = kit_run((const char *const[]){"python3", path, traced, NULL});
        if (result.exit) print_message("%s%s", result.out, result.err);
        assert_int_equal(result.exit, 0);
        kit_result_clear(&result);
    }
    kit_names_free(names, count);
    return count > 0;
}

static json_int_t repaired(const char *results, const char *what) {
    char path[1100];
    json_error_t error;
    snprintf(path, sizeof path, "%s/report.json", results);
    json_t *root = json_load_file(path, 0, &error);
    assert_non_null(root);
    const json_t *section = json_object_get(json_object_get(root, "sanitize"), "repaired");
    json_int_t value = json_integer_value(json_object_get(section, what));
    json_decref(root);
    return value;
}

/* Runs the damaged file as it is, which fails with the places, and with repair. */
static void run_damaged(const char *name, const char *input) {
    const char *results = kit_temp_path("out"), *traced = kit_temp_path("out/traced.hexex");
    bw_context ctx;
    bw_options options;
    traced_verdict verdict;
    bw_options_defaults(&options);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_run(&ctx, &options, input, results), BW_E_INVERTED);
    assert_in_range(ctx.error.region_count, 1, FOLDS);
    bw_context_init(&ctx);
    options.repair = true;
    kit_expect_ok(&ctx, bw_run(&ctx, &options, input, results));
    assert_int_equal(ctx.memory.used, 0);
    print_message("%s: %d tets in %d regions, %d vertices moved\n", name, (int)repaired(results, "tets"),
                  (int)repaired(results, "regions"), (int)repaired(results, "vertices_moved"));
    assert_true(repaired(results, "tets") >= 1 && repaired(results, "vertices_moved") >= 1);
    char *text = kit_read_file(traced, NULL);
    assert_true(traced_check(text, true, &verdict));
    free(text);
    if (traced_faults(&verdict)) traced_print(name, &verdict);
    assert_int_equal(traced_faults(&verdict), 0);
    check_by_other(traced);
}

static void folded_samples_pass_all_stages(void **state) {
    static const char *const names[] = {"ball", "torus-quarter", "plate", "bearing"};
    kit_random random = kit_random_start(1);
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        bw_model_options o =
            model_options(2, 0.5, i % 2 ? 1e-6 : 0, (int)(i % 4), kit_random_next(&random) % 100000);
        const char *path = kit_temp_path("in.hexex");
        bw_context ctx;
        o.folds = FOLDS;
        bw_model model = make_model(names[i], &o);
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
        drop_model(&model);
        print_message("seed %llu, ", (unsigned long long)o.seed);
        run_damaged(names[i], path);
    }
}

/* A file as a model: what the fold kit works on. */
static bw_model read_model(const char *path) {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_model model = {0};
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_hexex_read(&ctx, path, &mesh));
    model.vertex_count = mesh.vertex_count, model.tet_count = mesh.tet_count;
    model.feature_vertex_count = mesh.feature_vertex_count,
    model.feature_edge_count = mesh.feature_edge_count;
    model.position = mesh.position, model.tet = mesh.tet, model.parameter = mesh.parameter;
    model.feature_vertex = mesh.feature_vertex, model.feature_edge = mesh.feature_edge;
    mesh.position = NULL, mesh.tet = NULL, mesh.parameter = NULL, mesh.feature_vertex = NULL,
    mesh.feature_edge = NULL;
    bw_tet_mesh_clear(&ctx, &mesh);
    return model;
}

static void damage_file(const char *from, const char *to, kit_random *random) {
    folder f;
    sanitized damaged;
    fold_start(&f, read_model(from), 1e-4);
    fold_copy(&f, &damaged);
    for (int i = 0; i < FOLDS; i++) {
        static const int kinds[FOLDS] = {0, FOLD_BOUNDARY, FOLD_SINGULAR, FOLD_NEAR_SINGULAR, FOLD_SEAM, 0};
        bw_vertex v;
        fold_star star;
        if (fold_pick(&f, random, kinds[i], 0, &v, &star)) fold_past(&f, random, &star, 1.3, &damaged);
    }
    kit_expect_ok(&damaged.ctx, bw_hexex_write_mesh(&damaged.ctx, to, &damaged.mesh));
    drop_sanitized(&damaged);
    fold_end(&f);
}

/* BW_REPAIR_FILES=all takes every file. */
static void folded_files_of_the_shared_data_pass_all_stages(void **state) {
    size_t count;
    const char *data = kit_shared("data/tet"), *all = getenv("BW_REPAIR_FILES");
    char **names = kit_names(data, ".hexex", &count);
    kit_random random = kit_random_start(2);
    (void)state;
    for (size_t i = 0; i < count; i++) {
        char path[1100];
        if (!all && i % (count / FILES)) continue;
        const char *damaged = kit_temp_path("damaged.hexex");
        snprintf(path, sizeof path, "%s/%s", data, names[i]);
        damage_file(path, damaged, &random);
        run_damaged(names[i], damaged);
    }
    kit_names_free(names, count);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(folded_samples_pass_all_stages),
        cmocka_unit_test(folded_files_of_the_shared_data_pass_all_stages),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
