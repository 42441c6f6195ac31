/* Integer charts of blocks agree across patches and around arcs, for positive, zero and negative lengths; damage is found. */
#include "core/igm_kit.h"

static void check(quantizable *q) {
    bw_atlas atlas;
    kit_expect_ok(&q->ctx, bw_atlas_init(&q->ctx, &q->cells, &q->complex, q->length, &atlas));
    kit_expect_ok(&q->ctx, bw_atlas_check(&q->ctx, &atlas));
    int64_t hexes = 0, promised = 0;
    for (size_t b = 0; b < q->complex.block_count; b++) {
        int64_t volume = 1;
        for (int axis = 0; axis < 3; axis++) volume *= atlas.extent[b][axis];
        hexes += volume;
    }
    bw_quant_model *m = &q->model;
    int64_t *value = calloc(m->class_count + 1, sizeof *value);
    assert_non_null(value);
    for (size_t a = 0; a < m->arc_count; a++) value[m->arc_class[a]] = q->length[a];
    promised = bw_quant_model_hexes(m, value);
    free(value);
    assert_int_equal(hexes, promised);
    bw_atlas_clear(&q->ctx, &atlas);
}

static void check_ranges(quantizable *q) {
    for (int range = BW_QUANTIZE_POSITIVE; range <= BW_QUANTIZE_ANY; range++) {
        igm_quantize(q, (bw_quantize_range)range, 0);
        check(q);
    }
    igm_quantize(q, BW_QUANTIZE_ANY, 1);
    check(q);
}

static void charts_of_sample_models_agree(void **state) {
    (void)state;
    igm_each_sample(check_ranges);
}

static void charts_of_flat_manifolds_agree(void **state) {
    (void)state;
    igm_each_flat_manifold(check_ranges);
}

static void charts_of_shared_models_agree(void **state) {
    (void)state;
    igm_each_file(kit_shared("data/tet"), check_ranges);
}

static void damage_is_found(void **state) {
    (void)state;
    quantizable q;
    igm_open_part(&q);
    size_t inside = 0;
    while (q.complex.patch_block[inside][1] == BW_NONE) inside++;
    for (int damage = 0; damage < 4; damage++) {
        bw_atlas atlas;
        kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
        if (damage == 0) atlas.integer[inside].shift[damage]++;
        if (damage == 1) atlas.place[0].at[2].q++;
        if (damage == 2) atlas.extent[1][1]++;
        if (damage == 3) atlas.integer[inside].rotation = (bw_rotation)(atlas.integer[inside].rotation ? 0 : 1);
        kit_expect_status(&q.ctx, bw_atlas_check(&q.ctx, &atlas), BW_E_CHECK);
        bw_atlas_clear(&q.ctx, &atlas);
        q.ctx.error.status = BW_OK;
    }
    q.length[0]++;
    bw_atlas atlas;
    kit_expect_status(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas), BW_E_CHECK);
    q.ctx.error.status = BW_OK;
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(charts_of_sample_models_agree),
    cmocka_unit_test(charts_of_flat_manifolds_agree),
    cmocka_unit_test(charts_of_shared_models_agree),
    cmocka_unit_test(damage_is_found),
};
KIT_MAIN(tests)
