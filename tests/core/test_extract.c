/* Extraction against straight walks through the tets in rational numbers: same vertices, same hexes, same places. */
#include "core/extract_kit.h"

#include <gmp.h>

#include "hex/topology.h"

/* ---- the second way: everything in rationals, one point at a time ---- */

typedef struct {
    mpq_t at[3];
} point;

static void point_init(point *p) {
    for (int k = 0; k < 3; k++) mpq_init(p->at[k]);
}
static void point_clear(point *p) {
    for (int k = 0; k < 3; k++) mpq_clear(p->at[k]);
}

/* Barycentric coordinates of a point in units of hexes (1/subdivide of a unit). */
static void barycentric(const extractable *x, bw_tet t, int32_t subdivide, const point *p, mpq_t out[4]) {
    mpq_t d[4][3], term, scale;
    mpq_inits(term, scale, NULL);
    mpq_set_si(scale, subdivide, 1);
    mpq_div_2exp(scale, scale, (mp_bitcnt_t)x->igm.map.exponent);
    for (int i = 0; i < 12; i++) {
        mpq_init(d[i / 3][i % 3]);
        mpq_set_si(d[i / 3][i % 3], x->igm.map.value[t][i / 3][i % 3], 1);
        mpq_mul(d[i / 3][i % 3], d[i / 3][i % 3], scale);
        mpq_sub(d[i / 3][i % 3], d[i / 3][i % 3], p->at[i % 3]);
    }
    mpq_t sum;
    mpq_init(sum);
    for (int i = 0; i < 4; i++) { /* volume of the tet with corner i at p: determinant of the other three, seen from p */
        static const int others[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}};
        mpq_set_si(out[i], 0, 1);
        for (int k = 0; k < 6; k++) {
            static const int order[6][3] = {{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}};
            mpq_mul(term, d[others[i][0]][order[k][0]], d[others[i][1]][order[k][1]]);
            mpq_mul(term, term, d[others[i][2]][order[k][2]]);
            if (k < 3) mpq_sub(out[i], out[i], term);
            else mpq_add(out[i], out[i], term);
        }
        mpq_add(sum, sum, out[i]);
    }
    for (int i = 0; i < 4; i++) mpq_div(out[i], out[i], sum);
    for (int i = 0; i < 12; i++) mpq_clear(d[i / 3][i % 3]);
    mpq_clears(term, scale, sum, NULL);
}

static void carry(const extractable *x, bw_tet t, bw_facet f, int32_t subdivide, point *p) {
    bw_transition across = bw_grid_map_across(&x->igm.mesh, &x->igm.map, f, t);
    mpq_t turned[3], shift;
    mpq_init(shift);
    for (int k = 0; k < 3; k++) {
        mpq_init(turned[k]);
        mpq_set(turned[k], p->at[bw_rotation_axis[across.rotation][k]]);
        if (bw_rotation_sign[across.rotation][k] < 0) mpq_neg(turned[k], turned[k]);
        mpq_set_si(shift, across.shift[k] * subdivide, 1);
        mpq_div_2exp(shift, shift, (mp_bitcnt_t)x->igm.map.exponent);
        mpq_add(turned[k], turned[k], shift);
    }
    for (int k = 0; k < 3; k++) mpq_set(p->at[k], turned[k]), mpq_clear(turned[k]);
    mpq_clear(shift);
}

/* Walks straight from `from` to `to`, leaving *t and *to in the tet and chart of its end; false if it meets an edge. */
static bool walk(const extractable *x, bw_tet *t, int32_t subdivide, point *from, point *to) {
    mpq_t a[4], b[4], at[4];
    bool clean = true, there = false;
    for (int i = 0; i < 4; i++) mpq_inits(a[i], b[i], at[i], NULL);
    while (clean && !there) {
        int leave = -1;
        barycentric(x, *t, subdivide, from, a), barycentric(x, *t, subdivide, to, b);
        for (int i = 0; i < 4; i++) {
            if (mpq_sgn(b[i]) >= 0) continue;
            mpq_sub(at[i], a[i], b[i]);
            mpq_div(at[i], a[i], at[i]);
            int order = leave < 0 ? -1 : mpq_cmp(at[i], at[leave]);
            clean = clean && order != 0;
            if (order < 0) leave = i, clean = true;
        }
        there = leave < 0;
        if (there || !clean) break;
        bw_facet f = x->igm.mesh.tet_facet[*t][leave];
        bw_tet next = bw_tet_across(&x->igm.mesh, f, *t);
        if (next == BW_NONE) fail_msg("%s: a hex reaches outside", x->name);
        carry(x, *t, f, subdivide, from), carry(x, *t, f, subdivide, to);
        *t = next;
    }
    for (int i = 0; i < 4; i++) mpq_clears(a[i], b[i], at[i], NULL);
    return clean;
}

/* The point as text: the mesh vertices whose weights are not zero, ascending, with their weights. Also where it is in space. */
static char *name_of(const extractable *x, bw_tet t, int32_t subdivide, const point *p, double position[3]) {
    mpq_t w[4];
    char *name = calloc(1, 2000);
    const bw_vertex *v = x->igm.mesh.tet[t];
    for (int i = 0; i < 4; i++) mpq_init(w[i]);
    barycentric(x, t, subdivide, p, w);
    memset(position, 0, 3 * sizeof *position);
    for (bw_vertex last = -1;;) {
        int best = -1;
        for (int i = 0; i < 4; i++)
            if (v[i] > last && mpq_sgn(w[i]) && (best < 0 || v[i] < v[best])) best = i;
        if (best < 0) break;
        char *digits = mpq_get_str(NULL, 10, w[best]);
        snprintf(name + strlen(name), 2000 - strlen(name), "%d:%s ", v[best], digits);
        free(digits);
        for (int k = 0; k < 3; k++) position[k] += mpq_get_d(w[best]) * x->igm.mesh.position[v[best]][k];
        last = v[best];
    }
    for (int i = 0; i < 4; i++) mpq_clear(w[i]);
    return name;
}

/* A point inside the tet and inside the cube around `centre`, of which the tet has the centre. */
static void start_inside(const extractable *x, bw_tet t, int32_t subdivide, const point *centre, kit_random *random, point *out) {
    long weight[4], sum = 0;
    double reach = 1;
    mpq_t d, scale;
    mpq_inits(d, scale, NULL);
    for (int i = 0; i < 4; i++) sum += weight[i] = 1 + (long)kit_random_below(random, 1000);
    mpq_set_si(scale, subdivide, 1);
    mpq_div_2exp(scale, scale, (mp_bitcnt_t)x->igm.map.exponent);
    for (int k = 0; k < 3; k++) {
        mpq_set_si(out->at[k], 0, 1);
        for (int i = 0; i < 4; i++) {
            mpq_set_si(d, x->igm.map.value[t][i][k], 1);
            mpq_mul(d, d, scale);
            mpq_sub(d, d, centre->at[k]);
            mpq_t w;
            mpq_init(w);
            mpq_set_si(w, weight[i], (unsigned long)sum);
            mpq_canonicalize(w);
            mpq_mul(d, d, w);
            mpq_add(out->at[k], out->at[k], d);
            mpq_clear(w);
        }
        reach = fmax(reach, fabs(mpq_get_d(out->at[k])));
    }
    mpq_set_si(d, 1, 3 * (unsigned long)ceil(reach));
    for (int k = 0; k < 3; k++) {
        mpq_mul(out->at[k], out->at[k], d);
        mpq_add(out->at[k], out->at[k], centre->at[k]);
    }
    mpq_clears(d, scale, NULL);
}

typedef struct {
    char *name;
    bw_hvertex vertex;
} found;

static int by_name(const void *a, const void *b) { return strcmp(((const found *)a)->name, ((const found *)b)->name); }

static char *find_corner(const extractable *x, size_t h, int corner, kit_random *random, double position[3]) {
    int32_t n = x->mesh.subdivide;
    for (int tries = 0;; tries++) {
        bw_tet t = x->origin.tet[h];
        point from, to, centre;
        point_init(&from), point_init(&to), point_init(&centre);
        for (int k = 0; k < 3; k++) {
            mpq_set_si(to.at[k], x->origin.low[h][k] + (corner >> k & 1), 1);
            mpq_set_si(centre.at[k], 2 * x->origin.low[h][k] + 1, 2);
        }
        start_inside(x, t, n, &centre, random, &from);
        bool good = walk(x, &t, n, &from, &to);
        char *name = good ? name_of(x, t, n, &to, position) : NULL;
        point_clear(&from), point_clear(&to), point_clear(&centre);
        if (good) return name;
        if (tries == 50) fail_msg("%s: no walk to a corner of hex %zu", x->name, h);
    }
}

/* Centres must lie in their tets, and no two be one point. */
static void check_centres(const extractable *x) {
    found *all = calloc(x->mesh.hex_count, sizeof *all);
    for (size_t h = 0; h < x->mesh.hex_count; h++) {
        point p;
        double position[3];
        mpq_t w[4];
        point_init(&p);
        for (int k = 0; k < 3; k++) mpq_set_si(p.at[k], 2 * x->origin.low[h][k] + 1, 2);
        for (int i = 0; i < 4; i++) mpq_init(w[i]);
        barycentric(x, x->origin.tet[h], x->mesh.subdivide, &p, w);
        for (int i = 0; i < 4; i++) {
            if (mpq_sgn(w[i]) < 0) fail_msg("%s: the centre of hex %zu is not in its tet", x->name, h);
            mpq_clear(w[i]);
        }
        all[h].name = name_of(x, x->origin.tet[h], x->mesh.subdivide, &p, position);
        point_clear(&p);
    }
    qsort(all, x->mesh.hex_count, sizeof *all, by_name);
    for (size_t h = 0; h < x->mesh.hex_count; h++) {
        if (h && !strcmp(all[h].name, all[h - 1].name)) fail_msg("%s: two hexes have one centre: %s", x->name, all[h].name);
        if (h) free(all[h - 1].name);
    }
    if (x->mesh.hex_count) free(all[x->mesh.hex_count - 1].name);
    free(all);
}

static void check_against_walks(const extractable *x) {
    const bw_hex_mesh *m = &x->mesh;
    kit_random random = kit_random_start(9);
    found *all = calloc(8 * m->hex_count, sizeof *all);
    check_centres(x);
    for (size_t i = 0; i < 8 * m->hex_count; i++) {
        double position[3];
        all[i] = (found){find_corner(x, i / 8, (int)(i % 8), &random, position), m->hex[i / 8][i % 8]};
        const double *p = m->position[all[i].vertex];
        for (int k = 0; k < 3; k++)
            if (!(fabs(p[k] - position[k]) <= 1e-9 * (1 + fabs(position[k]))))
                fail_msg("%s: vertex %d is at %g %g %g, not %g %g %g", x->name, all[i].vertex, p[0], p[1], p[2], position[0], position[1], position[2]);
    }
    qsort(all, 8 * m->hex_count, sizeof *all, by_name);
    uint8_t *used = calloc(m->vertex_count, 1);
    for (size_t i = 0; i < 8 * m->hex_count; i++) {
        bool fresh = !i || strcmp(all[i].name, all[i - 1].name);
        if (fresh && used[all[i].vertex]++) fail_msg("%s: vertex %d is two points, %s and another", x->name, all[i].vertex, all[i].name);
        if (!fresh && all[i].vertex != all[i - 1].vertex) fail_msg("%s: %s is vertices %d and %d", x->name, all[i].name, all[i].vertex, all[i - 1].vertex);
    }
    for (size_t v = 0; v < m->vertex_count; v++)
        if (!used[v]) fail_msg("%s: vertex %zu is in no hex", x->name, v);
    for (size_t i = 0; i < 8 * m->hex_count; i++) free(all[i].name);
    free(all), free(used);
}

/* ---- properties ---- */

static void models_agree_with_walks_in_rationals(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++) {
        extractable x;
        extractable_open(&x, models[i].name, 1, i % 3 ? 0.8 : 0, 0, i);
        extractable_extract(&x, 1);
        if (x.igm.mesh.tet_count < 2000) check_against_walks(&x);
        extractable_drop(&x);
        if (x.igm.mesh.tet_count < 400) {
            extractable_extract(&x, 2 + (int32_t)(i % 2));
            check_against_walks(&x);
        }
        extractable_close(&x);
    }
}

static void flat_manifolds_agree_with_walks_in_rationals(void **state) {
    (void)state;
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        extractable x;
        extractable_open_flat(&x, &flat_shapes[i], 0.2, i);
        x.igm.map.exponent++; /* a unit is a cell: hexes are larger than tets */
        extractable_extract(&x, 1);
        check_against_walks(&x);
        extractable_close(&x);
    }
}

static void meshes_are_valid_and_of_the_right_number(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int32_t n = 1; n <= 3; n++) {
            extractable x;
            extractable_open(&x, models[i].name, 2, 0.7, (int)(i % 2), i);
            extractable_extract(&x, n);
            kit_expect_ok(&x.ctx, bw_hex_mesh_check(&x.ctx, &x.mesh));
            assert_int_equal(x.mesh.subdivide, n);
            bw_topology tets, hexes;
            kit_expect_ok(&x.ctx, bw_tet_mesh_topology(&x.ctx, &x.igm.mesh, &tets));
            kit_expect_ok(&x.ctx, bw_hex_mesh_topology(&x.ctx, &x.mesh, &hexes));
            assert_int_equal(tets.euler, models[i].euler);
            assert_int_equal(hexes.euler, models[i].euler);
            assert_int_equal(tets.components, 1);
            assert_int_equal(hexes.components, 1);
            extractable_close(&x);
        }
}

static void maps_that_leave_the_grid_are_refused(void **state) {
    (void)state;
    extractable x;
    extractable_open(&x, "cylinder", 2, 0.5, 1, 4);
    kit_expect_ok(&x.ctx, bw_igm_check(&x.ctx, &x.igm));
    for (size_t t = 0; t < x.igm.mesh.tet_count; t++)
        for (int i = 0; i < 4; i++) x.igm.map.value[t][i][1] += (int64_t)1 << (x.igm.map.exponent - 1);
    assert_int_equal(bw_igm_check(&x.ctx, &x.igm), BW_E_CHECK);
    x.ctx.error.status = BW_OK;
    for (size_t t = 0; t < x.igm.mesh.tet_count; t++)
        for (int i = 0; i < 4; i++) x.igm.map.value[t][i][1] -= (int64_t)1 << (x.igm.map.exponent - 1);
    kit_expect_ok(&x.ctx, bw_igm_check(&x.ctx, &x.igm));
    x.igm.map.exponent += 3; /* a unit of eight cells, which nothing here is a multiple of */
    assert_int_equal(bw_igm_check(&x.ctx, &x.igm), BW_E_CHECK);
    extractable_close(&x);
}

static void threads_change_nothing(void **state) {
    (void)state;
    extractable x[3];
    for (int i = 0; i < 3; i++) {
        extractable_open(&x[i], "torus", 4, 0.7, 0, 7);
        x[i].ctx.threads = i == 0 ? 1 : i == 1 ? 2 : 7;
        extractable_extract(&x[i], 2);
        const bw_hex_mesh *a = &x[0].mesh, *b = &x[i].mesh;
        assert_int_equal(a->vertex_count, b->vertex_count);
        assert_int_equal(a->hex_count, b->hex_count);
        assert_memory_equal(a->position, b->position, a->vertex_count * sizeof *a->position);
        assert_memory_equal(a->hex, b->hex, a->hex_count * sizeof *a->hex);
        assert_memory_equal(a->held, b->held, a->vertex_count);
        assert_memory_equal(a->carrier, b->carrier, a->vertex_count * sizeof *a->carrier);
    }
    for (int i = 0; i < 3; i++) extractable_close(&x[i]);
}

static void too_many_hexes_are_refused_with_their_number(void **state) {
    (void)state;
    extractable x;
    extractable_open(&x, "cuboid", 3, 0.5, 0, 1);
    assert_int_equal(bw_hex_extract(&x.ctx, &x.igm, 10, 100, &x.mesh, &x.origin), BW_E_LIMIT);
    assert_non_null(strstr(x.ctx.error.message, "hexes, more than 100"));
    extractable_close(&x);
}

static bw_status extract_again(bw_context *ctx, void *user) {
    bw_hex_mesh mesh;
    bw_hex_origin origin;
    bw_status status = bw_hex_extract(ctx, user, 1, 100000, &mesh, &origin);
    bw_hex_mesh_clear(ctx, &mesh);
    bw_hex_origin_clear(ctx, &origin);
    return status;
}

static void each_allocation_may_fail(void **state) {
    (void)state;
    extractable x;
    extractable_open(&x, "cuboid", 2, 0.5, 0, 1);
    assert_true(kit_fail_each_allocation(extract_again, &x.igm) > 15);
    extractable_close(&x);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(models_agree_with_walks_in_rationals),
        cmocka_unit_test(flat_manifolds_agree_with_walks_in_rationals),
        cmocka_unit_test(meshes_are_valid_and_of_the_right_number),
        cmocka_unit_test(maps_that_leave_the_grid_are_refused),
        cmocka_unit_test(threads_change_nothing),
        cmocka_unit_test(too_many_hexes_are_refused_with_their_number),
        cmocka_unit_test(each_allocation_may_fail),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
