/* traced.hexex is a conforming, exact refinement of the input, however its cells were cut. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>

#include "core/sample_map.h"
#include "core/traced_check.h"
#include "format/traced.h"
#include "stage/trace.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_traced_counts counts;
    size_t inside;
    double surface, volume; /* of the input, in space */
} fixture;

static void measure(fixture *f) {
    const bw_tet_mesh *m = &f->mesh;
    traced_mesh x = {.x = m->position};
    for (size_t i = 0; i < m->facet_count; i++)
        if (m->facet_tet[i][1] == BW_NONE) f->surface += traced_area(&x, m->facet[i]);
    for (size_t t = 0; t < m->tet_count; t++) {
        double e[3][3];
        for (int i = 0; i < 9; i++)
            e[i / 3][i % 3] = m->position[m->tet[t][i / 3 + 1]][i % 3] - m->position[m->tet[t][0]][i % 3];
        f->volume += (e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                      e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                      e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0])) /
                     6;
    }
}

static void open_model(fixture *f, const char *name, int size, double noise) {
    memset(f, 0, sizeof *f);
    bw_context_init(&f->ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = noise, options.seed = kit_seed();
    kit_expect_ok(&f->ctx, sample_map(&f->ctx, name, &options, &f->mesh, &f->map));
    kit_expect_ok(&f->ctx, bw_cells_init(&f->ctx, &f->cells, &f->mesh, &f->map));
    measure(f);
}

static void close_model(fixture *f) {
    bw_cells_clear(&f->ctx, &f->cells);
    bw_grid_map_clear(&f->ctx, &f->map);
    bw_tet_mesh_clear(&f->ctx, &f->mesh);
    assert_int_equal(f->ctx.memory.used, 0);
}

static bw_status write_traced(bw_context *ctx, bw_cells *cells, const char *path,
                              bw_traced_counts *counts, size_t *inside) {
    bw_tessellation t;
    double(*position)[3] = NULL;
    bw_status status = bw_tessellate(ctx, &t, cells);
    if (status == BW_OK) status = bw_points_positions(ctx, &t.points, &position);
    if (status == BW_OK) status = bw_traced_write(ctx, &t, (const double(*)[3])position, path, counts, NULL);
    *inside = t.inside;
    bw_free(ctx, position);
    bw_tessellation_clear(ctx, &t);
    return status;
}

static char *write_text(fixture *f, size_t *size) {
    const char *path = kit_temp_path("traced.hexex");
    kit_expect_ok(&f->ctx, write_traced(&f->ctx, &f->cells, path, &f->counts, &f->inside));
    char *text = kit_read_file(path, size);
    assert_int_equal(*size, f->counts.bytes);
    return text;
}

/* Writes, checks, and holds what was found against the counts and the input's surface and volume. */
static traced_verdict check(fixture *f, const char *what, bool with_blocks) {
    traced_verdict v;
    size_t size;
    char *text = write_text(f, &size);
    assert_true(traced_check(text, with_blocks, &v));
    free(text);
    if (traced_faults(&v)) traced_print(what, &v);
    assert_int_equal(traced_faults(&v), 0);
    assert_int_equal(v.vertices, f->counts.vertices);
    assert_int_equal(v.tets, f->counts.tets);
    assert_int_equal(v.walls, f->counts.walls);
    assert_true(fabs(v.boundary_area - f->surface) < 1e-9 * f->surface);
    assert_true(fabs(v.volume - f->volume) < 1e-9 * fabs(f->volume));
    return v;
}

/* ---- cutting at random
 * ------------------------------------------------------------------------------------------- */

static bw_plane random_plane(const fixture *f, bw_cell cell, kit_random *random) {
    int8_t axis = (int8_t)kit_random_below(random, 3);
    int64_t low = INT64_MAX, high = INT64_MIN;
    bw_tet tet = bw_cells_tet(&f->cells, cell);
    for (bw_polygon p = bw_cells_first_in_cell(&f->cells, cell); p != BW_NONE;
         p = bw_cells_next_in_cell(&f->cells, p, cell)) {
        bw_half h = f->cells.polygon[p].half;
        do {
            bool fraction;
            int64_t x = bw_cells_floor(&f->cells, f->cells.half[h].origin, tet, axis, &fraction);
            if (x < low) low = x;
            if (x > high) high = x;
            h = f->cells.half[h].next;
        } while (h != f->cells.polygon[p].half);
    }
    return (bw_plane){low + (int64_t)kit_random_below(random, (uint64_t)(high - low) + 1), axis};
}

static void cut_at_random(fixture *f, int cuts, kit_random *random) {
    for (int i = 0; i < cuts; i++) {
        bw_cell cell = (bw_cell)kit_random_below(random, f->cells.cell_count);
        bw_polygon section;
        if ((size_t)cell < f->mesh.tet_count) kit_expect_ok(&f->ctx, bw_cells_open(&f->ctx, &f->cells, cell));
        kit_expect_ok(&f->ctx,
                      bw_cells_cut(&f->ctx, &f->cells, cell, random_plane(f, cell, random), &section));
    }
}

/* Cells one grid unit thick: doubles cannot tell which side of their polygons they are on. */
static void cells_as_thin_as_can_be_become_positive_tets_too(void **state) {
    (void)state;
    kit_random random = kit_random_start(3);
    static const char *const names[] = {"cuboid", "cylinder"};
    for (int i = 0; i < 2; i++) {
        fixture f;
        open_model(&f, names[i], 1 + i, 0.6);
        bw_cell cell = 0;
        for (int k = 0; k < 600; k++) {
            if (k % 3 == 0) cell = (bw_cell)kit_random_below(&random, f.cells.cell_count); /* else the last thin one */
            bw_polygon section;
            if ((size_t)cell < f.mesh.tet_count) kit_expect_ok(&f.ctx, bw_cells_open(&f.ctx, &f.cells, cell));
            bw_plane plane = random_plane(&f, cell, &random);
            size_t before = f.cells.cell_count;
            kit_expect_ok(&f.ctx, bw_cells_cut(&f.ctx, &f.cells, cell, plane, &section));
            if (f.cells.cell_count == before) continue;
            cell = (bw_cell)before;
            plane.value++;
            kit_expect_ok(&f.ctx, bw_cells_cut(&f.ctx, &f.cells, cell, plane, &section));
        }
        traced_verdict v = check(&f, names[i], false);
        assert_true(v.tets >= f.cells.cell_count);
        close_model(&f);
    }
}

static void a_complex_cut_at_random_becomes_a_conforming_positive_tet_mesh(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    static const char *const names[] = {"cuboid", "cylinder", "torus-quarter"};
    for (int i = 0; i < 3; i++) {
        fixture f;
        open_model(&f, names[i], 1 + i % 2, 0.6);
        cut_at_random(&f, 400, &random);
        traced_verdict v = check(&f, names[i], false);
        assert_true(v.tets >= f.cells.cell_count);
        close_model(&f);
    }
}

static void cells_that_cannot_be_coned_from_a_vertex_get_a_point_inside(void **state) {
    (void)state;
    kit_random random = kit_random_start(2);
    fixture f;
    open_model(&f, "cuboid", 1, 0.6);
    cut_at_random(&f, 900,
                  &random); /* many walls that stop inside: vertices in the middle of faces everywhere */
    check(&f, "cuboid", false);
    assert_true(f.inside > 0);
    assert_int_equal(f.counts.vertices, f.cells.vertex_count + f.inside);
    close_model(&f);
}

/* Every kind of point, in every tet that has it, on grids from very coarse to finer than 64 bits. */
static void printed_parameters_are_the_exact_ones_on_any_grid(void **state) {
    (void)state;
    kit_random random = kit_random_start(4);
    fixture f;
    open_model(&f, "torus-quarter", 1, 0.6);
    cut_at_random(&f, 300, &random);
    bw_tessellation t;
    kit_expect_ok(&f.ctx, bw_tessellate(&f.ctx, &t, &f.cells));
    static const int32_t exponents[] = {-70, -3, 0, 1, 40, 63, 79, 80, 130};
    size_t kinds[4] = {0};
    mpq_t q[3];
    mpq_inits(q[0], q[1], q[2], NULL);
    for (bw_cell c = 0; (size_t)c < f.cells.cell_count; c++)
        for (bw_polygon p = bw_cells_first_in_cell(&f.cells, c); p != BW_NONE;
             p = bw_cells_next_in_cell(&f.cells, p, (bw_cell)c)) {
            bw_cvertex v = f.cells.half[f.cells.polygon[p].half].origin;
            bw_tet tet = bw_cells_tet(&f.cells, c);
            char text[BW_POINT_TEXT], *at = text;
            f.map.exponent = exponents[kit_random_below(&random, sizeof exponents / sizeof *exponents)];
            size_t length = bw_points_print(&t.points, v, tet, text);
            bw_cells_parameter(&f.cells, v, tet, q);
            for (int k = 0; k < 3; k++, at += strlen(at) + 1) {
                if (f.map.exponent > 0) mpq_div_2exp(q[k], q[k], (mp_bitcnt_t)f.map.exponent);
                if (f.map.exponent < 0) mpq_mul_2exp(q[k], q[k], (mp_bitcnt_t)-f.map.exponent);
                char *want = mpq_get_str(NULL, 10, q[k]);
                assert_string_equal(at, want);
                free(want);
            }
            assert_ptr_equal(at, text + length);
            kinds[f.cells.vertex[v].kind]++;
        }
    for (int k = 0; k < 4; k++) assert_true(kinds[k] > 10);
    mpq_clears(q[0], q[1], q[2], NULL);
    bw_tessellation_clear(&f.ctx, &t);
    close_model(&f);
}

/* ---- what tracing leaves
 * ----------------------------------------------------------------------------------------- */

static void traced_samples_fill_boxes_exactly(void **state) {
    (void)state;
    static const struct {
        const char *name;
        int blocks;
    } samples[] = {{"cuboid", 1}, {"l-shape", 3}, {"plus", 7}, {"cylinder", 5}, {"ball", 7}};
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        fixture f;
        open_model(&f, samples[i].name, 3, 0.7);
        kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_BC, UINT64_MAX));
        traced_verdict v = check(&f, samples[i].name, true);
        assert_int_equal(v.blocks, samples[i].blocks);
        close_model(&f);
    }
}

static void a_mesh_that_was_not_cut_keeps_its_tets(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "cuboid", 2, 0.5);
    size_t size;
    char *text = write_text(&f, &size);
    assert_int_equal(f.counts.tets, f.mesh.tet_count);
    char *at = text;
    for (size_t line = 0; line < f.mesh.vertex_count + 2; line++) at = strchr(at, '\n') + 1;
    for (size_t t = 0; t < f.mesh.tet_count; t++, at = strchr(at, '\n') + 1) {
        int v[4];
        assert_int_equal(sscanf(at, "%d %d %d %d", &v[0], &v[1], &v[2], &v[3]), 4);
        assert_memory_equal(v, f.mesh.tet[t], sizeof v);
    }
    free(text);
    close_model(&f);
}

static void a_mirrored_input_is_written_mirrored(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "l-shape", 2, 0.5);
    kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_MC, UINT64_MAX));
    size_t size[2];
    char *plain = write_text(&f, &size[0]);
    f.mesh.mirrored = 1;
    char *mirrored = write_text(&f, &size[1]);
    assert_int_equal(size[0], size[1]);
    traced_verdict v[2];
    assert_true(traced_check(plain, true, &v[0]) && traced_check(mirrored, true, &v[1]));
    assert_int_equal(traced_faults(&v[0]) + traced_faults(&v[1]), 0);
    assert_false(v[0].mirrored);
    assert_true(v[1].mirrored);
    free(plain), free(mirrored);
    close_model(&f);
}

/* Every boundary facet of the mesh, every edge of these, and three vertices are features. */
static void features_are_cut_where_the_mesh_is(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "l-shape", 2, 0.7);
    bw_tet_mesh *m = &f.mesh;
    m->feature_edge = bw_alloc(&f.ctx, m->edge_count, sizeof *m->feature_edge);
    m->feature_facet = bw_alloc(&f.ctx, m->facet_count, sizeof *m->feature_facet);
    m->feature_vertex = bw_alloc(&f.ctx, 3, sizeof *m->feature_vertex);
    m->feature_vertex_count = 3, m->feature_vertex[1] = 1, m->feature_vertex[2] = 2;
    double length[2] = {0, 0}, area = 0;
    for (size_t e = 0; e < m->edge_count; e++) { /* listed the wrong way round: a list need not be sorted */
        if (!(f.map.edge_flags[e] & BW_EDGE_BOUNDARY)) continue;
        bw_vertex *end = m->feature_edge[m->feature_edge_count++];
        end[0] = m->edge[e][1], end[1] = m->edge[e][0];
        double d = 0;
        for (int k = 0; k < 3; k++) d += pow(m->position[end[0]][k] - m->position[end[1]][k], 2);
        length[0] += sqrt(d);
    }
    for (size_t i = 0; i < m->facet_count; i++)
        if (m->facet_tet[i][1] == BW_NONE)
            for (int k = 0; k < 3; k++)
                m->feature_facet[m->feature_facet_count][k] = m->facet[i][2 - k],
                m->feature_facet_count += k == 2;
    kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_MC, UINT64_MAX));
    traced_verdict v;
    size_t size;
    char *text = write_text(&f, &size);
    traced_mesh x = {.out = &v};
    memset(&v, 0, sizeof v);
    assert_true(traced_parse(&x, text));
    assert_int_equal(v.feature_vertices, 3);
    assert_true(v.feature_edges > m->feature_edge_count); /* walls end on the boundary: it is cut */
    assert_true(v.feature_facets > m->feature_facet_count);
    for (size_t i = 0; i < v.feature_edges; i++) {
        double d = 0;
        for (int k = 0; k < 3; k++) d += pow(x.x[x.feature_edge[i][0]][k] - x.x[x.feature_edge[i][1]][k], 2);
        length[1] += sqrt(d);
    }
    for (size_t i = 0; i < v.feature_facets; i++) area += traced_area(&x, x.feature_facet[i]);
    assert_true(fabs(length[1] - length[0]) < 1e-9 * length[0]);
    assert_true(fabs(area - f.surface) < 1e-9 * area);
    for (size_t i = 0; i < 12 * v.tets; i++) mpq_clear(x.u[i / 12][i / 3 % 4][i % 3]);
    free(x.x), free(x.tet), free(x.u), free(x.wall), free(x.feature_edge), free(x.feature_facet),
        free(x.feature_vertex);
    free(text);
    close_model(&f);
}

static void a_feature_that_is_no_facet_of_the_mesh_is_an_error(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "cuboid", 1, 0);
    f.mesh.feature_facet = bw_alloc(&f.ctx, 1, sizeof *f.mesh.feature_facet);
    f.mesh.feature_facet_count = 1; /* 0 0 0 */
    kit_expect_status(&f.ctx, write_traced(&f.ctx, &f.cells, kit_temp_path("x.hexex"), &f.counts, &f.inside),
                      BW_E_CHECK);
    close_model(&f);
}

/* ---- the check itself, and failures
 * ------------------------------------------------------------------------------- */

static void the_check_notices_every_kind_of_damage(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "l-shape", 2, 0.5);
    kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_MC, UINT64_MAX));
    for (int damage = 0; damage < 3; damage++) {
        size_t size;
        traced_verdict v;
        char *text = write_text(&f, &size), *line = text, *at;
        for (size_t i = 0; i < f.counts.vertices + 2; i++) line = strchr(line, '\n') + 1;
        if (damage == 0) { /* the last digit of the first tet's last parameter */
            at = strchr(line, '\n') - 1;
            *at = *at == '1' ? '3' : '1';
        } else if (damage == 1) { /* its corners rotated: same tet, other parameters */
            int v4[4], n;
            sscanf(line, "%d %d %d %d%n", &v4[0], &v4[1], &v4[2], &v4[3], &n);
            char again[64];
            snprintf(again, sizeof again, "%d %d %d %d", v4[1], v4[2], v4[0], v4[3]);
            memcpy(line, again, (size_t)n);
        } else { /* the last wall replaced by the one before it */
            at = text + size - 1;
            while (at[-1] != '\n') at--;
            char *before = at - 1;
            while (before[-1] != '\n') before--;
            memset(at, ' ', (size_t)(text + size - 1 - at));
            memcpy(at, before, strcspn(before, "\n") < strlen(at) ? strcspn(before, "\n") : strlen(at) - 1);
        }
        assert_true(traced_check(text, true, &v));
        assert_true(traced_faults(&v) > 0);
        free(text);
    }
    close_model(&f);
}

static bw_status write_small(bw_context *ctx, void *user) {
    bw_cells *cells = user;
    bw_traced_counts counts;
    size_t inside;
    return write_traced(ctx, cells, kit_temp_path("small.hexex"), &counts, &inside);
}

static void every_refused_allocation_is_an_error_without_a_leak(void **state) {
    (void)state;
    kit_random random = kit_random_start(3);
    fixture f;
    open_model(&f, "cuboid", 1, 0.6);
    cut_at_random(&f, 60, &random);
    assert_true(kit_fail_each_allocation(write_small, &f.cells) > 20);
    close_model(&f);
}

static void a_file_that_cannot_be_written_is_an_io_error(void **state) {
    (void)state;
    const char *const path[] = {"/dev/full", kit_temp_path("no/such/folder")};
    for (int i = 0; i < 2; i++) {
        fixture f;
        open_model(&f, "cuboid", 1, 0);
        kit_expect_status(&f.ctx, write_traced(&f.ctx, &f.cells, path[i], &f.counts, &f.inside), BW_E_IO);
        close_model(&f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_complex_cut_at_random_becomes_a_conforming_positive_tet_mesh),
        cmocka_unit_test(cells_as_thin_as_can_be_become_positive_tets_too),
        cmocka_unit_test(cells_that_cannot_be_coned_from_a_vertex_get_a_point_inside),
        cmocka_unit_test(printed_parameters_are_the_exact_ones_on_any_grid),
        cmocka_unit_test(traced_samples_fill_boxes_exactly),
        cmocka_unit_test(a_mesh_that_was_not_cut_keeps_its_tets),
        cmocka_unit_test(a_mirrored_input_is_written_mirrored),
        cmocka_unit_test(features_are_cut_where_the_mesh_is),
        cmocka_unit_test(a_feature_that_is_no_facet_of_the_mesh_is_an_error),
        cmocka_unit_test(the_check_notices_every_kind_of_damage),
        cmocka_unit_test(every_refused_allocation_is_an_error_without_a_leak),
        cmocka_unit_test(a_file_that_cannot_be_written_is_an_io_error),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
