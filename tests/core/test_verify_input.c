/* The input's own lengths are valid: contracting nothing gives the base complex, on every complex that a job may quantize. */
#include "core/verify_kit.h"

#include <time.h>

static void check_own_lengths(quantizable *q, bool base) {
    struct timespec t[2];
    set_input(q, 1);
    clock_gettime(CLOCK_MONOTONIC, &t[0]);
    bw_verdict d = expect_fault(q, BW_VALID, "its own lengths");
    clock_gettime(CLOCK_MONOTONIC, &t[1]);
    print_message("%-60s %5zu blocks %8zu cells %7.1f ms\n", q->name, q->complex.block_count, d.cells,
                  1e3 * (double)(t[1].tv_sec - t[0].tv_sec) + 1e-6 * (double)(t[1].tv_nsec - t[0].tv_nsec));
    assert_true(d.cells >= q->complex.block_count || !d.cells);
    if (base && !q->complex.torus_splits) assert_int_equal(d.cells, q->complex.block_count); /* nothing has to be cut */
    size_t cells = d.cells;
    for (int64_t factor = 2; factor <= 3; factor++) {
        set_input(q, factor);
        d = expect_fault(q, BW_VALID, "a multiple of its own lengths");
        assert_int_equal(d.cells, cells);
    }
    set_input(q, -1);
    expect_fault(q, BW_FAULT_EXTENT, "its own lengths turned round");
}

static void sample_models_are_valid_as_they_are(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int way = 0; way < 6; way++) {
            quantizable q;
            bw_model_options options;
            bw_model_options_defaults(&options);
            options.size = 2, options.noise = 0.5, options.seed = i, options.features = way >= 4;
            options.perturb = way == 5 ? 1e-9 : 0;
            bw_complex_kind kind = way == 3 ? BW_COMPLEX_BC : BW_COMPLEX_MC;
            quantizable_open(&q, models[i].name, &options, kind, way < 3 ? (bw_reduce_mode)way : BW_REDUCE_NONE);
            check_own_lengths(&q, kind == BW_COMPLEX_BC);
            quantizable_close(&q);
        }
}

static void flat_manifolds_are_valid_as_they_are(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check_own_lengths(&q, false);
        quantizable_close(&q);
    }
}

static void check_folder(const char *folder, bw_reduce_mode mode) {
    size_t count;
    char **names = kit_names(folder, ".hexex", &count);
    assert_true(count > 0);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], mode);
        check_own_lengths(&q, false);
        quantizable_close(&q);
    }
    kit_names_free(names, count);
}

static void shared_models_are_valid_as_they_are(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet"), BW_REDUCE_KEEP_SINGULAR);
}

static void shared_models_with_features_are_valid_as_they_are(void **state) {
    (void)state;
    check_folder(kit_shared("data/tet-features"), BW_REDUCE_KEEP_SINGULAR);
    check_folder(kit_shared("data/tet-features"), BW_REDUCE_FULL);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(sample_models_are_valid_as_they_are),
    cmocka_unit_test(flat_manifolds_are_valid_as_they_are),
    cmocka_unit_test(shared_models_are_valid_as_they_are),
    cmocka_unit_test(shared_models_with_features_are_valid_as_they_are),
};
KIT_MAIN(tests)
