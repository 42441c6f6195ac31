/* The serial construction: which walls it leaves out, and that the blocks are cuboids all the same. */
#include "kit/kit.h"

#include <stdlib.h>

#include "core/sample_map.h"
#include "mesh/fire_serial.h"
#include "mesh/rectangles.h"
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
static void open_model(fixture *f, const char *name, const bw_model_options *options) {
    *f = (fixture){0};
    bw_context_init(&f->ctx);
    kit_expect_ok(&f->ctx, sample_map(&f->ctx, name, options, &f->mesh, &f->map));
    kit_expect_ok(&f->ctx, bw_cells_init(&f->ctx, &f->cells, &f->mesh, &f->map));
}

static bw_status build(fixture *f) {
    bw_build_options options = {.max_cells = CELLS};
    return bw_build_complex(&f->ctx, &f->cells, &options, &f->complex); /* with every check of the complex */
}

static void trace_and_build(fixture *f, bw_complex_kind kind) {
    kit_expect_ok(&f->ctx, bw_trace(&f->ctx, &f->cells, kind, CELLS));
    kit_expect_ok(&f->ctx, bw_cells_check(&f->ctx, &f->cells));
    kit_expect_ok(&f->ctx, build(f));
}

static void close_model(fixture *f) {
    bw_complex_clear(&f->ctx, &f->complex);
    bw_cells_clear(&f->ctx, &f->cells);
    bw_grid_map_clear(&f->ctx, &f->map);
    bw_tet_mesh_clear(&f->ctx, &f->mesh);
    assert_int_equal(f->ctx.memory.used, 0);
}

static bw_model_options options_of(uint64_t seed) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1 + (int)(seed & 1), options.noise = 0.7, options.seed = seed;
    options.scramble = (int)(seed >> 1 & 3), options.perturb = seed & 8 ? 1e-7 : 0;
    return options;
}

static size_t blocks_of(const char *name, const bw_model_options *options, bw_complex_kind kind) {
    fixture f;
    open_model(&f, name, options);
    trace_and_build(&f, kind);
    size_t blocks = f.complex.block_count;
    close_model(&f);
    return blocks;
}

/* ---- what is left out ------------------------------------------------------------------------------- */

/* Every block that touches an arc has a quarter turn of it along an edge of its own, or a half turn in a side. */
static void expect_walls_between_blocks(const fixture *f, bw_arc a, const size_t *along) {
    const bw_complex *x = &f->complex;
    size_t quarters = x->arc_quarters[a], boundary = x->arc_flags[a] & BW_ARC_BOUNDARY;
    assert_in_range(along[a], 0, quarters);
    assert_int_equal((quarters - along[a]) % 2, 0);
    size_t turns = along[a] + (quarters - along[a]) / 2;
    int walls = bw_cells_walls_at(&f->cells, x->arc_edge[x->arc_edge_begin[a]]);
    assert_int_equal(walls, turns + (boundary ? 1 : 0));
}

/* Cells of a block at an arc, one per quarter at most: counted where two of its walls meet at a right angle. */
static size_t *count_along(const fixture *f) {
    const bw_complex *x = &f->complex;
    size_t *along = calloc(x->arc_count, sizeof *along);
    assert_non_null(along);
    for (size_t i = 0; i < x->block_edge_begin[12 * x->block_count]; i++) along[x->block_edge[i] >> 1]++;
    return along;
}

static void blocks_meet_singular_arcs_in_quarter_or_half_turns(void **state) {
    (void)state;
    size_t models, singular = 0;
    const bw_model_info *list = bw_model_list(&models);
    for (size_t m = 0; m < models; m++)
        for (uint64_t i = 0; i < 4; i++) {
            fixture f;
            bw_model_options options = options_of(4 * kit_seed() + i);
            open_model(&f, list[m].name, &options);
            trace_and_build(&f, BW_COMPLEX_SERIAL);
            size_t *along = count_along(&f);
            for (bw_arc a = 0; a < (bw_arc)f.complex.arc_count; a++) {
                if (!(f.complex.arc_flags[a] & BW_ARC_SINGULAR)) continue;
                expect_walls_between_blocks(&f, a, along);
                singular++;
            }
            free(along);
            close_model(&f);
        }
    assert_true(singular > 100);
}

/* Models with singular edges whose walls are not all needed. */
static void fewer_blocks_than_with_all_walls(void **state) {
    (void)state;
    static const char *const names[] = {"l-shape", "ball", "hollow-torus", "tee", "plate", "bearing", "part"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++)
        for (uint64_t i = 0; i < 2; i++) {
            bw_model_options options = options_of(kit_seed() + i);
            size_t all = blocks_of(names[m], &options, BW_COMPLEX_MC);
            size_t sparse = blocks_of(names[m], &options, BW_COMPLEX_SERIAL);
            assert_in_range(sparse, 1, all - 1);
        }
}

static size_t count_walls(const fixture *f) {
    size_t count = 0;
    for (size_t p = 0; p < f->cells.polygon_count; p++)
        count += bw_cells_polygon_is_leaf(&f->cells, (bw_polygon)p) && f->cells.polygon[p].flags & BW_WALL;
    return count;
}

static void a_second_visit_finds_nothing_to_burn(void **state) {
    (void)state;
    static const char *const names[] = {"ball", "part", "torus-quarter"};
    for (size_t m = 0; m < sizeof names / sizeof *names; m++) {
        fixture f;
        bw_fire fire;
        bw_model_options options = options_of(kit_seed());
        open_model(&f, names[m], &options);
        kit_expect_ok(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_SERIAL, CELLS));
        size_t walls = count_walls(&f), cells = f.cells.cell_count;
        bw_fire_init(&fire, &f.ctx, &f.cells, &(bw_fire_rules){.stops_at_walls = true, .max_cells = CELLS});
        kit_expect_ok(&f.ctx, bw_fire_serial(&fire));
        kit_expect_ok(&f.ctx, bw_rectangles(&fire));
        bw_fire_clear(&fire);
        assert_int_equal(count_walls(&f), walls);
        assert_int_equal(f.cells.cell_count, cells);
        close_model(&f);
    }
}

/* ---- rectangles ------------------------------------------------------------------------------------- */

static bool has_lines(const fixture *f) {
    for (size_t e = 0; e < f->cells.edge_count; e++)
        if (bw_cells_edge_is_leaf(&f->cells, (bw_cedge)e) && f->cells.edge[e].flags & BW_KEPT) return true;
    return false;
}

/* Serial fire, then perhaps the lines; whether the complex is good, and whether lines were drawn. */
static bool burn_and_build(uint64_t seed, bool draw, bool *drawn) {
    fixture f;
    bw_fire fire;
    bw_model_options options = options_of(2 * seed);
    options.perturb = 0;
    open_model(&f, seed & 1 ? "bearing" : "part", &options);
    bw_fire_init(&fire, &f.ctx, &f.cells, &(bw_fire_rules){.stops_at_walls = true, .max_cells = CELLS});
    kit_expect_ok(&f.ctx, bw_cells_open_all(&f.ctx, &f.cells));
    kit_expect_ok(&f.ctx, bw_fire_serial(&fire));
    if (draw) kit_expect_ok(&f.ctx, bw_rectangles(&fire));
    bw_fire_clear(&fire);
    kit_expect_ok(&f.ctx, bw_cells_check(&f.ctx, &f.cells));
    *drawn = has_lines(&f);
    bool good = build(&f) == BW_OK;
    if (!good) assert_int_equal(f.ctx.error.status, BW_E_CHECK);
    close_model(&f);
    return good;
}

/* Lines are drawn where the complex would be refused without them, and nowhere else. */
static void walls_that_are_no_rectangles_are_parted(void **state) {
    (void)state;
    enum { SEEDS = 16 };
    size_t parted = 0;
    for (uint64_t seed = 1; seed <= SEEDS; seed++) {
        bool drawn;
        bool good = burn_and_build(seed, false, &drawn);
        assert_false(drawn);
        assert_true(burn_and_build(seed, true, &drawn));
        assert_int_equal(drawn, !good);
        parted += drawn;
    }
    assert_in_range(parted, 1, SEEDS - 1);
}

/* ---- limits ----------------------------------------------------------------------------------------- */

static bw_status trace_part(bw_context *ctx, void *user) {
    const fixture *f = user;
    bw_cells cells;
    bw_status status = bw_cells_init(ctx, &cells, &f->mesh, &f->map);
    if (status == BW_OK) status = bw_trace(ctx, &cells, BW_COMPLEX_SERIAL, CELLS);
    bw_cells_clear(ctx, &cells);
    return status;
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    fixture f;
    bw_model_options options = options_of(8);
    open_model(&f, "ball", &options);
    assert_true(kit_fail_each_allocation(trace_part, &f) > 20);
    close_model(&f);
}

static void the_limit_of_cells_holds(void **state) {
    (void)state;
    fixture f;
    bw_model_options options = options_of(2);
    open_model(&f, "ball", &options);
    kit_expect_status(&f.ctx, bw_trace(&f.ctx, &f.cells, BW_COMPLEX_SERIAL, 10), BW_E_LIMIT);
    assert_int_equal(f.cells.cell_count, f.mesh.tet_count + 11);
    close_model(&f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_meet_singular_arcs_in_quarter_or_half_turns),
        cmocka_unit_test(fewer_blocks_than_with_all_walls),
        cmocka_unit_test(a_second_visit_finds_nothing_to_burn),
        cmocka_unit_test(walls_that_are_no_rectangles_are_parted),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(the_limit_of_cells_holds),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
