/* All integers of a map are known before it is solved: any values of the unknowns keep to every transition and every alignment, for all ranges of lengths. */
#include "core/igm_kit.h"

/* Random unknowns must satisfy every seam: with small integers this is exact. */
static void try_values(quantizable *q, const bw_frame *frame, uint64_t stream) {
    kit_random random = kit_random_start(stream);
    int64_t *x = calloc(frame->variable_count + 1, sizeof *x);
    assert_non_null(x);
    for (size_t v = 0; v < frame->variable_count; v++) x[v] = (int64_t)kit_random_below(&random, 2001) - 1000;
    for (size_t t = 0; t < frame->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            const bw_frame_tet *a = &frame->tet[t], *b = a->next[i] == BW_NONE ? NULL : &frame->tet[a->next[i]];
            for (int c = 0; c < 4; c++) {
                int64_t u[3], w[3], image[3];
                int other = 0;
                if (c == i) continue;
                frame_value(a, c, x, u);
                if (a->plane[i] >= 0) {
                    int64_t other_u[3];
                    frame_value(a, c == 3 ? (i == 0 ? 1 : 0) : (i == 3 ? 2 : 3), x, other_u);
                    assert_int_equal(u[a->plane[i]], other_u[a->plane[i]]);
                }
                if (!b) continue;
                while (b->vertex[other] != a->vertex[c]) other++;
                frame_value(b, other, x, w);
                bw_transition_apply(&a->across[i], u, image);
                if (memcmp(image, w, sizeof w)) fail_msg("%s: tet %zu is torn from tet %d", q->name, t, a->next[i]);
            }
        }
    free(x);
}

static void check(quantizable *q) {
    for (int range = BW_QUANTIZE_POSITIVE; range <= BW_QUANTIZE_ANY; range++) {
        bw_atlas atlas;
        bw_frame frame;
        igm_quantize(q, (bw_quantize_range)range, 0);
        kit_expect_ok(&q->ctx, bw_atlas_init(&q->ctx, &q->cells, &q->complex, q->length, &atlas));
        kit_expect_ok(&q->ctx, bw_frame_init(&q->ctx, &atlas, &frame));
        kit_expect_ok(&q->ctx, bw_frame_check(&q->ctx, &frame));
        for (uint64_t stream = 0; stream < 2; stream++) try_values(q, &frame, stream);
        bw_frame_clear(&q->ctx, &frame);
        bw_atlas_clear(&q->ctx, &atlas);
    }
}

static void sample_models_have_frames(void **state) {
    (void)state;
    igm_each_sample(check);
}

static void flat_manifolds_have_frames(void **state) {
    (void)state;
    igm_each_flat_manifold(check);
}

static void shared_models_have_frames(void **state) {
    (void)state;
    igm_each_file(kit_shared("data/tet"), check);
    igm_each_file(kit_shared("data/tet-features"), check);
}

static void damage_is_found(void **state) {
    (void)state;
    quantizable q;
    igm_open_part(&q);
    bw_atlas atlas;
    kit_expect_ok(&q.ctx, bw_atlas_init(&q.ctx, &q.cells, &q.complex, q.length, &atlas));
    for (int damage = 0; damage < 3; damage++) {
        bw_frame frame;
        kit_expect_ok(&q.ctx, bw_frame_init(&q.ctx, &atlas, &frame));
        bw_frame_tet *t = &frame.tet[frame.tet_count / 2];
        if (damage == 0) t->across[t->next[0] == BW_NONE].shift[0]++;
        if (damage == 1) t->at[0][0]++, t->at[1][0]++, t->at[2][0]++, t->at[3][0]++;
        for (size_t i = 0; damage == 2 && i < frame.tet_count; i++)
            for (int c = 0; c < 4; c++) frame.tet[i].mask[c] = 0;
        kit_expect_status(&q.ctx, bw_frame_check(&q.ctx, &frame), BW_E_CHECK);
        q.ctx.error.status = BW_OK;
        bw_frame_clear(&q.ctx, &frame);
    }
    bw_atlas_clear(&q.ctx, &atlas);
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sample_models_have_frames),
    cmocka_unit_test(flat_manifolds_have_frames),
    cmocka_unit_test(shared_models_have_frames),
    cmocka_unit_test(damage_is_found),
};
KIT_MAIN(tests)
