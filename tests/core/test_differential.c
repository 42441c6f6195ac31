/* The differences of parameters that a quantization asks for (Q 6, equation 13) hold exactly in the input's map for the input's own lengths. */
#include "core/validity_kit.h"

#include "format/constraints_json.h"
#include "quantize/differential.h"

#include <jansson.h>

/* Coordinates of a node in the chart of a tet that holds it, in grid units. */
static void locate(const quantizable *q, bw_node node, bw_tet tet, int64_t out[3]) {
    assert_int_equal(bw_cells_locate(&q->cells, q->complex.node_vertex[node], tet, out), 0); /* nodes lie on the grid */
}

static bw_facet facet_between(const quantizable *q, bw_tet a, bw_tet b) {
    for (int i = 0; i < 4; i++)
        if (bw_tet_across(&q->mesh, q->mesh.tet_facet[a][i], a) == b) return q->mesh.tet_facet[a][i];
    fail_msg("%s: tets %d and %d of a path do not touch", q->name, a, b);
    return BW_NONE;
}

static void check_difference(const quantizable *q, const bw_differential *d, size_t i, int64_t factor) {
    const bw_difference *n = &d->difference[i];
    size_t first = d->tet_begin[i], last = d->tet_begin[i + 1] - 1;
    int64_t from[3], to[3];
    assert_true(first <= last && n->axes);
    locate(q, n->from, d->tet[first], from);
    locate(q, n->to, d->tet[last], to);
    for (size_t k = first; k < last; k++) {
        bw_transition across = bw_grid_map_across(&q->mesh, &q->map, facet_between(q, d->tet[k], d->tet[k + 1]), d->tet[k]);
        bw_transition_apply(&across, from, from);
    }
    for (int k = 0; k < 3; k++)
        if (n->vector[k] != factor * (to[k] - from[k])) fail_msg("%s: difference %zu is not that of the map", q->name, i);
}

static size_t differences, loops, stand_ins;

static void check_all(quantizable *q) {
    const bw_critical *c = bw_validity_critical(q->validity);
    bw_validity_figures f = bw_validity_count(q->validity);
    for (int64_t factor = 1; factor <= 3; factor += 2) {
        bw_differential d;
        for (size_t a = 0; a < q->complex.arc_count; a++) q->length[a] = factor * q->complex.arc_length[a];
        kit_expect_ok(&q->ctx, bw_differential_init(&q->ctx, &q->cells, q->validity, q->length, &d));
        size_t alone = 0, round = 0, partial = 0;
        for (size_t i = 0; i < d.count; i++) {
            check_difference(q, &d, i, factor);
            round += d.difference[i].from == d.difference[i].to;
            partial += d.difference[i].axes != 7;
        }
        for (size_t l = 0; l < c->link_count; l++) alone += bw_critical_link_is_cycle(&q->complex, c, l);
        for (size_t r = 0; r < c->region_count; r++) { /* closed ones: they touch nothing but themselves */
            bw_critical_entity e = bw_critical_region_entity(c, (int32_t)r);
            alone += c->touch_begin[e + 1] - c->touch_begin[e] == 1;
        }
        assert_int_equal(d.root_count, 1);
        assert_int_equal(round, f.volume_generators);
        size_t all = c->node_count + alone; /* one of them is the root, if there is any */
        assert_int_equal(d.count, round + all - (all > 0));
        assert_int_equal(partial, alone - (alone > 0 && !c->node_count));
        differences += d.count, loops += round, stand_ins += partial;
        bw_differential_clear(&q->ctx, &d);
    }
}

static void differences_hold_in_the_map_they_come_from(void **state) {
    (void)state;
    size_t count;
    const bw_model_info *models = bw_model_list(&count);
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 4; k++) {
            quantizable q;
            bw_model_options options;
            bw_model_options_defaults(&options);
            options.size = 1, options.noise = 0.5, options.seed = i + 3, options.features = k == 3, options.scramble = k;
            quantizable_open(&q, models[i].name, &options, k & 1 ? BW_COMPLEX_BC : BW_COMPLEX_MC, k == 0 ? BW_REDUCE_NONE : BW_REDUCE_FULL);
            check_all(&q);
            quantizable_close(&q);
        }
    for (size_t i = 0; i < FLAT_SHAPES; i++) {
        quantizable q;
        quantizable_open_flat(&q, &flat_shapes[i], BW_REDUCE_NONE);
        check_all(&q);
        quantizable_close(&q);
    }
    print_message("%zu differences, %zu around loops, %zu of cycles and closed regions\n", differences, loops, stand_ins);
    assert_true(loops > 50 && stand_ins > 50);
}

static void differences_hold_in_real_maps(void **state) {
    (void)state;
    static const char *const folders[] = {"data/tet", "data/tet-features"};
    for (int k = 0; k < 2; k++) {
        size_t count;
        const char *folder = kit_shared(folders[k]);
        char **names = kit_names(folder, ".hexex", &count);
        for (size_t i = 0; i < count; i++) {
            quantizable q;
            quantizable_open_file(&q, folder, names[i], BW_REDUCE_FULL);
            check_all(&q);
            quantizable_close(&q);
        }
        kit_names_free(names, count);
    }
}

/* Weights add up to 1 and give the node's position; critical nodes are vertices. */
static void nodes_are_combinations_of_vertices(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 2, options.noise = 0.6;
    quantizable_open(&q, "tee", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    const bw_critical *c = bw_validity_critical(q.validity);
    size_t inside = 0;
    for (size_t a = 0; a < q.complex.arc_count; a++) {
        bw_node n = q.complex.arc_node[a][0];
        bw_half h = q.cells.edge[q.complex.arc_edge[q.complex.arc_edge_begin[a]]].half;
        bw_tet tet = bw_cells_tet(&q.cells, q.cells.polygon[q.cells.half[h].polygon].cell[0]);
        double weight[4], sum = 0, at[3], expected[3];
        int parts = 0;
        bw_differential_weights(&q.cells, &q.complex, n, tet, weight);
        for (int i = 0; i < 4; i++) assert_true(weight[i] >= 0), sum += weight[i], parts += weight[i] > 0;
        assert_true(fabs(sum - 1) < 1e-15 * 8);
        bw_cells_position(&q.cells, q.complex.node_vertex[n], expected);
        for (int k = 0; k < 3; k++) {
            at[k] = 0;
            for (int i = 0; i < 4; i++) at[k] += weight[i] * q.mesh.position[q.mesh.tet[tet][i]][k];
            assert_true(fabs(at[k] - expected[k]) < 1e-9);
        }
        if (c->node[n]) assert_int_equal(parts, 1);
        inside += parts > 1;
    }
    assert_true(inside > 10);
    quantizable_close(&q);
}

static void the_file_says_what_was_found(void **state) {
    (void)state;
    quantizable q;
    bw_differential d;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1, options.noise = 0.6;
    quantizable_open(&q, "torus-half", &options, BW_COMPLEX_MC, BW_REDUCE_NONE);
    for (size_t a = 0; a < q.complex.arc_count; a++) q.length[a] = q.complex.arc_length[a];
    kit_expect_ok(&q.ctx, bw_differential_init(&q.ctx, &q.cells, q.validity, q.length, &d));
    char *text[2];
    for (int i = 0; i < 2; i++) {
        uint64_t bytes;
        size_t size;
        const char *path = kit_temp_path("constraints-%d.json", i);
        kit_expect_ok(&q.ctx, bw_constraints_write(&q.ctx, &q.cells, &q.complex, &d, path, &bytes));
        text[i] = kit_read_file(path, &size);
        assert_int_equal(size, bytes);
    }
    assert_string_equal(text[0], text[1]);
    json_t *root = json_loads(text[0], 0, NULL), *list = json_object_get(root, "differences");
    assert_int_equal(json_array_size(json_object_get(root, "roots")), 1);
    assert_int_equal(json_array_size(list), d.count);
    for (size_t i = 0; i < d.count; i++) {
        json_t *row = json_array_get(list, i), *tets = json_object_get(row, "tets");
        assert_int_equal(json_array_size(tets), d.tet_begin[i + 1] - d.tet_begin[i]);
        assert_int_equal(json_integer_value(json_array_get(tets, 0)), q.mesh.tet_id[d.tet[d.tet_begin[i]]]);
        for (size_t k = 0; k < 3; k++)
            assert_int_equal(json_integer_value(json_array_get(json_object_get(row, "vector"), k)), d.difference[i].vector[k]);
        assert_int_equal(json_integer_value(json_object_get(json_object_get(row, "to"), "node")), d.difference[i].to);
    }
    json_decref(root);
    free(text[0]), free(text[1]);
    bw_differential_clear(&q.ctx, &d);
    quantizable_close(&q);
}

static bw_status find(bw_context *ctx, void *user) {
    quantizable *q = user;
    bw_differential d;
    bw_status status = bw_differential_init(ctx, &q->cells, q->validity, q->length, &d);
    bw_differential_clear(ctx, &d);
    return status;
}

static void running_out_of_memory_leaks_nothing(void **state) {
    (void)state;
    quantizable q;
    bw_model_options options;
    bw_model_options_defaults(&options);
    options.size = 1;
    quantizable_open(&q, "tee", &options, BW_COMPLEX_MC, BW_REDUCE_FULL);
    assert_true(kit_fail_each_allocation(find, &q) > 10);
    quantizable_close(&q);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(differences_hold_in_the_map_they_come_from),
    cmocka_unit_test(differences_hold_in_real_maps),
    cmocka_unit_test(nodes_are_combinations_of_vertices),
    cmocka_unit_test(the_file_says_what_was_found),
    cmocka_unit_test(running_out_of_memory_leaks_nothing),
};
KIT_MAIN(tests)
