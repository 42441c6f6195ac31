/* The cell complex stays conforming, convex and exact under any sequence of cuts. */
#include "kit/kit.h"

#include <stdlib.h>

#include "core/sample_map.h"
#include "mesh/cells.h"
#include "mesh/walk.h"

typedef struct {
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
} fixture;

static bw_status start(bw_context *ctx, fixture *f, const char *name, uint64_t seed) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.6, options.seed = seed;
    bw_status status = sample_map(ctx, name, &options, &f->mesh, &f->map);
    memset(&f->cells, 0, sizeof f->cells);
    return status == BW_OK ? bw_cells_init(ctx, &f->cells, &f->mesh, &f->map) : status;
}

static void finish(bw_context *ctx, fixture *f) {
    bw_cells_clear(ctx, &f->cells);
    bw_grid_map_clear(ctx, &f->map);
    bw_tet_mesh_clear(ctx, &f->mesh);
    assert_int_equal(ctx->memory.used, 0);
}

/* A plane that is likely to meet the cell, at times through one of its vertices. */
static bw_plane random_plane(bw_context *ctx, bw_cells *c, bw_cell cell, kit_random *random) {
    if ((size_t)cell < c->mesh->tet_count) kit_expect_ok(ctx, bw_cells_open(ctx, c, cell));
    bw_tet tet = bw_cells_tet(c, cell);
    bw_half h = c->polygon[bw_cells_first_in_cell(c, cell)].half;
    for (uint64_t steps = kit_random_below(random, 4); steps; steps--) h = c->half[h].next;
    int8_t axis = (int8_t)kit_random_below(random, 3);
    bool fraction;
    int64_t a = bw_cells_floor(c, c->half[h].origin, tet, axis, &fraction);
    int64_t b = bw_cells_floor(c, bw_cells_half_end(c, h), tet, axis, &fraction);
    return (bw_plane){kit_random_below(random, 2) ? a : a + (b - a) / 3, axis};
}

static void random_cuts_keep_every_invariant(void **state) {
    (void)state;
    const char *names[] = {"cuboid", "torus", "ball"};
    for (int m = 0; m < 3; m++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fixture f;
        kit_random random = kit_random_start((uint64_t)m);
        kit_expect_ok(&ctx, start(&ctx, &f, names[m], (uint64_t)m));
        size_t before = f.cells.cell_count;
        for (int i = 0; i < 4000; i++) {
            bw_cell cell = (bw_cell)kit_random_below(&random, f.cells.cell_count);
            bw_polygon section;
            kit_expect_ok(&ctx, bw_cells_cut(&ctx, &f.cells, cell, random_plane(&ctx, &f.cells, cell, &random), &section));
            if (section != BW_NONE) assert_true(bw_cells_polygon_is_leaf(&f.cells, section));
        }
        assert_true(f.cells.cell_count > before + 500);
        kit_expect_ok(&ctx, bw_cells_check(&ctx, &f.cells));
        finish(&ctx, &f);
    }
}

/* The integers that decide (side, floor) against the rational coordinates they stand for, in every tet that sees a vertex. */
static void stored_integers_agree_with_exact_coordinates(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f;
    kit_random random = kit_random_start(9);
    kit_expect_ok(&ctx, start(&ctx, &f, "ball", 4));
    for (int i = 0; i < 2000; i++) {
        bw_cell cell = (bw_cell)kit_random_below(&random, f.cells.cell_count);
        bw_polygon section;
        kit_expect_ok(&ctx, bw_cells_cut(&ctx, &f.cells, cell, random_plane(&ctx, &f.cells, cell, &random), &section));
    }
    mpq_t u[3], plane;
    mpz_t floor;
    mpq_inits(u[0], u[1], u[2], plane, NULL);
    mpz_init(floor);
    size_t kinds[4] = {0, 0, 0, 0};
    for (size_t h = 0; h < f.cells.half_count; h++) {
        bw_polygon p = f.cells.half[h].polygon;
        if (!bw_cells_polygon_is_leaf(&f.cells, p)) continue;
        bw_cvertex v = f.cells.half[h].origin;
        kinds[f.cells.vertex[v].kind]++;
        for (int s = 0; s < 2 && f.cells.polygon[p].cell[s] != BW_NONE; s++) {
            bw_tet tet = bw_cells_tet(&f.cells, f.cells.polygon[p].cell[s]);
            bw_cells_parameter(&f.cells, v, tet, u);
            for (int8_t k = 0; k < 3; k++) {
                bool fraction;
                int64_t low = bw_cells_floor(&f.cells, v, tet, k, &fraction);
                mpz_fdiv_q(floor, mpq_numref(u[k]), mpq_denref(u[k]));
                assert_int_equal(mpz_cmp_si(floor, low), 0);
                assert_int_equal(mpz_cmp_ui(mpq_denref(u[k]), 1) != 0, fraction);
                int64_t value = low + (int64_t)kit_random_below(&random, 3) - 1;
                mpq_set_si(plane, value, 1);
                int sign = mpq_cmp(u[k], plane);
                assert_int_equal(bw_cells_side(&f.cells, v, tet, (bw_plane){value, k}), (sign > 0) - (sign < 0));
            }
        }
    }
    for (int k = 0; k < 4; k++) assert_true(kinds[k] > 100);
    mpq_clears(u[0], u[1], u[2], plane, NULL);
    mpz_clear(floor);
    finish(&ctx, &f);
}

static void a_plane_that_only_touches_cuts_nothing(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f;
    kit_expect_ok(&ctx, start(&ctx, &f, "cuboid", 1));
    size_t cells = f.cells.cell_count, faces = 0;
    for (size_t t = 0; t < cells; t++)
        for (int i = 0; i < 12; i++) {
            int64_t end = f.map.value[t][0][i % 3]; /* the lowest or highest value along an axis: a supporting plane */
            for (int j = 1; j < 4; j++) {
                int64_t x = f.map.value[t][j][i % 3];
                if (i < 6 ? x < end : x > end) end = x;
            }
            bw_polygon section;
            kit_expect_ok(&ctx, bw_cells_cut(&ctx, &f.cells, (bw_cell)t, (bw_plane){end, (int8_t)(i % 3)}, &section));
            faces += section != BW_NONE;
        }
    assert_int_equal(f.cells.cell_count, cells);
    assert_true(faces > 0); /* the boundary facets of the cuboid */
    finish(&ctx, &f);
}

/* The polygon of a boundary facet whose tet is not opened. */
static bw_polygon boundary_of_closed_tet(const fixture *f) {
    size_t i = f->mesh.facet_count - 1;
    while (f->mesh.facet_tet[i][1] != BW_NONE || bw_cells_is_open(&f->cells, f->mesh.facet_tet[i][0])) i--;
    return f->cells.of_facet[i];
}

/* The lowest corner of a tet along axis 0, and how far it reaches. */
static int64_t reach_of(const fixture *f, bw_tet t, int64_t *low) {
    int64_t high = *low = f->map.value[t][0][0];
    for (int i = 1; i < 4; i++) {
        int64_t x = f->map.value[t][i][0];
        if (x < *low) *low = x;
        if (x > high) high = x;
    }
    return high - *low;
}

static void a_cell_with_thousands_of_corners_is_checked(void **state) {
    (void)state;
    enum { CUTS = 1000 };
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f;
    kit_expect_ok(&ctx, start(&ctx, &f, "cuboid", 3));
    size_t facet = 0;
    while (f.mesh.facet_tet[facet][1] == BW_NONE) facet++;
    bw_cell left = f.mesh.facet_tet[facet][1], other = f.mesh.facet_tet[facet][0];
    int64_t low, reach = reach_of(&f, left, &low);
    kit_expect_ok(&ctx, bw_cells_open(&ctx, &f.cells, other));
    for (int i = 1; i <= CUTS; i++) { /* slices of one tet, which part the facets of its neighbours; the rest above is the newest cell */
        bw_polygon section;
        kit_expect_ok(&ctx, bw_cells_cut(&ctx, &f.cells, left, (bw_plane){low + reach / (CUTS + 1) * i, 0}, &section));
        assert_int_not_equal(section, BW_NONE);
        left = (bw_cell)f.cells.cell_count - 1;
    }
    size_t corners = 0;
    for (bw_polygon p = bw_cells_first_in_cell(&f.cells, other); p != BW_NONE; p = bw_cells_next_in_cell(&f.cells, p, other)) {
        bw_half first = f.cells.polygon[p].half, x = first;
        do corners++, x = f.cells.half[x].next;
        while (x != first);
    }
    assert_true(corners > 2048); /* twice what there is room for at first */
    kit_expect_ok(&ctx, bw_cells_check(&ctx, &f.cells));
    bw_half h = f.cells.polygon[bw_cells_first_in_cell(&f.cells, other)].half;
    f.cells.polygon[f.cells.half[h].polygon].cell[f.cells.polygon[f.cells.half[h].polygon].cell[0] != other] = left;
    kit_expect_status(&ctx, bw_cells_check(&ctx, &f.cells), BW_E_CHECK);
    finish(&ctx, &f);
}

static void damage_is_found(void **state) {
    (void)state;
    for (int kind = 0; kind < 10; kind++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fixture f;
        kit_expect_ok(&ctx, start(&ctx, &f, "cuboid", 2));
        bw_polygon section = BW_NONE;
        for (bw_cell c = 0; section == BW_NONE; c++) {
            kit_random random = kit_random_start((uint64_t)c);
            kit_expect_ok(&ctx, bw_cells_cut(&ctx, &f.cells, c, random_plane(&ctx, &f.cells, c, &random), &section));
            if (section != BW_NONE && f.cells.polygon[section].kind != BW_IN_TET) section = BW_NONE;
        }
        kit_expect_ok(&ctx, bw_cells_check(&ctx, &f.cells));
        bw_half h = f.cells.polygon[section].half;
        switch (kind) {
        case 0: f.cells.half[h].origin = bw_cells_half_end(&f.cells, h); break;
        case 1: f.cells.half[h].radial = h; break;
        case 2: f.cells.section[f.cells.polygon[section].carrier]++; break;
        case 3: f.cells.polygon[section].cell[0] = f.cells.polygon[section].cell[1]; break;
        case 4: f.cells.polygon[section].half = BW_NONE; break;
        case 5: f.cells.of_facet[f.mesh.tet_facet[bw_cells_tet(&f.cells, f.cells.polygon[section].cell[0])][0]] = BW_NONE; break;
        case 6: f.cells.of_facet[f.mesh.tet_facet[bw_cells_tet(&f.cells, f.cells.polygon[section].cell[0])][0]] = section; break;
        case 7: f.cells.list[f.cells.polygon[section].cell[1]] = BW_NONE; break; /* an opened tet closes again */
        case 8: f.cells.polygon[section].in_cell[0] = section; break; /* a list without end */
        default: f.cells.polygon[boundary_of_closed_tet(&f)].cell[0]--; break;
        }
        kit_expect_status(&ctx, bw_cells_check(&ctx, &f.cells), BW_E_CHECK);
        finish(&ctx, &f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(random_cuts_keep_every_invariant),
        cmocka_unit_test(stored_integers_agree_with_exact_coordinates),
        cmocka_unit_test(a_plane_that_only_touches_cuts_nothing),
        cmocka_unit_test(a_cell_with_thousands_of_corners_is_checked),
        cmocka_unit_test(damage_is_found),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
