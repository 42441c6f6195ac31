/* Each fault of a quantization is told by its name: one thing is damaged at a time. And the verifier agrees with the separation of validity constraints,
 * with which it has no line in common. */
#include "core/neck_kit.h"
#include "core/verify_kit.h"

static bw_model_options options_of(int size, uint64_t seed, double perturb) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = 0.5, options.seed = seed, options.perturb = perturb;
    options.stretch = seed & 1 ? 1 : 1.7;
    return options;
}

static void open_model(quantizable *q, const char *name, uint64_t seed) {
    bw_model_options options = options_of(2, seed, 0);
    quantizable_open(q, name, &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
}

/* Sets the arcs that are as long in the input as arc `a` to a length: a sheet, for lengths of these models are no multiples of each other. */
static void set_sheet(quantizable *q, size_t a, int64_t length) {
    for (size_t i = 0; i < q->complex.arc_count; i++)
        if (q->complex.arc_length[i] == q->complex.arc_length[a]) q->length[i] = length;
}

static bool is_singular(const quantizable *q, size_t a) { return q->complex.arc_flags[a] & BW_ARC_SINGULAR; }
static bool is_boundary(const quantizable *q, size_t a) { return q->complex.arc_flags[a] & BW_ARC_BOUNDARY; }

/* Whether some arc of the sheet of `a` is singular. */
static bool sheet_has_link(const quantizable *q, size_t a) {
    for (size_t i = 0; i < q->complex.arc_count; i++)
        if (q->complex.arc_length[i] == q->complex.arc_length[a] && is_singular(q, i)) return true;
    return false;
}

static void a_patch_that_is_no_rectangle(void **state) {
    (void)state;
    quantizable q;
    open_model(&q, "part", 1);
    for (size_t a = 0; a < q.complex.arc_count; a += 5) {
        set_input(&q, 1);
        q.length[a]++;
        bw_verdict d = expect_fault(&q, BW_FAULT_RECTANGLE, "one arc longer by 1");
        assert_string_equal(d.kind, "patch");
    }
    quantizable_close(&q);
}

static void a_block_turned_inside_out(void **state) {
    (void)state;
    quantizable q;
    open_model(&q, "ball", 1);
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        set_sheet(&q, a, -1);
        assert_string_equal(expect_fault(&q, BW_FAULT_EXTENT, "a sheet of negative blocks").kind, "block");
    }
    quantizable_close(&q);
}

static void a_link_without_length(void **state) {
    (void)state;
    quantizable q;
    open_model(&q, "plus", 1);
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        set_sheet(&q, a, 0);
        if (!sheet_has_link(&q, a)) continue;
        bw_verdict d = expect_fault(&q, BW_FAULT_LINK, "a sheet of singular arcs at 0");
        assert_true(is_singular(&q, (size_t)d.id));
        assert_int_equal(q.length[d.id], 0);
    }
    quantizable_close(&q);
}

static void a_region_without_area(void **state) {
    (void)state;
    quantizable q;
    quantizable_open_flat(&q, &flat_shapes[0], BW_REDUCE_NONE); /* two boundaries, and no singularity at all */
    int regions = 0, volumes = 0;
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        set_sheet(&q, a, 0);
        bw_verdict d = verdict_of(&q);
        regions += d.fault == BW_FAULT_REGION;
        volumes += d.fault == BW_FAULT_VOLUME;
        assert_int_equal(d.fault, is_boundary(&q, a) ? BW_FAULT_REGION : BW_FAULT_VOLUME); /* one way round the torus; its thickness */
    }
    assert_true(regions > 0 && volumes > 0);
    quantizable_close(&q);
}

static void a_volume_without_anything(void **state) {
    (void)state;
    for (size_t i = 3; i < FLAT_SHAPES; i++) { /* closed ones: no link, no region */
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        memset(q.length, 0, q.complex.arc_count * sizeof *q.length);
        expect_fault(&q, BW_FAULT_VOLUME, "all lengths 0");
        quantizable_close(&q);
    }
}

/* Around the square core of the cylinder there are four singular curves; its sheets bring them together in pairs, the sheet around it brings all of them to
 * the boundary. */
static void links_that_coincide(void **state) {
    (void)state;
    quantizable q;
    open_model(&q, "cylinder", 1);
    int found = 0;
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        set_sheet(&q, a, 0);
        if (sheet_has_link(&q, a)) continue;
        expect_fault(&q, BW_FAULT_COINCIDENCE, "the core or the ring around it at 0");
        found++;
    }
    assert_true(found > 0);
    quantizable_close(&q);
}

/* A neck without width: no critical curve meets another, no region is without area, but what joins the two parts is no volume. */
static void a_neck_that_is_a_sheet(void **state) {
    (void)state;
    quantizable q;
    quantizable_open_neck(&q);
    int64_t cell = INT64_MAX;
    size_t neck = 0;
    for (size_t a = 0; a < q.complex.arc_count; a++) cell = q.complex.arc_length[a] < cell ? q.complex.arc_length[a] : cell;
    cell /= NECK_LENGTH;
    for (size_t a = 0; a < q.complex.arc_count; a++)
        if (q.complex.arc_length[a] == NECK_WIDTH * cell) neck = a;
    for (size_t a = 0; a < q.complex.arc_count; a++) q.length[a] = 1;
    expect_fault(&q, BW_VALID, "all lengths 1");
    set_sheet(&q, neck, 0);
    expect_fault(&q, BW_FAULT_TOPOLOGY, "a neck without width");
    set_input(&q, 1);
    set_sheet(&q, neck, 0);
    expect_fault(&q, BW_FAULT_TOPOLOGY, "a neck without width, otherwise as in the input");
    quantizable_close(&q);
}

/* ---- lengths of 0 that are valid ---- */

/* Singular curves that lay on one wall, parted a little by errors: blocks between them are thin and may go, all of them at once. */
static void thin_blocks_may_be_contracted(void **state) {
    (void)state;
    static const char *const names[] = {"cylinder", "tee", "plate", "bearing", "part"};
    for (int i = 0; i < 5; i++) {
        quantizable q;
        bw_model_options options = options_of(1, 2, 1e-6);
        quantizable_open(&q, names[i], &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
        double unit = ldexp(1, q.map.exponent);
        const bw_quant_model *m = &q.model;
        int64_t *unknown = calloc(m->free_count + 1, sizeof *unknown);
        int zeros = 0;
        for (size_t f = 0; f < m->free_count; f++) unknown[f] = llround(40 * (double)m->class_length[m->free_class[f]] / unit);
        set_unknowns(&q, unknown);
        for (size_t a = 0; a < q.complex.arc_count; a++) zeros += !q.length[a];
        bw_verdict d = expect_fault(&q, BW_VALID, "lengths that come to 0 when rounded");
        print_message("%s: %d of %zu arcs at 0, %zu cells from %zu blocks\n", q.name, zeros, q.complex.arc_count, d.cells, q.complex.block_count);
        assert_true(zeros > 0);
        free(unknown);
        quantizable_close(&q);
    }
}

/* ---- agreement with the separation ---- */

static size_t both_accept, both_refuse, with_zeros, with_negatives, only_separation_refuses;

/* Returns whether the verifier accepts. */
static bool compare(quantizable *q) {
    bw_constraint_list list = {0};
    bw_verdict d = verdict_of(q);
    kit_expect_ok(&q->ctx, bw_validity_separate(q->validity, q->length, &list));
    if (d.fault != BW_VALID && !list.count)
        fail_msg("%s: no constraint is broken, but %s: %s (%s %lld, %lld)", q->name, bw_fault_name(d.fault), d.message, d.kind, (long long)d.id,
                 (long long)d.other);
    for (size_t c = 0; c < list.count && d.fault == BW_VALID; c++) { /* Q 5.3.3: constraints (iii) ask for more than is needed */
        if (list.rule[c] != BW_RULE_REGION && list.rule[c] != BW_RULE_VOLUME)
            fail_msg("%s: valid, but a constraint of rule %s is broken", q->name, bw_rule_name(list.rule[c]));
    }
    bool zeros = false, negatives = false;
    for (size_t a = 0; a < q->complex.arc_count; a++) zeros = zeros || q->length[a] == 0, negatives = negatives || q->length[a] < 0;
    both_accept += d.fault == BW_VALID && !list.count, both_refuse += d.fault != BW_VALID;
    only_separation_refuses += d.fault == BW_VALID && list.count;
    with_zeros += d.fault == BW_VALID && zeros, with_negatives += d.fault == BW_VALID && negatives;
    bw_constraint_clear(&q->ctx, &list);
    return d.fault == BW_VALID;
}

/* Short walks through what is valid, mostly towards the shorter: along its edge. */
static void compare_walks(quantizable *q, kit_random *random, int walks, int steps) {
    size_t size = (q->model.free_count + 1) * sizeof(int64_t);
    int64_t *unknown = calloc(1, size), *next = calloc(1, size);
    assert_true(unknown && next);
    for (int w = 0; w < walks; w++) {
        random_unknowns(q, random, unknown);
        set_unknowns(q, unknown);
        bool valid = compare(q);
        for (int i = 0; i < steps; i++) {
            memcpy(next, unknown, size);
            change_unknown(q, random, next);
            set_unknowns(q, next);
            bool good = compare(q);
            if (good || !valid) memcpy(unknown, next, size), valid = good;
        }
    }
    free(unknown), free(next);
}

static void print_agreement(void) {
    print_message("both accept %zu (with zeros %zu, with negative lengths %zu), both refuse %zu, only the separation refuses %zu\n", both_accept,
                  with_zeros, with_negatives, both_refuse, only_separation_refuses);
}

static void verifier_and_separation_agree_on_models(void **state) {
    (void)state;
    enum { SEED = 31 };
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    kit_random random = kit_random_start(SEED);
    print_message("seed %d\n", SEED);
    for (size_t i = 0; i < count; i++)
        for (int way = 0; way < 6; way++) {
            quantizable q;
            bw_model_options options = options_of(1, 40 + i, way & 1 ? 1e-3 : 0);
            options.features = way >= 4;
            quantizable_open(&q, models[i].name, &options, way == 3 ? BW_COMPLEX_BC : BW_COMPLEX_MC, way < 2 ? BW_REDUCE_KEEP_SINGULAR : BW_REDUCE_NONE);
            compare_walks(&q, &random, 5, 40);
            quantizable_close(&q);
        }
    print_agreement();
    assert_true(both_accept > 1000 && with_zeros > 300 && with_negatives > 10 && both_refuse > 1000);
    assert_true(only_separation_refuses * 100 < both_accept);
}

static void verifier_and_separation_agree_on_shared_models(void **state) {
    (void)state;
    enum { SEED = 32 };
    size_t count;
    const char *folder = kit_shared("data/tet");
    char **names = kit_names(folder, ".hexex", &count);
    kit_random random = kit_random_start(SEED);
    print_message("seed %d\n", SEED);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        quantizable_open_file(&q, folder, names[i], BW_REDUCE_KEEP_SINGULAR);
        compare_walks(&q, &random, 4, 40);
        quantizable_close(&q);
    }
    kit_names_free(names, count);
    print_agreement();
    assert_true(with_negatives > 50);
}

/* ---- the N-th allocation fails ---- */

static bw_status verify_once(bw_context *ctx, void *user) {
    quantizable *q = user;
    bw_verdict verdict;
    return bw_verify(ctx, &q->cells, &q->complex, q->length, &verdict);
}

static void no_allocation_may_fail_unseen(void **state) {
    (void)state;
    quantizable q;
    open_model(&q, "cylinder", 1);
    for (size_t a = 0; a < q.complex.arc_count; a++) q.length[a] = 1;
    kit_fail_each_allocation(verify_once, &q);
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(a_patch_that_is_no_rectangle),
    cmocka_unit_test(a_block_turned_inside_out),
    cmocka_unit_test(a_link_without_length),
    cmocka_unit_test(a_region_without_area),
    cmocka_unit_test(a_volume_without_anything),
    cmocka_unit_test(links_that_coincide),
    cmocka_unit_test(a_neck_that_is_a_sheet),
    cmocka_unit_test(thin_blocks_may_be_contracted),
    cmocka_unit_test(verifier_and_separation_agree_on_models),
    cmocka_unit_test(verifier_and_separation_agree_on_shared_models),
    cmocka_unit_test(no_allocation_may_fail_unseen),
};
KIT_MAIN(tests)
