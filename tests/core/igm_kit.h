/* Quantized complexes for the tests of integer-grid maps, on what validity_kit.h opens. */
#ifndef BW_TESTS_CORE_IGM_KIT_H
#define BW_TESTS_CORE_IGM_KIT_H

#include "core/validity_kit.h"
#include "igm/frame.h"

static bw_status igm_separate(void *user, const int64_t *length, bw_constraint_list *violated) {
    return bw_validity_separate(user, length, violated);
}

/* Lengths for a range and scale, into q->length. */
static inline void igm_quantize(quantizable *q, bw_quantize_range range, double scale) {
    bw_quantizer z;
    bw_quant_result result;
    bw_quant_oracle oracle = {.separate = range == BW_QUANTIZE_POSITIVE ? NULL : igm_separate, .user = q->validity};
    kit_expect_ok(&q->ctx, bw_quantizer_open(&q->ctx, &q->complex, q->map.exponent, range, &oracle, &z));
    kit_expect_ok(&q->ctx, bw_quantizer_solve(&q->ctx, &z, scale, 1, &result));
    bw_quant_model_lengths(&z.model, z.value, q->length);
    bw_quantizer_close(&q->ctx, &z);
}

/* The sample part as traced, with positive lengths. */
static inline void igm_open_part(quantizable *q) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    quantizable_open(q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    igm_quantize(q, BW_QUANTIZE_POSITIVE, 1);
}

/* Runs a test on every sample model, traced and reduced each way: with a chart of its own for every tet where nothing is reduced, with features where all is. */
static inline void igm_each_sample(void (*test)(quantizable *q)) {
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int mode = BW_REDUCE_NONE; mode <= BW_REDUCE_FULL; mode++) {
            quantizable q;
            bw_model_options options;
            bw_model_options_defaults(&options);
            options.size = 2, options.noise = 0.5, options.seed = i, options.features = mode == BW_REDUCE_FULL;
            options.scramble = mode == BW_REDUCE_NONE ? BW_SCRAMBLE_TETS : BW_SCRAMBLE_NONE;
            quantizable_open(&q, models[i].name, &options, BW_COMPLEX_MC, (bw_reduce_mode)mode);
            test(&q);
            quantizable_close(&q);
        }
}

static inline void igm_each_flat_manifold(void (*test)(quantizable *q)) {
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        test(&q);
        quantizable_close(&q);
    }
}

static inline void igm_each_file(const char *folder, void (*test)(quantizable *q)) {
    size_t count;
    char **names = kit_names(folder, ".hexex", &count);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_KEEP_SINGULAR);
        test(&q);
        quantizable_close(&q);
    }
    kit_names_free(names, count);
}

/* Number of hexes that q->length promises. */
static inline size_t igm_hexes(const quantizable *q) {
    size_t hexes = 0;
    for (size_t b = 0; b < q->complex.block_count; b++) {
        size_t volume = 1;
        for (size_t axis = 0; axis < 3; axis++) {
            int64_t extent = 0;
            for (size_t i = q->complex.block_edge_begin[12 * b + 4 * axis]; i < q->complex.block_edge_begin[12 * b + 4 * axis + 1]; i++)
                extent += q->length[q->complex.block_edge[i] >> 1];
            volume *= (size_t)extent;
        }
        hexes += volume;
    }
    return hexes;
}

/* A corner's coordinates for integer values of the unknowns. */
static inline void frame_value(const bw_frame_tet *t, int corner, const int64_t *x, int64_t out[3]) {
    for (int k = 0; k < 3; k++)
        out[k] = t->at[corner][k] + (t->variable[corner][k] == BW_NONE ? 0 : t->sign[corner][k] * x[t->variable[corner][k]]);
}

#endif
