/* blocks.json describes cuboids that fit together: everything here is read from the file alone. */
#include "core/encode_kit.h"

#include <jansson.h>
#include <math.h>

#include "format/blocks_json.h"

static const struct {
    const char *name;
    bw_complex_kind kind;
} samples[] = {{"l-shape", BW_COMPLEX_MC},       {"plus", BW_COMPLEX_MC},
               {"cylinder", BW_COMPLEX_BC},      {"ball", BW_COMPLEX_MC},
               {"torus-quarter", BW_COMPLEX_MC}, {"torus-half", BW_COMPLEX_BC},
               {"hollow-torus", BW_COMPLEX_MC},  {"tee", BW_COMPLEX_MC}};

static json_t *file; /* the file at hand */

static json_t *item(const char *list, json_int_t i) {
    json_t *x = json_array_get(json_object_get(file, list), (size_t)i);
    if (!x) fail_msg("there is no %s %lld", list, (long long)i);
    return x;
}
static size_t count(const char *list) {
    return json_array_size(json_object_get(file, list));
}
static json_int_t number(const json_t *object, const char *key, size_t i) {
    const json_t *list = json_object_get(object, key);
    assert_true(i < json_array_size(list));
    return json_integer_value(json_array_get(list, i));
}

/* Walks a chain from one node to another; returns its length in grid units. */
static json_int_t walk(const json_t *chain, json_int_t from, json_int_t to) {
    json_int_t length = 0;
    for (size_t i = 0; i < json_array_size(chain); i++) {
        json_int_t use = json_integer_value(json_array_get(chain, i));
        bool reversed = use < 0;
        json_t *arc = item("arcs", reversed ? -1 - use : use);
        assert_int_equal(number(arc, "nodes", reversed), from);
        from = number(arc, "nodes", !reversed);
        length += json_integer_value(json_object_get(arc, "length_grid"));
    }
    assert_int_equal(from, to);
    return length;
}

static void check_patch(json_int_t p) {
    json_t *patch = item("patches", p), *chains = json_object_get(patch, "chains");
    for (size_t i = 0; i < 4; i++)
        assert_int_equal(walk(json_array_get(chains, i), number(patch, "corners", i),
                              number(patch, "corners", (i + 1) % 4)),
                         number(patch, "extent_grid", i % 2));
    size_t sides = json_array_size(json_object_get(patch, "blocks"));
    assert_int_equal(sides, json_is_true(json_object_get(patch, "boundary")) ? 1 : 2);
    for (size_t i = 0; i < sides; i++) { /* the block lists it on that side */
        json_t *list = json_array_get(json_object_get(item("blocks", number(patch, "blocks", i)), "sides"),
                                      (size_t)number(patch, "sides", i));
        size_t found = 0;
        for (size_t k = 0; k < json_array_size(list); k++)
            found += json_integer_value(json_array_get(list, k)) == p;
        assert_true(found);
    }
}

/* The transition carries the side of the first block, seen from inside, to the side of the second, seen from
 * outside. */
static void check_transition(json_int_t p) {
    json_t *patch = item("patches", p), *t = json_object_get(patch, "transition");
    assert_int_equal(json_is_null(t), json_is_true(json_object_get(patch, "boundary")));
    if (json_is_null(t)) return;
    int axis[3], sign[3], seen = 0;
    for (size_t k = 0; k < 3; k++) {
        json_int_t r = number(t, "rotation", k);
        sign[k] = r < 0 ? -1 : 1;
        axis[k] = (int)llabs(r) - 1;
        seen |= 1 << axis[k];
    }
    assert_int_equal(seen, 7);
    int even = (axis[1] - axis[0] + 3) % 3 == 1 ? 1 : -1;
    assert_int_equal(even * sign[0] * sign[1] * sign[2], 1);
    json_int_t side[2] = {number(patch, "sides", 0), number(patch, "sides", 1)}, value[2];
    for (int i = 0; i < 2; i++)
        value[i] = side[i] & 1 ? number(item("blocks", number(patch, "blocks", (size_t)i)), "extent_grid",
                                        (size_t)side[i] / 2)
                               : 0;
    size_t to = (size_t)side[1] / 2;
    assert_int_equal(axis[to], side[0] / 2);
    assert_int_equal(sign[to] * value[0] + number(t, "shift_grid", to), value[1]);
    int outward[2] = {side[0] & 1 ? 1 : -1, side[1] & 1 ? 1 : -1};
    assert_int_equal(sign[to] * outward[0], -outward[1]);
}

static void check_block(json_int_t b) {
    json_t *block = item("blocks", b), *edges = json_object_get(block, "edges"),
           *sides = json_object_get(block, "sides");
    for (int e = 0; e < 12; e++) {
        int axis = e / 4, low = (e & 1) << (axis + 1) % 3 | (e >> 1 & 1) << (axis + 2) % 3;
        assert_int_equal(walk(json_array_get(edges, (size_t)e), number(block, "corners", (size_t)low),
                              number(block, "corners", (size_t)(low | 1 << axis))),
                         number(block, "extent_grid", (size_t)axis));
    }
    for (size_t s = 0; s < 6; s++) {
        const json_t *list = json_array_get(sides, s);
        __int128 area = 0;
        for (size_t i = 0; i < json_array_size(list); i++) {
            json_t *patch = item("patches", json_integer_value(json_array_get(list, i)));
            area += (__int128)number(patch, "extent_grid", 0) * number(patch, "extent_grid", 1);
            bool back = false;
            for (size_t k = 0; k < json_array_size(json_object_get(patch, "blocks")); k++)
                back =
                    back || (number(patch, "blocks", k) == b && number(patch, "sides", k) == (json_int_t)s);
            assert_true(back);
        }
        assert_true(area == (__int128)number(block, "extent_grid", (s / 2 + 1) % 3) *
                                number(block, "extent_grid", (s / 2 + 2) % 3));
    }
}

static void check_doubles(void) {
    int exponent = (int)json_integer_value(json_object_get(json_object_get(file, "grid"), "exponent"));
    for (size_t i = 0; i < count("arcs"); i++) {
        const json_t *arc = item("arcs", (json_int_t)i);
        double length = json_real_value(json_object_get(arc, "length"));
        if (json_is_integer(json_object_get(arc, "length")))
            length = json_number_value(json_object_get(arc, "length"));
        assert_true(length ==
                    ldexp((double)json_integer_value(json_object_get(arc, "length_grid")), -exponent));
    }
}

/* Nodes are where the traced mesh has their vertices. */
static void check_nodes(const encoded *e) {
    size_t size;
    char *text = encode_read(e, "traced.hexex", &size), *at = strchr(text, '\n') + 1;
    double(*x)[3] = calloc(e->report.quality.traced_vertices, sizeof *x);
    for (size_t i = 0; i < 3 * e->report.quality.traced_vertices; i++) x[i / 3][i % 3] = strtod(at, &at);
    for (size_t i = 0; i < count("nodes"); i++) {
        const json_t *node = item("nodes", (json_int_t)i);
        json_int_t v = json_integer_value(json_object_get(node, "vertex"));
        for (size_t k = 0; k < 3; k++)
            assert_true(json_number_value(json_array_get(json_object_get(node, "position"), k)) == x[v][k]);
    }
    free(x), free(text);
}

static void patches_and_blocks_are_rectangles_and_cuboids_that_fit(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof samples / sizeof *samples; i++) {
        encoded e;
        encode_prepare(&e, samples[i].name, 1, 0.6, samples[i].kind);
        encode_run(&e);
        json_error_t error;
        file = json_load_file(kit_temp_path("%s/blocks.json", strrchr(e.folder, '/') + 1), 0, &error);
        if (!file) fail_msg("%s: %s", samples[i].name, error.text);
        assert_int_equal(count("nodes"), e.complex.node_count);
        assert_int_equal(count("arcs"), e.complex.arc_count);
        assert_int_equal(count("patches"), e.complex.patch_count);
        assert_int_equal(count("blocks"), e.complex.block_count);
        for (size_t p = 0; p < count("patches"); p++)
            check_patch((json_int_t)p), check_transition((json_int_t)p);
        for (size_t b = 0; b < count("blocks"); b++) check_block((json_int_t)b);
        check_doubles();
        check_nodes(&e);
        json_decref(file);
        encode_clear(&e);
    }
}

static void lengths_beyond_doubles_are_written_as_text(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    e.complex.block_extent[0][1] = ((int64_t)1 << 53) + 1;
    e.complex.block_extent[0][2] = ((int64_t)1 << 53) - 1;
    double(*position)[3] = calloc(e.cells.vertex_count, sizeof *position), volume[1] = {1};
    uint64_t bytes;
    const char *path = kit_temp_path("long.json");
    kit_expect_ok(&e.ctx, bw_blocks_write(&e.ctx, &e.cells, &e.complex, "mc", NULL, volume,
                                          (const double(*)[3])position, path, &bytes));
    size_t size;
    char *text = kit_read_file(path, &size);
    assert_int_equal(size, bytes);
    assert_non_null(strstr(text, ", \"9007199254740993\", 9007199254740991]"));
    free(text), free(position);
    encode_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(patches_and_blocks_are_rectangles_and_cuboids_that_fit),
        cmocka_unit_test(lengths_beyond_doubles_are_written_as_text),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
