/* The solver's optimum is that of complete enumeration, for all ranges and with constraints that are found only on the way; bounds are bounds. */
#include "core/reduce_kit.h"

#include <math.h>

#include "quantize/quantizer.h"

static uint64_t seed;

static int64_t draw(int64_t low, int64_t high) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return low + (int64_t)((seed >> 33) % (uint64_t)(high - low + 1));
}

/* ---- constraints behind an oracle ---- */

typedef struct {
    bw_context *ctx;
    bw_constraint_list list; /* on arcs; all hold for long positive lengths */
    int calls;
} secret;

static bw_status reveal(void *user, const int64_t *length, bw_constraint_list *violated) {
    secret *s = user;
    s->calls++;
    size_t c = bw_constraint_first_broken(&s->list, length); /* one at a time: the laziest there is */
    return c < s->list.count ? bw_constraint_copy(s->ctx, violated, &s->list, c) : BW_OK;
}

/* plain: such that positive lengths satisfy all, as true constraints of validity are. */
static void make_secret(bw_context *ctx, const bw_complex *x, int count, bool plain, secret *s) {
    *s = (secret){.ctx = ctx};
    for (int i = 0; i < count; i++) {
        bw_term term[5];
        size_t n = (size_t)draw(1, 4);
        for (size_t k = 0; k < n; k++) term[k] = (bw_term){(bw_arc)draw(0, (int64_t)x->arc_count - 1), 1};
        int64_t longest = 0, sum = 0;
        for (size_t k = 0; k < n; k++) sum += x->arc_length[term[k].arc];
        bw_arc minus = (bw_arc)draw(0, (int64_t)x->arc_count - 1);
        longest = x->arc_length[minus];
        if (longest < sum && draw(0, 1) && !plain) term[n++] = (bw_term){minus, -1};
        kit_expect_ok(ctx, bw_constraint_add(ctx, &s->list, BW_RULE_SEPARATION, BW_AT_LEAST, term, n, plain ? 1 : draw(1, 2)));
    }
}

/* ---- enumeration ---- */

/* The least objective over unknowns within `span` of their target; INFINITY if none is allowed. *at_edge: the best one lies at the edge of that. */
static double enumerate(const bw_quant_problem *p, const secret *s, int span, bool *at_edge) {
    const bw_quant_model *m = p->model;
    int64_t low[8], x[8], *value = malloc(m->class_count * sizeof *value);
    double best = INFINITY;
    size_t n = m->free_count;
    assert_true(n <= 8);
    for (size_t f = 0; f < n; f++) x[f] = low[f] = llround(p->target[m->free_class[f]]) - span;
    for (;;) {
        bw_quant_model_expand(m, x, value);
        double objective = bw_quant_problem_objective(p, value);
        if (objective < best && bw_quant_problem_allows(p, value)) {
            bw_quant_model_lengths(m, value, p->length);
            if (bw_constraint_first_broken(&s->list, p->length) == s->list.count) {
                best = objective;
                *at_edge = false;
                for (size_t f = 0; f < n; f++) *at_edge |= x[f] == low[f] || x[f] == low[f] + 2 * span;
            }
        }
        size_t f = 0;
        while (f < n && x[f] == low[f] + 2 * span) x[f] = low[f], f++;
        if (f == n) break;
        x[f]++;
    }
    free(value);
    return best;
}

/* The fewest hexes over unknowns in 0 .. span; as enumerate. */
static double enumerate_hexes(const bw_quant_problem *p, const secret *s, int span) {
    const bw_quant_model *m = p->model;
    int64_t x[8] = {0}, *value = malloc(m->class_count * sizeof *value);
    double best = INFINITY;
    for (;;) {
        bw_quant_model_expand(m, x, value);
        double hexes = (double)bw_quant_model_hexes(m, value);
        if (hexes < best && bw_quant_problem_allows(p, value)) {
            bw_quant_model_lengths(m, value, p->length);
            if (bw_constraint_first_broken(&s->list, p->length) == s->list.count) best = hexes;
        }
        size_t f = 0;
        while (f < m->free_count && x[f] == span) x[f++] = 0;
        if (f == m->free_count) break;
        x[f]++;
    }
    free(value);
    return best;
}

static int compared, proven_by_simple_bound, learnt;

static void compare(bw_context *ctx, const bw_complex *x, const bw_quant_model *m, bw_quantize_range range, double scale, const char *name) {
    secret s;
    bw_quant_problem p, whole;
    bw_quant_moves moves;
    bw_quant_result result;
    int64_t *value = malloc(m->class_count * sizeof *value);
    make_secret(ctx, x, range == BW_QUANTIZE_POSITIVE ? 0 : (int)draw(1, 5), false, &s);
    bw_quant_oracle oracle = {.separate = range == BW_QUANTIZE_POSITIVE ? NULL : reveal, .user = &s};
    kit_expect_ok(ctx, bw_quant_problem_init(ctx, m, range, &p));
    kit_expect_ok(ctx, bw_quant_problem_init(ctx, m, range, &whole));
    kit_expect_ok(ctx, bw_quant_moves_init(ctx, m, &moves));
    bw_quant_problem_set_scale(&p, scale);
    bw_quant_problem_set_scale(&whole, scale);
    kit_expect_ok(ctx, bw_quant_solve(ctx, &p, &moves, &oracle, 60, NULL, value, &result));
    bool at_edge = false;
    double expected = enumerate(&whole, &s, m->free_count > 5 ? 2 : 4, &at_edge);
    assert_int_equal(result.status, BW_QUANT_OPTIMAL);
    assert_true(bw_quant_problem_allows(&whole, value));
    bw_quant_model_lengths(m, value, p.length);
    assert_true(bw_constraint_first_broken(&s.list, p.length) == s.list.count);
    assert_true(fabs(bw_quant_problem_objective(&whole, value) - result.objective) < 1e-9 * (1 + result.objective));
    assert_true(result.simple_bound <= result.objective + 1e-9 * (1 + result.objective));
    assert_true(result.objective <= result.heuristic + 1e-9);
    if (result.objective > expected + 1e-6 * (1 + expected) || (!at_edge && result.objective < expected - 1e-6 * (1 + expected)))
        fail_msg("%s range %d scale %g: %g, by enumeration %g", name, range, scale, result.objective, expected);
    compared += !at_edge && expected < INFINITY;
    proven_by_simple_bound += !result.nodes;
    learnt += result.rows > 0;
    free(value);
    bw_constraint_clear(ctx, &s.list);
    bw_quant_moves_clear(ctx, &moves);
    bw_quant_problem_clear(ctx, &p);
    bw_quant_problem_clear(ctx, &whole);
}

static void optima_are_those_of_enumeration(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    seed = 21;
    print_message("seed %d\n", (int)seed);
    for (size_t i = 0; i < count; i++) {
        reducible r;
        bw_quant_model m;
        bw_model_options options = reduce_options_of(1, i);
        reducible_open(&r, models[i].name, &options, BW_COMPLEX_MC, false);
        kit_expect_ok(&r.ctx, bw_quant_model_init(&r.ctx, &r.raw, r.map.exponent, &m));
        size_t used = r.ctx.memory.used;
        double longest = 0;
        for (size_t c = 0; c < m.class_count; c++) longest = fmax(longest, (double)m.class_length[c] / m.unit);
        for (int test = 0; test < 30 && m.free_count <= 6; test++) {
            double scale = draw(0, 3) ? (double)draw(0, 3000) / 1000 / longest : 0;
            compare(&r.ctx, &r.raw, &m, (bw_quantize_range)(BW_QUANTIZE_POSITIVE + test % 3), scale, r.name);
        }
        assert_int_equal(r.ctx.memory.used, used);
        bw_quant_model_clear(&r.ctx, &m);
        reducible_close(&r);
    }
    print_message("%d compared, %d without a linear program, %d learnt constraints\n", compared, proven_by_simple_bound, learnt);
    assert_true(compared >= 200 && proven_by_simple_bound < compared && learnt >= 50);
}

static void fewest_hexes_are_those_of_enumeration(void **state) {
    (void)state;
    size_t count;
    int tried = 0;
    const bw_model_info *models = bw_model_list(&count);
    seed = 23;
    print_message("seed %d\n", (int)seed);
    for (size_t i = 0; i < count; i++) {
        reducible r;
        bw_model_options options = reduce_options_of(1, i);
        reducible_open(&r, models[i].name, &options, BW_COMPLEX_MC, false);
        for (int test = 0; test < 12; test++) {
            secret s;
            bw_quantizer q;
            bw_quant_problem whole;
            bw_quant_result result;
            bw_quantize_range range = test % 2 ? BW_QUANTIZE_NONNEGATIVE : BW_QUANTIZE_POSITIVE;
            make_secret(&r.ctx, &r.raw, range == BW_QUANTIZE_POSITIVE ? 0 : 4, true, &s);
            bw_quant_oracle oracle = {.separate = range == BW_QUANTIZE_POSITIVE ? NULL : reveal, .user = &s};
            kit_expect_ok(&r.ctx, bw_quantizer_open(&r.ctx, &r.raw, r.map.exponent, range, &oracle, &q));
            if (q.model.free_count <= 6) {
                kit_expect_ok(&r.ctx, bw_quant_problem_init(&r.ctx, &q.model, range, &whole));
                kit_expect_ok(&r.ctx, bw_quantizer_fewest(&r.ctx, &q, 60, &result));
                double expected = enumerate_hexes(&whole, &s, q.model.free_count > 5 ? 4 : 5);
                assert_int_equal(result.status, BW_QUANT_OPTIMAL);
                assert_true(result.objective == (double)bw_quantizer_figures(&q).hexes);
                bw_quant_model_lengths(&q.model, q.value, whole.length);
                assert_true(bw_constraint_first_broken(&s.list, whole.length) == s.list.count);
                if (result.objective != expected) fail_msg("%s range %d: %g, by enumeration %g", r.name, range, result.objective, expected);
                tried++;
                bw_quant_problem_clear(&r.ctx, &whole);
            }
            bw_quantizer_close(&r.ctx, &q);
            bw_constraint_clear(&r.ctx, &s.list);
        }
        reducible_close(&r);
    }
    assert_true(tried >= 60);
}

/* ---- larger models ---- */

static void wider_ranges_are_never_worse_and_a_stopped_search_is_honest(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    seed = 22;
    for (size_t i = 0; i < count; i++) {
        reducible r;
        bw_quant_model m;
        bw_quant_moves moves;
        bw_model_options options = reduce_options_of(2, i);
        reducible_open(&r, models[i].name, &options, BW_COMPLEX_BC, false);
        kit_expect_ok(&r.ctx, bw_quant_model_init(&r.ctx, &r.raw, r.map.exponent, &m));
        kit_expect_ok(&r.ctx, bw_quant_moves_init(&r.ctx, &m, &moves));
        int64_t *value = malloc(m.class_count * sizeof *value);
        double scale = (double)draw(0, 40) / 10, last = INFINITY;
        for (int range = BW_QUANTIZE_POSITIVE; range <= BW_QUANTIZE_ANY; range++) {
            bw_quant_problem p;
            bw_quant_oracle oracle = {0};
            bw_quant_result full, stopped;
            kit_expect_ok(&r.ctx, bw_quant_problem_init(&r.ctx, &m, (bw_quantize_range)range, &p));
            bw_quant_problem_set_scale(&p, scale);
            kit_expect_ok(&r.ctx, bw_quant_solve(&r.ctx, &p, &moves, &oracle, 0, NULL, value, &stopped));
            assert_true(stopped.status == BW_QUANT_HEURISTIC || stopped.objective <= stopped.simple_bound + 1e-5 * (1 + stopped.objective));
            assert_true(bw_quant_problem_allows(&p, value));
            kit_expect_ok(&r.ctx, bw_quant_solve(&r.ctx, &p, &moves, &oracle, 60, value, value, &full));
            assert_int_equal(full.status, BW_QUANT_OPTIMAL);
            assert_true(full.objective <= last + 1e-9 * (1 + full.objective));
            assert_true(stopped.bound <= full.objective + 1e-9 * (1 + full.objective));
            assert_true(stopped.objective >= full.objective - 1e-9 * (1 + full.objective));
            last = full.objective;
            bw_quant_problem_clear(&r.ctx, &p);
        }
        free(value);
        bw_quant_moves_clear(&r.ctx, &moves);
        bw_quant_model_clear(&r.ctx, &m);
        reducible_close(&r);
    }
}

static bw_status quantize_once(bw_context *ctx, void *user) {
    const reducible *r = user;
    bw_quantizer q;
    bw_quant_oracle oracle = {0};
    bw_quant_result result;
    bw_status status = bw_quantizer_open(ctx, &r->raw, r->map.exponent, BW_QUANTIZE_ANY, &oracle, &q);
    if (status != BW_OK) return status;
    status = bw_quantizer_solve(ctx, &q, 0.37, 60, &result);
    if (status == BW_OK) status = bw_quantizer_fewest(ctx, &q, 60, &result);
    double scale;
    if (status == BW_OK) status = bw_quantizer_aim(ctx, &q, 40, 60, &scale, &result);
    bw_quantizer_close(ctx, &q);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    reducible r;
    bw_model_options options = reduce_options_of(1, 3);
    reducible_open(&r, "l-shape", &options, BW_COMPLEX_MC, false);
    assert_true(kit_fail_each_allocation(quantize_once, &r) > 20);
    reducible_close(&r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(each_allocation_may_fail),
    cmocka_unit_test(optima_are_those_of_enumeration),
    cmocka_unit_test(fewest_hexes_are_those_of_enumeration),
    cmocka_unit_test(wider_ranges_are_never_worse_and_a_stopped_search_is_honest),
};
KIT_MAIN(tests)
