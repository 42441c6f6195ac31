/* Validity: positive quantizations break nothing, what is broken is named by the rule it belongs to, and the verdict is that of the verifier. */
#include "core/validity_kit.h"

#include "quantize/verify.h"

static const bw_complex_kind kinds[] = {BW_COMPLEX_MC, BW_COMPLEX_BC};

static bw_model_options options_of(int size, uint64_t seed, int features) {
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = size, options.noise = 0.5, options.seed = seed, options.features = features;
    options.stretch = seed & 1 ? 1 : 1.7;
    return options;
}

static void set_input(quantizable *q, int64_t factor) {
    for (size_t a = 0; a < q->complex.arc_count; a++) q->length[a] = factor * q->complex.arc_length[a];
}

/* Separates and checks what every answer has to satisfy. */
static bw_constraint_list separate(quantizable *q) {
    bw_constraint_list list = {0};
    kit_expect_ok(&q->ctx, bw_validity_separate(q->validity, q->length, &list));
    for (size_t c = 0; c < list.count; c++) {
        if (bw_constraint_holds(&list, c, q->length))
            fail_msg("%s: a constraint (%s) holds for what it was found in", q->name, bw_rule_name(list.rule[c]));
        for (int64_t factor = 1; factor <= 7; factor += 3) {
            int64_t value = 0;
            for (size_t i = list.begin[c]; i < list.begin[c + 1]; i++) value += list.term[i].factor * factor * q->complex.arc_length[list.term[i].arc];
            if (list.relation[c] == BW_EQUAL ? value != list.bound[c] : value < list.bound[c])
                fail_msg("%s: a constraint (%s) excludes the input's lengths", q->name, bw_rule_name(list.rule[c]));
        }
    }
    return list;
}

/* Separates and fails unless every constraint, and at least one, is of one of these rules (bits). */
static void expect_rules(quantizable *q, unsigned rules, const char *what) {
    bw_constraint_list list = separate(q);
    if (!list.count) fail_msg("%s: %s is taken for valid", q->name, what);
    for (size_t c = 0; c < list.count; c++)
        if (!(rules >> list.rule[c] & 1)) fail_msg("%s: %s breaks the rule %s", q->name, what, bw_rule_name(list.rule[c]));
    bw_constraint_clear(&q->ctx, &list);
}

static void expect_valid(quantizable *q, const char *what) {
    bw_constraint_list list = separate(q);
    if (list.count) fail_msg("%s: %s breaks the rule %s", q->name, what, bw_rule_name(list.rule[0]));
    bw_constraint_clear(&q->ctx, &list);
}

/* ---- positive quantizations ---- */

static void solve_positive(quantizable *q, double scale) {
    bw_quantizer z;
    bw_quant_result result;
    kit_expect_ok(&q->ctx, bw_quantizer_open(&q->ctx, &q->complex, q->map.exponent, BW_QUANTIZE_POSITIVE, &(bw_quant_oracle){0}, &z));
    kit_expect_ok(&q->ctx, bw_quantizer_solve(&q->ctx, &z, scale, 5, &result));
    bw_quant_model_lengths(&z.model, z.value, q->length);
    bw_quantizer_close(&q->ctx, &z);
}

static void check_positive(quantizable *q) {
    for (int64_t factor = 1; factor <= 5; factor += 2) {
        set_input(q, factor);
        expect_valid(q, "a multiple of the input");
    }
    for (int i = 0; i < 2; i++) {
        solve_positive(q, i);
        expect_valid(q, "a positive quantization");
    }
}

static void positive_quantizations_of_models_are_valid(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 4; k++) {
            quantizable q;
            bw_model_options options = options_of(1, i + 1, k == 3);
            quantizable_open(&q, models[i].name, &options, kinds[k & 1], k == 0 ? BW_REDUCE_NONE : BW_REDUCE_FULL);
            check_positive(&q);
            quantizable_close(&q);
        }
}

static void positive_quantizations_of_flat_manifolds_are_valid(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check_positive(&q);
        quantizable_close(&q);
    }
}

/* ---- random quantizations ---- */

static size_t random_broken[BW_RULE_COUNT], random_valid, random_negative, random_strict;

/* The verifier contracts the complex and knows no constraints. Both must agree; with negative lengths separation may refuse a little more. */
static void compare(quantizable *q, const bw_constraint_list *list) {
    bw_verdict verdict;
    bool negative = false;
    for (size_t a = 0; a < q->complex.arc_count; a++) negative = negative || q->length[a] < 0;
    kit_expect_ok(&q->ctx, bw_verify(&q->ctx, &q->cells, &q->complex, q->length, &verdict));
    bool valid = verdict.fault == BW_VALID;
    if (list->count == 0 && !valid) fail_msg("%s: %s is not noticed: %s", q->name, bw_fault_name(verdict.fault), verdict.message);
    if (list->count && valid && !negative) fail_msg("%s: a valid quantization breaks the rule %s", q->name, bw_rule_name(list->rule[0]));
    random_negative += negative && !(list->count && list->rule[0] == BW_RULE_EXTENT);
    random_strict += list->count && valid;
}

/* Small lengths, some zero, some negative; those that leave a block with a negative extent break that rule. */
static void check_random(quantizable *q, kit_random *random, int tests) {
    const bw_quant_model *m = &q->model;
    int64_t *unknown = calloc(m->free_count + 1, sizeof *unknown), *value = calloc(m->class_count + 1, sizeof *value);
    for (int t = 0; t < tests; t++) {
        for (size_t f = 0; f < m->free_count; f++) /* mostly small; or long, and below one or two of them negative */
            unknown[f] = t % 3 == 2 ? 1 + (int64_t)kit_random_below(random, 4) : (int64_t)kit_random_below(random, kit_random_below(random, 4) ? 2 : 4);
        for (int i = 0; i <= t % 2 && t % 3 == 2 && m->free_count; i++) unknown[kit_random_below(random, m->free_count)] = -1;
        bw_quant_model_expand(m, unknown, value);
        bw_quant_model_lengths(m, value, q->length);
        bw_constraint_list list = separate(q);
        for (size_t c = 0; c < list.count; c++) random_broken[list.rule[c]]++;
        compare(q, &list);
        random_valid += !list.count;
        bw_constraint_clear(&q->ctx, &list);
    }
    free(unknown), free(value);
}

static void verdicts_are_those_of_the_verifier_and_constraints_hold_for_the_input(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    kit_random random = kit_random_start(4);
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 4; k++) {
            quantizable q;
            bw_model_options options = options_of(1, i + 20, k == 3);
            quantizable_open(&q, models[i].name, &options, kinds[k & 1], k == 0 ? BW_REDUCE_NONE : BW_REDUCE_FULL);
            check_random(&q, &random, 60);
            quantizable_close(&q);
        }
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check_random(&q, &random, 60);
        quantizable_close(&q);
    }
    for (int rule = 0; rule < BW_RULE_COUNT; rule++) print_message("%s %zu, ", bw_rule_name((bw_rule)rule), random_broken[rule]);
    print_message("valid %zu; %zu with negative lengths, %zu refused though valid\n", random_valid, random_negative, random_strict);
    assert_int_equal(random_broken[BW_RULE_RECTANGLE], 0); /* the model solves these */
    for (int rule = BW_RULE_EXTENT; rule < BW_RULE_COUNT; rule++) assert_true(random_broken[rule] > 0);
    assert_true(random_valid > 50 && random_negative > 100 && 10 * random_strict <= random_negative);
}

/* ---- one collapse for each rule ---- */

/* Sets the length of all arcs whose input is as long as that of arc `a` to 0: a sheet of the models below. Their lengths are no multiples of each other. */
static void collapse_like(quantizable *q, size_t a) {
    int64_t size = q->complex.arc_length[a];
    for (size_t i = 0; i < q->complex.arc_count; i++)
        if (q->complex.arc_length[i] == size) q->length[i] = 0;
}

static void a_rectangle_that_is_none_is_told(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options = options_of(1, 1, 0);
    quantizable_open(&q, "l-shape", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    set_input(&q, 1);
    q.length[3]++;
    expect_rules(&q, 1u << BW_RULE_RECTANGLE, "one arc longer by 1");
    set_input(&q, -1);
    expect_rules(&q, 1u << BW_RULE_EXTENT, "the input turned inside out");
    quantizable_close(&q);
}

static void a_box_without_extent_has_links_without_length(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options = options_of(1, 2, 0);
    quantizable_open(&q, "cuboid", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    bw_validity_figures f = bw_validity_count(q.validity);
    assert_int_equal(f.links, 12);
    assert_int_equal(f.regions, 6);
    assert_int_equal(f.nodes, 8);
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        collapse_like(&q, a);
        bw_constraint_list list = separate(&q);
        assert_int_equal(list.count, 4); /* the four edges of the box along one axis */
        for (size_t c = 0; c < 4; c++) assert_int_equal(list.rule[c], BW_RULE_LINK);
        bw_constraint_clear(&q.ctx, &list);
    }
    quantizable_close(&q);
}

/* In the round cylinder an arc across belongs to the square core or to the ring around it: without it, singular curves fall together or onto the boundary. */
static void sheets_between_singular_links_must_not_collapse(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options = options_of(1, 3, 0);
    quantizable_open(&q, "cylinder", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    int links = 0, separations = 0;
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        set_input(&q, 1);
        collapse_like(&q, a);
        bw_constraint_list list = separate(&q);
        assert_true(list.count > 0);
        links += list.rule[0] == BW_RULE_LINK, separations += list.rule[0] == BW_RULE_SEPARATION;
        bw_constraint_clear(&q.ctx, &list);
    }
    assert_int_equal(links + separations, q.complex.arc_count);
    assert_true(links >= 8); /* four singular curves and the arcs of the boundary beside them */
    assert_true(separations >= 12);
    quantizable_close(&q);
}

static void a_ring_without_length_has_cycles_of_links_without_length(void **state) {
    (void)state;
    static const char *const rings[] = {"torus", "torus-half", "torus-quarter"};
    for (int i = 0; i < 3; i++) {
        quantizable q;
        bw_model_options options = options_of(1, 4, 0);
        quantizable_open(&q, rings[i], &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
        const bw_critical *c = bw_validity_critical(q.validity);
        assert_int_equal(c->node_count, 0);
        for (size_t l = 0; l < c->link_count; l++) assert_true(bw_critical_link_is_cycle(&q.complex, c, l));
        set_input(&q, 1);
        collapse_like(&q, (size_t)(c->link_arc[0] >> 1));
        expect_rules(&q, 1u << BW_RULE_LINK, "a ring without length");
        quantizable_close(&q);
    }
}

/* A thick torus without a singularity: two ways round it, and one through. */
static void loops_must_not_collapse(void **state) {
    (void)state;
    for (int shape = 0; shape < 4; shape += 3) { /* with boundary; closed */
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[shape], BW_REDUCE_NONE);
        int loops = 0, separations = 0;
        for (size_t a = 0; a < q.complex.arc_count; a++) {
            set_input(&q, 1);
            collapse_like(&q, a);
            bw_constraint_list list = separate(&q);
            assert_true(list.count > 0);
            for (size_t c = 0; c < list.count; c++) {
                assert_true(list.rule[c] == BW_RULE_VOLUME || !shape);
                loops += list.rule[c] == BW_RULE_VOLUME, separations += list.rule[c] == BW_RULE_SEPARATION;
            }
            bw_constraint_clear(&q.ctx, &list);
        }
        assert_true(loops > 0);
        assert_int_equal(separations > 0, shape == 0); /* its two boundaries fall together */
        quantizable_close(&q);
    }
}

/* Opposite ways round: each has its length, but the loop that goes one forth and the other back has none. */
static void loops_that_are_no_generators_must_not_collapse(void **state) {
    (void)state;
    quantizable q;
    quantizable_open_flat(&q, &flat_shapes[1], BW_REDUCE_NONE); /* the two ways slide into each other */
    const bw_quant_model *m = &q.model;
    int64_t unknown[16] = {0}, *value = calloc(m->class_count, sizeof *value);
    size_t found = 0;
    assert_true(m->free_count > 1 && m->free_count <= 16);
    for (uint32_t code = 0; code < 1u << (2 * m->free_count) && code < 1u << 20; code++) {
        bool negative = false;
        for (size_t f = 0; f < m->free_count; f++) unknown[f] = code >> (2 * f) & 3;
        bw_quant_model_expand(m, unknown, value);
        bw_quant_model_lengths(m, value, q.length);
        for (size_t a = 0; a < q.complex.arc_count; a++) negative = negative || q.length[a] < 0;
        if (negative) continue;
        bw_constraint_list list = separate(&q);
        for (size_t c = 0; c < list.count; c++) found += list.rule[c] == BW_RULE_VOLUME;
        bw_constraint_clear(&q.ctx, &list);
    }
    assert_true(found > 0);
    free(value);
    quantizable_close(&q);
}

/* In manifolds that turn, a loop across is its own inverse: no multiple of it shows in the first Betti number. Nothing is critical there, so that is all there is. */
static void loops_of_finite_order_must_not_collapse(void **state) {
    (void)state;
    for (size_t shape = 5; shape < FLAT_SHAPES; shape++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[shape], BW_REDUCE_NONE);
        bw_validity_figures f = bw_validity_count(q.validity);
        assert_int_equal(f.links + f.regions + f.nodes, 0);
        const bw_quant_model *m = &q.model;
        int64_t unknown[16] = {0}, *value = calloc(m->class_count, sizeof *value);
        size_t gone = 0;
        assert_true(m->free_count <= 16);
        for (uint32_t code = 0; code < 1u << m->free_count; code++) {
            for (size_t i = 0; i < m->free_count; i++) unknown[i] = code >> i & 1;
            bw_quant_model_expand(m, unknown, value);
            bw_quant_model_lengths(m, value, q.length);
            if (bw_quant_model_hexes(m, value)) continue;
            bw_constraint_list list = separate(&q);
            assert_true(list.count > 0);
            gone += list.rule[0] == BW_RULE_VOLUME;
            bw_constraint_clear(&q.ctx, &list);
        }
        print_message("%s: %zu without volume\n", q.name, gone);
        assert_true(gone > 1);
        free(value);
        quantizable_close(&q);
    }
}

/* ---- features ---- */

/* A box with a line of feature edges across one side, or with one feature vertex in it. */
static void open_marked_box(quantizable *q, bool line) {
    bw_model model;
    bw_model_options options = options_of(4, 1, 0);
    options.noise = 0, options.stretch = 1;
    memset(q, 0, sizeof *q);
    bw_context_init(&q->ctx);
    snprintf(q->name, sizeof q->name, "box with a feature %s", line ? "line" : "vertex");
    kit_expect_ok(&q->ctx, bw_model_make(&q->ctx, "cuboid", &options, &model));
    double low[3] = {1e9, 1e9, 1e9}, mark[3] = {0, 0, 0};
    for (size_t v = 0; v < model.vertex_count; v++)
        for (int k = 0; k < 3; k++) low[k] = fmin(low[k], model.position[v][k]);
    mark[0] = 1e9, mark[1] = 1e9; /* of the side z low: the first grid line x and the first y that are not on its rim */
    for (size_t v = 0; v < model.vertex_count; v++)
        for (int k = 0; k < 2; k++)
            if (model.position[v][k] > low[k] + 1e-6) mark[k] = fmin(mark[k], model.position[v][k]);
    size_t n = 0;
    bw_free(&q->ctx, model.feature_edge), bw_free(&q->ctx, model.feature_vertex);
    model.feature_edge = bw_alloc(&q->ctx, 6 * model.tet_count, sizeof *model.feature_edge);
    model.feature_vertex = bw_alloc(&q->ctx, 1, sizeof *model.feature_vertex);
    model.feature_vertex_count = 0;
    for (size_t i = 0; i < 6 * model.tet_count; i++) {
        static const int corners[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
        int32_t end[2] = {model.tet[i / 6][corners[i % 6][0]], model.tet[i / 6][corners[i % 6][1]]};
        bool on = true, known = false;
        for (int j = 0; j < 2; j++)
            on = on && fabs(model.position[end[j]][2] - low[2]) < 1e-6 && fabs(model.position[end[j]][0] - mark[0]) < 1e-6;
        if (end[0] > end[1]) end[0] ^= end[1], end[1] ^= end[0], end[0] ^= end[1];
        for (size_t e = 0; e < n; e++) known = known || !memcmp(model.feature_edge[e], end, sizeof end);
        if (!on || known) continue;
        if (line) memcpy(model.feature_edge[n++], end, sizeof end);
        for (int j = 0; j < 2 && !line; j++)
            if (fabs(model.position[end[j]][1] - mark[1]) < 1e-6) model.feature_vertex[0] = end[j], model.feature_vertex_count = 1;
    }
    model.feature_edge_count = n;
    assert_true(line ? n > 0 : model.feature_vertex_count == 1);
    quantizable_take(q, &model);
    quantizable_build(q, BW_COMPLEX_MC, BW_REDUCE_NONE);
}

/* The sheets of a box that a feature cuts in two: each must keep its extent, or the feature falls onto an edge. */
static void features_are_critical(void **state) {
    (void)state;
    for (int line = 0; line < 2; line++) {
        quantizable q;
        open_marked_box(&q, line);
        bw_validity_figures f = bw_validity_count(q.validity);
        assert_int_equal(f.nodes, line ? 10 : 9);
        assert_int_equal(f.links, line ? 15 : 12); /* a line parts the two edges it ends in */
        assert_int_equal(f.regions, line ? 7 : 6);
        int separations = 0;
        for (size_t a = 0; a < q.complex.arc_count; a++) {
            set_input(&q, 1);
            collapse_like(&q, a);
            bw_constraint_list list = separate(&q);
            assert_true(list.count > 0);
            separations += list.rule[0] == BW_RULE_SEPARATION;
            if (line) assert_int_equal(list.rule[0], BW_RULE_LINK); /* parts of edges, or the line itself */
            bw_constraint_clear(&q.ctx, &list);
        }
        assert_int_equal(separations > 0, !line);
        quantizable_close(&q);
    }
}

/* ---- topology ---- */

static void generators_are_as_many_as_the_first_betti_number(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++) {
        quantizable q;
        bw_model_options options = options_of(1, 5, 0);
        quantizable_open(&q, models[i].name, &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
        bw_validity_figures f = bw_validity_count(q.validity);
        bool hollow = !strcmp(models[i].name, "hollow-torus"); /* the others are handlebodies */
        print_message("%s: %zu, regions %zu\n", models[i].name, f.volume_generators, f.region_generators);
        assert_int_equal(f.volume_generators, hollow ? 2 : 1 - models[i].euler);
        quantizable_close(&q);
    }
    static const struct {
        size_t volume, regions;
    } flat[] = {{2, 4}, {2, 4}, {1, 2}, {3, 0}, {3, 0}, {1, 0}, {1, 0}};
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        bw_validity_figures f = bw_validity_count(q.validity);
        print_message("%s: %zu, regions %zu\n", flat_shapes[i].name, f.volume_generators, f.region_generators);
        assert_int_equal(f.volume_generators, flat[i].volume);
        assert_int_equal(f.region_generators, flat[i].regions);
        quantizable_close(&q);
    }
}

/* ---- the same answer, and failures ---- */

static bool same(const bw_constraint_list *a, const bw_constraint_list *b) {
    if (a->count != b->count) return false;
    return !a->count || (!memcmp(a->begin, b->begin, (a->count + 1) * sizeof *a->begin) && !memcmp(a->bound, b->bound, a->count * sizeof *a->bound) &&
                         !memcmp(a->rule, b->rule, a->count) && !memcmp(a->term, b->term, a->begin[a->count] * sizeof *a->term));
}

static void the_same_lengths_give_the_same_constraints(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options = options_of(1, 6, 0);
    quantizable_open(&q, "part", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    bw_validity *fresh;
    kit_expect_ok(&q.ctx, bw_validity_new(&q.ctx, &q.cells, &q.complex, &fresh));
    for (size_t a = 0; a < q.complex.arc_count; a += 3) {
        bw_constraint_list once, again = {0};
        set_input(&q, 1);
        collapse_like(&q, a);
        once = separate(&q);
        kit_expect_ok(&q.ctx, bw_validity_separate(a % 2 ? fresh : q.validity, q.length, &again));
        assert_true(once.count > 0 && same(&once, &again));
        bw_constraint_clear(&q.ctx, &once), bw_constraint_clear(&q.ctx, &again);
    }
    bw_validity_free(&q.ctx, fresh);
    quantizable_close(&q);
}

static bw_status search(bw_context *ctx, void *user) {
    quantizable *q = user;
    bw_validity *v;
    bw_constraint_list list = {0};
    bw_status status = bw_validity_new(ctx, &q->cells, &q->complex, &v);
    if (status == BW_OK) {
        status = bw_validity_separate(v, q->length, &list);
        bw_validity_free(ctx, v);
    }
    bw_constraint_clear(ctx, &list);
    return status;
}

static void running_out_of_memory_leaks_nothing(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options = options_of(1, 7, 0);
    quantizable_open(&q, "hollow-torus", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    assert_true(kit_fail_each_allocation(search, &q) > 40); /* all lengths 0 */
    set_input(&q, 1);
    collapse_like(&q, 0);
    kit_fail_each_allocation(search, &q);
    quantizable_close(&q);
}

/* ---- real inputs ---- */

static void positive_quantizations_of_real_inputs_are_valid(void **state) {
    (void)state;
    static const char *const folders[] = {"data/tet", "data/tet-features"};
    for (int k = 0; k < 2; k++) {
        size_t count;
        const char *folder = kit_shared(folders[k]);
        char **names = kit_names(folder, ".hexex", &count);
        for (size_t i = 0; i < count; i++) {
            quantizable q;
            quantizable_open_file(&q, folder, names[i], BW_REDUCE_FULL);
            check_positive(&q);
            kit_random random = kit_random_start(i);
            check_random(&q, &random, 20);
            bw_validity_figures f = bw_validity_count(q.validity);
            print_message("%-36s %4zu arcs, %3zu links, %3zu regions, %3zu nodes, generators %zu + %zu\n", names[i], q.complex.arc_count,
                          f.links, f.regions, f.nodes, f.region_generators, f.volume_generators);
            quantizable_close(&q);
        }
        kit_names_free(names, count);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(positive_quantizations_of_models_are_valid),
    cmocka_unit_test(positive_quantizations_of_flat_manifolds_are_valid),
    cmocka_unit_test(verdicts_are_those_of_the_verifier_and_constraints_hold_for_the_input),
    cmocka_unit_test(a_rectangle_that_is_none_is_told),
    cmocka_unit_test(a_box_without_extent_has_links_without_length),
    cmocka_unit_test(sheets_between_singular_links_must_not_collapse),
    cmocka_unit_test(a_ring_without_length_has_cycles_of_links_without_length),
    cmocka_unit_test(loops_must_not_collapse),
    cmocka_unit_test(loops_that_are_no_generators_must_not_collapse),
    cmocka_unit_test(loops_of_finite_order_must_not_collapse),
    cmocka_unit_test(features_are_critical),
    cmocka_unit_test(generators_are_as_many_as_the_first_betti_number),
    cmocka_unit_test(the_same_lengths_give_the_same_constraints),
    cmocka_unit_test(running_out_of_memory_leaks_nothing),
    cmocka_unit_test(positive_quantizations_of_real_inputs_are_valid),
};
KIT_MAIN(tests)
