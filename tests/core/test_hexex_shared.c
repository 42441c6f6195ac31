/* Every real input loads, with the counts that its lines state; visibly skipped where the shared data is absent. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/hexex.h"
#include "format/hexex_write.h"

typedef struct {
    size_t vertices, tets, walls, feature[3];
} counts;

/* The counts as the text has them, found by counting lines and words: nothing of the reader is used. */
static const char *skip_lines(const char *text, size_t lines) {
    for (; lines && text; lines--) text = strchr(text, '\n') ? strchr(text, '\n') + 1 : NULL;
    return text ? text : "";
}

static counts counts_of(const char *text) {
    counts c = {0};
    c.vertices = strtoul(text, NULL, 10);
    text = skip_lines(text, 1 + c.vertices);
    c.tets = strtoul(text, NULL, 10);
    text = skip_lines(text, 1 + c.tets);
    size_t n[3];
    char line[200];
    snprintf(line, sizeof line, "%.*s", (int)strcspn(text, "\n"), text);
    if (sscanf(line, "%zu %zu %zu", &n[0], &n[1], &n[2]) == 1) {
        c.walls = n[0];
        text = skip_lines(text, 1 + c.walls);
    }
    snprintf(line, sizeof line, "%.*s", (int)strcspn(text, "\n"), text);
    if (sscanf(line, "%zu %zu %zu", &n[0], &n[1], &n[2]) == 3) memcpy(c.feature, n, sizeof n);
    return c;
}

static void expect_bytes_like_strtod(const char *text, const bw_tet_mesh *m) {
    char *at = (char *)(uintptr_t)skip_lines(text, 1);
    for (size_t v = 0; v < m->vertex_count; v++)
        for (int i = 0; i < 3; i++) assert_true(strtod(at, &at) == m->position[v][i]);
    at = (char *)(uintptr_t)skip_lines(at, 2);
    for (size_t t = 0; t < m->tet_count; t++) {
        for (int i = 0; i < 4; i++) assert_int_equal(strtol(at, &at, 10), m->tet[t][i]);
        for (int i = 0; i < 12; i++) {
            double d = strtod(at, &at);
            if (*at == '/') at += strcspn(at, " \n"); /* rationals are compared in test_hexex_number */
            else assert_true(d == m->parameter[t][i / 3][i % 3]);
        }
    }
}

static size_t load_all(const char *folder) {
    size_t count;
    char **names = kit_names(folder, ".hexex", &count);
    for (size_t i = 0; i < count; i++) {
        char path[1024];
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        bw_context ctx;
        bw_tet_mesh m;
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, bw_hexex_read(&ctx, path, &m));
        char *text = kit_read_file(path, NULL);
        counts c = counts_of(text);
        if (c.vertices != m.vertex_count || c.tets != m.tet_count || c.walls != m.wall_count || c.feature[0] != m.feature_vertex_count ||
            c.feature[1] != m.feature_edge_count || c.feature[2] != m.feature_facet_count)
            fail_msg("%s: the counts differ", names[i]);
        expect_bytes_like_strtod(text, &m);
        free(text);
        bw_tet_mesh_clear(&ctx, &m);
        assert_int_equal(ctx.memory.used, 0);
    }
    kit_names_free(names, count);
    return count;
}

static void all_tet_models_load(void **state) {
    (void)state;
    assert_true(load_all(kit_shared("data/tet")) >= 30);
}

static void all_models_with_features_load(void **state) {
    (void)state;
    assert_true(load_all(kit_shared("data/tet-features")) >= 4);
}

static void all_models_with_walls_and_rationals_load(void **state) {
    (void)state;
    assert_true(load_all(kit_shared("data/tet-walls")) >= 3);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(all_tet_models_load),
    cmocka_unit_test(all_models_with_features_load),
    cmocka_unit_test(all_models_with_walls_and_rationals_load),
};
KIT_MAIN(tests)
