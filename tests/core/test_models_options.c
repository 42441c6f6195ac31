/* Every option of the sample models does what it says, and every damage is the one it is named after. */
#include <errno.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "models/survey.h"

static bw_model_options plain(void) {
    return (bw_model_options){.size = 2, .stretch = 1, .noise = 0.6, .seed = 7};
}

static bw_model make(bw_context *ctx, const char *name, const bw_model_options *o) {
    bw_model m;
    bw_context_init(ctx);
    if (bw_model_make(ctx, name, o, &m)) fail_msg("%s: %s", name, ctx->error.message);
    return m;
}

static bw_model_survey look(bw_context *ctx, const bw_model *m) {
    bw_model_survey s;
    assert_int_equal(bw_model_look(ctx, m, &s), BW_OK);
    return s;
}

static bw_model_survey survey(const char *name, const bw_model_options *o) {
    bw_context ctx;
    bw_model m = make(&ctx, name, o);
    bw_model_survey s = look(&ctx, &m);
    bw_model_clear(&ctx, &m);
    return s;
}

static char *text_of(const char *name, const bw_model_options *o, size_t *length) {
    bw_context ctx;
    char *text = NULL;
    FILE *file = open_memstream(&text, length);
    bw_model m = make(&ctx, name, o);
    assert_int_equal(bw_model_write(&ctx, &m, file), BW_OK);
    fclose(file);
    bw_model_clear(&ctx, &m);
    assert_int_equal(ctx.memory.used, 0);
    return text;
}

static void the_same_options_give_the_same_bytes(void **state) {
    (void)state;
    bw_model_options o = plain();
    o.scramble = BW_SCRAMBLE_CELLS;
    o.perturb = 0.01;
    size_t n[3];
    char *text[3];
    for (int i = 0; i < 3; i++) {
        o.seed = i < 2 ? 7 : 8;
        text[i] = text_of("ball", &o, &n[i]);
    }
    assert_int_equal(n[0], n[1]);
    assert_memory_equal(text[0], text[1], n[0]);
    assert_true(n[0] != n[2] || memcmp(text[0], text[2], n[0]));
    for (int i = 0; i < 3; i++) free(text[i]);
}

static void a_written_model_reads_back_to_the_same_doubles(void **state) {
    (void)state;
    bw_model_options o = plain();
    o.features = 1;
    bw_context ctx;
    size_t length;
    char *text = text_of("part", &o, &length), *at = text;
    bw_model m = make(&ctx, "part", &o);
    assert_int_equal(strtoll(at, &at, 10), m.vertex_count);
    for (size_t i = 0; i < 3 * m.vertex_count; i++) assert_true(strtod(at, &at) == m.position[i / 3][i % 3]);
    assert_int_equal(strtoll(at, &at, 10), m.tet_count);
    for (size_t t = 0; t < m.tet_count; t++) {
        for (int i = 0; i < 4; i++) assert_int_equal(strtoll(at, &at, 10), m.tet[t][i]);
        for (int i = 0; i < 12; i++) assert_true(strtod(at, &at) == m.parameter[t][i / 3][i % 3]);
    }
    assert_int_equal(strtoll(at, &at, 10), m.feature_vertex_count);
    assert_int_equal(strtoll(at, &at, 10), m.feature_edge_count);
    assert_int_equal(strtoll(at, &at, 10), 0);
    for (size_t i = 0; i < m.feature_vertex_count; i++)
        assert_int_equal(strtoll(at, &at, 10), m.feature_vertex[i]);
    for (size_t i = 0; i < 2 * m.feature_edge_count; i++)
        assert_int_equal(strtoll(at, &at, 10), m.feature_edge[i / 2][i % 2]);
    assert_string_equal(at, "\n");
    free(text);
    bw_model_clear(&ctx, &m);
}

/* Without noise the facets on block and cell walls are constant in a parameter; with it almost none is, so
 * walls cut through tets. Facets between vertices that cannot move, on singular and boundary edges, may stay
 * flat. */
static void noise_takes_facets_off_the_walls(void **state) {
    static const char *const names[] = {"cuboid", "cylinder", "ball", "torus-quarter", "tee", "part"};
    (void)state;
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        bw_model_options o = plain();
        o.noise = 0;
        bw_model_survey still = survey(names[i], &o);
        o.noise = 0.6;
        bw_model_survey moved = survey(names[i], &o);
        print_message("%s: %zu of %zu facets flat, with noise %zu\n", names[i], still.facets_flat,
                      still.facets_inside, moved.facets_flat);
        assert_true(still.facets_flat > still.facets_inside / 4);
        assert_true(moved.facets_flat < still.facets_flat / 20);
    }
}

static void perturb_breaks_seams_and_alignment_as_much_as_asked(void **state) {
    (void)state;
    for (double size = 1e-6; size < 0.02; size *= 100) {
        bw_model_options o = plain();
        bw_model_survey exact = survey("cylinder", &o);
        o.perturb = size;
        bw_model_survey s = survey("cylinder", &o);
        print_message("perturb %g: seams off by %g, boundary by %g\n", size, s.seam_defect,
                      s.alignment_defect);
        assert_true(exact.seam_defect == 0);
        assert_true(s.seam_defect > 0.01 * size && s.seam_defect < 4 * size);
        assert_true(s.alignment_defect > 0.01 * size && s.alignment_defect < 4 * size);
        assert_true(s.map_volume_min > 0);
        assert_int_equal(s.singular_curves, 4);
    }
}

static void scramble_turns_charts(void **state) {
    (void)state;
    size_t turned[4], moved[4];
    for (int k = BW_SCRAMBLE_NONE; k <= BW_SCRAMBLE_TETS; k++) {
        bw_model_options o = plain();
        o.scramble = k;
        bw_model_survey s = survey("cylinder", &o);
        turned[k] = s.facets_turned;
        moved[k] = s.facets_moved;
        print_message("scramble %d: %zu of %zu facets turned, %zu moved\n", k, turned[k], s.facets_inside,
                      moved[k]);
        if (k == BW_SCRAMBLE_TETS)
            assert_true(turned[k] > s.facets_inside * 9 / 10 && moved[k] == s.facets_inside);
    }
    assert_true(turned[0] > 0); /* four singular edges leave four seams with a quarter turn */
    for (int k = 1; k < 4; k++) assert_true(moved[k] > 1.2 * (double)moved[k - 1]);
}

static double extent(const bw_model *m, int axis) {
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; i < 4 * m->tet_count; i++) {
        low = fmin(low, m->parameter[i / 4][i % 4][axis]);
        high = fmax(high, m->parameter[i / 4][i % 4][axis]);
    }
    return high - low;
}

static void stretch_changes_the_map_and_not_the_mesh(void **state) {
    (void)state;
    bw_context ctx[2];
    bw_model_options o = plain();
    bw_model a = make(&ctx[0], "cuboid", &o);
    o.stretch = 16;
    bw_model b = make(&ctx[1], "cuboid", &o);
    double ratio[3];
    for (int i = 0; i < 3; i++) ratio[i] = extent(&b, i) / extent(&a, i);
    print_message("extents change by %g %g %g\n", ratio[0], ratio[1], ratio[2]);
    assert_int_equal(a.tet_count, b.tet_count);
    assert_true(fabs(ratio[0] * ratio[1] * ratio[2] - 1) < 1e-8);
    assert_true(fmin(fmin(ratio[0], ratio[1]), ratio[2]) < 0.26);
    assert_true(fmax(fmax(ratio[0], ratio[1]), ratio[2]) > 3.9);
    bw_model_clear(&ctx[0], &a);
    bw_model_clear(&ctx[1], &b);
}

static void no_parameter_difference_is_an_integer(void **state) {
    (void)state;
    bw_context ctx;
    bw_model_options o = plain();
    o.noise = 0;
    bw_model m = make(&ctx, "ball", &o);
    for (size_t t = 0; t < m.tet_count; t++)
        for (int i = 0; i < 12; i++) {
            double d = m.parameter[t][i / 3][i % 3] - m.parameter[0][0][i % 3];
            assert_true(fabs(d) < 1e-9 || fabs(d - round(d)) > 1e-6);
        }
    bw_model_clear(&ctx, &m);
}

static void a_box_has_twelve_feature_edges_and_eight_corners(void **state) {
    (void)state;
    bw_context ctx;
    bw_model_options o = plain();
    o.size = 1;
    o.features = 1;
    bw_model m = make(&ctx, "cuboid", &o);
    int degree[1000] = {0}, corners = 0, inner = 0;
    for (size_t i = 0; i < 2 * m.feature_edge_count; i++) degree[m.feature_edge[i / 2][i % 2]]++;
    for (int v = 0; v < 1000; v++) corners += degree[v] == 3, inner += degree[v] == 2;
    assert_int_equal(m.feature_vertex_count, 8);
    assert_int_equal(corners, 8);
    assert_int_equal((int)m.feature_edge_count - inner, 12);
    bw_model_clear(&ctx, &m);
}

static void bad_options_are_refused(void **state) {
    static const bw_model_options bad[] = {
        {.size = 0, .stretch = 1},
        {.size = 65, .stretch = 1},
        {.size = 1, .stretch = 0},
        {.size = 1, .stretch = NAN},
        {.size = 1, .stretch = 1, .noise = 1.5},
        {.size = 1, .stretch = 1, .noise = -1},
        {.size = 1, .stretch = 1, .perturb = 0.5},
        {.size = 1, .stretch = 1, .scramble = 4},
        {.size = 1, .stretch = 1, .count = 17},
    };
    (void)state;
    for (size_t i = 0; i <= sizeof bad / sizeof *bad; i++) {
        bw_context ctx;
        bw_model m;
        bw_model_options o = i < sizeof bad / sizeof *bad ? bad[i] : plain();
        bw_context_init(&ctx);
        assert_int_equal(bw_model_make(&ctx, i < sizeof bad / sizeof *bad ? "cuboid" : "teapot", &o, &m),
                         BW_E_USAGE);
        bw_model_clear(&ctx, &m);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void every_refused_allocation_is_reported_and_nothing_leaks(void **state) {
    (void)state;
    bw_status status = BW_E_MEMORY;
    for (uint64_t n = 1; status; n++) {
        bw_context ctx;
        bw_model m;
        bw_model_options o = {.size = 1, .stretch = 1, .noise = 0.5, .features = 1};
        bw_context_init(&ctx);
        ctx.memory.fail_at = n;
        status = bw_model_make(&ctx, "ball", &o, &m);
        assert_true(status == BW_OK || status == BW_E_MEMORY);
        assert_true(n < 1000);
        bw_model_clear(&ctx, &m);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static void writing_to_a_full_device_is_an_error(void **state) {
    (void)state;
    FILE *full = fopen("/dev/full", "w");
    if (!full) skip();
    bw_context ctx;
    bw_model_options o = plain();
    bw_model m = make(&ctx, "cuboid", &o);
    assert_int_equal(bw_model_write(&ctx, &m, full), BW_E_IO);
    fclose(full);
    bw_model_clear(&ctx, &m);
}

/* --- damage --- */

static bool same_vertices(const int32_t *a, const int32_t *b) {
    for (int i = 0; i < 4; i++)
        if (a[i] != b[0] && a[i] != b[1] && a[i] != b[2] && a[i] != b[3]) return false;
    return true;
}

static void check_damage(bw_model_damage_kind kind, const bw_model *m, const bw_model *whole,
                         const bw_model_survey *s) {
    size_t last = m->tet_count - 1, twins = 0, out_of_range = 0, nan = 0;
    for (size_t t = 0; t < last; t++) twins += same_vertices(m->tet[t], m->tet[last]);
    for (size_t i = 0; i < 4 * m->tet_count; i++)
        out_of_range += (size_t)m->tet[i / 4][i % 4] >= m->vertex_count;
    for (size_t i = 0; i < 12 * m->tet_count; i++) nan += isnan(m->parameter[i / 12][i / 3 % 4][i % 3]) != 0;
    assert_int_equal(m->tet_count - whole->tet_count,
                     kind == BW_DAMAGE_DUPLICATE || kind == BW_DAMAGE_NONMANIFOLD);
    assert_int_equal(twins, kind == BW_DAMAGE_DUPLICATE);
    assert_int_equal(out_of_range, kind == BW_DAMAGE_INDEX);
    assert_int_equal(nan, kind == BW_DAMAGE_NAN);
    if (!s) return;
    assert_int_equal(s->map_volume_min < 0, kind == BW_DAMAGE_INVERT);
    assert_int_equal(s->facet_tets_max, kind == BW_DAMAGE_NONMANIFOLD || kind == BW_DAMAGE_DUPLICATE ? 3 : 2);
    if (kind == BW_DAMAGE_SEAM) assert_true(s->seam_defect > 1e-4);
    if (kind == BW_DAMAGE_TILT) assert_true(s->seam_defect < 1e-12 && s->alignment_defect > 1e-3);
    if (kind == BW_DAMAGE_INVERT) assert_true(s->seam_defect < 1e-12);
}

static void every_damage_is_the_one_it_is_named_after(void **state) {
    (void)state;
    for (int kind = 0; kind < BW_DAMAGE_COUNT; kind++)
        for (uint64_t seed = 1; seed <= 5; seed++) {
            bw_context ctx;
            bw_model_options o = plain();
            bw_model whole = make(&ctx, "cylinder", &o), m = make(&ctx, "cylinder", &o);
            print_message("damage %d seed %llu\n", kind, (unsigned long long)seed);
            assert_int_equal(bw_model_damage(&ctx, &m, (bw_model_damage_kind)kind, seed), BW_OK);
            bool readable = kind != BW_DAMAGE_INDEX && kind != BW_DAMAGE_NAN;
            bw_model_survey s;
            if (readable) s = look(&ctx, &m);
            check_damage((bw_model_damage_kind)kind, &m, &whole, readable ? &s : NULL);
            bw_model_clear(&ctx, &whole);
            bw_model_clear(&ctx, &m);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_same_options_give_the_same_bytes),
        cmocka_unit_test(a_written_model_reads_back_to_the_same_doubles),
        cmocka_unit_test(noise_takes_facets_off_the_walls),
        cmocka_unit_test(perturb_breaks_seams_and_alignment_as_much_as_asked),
        cmocka_unit_test(scramble_turns_charts),
        cmocka_unit_test(stretch_changes_the_map_and_not_the_mesh),
        cmocka_unit_test(no_parameter_difference_is_an_integer),
        cmocka_unit_test(a_box_has_twelve_feature_edges_and_eight_corners),
        cmocka_unit_test(bad_options_are_refused),
        cmocka_unit_test(every_refused_allocation_is_reported_and_nothing_leaks),
        cmocka_unit_test(writing_to_a_full_device_is_an_error),
        cmocka_unit_test(every_damage_is_the_one_it_is_named_after),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
