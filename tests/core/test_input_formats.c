/* The same model in every input format is the same mesh as in .hexex, bit for bit. */
#include "kit/kit.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/input_kit.h"
#include "format/hexex.h"
#include "format/hexex_write.h"
#include "format/input.h"
#include "models/models.h"

static bw_context ctx;
static bw_tet_mesh wanted; /* a model with features of every kind, through .hexex */

static const char *const samples[] = {"plus", "torus-quarter", "tee"};

/* A few of the model's facets become features, turned this way and that. */
static void add_facets(bw_tet_mesh *m) {
    m->feature_facet_count = 5;
    m->feature_facet = bw_resize(&ctx, m->feature_facet, 5, sizeof *m->feature_facet);
    for (size_t i = 0; i < 5; i++)
        for (size_t k = 0; k < 3; k++) m->feature_facet[i][k] = m->tet[7 * i][(i + k) % 4];
}

static void prepare(const char *name) {
    bw_model model;
    bw_model_options options;
    bw_tet_mesh mesh;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.7, options.features = 1, options.scramble = BW_SCRAMBLE_CELLS,
    options.seed = kit_seed();
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, &options, &model));
    const char *path = kit_temp_path("%s.hexex", name);
    kit_expect_ok(&ctx, bw_model_save(&ctx, &model, path));
    bw_model_clear(&ctx, &model);
    kit_expect_ok(&ctx, bw_hexex_read(&ctx, path, &mesh));
    assert_true(mesh.feature_edge_count > 3);
    add_facets(&mesh);
    kit_expect_ok(&ctx, bw_hexex_write_mesh(&ctx, path, &mesh));
    bw_tet_mesh_clear(&ctx, &mesh);
    kit_expect_ok(&ctx, bw_input_read(&ctx, path, NULL, &wanted));
}

static void expect_bytes(const void *got, const void *expected, size_t size) {
    if (size) assert_memory_equal(got, expected, size);
}

static void expect_same(const bw_tet_mesh *got) {
    assert_int_equal(got->vertex_count, wanted.vertex_count);
    assert_int_equal(got->tet_count, wanted.tet_count);
    assert_memory_equal(got->position, wanted.position, wanted.vertex_count * sizeof *wanted.position);
    assert_memory_equal(got->tet, wanted.tet, wanted.tet_count * sizeof *wanted.tet);
    assert_memory_equal(got->parameter, wanted.parameter, wanted.tet_count * sizeof *wanted.parameter);
    assert_int_equal(got->feature_vertex_count, wanted.feature_vertex_count);
    assert_int_equal(got->feature_edge_count, wanted.feature_edge_count);
    assert_int_equal(got->feature_facet_count, wanted.feature_facet_count);
    expect_bytes(got->feature_vertex, wanted.feature_vertex,
                 wanted.feature_vertex_count * sizeof *wanted.feature_vertex);
    expect_bytes(got->feature_edge, wanted.feature_edge,
                 wanted.feature_edge_count * sizeof *wanted.feature_edge);
    expect_bytes(got->feature_facet, wanted.feature_facet,
                 wanted.feature_facet_count * sizeof *wanted.feature_facet);
    assert_int_equal(got->wall_count, 0);
}

/* Reads the bytes as a file and from memory, and frees them. */
static void expect_format(bw_input_format format, kit_bytes file, const kit_bytes *side) {
    bw_tet_mesh got;
    const char *path = kit_temp_path("a.blob"), *side_path = side ? kit_temp_path("a.side") : NULL;
    assert_int_equal(bw_input_detect(file.bytes, file.size), format);
    kit_write_file(path, file.bytes, file.size);
    if (side) kit_write_file(side_path, side->bytes, side->size);
    kit_expect_ok(&ctx, bw_input_read(&ctx, path, side_path, &got));
    expect_same(&got);
    bw_tet_mesh_clear(&ctx, &got);
    char *exact = malloc(file.size); /* no byte behind it */
    memcpy(exact, file.bytes, file.size);
    kit_expect_ok(&ctx, bw_input_read_memory(&ctx, exact, file.size, side ? side->bytes : NULL,
                                             side ? side->size : 0, &got));
    expect_same(&got);
    bw_tet_mesh_clear(&ctx, &got);
    free(exact), free(file.bytes);
}

static void for_each_sample(void (*body)(void)) {
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        bw_context_init(&ctx);
        prepare(samples[i]);
        body();
        bw_tet_mesh_clear(&ctx, &wanted);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void vtk_forms(void) {
    for (int i = 0; i < 16; i++)
        expect_format(
            BW_INPUT_VTK,
            write_vtk(&wanted,
                      (kit_vtk){.binary = i & 1, .version_5 = i & 2, .field = i & 4, .feature_array = i & 8}),
            NULL);
}

static void every_form_of_legacy_vtk_is_the_same_mesh(void **state) {
    (void)state;
    for_each_sample(vtk_forms);
}

static void vtu_forms(void) {
    for (int placing = KIT_ASCII; placing <= KIT_APPENDED_BASE64; placing++)
        for (int i = 0; i < 8; i++)
            expect_format(BW_INPUT_VTU,
                          write_vtu(&wanted, (kit_vtu){.placing = (kit_placing)placing,
                                                       .wide = i & 1,
                                                       .big = i & 2,
                                                       .deflated = i & 4,
                                                       .no_features = i == 3}),
                          NULL);
    for (size_t block = 1; block < 4; block++) /* every phase of base64 */
        expect_format(
            BW_INPUT_VTU,
            write_vtu(&wanted, (kit_vtu){.placing = KIT_INLINE, .deflated = true, .block = 8000 * block}),
            NULL);
}

static void every_form_of_vtu_is_the_same_mesh(void **state) {
    (void)state;
    for_each_sample(vtu_forms);
}

static void msh_forms(void) {
    for (int i = 0; i < 32; i++)
        if ((i & 2) || !(i & 4)) /* only binary files have a byte order */
            expect_format(BW_INPUT_MSH,
                          write_msh(&wanted, (kit_msh){.version_2 = i & 1,
                                                       .binary = i & 2,
                                                       .big = i & 4,
                                                       .sparse = i & 8,
                                                       .no_names = i & 16}),
                          NULL);
}

static void every_form_of_gmsh_is_the_same_mesh(void **state) {
    (void)state;
    for_each_sample(msh_forms);
}

static void medit_forms(void) {
    kit_bytes side = write_parameters(&wanted);
    static const int version[] = {0, 2, 3, 4};
    for (int i = 0; i < 4; i++)
        for (int big = 0; big < 2; big++)
            expect_format(BW_INPUT_MEDIT, write_medit(&wanted, (kit_medit){.binary = version[i], .big = big}),
                          &side);
    free(side.bytes);
}

static void medit_with_a_side_file_is_the_same_mesh(void **state) {
    (void)state;
    for_each_sample(medit_forms);
}

static int by_bytes2(const void *a, const void *b) {
    return memcmp(a, b, 8);
}
static int by_bytes3(const void *a, const void *b) {
    return memcmp(a, b, 12);
}
static int by_vertex(const void *a, const void *b) {
    return memcmp(a, b, 4);
}

/* OVM keeps marks at the faces and edges themselves: which of them are features, not in what order they were
 * listed. */
static void sort_features(bw_tet_mesh *m) {
    for (size_t i = 0; i < m->feature_edge_count; i++) {
        int32_t key[3];
        ovm_sorted(m->feature_edge[i], 2, key);
        memcpy(m->feature_edge[i], key, sizeof m->feature_edge[i]);
    }
    for (size_t i = 0; i < m->feature_facet_count; i++) {
        int32_t key[3];
        ovm_sorted(m->feature_facet[i], 3, key);
        memcpy(m->feature_facet[i], key, sizeof key);
    }
    if (m->feature_vertex_count)
        qsort(m->feature_vertex, m->feature_vertex_count, sizeof *m->feature_vertex, by_vertex);
    qsort(m->feature_edge, m->feature_edge_count, sizeof *m->feature_edge, by_bytes2);
    qsort(m->feature_facet, m->feature_facet_count, sizeof *m->feature_facet, by_bytes3);
}

static void ovm_forms(void) {
    bw_tet_mesh got;
    turn_tets_for_ovm(&wanted);
    sort_features(&wanted);
    static const char *const names[] = {"HexHex::Parametrization", "Parametrization", "param"};
    for (int i = 0; i < 3; i++) {
        kit_bytes file = write_ovm(&wanted, names[i]);
        assert_int_equal(bw_input_detect(file.bytes, file.size), BW_INPUT_OVM);
        kit_expect_ok(&ctx, bw_input_read_memory(&ctx, file.bytes, file.size, NULL, 0, &got));
        sort_features(&got);
        expect_same(&got);
        bw_tet_mesh_clear(&ctx, &got);
        free(file.bytes);
    }
}

static void openvolumemesh_is_the_same_mesh(void **state) {
    (void)state;
    for_each_sample(ovm_forms);
}

/* ---- ways in ------------------------------------------------------------------------------------------- */

static void a_descriptor_under_proc_is_read_wherever_it_stands(void **state) {
    (void)state;
    bw_context_init(&ctx);
    prepare("plus");
    kit_bytes files[2] = {write_vtk(&wanted, (kit_vtk){.binary = true}), {0}};
    files[1].bytes = kit_read_file(kit_temp_path("plus.hexex"), &files[1].size);
    for (int i = 0; i < 2; i++) {
        const char *path = kit_temp_path("file-%d", i);
        kit_write_file(path, files[i].bytes, files[i].size);
        int fd = open(path, O_RDONLY);
        assert_int_equal(lseek(fd, 100, SEEK_SET), 100);
        char name[40];
        snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
        bw_tet_mesh got;
        kit_expect_ok(&ctx, bw_input_read(&ctx, name, NULL, &got));
        close(fd);
        expect_same(&got);
        bw_tet_mesh_clear(&ctx, &got);
        free(files[i].bytes);
    }
    bw_tet_mesh_clear(&ctx, &wanted);
    assert_int_equal(ctx.memory.used, 0);
}

static void a_pipe_is_read_in_any_format(void **state) {
    (void)state;
    bw_context_init(&ctx);
    prepare("plus");
    kit_bytes files[3] = {write_vtu(&wanted, (kit_vtu){.placing = KIT_APPENDED_RAW}),
                          write_msh(&wanted, (kit_msh){.binary = true}),
                          {0}};
    files[2].bytes = kit_read_file(kit_temp_path("plus.hexex"), &files[2].size);
    for (int i = 0; i < 3; i++) {
        int end[2];
        assert_int_equal(pipe(end), 0);
        pid_t child = fork();
        if (!child) {
            close(end[0]);
            for (size_t at = 0; at < files[i].size;) {
                ssize_t n =
                    write(end[1], files[i].bytes + at, files[i].size - at < 1000 ? files[i].size - at : 1000);
                if (n <= 0) _exit(1);
                at += (size_t)n;
            }
            _exit(0);
        }
        close(end[1]);
        char name[40];
        snprintf(name, sizeof name, "/dev/fd/%d", end[0]);
        bw_tet_mesh got;
        bw_status status = bw_input_read(&ctx, name, NULL, &got);
        close(end[0]);
        waitpid(child, NULL, 0);
        kit_expect_ok(&ctx, status);
        expect_same(&got);
        bw_tet_mesh_clear(&ctx, &got);
        free(files[i].bytes);
    }
    bw_tet_mesh_clear(&ctx, &wanted);
    assert_int_equal(ctx.memory.used, 0);
}

typedef struct {
    kit_bytes file, side;
} job;

static bw_status read_job(bw_context *c, void *user) {
    job *j = user;
    bw_tet_mesh mesh;
    bw_status status =
        bw_input_read_memory(c, j->file.bytes, j->file.size, j->side.bytes, j->side.size, &mesh);
    bw_tet_mesh_clear(c, &mesh);
    return status;
}

static void every_refused_allocation_is_an_error_without_a_leak(void **state) {
    (void)state;
    bw_context_init(&ctx);
    prepare("plus");
    job jobs[] = {{write_vtk(&wanted, (kit_vtk){.version_5 = true, .feature_array = true}), {0}},
                  {write_vtk(&wanted, (kit_vtk){.binary = true, .field = true}), {0}},
                  {write_vtu(&wanted, (kit_vtu){.placing = KIT_ASCII}), {0}},
                  {write_vtu(&wanted, (kit_vtu){.placing = KIT_APPENDED_BASE64, .deflated = true}), {0}},
                  {write_msh(&wanted, (kit_msh){.sparse = true}), {0}},
                  {write_medit(&wanted, (kit_medit){0}), write_parameters(&wanted)},
                  {write_ovm(&wanted, "uvw"), {0}}};
    for (size_t i = 0; i < sizeof jobs / sizeof *jobs; i++) {
        assert_true(kit_fail_each_allocation(read_job, &jobs[i]) > 5);
        free(jobs[i].file.bytes), free(jobs[i].side.bytes);
    }
    bw_tet_mesh_clear(&ctx, &wanted);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_form_of_legacy_vtk_is_the_same_mesh),
    cmocka_unit_test(every_form_of_vtu_is_the_same_mesh),
    cmocka_unit_test(every_form_of_gmsh_is_the_same_mesh),
    cmocka_unit_test(medit_with_a_side_file_is_the_same_mesh),
    cmocka_unit_test(openvolumemesh_is_the_same_mesh),
    cmocka_unit_test(a_descriptor_under_proc_is_read_wherever_it_stands),
    cmocka_unit_test(a_pipe_is_read_in_any_format),
    cmocka_unit_test(every_refused_allocation_is_an_error_without_a_leak),
};
KIT_MAIN(tests)
