#include "models/models.h"

#include <math.h>
#include <string.h>

#include "models/build.h"

void bw_model_options_defaults(bw_model_options *options) {
    *options = (bw_model_options){.size = 3, .stretch = 1, .noise = 0.6, .seed = 1};
}

void bw_model_clear(bw_context *ctx, bw_model *model) {
    bw_free(ctx, model->position);
    bw_free(ctx, model->tet);
    bw_free(ctx, model->parameter);
    bw_free(ctx, model->feature_vertex);
    bw_free(ctx, model->feature_edge);
    memset(model, 0, sizeof *model);
}

static bw_status check_options(bw_context *ctx, const bw_model_options *o) {
    if (o->size < 1 || o->size > 64) return bw_fail(ctx, BW_E_USAGE, "size must be 1 to 64, not %d", o->size);
    if (o->count < 0 || o->count > 16)
        return bw_fail(ctx, BW_E_USAGE, "count must be 0 to 16, not %d", o->count);
    if (!(o->stretch >= 0.01 && o->stretch <= 100))
        return bw_fail(ctx, BW_E_USAGE, "stretch must be 0.01 to 100, not %g", o->stretch);
    if (!(o->noise >= 0 && o->noise <= 1))
        return bw_fail(ctx, BW_E_USAGE, "noise must be 0 to 1, not %g", o->noise);
    if (!(o->perturb >= 0 && o->perturb <= 0.02))
        return bw_fail(ctx, BW_E_USAGE, "perturb must be 0 to 0.02, not %g", o->perturb);
    if (o->folds < 0 || o->folds > 1000)
        return bw_fail(ctx, BW_E_USAGE, "folds must be 0 to 1000, not %d", o->folds);
    if (o->scramble < BW_SCRAMBLE_NONE || o->scramble > BW_SCRAMBLE_TETS)
        return bw_fail(ctx, BW_E_USAGE, "scramble must be 0 to 3, not %d", o->scramble);
    return BW_OK;
}

static bool sharp(const bw_layout *l, int32_t edge) {
    return l->edge[edge].boundary && bw_layout_singular(l, edge);
}

static void list_feature_edge(bw_build *w, int32_t block, int edge) {
    const bw_layout *l = &w->layout;
    int axis = edge / 4, n = bw_layout_cells(l, block, axis), index[3];
    index[(axis + 1) % 3] = edge & 1 ? bw_layout_cells(l, block, (axis + 1) % 3) : 0;
    index[(axis + 2) % 3] = edge & 2 ? bw_layout_cells(l, block, (axis + 2) % 3) : 0;
    for (int i = 0; i < n; i++) {
        int32_t *out = w->model->feature_edge[w->model->feature_edge_count++];
        index[axis] = i;
        out[0] = bw_grid_vertex(w, block, index);
        index[axis] = i + 1;
        out[1] = bw_grid_vertex(w, block, index);
    }
}

/* Sharp edges of the boundary, and the nodes in which other than two of them meet (they are grid vertices,
 * and noise leaves them on their edge). */
static bw_status list_features(bw_build *w) {
    const bw_layout *l = &w->layout;
    bw_model *m = w->model;
    if (!w->options->features) return BW_OK;
    size_t edges = 0;
    for (size_t e = 0; e < l->edge_count; e++)
        edges += sharp(l, (int32_t)e) ? (size_t)l->sheet[l->edge[e].sheet].cells : 0;
    m->feature_edge = bw_alloc(w->ctx, edges, sizeof *m->feature_edge);
    m->feature_vertex = bw_alloc(w->ctx, l->node_count, sizeof *m->feature_vertex);
    int *degree = bw_alloc(w->ctx, l->node_count, sizeof *degree);
    bool *listed = bw_alloc(w->ctx, l->edge_count, sizeof *listed);
    bw_status status = w->ctx->error.status;
    for (size_t i = 0; !status && i < 12 * l->block_count; i++) {
        int32_t e = l->block[i / 12].edge[i % 12];
        if (listed[e] || !sharp(l, e)) continue;
        listed[e] = true;
        degree[l->edge[e].node[0]]++;
        degree[l->edge[e].node[1]]++;
        list_feature_edge(w, (int32_t)(i / 12), (int)(i % 12));
    }
    for (size_t v = 0; !status && v < l->node_count; v++)
        if (degree[v] && degree[v] != 2) m->feature_vertex[m->feature_vertex_count++] = (int32_t)v;
    bw_free(w->ctx, degree);
    bw_free(w->ctx, listed);
    return status;
}

bw_status bw_model_make(bw_context *ctx, const char *name, const bw_model_options *options, bw_model *out) {
    bw_build w = {.ctx = ctx, .options = options, .model = out};
    memset(out, 0, sizeof *out);
    bw_layout_init(ctx, &w.layout);
    bw_status status = check_options(ctx, options);
    if (!status) status = bw_shape_make(name, options->count, &w.layout);
    if (!status) status = bw_layout_finish(&w.layout, options->size, options->stretch, options->integral);
    if (!status) status = bw_grid_make(&w);
    if (!status) status = bw_noise_apply(&w);
    if (!status) status = list_features(&w);
    if (!status) status = bw_folds_apply(&w);
    if (!status) status = bw_charts_apply(&w);
    if (!status) status = bw_perturb_apply(&w);
    out->blocks_bc = w.layout.blocks_bc;
    out->euler = w.layout.euler;
    out->singular_inside = w.layout.singular_inside;
    void *all[] = {w.edge_first, w.face_first, w.block_first, w.star, w.home, w.tet_block, w.tet_cell};
    for (size_t i = 0; i < sizeof all / sizeof *all; i++) bw_free(ctx, all[i]);
    bw_layout_clear(&w.layout);
    if (status) bw_model_clear(ctx, out);
    return status;
}
