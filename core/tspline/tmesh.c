#include "tspline/tmesh.h"

#include <string.h>

#include "tspline/parts.h"

bool bw_tmesh_is_extraordinary(const bw_complex *complex, bw_arc arc) {
    int quarters = complex->arc_quarters[arc];
    return complex->arc_flags[arc] & BW_ARC_BOUNDARY ? quarters > 2 : quarters != 4;
}

bw_transition bw_tmesh_out(const bw_atlas *atlas, bw_patch patch, int slot) {
    bw_transition t = bw_atlas_out(atlas, patch, slot);
    for (int k = 0; k < 3; k++) t.shift[k] *= BW_TMESH_UNIT;
    return t;
}

void bw_tmesh_clear(bw_context *ctx, bw_tmesh *mesh) {
    void *blocks[] = {mesh->cell_begin,   mesh->cell,      mesh->face,      mesh->joint, mesh->point, mesh->vertex_place,
                      mesh->vertex_flags, mesh->thickness, mesh->cut_begin, mesh->cut,
                      mesh->arc_vertex};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(mesh, 0, sizeof *mesh);
}

static bw_status check_lengths(bw_context *ctx, const bw_atlas *atlas) {
    for (size_t a = 0; a < atlas->complex->arc_count; a++)
        if (atlas->length[a] < 1)
            return bw_fail(ctx, BW_E_USAGE, "arc %zu has the length %lld: a T-mesh needs positive ones", a, (long long)atlas->length[a]);
    for (size_t i = 0; i < 3 * atlas->complex->block_count; i++)
        if (atlas->extent[i / 3][i % 3] >= (int64_t)1 << 56) return bw_fail(ctx, BW_E_RANGE, "block %zu is too long for a T-mesh", i / 3);
    return BW_OK;
}

bw_status bw_tmesh_init(bw_context *ctx, const bw_atlas *atlas, bw_tmesh *mesh) {
    *mesh = (bw_tmesh){.atlas = atlas};
    bw_status status = check_lengths(ctx, atlas);
    if (status == BW_OK) status = bw_tmesh_find_thickness(ctx, mesh);
    if (status == BW_OK) status = bw_tmesh_cut(ctx, mesh);
    if (status == BW_OK) status = bw_tmesh_number(ctx, mesh);
    if (status == BW_OK) status = bw_tmesh_join(ctx, mesh);
    if (status != BW_OK) bw_tmesh_clear(ctx, mesh);
    return status;
}
