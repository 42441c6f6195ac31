/* view.drc decodes, with Draco, to the walls, skins and curves of the complex on one lattice. */
#include "core/encode_kit.h"

#include <math.h>

#include "format/view.h"
#include "format/view_draco.h"

/* A triangle as the viewer gets it: lattice positions, ids. */
typedef struct {
    int32_t at[3][3], id[BW_DRACO_IDS];
} triangle;

typedef struct {
    bw_view_lattice lattice;
    bw_draco_geometry part[3];
} view;

static int compare(const void *a, const void *b) {
    return memcmp(a, b, sizeof(triangle));
}

/* The smallest of the three ways to write it; the sense is kept. Corners may fall together on the lattice. */
static triangle turned(const int32_t at[3][3], const int32_t id[BW_DRACO_IDS], int ids) {
    triangle best = {0};
    for (int first = 0; first < 3; first++) {
        triangle t = {0};
        for (int i = 0; i < 3; i++) memcpy(t.at[i], at[(first + i) % 3], sizeof t.at[i]);
        memcpy(t.id, id, (size_t)ids * sizeof *id);
        if (first == 0 || compare(&t, &best) < 0) best = t;
    }
    return best;
}

static uint64_t little(const char *at, int bytes) {
    uint64_t x = 0;
    for (int i = bytes - 1; i >= 0; i--) x = x << 8 | (uint8_t)at[i];
    return x;
}
static double little_double(const char *at) {
    uint64_t bits = little(at, 8);
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* Reads the container by its description alone. */
static view open_view(encoded *e) {
    static const char *const names[] = {"walls", "skins", "curves"};
    view v;
    size_t size;
    char *file = encode_read(e, "view.drc", &size);
    assert_memory_equal(file, "BWVIEW\r\n", 8);
    assert_int_equal(little(file + 8, 4), 1);
    assert_int_equal(little(file + 12, 4), 3);
    for (int k = 0; k < 3; k++) v.lattice.origin[k] = little_double(file + 16 + 8 * k);
    v.lattice.step = little_double(file + 40);
    uint64_t end = 48 + 3 * 32;
    for (int i = 0; i < 3; i++) {
        const char *entry = file + 48 + 32 * i;
        char name[16] = {0};
        strcpy(name, names[i]);
        assert_memory_equal(entry, name, sizeof name);
        assert_int_equal(little(entry + 16, 8), end); /* parts follow each other without a gap */
        size_t length = little(entry + 24, 8);
        assert_true(end + length <= size);
        kit_expect_ok(&e->ctx, bw_draco_decode(&e->ctx, (uint8_t *)file + end, length, &v.part[i]));
        end += length;
    }
    assert_int_equal(end, size);
    free(file);
    return v;
}

static void close_view(encoded *e, view *v) {
    for (int i = 0; i < 3; i++) bw_draco_geometry_clear(&e->ctx, &v->part[i]);
}

static triangle *decoded(const bw_draco_geometry *g) {
    triangle *t = calloc(g->face_count + 1, sizeof *t);
    for (size_t i = 0; i < g->face_count; i++) {
        int32_t at[3][3];
        for (int k = 0; k < 3; k++) {
            const int32_t *point = g->point[g->face[i][k]];
            memcpy(at[k], g->position[point[0]], sizeof at[k]);
            assert_memory_equal(g->id[point[1]], g->id[g->point[g->face[i][0]][1]],
                                (size_t)g->ids * sizeof(int32_t));
        }
        t[i] = turned((const int32_t(*)[3])at, g->id[g->point[g->face[i][0]][1]], g->ids);
    }
    qsort(t, g->face_count, sizeof *t, compare);
    return t;
}

/* What the view should hold, from the complex: walls (which < 0), or skins. */
static triangle *expected(encoded *e, const bw_view_lattice *lattice, bool skins, size_t *count) {
    const bw_complex *c = &e->complex;
    bw_tessellation t;
    kit_expect_ok(&e->ctx, bw_tessellate(&e->ctx, &t, &e->cells));
    bw_cvertex(*tri)[3] = calloc((size_t)t.largest, sizeof *tri);
    triangle *list = calloc(8 * e->cells.polygon_count, sizeof *list);
    bw_chart chart = {0};
    *count = 0;
    for (size_t patch = 0; patch < c->patch_count; patch++)
        for (int which = 0; which < (skins ? 2 : 1); which++) {
            if (c->patch_block[patch][which] == BW_NONE) continue;
            const int32_t wall_id[4] = {(int32_t)patch, c->patch_block[patch][0], c->patch_block[patch][1],
                                        c->patch_flags[patch]};
            const int32_t skin_id[4] = {c->patch_block[patch][which], (int32_t)patch,
                                        c->patch_side[patch][which]};
            for (size_t i = c->patch_polygon_begin[patch]; i < c->patch_polygon_begin[patch + 1]; i++) {
                bw_polygon p = c->patch_polygon[i];
                bw_tessellation_triangles(&t, p, tri);
                int side = 1;
                if (skins) { /* the cell whose chart sees the polygon on that side of its block */
                    int slot = 1;
                    for (int s = 0; s < 2; s++) {
                        bw_cell cell = e->cells.polygon[p].cell[s];
                        if (cell == BW_NONE || c->cell_block[cell] != c->patch_block[patch][which]) continue;
                        bw_plane plane = bw_cells_polygon_plane(&e->cells, p, bw_cells_tet(&e->cells, cell));
                        plane = bw_transition_plane(bw_complex_chart(c, cell), plane);
                        if (2 * plane.axis + (plane.value != 0) == c->patch_side[patch][which]) slot = s;
                    }
                    kit_expect_ok(&e->ctx, bw_tessellation_side(&e->ctx, &t, &chart, p, slot, &side));
                }
                for (int32_t k = 0; k < t.size[p] - 2; k++) {
                    int32_t at[3][3];
                    for (int j = 0; j < 3; j++) {
                        double x[3];
                        bw_cells_position(&e->cells, tri[k][side < 0 ? 2 - j : j], x);
                        bw_view_quantize(lattice, x, at[j]);
                    }
                    list[(*count)++] =
                        turned((const int32_t(*)[3])at, skins ? skin_id : wall_id, skins ? 3 : 4);
                }
            }
        }
    qsort(list, *count, sizeof *list, compare);
    bw_chart_clear(&e->ctx, &chart);
    bw_tessellation_clear(&e->ctx, &t);
    free(tri);
    return list;
}

static void expect_part(encoded *e, const view *v, bool skins) {
    size_t count;
    triangle *want = expected(e, &v->lattice, skins, &count), *got = decoded(&v->part[skins]);
    assert_int_equal(v->part[skins].ids, skins ? 3 : 4);
    assert_int_equal(v->part[skins].face_count, count);
    assert_memory_equal(got, want, count * sizeof *got);
    free(want), free(got);
}

static void expect_curves(const encoded *e, const view *v) {
    const bw_draco_geometry *g = &v->part[2];
    size_t at = 0;
    assert_int_equal(g->face_count, 0);
    assert_int_equal(g->ids, 3);
    for (size_t arc = 0; arc < e->complex.arc_count; arc++) {
        bw_cvertex v0 = e->complex.node_vertex[e->complex.arc_node[arc][0]];
        for (size_t i = e->complex.arc_edge_begin[arc]; i <= e->complex.arc_edge_begin[arc + 1]; i++, at++) {
            double x[3];
            int32_t q[3];
            assert_true(at < g->point_count);
            bw_cells_position(&e->cells, v0, x);
            bw_view_quantize(&v->lattice, x, q);
            assert_memory_equal(g->position[g->point[at][0]], q, sizeof q);
            const int32_t id[3] = {(int32_t)arc, e->complex.arc_flags[arc], e->complex.arc_quarters[arc]};
            assert_memory_equal(g->id[g->point[at][1]], id, sizeof id);
            if (i == e->complex.arc_edge_begin[arc + 1]) break;
            const bw_cvertex *end = e->cells.edge[e->complex.arc_edge[i]].vertex;
            v0 = end[end[0] == v0];
        }
        at++;
        assert_int_equal(v0, e->complex.node_vertex[e->complex.arc_node[arc][1]]);
    }
    assert_int_equal(at, g->point_count);
}

static void a_view_holds_walls_skins_and_curves_on_one_lattice(void **state) {
    (void)state;
    static const char *const names[] = {"l-shape", "ball", "torus-quarter", "hollow-torus", "tee"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        encoded e;
        encode_prepare(&e, names[i], i < 3 ? 2 : 1, 0.6, i % 2 ? BW_COMPLEX_BC : BW_COMPLEX_MC);
        encode_run(&e);
        view v = open_view(&e);
        bw_view_lattice lattice = bw_view_lattice_of(&e.mesh);
        assert_memory_equal(&v.lattice, &lattice, sizeof lattice);
        expect_part(&e, &v, false);
        expect_part(&e, &v, true);
        expect_curves(&e, &v);
        close_view(&e, &v);
        encode_clear(&e);
    }
}

/* Skins are closed and turned outwards: their signed volumes add up to the model's, and each is positive. */
static void every_skin_is_closed_and_seen_from_outside(void **state) {
    (void)state;
    for (int mirrored = 0; mirrored < 2; mirrored++) {
        encoded e;
        encode_prepare(&e, "ball", 2, 0.6, BW_COMPLEX_MC);
        for (size_t v = 0; mirrored && v < e.mesh.vertex_count; v++) e.mesh.position[v][0] *= -1;
        encode_run(&e);
        view v = open_view(&e);
        double *volume = calloc(e.complex.block_count, sizeof *volume), sum = 0;
        const bw_draco_geometry *g = &v.part[1];
        for (size_t i = 0; i < g->face_count; i++) {
            double x[3][3];
            for (int k = 0; k < 9; k++)
                x[k / 3][k % 3] = g->position[g->point[g->face[i][k / 3]][0]][k % 3] * v.lattice.step;
            volume[g->id[g->point[g->face[i][0]][1]][0]] +=
                (x[0][0] * (x[1][1] * x[2][2] - x[1][2] * x[2][1]) -
                 x[0][1] * (x[1][0] * x[2][2] - x[1][2] * x[2][0]) +
                 x[0][2] * (x[1][0] * x[2][1] - x[1][1] * x[2][0])) /
                6;
        }
        for (size_t b = 0; b < e.complex.block_count; b++) {
            assert_true(volume[b] >= 0.9 * e.report.quality.block_volume.min);
            assert_true(volume[b] <= 1.1 * e.report.quality.block_volume.max);
            sum += volume[b];
        }
        assert_true(fabs(sum - e.report.quality.volume) < 1e-3 * sum);
        free(volume);
        close_view(&e, &v);
        encode_clear(&e);
    }
}

static void the_lattice_spans_the_box_and_keeps_points_inside_it(void **state) {
    (void)state;
    double position[4][3] = {{-1, 5, 0}, {3, 5, 0}, {-1, 6, 0}, {-1, 5, 2}};
    bw_vertex tet[1][4] = {{0, 1, 2, 3}};
    bw_tet_mesh mesh = {.vertex_count = 4, .tet_count = 1, .position = position, .tet = tet};
    bw_view_lattice lattice = bw_view_lattice_of(&mesh);
    assert_true(lattice.origin[0] == -1 && lattice.origin[1] == 5 && lattice.origin[2] == 0 &&
                lattice.step == 4.0 / 65535);
    int32_t q[3];
    bw_view_quantize(&lattice, (double[3]){3, 6, -1e-12}, q);
    assert_int_equal(q[0], 65535);
    assert_int_equal(q[1], 16384);
    assert_int_equal(q[2], 0);
    bw_view_quantize(&lattice, (double[3]){3.0000001, 5, 99}, q);
    assert_int_equal(q[0], 65535);
    assert_int_equal(q[2], 65535);
    for (int i = 0; i < 4; i++) memcpy(position[i], position[0], sizeof position[i]);
    assert_true(bw_view_lattice_of(&mesh).step == 1);
}

static void bytes_that_are_no_stream_are_refused(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    encode_run(&e);
    size_t size;
    char *file = encode_read(&e, "view.drc", &size);
    size_t at = little(file + 48 + 16, 8), length = little(file + 48 + 24, 8);
    for (int damage = 0; damage < 3; damage++) {
        bw_context ctx;
        bw_context_init(&ctx);
        bw_draco_geometry g;
        uint8_t *bytes = (uint8_t *)file + at;
        if (damage == 1) bytes[0] ^= 1;
        kit_expect_status(&ctx,
                          bw_draco_decode(&ctx, bytes,
                                          damage == 0   ? length / 2
                                          : damage == 1 ? length
                                                        : 0,
                                          &g),
                          BW_E_VERSION);
        bw_draco_geometry_clear(&ctx, &g);
        assert_int_equal(ctx.memory.used, 0);
        if (damage == 1) bytes[0] ^= 1;
    }
    free(file);
    encode_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_view_holds_walls_skins_and_curves_on_one_lattice),
        cmocka_unit_test(every_skin_is_closed_and_seen_from_outside),
        cmocka_unit_test(the_lattice_spans_the_box_and_keeps_points_inside_it),
        cmocka_unit_test(bytes_that_are_no_stream_are_refused),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
