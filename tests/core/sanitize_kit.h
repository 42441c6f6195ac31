/* What the tests of stage sanitize share: sample models as the stage's input, and a run of the stage. */
#ifndef BW_TESTS_SANITIZE_KIT_H
#define BW_TESTS_SANITIZE_KIT_H

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "kit/kit.h"
#include "models/models.h"
#include "stage/sanitize.h"

typedef struct {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_sanitize_report report;
    bw_status status;
} sanitized;

static inline void *copy_of(bw_context *ctx, const void *data, size_t count, size_t size) {
    void *copy = bw_alloc(ctx, count, size);
    if (copy && count) memcpy(copy, data, count * size);
    return copy;
}

/* The model as a reader would leave it. */
static inline bw_status mesh_from_model(bw_context *ctx, const bw_model *model, bw_tet_mesh *mesh) {
    *mesh = (bw_tet_mesh){.vertex_count = model->vertex_count,
                          .tet_count = model->tet_count,
                          .feature_vertex_count = model->feature_vertex_count,
                          .feature_edge_count = model->feature_edge_count};
    mesh->position = copy_of(ctx, model->position, model->vertex_count, sizeof *mesh->position);
    mesh->tet = copy_of(ctx, model->tet, model->tet_count, sizeof *mesh->tet);
    mesh->parameter = copy_of(ctx, model->parameter, model->tet_count, sizeof *mesh->parameter);
    mesh->feature_vertex =
        copy_of(ctx, model->feature_vertex, model->feature_vertex_count, sizeof *mesh->feature_vertex);
    mesh->feature_edge =
        copy_of(ctx, model->feature_edge, model->feature_edge_count, sizeof *mesh->feature_edge);
    return ctx->error.status;
}

static inline bw_model make_model(const char *name, const bw_model_options *options) {
    bw_context ctx;
    bw_model model;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_model_make(&ctx, name, options, &model));
    return model;
}

static inline void drop_model(bw_model *model) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_model_clear(&ctx, model);
}

static inline bw_model_options model_options(int size, double noise, double perturb, int scramble,
                                             uint64_t seed) {
    bw_model_options o;
    bw_model_options_defaults(&o);
    o.size = size, o.noise = noise, o.perturb = perturb, o.scramble = scramble, o.seed = seed;
    return o;
}

static inline void sanitize_mesh(sanitized *s, double tolerance) {
    bw_sanitize_options options = {.tolerance = tolerance};
    s->status = bw_sanitize(&s->ctx, &options, &s->mesh, &s->map, &s->report);
}

static inline void sanitize_model(sanitized *s, const bw_model *model, double tolerance) {
    *s = (sanitized){0};
    bw_context_init(&s->ctx);
    kit_expect_ok(&s->ctx, mesh_from_model(&s->ctx, model, &s->mesh));
    sanitize_mesh(s, tolerance);
}

static inline void drop_sanitized(sanitized *s) {
    bw_tet_mesh_clear(&s->ctx, &s->mesh);
    bw_grid_map_clear(&s->ctx, &s->map);
    assert_int_equal(s->ctx.memory.used, 0);
}

/* A mesh of `tets` unit-cube-like tets given by hand: positions are the parameters of one global chart. */
static inline void start_by_hand(sanitized *s, size_t vertices, const double (*position)[3], size_t tets,
                                 const int (*tet)[4]) {
    *s = (sanitized){0};
    bw_context_init(&s->ctx);
    s->mesh.vertex_count = vertices;
    s->mesh.tet_count = tets;
    s->mesh.position = copy_of(&s->ctx, position, vertices, sizeof *position);
    s->mesh.tet = copy_of(&s->ctx, tet, tets, sizeof *tet);
    s->mesh.parameter = bw_alloc(&s->ctx, tets, sizeof *s->mesh.parameter);
    for (size_t i = 0; i < 4 * tets; i++)
        memcpy(s->mesh.parameter[i / 4][i % 4], position[tet[i / 4][i % 4]], sizeof *position);
}

/* Independent of the map's own derivation: every transition maps every corner, boundary facets are constant.
 */
static inline void check_exact(const sanitized *s) {
    const bw_tet_mesh *m = &s->mesh;
    for (size_t f = 0; f < m->facet_count; f++) {
        const bw_tet *t = m->facet_tet[f];
        for (int i = 0; i < 3; i++) {
            const int64_t *a = s->map.value[t[0]][bw_tet_corner(m, t[0], m->facet[f][i])];
            if (t[1] == BW_NONE) {
                const int64_t *z = s->map.value[t[0]][bw_tet_corner(m, t[0], m->facet[f][0])];
                assert_int_equal(a[s->map.align[f]], z[s->map.align[f]]);
                continue;
            }
            int64_t b[3];
            bw_transition across = bw_grid_map_across(m, &s->map, (bw_facet)f, t[0]);
            bw_transition_apply(&across, a, b);
            assert_memory_equal(b, s->map.value[t[1]][bw_tet_corner(m, t[1], m->facet[f][i])], sizeof b);
        }
    }
}

#endif
