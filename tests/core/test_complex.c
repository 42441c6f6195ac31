/* Every sample model has the blocks it is known to have; whatever is damaged in a complex is found. */
#include "kit/kit.h"

#include "core/sample_map.h"
#include "stage/build.h"
#include "stage/trace.h"

typedef struct {
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells;
    bw_complex complex;
} fixture;

static bw_status make(bw_context *ctx, fixture *f, const char *name, const bw_model_options *options, bw_complex_kind kind) {
    memset(f, 0, sizeof *f);
    bw_status status = sample_map(ctx, name, options, &f->mesh, &f->map);
    if (status == BW_OK) status = bw_cells_init(ctx, &f->cells, &f->mesh, &f->map);
    if (status == BW_OK) status = bw_trace(ctx, &f->cells, kind, 1000000);
    if (status == BW_OK) status = bw_build_complex(ctx, &f->cells, &(bw_build_options){.max_cells = 1000000}, &f->complex);
    return status;
}

static void clear(bw_context *ctx, fixture *f) {
    bw_complex_clear(ctx, &f->complex);
    bw_cells_clear(ctx, &f->cells);
    bw_grid_map_clear(ctx, &f->map);
    bw_tet_mesh_clear(ctx, &f->mesh);
}

static bw_model_options options_of(uint64_t seed, int scramble) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.7, options.seed = seed, options.scramble = scramble;
    options.perturb = scramble && seed & 1 ? 1e-7 : 0;
    options.stretch = seed & 2 ? 2.5 : 1;
    return options;
}

static void check_model(const bw_model_info *model, const bw_model_options *options, bw_complex_kind kind) {
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f;
    bw_status status = make(&ctx, &f, model->name, options, kind);
    if (status != BW_OK) print_message("%s seed %llu scramble %d\n", model->name, (unsigned long long)options->seed, options->scramble);
    kit_expect_ok(&ctx, status);
    kit_expect_ok(&ctx, bw_cells_check(&ctx, &f.cells));
    size_t known = (size_t)model->blocks_bc, blocks = f.complex.block_count;
    bool exact = options->scramble == BW_SCRAMBLE_NONE && options->perturb == 0;
    if (exact && (kind == BW_COMPLEX_BC ? blocks != known : blocks > known))
        fail_msg("%s seed %llu: %zu blocks, %zu expected", model->name, (unsigned long long)options->seed, blocks, known);
    for (size_t a = 0; a < f.complex.arc_count && f.complex.torus_splits == 0 && kind == BW_COMPLEX_BC; a++)
        assert_int_equal(f.complex.arc_flags[a] & BW_ARC_T, 0); /* a base complex conforms */
    clear(&ctx, &f);
    assert_int_equal(ctx.memory.used, 0);
}

static void every_model_has_its_known_blocks(void **state) {
    (void)state;
    size_t models;
    const bw_model_info *list = bw_model_list(&models);
    for (size_t m = 0; m < models; m++)
        for (uint64_t i = 0; i < 4; i++) {
            bw_model_options options = options_of(kit_seed() + i, BW_SCRAMBLE_NONE);
            check_model(&list[m], &options, i & 1 ? BW_COMPLEX_MC : BW_COMPLEX_BC);
        }
}

/* Turned charts and errors in the parameters: what was one plane may now be several, a hair apart, so the number of blocks is not
 * known; but everything that the checks demand holds. */
static void disturbed_models_have_valid_complexes(void **state) {
    (void)state;
    size_t models;
    const bw_model_info *list = bw_model_list(&models);
    for (size_t m = 0; m < models; m++)
        for (uint64_t i = 0; i < 3; i++) {
            bw_model_options options = options_of(kit_seed() + i, BW_SCRAMBLE_BLOCKS + (int)i);
            check_model(&list[m], &options, BW_COMPLEX_MC);
        }
}

static bw_status make_and_clear(bw_context *ctx, void *user) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1;
    fixture f;
    bw_status status = make(ctx, &f, user, &options, BW_COMPLEX_MC);
    clear(ctx, &f);
    return status;
}

static void any_allocation_may_fail(void **state) {
    (void)state;
    assert_true(kit_fail_each_allocation(make_and_clear, "torus") > 50);
}

/* The cells of the tets do not count: the limit is the same for a mesh of any size that needs as many cuts. */
static void one_cell_more_than_cuts_may_add_is_a_limit(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f = {0};
    bw_model_options options = options_of(3, 0);
    kit_expect_ok(&ctx, sample_map(&ctx, "ball", &options, &f.mesh, &f.map));
    kit_expect_ok(&ctx, bw_cells_init(&ctx, &f.cells, &f.mesh, &f.map));
    kit_expect_ok(&ctx, bw_trace(&ctx, &f.cells, BW_COMPLEX_MC, UINT64_MAX));
    size_t added = f.cells.cell_count - f.mesh.tet_count;
    assert_true(added > 10);
    for (size_t less = 0; less < 2; less++) {
        bw_cells_clear(&ctx, &f.cells);
        kit_expect_ok(&ctx, bw_cells_init(&ctx, &f.cells, &f.mesh, &f.map));
        kit_expect_status(&ctx, bw_trace(&ctx, &f.cells, BW_COMPLEX_MC, added - less), less ? BW_E_LIMIT : BW_OK);
    }
    clear(&ctx, &f);
    assert_int_equal(ctx.memory.used, 0);
}

static void damage_one_thing(bw_complex *x, int kind) {
    switch (kind) {
    case 0: x->arc_length[3]++; break;
    case 1: x->block_extent[1][2]--; break;
    case 2: x->patch_extent[2][0]++; break;
    case 3: x->block_corner[0][5] = x->block_corner[0][6]; break;
    case 4: x->patch_corner[4][0] = x->patch_corner[4][1]; break;
    case 5: x->block_edge[0] ^= 1; break;
    case 6: x->patch_flags[0] ^= BW_PATCH_BOUNDARY; break;
    case 7: x->arc_flags[0] ^= BW_ARC_SINGULAR; break;
    case 8: x->node_count++; break;
    case 9: x->chart[x->cell_chart[5]].shift[0]++; break;
    default: x->block_side[0] = x->block_side[x->block_side_begin[6]]; break;
    }
}

static void damage_is_found(void **state) {
    (void)state;
    for (int kind = 0; kind <= 10; kind++) {
        bw_context ctx;
        bw_context_init(&ctx);
        fixture f;
        bw_model_options options = options_of(2, 0);
        kit_expect_ok(&ctx, make(&ctx, &f, "ball", &options, BW_COMPLEX_MC));
        kit_expect_ok(&ctx, bw_complex_check(&ctx, &f.cells, &f.complex));
        damage_one_thing(&f.complex, kind);
        if (bw_complex_check(&ctx, &f.cells, &f.complex) != BW_E_CHECK) fail_msg("damage %d was not found", kind);
        clear(&ctx, &f);
    }
}

/* A wall is taken away: the two blocks beside it no longer are cuboids, or the rims that it leaves are no rectangles. */
static void a_missing_wall_is_found(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    fixture f;
    bw_model_options options = options_of(5, 0);
    kit_expect_ok(&ctx, make(&ctx, &f, "ball", &options, BW_COMPLEX_MC));
    bw_polygon inner = 0;
    while (!(f.cells.polygon[inner].flags == BW_WALL && bw_cells_polygon_is_leaf(&f.cells, inner))) inner++;
    f.cells.polygon[inner].flags = 0;
    bw_complex damaged;
    bw_torus_list tori = {0};
    bw_status status = bw_complex_build(&ctx, &f.cells, &damaged, &tori);
    assert_true(status == BW_E_CHECK || tori.count > 0);
    bw_complex_clear(&ctx, &damaged);
    bw_free(&ctx, tori.cell);
    clear(&ctx, &f);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_model_has_its_known_blocks),
        cmocka_unit_test(disturbed_models_have_valid_complexes),
        cmocka_unit_test(any_allocation_may_fail),
        cmocka_unit_test(one_cell_more_than_cuts_may_add_is_a_limit),
        cmocka_unit_test(damage_is_found),
        cmocka_unit_test(a_missing_wall_is_found),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
