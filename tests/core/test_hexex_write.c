/* What the writer writes, the reader reads back bit for bit. */
#include "kit/kit.h"

#include <gmp.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/hexex.h"
#include "format/hexex_write.h"

static bw_context ctx;

static int start(void **state) {
    (void)state;
    bw_context_init(&ctx);
    return 0;
}

static int finish(void **state) {
    (void)state;
    return ctx.memory.used ? -1 : 0;
}

static bool same(const void *a, const void *b, size_t size) { return !size || !memcmp(a, b, size); }

static void fill_numbers(kit_random *random, double *number, size_t count) {
    for (size_t i = 0; i < count; i++) {
        uint64_t kind = kit_random_below(random, 5);
        number[i] = kind == 0   ? kit_random_bits(random) /* any exponent: huge, tiny, subnormal */
                    : kind == 1 ? kit_random_range(random, -10, 10)
                    : kind == 2 ? (double)(int64_t)kit_random_below(random, 100) - 50
                    : kind == 3 ? ldexp((double)kit_random_below(random, 1000), -1074)
                                : -0.0;
    }
}

static void fill_indices(kit_random *random, bw_vertex *index, size_t count, size_t bound) {
    for (size_t i = 0; i < count; i++) index[i] = (bw_vertex)kit_random_below(random, bound);
}

/* Not a mesh in any other sense than that the format can hold it. */
static bw_tet_mesh random_mesh(kit_random *random, size_t vertices, size_t tets, size_t walls, size_t features) {
    bw_tet_mesh m = {.vertex_count = vertices, .tet_count = tets, .wall_count = walls, .feature_vertex_count = features,
                     .feature_edge_count = 2 * features, .feature_facet_count = 3 * features};
    m.position = bw_alloc(&ctx, vertices, sizeof *m.position);
    m.tet = bw_alloc(&ctx, tets, sizeof *m.tet);
    m.parameter = bw_alloc(&ctx, tets, sizeof *m.parameter);
    m.wall = bw_alloc(&ctx, walls, sizeof *m.wall);
    m.wall_distance = bw_alloc(&ctx, walls, sizeof *m.wall_distance);
    m.feature_vertex = bw_alloc(&ctx, features, sizeof *m.feature_vertex);
    m.feature_edge = bw_alloc(&ctx, 2 * features, sizeof *m.feature_edge);
    m.feature_facet = bw_alloc(&ctx, 3 * features, sizeof *m.feature_facet);
    fill_numbers(random, &m.position[0][0], 3 * vertices);
    fill_numbers(random, &m.parameter[0][0][0], 12 * tets);
    fill_numbers(random, m.wall_distance, walls);
    fill_indices(random, &m.tet[0][0], 4 * tets, vertices);
    fill_indices(random, &m.wall[0][0], 3 * walls, vertices);
    fill_indices(random, m.feature_vertex, features, vertices);
    fill_indices(random, &m.feature_edge[0][0], 4 * features, vertices);
    fill_indices(random, &m.feature_facet[0][0], 9 * features, vertices);
    return m;
}

static void expect_same(const bw_tet_mesh *a, const bw_tet_mesh *b) {
    assert_int_equal(a->vertex_count, b->vertex_count);
    assert_int_equal(a->tet_count, b->tet_count);
    assert_int_equal(a->wall_count, b->wall_count);
    assert_int_equal(a->feature_vertex_count, b->feature_vertex_count);
    assert_int_equal(a->feature_edge_count, b->feature_edge_count);
    assert_int_equal(a->feature_facet_count, b->feature_facet_count);
    assert_true(same(a->position, b->position, a->vertex_count * sizeof *a->position));
    assert_true(same(a->tet, b->tet, a->tet_count * sizeof *a->tet));
    assert_true(same(a->parameter, b->parameter, a->tet_count * sizeof *a->parameter));
    assert_true(same(a->wall, b->wall, a->wall_count * sizeof *a->wall));
    assert_true(same(a->wall_distance, b->wall_distance, a->wall_count * sizeof *a->wall_distance));
    assert_true(same(a->feature_vertex, b->feature_vertex, a->feature_vertex_count * sizeof *a->feature_vertex));
    assert_true(same(a->feature_edge, b->feature_edge, a->feature_edge_count * sizeof *a->feature_edge));
    assert_true(same(a->feature_facet, b->feature_facet, a->feature_facet_count * sizeof *a->feature_facet));
}

static void a_mesh_with_any_doubles_and_lists_comes_back_bit_for_bit(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    const char *path = kit_temp_path("round.hexex");
    for (int lists = 0; lists < 4; lists++) { /* none, walls, features, both */
        bw_tet_mesh m = random_mesh(&random, 2000, 5000, lists & 1 ? 700 : 0, lists & 2 ? 100 : 0), back;
        kit_expect_ok(&ctx, bw_hexex_write_mesh(&ctx, path, &m));
        kit_expect_ok(&ctx, bw_hexex_read(&ctx, path, &back));
        expect_same(&m, &back);
        bw_tet_mesh_clear(&ctx, &m);
        bw_tet_mesh_clear(&ctx, &back);
    }
}

static void exact_rationals_are_written_as_given_and_read_to_the_nearest_double(void **state) {
    (void)state;
    kit_random random = kit_random_start(2);
    const char *path = kit_temp_path("rational.hexex");
    const double corner[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const bw_vertex index[4] = {0, 1, 2, 3};
    double exact[12]; /* dyadic, so the nearest double is the number itself */
    char *text[12];
    mpq_t q;
    mpq_init(q);
    for (int i = 0; i < 12; i++) {
        exact[i] = kit_random_range(&random, -1000, 1000);
        mpq_set_d(q, exact[i]);
        mpz_mul_ui(mpq_numref(q), mpq_numref(q), 3); /* not in lowest terms: still the same number */
        mpz_mul_ui(mpq_denref(q), mpq_denref(q), 3);
        text[i] = mpq_get_str(NULL, 10, q);
    }
    mpq_clear(q);
    bw_hexex_writer w;
    kit_expect_ok(&ctx, bw_hexex_write_begin(&ctx, &w, path, 4));
    for (int i = 0; i < 4; i++) bw_hexex_write_vertex(&w, corner[i]);
    bw_hexex_write_tets(&w, 1);
    bw_hexex_write_tet_text(&w, index, (const char *const *)text);
    uint64_t bytes;
    kit_expect_ok(&ctx, bw_hexex_write_end(&w, &bytes));
    size_t size;
    char *file = kit_read_file(path, &size);
    assert_int_equal(size, bytes);
    for (int i = 0; i < 12; i++) {
        assert_non_null(strstr(file, text[i]));
        free(text[i]);
    }
    free(file);
    bw_tet_mesh m;
    kit_expect_ok(&ctx, bw_hexex_read(&ctx, path, &m));
    assert_memory_equal(m.parameter, exact, sizeof exact);
    bw_tet_mesh_clear(&ctx, &m);
}

static void the_same_mesh_gives_the_same_bytes(void **state) {
    (void)state;
    bw_tet_mesh m = {.vertex_count = 4, .tet_count = 1, .wall_count = 1};
    double position[4][3] = {{0, 0, 0.1}, {1e-7, 0, 0}, {0, 1e20, 0}, {0, 0, -1.5}}, parameter[1][4][3] = {{{0.5}}}, distance = 0.25;
    bw_vertex tet[1][4] = {{0, 1, 2, 3}}, wall[1][3] = {{0, 1, 2}};
    m.position = position, m.parameter = parameter, m.tet = tet, m.wall = wall, m.wall_distance = &distance;
    const char *path = kit_temp_path("bytes.hexex");
    kit_expect_ok(&ctx, bw_hexex_write_mesh(&ctx, path, &m));
    char *text = kit_read_file(path, NULL);
    assert_string_equal(text, "4\n0 0 0.1\n1e-7 0 0\n0 1e20 0\n0 0 -1.5\n1\n0 1 2 3 0.5 0 0 0 0 0 0 0 0 0 0 0\n1\n0 1 2 0.25\n");
    free(text);
}

static void a_full_disk_is_an_io_error(void **state) {
    (void)state;
    if (!kit_exists("/dev/full")) kit_skip("/dev/full is not here");
    kit_random random = kit_random_start(3);
    bw_tet_mesh m = random_mesh(&random, 20000, 10, 0, 0);
    bw_status status = bw_hexex_write_mesh(&ctx, "/dev/full", &m);
    bw_tet_mesh_clear(&ctx, &m);
    kit_expect_status(&ctx, status, BW_E_IO);
}

static void a_folder_that_is_not_there_is_an_io_error(void **state) {
    (void)state;
    bw_tet_mesh m = {0};
    kit_expect_status(&ctx, bw_hexex_write_mesh(&ctx, kit_temp_path("no/where.hexex"), &m), BW_E_IO);
}

static bw_status write_wrongly(int how) {
    const double origin[3] = {0}, bad[3] = {0, NAN, 0}, tet[4][3] = {{0}};
    const bw_vertex corner[4] = {0};
    bw_hexex_writer w;
    bw_context_init(&ctx);
    bw_hexex_write_begin(&ctx, &w, kit_temp_path("wrong.hexex"), 1);
    if (how == 0) bw_hexex_write_vertex(&w, bad);
    if (how != 1) bw_hexex_write_vertex(&w, origin);
    if (how == 2) bw_hexex_write_vertex(&w, origin);
    bw_hexex_write_tets(&w, 1);
    if (how != 3) bw_hexex_write_tet(&w, corner, tet);
    if (how == 4) bw_hexex_write_wall(&w, corner, 0);
    if (how == 5) bw_hexex_write_walls(&w, 1);
    if (how == 6) bw_hexex_write_features(&w, 1, 1, 0), bw_hexex_write_feature_edge(&w, corner);
    if (how == 7) bw_hexex_write_features(&w, 0, 0, 0), bw_hexex_write_walls(&w, 0);
    return bw_hexex_write_end(&w, NULL);
}

static void records_other_than_announced_are_refused(void **state) {
    (void)state;
    for (int how = 0; how < 8; how++) {
        kit_expect_status(&ctx, write_wrongly(how), BW_E_INTERNAL);
        assert_int_equal(ctx.memory.used, 0);
    }
    kit_expect_ok(&ctx, write_wrongly(8)); /* and rightly */
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, start, finish)
static const struct CMUnitTest tests[] = {
    TEST(a_mesh_with_any_doubles_and_lists_comes_back_bit_for_bit),
    TEST(exact_rationals_are_written_as_given_and_read_to_the_nearest_double),
    TEST(the_same_mesh_gives_the_same_bytes),
    TEST(a_full_disk_is_an_io_error),
    TEST(a_folder_that_is_not_there_is_an_io_error),
    TEST(records_other_than_announced_are_refused),
};
KIT_MAIN(tests)
