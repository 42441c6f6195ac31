/* The block-wise map is a bijection of every block for any positive lengths, affine where there are no T-nodes, and the same on both sides of a wall. */
#include "core/igm_kit.h"
#include "igm/blockwise.h"

/* Any positive lengths that keep patches rectangles: random values of the free integers' classes, through the quantizer at random sizes. */
static const double scales[] = {0, 0.7, 3};

static double distance(const double a[3], const double b[3]) { return fabs(a[0] - b[0]) + fabs(a[1] - b[1]) + fabs(a[2] - b[2]); }

static void carry(const bw_transition *t, const double x[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = bw_rotation_sign[t->rotation][i] * x[bw_rotation_axis[t->rotation][i]] + (double)t->shift[i];
}

/* Points on a wall come out of both its blocks at the same place. */
static void check_walls(const quantizable *q, const bw_blockwise *map, kit_random *random) {
    const bw_complex *x = &q->complex;
    for (size_t p = 0; p < x->patch_count; p++) {
        const bw_patch_point *far = &map->rim[map->rim_begin[p]];
        for (size_t i = map->rim_begin[p]; i < map->rim_begin[p + 1]; i++)
            if (map->rim[i].real[0] + map->rim[i].real[1] > far->real[0] + far->real[1]) far = &map->rim[i];
        double size = (double)(far->real[0] + far->real[1]);
        for (int n = 0; n < 4; n++) {
            double uv[3] = {kit_random_unit(random) * (double)far->image[0] / 65536, kit_random_unit(random) * (double)far->image[1] / 65536, 0};
            double flat[3] = {0}, at[3], from_block[3], from_patch[3];
            bw_blockwise_back_on_patch(map, (bw_patch)p, uv, flat);
            for (int slot = 0; slot < 2 && x->patch_block[p][slot] != BW_NONE; slot++) {
                carry(&map->image[p][slot], uv, at);
                bw_blockwise_back(map, x->patch_block[p][slot], at, from_block);
                carry(&map->real[p][slot], flat, from_patch);
                if (distance(from_block, from_patch) > 1e-9 * size) fail_msg("%s: patch %zu is torn", q->name, p);
            }
        }
    }
}

static bool is_plain(const bw_complex *x, size_t block) {
    for (int s = 0; s < 6; s++) {
        size_t begin = x->block_side_begin[6 * block + (size_t)s];
        if (x->block_side_begin[6 * block + (size_t)s + 1] != begin + 1) return false;
        bw_patch p = x->block_side[begin];
        if (x->patch_chain_begin[4 * p + 4] != x->patch_chain_begin[4 * p] + 4) return false;
    }
    return true;
}

/* A block without T-nodes is only scaled along its axes. */
static size_t check_plain_blocks(const quantizable *q, const bw_atlas *atlas, const bw_blockwise *map, kit_random *random) {
    size_t plain = 0;
    for (size_t b = 0; b < q->complex.block_count; b++) {
        if (!is_plain(&q->complex, b)) continue;
        double image[3], at[3], expected[3], size = 0;
        for (int k = 0; k < 3; k++) {
            double s = kit_random_unit(random);
            image[k] = s * (double)atlas->extent[b][k], expected[k] = s * (double)q->complex.block_extent[b][k];
            size += (double)q->complex.block_extent[b][k];
        }
        bw_blockwise_back(map, (bw_block)b, image, at);
        assert_true(distance(at, expected) < 1e-9 * size);
        plain++;
    }
    return plain;
}

static size_t plain_blocks;

static void check(quantizable *q) {
    kit_random random = kit_random_start(7);
    for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
        bw_atlas atlas;
        bw_blockwise map;
        igm_quantize(q, BW_QUANTIZE_POSITIVE, scales[i]);
        kit_expect_ok(&q->ctx, bw_atlas_init(&q->ctx, &q->cells, &q->complex, q->length, &atlas));
        kit_expect_ok(&q->ctx, bw_blockwise_init(&q->ctx, &atlas, &map));
        kit_expect_ok(&q->ctx, bw_blockwise_check(&q->ctx, &map));
        check_walls(q, &map, &random);
        plain_blocks += check_plain_blocks(q, &atlas, &map, &random);
        bw_blockwise_clear(&q->ctx, &map);
        bw_atlas_clear(&q->ctx, &atlas);
    }
}

static void sample_models_have_block_wise_maps(void **state) {
    (void)state;
    igm_each_sample(check);
    assert_true(plain_blocks > 0);
}

static void flat_manifolds_have_block_wise_maps(void **state) {
    (void)state;
    igm_each_flat_manifold(check);
}

static void damage_is_found(void **state) {
    (void)state;
    quantizable q;
    igm_open_part(&q);
    bw_atlas atlas;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
    for (int damage = 0; damage < 5; damage++) {
        bw_blockwise map;
        kit_expect_ok(&q.ctx, bw_blockwise_init(&q.ctx, &atlas, &map));
        size_t last = map.rim_begin[q.complex.patch_count] - 1;
        if (damage == 0) map.block_centre[0].image[1] = 0;
        if (damage == 1) map.patch_centre[0].real[0] = 0;
        if (damage == 2) map.rim[last].image[0]++;
        if (damage == 3) map.image[0][0].shift[0]++;
        if (damage == 4) map.rim[1].real[0] = -map.rim[1].real[0];
        kit_expect_status(&q.ctx, bw_blockwise_check(&q.ctx, &map), BW_E_CHECK);
        q.ctx.error.status = BW_OK;
        bw_blockwise_clear(&q.ctx, &map);
    }
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

static void lengths_that_are_not_positive_are_refused(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    bw_atlas atlas;
    bw_blockwise map;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas)); /* all lengths are 0 */
    kit_expect_status(&q.ctx, bw_blockwise_init(&q.ctx, &atlas, &map), BW_E_USAGE);
    q.ctx.error.status = BW_OK;
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sample_models_have_block_wise_maps),
    cmocka_unit_test(flat_manifolds_have_block_wise_maps),
    cmocka_unit_test(damage_is_found),
    cmocka_unit_test(lengths_that_are_not_positive_are_refused),
};
KIT_MAIN(tests)
