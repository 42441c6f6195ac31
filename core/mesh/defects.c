#include "mesh/defects.h"

#include <math.h>
#include <string.h>

#include "base/forest.h"
#include "mesh/gridmap.h"

void bw_defects_clear(bw_context *ctx, bw_defects *defects) {
    bw_free(ctx, defects->first);
    bw_free(ctx, defects->tet);
    *defects = (bw_defects){0};
}

static bw_status list_tets(bw_context *ctx, const bw_tet_mesh *mesh, const int64_t (*value)[4][3],
                           bw_tet **out, size_t *count) {
    size_t room = 0;
    *out = NULL;
    *count = 0;
    for (size_t t = 0; t < mesh->tet_count; t++) {
        if (bw_grid_tet_sign(value[t]) > 0) continue;
        if (bw_reserve(ctx, out, &room, *count + 1)) break;
        (*out)[(*count)++] = (bw_tet)t;
    }
    return ctx->error.status;
}

/* parent[i]: the lowest tet of the list, by its place there, in the same region as tet i. */
static bw_status join(bw_context *ctx, const bw_tet_mesh *mesh, const bw_tet *tet, size_t count,
                      int32_t *parent) {
    int32_t *at = bw_alloc(ctx, mesh->vertex_count, sizeof *at); /* the last tet seen at a vertex, plus 1 */
    if (!at) return ctx->error.status;
    for (size_t i = 0; i < count; i++) {
        parent[i] = (int32_t)i;
        for (int c = 0; c < 4; c++) {
            int32_t *last = &at[mesh->tet[tet[i]][c]];
            if (*last) bw_forest_join(parent, (int32_t)i, *last - 1);
            *last = (int32_t)i + 1;
        }
    }
    for (size_t i = 0; i < count; i++) parent[i] = bw_forest_root(parent, (int32_t)i);
    bw_free(ctx, at);
    return BW_OK;
}

/* Sorts the tets by region; parent becomes the region. */
static bw_status group(bw_context *ctx, bw_defects *defects, const bw_tet *tet, size_t count,
                       int32_t *parent) {
    for (size_t i = 0; i < count; i++)
        parent[i] = parent[i] == (int32_t)i ? (int32_t)defects->count++ : parent[parent[i]];
    defects->first = bw_alloc(ctx, defects->count + 2, sizeof *defects->first);
    defects->tet = bw_alloc(ctx, count, sizeof *defects->tet);
    if (!defects->first || !defects->tet) return ctx->error.status;
    for (size_t i = 0; i < count; i++) defects->first[parent[i] + 2]++;
    for (size_t r = 0; r < defects->count; r++) defects->first[r + 2] += defects->first[r + 1];
    for (size_t i = 0; i < count; i++) defects->tet[defects->first[parent[i] + 1]++] = tet[i];
    return BW_OK;
}

bw_status bw_defects_init(bw_context *ctx, bw_defects *defects, const bw_tet_mesh *mesh,
                          const int64_t (*value)[4][3]) {
    bw_tet *tet;
    size_t count;
    *defects = (bw_defects){0};
    bw_status status = list_tets(ctx, mesh, value, &tet, &count);
    int32_t *parent = status == BW_OK && count ? bw_alloc(ctx, count, sizeof *parent) : NULL;
    if (parent && !join(ctx, mesh, tet, count, parent)) group(ctx, defects, tet, count, parent);
    bw_free(ctx, parent);
    bw_free(ctx, tet);
    if (ctx->error.status) bw_defects_clear(ctx, defects);
    return ctx->error.status;
}

void bw_defects_place(const bw_defects *defects, const bw_tet_mesh *mesh, size_t region, bw_region *out) {
    size_t begin = defects->first[region], end = defects->first[region + 1];
    memset(out, 0, sizeof *out);
    for (int k = 0; k < 3; k++) out->low[k] = INFINITY, out->high[k] = -INFINITY;
    for (size_t i = begin; i < end; i++, out->tet_count++) {
        bw_tet t = defects->tet[i];
        double centre[3];
        bw_tet_centre(mesh, t, centre);
        if (out->tet_count < BW_REGION_TETS) out->tets[out->tet_count] = mesh->tet_id[t];
        for (int k = 0; k < 3; k++) out->centre[k] += centre[k] / (double)(end - begin);
        for (int i12 = 0; i12 < 12; i12++) {
            int k = i12 % 3;
            double x = mesh->position[mesh->tet[t][i12 / 3]][k];
            out->low[k] = fmin(out->low[k], x), out->high[k] = fmax(out->high[k], x);
        }
    }
}

void bw_defects_blame(bw_context *ctx, const bw_defects *defects, const bw_tet_mesh *mesh, size_t region) {
    bw_region place;
    bw_defects_place(defects, mesh, region, &place);
    bw_fail_region(ctx, &place);
    for (size_t i = defects->first[region]; i < defects->first[region + 1]; i++) {
        double centre[3];
        bw_tet_centre(mesh, defects->tet[i], centre);
        bw_fail_element(ctx, "tet", mesh->tet_id[defects->tet[i]], centre);
    }
}
