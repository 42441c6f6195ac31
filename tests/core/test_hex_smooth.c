/* Geometric optimization of hex meshes (hex/smooth.h): perturbed ones become positive, nothing gets worse, nothing leaves what holds it. */
#include "core/hex_tets_kit.h"

#include <signal.h>
#include <stdio.h>

#include "hex/quality.h"
#include "hex/smooth.h"

typedef struct {
    bw_hex_mesh mesh;
    hex_tets tets;
    double scale; /* mean length of edges */
} sample;

static void sample_init(bw_context *ctx, int which, sample *s) {
    bw_hex_quality q;
    hex_kit_sample(ctx, which, &s->mesh);
    hex_tets_make(ctx, &s->mesh, &s->tets);
    kit_expect_ok(ctx, bw_hex_measure(ctx, &s->mesh, &q));
    s->scale = q.edge_length.mean;
}

static void sample_clear(bw_context *ctx, sample *s) {
    hex_tets_clear(ctx, &s->tets);
    bw_hex_mesh_clear(ctx, &s->mesh);
    assert_int_equal(ctx->memory.used, 0);
}

/* Vertices leave their place by up to `by` mean lengths of edges along each axis, then return to what holds them. */
static void perturb(sample *s, double by, uint64_t stream) {
    kit_random random = kit_random_start(stream);
    for (size_t v = 0; v < s->mesh.vertex_count; v++) {
        double direction[3][3], *p = s->mesh.position[v];
        bw_hex_surface_hold hold = bw_hex_surface_holds(&s->tets.surface, s->mesh.held[v], s->mesh.carrier[v], p);
        for (int k = 0; k < 3 && hold.held != BW_HELD_POINT; k++) p[k] += s->scale * kit_random_range(&random, -by, by);
        bw_hex_surface_project(&s->tets.surface, hold, p, direction);
    }
}

static bw_smooth_report smooth(bw_context *ctx, sample *s) {
    bw_smooth_options options;
    bw_smooth_report report;
    bw_smooth_options_defaults(&options);
    kit_expect_ok(ctx, bw_hex_smooth(ctx, &s->mesh, &s->tets.surface, &options, &report));
    return report;
}

static void perturbed_meshes_become_positive_on_their_surface(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        sample s;
        bw_hex_distance d;
        sample_init(&ctx, i, &s);
        perturb(&s, 0.4, (uint64_t)(30 + i));
        bw_smooth_report r = smooth(&ctx, &s);
        printf("%s: %llu of %zu hexes not positive, least %.3f; after: %llu, least %.3f, mean %.3f\n", hex_kit_names[i],
               (unsigned long long)r.before.hexes, s.mesh.hex_count, r.before.least, (unsigned long long)r.after.hexes, r.after.least, r.after.mean);
        assert_true(r.before.hexes > 0);
        assert_int_equal(r.after.hexes, 0);
        assert_true(r.after.least > 0.1 && r.moved_max > 0 && r.off_max < 1e-12 && r.left == 0);
        kit_expect_ok(&ctx, bw_hex_measure_distance(&ctx, &s.mesh, &s.tets.surface, &d));
        for (size_t v = 0; v < s.mesh.vertex_count; v++) {
            bw_bvh_hit hit;
            if (s.mesh.held[v] == BW_HELD_NOT) continue;
            bw_bvh_closest(&s.tets.surface.triangles, BW_NONE, s.mesh.position[v], INFINITY, &hit);
            assert_true(hit.squared < 1e-24);
        }
        sample_clear(&ctx, &s);
    }
}

static void the_report_tells_what_is_measured(void **state) {
    (void)state;
    bw_context ctx;
    sample s;
    bw_hex_quality before, after;
    bw_context_init(&ctx);
    sample_init(&ctx, HEX_KIT_O_GRID, &s);
    perturb(&s, 0.3, 40);
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &s.mesh, &before));
    bw_smooth_report r = smooth(&ctx, &s);
    kit_expect_ok(&ctx, bw_hex_measure(&ctx, &s.mesh, &after));
    assert_int_equal(r.before.hexes, before.nonpositive);
    assert_int_equal(r.after.hexes, after.nonpositive);
    assert_float_equal(r.before.least, before.scaled_jacobian.min, 1e-15);
    assert_float_equal(r.after.least, after.scaled_jacobian.min, 1e-15);
    assert_float_equal(r.after.mean, after.scaled_jacobian.mean, 1e-12);
    assert_true(r.after.mean > r.before.mean && r.iterations > 0 && r.rounds > 0);
    sample_clear(&ctx, &s);
}

/* Points are held where they are, here where they should not be: what can be mended differs. */
static void no_mesh_gets_more_bad_hexes_or_corners(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < 2 * HEX_KIT_COUNT; i++) {
        sample s;
        kit_random random = kit_random_start((uint64_t)(200 + i));
        sample_init(&ctx, i % HEX_KIT_COUNT, &s);
        for (size_t v = 0; v < s.mesh.vertex_count; v++)
            for (int k = 0; k < 3; k++)
                if (s.mesh.held[v] == BW_HELD_POINT) s.mesh.position[v][k] += kit_random_range(&random, -3, 3) * s.scale;
        perturb(&s, 0.4, (uint64_t)(220 + i));
        bw_smooth_report r = smooth(&ctx, &s);
        printf("%s: %llu hexes, %llu corners not positive; after: %llu, %llu\n", hex_kit_names[i % HEX_KIT_COUNT], (unsigned long long)r.before.hexes,
               (unsigned long long)r.before.corners, (unsigned long long)r.after.hexes, (unsigned long long)r.after.corners);
        assert_true(r.before.corners > 0);
        assert_true(r.after.corners <= r.before.corners && r.after.hexes <= r.before.hexes);
        sample_clear(&ctx, &s);
    }
}

static void a_good_mesh_stays_at_least_as_good(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        sample s;
        sample_init(&ctx, i, &s);
        bw_smooth_report r = smooth(&ctx, &s);
        assert_int_equal(r.before.hexes, 0);
        assert_int_equal(r.after.hexes, 0);
        assert_true(r.after.mean + 2 * fmin(r.after.least, 0.2) + r.after.least / 50 >= r.before.mean + 2 * fmin(r.before.least, 0.2) + r.before.least / 50);
        sample_clear(&ctx, &s);
    }
}

static void the_result_is_the_same_at_any_number_of_threads(void **state) {
    (void)state;
    bw_context ctx;
    sample s;
    bw_context_init(&ctx);
    sample_init(&ctx, HEX_KIT_TORUS, &s);
    bw_hex_mesh large;
    hex_kit_cube(&ctx, 12, &large); /* several ranges of hexes and vertices */
    hex_tets tets;
    hex_kit_hold(&ctx, &large);
    hex_tets_make(&ctx, &large, &tets);
    sample *both[2] = {&s, &(sample){large, tets, 1.0 / 12}};
    for (int i = 0; i < 2; i++) {
        size_t bytes = both[i]->mesh.vertex_count * sizeof *both[i]->mesh.position;
        double *start = malloc(bytes), *first = malloc(bytes);
        perturb(both[i], 0.4, 50);
        memcpy(start, both[i]->mesh.position, bytes);
        for (int threads = 1; threads <= 3; threads++) {
            memcpy(both[i]->mesh.position, start, bytes);
            ctx.threads = threads;
            smooth(&ctx, both[i]);
            if (threads == 1)
                memcpy(first, both[i]->mesh.position, bytes);
            else
                assert_memory_equal(first, both[i]->mesh.position, bytes);
        }
        assert_true(memcmp(start, first, bytes) != 0);
        free(start), free(first);
    }
    hex_tets_clear(&ctx, &tets);
    bw_hex_mesh_clear(&ctx, &large);
    sample_clear(&ctx, &s);
}

/* Of a mesh larger than `whole`, only the surroundings of hexes that need it move. */
static void a_large_mesh_is_mended_where_it_is_broken(void **state) {
    (void)state;
    enum { N = 16 };
    bw_context ctx;
    sample s = {.scale = 1.0 / N};
    bw_smooth_options options;
    bw_smooth_report r;
    size_t moved = 0;
    bw_context_init(&ctx);
    hex_kit_cube(&ctx, N, &s.mesh);
    hex_kit_hold(&ctx, &s.mesh);
    hex_tets_make(&ctx, &s.mesh, &s.tets);
    bw_hvertex broken = s.mesh.hex[N * N * N / 2 + N * N / 2 + N / 2][0];
    s.mesh.position[broken][1] += 1.7 * s.scale;
    size_t bytes = s.mesh.vertex_count * sizeof *s.mesh.position;
    double(*start)[3] = malloc(bytes);
    memcpy(start, s.mesh.position, bytes);
    bw_smooth_options_defaults(&options);
    options.whole = 1000;
    kit_expect_ok(&ctx, bw_hex_smooth(&ctx, &s.mesh, &s.tets.surface, &options, &r));
    for (size_t v = 0; v < s.mesh.vertex_count; v++) moved += memcmp(start[v], s.mesh.position[v], sizeof start[v]) != 0;
    printf("%llu hexes not positive, %zu of %zu vertices moved\n", (unsigned long long)r.before.hexes, moved, s.mesh.vertex_count);
    assert_true(r.before.hexes > 0 && r.after.hexes == 0 && r.after.least > 0.2);
    assert_true(moved > 10 && moved < s.mesh.vertex_count / 2);
    free(start);
    sample_clear(&ctx, &s);
}

/* A cube with the faces x = n and z = n folded into one plane: hexes along the edge between them have two faces in it, and cannot be positive. */
static void unfold(bw_hex_mesh *mesh, int n) {
    for (size_t v = 0; v < mesh->vertex_count; v++) {
        size_t m = (size_t)n + 1;
        double u = n - (double)(v % m), y = (double)(v / m % m), w = n - (double)(v / m / m), r = sqrt(u * u + w * w), angle = 2 * atan2(w, u);
        mesh->position[v][0] = r * cos(angle), mesh->position[v][1] = -y, mesh->position[v][2] = w > 0 && u > 0 ? -r * sin(angle) : 0;
    }
}

static void vertices_leave_the_surface_only_where_they_must_and_as_far_as_they_may(void **state) {
    (void)state;
    enum { N = 4 };
    bw_context ctx;
    bw_smooth_report r[2];
    bw_context_init(&ctx);
    for (int i = 0; i < 2; i++) {
        sample s = {.scale = 1};
        bw_smooth_options options;
        hex_kit_cube(&ctx, N, &s.mesh);
        unfold(&s.mesh, N);
        hex_kit_hold(&ctx, &s.mesh);
        hex_tets_make(&ctx, &s.mesh, &s.tets);
        bw_smooth_options_defaults(&options);
        options.leave = i ? 0.1 : 0;
        kit_expect_ok(&ctx, bw_hex_smooth(&ctx, &s.mesh, &s.tets.surface, &options, &r[i]));
        printf("leave %g: hexes %llu, then %llu; %llu vertices left, by %g at most\n", options.leave, (unsigned long long)r[i].before.hexes,
               (unsigned long long)r[i].after.hexes, (unsigned long long)r[i].left, r[i].off_max);
        sample_clear(&ctx, &s);
    }
    assert_int_equal(r[0].before.hexes, N);
    assert_true(r[0].after.hexes == N && r[0].left == 0 && r[0].off_max < 1e-12);
    assert_true(r[1].after.hexes == 0 && r[1].left > 0 && r[1].off_max > 1e-6 && r[1].off_max < 0.2);
}

static void only_positions_change(void **state) {
    (void)state;
    bw_context ctx;
    sample s;
    bw_hex_mesh other;
    bw_context_init(&ctx);
    sample_init(&ctx, HEX_KIT_FIVE, &s);
    hex_kit_sample(&ctx, HEX_KIT_FIVE, &other);
    perturb(&s, 0.4, 60);
    smooth(&ctx, &s);
    assert_memory_equal(s.mesh.hex, other.hex, other.hex_count * sizeof *other.hex);
    assert_memory_equal(s.mesh.held, other.held, other.vertex_count);
    assert_memory_equal(s.mesh.ijk, other.ijk, other.hex_count * sizeof *other.ijk);
    bw_hex_mesh_clear(&ctx, &other);
    sample_clear(&ctx, &s);
}

static void a_cancelled_run_leaves_the_mesh_as_it_was(void **state) {
    (void)state;
    bw_context ctx;
    sample s;
    bw_smooth_options options;
    bw_smooth_report report;
    volatile sig_atomic_t cancel = 1;
    bw_context_init(&ctx);
    sample_init(&ctx, HEX_KIT_GRID, &s);
    perturb(&s, 0.4, 70);
    size_t bytes = s.mesh.vertex_count * sizeof *s.mesh.position;
    double *start = malloc(bytes);
    memcpy(start, s.mesh.position, bytes);
    ctx.cancel = &cancel;
    bw_smooth_options_defaults(&options);
    kit_expect_status(&ctx, bw_hex_smooth(&ctx, &s.mesh, &s.tets.surface, &options, &report), BW_E_CANCELLED);
    assert_memory_equal(start, s.mesh.position, bytes);
    free(start);
    sample_clear(&ctx, &s);
}

static bw_status smooth_copy(bw_context *ctx, void *user) {
    sample *s = user;
    bw_smooth_options options = {.rounds = 1, .work = 1, .whole = 1000, .leave = 0.1};
    bw_smooth_report report;
    return bw_hex_smooth(ctx, &s->mesh, &s->tets.surface, &options, &report);
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    sample s;
    bw_context_init(&ctx);
    sample_init(&ctx, HEX_KIT_FIVE, &s);
    perturb(&s, 0.4, 80);
    assert_true(kit_fail_each_allocation(smooth_copy, &s) > 15);
    sample_clear(&ctx, &s);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(perturbed_meshes_become_positive_on_their_surface),
    cmocka_unit_test(the_report_tells_what_is_measured),
    cmocka_unit_test(no_mesh_gets_more_bad_hexes_or_corners),
    cmocka_unit_test(a_good_mesh_stays_at_least_as_good),
    cmocka_unit_test(the_result_is_the_same_at_any_number_of_threads),
    cmocka_unit_test(a_large_mesh_is_mended_where_it_is_broken),
    cmocka_unit_test(vertices_leave_the_surface_only_where_they_must_and_as_far_as_they_may),
    cmocka_unit_test(only_positions_change),
    cmocka_unit_test(a_cancelled_run_leaves_the_mesh_as_it_was),
    cmocka_unit_test(each_allocation_may_fail),
};
KIT_MAIN(tests)
