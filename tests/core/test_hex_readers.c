/* Written hex meshes, read by programs that are not ours: meshio, VTK, Gmsh, the CGNS tools; each is skipped where it is not installed.
 *
 * hex_readers.py compares what they read with the mesh: positions to the last bit, corners in order, blocks, ijk, surfaces, edges, and that every hex is positive.
 */
#include "core/hex_files.h"

static int write_all(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i <= HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        bw_hex_skin skin;
        const char *name = i < HEX_KIT_COUNT ? hex_kit_names[i] : "no-blocks";
        hex_kit_sample(&ctx, i % HEX_KIT_COUNT, &mesh);
        for (size_t h = 0; h < mesh.hex_count && i == HEX_KIT_COUNT; h++) mesh.block[h] = mesh.block[h] == 1 ? BW_NONE : mesh.block[h];
        kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
        hex_files_truth(&mesh, &skin, kit_temp_path("%s.json", name));
        for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++)
            kit_expect_ok(&ctx, bw_hex_formats[f].write(&ctx, &mesh, &skin, kit_temp_path("%s.%s", name, bw_hex_formats[f].name), NULL));
        bw_hex_skin_clear(&ctx, &skin);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
    return 0;
}

static void read_with(const char *reader) {
    const char *script = BW_SOURCE_DIR "/tests/core/hex_readers.py";
    kit_result r = kit_run((const char *const[]){"/usr/bin/python3", script, reader, kit_temp_dir(), NULL});
    printf("%s", r.out);
    if (r.exit == 77) kit_skip("%s is not installed", reader);
    if (r.exit) fail_msg("%s: exit %d: %s", reader, r.exit, r.err);
    kit_result_clear(&r);
}

static void meshio_reads_what_was_written(void **state) {
    (void)state;
    read_with("meshio");
}
static void vtk_reads_what_was_written(void **state) {
    (void)state;
    read_with("vtk");
}
static void gmsh_reads_what_was_written(void **state) {
    (void)state;
    read_with("gmsh");
}
static void vtk_reads_the_zones_that_were_written(void **state) {
    (void)state;
    read_with("cgns");
}
static void cgnscheck_finds_nothing(void **state) {
    (void)state;
    read_with("cgnscheck");
}
static void an_openvolumemesh_file_is_what_its_kernel_asks_for(void **state) {
    (void)state;
    read_with("ovm");
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(meshio_reads_what_was_written),
    cmocka_unit_test(vtk_reads_what_was_written),
    cmocka_unit_test(gmsh_reads_what_was_written),
    cmocka_unit_test(vtk_reads_the_zones_that_were_written),
    cmocka_unit_test(cgnscheck_finds_nothing),
    cmocka_unit_test(an_openvolumemesh_file_is_what_its_kernel_asks_for),
};

int main(void) {
    return kit_exit(cmocka_run_group_tests(tests, write_all, NULL), sizeof tests / sizeof *tests);
}
