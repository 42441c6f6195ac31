/* What a well-formed .hexex may look like, and what comes back for each ill-formed one. */
#include "kit/kit.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "format/hexex.h"
#include "format/hexex_lines.h"

#define VERTICES "5\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 1 1\n"
#define TET0 "0 1 2 3  0 0 0  1 0 0  0 1 0  0 0 1\n"
#define TET1 "1 2 3 4  1 0 0  0 1 0  0 0 1  1 1 1\n"
#define TETS "2\n" TET0 TET1
#define MESH VERTICES TETS
#define WALLS "2\n0 1 2 0.5\n1 2 3 7/2\n"
#define FEATURES "2 1 1\n0\n4\n0 1\n1 2 3\n"

static bw_context ctx;
static bw_tet_mesh mesh;

static int start(void **state) {
    (void)state;
    bw_context_init(&ctx);
    return 0;
}

static int finish(void **state) {
    (void)state;
    bw_tet_mesh_clear(&ctx, &mesh);
    return ctx.memory.used ? -1 : 0;
}

static bw_status read_text(const char *text) { return bw_hexex_read_memory(&ctx, text, strlen(text), &mesh); }

static bool names(const char *kind, int64_t id) {
    for (size_t i = 0; i < ctx.error.element_count && i < BW_ELEMENTS_KEPT; i++)
        if (!strcmp(ctx.error.elements[i].kind, kind) && ctx.error.elements[i].id == id) return true;
    return false;
}

/* Expects `status`, a message that has `words`, the line among the elements (0: none), and nothing left in memory. */
static void refuses(const char *text, bw_status status, int64_t line, const char *words) {
    bw_context_init(&ctx);
    kit_expect_status(&ctx, read_text(text), status);
    if (!strstr(ctx.error.message, words)) fail_msg("message lacks '%s': %s", words, ctx.error.message);
    if (line && !names("line", line)) fail_msg("line %lld is not named: %s", (long long)line, ctx.error.message);
    assert_int_equal(ctx.memory.used, 0);
    assert_int_equal(mesh.vertex_count + mesh.tet_count, 0);
    assert_null(mesh.position);
}

/* ---- well-formed --------------------------------------------------------------------------------------------- */

static void a_mesh_is_read_as_written(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text(MESH));
    assert_int_equal(mesh.vertex_count, 5);
    assert_int_equal(mesh.tet_count, 2);
    assert_int_equal(mesh.tet[1][3], 4);
    assert_true(mesh.position[4][2] == 1 && mesh.position[3][2] == 1 && mesh.position[3][1] == 0);
    assert_true(mesh.parameter[1][3][0] == 1 && mesh.parameter[0][2][1] == 1 && mesh.parameter[0][2][2] == 0);
    assert_int_equal(mesh.wall_count + mesh.feature_vertex_count + mesh.feature_edge_count + mesh.feature_facet_count, 0);
    assert_null(mesh.facet);
}

static void expect_walls(void) {
    assert_int_equal(mesh.wall_count, 2);
    assert_int_equal(mesh.wall[1][2], 3);
    assert_true(mesh.wall_distance[0] == 0.5 && mesh.wall_distance[1] == 3.5);
}

static void expect_features(void) {
    assert_int_equal(mesh.feature_vertex_count, 2);
    assert_int_equal(mesh.feature_edge_count, 1);
    assert_int_equal(mesh.feature_facet_count, 1);
    assert_int_equal(mesh.feature_vertex[1], 4);
    assert_int_equal(mesh.feature_edge[0][1], 1);
    assert_int_equal(mesh.feature_facet[0][2], 3);
}

static void walls_may_stand_alone(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text(MESH WALLS));
    expect_walls();
    assert_int_equal(mesh.feature_vertex_count, 0);
}

static void features_may_stand_alone(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text(MESH FEATURES));
    expect_features();
    assert_int_equal(mesh.wall_count, 0);
}

static void features_may_follow_walls(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text(MESH WALLS FEATURES));
    expect_walls();
    expect_features();
}

static void empty_lists_are_lists(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text(MESH "0\n0 0 0\n"));
    assert_int_equal(mesh.wall_count + mesh.feature_vertex_count, 0);
}

static void blanks_blank_lines_and_other_line_breaks_do_not_matter(void **state) {
    (void)state;
    kit_expect_ok(&ctx, read_text("\n\n 5 \r\n0 0 0\r\n\t1 0 0 \r\n0 1 0\n0 0 1\n\n   \n1 1 1\n2\n" TET0
                                  "\n1 2 3 4 1 0 0 0 1 0 0 0 1 1 1 1")); /* the last break is missing, too */
    assert_int_equal(mesh.vertex_count, 5);
    assert_true(mesh.parameter[1][3][2] == 1);
}

static void lines_are_whole_whatever_the_pieces_a_pipe_delivers(void **state) {
    (void)state;
    int end[2];
    assert_int_equal(pipe(end), 0);
    if (!fork()) {
        close(end[0]);
        for (const char *c = MESH WALLS FEATURES; *c; c++)
            if (write(end[1], c, 1) != 1) _exit(1);
        _exit(0);
    }
    close(end[1]);
    bw_status status = bw_hexex_read_fd(&ctx, end[0], &mesh);
    close(end[0]);
    kit_expect_ok(&ctx, status);
    expect_walls();
    expect_features();
}

static void a_descriptor_is_read_from_where_it_stands(void **state) {
    (void)state;
    const char *path = kit_temp_path("at.hexex");
    kit_write_text(path, "some header\n" MESH);
    int fd = open(path, O_RDONLY);
    assert_int_equal(lseek(fd, 12, SEEK_SET), 12);
    bw_status status = bw_hexex_read_fd(&ctx, fd, &mesh);
    close(fd);
    kit_expect_ok(&ctx, status);
    assert_int_equal(mesh.tet_count, 2);
}

/* ---- ill-formed ---------------------------------------------------------------------------------------------- */

static void nothing_is_an_empty_input(void **state) {
    (void)state;
    refuses("", BW_E_EMPTY, 0, "empty");
    refuses(" \n\t\r\n", BW_E_EMPTY, 0, "empty");
    refuses("0\n0\n", BW_E_EMPTY, 0, "no tets");
    refuses(VERTICES "0\n", BW_E_EMPTY, 0, "no tets");
}

static void every_place_to_break_off_is_truncation_and_never_a_crash(void **state) {
    (void)state;
    const char *whole = MESH WALLS FEATURES;
    size_t mesh_end = strlen(MESH), walls_end = strlen(MESH WALLS), length = strlen(whole);
    for (size_t n = 1; n < length - 1; n++) {
        bw_context_init(&ctx);
        bw_status status = bw_hexex_read_memory(&ctx, whole, n, &mesh);
        /* What has every record is whole: with and without the last line break, and with "7" for "7/2". */
        bool complete = n == mesh_end || n == mesh_end - 1 || n == walls_end || n == walls_end - 1 || n == walls_end - 3;
        if (complete) kit_expect_ok(&ctx, status);
        else if (status != BW_E_TRUNCATED && status != BW_E_COUNT) /* a count may be larger than what is left */
            fail_msg("cut after %zu bytes: %s: %s", n, bw_status_code(status), ctx.error.message);
        bw_tet_mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void a_truncated_input_names_the_element_it_lacks(void **state) {
    (void)state;
    refuses("2\n0.00 0.00 0.00\n1", BW_E_TRUNCATED, 3, "vertex 1");
    refuses("2\n0.00 0.00 0.00000000000\n", BW_E_TRUNCATED, 3, "vertex 1");
    refuses(VERTICES, BW_E_TRUNCATED, 7, "number of tets");
    refuses(VERTICES "2\n" TET0 "1 2 3 4  1 0 0  0 1 0  0 0 1  1 ", BW_E_TRUNCATED, 9, "tet 1");
    refuses(VERTICES "2\n" TET0 "1 2 3 4  1 0 0  0 1 0  0 0 1  1 1 1e", BW_E_TRUNCATED, 9, "tet 1");
    assert_true(names("tet", 1));
    refuses(MESH "2\n0 1 2 0.50000000\n", BW_E_TRUNCATED, 12, "wall 1");
    refuses(MESH "2 1 1\n0\n1\n00 000001\n", BW_E_TRUNCATED, 14, "feature facet 0");
}

static void counts_that_the_input_cannot_hold_are_refused_before_any_memory_is_taken(void **state) {
    (void)state;
    refuses("1000000000\n0 0 0\n", BW_E_COUNT, 1, "1000000000 vertices cannot be in the 6 bytes");
    assert_true(ctx.memory.peak < BW_LINE_MAX * 2);
    refuses("99999999999999999999\n0 0 0\n", BW_E_COUNT, 1, "vertices");
    refuses("3000000000\n0 0 0\n", BW_E_COUNT, 1, "supported");
    refuses(VERTICES "3\n" TET0 TET1, BW_E_COUNT, 7, "3 tets");
    refuses(VERTICES "200000000\n" TET0 TET1, BW_E_COUNT, 7, "tets");
    assert_true(ctx.memory.peak < BW_LINE_MAX * 2);
    refuses(MESH "100\n0 1 2 1\n", BW_E_COUNT, 10, "100 walls");
    refuses(MESH "1 2 3000\n0\n", BW_E_COUNT, 10, "feature");
    refuses(MESH "1 2 2\n0\n0 1\n0 1\n0 1 2\n", BW_E_COUNT, 10, "feature facets"); /* each fits, not all of them */
}

static void negative_counts_are_refused(void **state) {
    (void)state;
    refuses("-1\n0 0 0\n", BW_E_COUNT, 1, "negative: -1");
    refuses(VERTICES "-2\n" TET0, BW_E_COUNT, 7, "tets is negative");
    refuses(MESH "-1\n", BW_E_COUNT, 10, "walls is negative");
    refuses(MESH "0 -1 0\n", BW_E_COUNT, 10, "feature edges is negative");
}

static void an_index_out_of_range_names_the_tet_and_the_line(void **state) {
    (void)state;
    refuses(VERTICES "2\n" TET0 "1 2 3 5  1 0 0  0 1 0  0 0 1  1 1 1\n", BW_E_INDEX, 9, "vertex index 5 is outside 0..4");
    assert_true(names("tet", 1));
    refuses(VERTICES "1\n-1 1 2 3  0 0 0  1 0 0  0 1 0  0 0 1\n", BW_E_INDEX, 8, "tet 0");
    refuses(VERTICES "1\n4294967296 1 2 3  0 0 0  1 0 0  0 1 0  0 0 1\n", BW_E_INDEX, 8, "4294967296");
    refuses(MESH "1\n0 1 5 0\n", BW_E_INDEX, 11, "wall 0");
    refuses(MESH "1 0 0\n5\n", BW_E_INDEX, 11, "feature vertex 0");
    refuses(MESH "0 0 1\n0 1 77\n", BW_E_INDEX, 11, "feature facet 0");
}

static void numbers_that_are_not_finite_are_refused(void **state) {
    (void)state;
    static const char *const bad[] = {"nan", "NaN", "-inf", "Infinity", "1e999", "-1e400", "1/0", "0/0"};
    char text[400];
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        snprintf(text, sizeof text, VERTICES "1\n0 1 2 3  0 0 0  1 0 0  0 %s 0  0 0 1\n", bad[i]);
        refuses(text, BW_E_NUMBER, 8, bad[i]);
        assert_true(names("tet", 0));
        snprintf(text, sizeof text, "2\n0 0 0\n0 0 %s\n1\n", bad[i]);
        refuses(text, BW_E_NUMBER, 3, "vertex 1");
    }
}

static void what_is_not_the_format_is_a_syntax_error(void **state) {
    (void)state;
    refuses("hello world\n", BW_E_SYNTAX, 1, "'hello'");
    refuses("5.0\n0 0 0\n", BW_E_SYNTAX, 1, "'5.0' is not a whole number");
    refuses("1 2 3\n", BW_E_SYNTAX, 1, "more than belongs");
    refuses("2\n0 0 0 0\n1 1 1\n1\n", BW_E_SYNTAX, 2, "more than belongs");
    refuses("2\n0 0\n1 1 1 1\n1\n", BW_E_SYNTAX, 2, "too few numbers");
    refuses("2\n0 0 zero\n1 1 1\n1\n", BW_E_SYNTAX, 2, "'zero' is not a number");
    refuses("2\n0 0 0,5\n1 1 1\n1\n", BW_E_SYNTAX, 2, "'0,5' is not a number");
    refuses(VERTICES "1\n0 1 2.5 3  0 0 0  1 0 0  0 1 0  0 0 1\n", BW_E_SYNTAX, 8, "'2.5' is not a whole number");
    refuses("2\n0 0 \x01\xff\xc3\n1 1 1\n1\n", BW_E_SYNTAX, 2, "'?\?\?'");
}

static void what_follows_the_lists_is_a_syntax_error(void **state) {
    (void)state;
    refuses(MESH "1 2\n0 0 0 0 0 0\n", BW_E_SYNTAX, 10, "two counts");
    refuses(MESH "1 2 3 4\n", BW_E_SYNTAX, 10, "more than belongs");
    refuses(MESH WALLS "1\n0 1 2 3\n", BW_E_SYNTAX, 13, "may follow the walls");
    refuses(MESH WALLS FEATURES "garbage\n", BW_E_SYNTAX, 18, "more text");
    refuses(MESH "garbage\n", BW_E_SYNTAX, 10, "'garbage'");
}

static void random_bytes_are_refused_and_the_message_stays_printable(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    static char noise[20000];
    for (int round = 0; round < 200; round++) {
        for (size_t i = 0; i < sizeof noise; i++) noise[i] = (char)kit_random_next(&random);
        bw_context_init(&ctx);
        kit_expect_status(&ctx, bw_hexex_read_memory(&ctx, noise, sizeof noise, &mesh), BW_E_SYNTAX);
        for (const char *c = ctx.error.message; *c; c++) assert_true(*c >= ' ' && *c <= '~');
        assert_int_equal(ctx.memory.used, 0);
    }
}

/* Writes 200 MB of `unit` into the pipe, then stops; ends early when the reader goes away. */
static bw_status read_200_megabytes_of(const char *before, const char *unit) {
    int end[2];
    assert_int_equal(pipe(end), 0);
    pid_t child = fork();
    if (!child) {
        close(end[0]);
        static char block[1 << 16];
        size_t n = strlen(unit);
        for (size_t i = 0; i < sizeof block; i++) block[i] = unit[i % n];
        bool open = write(end[1], before, strlen(before)) >= 0;
        for (int i = 0; open && i < 200 * 16; i++) open = write(end[1], block, sizeof block) >= 0;
        _exit(0);
    }
    close(end[1]);
    bw_context_init(&ctx);
    bw_status status = bw_hexex_read_fd(&ctx, end[0], &mesh);
    close(end[0]);
    waitpid(child, NULL, 0);
    return status;
}

static void a_line_of_200_megabytes_is_refused_in_constant_memory(void **state) {
    (void)state;
    static const struct {
        const char *before, *unit;
        int64_t line;
    } cases[] = {{"", "1", 1}, {"", "x", 1}, {"", "1 ", 1}, {"", " ", 1}, {"1\n0 0 ", "123/", 2}, {VERTICES "1\n0 1 2 3 0.", "0", 8}, {MESH, "0 ", 10}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        kit_expect_status(&ctx, read_200_megabytes_of(cases[i].before, cases[i].unit), BW_E_LINE);
        assert_true(names("line", cases[i].line));
        assert_true(ctx.memory.peak < 2 * BW_LINE_MAX);
    }
    size_t size = 100000; /* a long number on a line of allowed length */
    char *text = malloc(size + 100);
    int n = sprintf(text, "1\n0 0 ");
    memset(text + n, '7', size);
    strcpy(text + (size_t)n + size, "\n1\n");
    refuses(text, BW_E_LINE, 2, "too long a number");
    free(text);
}

static void a_count_from_a_pipe_takes_memory_only_as_data_arrives(void **state) {
    (void)state;
    int end[2];
    assert_int_equal(pipe(end), 0);
    assert_int_equal(write(end[1], "2000000000\n0 0 0\n", 17), 17);
    close(end[1]);
    bw_status status = bw_hexex_read_fd(&ctx, end[0], &mesh);
    close(end[0]);
    kit_expect_status(&ctx, status, BW_E_TRUNCATED);
    assert_true(ctx.memory.peak < 2 * BW_LINE_MAX);
}

static void a_missing_file_is_an_io_error(void **state) {
    (void)state;
    kit_expect_status(&ctx, bw_hexex_read(&ctx, kit_temp_path("not-there"), &mesh), BW_E_IO);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_hexex_read(&ctx, kit_temp_dir(), &mesh), BW_E_IO); /* a folder */
}

/* ---- the context's part ---------------------------------------------------------------------------------------- */

static bw_status read_for_loop(bw_context *c, void *user) {
    bw_tet_mesh m;
    bw_status status = bw_hexex_read_memory(c, user, strlen(user), &m);
    bw_tet_mesh_clear(c, &m);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    char text[] = MESH WALLS FEATURES;
    assert_true(kit_fail_each_allocation(read_for_loop, text) > 8);
}

static bw_status read_pipe_for_loop(bw_context *c, void *user) {
    int end[2];
    assert_int_equal(pipe(end), 0);
    if (!fork()) {
        close(end[0]);
        FILE *file = fdopen(end[1], "w");
        fprintf(file, "%d\n", *(int *)user);
        for (int i = 0; i < *(int *)user; i++) fprintf(file, "%d 0 0\n", i);
        fputs("1\n" TET0, file);
        _exit(fclose(file));
    }
    close(end[1]);
    bw_tet_mesh m;
    bw_status status = bw_hexex_read_fd(c, end[0], &m);
    close(end[0]);
    if (status == BW_OK) assert_true(m.vertex_count == (size_t)*(int *)user && m.position[m.vertex_count - 1][0] == *(int *)user - 1);
    bw_tet_mesh_clear(c, &m);
    return status;
}

static void every_allocation_may_fail_while_lists_grow(void **state) {
    (void)state;
    int vertices = 9000;
    assert_true(kit_fail_each_allocation(read_pipe_for_loop, &vertices) > 6);
}

static double last_fraction;
static int reports;
static volatile sig_atomic_t cancel;

static void count_report(void *user, const char *stage, double fraction) {
    (void)user, (void)stage;
    assert_true(fraction >= last_fraction && fraction <= 1);
    last_fraction = fraction;
    if (++reports == 2) cancel = 1;
}

static char *big_text(size_t vertices, size_t *size) {
    char *text = malloc(vertices * 24 + 200);
    size_t n = (size_t)sprintf(text, "%zu\n", vertices);
    for (size_t i = 0; i < vertices; i++) n += (size_t)sprintf(text + n, "%.3f %.3f %.3f\n", (double)i * 0.001, 1.0, 2.0);
    *size = n + (size_t)sprintf(text + n, "1\n%s", TET0);
    return text;
}

static void progress_rises_to_one_and_cancelling_stops_the_reading(void **state) {
    (void)state;
    size_t size;
    char *text = big_text(800000, &size);
    ctx.progress = count_report;
    last_fraction = 0, reports = 0;
    kit_expect_ok(&ctx, bw_hexex_read_memory(&ctx, text, size, &mesh));
    assert_true(reports >= 3);
    assert_true(last_fraction == 1);
    bw_tet_mesh_clear(&ctx, &mesh);
    ctx.cancel = &cancel;
    cancel = 0, last_fraction = 0, reports = 0;
    bw_status status = bw_hexex_read_memory(&ctx, text, size, &mesh);
    free(text);
    kit_expect_status(&ctx, status, BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, 0);
}

static void the_byte_budget_is_respected(void **state) {
    (void)state;
    size_t size;
    char *text = big_text(200000, &size);
    ctx.memory.limit = 4 << 20;
    bw_status status = bw_hexex_read_memory(&ctx, text, size, &mesh);
    free(text);
    kit_expect_status(&ctx, status, BW_E_MEMORY);
    assert_true(ctx.memory.peak <= 4 << 20);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, start, finish)
static const struct CMUnitTest tests[] = {
    TEST(a_mesh_is_read_as_written),
    TEST(walls_may_stand_alone),
    TEST(features_may_stand_alone),
    TEST(features_may_follow_walls),
    TEST(empty_lists_are_lists),
    TEST(blanks_blank_lines_and_other_line_breaks_do_not_matter),
    TEST(lines_are_whole_whatever_the_pieces_a_pipe_delivers),
    TEST(a_descriptor_is_read_from_where_it_stands),
    TEST(nothing_is_an_empty_input),
    TEST(every_place_to_break_off_is_truncation_and_never_a_crash),
    TEST(a_truncated_input_names_the_element_it_lacks),
    TEST(counts_that_the_input_cannot_hold_are_refused_before_any_memory_is_taken),
    TEST(negative_counts_are_refused),
    TEST(an_index_out_of_range_names_the_tet_and_the_line),
    TEST(numbers_that_are_not_finite_are_refused),
    TEST(what_is_not_the_format_is_a_syntax_error),
    TEST(what_follows_the_lists_is_a_syntax_error),
    TEST(random_bytes_are_refused_and_the_message_stays_printable),
    TEST(a_line_of_200_megabytes_is_refused_in_constant_memory),
    TEST(a_count_from_a_pipe_takes_memory_only_as_data_arrives),
    TEST(a_missing_file_is_an_io_error),
    TEST(every_allocation_may_fail),
    TEST(every_allocation_may_fail_while_lists_grow),
    TEST(progress_rises_to_one_and_cancelling_stops_the_reading),
    TEST(the_byte_budget_is_respected),
};
KIT_MAIN(tests)
