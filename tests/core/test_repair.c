/* Local defects are repaired where the fix is certain, wherever they are, and nothing that the map means changes. */
#include "core/fold_kit.h"

static void repair_mesh(sanitized *s, double tolerance) {
    bw_sanitize_options options = {.tolerance = tolerance, .repair = true};
    s->status = bw_sanitize(&s->ctx, &options, &s->mesh, &s->map, &s->report);
}

/* Least ratio of a tet's volume in the map after to before. */
static double thinnest(const folder *f, const sanitized *s) {
    double least = INFINITY, scale = ldexp(1, 3 * (s->map.exponent - f->clean.map.exponent));
    for (size_t t = 0; t < s->mesh.tet_count; t++) {
        double volume[2];
        for (int i = 0; i < 2; i++) {
            int64_t(*u)[3] = i ? s->map.value[t] : f->clean.map.value[t];
            double d[3][3];
            for (int c = 0; c < 9; c++) d[c / 3][c % 3] = (double)(u[c / 3 + 1][c % 3] - u[0][c % 3]);
            volume[i] = d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
                        d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
        }
        least = fmin(least, volume[1] / (scale * volume[0]));
    }
    return least;
}

/* A random vertex that is all of `is` and none of `not` and can move; false if there is none. */
static bool pick(const folder *f, kit_random *random, int is, int not, bw_vertex *v, fold_star *star) {
    for (int i = 0; i < 2000; i++) {
        *v = (bw_vertex)kit_random_below(random, fold_mesh(f)->vertex_count);
        if ((f->kind[*v] & is) != is || f->kind[*v] & not) continue;
        fold_read(f, *v, star);
        if (star->free) return true;
    }
    return false;
}

/* Moves the vertex past its neighbours, by `reach` times the extent of a tet. */
static void fold(const folder *f, kit_random *random, const fold_star *star, double reach, sanitized *s) {
    int64_t extent[3], delta[3];
    fold_extent(f, star, extent);
    for (int k = 0; k < 3; k++) {
        double far = reach * kit_random_range(random, 0.8, 1.2) * (kit_random_below(random, 2) ? 1 : -1);
        delta[k] = star->free & 1 << k ? llrint(far * (double)extent[k]) : 0;
    }
    fold_move(f, star, s, delta);
}

typedef struct {
    const char *place;
    int is, not;
} place;

static const place places[] = {
    {"inside", 0, FOLD_BOUNDARY | FOLD_SINGULAR | FOLD_NEAR_SINGULAR},
    {"on the boundary", FOLD_BOUNDARY, FOLD_SINGULAR},
    {"beside a singular edge", FOLD_NEAR_SINGULAR, FOLD_BOUNDARY},
    {"on an inner singular edge", FOLD_SINGULAR, FOLD_BOUNDARY},
    {"on a sharp edge", FOLD_SINGULAR | FOLD_BOUNDARY, 0},
    {"at a seam", FOLD_SEAM, FOLD_BOUNDARY | FOLD_SINGULAR},
    {"at a seam on the boundary", FOLD_SEAM | FOLD_BOUNDARY, 0},
    {"on a feature edge", FOLD_FEATURE, 0},
};
enum { PLACES = sizeof places / sizeof *places };

/* One fold; true if tets were inverted, and then they have been repaired. */
static bool fold_and_repair(const folder *f, const place *where, kit_random *random, double *least) {
    sanitized s;
    bw_vertex v;
    fold_star star;
    if (!pick(f, random, where->is, where->not, &v, &star)) return false;
    fold_copy(f, &s);
    fold(f, random, &star, 1.3, &s);
    repair_mesh(&s, 1e-6);
    if (s.status) print_message("%s: vertex %d, axes %d\n", where->place, v, star.free);
    kit_expect_ok(&s.ctx, s.status);
    bool folded = s.report.repaired;
    if (folded) {
        assert_true(s.report.defective_tets >= 1 && s.report.region_count == 1 && s.report.vertices_moved >= 1);
        assert_true(s.report.repair_displacement_max > 0 && !s.report.already_exact);
        fold_expect_same_meaning(f, &s);
        check_exact(&s);
        double thin = thinnest(f, &s);
        assert_true(thin > 0);
        *least = fmin(*least, thin);
    }
    drop_sanitized(&s);
    return folded;
}

static void a_fold_is_repaired_wherever_it_is(void **state) {
    static const char *const names[] = {"ball", "cylinder", "torus-quarter", "plus"};
    size_t done[PLACES] = {0};
    kit_random random = kit_random_start(1);
    (void)state;
    for (size_t n = 0; n < sizeof names / sizeof *names; n++)
        for (int scramble = BW_SCRAMBLE_NONE; scramble <= BW_SCRAMBLE_TETS; scramble++) {
            bw_model_options o = model_options(n < 2 ? 2 : 3, 0.5, 0, scramble, kit_random_next(&random));
            folder f;
            double least = INFINITY;
            o.features = 1;
            fold_start(&f, make_model(names[n], &o));
            for (size_t p = 0; p < PLACES; p++)
                for (int i = 0; i < 3; i++) done[p] += fold_and_repair(&f, &places[p], &random, &least);
            print_message("%s, charts %d: thinnest tet has %.3f of its volume\n", names[n], scramble, least);
            fold_end(&f);
        }
    for (size_t p = 0; p < PLACES; p++) {
        print_message("%s: %zu\n", places[p].place, done[p]);
        assert_true(done[p] >= 5);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fold_is_repaired_wherever_it_is),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
