/* T-meshes: cells fill their blocks, tubes around extraordinary arcs are regular, whatever complex they are made from; and the check notices every damage. */
#include "core/reduce_kit.h"

#include <math.h>
#include <string.h>

#include "stage/quantize.h"
#include "tspline/parts.h"

typedef struct {
    reducible r;
    bw_complex complex;
    bw_atlas atlas;
    bw_tmesh mesh;
    int64_t *length;
} sample;

/* factor: of all lengths. */
static void open_sample(sample *s, const char *model, int size, bw_complex_kind kind, bw_reduce_mode mode, int64_t factor) {
    bw_model_options options = reduce_options_of(size, 1);
    bw_reduce_options how = {mode, false, 1};
    bw_reduce_report report;
    size_t tori;
    memset(s, 0, sizeof *s);
    reducible_open(&s->r, model, &options, kind, false);
    if (mode == BW_REDUCE_NONE) kit_expect_ok(&s->r.ctx, reducible_read(&s->r.ctx, &s->r, &s->complex, &tori));
    else kit_expect_ok(&s->r.ctx, reducible_reduce(&s->r.ctx, &s->r, &how, &s->complex, &report));
    s->length = calloc(s->complex.arc_count, sizeof *s->length);
    for (size_t a = 0; a < s->complex.arc_count; a++) s->length[a] = factor * s->complex.arc_length[a];
    kit_expect_ok(&s->r.ctx, bw_atlas_init(&s->r.ctx, &s->r.cells, &s->complex, factor == 1 ? s->complex.arc_length : s->length, &s->atlas));
    kit_expect_ok(&s->r.ctx, bw_tmesh_init(&s->r.ctx, &s->atlas, &s->mesh));
}

static void close_sample(sample *s) {
    bw_tmesh_clear(&s->r.ctx, &s->mesh);
    bw_atlas_clear(&s->r.ctx, &s->atlas);
    bw_complex_clear(&s->r.ctx, &s->complex);
    free(s->length);
    reducible_close(&s->r);
}

static const struct {
    bw_complex_kind kind;
    bw_reduce_mode mode;
} variants[] = {{BW_COMPLEX_MC, BW_REDUCE_NONE}, {BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR}, {BW_COMPLEX_MC, BW_REDUCE_FULL}, {BW_COMPLEX_BC, BW_REDUCE_NONE},
                {BW_COMPLEX_SERIAL, BW_REDUCE_NONE}};
enum { VARIANTS = sizeof variants / sizeof *variants };

static const char *const models[] = {"cuboid", "l-shape", "plus", "cylinder", "ball", "torus", "torus-quarter", "torus-half", "hollow-torus", "tee", "plate"};
enum { MODELS = sizeof models / sizeof *models };

/* ---- what every T-mesh is ------------------------------------------------------------------------------------------ */

static void every_variant_of_every_model_has_a_valid_t_mesh(void **state) {
    (void)state;
    for (int m = 0; m < MODELS; m++)
        for (int v = 0; v < VARIANTS; v++) {
            sample s;
            open_sample(&s, models[m], 1, variants[v].kind, variants[v].mode, 1);
            bw_status status = bw_tmesh_check(&s.r.ctx, &s.mesh);
            if (status != BW_OK) fail_msg("%s, variant %d: %s", models[m], v, s.r.ctx.error.message);
            close_sample(&s);
        }
}

static void volumes_of_cells_add_up_to_that_of_the_map(void **state) {
    (void)state;
    for (int v = 0; v < VARIANTS; v++) {
        sample s;
        mpz_t blocks, cells, cell;
        mpz_inits(blocks, cells, cell, NULL);
        open_sample(&s, "tee", 1, variants[v].kind, variants[v].mode, 1);
        complex_volume(&s.complex, blocks);
        mpz_mul_ui(blocks, blocks, BW_TMESH_UNIT * BW_TMESH_UNIT * BW_TMESH_UNIT);
        for (size_t c = 0; c < s.mesh.cell_count; c++) {
            mpz_set_ui(cell, 1);
            for (int k = 0; k < 3; k++) mpz_mul_si(cell, cell, (long)(s.mesh.cell[c].high[k] - s.mesh.cell[c].low[k]));
            mpz_add(cells, cells, cell);
        }
        assert_int_equal(mpz_cmp(cells, blocks), 0);
        mpz_clears(blocks, cells, cell, NULL);
        close_sample(&s);
    }
}

/* Vertices on an arc: one for each node and cut, in order, on it; those at its ends are where the nodes are. */
static void expect_vertices_on_arcs(sample *s) {
    double(*position)[3] = calloc(s->mesh.vertex_count, sizeof *position);
    kit_expect_ok(&s->r.ctx, bw_tmesh_positions(&s->r.ctx, &s->mesh, position));
    size_t arcs = 0;
    for (bw_arc a = 0; a < (bw_arc)s->complex.arc_count; a++) {
        size_t count;
        if (!bw_tmesh_is_extraordinary(&s->complex, a)) continue;
        const int32_t *vertex = bw_tmesh_along(&s->mesh, a, &count);
        for (int e = 0; e < 2; e++) {
            double node[3];
            bw_cells_position(&s->r.cells, s->complex.node_vertex[s->complex.arc_node[a][e]], node);
            for (int k = 0; k < 3; k++) assert_true(fabs(position[vertex[e ? count - 1 : 0]][k] - node[k]) < 1e-6);
        }
        for (size_t i = 0; i < count; i++) assert_true(s->mesh.vertex_flags[vertex[i]] & BW_TVERTEX_EXTRAORDINARY);
        arcs++;
    }
    assert_true(arcs > 0);
    free(position);
}

static void vertices_along_arcs_are_where_the_arcs_are(void **state) {
    (void)state;
    sample s;
    open_sample(&s, "plate", 1, BW_COMPLEX_MC, BW_REDUCE_FULL, 1);
    expect_vertices_on_arcs(&s);
    close_sample(&s);
}

static void knots_may_be_quarters_of_hexes(void **state) {
    (void)state;
    sample s;
    int64_t *length;
    bw_report *report = calloc(1, sizeof *report);
    open_sample(&s, "plate", 1, BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR, 1);
    bw_tmesh_clear(&s.r.ctx, &s.mesh), bw_atlas_clear(&s.r.ctx, &s.atlas);
    bw_quantize_options coarsest = {.range = BW_QUANTIZE_POSITIVE, .scale = 0, .seconds = 10};
    kit_expect_ok(&s.r.ctx, bw_quantize(&s.r.ctx, &s.r.cells, &s.complex, &coarsest, &length, report));
    kit_expect_ok(&s.r.ctx, bw_atlas_init(&s.r.ctx, &s.r.cells, &s.complex, length, &s.atlas));
    kit_expect_ok(&s.r.ctx, bw_tmesh_init(&s.r.ctx, &s.atlas, &s.mesh));
    kit_expect_ok(&s.r.ctx, bw_tmesh_check(&s.r.ctx, &s.mesh));
    expect_vertices_on_arcs(&s);
    size_t volume = 0;
    for (size_t c = 0; c < s.mesh.cell_count; c++) {
        const bw_tcell *cell = &s.mesh.cell[c];
        volume += (size_t)(cell->high[0] - cell->low[0]) * (size_t)(cell->high[1] - cell->low[1]) * (size_t)(cell->high[2] - cell->low[2]);
    }
    assert_int_equal(volume, 64 * report->quantization.hexes);
    bw_free(&s.r.ctx, length), free(report);
    close_sample(&s);
}

/* ---- how many cells ------------------------------------------------------------------------------------------------ */

/* l-shape: in each of three blocks a tube and two boxes. Two blocks, one of them with the edge inside a side: there two cells of the tube, two beside, one behind. cylinder: the core
 * has four tubes and three boxes, each of the others two tubes, one box between and one behind them. */
static void cells_are_as_many_as_drawn_by_hand(void **state) {
    (void)state;
    static const struct {
        const char *model;
        int variant;
        size_t blocks, cells;
    } known[] = {{"cuboid", 0, 1, 1}, {"l-shape", 3, 3, 9}, {"l-shape", 2, 2, 8}, {"cylinder", 3, 5, 23}, {"torus", 0, 1, 1}};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        sample s;
        open_sample(&s, known[i].model, 1, variants[known[i].variant].kind, variants[known[i].variant].mode, 1);
        print_message("%s: %zu blocks, %zu cells\n", known[i].model, s.complex.block_count, s.mesh.cell_count);
        assert_int_equal(s.complex.block_count, known[i].blocks);
        assert_int_equal(s.mesh.cell_count, known[i].cells);
        close_sample(&s);
    }
}

/* MC 7.2: the base complex needs more of them. */
static void the_base_complex_gets_at_least_as_many_cells_added(void **state) {
    (void)state;
    for (int m = 0; m < MODELS; m++) {
        size_t added[2];
        for (int bc = 0; bc < 2; bc++) {
            sample s;
            open_sample(&s, models[m], 1, variants[bc ? 3 : 1].kind, variants[bc ? 3 : 1].mode, 1);
            added[bc] = s.mesh.cell_count - s.complex.block_count;
            close_sample(&s);
        }
        print_message("%s: %zu added, %zu to the base complex\n", models[m], added[0], added[1]);
        assert_true(added[0] <= added[1]);
    }
}

static void longer_arcs_change_the_knots_and_nothing_else(void **state) {
    (void)state;
    sample one, three;
    open_sample(&one, "tee", 1, BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR, 1);
    open_sample(&three, "tee", 1, BW_COMPLEX_MC, BW_REDUCE_KEEP_SINGULAR, 3);
    kit_expect_ok(&three.r.ctx, bw_tmesh_check(&three.r.ctx, &three.mesh));
    assert_int_equal(one.mesh.cell_count, three.mesh.cell_count);
    assert_int_equal(one.mesh.vertex_count, three.mesh.vertex_count);
    assert_int_equal(one.mesh.joint_count, three.mesh.joint_count);
    for (size_t c = 0; c < one.mesh.cell_count; c++)
        for (int k = 0; k < 3; k++) {
            assert_int_equal(3 * one.mesh.cell[c].low[k], three.mesh.cell[c].low[k]);
            assert_int_equal(3 * one.mesh.cell[c].high[k], three.mesh.cell[c].high[k]);
        }
    close_sample(&one), close_sample(&three);
}

static void lengths_that_are_not_positive_are_refused(void **state) {
    (void)state;
    sample s;
    open_sample(&s, "cuboid", 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 2);
    bw_tmesh_clear(&s.r.ctx, &s.mesh);
    s.length[3] = 0;
    kit_expect_status(&s.r.ctx, bw_tmesh_init(&s.r.ctx, &s.atlas, &s.mesh), BW_E_USAGE);
    s.r.ctx.error.status = BW_OK;
    close_sample(&s);
}

/* ---- damage -------------------------------------------------------------------------------------------------------- */

/* The first cell at an extraordinary arc, and the axis of that. */
static size_t tube_cell(const sample *s, int *axis) {
    for (size_t c = 0; c < s->mesh.cell_count; c++) {
        const int32_t *v = s->mesh.cell[c].corner;
        for (*axis = 0; *axis < 3; ++*axis)
            for (int i = 0; i < 8; i++)
                if (!(i >> *axis & 1) && s->mesh.vertex_flags[v[i]] & s->mesh.vertex_flags[v[i | 1 << *axis]] & BW_TVERTEX_EXTRAORDINARY) return c;
    }
    fail_msg("no cell is at an extraordinary arc");
    return 0;
}

/* Makes everything anew that follows from the cells, so that only the rule on these is broken. */
static void derive(sample *s) {
    bw_tmesh *m = &s->mesh;
    void *blocks[] = {m->face, m->joint, m->point, m->vertex_place, m->vertex_flags, m->arc_vertex};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(&s->r.ctx, blocks[i]);
    m->face = NULL, m->joint = NULL, m->point = NULL, m->vertex_place = NULL, m->vertex_flags = NULL, m->arc_vertex = NULL;
    m->face_count = m->joint_count = m->point_count = m->vertex_count = 0;
    kit_expect_ok(&s->r.ctx, bw_tmesh_number(&s->r.ctx, m));
    kit_expect_ok(&s->r.ctx, bw_tmesh_join(&s->r.ctx, m));
}

static void cut_cell(sample *s, size_t c, int axis) {
    bw_tmesh *m = &s->mesh;
    m->cell = bw_resize(&s->r.ctx, m->cell, m->cell_count + 1, sizeof *m->cell);
    memmove(&m->cell[c + 1], &m->cell[c], (m->cell_count - c) * sizeof *m->cell);
    m->cell_count++;
    m->cell[c].high[axis] = m->cell[c + 1].low[axis] = (m->cell[c].low[axis] + m->cell[c].high[axis]) / 2;
    for (size_t b = (size_t)m->cell[c].block; b < s->complex.block_count; b++) m->cell_begin[b + 1]++;
    derive(s);
}

static const char *damage(sample *s, int kind) {
    bw_tmesh *m = &s->mesh;
    int axis;
    size_t c = tube_cell(s, &axis), f = 0;
    while (m->face[f].cell[1] == BW_NONE || m->face[f].patch == BW_NONE) f++;
    switch (kind) {
    case 0: m->cell[c].high[axis]--; return "its cells do not fill it";
    case 1: m->cell[c].low[axis] = m->cell[c].high[axis]; return "an extent is not positive";
    case 2: m->cell[c] = m->cell[c + 1]; return "it overlaps another one";
    case 3: m->cell[c].low[axis] = -1; return "it leaves its block";
    case 4: m->cell[c].block = s->complex.block_count > 1 && !m->cell[c].block; return "it is listed with another block";
    case 5: m->face_count--; return "a side is not covered by faces";
    case 6: m->face = bw_resize(&s->r.ctx, m->face, m->face_count + 1, sizeof *m->face); m->face[m->face_count++] = m->face[f]; return "faces of one side overlap";
    case 7: m->face[f].side[0] ^= 1; return "it is not on the side of its cell";
    case 8: m->face[f].patch = BW_NONE; return "it is in no patch";
    case 9: m->cell[c].corner[0] = m->cell[c].corner[7]; return "different vertices at one point";
    case 10: m->joint[0].inside = 7; return "it is not on its cell";
    case 11: cut_cell(s, c, axis); return "there is not one cell per quarter turn";
    case 12: cut_cell(s, c, (axis + 1) % 3); return "share less than a whole side";
    default: return NULL;
    }
}

static void the_check_notices_what_is_wrong(void **state) {
    (void)state;
    const char *expected = "";
    for (int kind = 0; expected; kind++) {
        sample s;
        open_sample(&s, "cylinder", 1, BW_COMPLEX_BC, BW_REDUCE_NONE, 1);
        kit_expect_ok(&s.r.ctx, bw_tmesh_check(&s.r.ctx, &s.mesh));
        expected = damage(&s, kind);
        if (expected) {
            kit_expect_status(&s.r.ctx, bw_tmesh_check(&s.r.ctx, &s.mesh), BW_E_CHECK);
            if (!strstr(s.r.ctx.error.message, expected)) fail_msg("damage %d: \"%s\", not \"%s\"", kind, s.r.ctx.error.message, expected);
            s.r.ctx.error.status = BW_OK;
        }
        close_sample(&s);
    }
}

/* The complex itself, a cell for each block: tubes as thick as blocks. */
static void a_complex_that_is_not_refined_is_not_accepted(void **state) {
    (void)state;
    sample s;
    open_sample(&s, "cylinder", 1, BW_COMPLEX_BC, BW_REDUCE_NONE, 1);
    bw_tmesh *m = &s.mesh;
    for (size_t b = 0; b < s.complex.block_count; b++) {
        m->cell[b] = (bw_tcell){.block = (bw_block)b};
        for (int k = 0; k < 3; k++) m->cell[b].high[k] = BW_TMESH_UNIT * s.atlas.extent[b][k];
        m->cell_begin[b + 1] = b + 1;
    }
    m->cell_count = s.complex.block_count;
    derive(&s);
    kit_expect_status(&s.r.ctx, bw_tmesh_check(&s.r.ctx, m), BW_E_CHECK);
    assert_non_null(strstr(s.r.ctx.error.message, "thicker than half of its block"));
    s.r.ctx.error.status = BW_OK;
    close_sample(&s);
}

/* ---- memory -------------------------------------------------------------------------------------------------------- */

static bw_status make_and_check(bw_context *ctx, void *user) {
    sample *s = user;
    bw_tmesh mesh;
    bw_status status = bw_tmesh_init(ctx, &s->atlas, &mesh);
    if (status == BW_OK) status = bw_tmesh_check(ctx, &mesh);
    bw_tmesh_clear(ctx, &mesh);
    return status;
}

static void every_failing_allocation_is_reported_and_nothing_leaks(void **state) {
    (void)state;
    sample s;
    open_sample(&s, "cylinder", 1, BW_COMPLEX_MC, BW_REDUCE_FULL, 1);
    assert_true(kit_fail_each_allocation(make_and_check, &s) > 15);
    close_sample(&s);
}

static void each_step_and_the_check_can_be_cancelled(void **state) {
    (void)state;
    static bw_status (*const step[])(bw_context *ctx, bw_tmesh *mesh) = {bw_tmesh_cut, bw_tmesh_number, bw_tmesh_join};
    volatile sig_atomic_t cancel = 0;
    sample s;
    open_sample(&s, "cylinder", 1, BW_COMPLEX_MC, BW_REDUCE_FULL, 1);
    bw_context *ctx = &s.r.ctx;
    ctx->cancel = &cancel;
    for (size_t at = 0; at <= sizeof step / sizeof *step; at++) { /* the step at which it is asked for; the last is the check */
        bw_tmesh mesh = {.atlas = &s.atlas};
        cancel = 0;
        kit_expect_ok(ctx, bw_tmesh_find_thickness(ctx, &mesh));
        for (size_t i = 0; i < at; i++) kit_expect_ok(ctx, step[i](ctx, &mesh));
        cancel = 1;
        kit_expect_status(ctx, at < sizeof step / sizeof *step ? step[at](ctx, &mesh) : bw_tmesh_check(ctx, &mesh), BW_E_CANCELLED);
        bw_tmesh_clear(ctx, &mesh);
        ctx->error.status = BW_OK;
    }
    ctx->cancel = NULL;
    close_sample(&s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_variant_of_every_model_has_a_valid_t_mesh),
    cmocka_unit_test(volumes_of_cells_add_up_to_that_of_the_map),
    cmocka_unit_test(vertices_along_arcs_are_where_the_arcs_are),
    cmocka_unit_test(knots_may_be_quarters_of_hexes),
    cmocka_unit_test(cells_are_as_many_as_drawn_by_hand),
    cmocka_unit_test(the_base_complex_gets_at_least_as_many_cells_added),
    cmocka_unit_test(longer_arcs_change_the_knots_and_nothing_else),
    cmocka_unit_test(lengths_that_are_not_positive_are_refused),
    cmocka_unit_test(the_check_notices_what_is_wrong),
    cmocka_unit_test(a_complex_that_is_not_refined_is_not_accepted),
    cmocka_unit_test(every_failing_allocation_is_reported_and_nothing_leaks),
    cmocka_unit_test(each_step_and_the_check_can_be_cancelled),
};

KIT_MAIN(tests)
