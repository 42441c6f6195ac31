/* The brush fire: where it is lit, what it burns, and where it stops. */
#include "kit/kit.h"

#include <stdlib.h>

#include "core/sample_map.h"
#include "mesh/fire.h"
#include "stage/build.h"
#include "stage/trace.h"

enum { CELLS = 1000000 };

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
} fixture;

/* Sanitized, with uncut cells. */
static void open_model(fixture *f, const char *name, int scramble) {
    *f = (fixture){0};
    bw_context_init(&f->ctx);
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.7, options.seed = kit_seed(), options.scramble = scramble;
    kit_expect_ok(&f->ctx, sample_map(&f->ctx, name, &options, &f->mesh, &f->map));
    kit_expect_ok(&f->ctx, bw_cells_init(&f->ctx, &f->cells, &f->mesh, &f->map));
}

static void trace_and_build(fixture *f) {
    kit_expect_ok(&f->ctx, bw_trace(&f->ctx, &f->cells, BW_COMPLEX_MC, CELLS));
    kit_expect_ok(&f->ctx,
                  bw_build_complex(&f->ctx, &f->cells, &(bw_build_options){.max_cells = CELLS}, &f->complex));
}

static void close_model(fixture *f) {
    bw_complex_clear(&f->ctx, &f->complex);
    bw_cells_clear(&f->ctx, &f->cells);
    bw_grid_map_clear(&f->ctx, &f->map);
    bw_tet_mesh_clear(&f->ctx, &f->mesh);
    assert_int_equal(f->ctx.memory.used, 0);
}

/* The complex as the walls now have it; all blocks must be cuboids. */
static void read_blocks(fixture *f, bw_complex *x) {
    bw_torus_list tori = {0};
    kit_expect_ok(&f->ctx, bw_cells_check(&f->ctx, &f->cells));
    kit_expect_ok(&f->ctx, bw_complex_build(&f->ctx, &f->cells, x, &tori));
    assert_int_equal(tori.count, 0);
    bw_free(&f->ctx, tori.cell);
    kit_expect_ok(&f->ctx, bw_complex_check(&f->ctx, &f->cells, x));
}

static size_t count_flagged(const fixture *f, uint8_t flag) {
    size_t count = 0;
    for (size_t p = 0; p < f->cells.polygon_count; p++)
        count += bw_cells_polygon_is_leaf(&f->cells, (bw_polygon)p) && f->cells.polygon[p].flags & flag;
    return count;
}

/* ---- planes ----------------------------------------------------------------------------------------- */

/* A cell of a block and the plane across the middle of the block's axis in it, if the cell reaches it:
 * BW_NONE if none does. */
static bw_cell middle_of_block(const fixture *f, bw_block block, int axis, bw_plane *plane) {
    for (bw_cell cell = 0; (size_t)cell < f->complex.cell_count; cell++) {
        if (f->complex.cell_block[cell] != block) continue;
        bw_transition back = bw_transition_inverse(bw_complex_chart(&f->complex, cell));
        *plane =
            bw_transition_plane(&back, (bw_plane){f->complex.block_extent[block][axis] / 2, (int8_t)axis});
        int sides = 0;
        for (bw_polygon p = bw_cells_first_in_cell(&f->cells, cell); p != BW_NONE;
             p = bw_cells_next_in_cell(&f->cells, p, (bw_cell)cell)) {
            bw_half h = f->cells.polygon[p].half;
            do {
                int side = bw_cells_side(&f->cells, f->cells.half[h].origin, bw_cells_tet(&f->cells, cell), *plane);
                sides |= side < 0 ? 1 : side > 0 ? 2 : 0;
                h = f->cells.half[h].next;
            } while (h != f->cells.polygon[p].half);
        }
        if (sides == 3) return (bw_cell)cell;
    }
    return BW_NONE;
}

static void burn_plane(fixture *f, bool stops, bw_block block, int axis) {
    bw_fire fire;
    bw_plane plane;
    kit_expect_ok(&f->ctx, bw_cells_open_all(&f->ctx, &f->cells));
    bw_cell cell = middle_of_block(f, block, axis, &plane);
    assert_int_not_equal(cell, BW_NONE);
    bw_fire_init(&fire, &f->ctx, &f->cells,
                 &(bw_fire_rules){.stops_at_walls = stops, .flags = BW_SPLIT, .max_cells = CELLS});
    kit_expect_ok(&f->ctx, bw_fire_ignite_plane(&fire, cell, plane));
    kit_expect_ok(&f->ctx, bw_fire_run(&fire));
    bw_fire_clear(&fire);
}

/* One block in two, and every other as it was. */
static void a_plane_stops_at_the_walls_of_its_block(void **state) {
    (void)state;
    static const char *const names[] = {"cuboid", "l-shape", "plus", "cylinder", "ball", "tee"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++)
        for (int axis = 0; axis < 3; axis++) {
            fixture f;
            bw_complex x;
            open_model(&f, names[m], axis);
            trace_and_build(&f);
            bw_block block = (bw_block)(f.complex.block_count / 2);
            const int64_t *extent = f.complex.block_extent[block];
            __int128 area = (__int128)extent[(axis + 1) % 3] * extent[(axis + 2) % 3];
            burn_plane(&f, true, block, axis);
            read_blocks(&f, &x);
            assert_int_equal(x.block_count, f.complex.block_count + 1);
            size_t split = 0;
            for (size_t p = 0; p < x.patch_count; p++) {
                if (!(x.patch_flags[p] & BW_PATCH_TORUS)) continue;
                assert_true((__int128)x.patch_extent[p][0] * x.patch_extent[p][1] == area);
                split++;
            }
            assert_int_equal(split, 1);
            bw_complex_clear(&f.ctx, &x);
            close_model(&f);
        }
}

/* Through the middle of a plus: across the two or four arms that the plane meets, to the boundary on all
 * sides. */
static void without_that_rule_it_crosses_walls(void **state) {
    (void)state;
    for (int axis = 0; axis < 3; axis++) {
        fixture f;
        bw_complex x;
        open_model(&f, "plus", BW_SCRAMBLE_TETS);
        trace_and_build(&f);
        bw_block middle = 0; /* the block without boundary */
        for (size_t b = 0; b < f.complex.block_count; b++) {
            bool inside = true;
            for (size_t i = f.complex.block_side_begin[6 * b]; i < f.complex.block_side_begin[6 * b + 6]; i++)
                inside = inside && !(f.complex.patch_flags[f.complex.block_side[i]] & BW_PATCH_BOUNDARY);
            if (inside) middle = (bw_block)b;
        }
        burn_plane(&f, false, middle, axis);
        read_blocks(&f, &x);
        assert_int_equal(x.block_count, f.complex.block_count + 5); /* the middle and four arms in two */
        bw_complex_clear(&f.ctx, &x);
        close_model(&f);
    }
}

static void a_plane_that_misses_the_cell_burns_nothing(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "cuboid", 0);
    size_t walls = count_flagged(&f, BW_WALL), cells = f.cells.cell_count;
    bw_fire fire;
    bw_fire_init(&fire, &f.ctx, &f.cells, &(bw_fire_rules){.stops_at_walls = true, .max_cells = CELLS});
    kit_expect_ok(&f.ctx, bw_fire_ignite_plane(&fire, 0, (bw_plane){BW_GRID_MAX, 0}));
    kit_expect_ok(&f.ctx, bw_fire_run(&fire));
    bw_fire_clear(&fire);
    assert_int_equal(count_flagged(&f, BW_WALL), walls);
    assert_int_equal(f.cells.cell_count, cells);
    close_model(&f);
}

/* ---- points ----------------------------------------------------------------------------------------- */

static bool on_boundary(const fixture *f, bw_vertex v) {
    for (size_t i = 0; i < f->mesh.facet_count; i++)
        if (f->mesh.facet_tet[i][1] == BW_NONE &&
            (f->mesh.facet[i][0] == v || f->mesh.facet[i][1] == v || f->mesh.facet[i][2] == v))
            return true;
    return false;
}

static bool on_singular_edge(const fixture *f, bw_vertex v) {
    for (size_t e = 0; e < f->mesh.edge_count; e++)
        if (f->map.edge_flags[e] & BW_EDGE_SINGULAR && (f->mesh.edge[e][0] == v || f->mesh.edge[e][1] == v))
            return true;
    return false;
}

/* The n-th regular vertex inside, or on the boundary; n counts from the newest vertex. */
static bw_vertex regular_vertex(const fixture *f, bool boundary) {
    bw_vertex v = (bw_vertex)f->mesh.vertex_count - 1;
    while (v >= 0 && (on_boundary(f, v) != boundary || on_singular_edge(f, v))) v--;
    assert_true(v >= 0);
    return v;
}

static void burn_vertex(fixture *f, bw_vertex v, unsigned axes) {
    bw_tet *tets = calloc(f->mesh.tet_count, sizeof *tets);
    size_t count = 0;
    for (size_t t = 0; t < f->mesh.tet_count; t++)
        if (bw_tet_corner(&f->mesh, (bw_tet)t, v) >= 0) tets[count++] = (bw_tet)t;
    bw_fire fire;
    bw_fire_init(&fire, &f->ctx, &f->cells, &(bw_fire_rules){.stops_at_walls = true, .max_cells = CELLS});
    kit_expect_ok(&f->ctx, bw_fire_ignite_vertex(&fire, v, tets, count, axes));
    kit_expect_ok(&f->ctx, bw_fire_run(&fire));
    bw_fire_clear(&fire);
    free(tets);
}

/* Every plane through an inner point of a cuboid doubles its blocks, in whatever charts the tets around the
 * point are. */
static void planes_through_a_point_halve_a_cuboid_each(void **state) {
    (void)state;
    for (unsigned axes = 0; axes < 8; axes++)
        for (int scramble = BW_SCRAMBLE_NONE; scramble <= BW_SCRAMBLE_TETS; scramble += BW_SCRAMBLE_TETS) {
            fixture f;
            bw_complex x;
            open_model(&f, "cuboid", scramble);
            burn_vertex(&f, regular_vertex(&f, false), axes);
            read_blocks(&f, &x);
            assert_int_equal(x.block_count, 1 << __builtin_popcount(axes));
            bw_complex_clear(&f.ctx, &x);
            close_model(&f);
        }
}

/* On the boundary the plane of the boundary itself is no wall; the other two are. */
static void a_point_on_the_boundary_gives_two(void **state) {
    (void)state;
    for (int scramble = BW_SCRAMBLE_NONE; scramble <= BW_SCRAMBLE_TETS; scramble += BW_SCRAMBLE_TETS) {
        fixture f;
        bw_complex x;
        open_model(&f, "cuboid", scramble);
        burn_vertex(&f, regular_vertex(&f, true), 7);
        read_blocks(&f, &x);
        assert_int_equal(x.block_count, 4);
        bw_complex_clear(&f.ctx, &x);
        close_model(&f);
    }
}

/* ---- edges ------------------------------------------------------------------------------------------ */

/* What tracing does, by hand: with a limit for the cells, twice the same, and never across a singular edge.
 */
static bw_status burn_singular_edges(bw_context *ctx, bw_cells *cells, uint64_t max_cells) {
    bw_fire fire;
    bw_fire_init(&fire, ctx, cells, &(bw_fire_rules){.stops_at_walls = true, .max_cells = max_cells});
    bw_status status = bw_cells_open_all(ctx, cells);
    for (size_t e = 0; e < cells->mesh->edge_count && status == BW_OK; e++)
        if (cells->map->edge_flags[e] & BW_EDGE_SINGULAR) status = bw_fire_ignite_edge(&fire, cells->of_edge[e]);
    if (status == BW_OK) status = bw_fire_run(&fire);
    bw_fire_clear(&fire);
    return status;
}

/* MC 4: a wall along an iso-surface in each quarter turn, so as many walls as quarters inside, one more on
 * the boundary. */
static void a_singular_edge_has_a_wall_in_every_quarter(void **state) {
    (void)state;
    static const char *const names[] = {"l-shape", "cylinder", "ball", "tee", "plate"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++) {
        fixture f;
        open_model(&f, names[m], (int)m % 4);
        kit_expect_ok(&f.ctx, burn_singular_edges(&f.ctx, &f.cells, CELLS));
        size_t seen = 0;
        for (size_t e = 0; e < f.cells.edge_count; e++) {
            if (!bw_cells_edge_is_leaf(&f.cells, (bw_cedge)e) ||
                !bw_cells_edge_is_singular(&f.cells, (bw_cedge)e))
                continue;
            bw_half head = f.cells.edge[e].half, h = head;
            int walls = 0;
            do {
                walls += (f.cells.polygon[f.cells.half[h].polygon].flags & BW_WALL) != 0;
                h = f.cells.half[h].radial;
            } while (h != head);
            assert_int_equal(walls, f.map.quarters[f.cells.edge[e].carrier] +
                                        bw_cells_edge_is_boundary(&f.cells, (bw_cedge)e));
            seen++;
        }
        assert_true(seen > 0);
        close_model(&f);
    }
}

static void the_same_sparks_burn_the_same_walls(void **state) {
    (void)state;
    fixture f[2];
    for (int i = 0; i < 2; i++) {
        open_model(&f[i], "plate", BW_SCRAMBLE_BLOCKS);
        kit_expect_ok(&f[i].ctx, burn_singular_edges(&f[i].ctx, &f[i].cells, CELLS));
    }
    assert_int_equal(f[0].cells.polygon_count, f[1].cells.polygon_count);
    for (size_t p = 0; p < f[0].cells.polygon_count; p++) {
        assert_int_equal(f[0].cells.polygon[p].flags, f[1].cells.polygon[p].flags);
        assert_int_equal(bw_cells_distance(&f[0].cells, (bw_polygon)p), bw_cells_distance(&f[1].cells, (bw_polygon)p));
    }
    for (int i = 0; i < 2; i++) close_model(&f[i]);
}

static void the_limit_of_cells_is_kept(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "ball", 0);
    kit_expect_status(&f.ctx, burn_singular_edges(&f.ctx, &f.cells, 100), BW_E_LIMIT);
    assert_int_equal(f.cells.cell_count, f.mesh.tet_count + 101); /* found by the cut that goes beyond */
    close_model(&f);
}

static bw_status burn_and_clear(bw_context *ctx, void *user) {
    fixture *f = user;
    bw_cells cells = {0};
    bw_status status = bw_cells_init(ctx, &cells, &f->mesh, &f->map);
    if (status == BW_OK) status = burn_singular_edges(ctx, &cells, CELLS);
    bw_cells_clear(ctx, &cells);
    return status;
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    fixture f;
    open_model(&f, "plate", 0);
    assert_true(kit_fail_each_allocation(burn_and_clear, &f) > 20);
    close_model(&f);
}

static void fire_can_be_cancelled(void **state) {
    (void)state;
    static volatile sig_atomic_t cancel = 1;
    fixture f;
    open_model(&f, "plate", 0);
    bw_context ctx;
    bw_context_init(&ctx);
    ctx.cancel = &cancel;
    kit_expect_status(&ctx, burn_and_clear(&ctx, &f), BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, 0);
    close_model(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_plane_stops_at_the_walls_of_its_block),
        cmocka_unit_test(without_that_rule_it_crosses_walls),
        cmocka_unit_test(a_plane_that_misses_the_cell_burns_nothing),
        cmocka_unit_test(planes_through_a_point_halve_a_cuboid_each),
        cmocka_unit_test(a_point_on_the_boundary_gives_two),
        cmocka_unit_test(a_singular_edge_has_a_wall_in_every_quarter),
        cmocka_unit_test(the_same_sparks_burn_the_same_walls),
        cmocka_unit_test(the_limit_of_cells_is_kept),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(fire_can_be_cancelled),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
