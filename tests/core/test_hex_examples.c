/* The files in api/examples/hexmesh are what the writers write today. BW_KEEP=1 keeps the new ones, for a change that is meant. */
#include <stdio.h>

#include "bwh.h"
#include "core/hex_kit.h"
#include "format/hex_write.h"

static void point(const void *user, int block, const int32_t at[3], int64_t key[4], double position[3]) {
    const hex_kit_box *box = (const hex_kit_box *)user + block;
    key[3] = 0;
    for (int k = 0; k < 3; k++) key[2 - k] = box->low[k] + at[k], position[k] = 0.5 * (box->low[k] + at[k]);
    position[0] += 0.125 * position[2] * position[2]; /* a little askew */
}

/* One block of two hexes on top of two blocks of one. */
static void make(bw_context *ctx, bw_hex_mesh *mesh) {
    static const hex_kit_box box[] = {{{0, 0, 0}, {1, 1, 1}}, {{1, 0, 0}, {2, 1, 1}}, {{0, 0, 1}, {2, 1, 2}}};
    hex_kit_block block[3];
    for (int b = 0; b < 3; b++) {
        block[b] = (hex_kit_block){.point = point, .user = box};
        for (int k = 0; k < 3; k++) block[b].n[k] = box[b].high[k] - box[b].low[k];
    }
    hex_kit_make(ctx, block, 3, kit_random_of(1, 0), 0, mesh);
}

static char *example(const char *extension, size_t *size) {
    char path[512];
    snprintf(path, sizeof path, "%s/api/examples/hexmesh/hexmesh.%s", BW_SOURCE_DIR, extension);
    return kit_read_file(path, size);
}

/* Formats that a library makes may differ in bytes from version to version of it. */
static bool own_bytes(int format) {
    return format != BW_HEX_FORMAT_CGNS;
}

static void examples_are_what_is_written(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_hex_skin skin;
    bw_context_init(&ctx);
    make(&ctx, &mesh);
    kit_expect_ok(&ctx, bw_hex_mesh_check(&ctx, &mesh));
    kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++)
        kit_expect_ok(&ctx, bw_hex_formats[f].write(&ctx, &mesh, &skin, kit_temp_path("hexmesh.%s", bw_hex_formats[f].name), NULL));
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++) {
        size_t size[2];
        if (!own_bytes(f)) continue;
        char *now = kit_read_file(kit_temp_path("hexmesh.%s", bw_hex_formats[f].name), &size[0]), *then = example(bw_hex_formats[f].name, &size[1]);
        if (size[0] != size[1] || memcmp(now, then, size[0])) fail_msg("api/examples/hexmesh/hexmesh.%s is not what is written", bw_hex_formats[f].name);
        free(now), free(then);
    }
    bw_hex_skin_clear(&ctx, &skin);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static void the_compact_example_decodes_to_the_same_mesh(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bwh_mesh got;
    size_t size;
    bw_context_init(&ctx);
    make(&ctx, &mesh);
    char *bytes = example("bwh", &size);
    assert_int_equal(bwh_decode(bytes, size, 0, &got), BWH_OK);
    assert_int_equal(got.hex_count, 4);
    assert_int_equal(got.part_count, 3);
    for (size_t g = 0; g < 4; g++) {
        size_t h = 0;
        while (h < 4 && (mesh.block[h] != got.block[g] || memcmp(mesh.ijk[h], got.ijk[g], sizeof *mesh.ijk))) h++;
        assert_true(h < 4);
        for (int c = 0; c < 8; c++) assert_memory_equal(mesh.position[mesh.hex[h][c]], got.position[got.hex[g][c]], sizeof *mesh.position);
    }
    free(bytes);
    bwh_clear(&got);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(examples_are_what_is_written),
    cmocka_unit_test(the_compact_example_decodes_to_the_same_mesh),
};
KIT_MAIN(tests)
