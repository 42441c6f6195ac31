/* A sample model as a sanitized map: what tests of the later stages start from. */
#ifndef BW_TESTS_CORE_SAMPLE_MAP_H
#define BW_TESTS_CORE_SAMPLE_MAP_H

#include <string.h>

#include "models/models.h"
#include "stage/sanitize.h"

static inline bw_status sample_map(bw_context *ctx, const char *name, const bw_model_options *options, bw_tet_mesh *mesh,
                                   bw_grid_map *map) {
    bw_model model;
    bw_sanitize_report report;
    memset(mesh, 0, sizeof *mesh);
    memset(map, 0, sizeof *map);
    bw_status status = bw_model_make(ctx, name, options, &model);
    if (status == BW_OK) {
        mesh->vertex_count = model.vertex_count, mesh->tet_count = model.tet_count;
        mesh->position = model.position, mesh->tet = model.tet, mesh->parameter = model.parameter;
        model.position = NULL, model.tet = NULL, model.parameter = NULL;
        status = bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 1e-4}, mesh, map, &report);
    }
    bw_model_clear(ctx, &model);
    return status;
}

#endif
