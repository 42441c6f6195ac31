/* Labels: a mesh extracted from an integral map is the one that the lengths of its own arcs promise, and no other's. */
#include "core/validity_kit.h"
#include "hex/extract.h"
#include "hex/label.h"

typedef struct {
    quantizable q;
    bw_igm igm; /* borrows mesh and map of q */
    bw_hex_mesh mesh;
    bw_hex_origin origin;
} labelled;

static void open_model(labelled *x, const char *name, int size, int features, uint64_t seed, bw_complex_kind kind, bw_reduce_mode mode, int32_t subdivide) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    memset(x, 0, sizeof *x);
    options.size = size, options.noise = 0.6, options.seed = seed, options.features = features, options.integral = 1, options.scramble = (int)(seed % 4);
    quantizable_open(&x->q, name, &options, kind, mode);
    x->igm = (bw_igm){.mesh = x->q.mesh, .map = x->q.map};
    for (size_t a = 0; a < x->q.complex.arc_count; a++) {
        x->q.length[a] = x->q.complex.arc_length[a] >> x->q.map.exponent;
        assert_int_equal(x->q.length[a] << x->q.map.exponent, x->q.complex.arc_length[a]);
    }
    kit_expect_ok(&x->q.ctx, bw_hex_extract(&x->q.ctx, &x->igm, subdivide, 1000000, &x->mesh, &x->origin));
}

static void close_model(labelled *x) {
    bw_hex_mesh_clear(&x->q.ctx, &x->mesh);
    bw_hex_origin_clear(&x->q.ctx, &x->origin);
    quantizable_close(&x->q);
}

static bw_status label(labelled *x) {
    bw_hex_plan plan;
    bw_context *ctx = &x->q.ctx;
    bw_status status = bw_hex_plan_init(ctx, &x->q.cells, &x->q.complex, x->q.length, x->mesh.subdivide, &plan);
    if (status == BW_OK) status = bw_hex_label(ctx, &plan, &x->igm, &x->mesh);
    bw_hex_plan_clear(ctx, &plan);
    return status;
}

/* The map is the input's, so the block of a hex is that of the cell which its centre lies in. */
static void check_blocks(const labelled *x) {
    const bw_complex *c = &x->q.complex;
    int64_t unit = (int64_t)1 << x->q.map.exponent, n = x->mesh.subdivide;
    size_t compared = 0;
    for (size_t h = 0; h < x->mesh.hex_count; h++) {
        bw_tet t = x->origin.tet[h];
        if (bw_cells_is_open(&x->q.cells, t)) continue; /* cut: parts may be in several blocks */
        int64_t at[3];
        for (int k = 0; k < 3; k++) at[k] = (2 * x->origin.low[h][k] + 1) * unit; /* times 2 n */
        bw_transition chart = *bw_complex_chart(c, t);
        for (int k = 0; k < 3; k++) chart.shift[k] *= 2 * n;
        bw_transition_apply(&chart, at, at);
        if (x->mesh.block[h] != c->cell_block[t]) fail_msg("%s: hex %zu is in block %d, not %d", x->q.name, h, x->mesh.block[h], c->cell_block[t]);
        for (int k = 0; k < 3; k++) assert_int_equal(x->mesh.ijk[h][k], (at[k] / unit - 1) / 2);
        compared++;
    }
    if (x->mesh.hex_count > 100) assert_true(compared > 0);
}

static void every_hex_has_its_block_and_place(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int mode = 0; mode < 3; mode++) {
            labelled x;
            open_model(&x, models[i].name, 2, mode == 2, i + 1, mode == 0 ? BW_COMPLEX_BC : BW_COMPLEX_MC, (bw_reduce_mode)mode, 1 + mode);
            kit_expect_ok(&x.q.ctx, label(&x));
            kit_expect_ok(&x.q.ctx, bw_hex_mesh_check(&x.q.ctx, &x.mesh));
            if (!strstr(models[i].name, "torus")) check_blocks(&x); /* a ring without nodes may be turned */
            close_model(&x);
        }
}

static const double *place_of_node(const labelled *x, size_t node) {
    const bw_cell_vertex *at = &x->q.cells.vertex[x->q.complex.node_vertex[node]];
    assert_int_equal(at->kind, BW_IN_VERTEX);
    return x->q.mesh.position[at->carrier];
}

/* As where an input is slit open: the positions of nodes do not tell which hex vertex is which. */
static void many_hex_vertices_may_be_in_the_place_of_a_node(void **state) {
    (void)state;
    for (int more = 1; more < 10; more *= 3) { /* at each node */
        labelled x;
        size_t v = 0;
        open_model(&x, "cuboid", 3, 0, 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 2);
        size_t nodes = x.q.complex.node_count;
        for (size_t i = 0; i < (size_t)more * nodes; v++) {
            bool is_node = false;
            assert_true(v < x.mesh.vertex_count);
            for (size_t n = 0; n < nodes; n++) is_node |= !memcmp(x.mesh.position[v], place_of_node(&x, n), sizeof(double[3]));
            if (!is_node) memcpy(x.mesh.position[v], place_of_node(&x, i++ % nodes), sizeof(double[3]));
        }
        kit_expect_ok(&x.q.ctx, label(&x));
        kit_expect_ok(&x.q.ctx, bw_hex_mesh_check(&x.q.ctx, &x.mesh));
        close_model(&x);
    }
}

static void expect_refused(labelled *x, const char *words) {
    bw_status status = label(x);
    if (status != BW_E_CHECK || !strstr(x->q.ctx.error.message, words))
        fail_msg("\"%s\" expected, but it is %s: %s", words, bw_status_code(status), x->q.ctx.error.message);
    close_model(x);
}

static void another_number_of_hexes_is_refused(void **state) {
    (void)state;
    labelled x;
    open_model(&x, "cylinder", 2, 0, 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 1);
    for (size_t a = 0; a < x.q.complex.arc_count; a++) x.q.length[a] *= 2;
    expect_refused(&x, "promised");
}

/* As many hexes, in a box of the same shape, turned over: only nodes and regions tell. */
static void a_box_turned_over_is_refused(void **state) {
    (void)state;
    labelled x;
    open_model(&x, "cuboid", 2, 0, 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 1);
    int64_t extent[3];
    for (int k = 0; k < 3; k++) extent[k] = x.q.complex.block_extent[0][k] >> x.q.map.exponent;
    int i = extent[0] != extent[1] ? 0 : 1, j = i + 1;
    assert_int_not_equal(extent[i], extent[j]);
    for (size_t a = 0; a < x.q.complex.arc_count; a++)
        for (int e = 0; e < 12; e++)
            for (size_t k = x.q.complex.block_edge_begin[e]; k < x.q.complex.block_edge_begin[e + 1]; k++)
                if ((size_t)x.q.complex.block_edge[k] / 2 == a) x.q.length[a] = extent[e / 4 == i ? j : e / 4 == j ? i : e / 4];
    expect_refused(&x, "not the one");
}

static void a_hex_inside_out_is_refused(void **state) {
    (void)state;
    labelled x;
    open_model(&x, "l-shape", 2, 0, 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 1);
    for (int c = 0; c < 8; c += 2) {
        bw_hvertex swap = x.mesh.hex[1][c];
        x.mesh.hex[1][c] = x.mesh.hex[1][c + 1], x.mesh.hex[1][c + 1] = swap;
    }
    expect_refused(&x, "do not share a face");
}

static bw_status label_again(bw_context *ctx, void *user) {
    labelled *x = user;
    bw_hex_plan plan;
    bw_status status = bw_hex_plan_init(ctx, &x->q.cells, &x->q.complex, x->q.length, x->mesh.subdivide, &plan);
    if (status == BW_OK) status = bw_hex_label(ctx, &plan, &x->igm, &x->mesh);
    bw_hex_plan_clear(ctx, &plan);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    labelled x;
    open_model(&x, "ball", 1, 0, 1, BW_COMPLEX_MC, BW_REDUCE_NONE, 1);
    assert_true(kit_fail_each_allocation(label_again, &x) > 20);
    close_model(&x);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_hex_has_its_block_and_place),
        cmocka_unit_test(many_hex_vertices_may_be_in_the_place_of_a_node),
        cmocka_unit_test(another_number_of_hexes_is_refused),
        cmocka_unit_test(a_box_turned_over_is_refused),
        cmocka_unit_test(a_hex_inside_out_is_refused),
        cmocka_unit_test(each_allocation_may_fail),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
