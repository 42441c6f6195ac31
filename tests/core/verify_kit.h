/* The verifier on what validity_kit.h opens. */
#ifndef BW_TESTS_CORE_VERIFY_KIT_H
#define BW_TESTS_CORE_VERIFY_KIT_H

#include "core/validity_kit.h"
#include "quantize/verify.h"

static inline bw_verdict verdict_of(quantizable *q) {
    bw_verdict verdict;
    kit_expect_ok(&q->ctx, bw_verify(&q->ctx, &q->cells, &q->complex, q->length, &verdict));
    return verdict;
}

/* Fails the test unless the verifier finds this fault in q->length. */
static inline bw_verdict expect_fault(quantizable *q, bw_fault fault, const char *what) {
    bw_verdict d = verdict_of(q);
    if (d.fault != fault)
        fail_msg("%s, %s: %s expected, but it is %s: %s (%s %lld, %lld)", q->name, what, bw_fault_name(fault), bw_fault_name(d.fault),
                 d.message, d.kind, (long long)d.id, (long long)d.other);
    return d;
}

static inline void set_input(quantizable *q, int64_t factor) {
    for (size_t a = 0; a < q->complex.arc_count; a++) q->length[a] = factor * q->complex.arc_length[a];
}

/* Sets q->length from values of the model's free unknowns. */
static inline void set_unknowns(quantizable *q, const int64_t *unknown) {
    int64_t *value = malloc((q->model.class_count + 1) * sizeof *value);
    assert_non_null(value);
    bw_quant_model_expand(&q->model, unknown, value);
    bw_quant_model_lengths(&q->model, value, q->length);
    free(value);
}

/* Values of the free unknowns near the input's at a random scale, some zero. */
static inline void random_unknowns(quantizable *q, kit_random *random, int64_t *unknown) {
    const bw_quant_model *m = &q->model;
    double longest = 0, scale;
    for (size_t c = 0; c < m->class_count; c++) longest = fmax(longest, (double)m->class_length[c]);
    scale = kit_random_range(random, 0.2, 10) / longest;
    for (size_t f = 0; f < m->free_count; f++) {
        unknown[f] = (int64_t)floor(scale * (double)m->class_length[m->free_class[f]] + 0.5);
        if (!kit_random_below(random, 8)) unknown[f] += (int64_t)kit_random_below(random, 3) - 1;
    }
}

/* One of them a little shorter or longer. */
static inline void change_unknown(quantizable *q, kit_random *random, int64_t *unknown) {
    int64_t by = 1 + (int64_t)kit_random_below(random, 2);
    if (q->model.free_count) unknown[kit_random_below(random, q->model.free_count)] += kit_random_below(random, 3) ? -by : by;
}

#endif
