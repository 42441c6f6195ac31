/* The cost E_g of X 4.1 and cubes (hex/predict.h), against figures found by hand. */
#include "core/hex_kit.h"

#include "format/hex_bwh.h"
#include "hex/predict.h"

/* A box of 3 x 1 x 1 hexes whose vertices are points of the lattice of 2 bits: x = 0, 1, 2, 3, the others 0 and 3. */
enum { ROW_POINTS = 16 };
static const uint32_t row_size[3] = {3, 1, 1};

static void make_row(double position[ROW_POINTS][3], bw_hvertex vertex[ROW_POINTS]) {
    for (int p = 0; p < ROW_POINTS; p++) {
        position[p][0] = p % 4, position[p][1] = 3 * (p / 4 % 2), position[p][2] = 3 * (p / 8);
        vertex[p] = p;
    }
}

static double entropy(double p) {
    return p > 0 && p < 1 ? -p * log2(p) - (1 - p) * log2(1 - p) : 0;
}

static double bits_of(int64_t cost) {
    return bw_predict_per_vertex(cost, 1);
}

/* The box, its first block tallied. */
typedef struct {
    double position[ROW_POINTS][3];
    bw_hvertex vertex[ROW_POINTS];
    bw_predictor predictor;
    bw_predict_tally tally;
} row;

static void tally_row(bw_context *ctx, row *r) {
    kit_expect_ok(ctx, bw_predictor_init(ctx, (const double(*)[3])r->position, ROW_POINTS, 2, &r->predictor));
    kit_expect_ok(ctx, bw_predict_tally_init(ctx, 2, &r->tally));
    bw_predict_tally_block(&r->predictor, row_size, r->vertex, &r->tally);
}

static void clear_row(bw_context *ctx, row *r) {
    bw_predict_tally_clear(ctx, &r->tally);
    bw_predictor_clear(ctx, &r->predictor);
    assert_int_equal(ctx->memory.used, 0);
}

static void what_is_trilinear_costs_nothing(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    row r;
    make_row(r.position, r.vertex);
    tally_row(&ctx, &r);
    assert_int_equal(r.tally.coordinates, 48);
    assert_int_equal(r.tally.wrong, 0);
    assert_int_equal(bw_predict_tally_cost(&r.tally), 0);
    clear_row(&ctx, &r);
}

static void errors_cost_their_entropies(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    row r;
    make_row(r.position, r.vertex);
    r.position[1][0] = 2;  /* + 1 */
    r.position[5][0] = 3;  /* + 2 */
    r.position[6][0] = 3;  /* + 1 */
    r.position[10][0] = 0; /* - 2 */
    tally_row(&ctx, &r);
    assert_int_equal(r.tally.wrong, 4);
    assert_int_equal(r.tally.negative, 1);
    assert_int_equal(r.tally.times[1], 2);
    assert_int_equal(r.tally.times[2], 2);
    assert_int_equal(r.tally.highest, 2);
    double wanted = 48 * entropy(4. / 48) + 4 * (entropy(1. / 4) + entropy(2. / 4));
    assert_true(fabs(bits_of(bw_predict_tally_cost(&r.tally)) - wanted) < 1e-4);
    /* The same block once more: twice as many of the same. */
    bw_predict_errors errors;
    kit_expect_ok(&ctx, bw_predict_errors_init(&ctx, &r.tally, &errors));
    assert_int_equal(errors.cost, bw_predict_tally_cost(&r.tally));
    bw_predict_tally_add(&r.tally, &errors);
    assert_true(fabs(bits_of(bw_predict_tally_cost(&r.tally)) - 2 * wanted) < 1e-4);
    bw_predict_errors_clear(&ctx, &errors);
    clear_row(&ctx, &r);
}

/* Corners that are off the lattice are foreseen from, as they are; only then it is rounded. */
static void what_is_foreseen_is_rounded_last(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    row r;
    make_row(r.position, r.vertex);
    r.position[4][0] = 0.4; /* a corner, on 0; a third of the way on from it is 1.27, two thirds 2.13 */
    r.position[5][0] = 1.27, r.position[6][0] = 1.6;
    tally_row(&ctx, &r);
    assert_int_equal(r.predictor.at[4][0], 0);
    assert_int_equal(r.tally.wrong, 0);
    clear_row(&ctx, &r);
}

/* As large as doubles can be: their differences are infinite, predictions may be no numbers. */
static void coordinates_of_any_size_stay_on_the_lattice(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    row r;
    make_row(r.position, r.vertex);
    for (int p = 0; p < ROW_POINTS; p++)
        for (int k = 0; k < 3; k++) r.position[p][k] = r.position[p][k] > 1 ? 1.7e308 : -1.7e308;
    tally_row(&ctx, &r);
    for (int p = 0; p < ROW_POINTS; p++)
        for (int k = 0; k < 3; k++) assert_true(r.predictor.at[p][k] >= 0 && r.predictor.at[p][k] <= 3);
    assert_int_equal(r.tally.coordinates, 3 * ROW_POINTS);
    clear_row(&ctx, &r);
}

/* Blocks with random errors, added and taken away in any order. */
static void tallies_forget_what_is_taken_away(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    enum { COUNT = 20 };
    kit_random random = kit_random_start(11);
    bw_predict_errors errors[COUNT];
    bw_predict_tally tally, other;
    kit_expect_ok(&ctx, bw_predict_tally_init(&ctx, 12, &tally));
    kit_expect_ok(&ctx, bw_predict_tally_init(&ctx, 12, &other));
    for (int b = 0; b < COUNT; b++) {
        double position[ROW_POINTS][3];
        bw_hvertex vertex[ROW_POINTS];
        bw_predictor predictor;
        make_row(position, vertex);
        for (int p = 1; p < ROW_POINTS; p++) position[p][0] += kit_random_range(&random, -0.5, 0.5);
        kit_expect_ok(&ctx, bw_predictor_init(&ctx, (const double(*)[3])position, ROW_POINTS, 12, &predictor));
        bw_predict_tally_empty(&tally);
        bw_predict_tally_block(&predictor, row_size, vertex, &tally);
        kit_expect_ok(&ctx, bw_predict_errors_init(&ctx, &tally, &errors[b]));
        bw_predictor_clear(&ctx, &predictor);
    }
    bw_predict_tally_empty(&tally);
    for (int b = 0; b < COUNT; b++) bw_predict_tally_add(&tally, &errors[b]);
    for (int b = 0; b < COUNT; b += 2) bw_predict_tally_remove(&tally, &errors[b]);
    for (int b = COUNT - 1; b > 0; b -= 2) bw_predict_tally_add(&other, &errors[b]);
    assert_true(bw_predict_tally_cost(&other) > 0);
    assert_int_equal(bw_predict_tally_cost(&tally), bw_predict_tally_cost(&other));
    for (int b = 1; b < COUNT; b += 2) bw_predict_tally_remove(&tally, &errors[b]);
    assert_int_equal(bw_predict_tally_cost(&tally), 0);
    assert_int_equal(tally.coordinates, 0);
    for (int b = 0; b < COUNT; b++) bw_predict_errors_clear(&ctx, &errors[b]);
    bw_predict_tally_clear(&ctx, &tally), bw_predict_tally_clear(&ctx, &other);
    assert_int_equal(ctx.memory.used, 0);
}

static void cubes_have_the_ratio_1(void **state) {
    (void)state;
    double position[ROW_POINTS][3];
    bw_hvertex vertex[ROW_POINTS];
    make_row(position, vertex);
    assert_true(bw_cube_ratio(row_size) == 3);
    assert_true(bw_cube_ratio_of_lengths((const double(*)[3])position, row_size, vertex) == 1);
    for (int p = 0; p < ROW_POINTS; p++) position[p][1] *= 2;
    assert_true(bw_cube_ratio_of_lengths((const double(*)[3])position, row_size, vertex) == 2);
    for (int p = 0; p < ROW_POINTS; p++) position[p][2] = 0;
    assert_true(isinf(bw_cube_ratio_of_lengths((const double(*)[3])position, row_size, vertex)));
}

static void a_mesh_is_the_sum_of_its_blocks(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    bool known;
    bw_predict_report report;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    kit_expect_ok(&ctx, bw_predict_mesh(&ctx, &mesh, BW_PREDICT_BITS, &known, &report));
    assert_true(known);
    assert_int_equal(report.blocks, 3);
    assert_int_equal(report.vertices, mesh.vertex_count);
    assert_true(report.vertices_coded > report.vertices); /* those of walls more than once */
    assert_true(report.e_g_pooled > 0 && report.e_g_blocks > 0 && report.e_g_blocks < 2 * report.e_g_pooled);
    assert_true(report.cube_ratio >= 3 && report.cube_ratio_lengths >= 3);
    for (size_t h = 0; h < mesh.hex_count; h++) mesh.block[h] = BW_NONE;
    kit_expect_ok(&ctx, bw_predict_mesh(&ctx, &mesh, BW_PREDICT_BITS, &known, &report));
    assert_false(known);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static bw_status predict_again(bw_context *ctx, void *user) {
    bool known;
    bw_predict_report report;
    return bw_predict_mesh(ctx, user, BW_PREDICT_BITS, &known, &report);
}

static bw_status write_again(bw_context *ctx, void *user) {
    return bw_bwh_write(ctx, user, 12, kit_temp_path("memory.bwh"), NULL);
}

static void nothing_leaks_where_memory_runs_out(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    kit_fail_each_allocation(predict_again, &mesh);
    kit_fail_each_allocation(write_again, &mesh);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_is_trilinear_costs_nothing), cmocka_unit_test(errors_cost_their_entropies),       cmocka_unit_test(what_is_foreseen_is_rounded_last),
    cmocka_unit_test(coordinates_of_any_size_stay_on_the_lattice),
    cmocka_unit_test(tallies_forget_what_is_taken_away), cmocka_unit_test(cubes_have_the_ratio_1), cmocka_unit_test(a_mesh_is_the_sum_of_its_blocks),
    cmocka_unit_test(nothing_leaks_where_memory_runs_out),
};
KIT_MAIN(tests)
