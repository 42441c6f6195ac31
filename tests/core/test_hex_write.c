/* Written hex meshes say what the mesh says; readers that are not ours judge them in test_hex_readers.c (format/hex_write.h). */
#include "core/hex_kit.h"

#include <stdio.h>

#include "format/hex_write.h"

/* ---- Medit, read back token by token ------------------------------------------------------------------------------- */

static double number(char **at) {
    char *end;
    double value = strtod(*at, &end);
    assert_true(end > *at);
    *at = end;
    return value;
}

static void title(char **at, const char *word, size_t count) {
    *at += strspn(*at, " \n");
    size_t n = strlen(word);
    if (strncmp(*at, word, n)) fail_msg("%s expected at %.30s", word, *at);
    *at += n;
    assert_int_equal((size_t)number(at), count);
}

static void indices(char **at, const bw_hvertex *vertex, int count, int64_t reference) {
    for (int i = 0; i < count; i++) assert_int_equal((int64_t)number(at), vertex[i] + 1);
    assert_int_equal((int64_t)number(at), reference);
}

static void check_medit(char *text, const bw_hex_mesh *mesh, const bw_hex_skin *skin) {
    char *at = text + strlen("MeshVersionFormatted 2\nDimension 3\n");
    title(&at, "Vertices", mesh->vertex_count);
    size_t points = 0, boundary = 0;
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        for (int k = 0; k < 3; k++) assert_true(number(&at) == mesh->position[v][k]);
        assert_int_equal((int)number(&at), mesh->held[v]);
        points += mesh->held[v] == BW_HELD_POINT;
    }
    for (int i = 0; i < 2 && points; i++) {
        title(&at, i ? "RequiredVertices" : "Corners", points);
        for (size_t p = 0; p < points; p++) assert_int_equal(mesh->held[(size_t)number(&at) - 1], BW_HELD_POINT);
    }
    if (skin->edge_count) title(&at, "Edges", skin->edge_count);
    for (size_t e = 0; e < skin->edge_count; e++) {
        indices(&at, skin->edge[e].vertex, 2, skin->edge[e].valence);
        boundary += skin->edge[e].boundary;
    }
    if (boundary) title(&at, "Ridges", boundary);
    for (size_t e = 0; e < boundary; e++) assert_true(skin->edge[(size_t)number(&at) - 1].boundary);
    title(&at, "Quadrilaterals", skin->quad_count);
    for (size_t q = 0; q < skin->quad_count; q++) {
        bw_hvertex corner[4];
        for (int i = 0; i < 4; i++) corner[i] = bw_hex_quad_vertex(mesh, &skin->quad[q], i);
        indices(&at, corner, 4, skin->quad[q].surface + 1);
    }
    title(&at, "Hexahedra", mesh->hex_count);
    for (size_t h = 0; h < mesh->hex_count; h++) {
        const bw_hvertex *c = mesh->hex[h], ring[8] = {c[0], c[1], c[3], c[2], c[4], c[5], c[7], c[6]};
        indices(&at, ring, 8, mesh->block[h] + 1);
    }
    assert_string_equal(at, "\nEnd\n");
}

static void medit_says_what_the_mesh_says(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        bw_hex_skin skin;
        uint64_t bytes;
        size_t size;
        hex_kit_sample(&ctx, i, &mesh);
        kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
        const char *path = kit_temp_path("%s.mesh", hex_kit_names[i]);
        kit_expect_ok(&ctx, bw_hex_write_medit(&ctx, &mesh, &skin, path, &bytes));
        char *text = kit_read_file(path, &size);
        assert_int_equal(size, bytes);
        check_medit(text, &mesh, &skin);
        free(text);
        bw_hex_skin_clear(&ctx, &skin);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
}

/* ---- all formats --------------------------------------------------------------------------------------------------- */

static void a_folder_that_is_not_there_is_an_io_error(void **state) {
    (void)state;
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_hex_mesh mesh;
        bw_hex_skin skin;
        hex_kit_sample(&ctx, HEX_KIT_FIVE, &mesh);
        kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
        const char *path = kit_temp_path("not/there.%s", bw_hex_formats[f].name);
        kit_expect_status(&ctx, bw_hex_formats[f].write(&ctx, &mesh, &skin, path, NULL), BW_E_IO);
        bw_hex_skin_clear(&ctx, &skin);
        bw_hex_mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory.used, 0);
    }
}

typedef struct {
    const bw_hex_mesh *mesh;
    const bw_hex_skin *skin;
    int format;
} job;

static bw_status write_one(bw_context *ctx, void *user) {
    job *j = user;
    const char *path = kit_temp_path("memory.%s", bw_hex_formats[j->format].name);
    return bw_hex_formats[j->format].write(ctx, j->mesh, j->skin, path, NULL);
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    bw_hex_skin skin;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    kit_expect_ok(&ctx, bw_hex_skin_init(&ctx, &mesh, &skin));
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++) assert_true(kit_fail_each_allocation(write_one, &(job){&mesh, &skin, f}) > 1);
    bw_hex_skin_clear(&ctx, &skin);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(medit_says_what_the_mesh_says),
    cmocka_unit_test(a_folder_that_is_not_there_is_an_io_error),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
