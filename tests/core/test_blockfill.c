/* Hex meshes straight from blocks: as many hexes as promised, valid by the validator, and for shared models by an independent program too. */
#include "core/igm_kit.h"

#include <stdio.h>
#include <time.h>

#include "format/hex_write.h"
#include "hex/blockfill.h"
#include "hex/quality.h"

typedef struct {
    bw_atlas atlas;
    bw_blockwise map;
    bw_hex_mesh mesh;
} filled;

static void fill(quantizable *q, int32_t subdivide, filled *f) {
    kit_expect_ok(&q->ctx, bw_atlas_init(&q->ctx, &q->cells, &q->complex, q->length, &f->atlas));
    kit_expect_ok(&q->ctx, bw_blockwise_init(&q->ctx, &f->atlas, &f->map));
    kit_expect_ok(&q->ctx, bw_blockfill(&q->ctx, &f->map, subdivide, &f->mesh));
}

static void empty(quantizable *q, filled *f) {
    bw_hex_mesh_clear(&q->ctx, &f->mesh);
    bw_blockwise_clear(&q->ctx, &f->map);
    bw_atlas_clear(&q->ctx, &f->atlas);
}

/* Number of hexes of each block. */
static void check_promise(const quantizable *q, const filled *f, int32_t subdivide) {
    size_t *count = calloc(q->complex.block_count, sizeof *count);
    assert_non_null(count);
    for (size_t h = 0; h < f->mesh.hex_count; h++) count[f->mesh.block[h]]++;
    for (size_t b = 0; b < q->complex.block_count; b++) {
        size_t promised = 1;
        for (int k = 0; k < 3; k++) promised *= (size_t)(f->atlas.extent[b][k] * subdivide);
        assert_int_equal(count[b], promised);
    }
    free(count);
}

/* What is held is on its carrier: a position on the plane, line or point to rounding. */
static void check_carriers(const quantizable *q, const bw_hex_mesh *m) {
    const bw_tet_mesh *mesh = &q->mesh;
    for (size_t v = 0; v < m->vertex_count; v++) {
        const double *x = m->position[v];
        const bw_vertex point = m->carrier[v], *corner = &point;
        int n = m->held[v] == BW_HELD_POINT ? 1 : m->held[v] == BW_HELD_CURVE ? 2 : m->held[v] == BW_HELD_SURFACE ? 3 : 4;
        if (n > 1) corner = n == 2 ? mesh->edge[m->carrier[v]] : n == 3 ? mesh->facet[m->carrier[v]] : mesh->tet[m->carrier[v]];
        double d[3][3] = {{0}}, at[3], size = 0, off = 0;
        for (int k = 0; k < 3; k++) {
            at[k] = x[k] - mesh->position[corner[0]][k];
            for (int i = 1; i < n; i++) d[i - 1][k] = mesh->position[corner[i]][k] - mesh->position[corner[0]][k], size = fmax(size, fabs(d[i - 1][k]));
            size = fmax(size, fabs(x[k]) * 1e-3);
        }
        if (n == 4) continue; /* in it or not, it is free */
        for (int i = 0; i + 1 < n; i++) { /* Gram-Schmidt: what is left of `at` is off the carrier */
            for (int j = 0; j < i; j++) {
                double s = d[i][0] * d[j][0] + d[i][1] * d[j][1] + d[i][2] * d[j][2];
                for (int k = 0; k < 3; k++) d[i][k] -= s * d[j][k];
            }
            double length = sqrt(d[i][0] * d[i][0] + d[i][1] * d[i][1] + d[i][2] * d[i][2]), s = 0;
            for (int k = 0; k < 3; k++) d[i][k] /= length, s += d[i][k] * at[k];
            for (int k = 0; k < 3; k++) at[k] -= s * d[i][k];
        }
        for (int k = 0; k < 3; k++) off = fmax(off, fabs(at[k]));
        if (off > 1e-9 * size) fail_msg("%s: vertex %zu is off what holds it (%d) by %g", q->name, v, m->held[v], off / size);
    }
}

static void expect_valid(quantizable *q, const bw_hex_mesh *mesh, double scale) {
    if (bw_hex_mesh_check(&q->ctx, mesh) != BW_OK)
        fail_msg("%s scale %g, %zu hexes: %s", q->name, scale, mesh->hex_count, q->ctx.error.message);
}

static void check(quantizable *q, double scale, int32_t subdivide) {
    filled f;
    igm_quantize(q, BW_QUANTIZE_POSITIVE, scale);
    fill(q, subdivide, &f);
    check_promise(q, &f, subdivide);
    expect_valid(q, &f.mesh, scale);
    check_carriers(q, &f.mesh);
    empty(q, &f);
}

static void check_sizes(quantizable *q) {
    check(q, 3, 1);
    check(q, 1, 3);
}

static void sample_models_are_filled(void **state) {
    (void)state;
    igm_each_sample(check_sizes);
}

static void flat_manifolds_are_filled(void **state) {
    (void)state;
    igm_each_flat_manifold(check_sizes);
}

static void the_mesh_does_not_depend_on_threads(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.noise = 0.5, options.size = 3;
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 8);
    filled one, many;
    fill(&q, 2, &one);
    q.ctx.threads = 3;
    fill(&q, 2, &many);
    q.ctx.threads = 1;
    assert_true(one.mesh.vertex_count > 1000);
    assert_int_equal(one.mesh.vertex_count, many.mesh.vertex_count);
    assert_int_equal(one.mesh.hex_count, many.mesh.hex_count);
    assert_memory_equal(one.mesh.position, many.mesh.position, one.mesh.vertex_count * sizeof *one.mesh.position);
    assert_memory_equal(one.mesh.carrier, many.mesh.carrier, one.mesh.vertex_count * sizeof *one.mesh.carrier);
    assert_memory_equal(one.mesh.hex, many.mesh.hex, one.mesh.hex_count * sizeof *one.mesh.hex);
    assert_memory_equal(one.mesh.ijk, many.mesh.ijk, one.mesh.hex_count * sizeof *one.mesh.ijk);
    empty(&q, &one), empty(&q, &many);
    quantizable_close(&q);
}

static bw_status fill_again(bw_context *ctx, void *user) {
    const bw_blockwise *map = user;
    bw_hex_mesh mesh;
    bw_status status = bw_blockfill(ctx, map, 2, &mesh);
    bw_hex_mesh_clear(ctx, &mesh);
    return status;
}

/* A ring of one hex is one that vertices cannot tell, a ring of three is not. */
static void rings_are_simple_from_three_hexes_on(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++)
        for (int32_t subdivide = 1; subdivide <= 3; subdivide += 2) {
            quantizable q;
            filled f;
            quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
            igm_quantize(&q, BW_QUANTIZE_POSITIVE, 0);
            fill(&q, subdivide, &f);
            kit_expect_status(&q.ctx, bw_hex_mesh_check(&q.ctx, &f.mesh), subdivide == 1 ? BW_E_CHECK : BW_OK);
            q.ctx.error = (bw_error){.status = BW_OK};
            empty(&q, &f);
            quantizable_close(&q);
        }
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1;
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 0);
    filled f;
    fill(&q, 1, &f);
    kit_fail_each_allocation(fill_again, &f.map);
    empty(&q, &f);
    quantizable_close(&q);
}

static void too_many_hexes_are_a_limit(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    igm_quantize(&q, BW_QUANTIZE_POSITIVE, 0);
    filled f;
    fill(&q, 1, &f);
    bw_hex_mesh other;
    kit_expect_status(&q.ctx, bw_blockfill(&q.ctx, &f.map, 2000, &other), BW_E_LIMIT);
    q.ctx.error.status = BW_OK;
    empty(&q, &f);
    quantizable_close(&q);
}

/* The independent program takes a second per 8 000 hexes, and 10 kB for each. */
static void check_independently(quantizable *q, const bw_hex_mesh *mesh, const char *checker, const char *input) {
    bw_hex_skin skin;
    const char *path = kit_temp_path("hexes.mesh");
    kit_expect_ok(&q->ctx, bw_hex_skin_init(&q->ctx, mesh, &skin));
    kit_expect_ok(&q->ctx, bw_hex_write_medit(&q->ctx, mesh, &skin, path, NULL));
    kit_result r = kit_run((const char *[]){"python3", checker, path, "--like", input, NULL});
    if (r.exit != 0) fail_msg("%s, %zu hexes: %s%s", q->name, mesh->hex_count, r.out, r.err);
    kit_result_clear(&r);
    bw_hex_skin_clear(&q->ctx, &skin);
}

/* Where a ring of blocks is one or two hexes around, two faces may have the same four corners: the complex is one of hexes all the same, but vertices alone
 * cannot tell. Three hexes for each are always enough: then an edge has a point of its own. */
static int32_t fill_simply(quantizable *q, filled *f) {
    for (int32_t subdivide = 1; subdivide < 3; subdivide++) {
        fill(q, subdivide, f);
        if (bw_hex_mesh_check(&q->ctx, &f->mesh) == BW_OK) return subdivide;
        printf("%s, %zu hexes: %s\n", q->name, f->mesh.hex_count, q->ctx.error.message);
        q->ctx.error = (bw_error){.status = BW_OK};
        empty(q, f);
    }
    fill(q, 3, f);
    expect_valid(q, &f->mesh, NAN);
    return 3;
}

/* BW_HEXES sets the size up to which meshes are checked independently; ten times that size is the largest that is made. */
static void shared_models_pass_an_independent_check(void **state) {
    (void)state;
    static const double scales[] = {0, 0.5, 1, 2};
    const char *folder = kit_shared("data/tet"), *checker = kit_shared("tools/check_hexmesh.py"), *most = getenv("BW_HEXES");
    size_t count, largest = most ? strtoul(most, NULL, 10) : 2000;
    char **names = kit_names(folder, ".hexex", &count), input[600];
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_FULL);
        snprintf(input, sizeof input, "%s/%s", folder, names[i]);
        for (size_t s = 0; s < sizeof scales / sizeof *scales; s++) {
            filled f;
            bw_hex_quality quality;
            igm_quantize(&q, BW_QUANTIZE_POSITIVE, scales[s]);
            if (igm_hexes(&q) > 10 * largest) continue;
            struct timespec since, now;
            clock_gettime(CLOCK_MONOTONIC, &since);
            int32_t subdivide = fill_simply(&q, &f);
            clock_gettime(CLOCK_MONOTONIC, &now);
            check_promise(&q, &f, subdivide);
            check_carriers(&q, &f.mesh);
            kit_expect_ok(&q.ctx, bw_hex_measure(&q.ctx, &f.mesh, &quality));
            if (f.mesh.hex_count <= largest) check_independently(&q, &f.mesh, checker, input);
            printf("%-34s scale %-3g hexes %7zu %6.3f s, scaled Jacobian > 0: %5.1f %%, least %6.3f%s\n", names[i], scales[s], f.mesh.hex_count,
                   (double)(now.tv_sec - since.tv_sec) + 1e-9 * (double)(now.tv_nsec - since.tv_nsec),
                   100 - 100 * (double)quality.nonpositive / (double)quality.hexes, quality.scaled_jacobian.min,
                   f.mesh.hex_count <= largest ? ", checked" : "");
            empty(&q, &f);
        }
        quantizable_close(&q);
    }
    kit_names_free(names, count);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sample_models_are_filled),
    cmocka_unit_test(flat_manifolds_are_filled),
    cmocka_unit_test(the_mesh_does_not_depend_on_threads),
    cmocka_unit_test(rings_are_simple_from_three_hexes_on),
    cmocka_unit_test(each_allocation_may_fail),
    cmocka_unit_test(too_many_hexes_are_a_limit),
    cmocka_unit_test(shared_models_pass_an_independent_check),
};
KIT_MAIN(tests)
